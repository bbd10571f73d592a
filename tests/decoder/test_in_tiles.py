"""Every decoder in the configuration: in tiles as at once, and how far measurement and mask act."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from torch.nn import functional as F

from sci_lightning.decoder import Decoder
from sci_lightning.decoder import decoder as base
from sci_lightning.decoder.birnat import BIRNAT, FEATURES_FIELD, FRAME_FIELD, STEP_FIELD
from sci_lightning.decoder.denoiser import WNNM, FastDVDnet, FFDNet, TotalVariation
from sci_lightning.decoder.layers import kernels
from sci_lightning.decoder.layers.kernels import channels_last
from sci_lightning.decoder.layers.unet import UNet
from sci_lightning.decoder.tiling.tiling import Tiling
from sci_lightning.errors import BadInput
from sci_lightning.operator import SnapshotOperator
from tests.conftest import members
from tests.decoder.small import SMALL

FRAMES, HEIGHT, WIDTH = 3, 75, 130
TILE = {"birnat": (46, 46), "pnp_fastdvdnet": (80, 80), "universal": (48, 48)}
"""Tiles of decoders whose halo is larger than the 32 pixels of the others' tiles."""

FIELD = {
    "e2e_cnn": ["decoder.channels=4", "decoder.blocks=2"],
    "efficientsci": ["decoder.channels=8", "decoder.blocks=1", "decoder.groups=2", "decoder.heads=2"],
    "elp_unfolding": ["decoder.channels=8", "decoder.iterations=2", "decoder.priors=1"],
    "metasci": ["decoder.channels=8", "decoder.blocks=1"],
    "res2former": ["decoder.dim=16", "decoder.depths=[1,1]"],
    "res2former_l": ["decoder.dim=16", "decoder.depths=[1,1]", "decoder.groups=[2,2]", "decoder.heads=2"],
    "revsci": ["decoder.channels=8", "decoder.blocks=2"],
    "sci3d": ["decoder.phases=2", "decoder.channels=[3,4,4]", "decoder.inner=2"],
    "stformer": ["decoder.dim=4", "decoder.units=1"],
}
"""Networks that decode a tile by itself, so small that the distance over which they act can be measured."""


def scene() -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """Return a soft video ``(1, T, H, W)`` that moves, a binary mask and the measurement."""
    coarse = torch.rand(1, FRAMES, HEIGHT // 5, WIDTH // 5)
    video = F.interpolate(coarse, (HEIGHT, WIDTH), mode="bicubic", align_corners=False).clamp(0, 1)
    mask = (torch.rand(FRAMES, HEIGHT, WIDTH) < 0.5).float()
    return video, mask, SnapshotOperator(mask)(video)


def psnr(estimate: torch.Tensor, truth: torch.Tensor) -> float:
    return -10 * math.log10(float((estimate - truth).square().mean()))


@torch.no_grad()
@pytest.mark.parametrize(
    ("name", "input_"),
    [*((name, "published") for name in members("decoder")), ("metasci", "linear"), ("gap_net", "linear")],
)
def test_in_tiles_as_at_once(name: str, input_: str, make_decoder: Callable[..., Decoder]) -> None:
    """To a hundredth of a decibel, and nowhere further off than a tenth of a gray level."""
    more = ["decoder.first_estimate=linear"] if input_ == "linear" else []
    decoder = make_decoder(name, FRAMES, *SMALL.get(name, []), *more).eval()
    for parameter in decoder.parameters():
        if not parameter.any():  # a gain or a layer that starts from 0 hides what stands before it
            parameter.normal_(std=0.1)
    video, mask, measurement = scene()
    tiles: list[int] = []
    tiling = Tiling(TILE.get(name, (32, 32)), watch=lambda number, of: tiles.append(of))
    whole, parts = decoder(measurement, mask), decoder.in_tiles(measurement, mask, tiling)
    assert parts.shape == whole.shape
    if name != "linear":  # which works in strips of its own
        assert max(tiles) > 1
    assert abs(psnr(whole, video) - psnr(parts, video)) <= 0.01
    assert (whole - parts).abs().max() < 1 / 2550
    assert decoder._tiling is None


def field_of(function: Callable[..., torch.Tensor], width: int, period: int, frames: int = FRAMES) -> int:
    """Return over how many columns measurement or mask act on a result, by gradients in double precision."""
    measurement = torch.rand(1, 16, width, dtype=torch.float64, requires_grad=True)
    mask = torch.rand(frames, 16, width, dtype=torch.float64, requires_grad=True)
    middle, far = width // 2 // period * period, 0
    result = function(measurement, mask)
    for column in range(middle, middle + period):
        gradients = torch.autograd.grad(result[..., 7, column].sum(), (measurement, mask), retain_graph=True)
        acting = sum(gradient.abs().flatten(0, -2).sum(0) for gradient in gradients).nonzero()
        far = max(far, column - int(acting.min()), int(acting.max()) - column)
    return far


@pytest.mark.parametrize("name", FIELD)
def test_receptive_fields(name: str, make_decoder: Callable[..., Decoder]) -> None:
    """Nothing beyond the stated field acts, and it is not stated larger than it is by more than one coarse pixel."""
    decoder = make_decoder(name, FRAMES, *FIELD[name]).double().eval()
    kernels.use(decoder, "plain")  # convolutions on tiles round a little beyond their field
    with torch.no_grad():
        for parameter in decoder.parameters():
            if parameter.numel() == 1:
                parameter += 0.1
    stated = decoder.receptive_field
    assert stated is not None
    measured = field_of(decoder, 2 * decoder.alignment * (2 + stated // decoder.alignment), decoder.alignment)
    assert stated - decoder.alignment <= measured <= stated


@pytest.mark.parametrize("name", members("decoder"))
def test_every_network_states_its_field(name: str, make_decoder: Callable[..., Decoder]) -> None:
    decoder = make_decoder(name, FRAMES, *SMALL.get(name, []))
    assert decoder.global_steps or (name in FIELD and decoder.receptive_field is not None)


NETWORKS = {
    "ffdnet": (lambda: FFDNet(8, 5), 2),
    "fastdvdnet": (lambda: FastDVDnet([4, 4, 4], 2), 4),
    "unet": (lambda: UNet(FRAMES, (8, 8, 8)), 4),
}


@pytest.mark.parametrize("name", NETWORKS)
def test_fields_of_networks_in_steps(name: str) -> None:
    build, period = NETWORKS[name]
    denoiser = build().double()
    strength = [] if isinstance(denoiser, UNet) else [0.1]
    measured = field_of(lambda y, mask: denoiser((mask * y)[None], *strength), 240, period)
    assert denoiser.receptive_field - 4 <= measured <= denoiser.receptive_field


def test_fields_of_birnat() -> None:
    decoder = BIRNAT(FRAMES, channels=16, hidden=4).double()
    layers, step = list(decoder.first_frame_net.children()), decoder.forward_rnn.step
    place = layers.index(decoder.first_frame_net.att1)
    before, behind = torch.nn.Sequential(*layers[:place]), torch.nn.Sequential(*layers[place + 1 :])

    def features(measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        inputs = torch.cat([measurement[None], mask[None]], 1)
        return F.interpolate(before(channels_last(inputs)), scale_factor=2)

    assert FEATURES_FIELD - 2 <= field_of(features, 140, 2) <= FEATURES_FIELD
    assert field_of(lambda y, mask: behind(F.avg_pool2d((mask * y)[None], 2)), 60, 2, 16) <= FRAME_FIELD
    measured = field_of(lambda y, mask: step(y[None], mask[None, :4], mask[None, 4:]), 100, 2, 6)
    assert STEP_FIELD - 2 <= measured <= STEP_FIELD


@torch.no_grad()
@pytest.mark.parametrize("denoiser", [TotalVariation(4), WNNM(patch=4, step=3, reach=2, neighbours=6)])
def test_fields_of_algorithms(denoiser: TotalVariation | WNNM) -> None:
    """What changes beyond the stated field changes nothing."""
    video = torch.rand(1, 2, 31, 90)
    other, far = video.clone(), 45 + denoiser.receptive_field
    other[..., far + 1 :] += torch.rand(31, 90 - far - 1)
    before = denoiser(video, 0.1)
    denoiser.reset()
    assert torch.allclose(before[..., :46], denoiser(other, 0.1)[..., :46], atol=1e-6)


class Wide(Decoder):
    """A mean over the whole row, which acts noticeably from further away than any halo."""

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return mask * measurement.mean(-1, keepdim=True).unsqueeze(1)


class Blur(Decoder):
    """A mean over 81 columns, of which the first halo knows 33."""

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return F.avg_pool2d(mask * measurement.unsqueeze(1), (1, 81), 1, (0, 40), count_include_pad=False)


@torch.no_grad()
def test_the_seams_say_how_wide_the_halo_must_be() -> None:
    measurement, mask = torch.rand(1, 20, 400).cumsum(-1) / 200, torch.ones(2, 20, 400)
    decoder = Blur()
    assert decoder.halo == base.HALO < 40
    parts = decoder.in_tiles(measurement, mask, Tiling((20, 100)))
    assert torch.allclose(parts, decoder(measurement, mask), atol=1e-5)
    with pytest.raises(BadInput, match=r"tile=\[20,20\]: .*differ by .*halo of 32"):
        decoder.in_tiles(measurement, mask, Tiling((20, 20)))
    with pytest.raises(BadInput, match=r"differ.*tile=none"):
        Wide().in_tiles(torch.linspace(0, 1, 1600).expand(1, 4, 1600), torch.ones(2, 4, 1600), Tiling((300, 300)))


class Rounded(Decoder):
    """The measurement, which in bfloat16 is rounded in another way in every tile: beside its mean."""

    def __init__(self) -> None:
        super().__init__()
        self.fields: list[int] = []

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        self.fields.append(measurement.shape[-1])
        mean = measurement.mean()
        return mask * (((measurement - mean)[..., None] @ torch.ones(1, 1)).squeeze(-1).float() + mean).unsqueeze(1)


@torch.no_grad()
def test_rounding_is_no_reason_for_a_wider_halo() -> None:
    """Tiles differ at their seam by more than what is allowed in full precision, and no halo would help."""
    measurement, mask = 20 * torch.rand(1, 80, 200), torch.ones(2, 80, 200)
    decoder = Rounded()
    with torch.autocast("cpu", torch.bfloat16):
        parts = decoder.in_tiles(measurement, mask, Tiling((80, 100)))
        whole = decoder(measurement, mask)
    assert max(decoder.fields[:-1]) == 100 + base.HALO
    assert (parts - whole).abs().max() > base.SEAM_TOLERANCE
    assert torch.allclose(parts, whole, atol=0.2)


@pytest.mark.parametrize("name", ["gap_tv", "gap_net", "e2e_cnn", "birnat"])
def test_a_tile_smaller_than_the_halo(name: str, make_decoder: Callable[..., Decoder]) -> None:
    decoder = make_decoder(name, FRAMES, *SMALL[name])
    halo = decoder.halo
    with pytest.raises(BadInput, match=rf"tile=\[2,64\] .*halo of {halo} .*\[{halo},{halo}\]"):
        decoder.in_tiles(torch.rand(1, 96, 96), torch.rand(FRAMES, 96, 96), Tiling((2, 64)))
