"""The target is not quite what the file says: such an effect is named, and not taken for one of the camera."""

from __future__ import annotations

from pathlib import Path
from string import Formatter

import numpy as np
import pytest
import torch
import yaml
from scipy.ndimage import gaussian_filter, rotate, shift

from sci_lightning.captures import Captures
from sci_lightning.diagnosis.diagnosis import diagnose
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.model.observation import observe
from sci_lightning.diagnosis.report.corrected_camera import write_encoder
from sci_lightning.diagnosis.report.report import describe
from sci_lightning.diagnosis.report.sentences import headline
from sci_lightning.diagnosis.target_effects import TARGET_EFFECTS, SceneDetail, SceneEffect, changed_scenes
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.errors import BadInput
from tests.diagnosis.another_camera import Hidden, captures
from tests.files.formats import check

SCENE = torch.from_numpy(gaussian_filter(np.random.default_rng(0).random((2, 40, 48)), (0, 2, 2))).float()
SETTINGS: dict[str, dict[str, float]] = {
    "scene_shift": {"dx": 0.6, "dy": -1.3},
    "scene_rotation": {"angle": 7.0},
    "scene_scale": {"scale": 1.1},
    "scene_blur": {"sigma": 1.2},
    "scene_gamma": {"gamma": 1.3},
    "scene_detail": {"share": 0.9},
}


def changed(name: str) -> np.ndarray:
    return as_shown(TARGET_EFFECTS[name](**SETTINGS[name]), SCENE).numpy()


def as_shown(effect: SceneEffect, scene: torch.Tensor) -> torch.Tensor:
    """The scene as an effect changes it; detail within pixels shows on a pixel's cells alone."""
    return effect.on_cells(scene, 3)[..., ::3, ::3] if isinstance(effect, SceneDetail) else effect.change(scene)


@pytest.mark.parametrize("name", TARGET_EFFECTS)
def test_contract(name: str) -> None:
    """Neutral it is the identity; an even scene stays even; what rests rests; a report says what it does."""
    effect = TARGET_EFFECTS[name]
    assert issubclass(effect, SceneEffect) and effect.stage == "scene" and effect.name == name and effect.rank < 10
    neutral = effect(**{key: about.neutral for key, about in effect.about.items()})
    torch.testing.assert_close(as_shown(neutral, SCENE), SCENE, atol=1e-5, rtol=0)
    active = effect(**SETTINGS[name])
    assert (as_shown(active, SCENE) - SCENE).abs().max() > 0.005
    even, rest = torch.full((3, 1, 1), 0.4), SCENE[:1]
    assert active.change(even).shape == even.shape and active.change(rest).shape == rest.shape
    assert name == "scene_gamma" or torch.equal(active.change(even), even)
    assert {field for _, field, _, _ in Formatter().parse(effect.sentence) if field} == set(effect.about)
    for setting in effect.starts(8, (40, 48), 8):
        assert effect(**setting).values == pytest.approx(setting)
    assert set(TARGET_EFFECTS) == set(SETTINGS)


def test_detail_within_a_pixel_leaves_its_mean_and_continues_a_slope() -> None:
    detail = SceneDetail(share=1.0)
    fine = detail.on_cells(SCENE, 5)
    torch.testing.assert_close(torch.nn.functional.avg_pool2d(fine, 5), SCENE, atol=1e-5, rtol=0)
    slope = (0.01 * torch.arange(20.0) + 0.3).expand(1, 20, 20)
    inside = detail.on_cells(slope, 3)[0, 15, 3:-3].unflatten(0, (-1, 3))
    step = (1 / 8) ** 0.5  # with the variance of a slope over the pixel, 1 / 12
    torch.testing.assert_close(inside[5] - slope[0, 10, 6], 0.01 * torch.tensor([-step, 0.0, step]), atol=1e-5, rtol=0)
    assert detail.on_cells(torch.ones(8, 1, 1), 3).shape == (8, 1, 1)


@pytest.mark.parametrize("name", ["optical_blur", "mask_shift"])
def test_what_is_predicted_is_the_light_of_a_continuous_scene(name: str) -> None:
    """Summed up on 15 x 15 points per pixel; without detail the prediction is several times as far off."""
    size, points, hidden = 24, 15, {"optical_blur": {"sigma": 0.5}, "mask_shift": {"dx": 0.4, "dy": 0.0}}
    place = (torch.arange(size * points) + 0.5) / points
    scene = 0.5 + 0.2 * torch.sin(1.1 * place)[None] * torch.cos(0.8 * place)[:, None]
    patterns = (torch.rand(2, size, size, generator=torch.Generator().manual_seed(0)) < 0.5).float()
    mask = patterns.repeat_interleave(points, 1).repeat_interleave(points, 2).sum(0).numpy()
    shift_points = round(hidden["mask_shift"]["dx"] * points) if name == "mask_shift" else 0
    light = np.roll(mask, shift_points, axis=1) * scene.numpy()
    light = gaussian_filter(light, 0.5 * points) if name == "optical_blur" else light
    expected = light.reshape(size, points, size, points).mean((1, 3))[4:-4, 4:-4]
    means = torch.nn.functional.avg_pool2d(scene[None], points).expand(2, -1, -1)
    one = Captures(
        patterns=patterns.numpy(),
        sequence=np.array([[0, 1]]),
        measurement=(65535 * 0.5 * (patterns * means).sum(0))[None].numpy().astype("uint16"),
        scene=means[None].numpy(),
        aperture=np.array([0.5], "float32"),
        exposure=np.array([1.0], "float32"),
        kind=("static",),
        bit_depth=16,
    )
    model = CameraModel(observe(one), vocabulary())
    noise = {"shot_noise": {"full_well": 1e4}, "read_noise": {"std": 1.0}}
    steps, slopes = (
        model.predict(Hypothesis({**noise, name: hidden[name], **more})).mean[0, 4:-4, 4:-4].numpy() / 65535 / 0.5
        - expected
        for more in ({}, {"scene_detail": {"share": 1.0}})
    )
    assert np.abs(slopes).max() < 0.35 * np.abs(steps).max() and np.mean(slopes**2) < 0.15 * np.mean(steps**2)


def test_no_target_shows_negative_light() -> None:
    """A spline swings below 0 beside an edge."""
    edge = torch.zeros(1, 8, 16)
    edge[..., 8:] = 1.0
    shift = TARGET_EFFECTS["scene_shift"](dx=0.5, dy=0.0)
    assert shift.change(edge).min() < -0.01
    (shown,) = changed_scenes(shift, [edge])
    assert shown.min() == 0 and shown.max() > 0.9


def test_against_scipy() -> None:
    """Inside, where nothing comes from beyond the field."""
    inner = (slice(None), slice(8, -8), slice(8, -8))
    scene = SCENE.numpy().astype(float)
    moved = shift(scene, (0, -1.3, 0.6), order=3, mode="nearest")
    np.testing.assert_allclose(changed("scene_shift")[inner], moved[inner], atol=1e-4)
    turned = rotate(scene, -7.0, (2, 1), reshape=False, order=3, mode="nearest")
    opposite = rotate(scene, 7.0, (2, 1), reshape=False, order=3, mode="nearest")
    error, wrong = (np.abs(changed("scene_rotation")[inner] - one[inner]).max() for one in (turned, opposite))
    assert min(error, wrong) < 1e-4
    np.testing.assert_allclose(changed("scene_blur")[inner], gaussian_filter(scene, (0, 1.2, 1.2))[inner], atol=1e-3)
    np.testing.assert_allclose(changed("scene_gamma"), scene**1.3, atol=1e-5)


def test_directions() -> None:
    """A bright spot right of the middle goes down when it is turned clockwise, and outwards when it grows."""
    y, x = (torch.arange(length) - (length - 1) / 2 for length in (41, 41))
    spot = torch.exp(-((y[:, None]) ** 2 + (x[None] - 10) ** 2) / 8)[None]
    for name, place in (("scene_rotation", (1.22, 9.93)), ("scene_scale", (0.0, 11.0)), ("scene_shift", (-1.3, 10.6))):
        image = TARGET_EFFECTS[name](**SETTINGS[name]).change(spot)[0]
        centre = float((image * y[:, None]).sum() / image.sum()), float((image * x).sum() / image.sum())
        assert centre == pytest.approx(place, abs=0.05), name


CASES: dict[str, tuple[Hidden, dict[str, float]]] = {
    "shift": (Hidden(scene_shift=(0.3, -0.4)), {"scene_shift.dx": 0.3, "scene_shift.dy": -0.4}),
    "rotation": (Hidden(scene_angle=0.5), {"scene_rotation.angle": 0.5}),
    "scale": (Hidden(scene_scale=1.01), {"scene_scale.scale": 1.01}),
    "gamma": (Hidden(scene_gamma=1.05), {"scene_gamma.gamma": 1.05}),
    "shift of both": (
        Hidden(scene_shift=(0.3, -0.4), shift=(0.5, 0.2)),
        {"scene_shift.dx": 0.3, "scene_shift.dy": -0.4, "mask_shift.dx": 0.5, "mask_shift.dy": 0.2},
    ),
    "gamma and gain": (Hidden(scene_gamma=1.08, gain=0.95), {"scene_gamma.gamma": 1.08, "gain.factor": 0.95}),
}
FAST = ("gamma",)


@pytest.mark.parametrize("name", [one if one in FAST else pytest.param(one, marks=pytest.mark.slow) for one in CASES])
def test_hidden_cases(name: str, tmp_path: Path) -> None:
    hidden, truth = CASES[name]
    result = diagnose(captures(hidden, size=40 if name in FAST else 64, seed=1), vocabulary())
    assert result.verdict == "explained" and set(result.names) == {one.split(".")[0] for one in truth}
    estimates = {f"{one.name}.{key}": value for one in result.effects for key, value in one.parameters.items()}
    for key, value in truth.items():
        assert abs(float(estimates[key].value) - value) < max(5 * estimates[key].std, 4e-3 * abs(value)), key
    content = describe(result)
    assert {one["name"] for one in content["laboratory"]} == {one for one in result.names if one.startswith("scene_")}
    assert not any(one["name"].startswith("scene_") for one in content["effects"])
    assert all(one["stage"] == "scene" for one in content["laboratory"])
    check("report", content)
    assert "the targets" in headline(result).lower()
    write_encoder(result, tmp_path)
    assert not any(
        one.startswith("scene_") for one in yaml.safe_load((tmp_path / "encoder.yaml").read_text())["effects"]
    )


def test_effects_can_be_left_out() -> None:
    assert set(vocabulary()) - set(vocabulary(leave_out=["scene_blur", "gain"])) == {"scene_blur", "gain"}
    with pytest.raises(BadInput, match="leave_out: no effect 'blur'; there are "):
        vocabulary(leave_out=["blur"])
    with pytest.raises(BadInput, match="every camera has read_noise"):
        vocabulary(leave_out=["read_noise"])
