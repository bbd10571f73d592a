"""The settings of a diagnosis: its thresholds and budgets, with their defaults and reasons.

``conf/diagnose.yaml`` takes its defaults of ``search`` from here, and ``--help`` what they mean. What a formula needs
to be computed accurately (the step of a finite difference, where an asymptote takes over) is no setting and stands
beside its formula.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated

from annotated_types import Interval

from sci_lightning.configuration.bounds import NonNegative, Positive, Repeats, Share
from sci_lightning.errors import BadInput

OF_UNKNOWN_SCENES = (
    "max_effects",
    "border_share",
    "candidates_fitted",
    "min_gain_nats",
    "rivals_fitted",
    "indistinct_nats",
)
"""Settings that a diagnosis of unknown scenes reads as well; all others are those of captures of known scenes alone."""


@dataclass(frozen=True)
class SearchSettings:
    """Thresholds and budgets of a diagnosis. One nat is one unit of natural log-likelihood.

    Attributes:
        max_effects: effects that the search may name, a count; one round for each bounds the run time.
        held_out_one_in: with n = 4, every 4th capture of each kind is held out as a whole, and one in n squared = 16
            blocks of the remaining captures; a quarter leaves the fits most of the data.
        verification_one_in: one capture of so many of each kind is kept for verification where the file does not choose
            them; 0 keeps none.
        find_bad_captures: whether captures that do not fit the others (mislabelled, moved, saturated) are left out.
        border_share: largest part of the field that may be left out on one side, because what lies beyond the patterns
            is unknown and a hypothesis would need it; with both sides at 3/8 a quarter of the field is left.
        candidates_fitted: candidates per round, a count, that are fitted jointly after screening, beside those that are
            chosen from a few values, which always are; more than one,
            because screening is only accurate to second order, and few, because a joint fit takes most of the time.
        min_gain_nats: gain in nats beyond the information criterion's penalty that an effect must bring; 2 nats
            are odds of 7.
        rivals_fitted: rivals of one effect, a count, that are fitted; the closest first.
        indistinct_nats: difference in nats below which captures are said not to tell two effects apart: odds of 400.
        max_unnamed: deviations without a name, a count, that are localised; it bounds the run time.
        significance: corrected p-value below which a residual test reports a structure: one camera without a fault in
            a thousand is called wrong.
        negligible_chi2: reduced chi2 on held-out pixels that has no practical relevance, however many pixels prove
            that it is above 1.
    """

    max_effects: Annotated[int, Interval(ge=0, le=10**9)] = 6
    held_out_one_in: Annotated[int, Interval(ge=2, le=10**9)] = 4
    verification_one_in: Annotated[int, Interval(ge=0, le=10**9)] = 5
    find_bad_captures: bool = True
    border_share: Annotated[float, Interval(ge=0, le=0.45)] = 0.375
    candidates_fitted: Repeats = 4
    min_gain_nats: NonNegative = 2.0
    rivals_fitted: Repeats = 2
    indistinct_nats: NonNegative = 6.0
    max_unnamed: Repeats = 3
    significance: Share = 1e-3
    negligible_chi2: Positive = 1.05

    def check_unknown_scenes(self) -> None:
        """Check that nothing was changed that a diagnosis of unknown scenes does not read.

        Raises:
            BadInput: such a setting differs from its default.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name not in OF_UNKNOWN_SCENES and value != field.default:
                raise BadInput(
                    f"search.{field.name}={value}: only captures of known scenes use it, and no scene is known; of "
                    f"search, unknown scenes use {', '.join(OF_UNKNOWN_SCENES)}"
                )
