"""What a report's page shows of known scenes, and of unknown ones: its numbers, rounded, and its figures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from matplotlib.figure import Figure

from sci_lightning.diagnosis.blind.blind_diagnosis import BlindDiagnosis
from sci_lightning.diagnosis.blind.block_prediction import PredictionVerdict
from sci_lightning.diagnosis.fit.gap import Misfit
from sci_lightning.diagnosis.model.hypothesis import datasheet_noise
from sci_lightning.diagnosis.report import pictures
from sci_lightning.diagnosis.report.sentences import (
    chi2,
    count_of,
    fallen,
    further_notes,
    laboratory,
    nats_gained,
    not_named,
    not_tried,
)
from sci_lightning.diagnosis.residual_tests import ResidualTest
from sci_lightning.diagnosis.result import CalibratedResult

MAX_TEST_FIGURES = 8
"""Residual tests that are drawn."""


@dataclass(frozen=True)
class Card:
    """A figure at the head of the page.

    Attributes:
        value: the figure itself, as it is shown.
        label: what it is.
    """

    value: str
    label: str


def sections_of_known_scenes(result: CalibratedResult) -> dict[str, Any]:
    """Return what the template shows of a diagnosis of known scenes, by the template's names."""
    trade_offs = None
    if len(result.correlation.names) > 2:
        trade_offs = pictures.correlation_figure(list(result.correlation.names), result.correlation.matrix)
    significant = _significant_tests(result)
    tested = significant[:MAX_TEST_FIGURES]
    return {
        "captures": _captures(result),
        "notes": [
            *([] if result.unknown_scenes is None else [result.unknown_scenes.sentence()]),
            *([f"{laboratory(result)}."] if result.imperfections else []),
            *([f"Not named, with their probabilities: {doubtful}."] if (doubtful := not_named(result)) else []),
            *([f"Not tried: {not_tried(result)}."] if result.budget.not_tried else []),
        ],
        "cards": _cards(result),
        "afterwards": _named_afterwards(result),
        "correlation": result.correlation,
        "correlation_figure": trade_offs,
        "gap_rows": _gap_rows(result),
        "significance": f"{result.settings.significance:g}",
        "tolerated": sum(test.significant for test in result.after.tests) - len(result.remaining),
        "tests": _test_pairs(result),
        "significant_tests": len(significant),
        "test_figures": [(after.question, pictures.test_figure(before, after)) for before, after in tested],
        "maps": _maps(result),
        "about_pixels": _about_pixels(result),
    }


def sections_of_unknown_scenes(result: BlindDiagnosis) -> dict[str, Any]:
    """Return what the template shows of a diagnosis of unknown scenes, by the template's names."""
    observation = result.observation
    height, width = observation.size
    return {
        "captures": (
            f"{count_of(len(observation), 'snapshot')} of unknown scenes, {height} \u00d7 {width} pixels, "
            f"{observation.frames} slots, {observation.bit_depth} bits."
        ),
        "notes": further_notes(result),
        "cards": _cards_of_unknown_scenes(result),
        "prediction_rows": [] if result.prediction is None else _prediction_rows(result.prediction),
        "about_pixels": {"verification": f"snapshots {', '.join(map(str, result.verification))}"}
        if result.verification
        else {},
    }


def _cards_of_unknown_scenes(result: BlindDiagnosis) -> list[Card]:
    cards = [Card(str(len(result.effects)), f"effect{'s' * (len(result.effects) != 1)} named")]
    if (judged := result.prediction) is not None:
        error = _change(_three_digits(judged.gap.before), _three_digits(judged.gap.after))
        without = _three_digits(judged.without_mask.before)
        label = "RMS error of held-out pixels, as a part of their standard deviation"
        cards = [Card(error, label), Card(without, "the same without any mask"), *cards]
    return cards


def _prediction_rows(judged: PredictionVerdict) -> list[tuple[str, str]]:
    """Return the prediction errors of three cameras on all snapshots, and of two on those that were set aside."""
    rows = [("the ideal camera", judged.gap.before), ("the corrected camera", judged.gap.after)]
    rows.append(("a camera without any mask", judged.without_mask.before))
    if (verified := judged.verification) is not None:
        rows.append(("snapshots set aside, the ideal camera", verified.before))
        rows.append(("snapshots set aside, the corrected camera", verified.after))
    return [(camera, f"{error:.3f}") for camera, error in rows]


def _captures(result: CalibratedResult) -> str:
    observation = result.observation
    height, width = observation.size
    kinds = ", ".join(f"{observation.kinds.count(kind)} {kind}" for kind in sorted(set(observation.kinds)))
    judged = "judged on pixels that no fit has seen" if result.split.held_out.any() else "nothing could be held out"
    return (
        f"{len(observation)} captures with known scenes ({kinds}), {height} \u00d7 {width} pixels, "
        f"{observation.frames} slots, {observation.bit_depth} bits; {judged}."
    )


def _cards(result: CalibratedResult) -> list[Card]:
    """Return the figures at the head of the page: first the one that fell, as in the headline; else chi2."""
    before, after = result.before.gap, result.after.gap
    limit = f"; chance reaches {chi2(after.chi2_limit)} with {after.pixels:,} pixels"
    count, questions = len(result.effects), [test.significant for test in result.before.tests]
    chi2_label = f"held-out reduced χ² (1 = noise{limit if after.chi2_limit > result.settings.negligible_chi2 else ''})"
    cards = {
        "chi2": Card(_change(chi2(before.chi2), chi2(after.chi2)), chi2_label),
        "rmse_dn": Card(f"{_change(f'{before.rmse_dn:.3g}', f'{after.rmse_dn:.3g}')} DN", "held-out RMS error"),
    }
    figure = fallen(before, after)
    if figure == "nll":
        likelier = Card(f"{nats_gained(before, after):,.0f} nats", "by which held-out pixels become likelier")
        cards = {"nll": likelier, **cards}
    first = [cards.pop(figure)] if figure else []
    return [
        *first,
        *cards.values(),
        Card(
            _change(str(sum(questions)), str(len(result.remaining))),
            f"of {len(questions)} questions find more than noise",
        ),
        Card(str(count), f"effect{'s' * (count != 1)} named"),
    ]


def _change(before: str, after: str) -> str:
    """Return two figures with an arrow between them; one of them where nothing changes."""
    return after if before == after else f"{before} \u2192 {after}"


def _named_afterwards(result: CalibratedResult) -> dict[str, str]:
    """Return the named effects that no round of the search has added, and how they came to be named."""
    added = {considered.added for considered in result.rounds}
    return {
        effect.name: "every model has it, so that it is no candidate; its values are judged after the last round"
        if effect.effect.noise
        else "it took the place of one that a round had added, because it fits better beside the others"
        for effect in result.effects
        if effect.name not in added
    }


def _gap_rows(result: CalibratedResult) -> list[tuple[str, ...]]:
    """Return the misfit before and after of every kind of capture and of all."""

    def row(kind: str, before: Misfit, after: Misfit) -> tuple[str, ...]:
        rmse = _change(_three_digits(before.rmse_dn), _three_digits(after.rmse_dn))
        nll = _change(_three_digits(before.nll), _three_digits(after.nll))
        return kind, rmse, _change(chi2(before.chi2), chi2(after.chi2)), nll

    before, after = result.before.gap, result.after.gap
    rows = [row(kind, misfit, after.by_kind[kind]) for kind, misfit in before.by_kind.items()]
    return [*rows, row("all", before, after)]


def _three_digits(value: float) -> str:
    """Return three significant digits, without an exponent."""
    return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _test_pairs(result: CalibratedResult) -> list[tuple[ResidualTest | None, ResidualTest]]:
    """Return every residual test before and after; None where it could not be made before."""
    before = {test.name: test for test in result.before.tests}
    return [(before.get(test.name), test) for test in result.after.tests]


def _significant_tests(result: CalibratedResult) -> list[tuple[ResidualTest | None, ResidualTest]]:
    """Return the pairs that find something: what is left first, variance last, otherwise the largest first."""

    def order(pair: tuple[ResidualTest | None, ResidualTest]) -> tuple[bool, bool, float]:
        after = pair[1]
        return not after.significant, after.about == "variance", -max(test.nats for test in pair if test)

    pairs = _test_pairs(result)
    return sorted(
        ((before, after) for before, after in pairs if after.significant or (before and before.significant)), key=order
    )


def _maps(result: CalibratedResult) -> dict[str, Figure]:
    """Return a figure of every estimated fixed-pattern map by the effect's name."""
    drawn = {}
    for name in (name for name, one in result.after.fit.maps.items() if not one.of_captures):
        effect = result.model.effects[name]
        unit = effect.map_unit or next(iter(effect.about.values())).unit
        values = result.after.fit.hypothesis.maps[name]
        drawn[name] = pictures.map_figure(values, "relative" if unit == "1" else unit)
    return drawn


def _left_out(result: CalibratedResult) -> dict[str, str]:
    """Return what was kept for verification, and how much of the field counts nowhere, as rows of the footer."""
    rows = {}
    if (verification := result.verification) is not None:
        captures = ", ".join(map(str, verification.captures))
        reached = f"χ² {chi2(verification.before.chi2)} → {chi2(verification.after.chi2)}"
        rows["verification"] = (
            f"captures {captures}, which no fit and no choice has seen: {reached}; the verdict rests on it"
        )
    split = result.split.describe()
    if any(split["border"].values()):
        sides = ", ".join(f"{width} {side}" for side, width in split["border"].items())
        rows["surround"] = (
            f"what lies beyond the patterns is unknown: pixels along the sides count nowhere ({sides}), "
            f"{100 * split['counted_fraction']:.0f} % are left"
        )
    return rows


def _about_pixels(result: CalibratedResult) -> dict[str, str]:
    """Return which pixels were held out or count nowhere, and which noise the model has, as rows of the footer."""
    split = result.split.describe()
    captures = ", ".join(map(str, split["held_out_captures"])) or "none"
    held_out = (
        f"captures {captures} as numbered in the file, and {split['held_out_blocks']}: "
        f"{100 * split['held_out_fraction']:.0f} % of all pixels"
    )
    noise, datasheet = [], datasheet_noise(result.observation)[0].effects
    for name, values in result.after.fit.hypothesis.effects.items():
        if name in datasheet:
            stated = name in result.stated_noise and values == datasheet[name]
            listed = ", ".join(f"{key} {value:.4g}" for key, value in values.items())
            noise.append(f"{name.replace('_', ' ')}: {listed} ({'stated by the file' if stated else 'estimated'})")
    return {"held out": held_out, **_left_out(result), "noise": "; ".join(noise)}
