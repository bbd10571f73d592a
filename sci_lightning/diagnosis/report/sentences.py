"""The result of a diagnosis in words: headline, a clause for every effect, numbers with the digits that count."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from sci_lightning.diagnosis.blind.blind_diagnosis import BlindDiagnosis
from sci_lightning.diagnosis.fit.gap import Gap
from sci_lightning.diagnosis.result import CalibratedResult
from sci_lightning.diagnosis.search.evidence import Estimate, NamedEffect
from sci_lightning.diagnosis.search.probability import MIN_PROBABILITY, PRIOR_PROBABILITY
from sci_lightning.diagnosis.search.remaining_misfit import Unnamed
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.encoder.effects import Effect
from sci_lightning.encoder.effects.parameter import Value

MAX_CLAUSES = 3
"""Effects that a headline describes in words; of more it gives the names."""
MIN_FALL = 0.02
"""Relative fall that a figure must show for a headline to begin with it."""
NOTHING_LEFT = "nothing significant is left"
"""The end of a headline if the verdict is consistent or explained, and of no other."""


UNCERTAINTY = {
    "calibrated": (
        "Uncertainties are one standard deviation: from the noise of the captures, or, where they disagree by more "
        "than that, from how far captures, levels of light and parts of the field disagree. They contain the error "
        "that formulas are taken to have: a thousandth of what an effect changes, and two hundredths where exposures "
        "or targets have errors too. Other errors that all captures share come on top."
    ),
    "blind": (
        "Uncertainties are one standard deviation, from the differences between blocks and between snapshots, because "
        "the statistics of the scenes are only roughly right. What is the same for all scenes, such as an error of the "
        "patterns, comes on top."
    ),
}
"""What ``std`` and ``systematic`` of the report mean, for people, by the mode of the diagnosis."""


def headline(result: CalibratedResult | BlindDiagnosis) -> str:
    """Return the verdict and the reasons for it in one sentence, which never contradicts the verdict."""
    if isinstance(result, BlindDiagnosis):
        return _headline_of_unknown_scenes(result)
    verdict, effects, after = result.verdict, result.effects, result.after.gap
    if verdict == "consistent":
        allowed = f" ({_chance(after)})" if _acceptable_by_chance(after) else ""
        return (
            f"The captures agree with the ideal camera: held-out chi2 {chi2(after.chi2)}{allowed}, and {NOTHING_LEFT}."
        )
    if not effects:
        return f"{_disagreement(result)}: {_what_is_left(result)}."
    named = _named(effects, "captures")
    if verdict == "unexplained":
        worthless = "does not make the held-out pixels likelier"
        return f"{_disagreement(result)}: to say that {named} {worthless}, and {_what_is_left(result)}."
    end = f"and {NOTHING_LEFT}" if verdict == "explained" else f"but {_what_is_left(result)}"
    return f"{_capitalised(named)}; with that in the model {improvement(result.before.gap, after)}, {end}."


def _headline_of_unknown_scenes(result: BlindDiagnosis) -> str:
    if result.verdict == "undecided":
        camera = f" The likeliest camera: {_named(result.effects, 'snapshots')}." if result.effects else ""
        return f"{result.notes[0]}{camera}"
    if not result.effects:
        count = len(result.observation)
        snapshots = "The snapshot agrees" if count == 1 else f"The {count} snapshots agree"
        return f"{snapshots} with the ideal camera, as far as unknown scenes can tell."
    return f"{_capitalised(_named(result.effects, 'snapshots'))}: that makes snapshots of unknown scenes most likely."


def further_notes(result: BlindDiagnosis) -> tuple[str, ...]:
    """Return the notes beside the headline, which begins with the first one where the verdict is ``undecided``."""
    return result.notes[1:] if result.verdict == "undecided" else result.notes


def laboratory(result: CalibratedResult) -> str:
    """Say which errors the laboratory has, which no camera is blamed for."""
    clauses = (
        error.effect.describe({name: percentage_of_size(one) for name, one in error.parameters.items()})
        for error in result.imperfections
    )
    return f"In this laboratory {'; '.join(clauses)}"


def percentage_of_size(estimate: Estimate) -> str:
    """Return a relative size in per cent, with one standard deviation."""
    return f"{quantity(100 * float(estimate.value), 100 * estimate.std)} %"


def not_named(result: CalibratedResult) -> str:
    """Say which effects are not named although they are not certainly absent, the most probable first; may be empty."""
    doubtful = {name: one for name, one in result.not_named.items() if one >= PRIOR_PROBABILITY}
    return ", ".join(f"{name} ({doubtful[name]:.2f})" for name in sorted(doubtful, key=lambda name: -doubtful[name]))


def not_tried(result: CalibratedResult) -> str:
    """Say what the search left out for lack of time, and how to have it tried."""
    budget = result.budget
    return f"{', '.join(budget.not_tried)}, for lack of time; budget={2 * budget.seconds:.0f} gives it twice as much"


def _named(effects: Sequence[NamedEffect], captures: str) -> str:
    """Return effects as clauses, or as names where they are many, with those that may be meant as well."""
    if len(effects) > MAX_CLAUSES:
        names = (effect.name + _alternatives(effect, " (or {})") for effect in effects)
        return f"{len(effects)} effects act together: {', '.join(names)}"
    either = f" (or it is {{}}, which these {captures} cannot tell from it)"
    clauses = [clause(effect) + _alternatives(effect, either) for effect in effects]
    return " and ".join(filter(None, (", ".join(clauses[:-1]), clauses[-1])))


def _capitalised(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}"


def clause(effect: NamedEffect) -> str:
    """Return what an effect does, with its parameters and their statistical standard deviations.

    The words are the effect's own, see :meth:`~sci_lightning.encoder.effects.Effect.describe`.
    """
    values = {name: quantity(estimate.value, estimate.std) for name, estimate in effect.parameters.items()}
    return effect.effect.describe(values)


def considered(effects: Mapping[str, type[Effect]]) -> str:
    """Say how many effects might have been named, and which of them are not of the package.

    Args:
        effects: their classes by name.
    """
    own = [f"{name} ({path})" for name, path in class_paths(effects).items() if not path.startswith("sci_lightning.")]
    return f"{len(effects)} effects were considered" + (f", of your own: {', '.join(own)}" if own else "")


def class_paths(effects: Mapping[str, type[Effect]]) -> dict[str, str]:
    """Return the dotted paths of classes of effects, by name."""
    return {name: f"{effect.__module__}.{effect.__qualname__}" for name, effect in effects.items()}


def fallen(before: Gap, after: Gap) -> str:
    """Return which figure of held-out pixels shows most plainly that they are predicted better.

    Returns:
        ``rmse_dn`` if the RMS error falls by more than ``MIN_FALL``; otherwise ``chi2`` if that does, which noise alone
        changes; otherwise ``nll``, which is all that a weak effect improves; empty if they become no likelier.
    """
    if after.rmse_dn < (1 - MIN_FALL) * before.rmse_dn:
        return "rmse_dn"
    if after.chi2 < (1 - MIN_FALL) * before.chi2:
        return "chi2"
    return "nll" if nats_gained(before, after) >= 0.5 else ""


def nats_gained(before: Gap, after: Gap) -> float:
    """Return by how many nats all held-out pixels together become likelier."""
    return (before.nll - after.nll) * after.pixels


def improvement(before: Gap, after: Gap) -> str:
    """Say how much better held-out pixels are predicted, by the figure that :func:`fallen` chooses."""
    reached = chi2(after.chi2)
    fall = f"chi2 {chi2(before.chi2)} to {reached}"
    if overestimated := before.chi2 < 2 - before.chi2_limit:
        fall = f"from chi2 {chi2(before.chi2)}, below 1 because the noise was overestimated, to {reached}"
    allowed = f", where {_chance(after)}" if _acceptable_by_chance(after) else ""
    figure = fallen(before, after)
    if figure == "rmse_dn":
        return f"the held-out RMS error falls from {before.rmse_dn:.3g} to {after.rmse_dn:.3g} DN ({fall}{allowed})"
    if figure == "chi2":
        return f"the held-out misfit falls {fall if overestimated else f'from {fall}'}{allowed}"
    if figure == "nll":
        misfit = fall if overestimated else f"chi2 {reached}"
        return f"held-out pixels become likelier by {nats_gained(before, after):,.0f} nats ({misfit}{allowed})"
    return f"the held-out misfit stays at chi2 {reached}{allowed}"


def _disagreement(result: CalibratedResult) -> str:
    before, after = result.before.gap.chi2, result.after.gap.chi2
    free = f", {chi2(after)} in free form" if result.unnamed and after < 0.999 * before else ""
    return f"The captures disagree with the ideal camera (held-out chi2 {chi2(before)}{free}) and no name explains it"


def _what_is_left(result: CalibratedResult) -> str:
    """Say why the verdict is neither ``consistent`` nor ``explained``."""
    if result.unnamed:
        places = ", and ".join(f"{_perhaps(one)}in the {one.stage}, {one.where}" for one in result.unnamed)
        return f"something without a name is left ({places})" if result.effects else places
    if remaining := result.remaining:
        names = ", ".join(test.name for test in remaining[:4]) + (", .." if len(remaining) > 4 else "")
        return f"the residuals are not noise yet ({names})"
    gap = result.judging[1]
    unseen = "" if result.verification is None else " on captures that nothing has seen"
    return f"chi2{unseen} is {chi2(gap.chi2)}, {_chance(gap)}, and no test of the residuals says where it comes from"


def _perhaps(unnamed: Unnamed) -> str:
    return "perhaps " if unnamed.probability is not None and unnamed.probability < MIN_PROBABILITY else ""


def _acceptable_by_chance(gap: Gap) -> bool:
    """Return whether chi2 is acceptable only because there are few pixels."""
    return SearchSettings.negligible_chi2 < gap.chi2 <= gap.chi2_limit


def _chance(gap: Gap) -> str:
    return f"chance alone reaches {chi2(gap.chi2_limit)} with {gap.pixels:,} pixels"


def _alternatives(effect: NamedEffect, text: str) -> str:
    """Return ``text`` with the effects that may be meant as well; nothing if there are none."""
    return text.format(" or ".join(effect.alternatives)) if effect.alternatives else ""


def count_of(number: int, noun: str) -> str:
    """Return a number with its noun, in the plural unless it is one."""
    return f"{number} {noun}{'s' * (number != 1)}"


def quantity(value: Value, std: float = 0.0) -> str:
    """Return a number and its uncertainty, rounded to the second significant digit of that.

    Args:
        value: of a parameter; what is no ``float`` is a choice, and exact.
        std: its standard deviation.
    """
    if not isinstance(value, float):
        return str(value)
    if not 0 < std < math.inf or not math.isfinite(value):
        return f"{value:.6g}"
    place = math.floor(math.log10(std)) - 1
    return f"{_rounded(value, place)} \u00b1 {_rounded(std, place)}"


def percentage(probability: float | None) -> str:
    """Return a probability in per cent, never rounded to certainty; nothing if there is none."""
    if probability is None:
        return ""
    return "> 99.9 %" if probability > 0.999 else f"{100 * probability:.3g} %"


def uncertainty(std: float) -> str:
    """Return a standard deviation with two significant digits, nothing if there is none."""
    return _rounded(std, math.floor(math.log10(std)) - 1) if 0 < std < math.inf else ""


def chi2(value: float) -> str:
    """Return a reduced chi2 with the digits that mean something."""
    return f"{value:.0f}" if value >= 1000 else f"{value:.4g}" if value >= 10 else f"{value:.3f}"


def _rounded(value: float, place: int) -> str:
    """``value`` with the last digit at 10 ** place."""
    return f"{round(value, -place):.{max(0, -place)}f}"
