"""All residual tests of a fit, with corrected p-values and pictures: where do captures and model disagree?"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.residual_tests.captures import captures, carry_over, drift, kinds
from sci_lightning.diagnosis.residual_tests.converter import codes
from sci_lightning.diagnosis.residual_tests.image import copies, frequency, image_edges, mask_edges
from sci_lightning.diagnosis.residual_tests.light import intensity, light
from sci_lightning.diagnosis.residual_tests.modulation import delays, patterns, slots, swaps
from sci_lightning.diagnosis.residual_tests.noise import distribution, variance_by_intensity, variance_by_position
from sci_lightning.diagnosis.residual_tests.position import blocks, columns, estimated_map, pixels, radius, rows
from sci_lightning.diagnosis.residual_tests.residual_test import About, Answer, ResidualTest, corrected
from sci_lightning.diagnosis.residual_tests.residuals import Residuals

Question = tuple[About, str, Callable[[Residuals], Answer]]

QUESTIONS: dict[str, Question] = {
    "intensity": ("mean", "Does the misfit depend on how bright a pixel is?", intensity),
    "light": ("mean", "Is there too much light, or too little: its own, spread evenly, or in the dark?", light),
    "blocks": ("mean", "Are there regions of the sensor that are too bright or too dark?", blocks),
    "rows": ("mean", "Are there rows that are too bright or too dark?", rows),
    "columns": ("mean", "Are there columns that are too bright or too dark?", columns),
    "radius": ("mean", "Does the misfit depend on the distance from the centre?", radius),
    "pixels": ("mean", "Are there single pixels that are too bright or too dark?", pixels),
    "slots": ("mean", "Do single slots let through more or less light than they should?", slots),
    "delays": ("mean", "Do patterns come late, or stay on?", delays),
    "patterns": ("mean", "Do single patterns let through more or less light than they should?", patterns),
    "swaps": ("mean", "Is another pattern displayed than the commanded one?", swaps),
    "mask_edges": ("mean", "Does the misfit sit on the edges of the mask's image?", mask_edges),
    "image_edges": ("mean", "Does the misfit sit on the edges of the whole picture?", image_edges),
    "frequency": ("mean", "Is the misfit coarser or finer than noise?", frequency),
    "copies": ("mean", "Does the misfit look like the picture, but elsewhere?", copies),
    "kinds": ("mean", "Are some kinds of capture too bright or too dark?", kinds),
    "captures": ("mean", "Are single captures too bright or too dark?", captures),
    "drift": ("mean", "Does the light drift from capture to capture?", drift),
    "carry_over": ("mean", "Does something of a capture remain in those after it?", carry_over),
    "variance_by_intensity": ("variance", "Is the noise as strong as predicted at every level?", variance_by_intensity),
    "variance_by_position": ("variance", "Is the noise as strong as predicted everywhere?", variance_by_position),
    "distribution": ("variance", "Are the residuals spread like a bell?", distribution),
    "codes": ("converter", "Are there codes that the converter never gives?", codes),
}
"""Tests of every fit by name: what they are about, the question in words, and the function."""


def residual_tests(fitter: Fitter, fit: Fit, seed: int = 0) -> list[ResidualTest]:
    """Run every residual test on a fit, those of its estimated maps too.

    Args:
        fitter: holds captures, split and model.
        fit: the fitted model.
        seed: of the residuals' randomisation.
    """
    return ask(Residuals.of(fitter, fit, seed))


def ask(residuals: Residuals) -> list[ResidualTest]:
    """Run every residual test on residuals; the p-values are corrected for the number of tests (Holm)."""
    questions = dict(QUESTIONS)
    for name in residuals.fit.maps:
        question = f"Is the map of {name} as random as its name says?"
        questions[f"map_of_{name}"] = ("map", question, partial(estimated_map, name=name))
    tests, significance = [], residuals.fitter.settings.significance
    for name, (about, question, answered) in questions.items():
        answer = answered(residuals)
        numbers = answer.statistic, answer.p_value, answer.nats, answer.p_value
        tests.append(ResidualTest(name, about, question, *numbers, answer.picture, significance))
    return corrected(tests)
