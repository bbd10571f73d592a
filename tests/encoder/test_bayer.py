"""A Bayer sensor: what its pixels see of a scene in colour, the four sub-lattices, and the way back to colours."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from itertools import product
from typing import Any, get_args

import numpy as np
import pytest
import torch

from sci_lightning.configuration.bounds import BayerPattern
from sci_lightning.decoder.linear import Linear
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.effects import Effect
from sci_lightning.encoder.effects.optics.optical_blur import OpticalBlur
from sci_lightning.encoder.effects.optics.vignetting import Vignetting
from sci_lightning.encoder.mask import RandomBinary
from sci_lightning.encoder.sensor import Bayer, ClipQuantise
from sci_lightning.encoder.sensor.bayer import demosaiced, interleaved, mosaic, sub_lattices
from sci_lightning.errors import BadInput
from sci_lightning.pipeline import Pipeline

PATTERNS = get_args(BayerPattern)


def camera(pattern: Any = "rggb", size: tuple[int, int] = (12, 16), effects: Sequence[Effect] = ()) -> Encoder:
    return Encoder(RandomBinary(frames=4, size=size), Bayer(pattern), effects=effects)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_every_pixel_sees_its_own_colour(pattern: str) -> None:
    """The snapshot of each colour alone, taken by a gray camera, has the same pixels."""
    video, encoder = torch.rand(2, 3, 4, 12, 16), camera(pattern)
    gray = Encoder(encoder.mask, ClipQuantise())
    snapshots = [gray.record(video[:, colour], gray.transmittance()) for colour in range(3)]
    recorded = encoder(video).recorded()
    for row, column in product(range(12), range(16)):
        colour = "rgb".index(pattern[2 * (row % 2) + column % 2])
        assert torch.equal(recorded[:, row, column], snapshots[colour][:, row, column])


def test_sub_lattices_and_back() -> None:
    image = torch.rand(2, 3, 6, 8)
    parts = sub_lattices(image)
    assert [float(part[0, 0, 0, 0]) for part in parts] == image[0, 0, :2, :2].flatten().tolist()
    assert torch.equal(interleaved(parts), image)


def test_a_pipeline_decodes_four_gray_snapshots() -> None:
    encoder, decoder = camera(), Linear()
    pipeline = Pipeline(encoder, decoder)
    measurement = encoder(torch.rand(2, 3, 4, 12, 16))
    linear, mask = measurement.linear(), encoder.mask()
    parts = [decoder(linear[:, r::2, c::2], mask[:, r::2, c::2]) for r, c in product((0, 1), (0, 1))]
    estimate = pipeline.reconstruct(measurement)
    for part, (r, c) in zip(parts, product((0, 1), (0, 1)), strict=True):
        assert torch.allclose(estimate[..., r::2, c::2], part, atol=1e-6)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_a_scene_of_one_colour_comes_back(pattern: str) -> None:
    pytest.importorskip("colour_demosaicing", reason="pip install 'sci-lightning[colour]'")
    video = torch.tensor([0.9, 0.5, -0.1]).view(1, 3, 1, 1, 1).expand(2, 3, 4, 8, 12)
    shown = repr(np.float64(0.1) * 3), np.get_printoptions()
    assert torch.allclose(demosaiced(mosaic(video, pattern), pattern), video, atol=1e-6)
    assert (repr(np.float64(0.1) * 3), np.get_printoptions()) == shown  # the library would change them


def test_without_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "colour_demosaicing", None)
    with pytest.raises(BadInput, match=r"pip install 'sci-lightning\[colour\]'"):
        demosaiced(torch.rand(1, 4, 8, 8), "rggb")


def test_what_a_bayer_camera_refuses() -> None:
    for size in ((11, 16), (12, 15)):
        with pytest.raises(BadInput, match=r"x 1[56] pixels \(H x W\) .* both even"):
            camera(size=size)
    with pytest.raises(BadInput, match=r"bayer=rgbg: .* rggb, grbg"):
        camera("rgbg")
    with pytest.raises(BadInput, match=r"optical_blur mixes pixels .* encoder/sensor=bayer"):
        camera(effects=[OpticalBlur(sigma=1.0)])
    assert camera(effects=[Vignetting(strength=0.2)])(torch.rand(1, 3, 4, 12, 16)).shape == (1, 12, 16)
    gray = Encoder(RandomBinary(frames=4, size=(12, 16)), ClipQuantise())
    with pytest.raises(BadInput, match="encoder/sensor=bayer"):
        gray(torch.rand(1, 3, 4, 12, 16))
