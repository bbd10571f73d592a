"""Captures of a world that goes on beyond the field, taken by a camera that shares no code with the package."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from sci_lightning.diagnosis.diagnosis import Diagnosis, diagnose
from sci_lightning.diagnosis.fit.fit import Fitter
from sci_lightning.diagnosis.fit.split import split
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.model.observation import observe
from sci_lightning.diagnosis.report.report import describe
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.encoder import effects
from sci_lightning.encoder.border import Border
from tests.diagnosis.another_camera import Hidden, captures

SHIFT = Hidden(shift=(0.6, -0.35))
CASES: dict[str, tuple[Hidden, dict[str, float]]] = {
    "shift": (SHIFT, {"mask_shift.dx": 0.6, "mask_shift.dy": -0.35}),
    "rotation": (Hidden(angle=0.7), {"mask_rotation.angle": 0.7}),
    "blur": (Hidden(blur=0.6), {"optical_blur.sigma": 0.6}),
    "wide blur": (Hidden(blur=1.5), {"optical_blur.sigma": 1.5}),
    "shift and black level": (
        replace(SHIFT, black=0.02),
        {"mask_shift.dx": 0.6, "mask_shift.dy": -0.35, "black_level.offset": 0.02},
    ),
    "rotation and contrast": (
        Hidden(angle=0.5, leak=0.06),
        {"mask_rotation.angle": 0.5, "mask_contrast.leak": 0.06},
    ),
    "three": (
        Hidden(shift=(0.45, 0.3), leak=0.05, gain=0.92),
        {"mask_shift.dx": 0.45, "mask_shift.dy": 0.3, "mask_contrast.leak": 0.05, "gain.factor": 0.92},
    ),
    "nothing": (Hidden(), {}),
    "mask blur": (Hidden(mask_blur=0.5), {"mask_blur.sigma": 0.5}),
    "large shift": (Hidden(shift=(2.7, -1.9)), {"mask_shift.dx": 2.7, "mask_shift.dy": -1.9}),
}
FAST = "rotation"


def check(result: Diagnosis, truth: dict[str, float]) -> None:
    """The names are right, their values are within five standard deviations or a thousandth, and chi2 is 1."""
    assert result.verdict == ("explained" if truth else "consistent")
    assert set(result.names) == {name.split(".")[0] for name in truth}
    estimates = {f"{one.name}.{name}": value for one in result.effects for name, value in one.parameters.items()}
    for name, value in truth.items():
        error = abs(float(estimates[name].value) - value)
        assert error < max(5 * estimates[name].std, 2e-3 * abs(value)), (name, estimates[name])
    assert 0.95 < result.after.gap.chi2 < 1.05


@pytest.mark.parametrize("name", [one if one == FAST else pytest.param(one, marks=pytest.mark.slow) for one in CASES])
def test_hidden_cases(name: str) -> None:
    hidden, truth = CASES[name]
    result = diagnose(captures(hidden, size=40 if name == FAST else 64, seed=1), vocabulary())
    check(result, truth)
    stated = describe(result)["split"]
    needed = {side: width for side, width in stated["border"].items() if width}
    assert all(width <= 10 for width in needed.values()) and stated["counted_fraction"] > 0.3
    assert bool(needed) == (name != "nothing")  # what only rivals had needed counts again


def test_a_displacement_costs_its_own_rows() -> None:
    """Twelve pixels of displacement leave out twelve rows on one side, and pixels that depend on the surround."""
    observation = observe(captures(SHIFT, size=40, seed=1))
    fitter = Fitter(CameraModel(observation, vocabulary()), split(observation))
    assert fitter.pixels == observation.dn.numel()
    far = Hypothesis({"mask_shift": {"dx": 0.0, "dy": -11.8}})
    wide = fitter.covering(far)
    assert wide.split.border == Border(top=0, right=0, bottom=12, left=0)
    assert wide.pixels == len(observation) * 28 * 40
    assert wide.fitted.shape == wide.held_out.shape == (len(observation), 28, 40)
    assert torch.equal(wide.model.predict(far).mean, fitter.model.predict(far).mean[:, :28])
    assert wide.covering(Hypothesis({})) is wide and fitter.covering(Hypothesis({})) is fitter
    known = replace(observation, dark_surround=True)
    told = Fitter(CameraModel(known, vocabulary()), split(known))
    assert told.covering(far) is told


@pytest.mark.parametrize(
    ("effect", "border"),
    [
        (effects.MaskShift(dx=1.5, dy=-0.25), Border(right=0, left=1.5, top=0, bottom=0.25)),
        (effects.MaskScale(scale=0.9), Border.around(2.0, 3.0)),
        (effects.MaskScale(scale=1.1), Border()),
        (effects.MaskRotation(angle=45.0), Border.around(30.0, 20.0)),
        (effects.MaskBlur(sigma=0.5), Border.around(1.85)),
        (effects.OpticalBlur(sigma=0.5), Border.around(1.85)),
        (effects.Gain(factor=2.0), Border()),
    ],
)
def test_the_border_of_an_effect(effect: effects.Effect, border: Border) -> None:
    result = effect.border((40, 60))
    for side in ("top", "right", "bottom", "left"):
        assert getattr(result, side) == pytest.approx(getattr(border, side), abs=1e-5)


@pytest.mark.parametrize("name", ["mask_shift", "mask_rotation", "mask_scale", "mask_blur", "optical_blur"])
def test_inside_the_border_nothing_depends_on_the_surround(name: str) -> None:
    """A field cut out of a larger one is predicted as in the larger one, but for the border."""
    settings = {
        "mask_shift": {"dx": 1.3, "dy": -2.2},
        "mask_rotation": {"angle": 3.0},
        "mask_scale": {"scale": 0.95},
        "mask_blur": {"sigma": 0.9},
        "optical_blur": {"sigma": 0.9},
    }
    observation = observe(captures(Hidden(), size=40, seed=1))
    model = CameraModel(observation, vocabulary())
    hypothesis = Hypothesis({name: settings[name], "read_noise": {"std": 1.0}})
    rows, columns = model.border(hypothesis).rounded().window((40, 40))
    # what lies beyond a field of 24 x 24 is dark, or bright: within its border nothing changes
    around = torch.ones(40, 40, dtype=torch.bool)
    around[8:32, 8:32] = False
    dark, bright = (
        CameraModel(replace(observation, patterns=torch.where(around, light, observation.patterns)), vocabulary())
        .predict(hypothesis)
        .mean[:, 8:32, 8:32]
        for light in (0.0, 1.0)
    )
    inner = (slice(None), slice(rows.start, rows.stop - 16), slice(columns.start, columns.stop - 16))
    assert (dark[inner] - bright[inner]).abs().max() < 0.1
    assert (dark - bright).abs().max() > 10
