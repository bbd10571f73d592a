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
    "min_progress_nats",
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
        held_out_block: side in pixels of the square blocks that are held out, wide enough that blurs and maps fitted
            around a block say little about its middle.
        held_out_one_in: with n = 4, every 4th capture of each kind is held out as a whole, and one in n squared = 16
            blocks of the remaining captures; a quarter leaves the fits most of the data.
        verification_one_in: one capture of so many of each kind is kept for verification where the file does not choose
            them; 0 keeps none.
        find_bad_captures: whether captures that do not fit the others (mislabelled, moved, saturated) are left out.
        border_share: largest part of the field that may be left out on one side, because what lies beyond the patterns
            is unknown and a hypothesis would need it; with both sides at 3/8 a quarter of the field is left.
        border_gain_share: part of the best candidate's gain from which a candidate's border is respected; a hypothesis
            that needs the surround gains too little while its border is too narrow.
        min_progress_nats: gain in nats below which a fit has converged; a twentieth of what one standard deviation of
            one parameter changes is far below every threshold of the search.
        coarse_pixels: pixels, a count, on which fits begin and strong candidates are screened if the captures have more
            than four times as many; enough that no parameter is undetermined.
        coarse_nats: gain in nats, on these pixels, from which a candidate is strong: far above what chance gives.
        candidates_fitted: candidates per round, a count, that are fitted jointly after screening, beside those that are
            chosen from a few values, which always are; more than one,
            because screening is only accurate to second order, and few, because a joint fit takes most of the time.
        screened_share: part of the nats that an effect must gain which screening must promise for a joint fit to be
            made; screening finds at least half of what a fit gains, even between two starts of a flicker.
        abandon_nats: nats by which a fit may stay behind another one for good before it is abandoned; well above what
            the criterion's penalty for parameters and held-out pixels make up for.
        min_gain_nats: gain in nats beyond the information criterion's penalty that an effect must bring; 2 nats
            are odds of 7.
        provisional_nats: gain in nats beyond that penalty from which an effect is added provisionally that held-out
            pixels do not confirm; small ones are nearly always chance. Below it, effects are compared once more with
            narrow borders.
        rival_nats: nats of an effect's evidence that another effect may leave unexplained and still be fitted in its
            place; well above ``indistinct_nats``, because screening is only accurate to second order.
        rival_fraction: the same as a part of the evidence, because large effects are not linear.
        rivals_fitted: rivals of one effect, a count, that are fitted; the closest first.
        rival_starts: settings of a rival, a count, from which its screening starts; it bounds the run time.
        indistinct_nats: difference in nats below which captures are said not to tell two effects apart: odds of 400.
        needed_nats: nats that further captures must bring on average, so that they bring ``indistinct_nats`` in 19 of
            20 cases. The log-likelihood ratio of two Gaussian predictions that are d nats apart has mean d and variance
            2 d, and d = 15 solves d - 1.645 sqrt(2 d) = 6.
        max_further_captures: captures of one kind, a count, that somebody may reasonably be asked to record.
        probe_min_sigma: standard deviations from 0 from which a free-form deviation keeps one of its numbers; of 250
            numbers chance keeps 0.1.
        probe_max_numbers: numbers, a count, that a free-form deviation keeps, the clearest; it bounds the run time.
        probe_max_derivatives: derivatives, a count, held in memory at once (4 bytes each); larger free-form deviations
            are left out.
        probes_fitted: free-form deviations per round, a count, that are fitted jointly after screening; see
            ``candidates_fitted``.
        max_unnamed: deviations without a name, a count, that are localised; it bounds the run time.
        max_map_p_value: p-value below which an estimated fixed-pattern map contradicts the definition of its effect
            (independent Gaussian values).
        max_residual_p_value: corrected p-value of a residual test below which something is left in the residuals while
            the noise is the datasheet's; one tenth of ``significance``, because formulas are not exact.
        significance: corrected p-value below which a residual test reports a structure: one camera without a fault in
            a thousand is called wrong.
        negligible_chi2: reduced chi2 on held-out pixels that has no practical relevance, however many pixels prove
            that it is above 1.
    """

    max_effects: Annotated[int, Interval(ge=0, le=10**9)] = 6
    held_out_block: Repeats = 16
    held_out_one_in: Annotated[int, Interval(ge=2, le=10**9)] = 4
    verification_one_in: Annotated[int, Interval(ge=0, le=10**9)] = 5
    find_bad_captures: bool = True
    border_share: Annotated[float, Interval(ge=0, le=0.45)] = 0.375
    border_gain_share: Share = 0.5
    min_progress_nats: Positive = 0.05
    coarse_pixels: Repeats = 60_000
    coarse_nats: Positive = 100.0
    candidates_fitted: Repeats = 4
    screened_share: Share = 0.33
    abandon_nats: NonNegative = 60.0
    min_gain_nats: NonNegative = 2.0
    provisional_nats: NonNegative = 100.0
    rival_nats: NonNegative = 24.0
    rival_fraction: Share = 0.03
    rivals_fitted: Repeats = 2
    rival_starts: Repeats = 12
    indistinct_nats: NonNegative = 6.0
    needed_nats: Positive = 15.0
    max_further_captures: Repeats = 50
    probe_min_sigma: NonNegative = 3.5
    probe_max_numbers: Repeats = 24
    probe_max_derivatives: Repeats = 250_000_000
    probes_fitted: Repeats = 3
    max_unnamed: Repeats = 3
    max_map_p_value: Share = 1e-4
    max_residual_p_value: Share = 1e-4
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
