"""Every reading of the aperture: what the sensor gets, and what decoders divide by."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest
import torch
from hydra.utils import instantiate
from omegaconf import DictConfig

import sci_lightning as sci
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.aperture import WORDS, Aperture
from sci_lightning.encoder.effects import BlackLevel, MaskShift
from sci_lightning.encoder.mask import RandomBinary, RandomStructural
from sci_lightning.encoder.sensor import ClipQuantise, Ideal
from sci_lightning.errors import BadInput
from sci_lightning.measurement import Measurement
from tests.conftest import members

T, SIZE = 4, (12, 16)
LEVELS = torch.tensor([0.3, 0.6, 1.0])[:, None, None, None]


@pytest.fixture(scope="module")
def video() -> torch.Tensor:
    """Three clips of different brightness."""
    return torch.rand(3, T, *SIZE, generator=torch.Generator().manual_seed(0)) * LEVELS


@pytest.mark.parametrize("told", [True, False])
@pytest.mark.parametrize("setting", [*WORDS, 0.2])
@pytest.mark.parametrize("name", members("encoder"))
def test_contract(
    name: str, setting: float | str, told: bool, configuration: Callable[..., DictConfig], video: torch.Tensor
) -> None:
    """Every encoder of the configuration: a told scale is undone, another one is taken for the automatic one."""
    size = f"size=[{SIZE[0]},{SIZE[1]}]"
    cfg = configuration("train", f"encoder={name}", f"frames={T}", size, f"encoder.aperture={setting}")
    encoder = instantiate(cfg.encoder, told=told)
    light = (video * encoder.mask()).sum(1)
    automatic = encoder.mask.automatic_aperture
    brightest = light.amax((-2, -1), keepdim=True)
    scale = {"auto": automatic, "1/T": 1 / T, "per_snapshot": 1 / brightest}.get(setting, 0.2)
    recorded = encoder(video)
    assert torch.allclose(recorded.recorded(), encoder.sensor(scale * light))
    if setting == "per_snapshot":
        assert torch.allclose(recorded.recorded().amax((-2, -1)), torch.ones(3))
    undone = scale if told else automatic
    linear = recorded.linear(), encoder.normalised(recorded), encoder.normalised(encoder.record(video, encoder.mask()))
    for values in linear:
        assert torch.allclose(values.as_subclass(torch.Tensor), recorded.recorded() / undone, rtol=1e-5)


def test_today_s_apertures_are_bit_equal(video: torch.Tensor) -> None:
    mask = RandomBinary(T, SIZE)
    for setting, scale in (("auto", 2 / T), (0.3, 0.3)):
        encoder = Encoder(mask, ClipQuantise(), setting)
        assert torch.equal(encoder(video).recorded(), encoder.sensor(scale * (video * mask()).sum(1)))
        assert type(encoder.record(video, mask())) is torch.Tensor and encoder.aperture == scale


@pytest.mark.parametrize("wrong", [0, -1, float("nan"), float("inf"), "wide", "2/T"])
def test_what_is_no_aperture(wrong: float | str) -> None:
    with pytest.raises(BadInput, match=r"encoder.aperture=.*: expected a positive number, auto, 1/T or per_snapshot"):
        Aperture(wrong)


def test_a_dark_snapshot_and_gradients(video: torch.Tensor) -> None:
    encoder = Encoder(RandomBinary(T, SIZE), ClipQuantise(), "per_snapshot")
    dark = torch.zeros(1, T, *SIZE).requires_grad_()
    recorded = encoder.record(dark, encoder.mask())
    assert isinstance(recorded, Measurement) and recorded.aperture.item() == pytest.approx(255) and not recorded.any()
    encoder.normalised(recorded).sum().backward()
    assert dark.grad is not None and dark.grad.isfinite().all()


def test_effects_come_after_the_scale(video: torch.Tensor) -> None:
    """With a mask on finer cells, and an offset of the sensor that decoders have undone."""
    mask = RandomStructural(4, T, SIZE)
    effects = [MaskShift(dx=0.5, dy=0), BlackLevel(offset=0.05)]
    encoder = Encoder(mask, Ideal(), "per_snapshot", effects)
    light = sci.SnapshotOperator(encoder.transmittance(), encoder.path.cells).in_pixels()(video)
    expected = light / light.amax((-2, -1), keepdim=True) + 0.05
    assert torch.allclose(encoder(video).recorded(), expected, atol=1e-5)
    assert torch.allclose(encoder(video).linear(), light, atol=1e-4)


SAME = {
    "a slice": (lambda y: y[1:], [1, 2]),
    "one snapshot": (lambda y: y[2][None], [2]),
    "another order": (lambda y: y[[2, 0]], [2, 0]),
    "backwards": (lambda y: y.flip(0), [2, 1, 0]),
    "joined": (lambda y: torch.cat([y, y[:1]]), [0, 1, 2, 0]),
    "stacked": (lambda y: torch.stack([y[2], y[1]]), [2, 1]),
    "in halves": (lambda y: 0.5 * y + 0.5 * y, [0, 1, 2]),
    "in DN": (lambda y: (255 * y).double(), [0, 1, 2]),
}


@pytest.mark.parametrize("name", SAME)
def test_every_snapshot_keeps_its_scale(name: str, video: torch.Tensor) -> None:
    recorded = Encoder(RandomBinary(T, SIZE), ClipQuantise(), "per_snapshot")(video)
    changed, places = SAME[name]
    assert torch.allclose(changed(recorded).linear().float(), recorded.linear()[places])


@pytest.mark.parametrize("change", [lambda y: y.mean(0), lambda y: y + y.flip(0), lambda y: y[:, 3]])
def test_snapshots_of_several_scales_in_one(change: Callable[[Measurement], Measurement], video: torch.Tensor) -> None:
    recorded = Encoder(RandomBinary(T, SIZE), ClipQuantise(), "per_snapshot")(video)
    with pytest.raises(BadInput, match=r"scale .*unknown"):
        change(recorded).linear()


def test_a_scale_that_nothing_states(video: torch.Tensor) -> None:
    """A plain tensor, and the encoder's own number, which it does not have; a measurement can be given its scales."""
    told = Encoder(RandomStructural(4, T, SIZE), ClipQuantise(), "per_snapshot")
    plain = told(video).recorded().as_subclass(torch.Tensor)
    decoder = sci.load_decoder("gap_tv", ["decoder.iterations=[2]"])
    for wrong in (lambda: told.aperture, lambda: told.normalised(plain), lambda: sci.reconstruct(plain, decoder, told)):
        with pytest.raises(BadInput, match=r"per_snapshot: .* scale of its own.*aperture=NUMBER"):
            wrong()
    with pytest.raises(BadInput, match="aperture one for each snapshot"):
        decoder(plain, told.transmittance())
    with pytest.raises(BadInput, match=r"aperture of shape \(2,\)"):
        Measurement(plain, torch.ones(2))
    scales = told(video).aperture
    assert isinstance(scales, torch.Tensor) and scales.shape == (3,)
    stated = Measurement(255 * plain, scales, 255)
    assert torch.allclose(stated.linear(), told(video).linear(), atol=1e-6)
    done = sci.reconstruct(stated, decoder, told, say=lambda line: None)
    assert torch.allclose(torch.from_numpy(done.video), decoder(told(video), told.transmittance()), atol=1e-4)
    assert "per_snapshot" in repr(told) and "not told" in repr(Encoder(told.mask, told.sensor, 0.3, told=False))


@pytest.mark.parametrize("aperture", [0.25, torch.tensor([0.1, 0.2, 0.4, 0.5])], ids=["one", "of each snapshot"])
@pytest.mark.parametrize(
    "divide",
    [
        lambda y: y.split(3),
        lambda y: torch.split(y, [1, 3]),
        lambda y: y.chunk(2),
        lambda y: y.tensor_split(2),
        lambda y: y.hsplit(2),
        lambda y: y.unbind(0),
        lambda y: list(y),
    ],
    ids=["split", "sizes", "chunk", "tensor_split", "hsplit", "unbind", "iteration"],
)
def test_parts_keep_their_scale(
    divide: Callable[[torch.Tensor], Sequence[torch.Tensor]], aperture: float | torch.Tensor
) -> None:
    """As slices do: a part that was a plain tensor would be decoded with another scale, without a word."""
    values = torch.rand(4, 6, 8)
    whole = Measurement(values, aperture=aperture, full_scale=2.0)
    for part, right in zip(divide(whole), divide(whole.linear()), strict=True):
        assert isinstance(part, Measurement) and torch.equal(part.linear(), right)


def test_parts_of_an_operation_without_a_scale_are_refused() -> None:
    with pytest.raises(BadInput, match="scale of this tensor is unknown"):
        Measurement(torch.rand(4, 6, 8), aperture=0.25).sort(0).values.linear()
