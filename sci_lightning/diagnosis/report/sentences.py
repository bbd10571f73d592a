"""The result of a diagnosis in words: the headline of a report, and a clause about every effect."""

from __future__ import annotations

from collections.abc import Mapping

from sci_lightning.diagnosis.fit.gap import Gap
from sci_lightning.diagnosis.report.digits import chi2, quantity
from sci_lightning.diagnosis.result import Result
from sci_lightning.diagnosis.search.evidence import NamedEffect
from sci_lightning.diagnosis.verdict import NEGLIGIBLE
from sci_lightning.encoder.effects import Effect

MAX_CLAUSES = 3
"""Effects that a headline describes in words; of more it gives the names."""
MIN_FALL = 0.02
"""Relative fall that a figure must show for a headline to begin with it."""
NOTHING_LEFT = "nothing significant is left"
"""The end of a headline if the verdict is consistent or explained, and of no other."""


def headline(diagnosis: Result) -> str:
    """Return the verdict and the reasons for it in one sentence, which never contradicts the verdict."""
    verdict, effects, after = diagnosis.verdict, diagnosis.effects, diagnosis.after.gap
    if verdict == "consistent":
        allowed = f" ({_chance(after)})" if _acceptable_by_chance(after) else ""
        return (
            f"The captures agree with the ideal camera: held-out chi2 {chi2(after.chi2)}{allowed}, and {NOTHING_LEFT}."
        )
    if not effects:
        return f"{_disagreement(diagnosis)}: {_what_is_left(diagnosis)}."
    if len(effects) > MAX_CLAUSES:
        names = (effect.name + _alternatives(effect, " (or {})") for effect in effects)
        named = f"{len(effects)} effects act together: {', '.join(names)}"
    else:
        either = " (or it is {}, which these captures cannot tell from it)"
        clauses = [clause(effect) + _alternatives(effect, either) for effect in effects]
        named = " and ".join(filter(None, (", ".join(clauses[:-1]), clauses[-1])))
    if verdict == "unexplained":
        worthless = "does not make the held-out pixels likelier"
        return f"{_disagreement(diagnosis)}: to say that {named} {worthless}, and {_what_is_left(diagnosis)}."
    end = f"and {NOTHING_LEFT}" if verdict == "explained" else f"but {_what_is_left(diagnosis)}"
    return f"{named[0].upper()}{named[1:]}; with that in the model {improvement(diagnosis.before.gap, after)}, {end}."


def clause(effect: NamedEffect) -> str:
    """Return what an effect does, with its parameters and their statistical standard deviations.

    The words are the effect's own, see :meth:`~sci_lightning.encoder.effects.Effect.describe`.
    """
    values = {
        name: quantity(estimate.value, estimate.std, estimate.systematic)
        for name, estimate in effect.parameters.items()
    }
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


def _disagreement(diagnosis: Result) -> str:
    before, after = diagnosis.before.gap.chi2, diagnosis.after.gap.chi2
    free = f", {chi2(after)} in free form" if diagnosis.unnamed and after < 0.999 * before else ""
    return f"The captures disagree with the ideal camera (held-out chi2 {chi2(before)}{free}) and no name explains it"


def _what_is_left(diagnosis: Result) -> str:
    """Say why the verdict is neither ``consistent`` nor ``explained``."""
    if diagnosis.unnamed:
        places = ", and ".join(f"in the {unnamed.stage}, {unnamed.where}" for unnamed in diagnosis.unnamed)
        return f"something without a name is left ({places})" if diagnosis.effects else places
    if remaining := diagnosis.remaining:
        names = ", ".join(test.name for test in remaining[:4]) + (", .." if len(remaining) > 4 else "")
        return f"the residuals are not noise yet ({names})"
    gap = diagnosis.judging[1]
    unseen = "" if diagnosis.verification is None else " on captures that nothing has seen"
    return f"chi2{unseen} is {chi2(gap.chi2)}, {_chance(gap)}, and no test of the residuals says where it comes from"


def _acceptable_by_chance(gap: Gap) -> bool:
    """Return whether chi2 is acceptable only because there are few pixels."""
    return NEGLIGIBLE < gap.chi2 <= gap.chi2_limit


def _chance(gap: Gap) -> str:
    return f"chance alone reaches {chi2(gap.chi2_limit)} with {gap.pixels:,} pixels"


def _alternatives(effect: NamedEffect, text: str) -> str:
    """Return ``text`` with the effects that may be meant as well; nothing if there are none."""
    return text.format(" or ".join(effect.alternatives)) if effect.alternatives else ""
