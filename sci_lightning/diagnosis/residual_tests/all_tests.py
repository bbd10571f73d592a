"""All residual tests of a fit, with corrected p-values and pictures: where do captures and model disagree?"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from sci_lightning.diagnosis.residual_tests import image_tests, pixel_tests
from sci_lightning.diagnosis.residual_tests.residual_test import About, Answer, ResidualTest, corrected
from sci_lightning.diagnosis.residual_tests.residuals import Residuals

Question = tuple[About, str, Callable[[Residuals], Answer]]

QUESTIONS: dict[str, Question] = {
    "intensity": ("mean", "Does the misfit depend on how bright a pixel is?", pixel_tests.intensity),
    "light": (
        "mean",
        "Is there too much light, or too little: its own, spread evenly, or in the dark?",
        pixel_tests.light,
    ),
    "blocks": ("mean", "Are there regions of the sensor that are too bright or too dark?", pixel_tests.blocks),
    "rows": ("mean", "Are there rows that are too bright or too dark?", pixel_tests.rows),
    "columns": ("mean", "Are there columns that are too bright or too dark?", pixel_tests.columns),
    "radius": ("mean", "Does the misfit depend on the distance from the centre?", pixel_tests.radius),
    "pixels": ("mean", "Are there single pixels that are too bright or too dark?", pixel_tests.pixels),
    "slots": ("mean", "Do single slots let through more or less light than they should?", image_tests.slots),
    "delays": ("mean", "Do patterns come late, or stay on?", image_tests.delays),
    "patterns": ("mean", "Do single patterns let through more or less light than they should?", image_tests.patterns),
    "swaps": ("mean", "Is another pattern displayed than the commanded one?", image_tests.swaps),
    "mask_edges": ("mean", "Does the misfit sit on the edges of the mask's image?", image_tests.mask_edges),
    "image_edges": ("mean", "Does the misfit sit on the edges of the whole picture?", image_tests.image_edges),
    "frequency": ("mean", "Is the misfit coarser or finer than noise?", image_tests.frequency),
    "copies": ("mean", "Does the misfit look like the picture, but elsewhere?", image_tests.copies),
    "kinds": ("mean", "Are some kinds of capture too bright or too dark?", image_tests.kinds),
    "captures": ("mean", "Are single captures too bright or too dark?", image_tests.captures),
    "drift": ("mean", "Does the light drift from capture to capture?", image_tests.drift),
    "carry_over": ("mean", "Does something of a capture remain in those after it?", image_tests.carry_over),
    "variance_by_intensity": (
        "variance",
        "Is the noise as strong as predicted at every level?",
        pixel_tests.variance_by_intensity,
    ),
    "variance_by_position": (
        "variance",
        "Is the noise as strong as predicted everywhere?",
        pixel_tests.variance_by_position,
    ),
    "distribution": ("variance", "Are the residuals spread like a bell?", pixel_tests.distribution),
    "codes": ("converter", "Are there codes that the converter never gives?", pixel_tests.codes),
}
"""Tests of every fit by name: what they are about, the question in words, and the function."""


def residual_tests(residuals: Residuals) -> list[ResidualTest]:
    """Run every residual test on the residuals of a fit, those of its estimated maps too.

    The p-values are corrected for the number of tests (Holm).
    """
    questions = dict(QUESTIONS)
    for name in (name for name, one in residuals.fit.maps.items() if not one.of_captures):
        question = f"Is the map of {name} as random as its name says?"
        questions[f"map_of_{name}"] = ("map", question, partial(pixel_tests.estimated_map, name=name))
    tests, significance = [], residuals.fit.fitter.settings.significance
    for name, (about, question, answered) in questions.items():
        answer = answered(residuals)
        numbers = answer.statistic, answer.p_value, answer.nats, answer.p_value
        tests.append(ResidualTest(name, about, question, *numbers, answer.picture, significance))
    return corrected(tests)
