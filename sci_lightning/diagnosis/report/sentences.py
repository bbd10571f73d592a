"""What was found, in plain words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sci_lightning.diagnosis.report.digits import chi2, quantity
from sci_lightning.diagnosis.residual_tests import ResidualTest
from sci_lightning.diagnosis.verdict import NEGLIGIBLE
from sci_lightning.encoder import effects

MOST = 3
"""Effects that a headline tells of in words."""
VISIBLE = 0.02
"""Part by which a figure has to fall for a headline to lead with it."""
CLEAN = "nothing significant is left"
"""What a headline ends with when the verdict is consistent or explained."""


def headline(report: Mapping[str, Any], left: Sequence[ResidualTest]) -> str:
    """Return the verdict and its reasons in one sentence; it never says anything else than ``report["verdict"]``.

    Args:
        report: ``report.json``.
        left: the residual tests that the verdict follows from, :attr:`Diagnosis.remaining`.
    """
    gap = report["gap"]["after"]
    if report["verdict"] == "consistent":
        allowed = f" ({_chance(gap)})" if _by_chance(gap) else ""
        return f"The captures agree with the ideal camera: held-out chi2 {chi2(gap['chi2'])}{allowed}, and {CLEAN}."
    if not report["effects"]:
        return f"{_disagreement(report)}: {_rest(report, left)}."
    described = [_admitting(effect) for effect in report["effects"]]
    found = " and ".join(filter(None, (", ".join(described[:-1]), described[-1])))
    if len(described) > MOST:
        names = (effect["name"] + _others(effect, "or {}") for effect in report["effects"])
        found = f"{len(described)} effects act together: {', '.join(names)}"
    if report["verdict"] == "unexplained":
        worthless = "does not make the held-out pixels likelier"
        return f"{_disagreement(report)}: to say that {found} {worthless}, and {_rest(report, left)}."
    end = f"and {CLEAN}" if report["verdict"] == "explained" else f"but {_rest(report, left)}"
    return f"{found[0].upper()}{found[1:]}; with that in the model {improvement(report)}, {end}."


def improvement(report: Mapping[str, Any]) -> str:
    """Say what the effects that were found improve on held-out pixels, in the figure in which it shows most plainly.

    That is the RMS error if it falls by more than ``VISIBLE``. It is chi2 if that does, which noise alone changes. If
    neither does, a weak effect is worth log-likelihood only.
    """
    before, after = report["gap"]["before"], report["gap"]["after"]
    reached = chi2(after["chi2"])
    fall = f"chi2 {chi2(before['chi2'])} to {reached}"
    if overestimated := before["chi2"] < 2 - before["chi2_limit"]:
        fall = f"from chi2 {chi2(before['chi2'])}, below 1 because the noise was overestimated, to {reached}"
    allowed = f", where {_chance(after)}" if _by_chance(after) else ""
    if after["rmse_dn"] < (1 - VISIBLE) * before["rmse_dn"]:
        rmse = [f"{gap['rmse_dn']:.3g}" for gap in (before, after)]
        return f"the held-out RMS error falls from {rmse[0]} to {rmse[1]} DN ({fall}{allowed})"
    if after["chi2"] < (1 - VISIBLE) * before["chi2"]:
        return f"the held-out misfit falls {fall if overestimated else f'from {fall}'}{allowed}"
    nats = (before["nll"] - after["nll"]) * after["pixels"]
    if nats >= 0.5:
        misfit = fall if overestimated else f"chi2 {reached}"
        return f"held-out pixels become likelier by {nats:,.0f} nats ({misfit}{allowed})"
    return f"the held-out misfit stays at chi2 {reached}{allowed}"


def _disagreement(report: Mapping[str, Any]) -> str:
    before, after = report["gap"]["before"]["chi2"], report["gap"]["after"]["chi2"]
    free = f", {chi2(after)} in free form" if report["unnamed"] and after < 0.999 * before else ""
    return f"The captures disagree with the ideal camera (held-out chi2 {chi2(before)}{free}) and no name explains it"


def _rest(report: Mapping[str, Any], left: Sequence[ResidualTest]) -> str:
    """Say why a verdict is neither ``consistent`` nor ``explained``."""
    gap, named = report["gap"]["after"], bool(report["effects"])
    if report["unnamed"]:
        places = ", and ".join(f"in the {each['stage']}, {each['where']}" for each in report["unnamed"])
        return f"something without a name is left ({places})" if named else places
    if left:
        names = ", ".join(test.name for test in left[:4]) + (", .." if len(left) > 4 else "")
        return f"the residuals are not noise yet ({names})"
    return f"chi2 is {chi2(gap['chi2'])}, {_chance(gap)}, and no test of the residuals says where it comes from"


def _by_chance(gap: Mapping[str, Any]) -> bool:
    """Return whether a chi2 is acceptable only because there are few pixels."""
    return bool(NEGLIGIBLE < gap["chi2"] <= gap["chi2_limit"])


def _chance(gap: Mapping[str, Any]) -> str:
    return f"chance alone reaches {chi2(gap['chi2_limit'])} with {gap['pixels']:,} pixels"


def _admitting(effect: Mapping[str, Any]) -> str:
    """An effect in words, and the effects that might as well be meant."""
    return say(effect) + _others(effect, "or it is {}, which these captures cannot tell from it")


def _others(effect: Mapping[str, Any], text: str) -> str:
    others = " or ".join(effect.get("alternatives", ()))
    return f" ({text.format(others)})" if others else ""


def say(effect: Mapping[str, Any]) -> str:
    """Return one effect of the report in words, with its parameters and their statistical standard deviations."""
    values = {name: parameter(content) for name, content in effect["parameters"].items()}
    known = {cls.name: cls for cls in (getattr(effects, name) for name in effects.__all__) if hasattr(cls, "name")}
    if effect["name"] in known:
        return known[effect["name"]].describe(values)
    units = {name: content["unit"].removeprefix("1") for name, content in effect["parameters"].items()}
    listed = ", ".join(f"{name} {value} {units[name]}".strip() for name, value in values.items())
    return f"{effect['name']} ({listed})"


def parameter(content: Mapping[str, Any]) -> str:
    """Return a parameter of the report as a number with the digits that mean something."""
    return quantity(content["value"], content["std"], content["systematic"])
