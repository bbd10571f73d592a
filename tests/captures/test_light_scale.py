"""Full scale and aperture of snapshots as cameras and software write them: frames are as bright as the scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

import sci_lightning as sci
from sci_lightning.captures.light_scale import doubtful_brightness, full_scale_of, resolve_aperture
from sci_lightning.captures.snapshots import Snapshot
from sci_lightning.errors import BadInput

T, SIDE = 8, 48


def scene() -> np.ndarray:
    y, x = np.mgrid[:SIDE, :SIDE] / SIDE
    return np.stack([0.5 + 0.42 * np.sin(6 * (x + 0.03 * t)) * np.cos(5 * y) for t in range(T)])


def mask() -> np.ndarray:
    return (np.random.default_rng(1).random((T, SIDE, SIDE)) < 0.5).astype(np.float32)


LIGHT = (mask() * scene()).sum(0)
"""Near 2 on average, at most 8."""


def dn(bits: int, part: float = 1.0) -> np.ndarray:
    """An exposure that a white scene fills on average, times ``part``."""
    return np.clip(np.round(LIGHT / 4 * part * (2**bits - 1)), 0, 2**bits - 1).astype(np.uint16)


@pytest.mark.parametrize(
    ("values", "bit_depth", "full_scale", "words"),
    [
        (dn(12), None, 4095, "12 bits"),
        (dn(12) << 4, None, 65520, "12 bits at the top of 16"),
        (dn(10) << 6, None, 65472, "10 bits at the top of 16"),
        (dn(14) << 2, None, 65532, "14 bits at the top of 16"),
        (dn(12, 0.2) << 4, None, 65520, "12 bits at the top of 16"),
        (dn(16), None, 65535, "16 bits"),
        (dn(8).astype(np.uint8), None, 255, "8 bits"),
        (dn(8).astype(np.uint8) // 4 * 4, None, 255, "8 bits"),
        (dn(8) << 2, None, 1023, "10 bits"),  # a camera of 10 bits that gives 8
        (dn(12).astype(np.float64), None, 4095, "12 bits"),
        (dn(12) / 4095, None, 1, "floating-point"),
        (dn(8), 8, 255, "the sensor's 8 bits"),
        (dn(12), 8, 4095, "12 bits"),
        (np.full((4, 4), 70000, np.int32), None, 2**17 - 1, "17 bits"),
    ],
)
def test_full_scale_of_numbers(values: np.ndarray, bit_depth: int | None, full_scale: float, words: str) -> None:
    chosen, why = full_scale_of(values[None], bit_depth)
    assert chosen == full_scale and words in why


@pytest.mark.parametrize(
    ("values", "full_scale"),
    [
        (dn(12), None),
        (dn(12) << 4, None),
        (dn(12), 4095),  # an ordinary exposure, without aperture=
        (dn(12), 4095 / 4),
        (dn(12) / 4095, None),
        (LIGHT, None),  # a sum of frames
        (np.round(255 * LIGHT).astype(np.uint16), 255),
        (np.round(255 * LIGHT).astype(np.uint16), None),
        (np.round(255 * LIGHT), None),
    ],
)
def test_frames_as_bright_as_the_scene(tmp_path: Path, values: np.ndarray, full_scale: float | None) -> None:
    np.save(tmp_path / "mask.npy", mask())
    np.save(tmp_path / "snapshot.npy", values)
    decoder, said = sci.load_decoder("gap_tv", ["decoder.iterations=[8]"]), []
    result = sci.reconstruct(
        tmp_path / "snapshot.npy", decoder, mask=tmp_path / "mask.npy", full_scale=full_scale, say=said.append
    )
    assert result.video.shape == (1, T, SIDE, SIDE) and result.warnings == () and result.white == 1
    assert abs(float(result.video.mean()) - scene().mean()) < 0.03
    assert any(f"full_scale={result.full_scale:g}" in line and "aperture=" in line for line in said)


def test_a_light_scale_below_the_converter_s_end_is_no_saturation(tmp_path: Path) -> None:
    np.save(tmp_path / "mask.npy", mask())
    decoder = sci.load_decoder("gap_tv", ["decoder.iterations=[2]"])
    given = {"mask": tmp_path / "mask.npy", "full_scale": 4095 / 8, "say": lambda line: None}
    exposed = np.clip(np.round(LIGHT / 8 * 4095), 0, 4095).astype(np.uint16)
    assert sci.reconstruct(exposed, decoder, **given).warnings == ()
    (line,) = sci.reconstruct(np.minimum(dn(12, 1.8), 4095), decoder, **given).warnings
    assert "% of the pixels are saturated" in line


def test_frames_that_come_out_dark_are_doubted_and_shown_brighter(tmp_path: Path) -> None:
    from PIL import Image

    np.save(tmp_path / "mask.npy", mask())
    decoder, said = sci.load_decoder("gap_tv", ["decoder.iterations=[2]"]), []
    values = (0.5 * LIGHT / LIGHT.max()).astype(np.float32)
    result = sci.reconstruct(
        values, decoder, mask=tmp_path / "mask.npy", aperture=1.0, out=tmp_path / "out", say=said.append
    )
    (line,) = result.warnings
    assert "come out dark" in line and "aperture=" in line and f"warning: {line}" in said
    assert any("scaled to be seen" in line for line in said)
    assert np.asarray(Image.open(tmp_path / "out" / "frames" / "000_00.png")).max() > 200
    assert result.video.max() < 0.3


def test_where_an_aperture_comes_from() -> None:
    masks = torch.from_numpy(mask())
    camera = sci.Encoder(sci.masks.RandomBinary(4, (SIDE, SIDE)), sci.sensors.ClipQuantise(bit_depth=8))
    ideal = sci.Encoder(sci.masks.RandomBinary(T, (SIDE, SIDE)), sci.sensors.Ideal(), aperture=1.0)
    ordinary = pytest.approx(1 / float(masks.sum(0).mean()))
    assert resolve_aperture(0.3, camera, masks, 1.0, own_mask=False)[0] == 0.3
    assert resolve_aperture("auto", ideal, masks, 5.0, own_mask=False)[0] == ordinary
    assert resolve_aperture(None, camera, masks, 1.0, own_mask=False)[0] == ordinary  # of 8 slots, not of its own 4
    assert resolve_aperture(None, camera, camera.mask(), 1.0, own_mask=True)[0] == camera.aperture == 0.5
    assert resolve_aperture(None, ideal, masks, 1.0, own_mask=False)[0] == ordinary
    assert resolve_aperture(None, ideal, masks, 3.0, own_mask=False)[0] == 1.0
    assert doubtful_brightness(0.8, 255, 1.0) == "" and "brighter than white" in doubtful_brightness(3.0, 255, 1.0)


def test_what_a_notebook_gives_wrongly(tmp_path: Path) -> None:
    decoder = sci.load_decoder("gap_tv", ["decoder.iterations=[2]"])
    with pytest.raises(BadInput, match="nothing says which mask"):
        sci.reconstruct(LIGHT, decoder)
    with pytest.raises(BadInput, match=r"expected numbers \(H, W\) or \(N, H, W\)"):
        sci.reconstruct(np.zeros(3), decoder, mask="mask.npy")
    np.save(tmp_path / "mask.npy", mask())
    for wrong in ("half", -1.0, float("nan")):
        with pytest.raises(BadInput, match=r"aperture=.*positive number, or auto"):
            sci.reconstruct(LIGHT, decoder, mask=tmp_path / "mask.npy", aperture=wrong)
    with pytest.raises(BadInput, match=r"mask_step=.* belongs to a mask"):
        sci.reconstruct(LIGHT, decoder, mask_step=(1, 0))


def test_why_a_full_scale_was_chosen_is_a_sentence() -> None:
    dim = Snapshot("y.tiff", torch.full((1, 2, 2), 1622 / 65535), 65535.0, integer=True, chosen="whole numbers")
    chosen = dim.as_sum(8.0).chosen
    assert "sum of 8-bit frames" in chosen and "end at 1622" in chosen and "full_scale=65535" in chosen
