"""Effects in the encoder: how they are given, what learning and decoding see of them, one of a user's own."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from hydra.utils import instantiate
from omegaconf import DictConfig

from sci_lightning.decoder import E2ECNN
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.effects import Gain, MaskShift, OpticalBlur, Prnu, ShotNoise
from sci_lightning.encoder.mask import LearnedStructural, RandomStructural
from sci_lightning.encoder.sensor import ClipQuantise, Ideal
from sci_lightning.errors import BadInput
from sci_lightning.operator import SnapshotOperator
from sci_lightning.pipeline import Pipeline
from sci_lightning.training.system import System


def camera(*effects: object, learned: bool = False, size: tuple[int, int] = (16, 16)) -> Encoder:
    mask = (LearnedStructural if learned else RandomStructural)(2, 4, size)
    return Encoder(mask, ClipQuantise(), effects=effects)  # type: ignore[arg-type]


def test_as_list_as_mapping_and_none() -> None:
    mask, video = RandomStructural(2, 4, (16, 16)), torch.rand(2, 4, 16, 16)
    gain, shift = Gain(factor=0.5), MaskShift(dx=1.0)
    listed = Encoder(mask, Ideal(), effects=[gain, None, shift])(video)
    mapped = Encoder(mask, Ideal(), effects={"b": gain, "none": None, "a": shift})(video)
    assert torch.equal(listed, mapped) and not torch.equal(listed, Encoder(mask, Ideal())(video))
    for nothing in ((), None, {}, {"gain": None}):
        ideal = Encoder(mask, Ideal(), effects=nothing)
        assert torch.equal(ideal(video), (video * mask()).sum(1))
        assert torch.equal(ideal.transmittance(), mask()) and not list(ideal.path.parameters())
        assert ideal.linearise(video[:, 0]) is not None and torch.equal(ideal.linearise(video[:, 0]), video[:, 0])


def test_what_is_refused() -> None:
    with pytest.raises(BadInput, match="gain is given 2 times"):
        camera(Gain(factor=0.5), Gain(factor=0.6))
    with pytest.raises(BadInput, match="must be effects"):
        camera(torch.nn.Identity())
    shifted = camera(MaskShift(dx=1.0))
    with pytest.raises(BadInput, match="not inside"):
        shifted.record(torch.rand(1, 4, 8, 8), shifted.transmittance()[:, :8, :8], origin=(9, 0))


def test_from_the_command_line(configuration: Callable[..., DictConfig]) -> None:
    cfg = configuration("train", "size=[16,16]", "effect=[mask_shift,prnu]", "encoder.effects.mask_shift.dx=2")
    encoder = instantiate(cfg.encoder, _convert_="all")
    shift, prnu = encoder.path.effects.values()
    assert shift.values == {"dx": 2, "dy": pytest.approx(-0.4)} and prnu.map.shape == (16, 16)
    one = configuration("train", "effect=gain", "encoder=rbw_sr").encoder.effects
    assert list(one) == ["gain"]


def test_seeded_noise() -> None:
    noisy, video = camera(ShotNoise(full_well=500.0)), torch.rand(1, 4, 16, 16)
    torch.manual_seed(1)
    first, second = noisy(video), noisy(video)
    torch.manual_seed(1)
    assert torch.equal(first, noisy(video)) and not torch.equal(first, second)


def test_learning_reaches_the_mask_through_effects_and_windows() -> None:
    effects = [MaskShift(dx=0.4), OpticalBlur(sigma=0.5), Prnu(size=(16, 16), std=0.1), ShotNoise(full_well=1e3)]
    system = System(camera(*effects, learned=True), E2ECNN(frames=4, channels=4, blocks=1))
    video = torch.rand(2, 4, 8, 8)
    measurement, mask = system.observe(video)
    assert measurement.shape == (2, 8, 8) and mask.shape == (4, 8, 8)
    system.training_step(video, 0).backward()
    weight = system.encoder.mask.weight
    assert torch.isfinite(weight.grad).all() and weight.grad.any()


def test_the_decoder_gets_what_a_calibrated_camera_would() -> None:
    """With deterministic sensor effects undone, the measurement is that of the effective mask."""
    effects = [MaskShift(dx=0.4, dy=-0.3), Gain(factor=0.8), Prnu(size=(16, 16), std=0.05)]
    encoder = Encoder(RandomStructural(2, 4, (16, 16)), Ideal(), 0.5, effects)
    pipeline, video = Pipeline(encoder, E2ECNN(frames=4, channels=4, blocks=1)), torch.rand(2, 4, 16, 16)
    measurement, mask = pipeline.linearise(pipeline.record(video)), pipeline.decoder_mask()
    torch.testing.assert_close(measurement, (video * mask).sum(1))
    assert torch.equal(mask, encoder.transmittance()) and not torch.equal(mask, encoder.mask())


OWN = '''
"""A scratch on the sensor's window."""
from sci_lightning.encoder.effects import OpticsEffect, Parameter


class Scratch(OpticsEffect):
    """Row 3 loses a part of its light."""
    name, rank = "scratch", 45
    about = {"loss": Parameter("1", 0.0, 0, 1, step=0.01, starts=(0.2,))}

    def form(self, signal):
        y, _ = signal.coordinates()
        row = y + (signal.field[0] - 1) / 2
        return signal.with_mean(signal.mean * (1 - self.loss * (row == 3)))
'''


def test_an_effect_of_ones_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, configuration: Callable[..., DictConfig]
) -> None:
    (tmp_path / "my_effects.py").write_text(OWN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "my_effects", raising=False)
    own = ["+encoder.effects.scratch._target_=my_effects.Scratch", "+encoder.effects.scratch.loss=0.25"]
    cfg = configuration("train", "encoder=rsw_sr", "encoder/sensor=ideal", "size=[16,16]", "effect=gain", *own)
    encoder = instantiate(cfg.encoder, _convert_="all")
    assert list(encoder.path.effects) == ["scratch", "gain"]
    seen = encoder(torch.full((1, 8, 16, 16), 0.5))[0, :, 0]
    assert float(seen[3]) == pytest.approx(0.5 * 0.75 * 0.8) and float(seen[4]) == pytest.approx(0.5 * 0.8)


def test_a_decoder_sees_no_light_at_the_dark_edge_of_a_displaced_mask() -> None:
    """A column that sees a fiftieth of a mirror is dark to a decoder, which would divide the noise by a fiftieth."""
    shifted = camera(MaskShift(dx=0.98))
    seen, commanded = shifted.transmittance(), camera().transmittance()
    given = shifted.decoder_mask(seen)
    assert seen[:, :, 0].max() > 0 and not given[:, :, 0].any()
    assert torch.equal(given[:, :, 1:], seen[:, :, 1:])
    assert torch.equal(camera().decoder_mask(commanded), commanded)  # no effect comes between pattern and light
    noise = 0.01 * torch.randn(1, 16, 16)
    assert SnapshotOperator(given).pseudo_inverse(noise).abs().max() < 0.2
