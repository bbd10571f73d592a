"""Q against values of the original program, and what Q refuses."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter

from sci_lightning.errors import BadInput
from sci_lightning.metrics import hdrvdp2_q

CONVENTIONS: dict[str, dict[str, Any]] = {
    "luma-display|ppd=30": {},
    "luma-display|ppd=60": {"pixels_per_degree": 60},
    "luminance_x255|ppd=52.7224414273": {"encoding": "luminance", "pixels_per_degree": 52.7224414273},
    "sRGB-display|ppd=30": {"encoding": "sRGB-display"},
}
FORMULAS = {
    "zone_blur1": (57.834913265, 37.960586832, 41.27490578, 57.747747174),
    "ramp_quant4bit": (59.942734123, 44.942494168, 40.633328588, 60.04246971),
    "ramp_gain0.9": (78.32562497, 70.936467681, 89.023348317, 79.319628514),
}
"""Version 2.2.2 in the conventions above."""


def pair(name: str) -> tuple[torch.Tensor, torch.Tensor]:
    """Test and reference (1, 256, 256) that need no file."""
    i, j = np.mgrid[:256, :256]
    zone = 0.5 + 0.45 * np.cos(np.pi * ((i - 128) ** 2 + (j - 128) ** 2) / 600)
    ramp = 0.9 * ((i + 2 * j) / 765) + 0.1 * ((i // 32 + j // 32) % 2)
    test, reference = {
        "zone_blur1": (gaussian_filter(zone, 1, mode="nearest"), zone),
        "ramp_quant4bit": (np.round(15 * ramp) / 15, ramp),
        "ramp_gain0.9": (0.9 * ramp, ramp),
    }[name]
    return torch.from_numpy(test).float().unsqueeze(0), torch.from_numpy(reference).float().unsqueeze(0)


def frames(*shape: int) -> torch.Tensor:
    return torch.rand(*shape, dtype=torch.float64)


def noisy(truth: torch.Tensor, std: float = 0.05) -> torch.Tensor:
    return (truth + std * torch.randn_like(truth)).clamp(min=0)


@pytest.mark.parametrize("name", FORMULAS)
def test_pairs_made_from_formulas(name: str) -> None:
    for (convention, arguments), expected in zip(CONVENTIONS.items(), FORMULAS[name], strict=True):
        test, reference = (255 * x.double() if "x255" in convention else x for x in pair(name))
        assert float(hdrvdp2_q(test, reference, **arguments)) == pytest.approx(expected, abs=1e-6)
        single = hdrvdp2_q(test, reference, **arguments, dtype=torch.float32)
        assert single.dtype == torch.float32
        assert float(single) == pytest.approx(expected, abs=0.02)


@pytest.fixture(scope="module")
def table(shared_reference: Path) -> dict[str, Any]:
    table = json.loads((shared_reference / "hdrvdp2" / "expected.json").read_text())
    with np.load(shared_reference / "hdrvdp2" / "pairs.npz", allow_pickle=False) as arrays:
        return {**table, "test": torch.from_numpy(arrays["test"]), "ref": torch.from_numpy(arrays["ref"])}


def told(table: dict[str, Any], convention: str) -> tuple[float, dict[str, Any]]:
    """What a convention of the table multiplies pixel values with, and calls the function with."""
    about = table["conventions"][convention]
    factor = 255 if about["input"].startswith("255") else 1
    return factor, {"encoding": about["color_encoding"], "pixels_per_degree": about["pixels_per_degree"]}


@pytest.mark.filterwarnings("ignore:encoding=luminance")
@pytest.mark.parametrize("pairs", [slice(None, None, 9), pytest.param(slice(None), marks=pytest.mark.slow)])
def test_reference_table(table: dict[str, Any], pairs: slice) -> None:
    assert len(table["pairs"]) == 27 and len(table["conventions"]) == 9
    for convention in table["conventions"]:
        factor, arguments = told(table, convention)
        values = [pair["values"][convention]["Q"] for pair in table["pairs"]]
        expected = torch.tensor(values, dtype=torch.float64)[pairs]
        images = [factor * table[key][pairs].double() for key in ("test", "ref")]
        result = hdrvdp2_q(*images, **arguments)
        torch.testing.assert_close(result, expected, atol=1e-6, rtol=0)
        assert (result == 100).tolist() == (expected == 100).tolist()
        if arguments["pixels_per_degree"] == 30:
            single = hdrvdp2_q(*images, **arguments, dtype=torch.float32).double()
            worse = expected < 95
            torch.testing.assert_close(single[worse], result[worse], atol=0.02, rtol=0)


def test_reference_table_of_other_sizes(table: dict[str, Any]) -> None:
    for case in table["other_sizes"]["cases"]:
        _, arguments = told(table, case["convention"])
        images = [table[key][case["index"]] for key in ("test", "ref")]
        if case.get("mirror_tiled"):
            images = [
                torch.cat((torch.cat((x, x.flip(1)), 1), torch.cat((x.flip(0), x.flip(0, 1)), 1))) for x in images
            ]
        else:
            images = [x[slice(*case["rows"]), slice(*case["cols"])] for x in images]
        result = hdrvdp2_q(*(x.unsqueeze(0) for x in images), **arguments)
        assert float(result) == pytest.approx(case["Q"], abs=1e-6), case


def test_bands_before_they_are_weighted(table: dict[str, Any]) -> None:
    """Errors that compensate in Q, or that its weights hide, show here."""
    from sci_lightning.metrics.hdrvdp2 import quality

    kept: list[torch.Tensor] = []

    def keep(squares: list[torch.Tensor], frequencies: list[float]) -> torch.Tensor:
        kept[:] = [(band.sum((-2, -1)).sqrt() / band[0, 0].numel()).flatten() for band in squares]
        return torch.zeros(1)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(quality, "pool", keep)
        for each in table["pairs"][::5]:
            images = (table[key][each["index"]].unsqueeze(0) for key in ("test", "ref"))
            hdrvdp2_q(*images)
            expected = torch.tensor(each["band_msre_luma-display_ppd30"], dtype=torch.float64)
            torch.testing.assert_close(torch.cat(kept), expected, rtol=1e-6, atol=1e-15)


@pytest.mark.parametrize("size", [(17, 17), (17, 40), (33, 18), (51, 35)])
def test_same_images_give_exactly_100(size: tuple[int, int]) -> None:
    truth = frames(3, *size)
    assert hdrvdp2_q(truth, truth).tolist() == [100.0] * 3
    assert hdrvdp2_q(truth, truth, dtype=torch.float32).tolist() == [100.0] * 3
    assert (hdrvdp2_q(noisy(truth), truth) < 95).all()


def test_a_pair_does_not_depend_on_its_batch() -> None:
    truth = frames(300, 24, 40)  # more than are worked on at a time
    test = noisy(truth)
    together = hdrvdp2_q(test, truth)
    for one in (0, 150, 299):
        alone = hdrvdp2_q(test[one : one + 1].mT.contiguous().mT, truth[one : one + 1])
        torch.testing.assert_close(together[one], alone[0], rtol=0, atol=1e-9)


def test_reference_and_test_are_not_alike() -> None:
    truth = frames(1, 32, 32)
    test = 0.5 * truth
    assert abs(float(hdrvdp2_q(test, truth) - hdrvdp2_q(truth, test))) > 1e-9


def test_grey_frames_stand_for_three_equal_channels() -> None:
    truth = frames(2, 32, 48)
    test = noisy(truth)
    colour = (x.unsqueeze(1).expand(-1, 3, -1, -1) for x in (test, truth))
    grey = hdrvdp2_q(test, truth, encoding="sRGB-display")
    torch.testing.assert_close(hdrvdp2_q(*colour, encoding="sRGB-display"), grey, rtol=0, atol=1e-9)


def test_each_channel_counts() -> None:
    truth = frames(1, 3, 32, 32)
    whole = float(hdrvdp2_q(noisy(truth), truth, encoding="sRGB-display"))
    for channel in range(3):
        test = truth.clone()
        test[:, channel] = noisy(truth[:, channel])
        assert whole < float(hdrvdp2_q(test, truth, encoding="sRGB-display")) < 100


@pytest.mark.parametrize("encoding", ["luma-display", "sRGB-display", "luminance"])
def test_gradient(encoding: str) -> None:
    """By central differences, with the values cached before by a call that wanted no gradient."""
    scale = 100 if encoding == "luminance" else 1
    truth = scale * (0.2 + 0.6 * frames(1, 19, 21))
    test = noisy(truth, 0.05 * scale)
    with torch.inference_mode():
        hdrvdp2_q(test, truth, encoding=encoding, pixels_per_degree=29)
    test.requires_grad_()
    truth.requires_grad_()
    hdrvdp2_q(test, truth, encoding=encoding, pixels_per_degree=29).sum().backward()
    for images in (test, truth):
        direction = scale * torch.randn_like(images)
        assert images.grad is not None
        step = 1e-6 * direction
        with torch.no_grad():
            ends = [[x + s * step if x is images else x for x in (test, truth)] for s in (1, -1)]
            up, down = (float(hdrvdp2_q(*end, encoding=encoding, pixels_per_degree=29)) for end in ends)
        assert float((images.grad * direction).sum()) == pytest.approx((up - down) / 2e-6, rel=1e-4)


def test_gradient_of_images_that_are_the_same() -> None:
    test = frames(1, 20, 20).requires_grad_()
    hdrvdp2_q(test, test.detach()).sum().backward()
    assert test.grad is not None and not test.grad.any()


def test_values_above_1_and_zeros() -> None:
    truth = frames(1, 32, 32)
    truth[:, :16] = 0
    for encoding in ("luma-display", "sRGB-display", "luminance"):
        scale = 100 if encoding == "luminance" else 1
        test = (truth + 0.1 * (truth > 0.5)).requires_grad_()
        q = hdrvdp2_q(scale * test, scale * truth, encoding=encoding)
        assert q.isfinite().all() and (q < 100).all()
        q.sum().backward()
        assert test.grad is not None and test.grad.isfinite().all() and test.grad.any()


def test_autocast_does_not_reach_it() -> None:
    truth = frames(1, 32, 32).float()
    test = noisy(truth)
    with torch.autocast("cpu", torch.bfloat16):
        inside = hdrvdp2_q(test, truth, dtype=torch.float32)
    assert torch.equal(inside, hdrvdp2_q(test, truth, dtype=torch.float32))


def with_value(value: float) -> torch.Tensor:
    images = torch.rand(2, 20, 20)
    images[1, 3, 4] = value
    return images


GOOD = torch.full((2, 20, 20), 0.5)


@pytest.mark.parametrize(
    ("test", "reference", "arguments", "message"),
    [
        (GOOD, GOOD[:1], {}, "one shape"),
        (GOOD, GOOD[..., :19], {}, "one shape"),
        (GOOD[0], GOOD[0], {}, "must be"),
        (GOOD[:0], GOOD[:0], {}, "must be"),
        (GOOD.expand(3, 2, 20, 20).mT, GOOD.expand(3, 2, 20, 20).mT, {"encoding": "sRGB-display"}, "must be"),
        (torch.ones(1, 3, 20, 20), torch.ones(1, 3, 20, 20), {}, "sRGB-display"),
        (GOOD[..., :16], GOOD[..., :16], {}, "17 x 17 pixels, got 20 x 16"),
        (GOOD[:, :16], GOOD[:, :16], {}, "17 x 17 pixels, got 16 x 20"),
        (with_value(float("nan")), GOOD, {}, "test has values that are NaN or infinite"),
        (GOOD, with_value(float("inf")), {}, "reference has values that are NaN or infinite"),
        (with_value(-0.25), GOOD, {}, "test has negative values, down to -0.25"),
        (GOOD, with_value(-1e-6), {"encoding": "luminance"}, "reference has negative values"),
        (GOOD.byte(), GOOD, {}, "test is torch.uint8"),
        (GOOD, GOOD.int(), {}, "reference is torch.int32"),
        (GOOD, GOOD > 0, {}, "reference is torch.bool"),
        (GOOD, GOOD, {"encoding": "srgb"}, "luma-display, sRGB-display, luminance"),
        (GOOD, GOOD, {"pixels_per_degree": 0}, "must be a positive number"),
        (GOOD, GOOD, {"pixels_per_degree": "30"}, "must be a positive number"),
        (GOOD, GOOD, {"pixels_per_degree": -30.0}, "must be a positive number"),
        (GOOD, GOOD, {"pixels_per_degree": float("nan")}, "must be a positive number"),
        (GOOD, GOOD, {"pixels_per_degree": float("inf")}, "must be a positive number"),
        (GOOD, GOOD, {"dtype": torch.float16}, "float64 or torch.float32"),
    ],
)
def test_bad_input(test: torch.Tensor, reference: torch.Tensor, arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInput) as caught:
        hdrvdp2_q(test, reference, **arguments)
    assert message in str(caught.value) and "\n" not in str(caught.value)


def test_luminance_that_is_none_is_warned_of() -> None:
    with pytest.warns(UserWarning, match="cd/m2"):
        hdrvdp2_q(GOOD, GOOD, encoding="luminance")
