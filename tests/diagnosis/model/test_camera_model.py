"""The forward model predicts what a hypothesis says, and nothing that it remembers of another one."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.captures import read_captures
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.model.observation import observe
from sci_lightning.diagnosis.model.starting_points import starting_settings, with_effect_at
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.encoder.effects import Effect, MapEffect, OpticsEffect, Parameter
from sci_lightning.encoder.effects.sensor.saturation import Saturation
from sci_lightning.encoder.signal import Signal
from sci_lightning.virtual_camera import Session, VirtualCamera


class Window(MapEffect, OpticsEffect):
    """Dust on the sensor's window: a map that acts on the light before the sensor."""

    name = "window"
    rank = 46
    map_kind = "pixel"
    about = {"std": Parameter("1", 0.0, 0, 1, step=0.01)}

    def form(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.pooled().mean * (1 + self.std * self.map))


class FullWells(Saturation):
    """A user's own effect that limits the signal, under another name."""

    name = "full_wells"
    ceiling = "height"
    about = {"height": Saturation.about["level"]}
    height: torch.Tensor

    @property
    def level(self) -> torch.Tensor:  # type: ignore[override]
        return self.height


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> CameraModel:
    path = tmp_path_factory.mktemp("model") / "a.h5"
    VirtualCamera(Session(size=(16, 16), dark=1, flat=1), {}).write(path, seed=1)
    return CameraModel(observe(read_captures(path)), vocabulary())


def with_more(model: CameraModel, effects: dict[str, type[Effect]]) -> CameraModel:
    return CameraModel(model.observation, {**model.vocabulary, **effects})


def test_two_maps_of_one_sum_give_two_images(model: CameraModel) -> None:
    """The light before the sensor is remembered: by the map's values, not by a number that other maps share."""
    larger = with_more(model, {"window": Window})
    values = torch.randn(16, 16, generator=torch.Generator().manual_seed(0))
    one = Hypothesis({"read_noise": {"std": 1.0}}).with_effect("window", {"std": 0.1}, 0.1 * values)
    other = one.with_effect("window", {"std": 0.1}, 0.1 * values.flip(1))
    images = [larger.predict(hypothesis).mean for hypothesis in (one, other)]
    alone = CameraModel(larger.observation, larger.vocabulary).predict(other).mean
    assert not torch.equal(*images) and torch.equal(images[1], alone)


def test_a_further_candidate_makes_a_new_model(model: CameraModel) -> None:
    larger = with_more(model, {"window": Window})
    assert "window" in larger.vocabulary and "window" in larger.effects
    assert "window" not in model.vocabulary and "window" not in model.effects


def test_an_effect_of_ones_own_may_limit_the_signal_as_saturation_does(model: CameraModel) -> None:
    own = with_more(model, {"full_wells": FullWells})
    starts = {name: starting_settings(own, name, Hypothesis({})) for name in ("saturation", "full_wells")}
    assert [start["height"] for start in starts["full_wells"]] == [start["level"] for start in starts["saturation"]]
    wells, built_in = (
        Hypothesis({name: {key: 0.5}}) for name, key in (("full_wells", "height"), ("saturation", "level"))
    )
    assert own.predict(wells).clipped is not None
    assert torch.equal(own.predict(wells).mean, own.predict(built_in).mean)
    adapted = with_effect_at(own, wells, "black_level", {"offset": 0.1}).effects["full_wells"]["height"]
    assert float(adapted) == pytest.approx(0.4, abs=1e-3)  # recorded at 0.5 as before
