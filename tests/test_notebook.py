"""What everybody types first in a notebook: every line is right, or refused in one line; none is wrong in silence."""

from __future__ import annotations

import copy
import io
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch

import sci_lightning as sci
from sci_lightning.data import Synthetic
from sci_lightning.errors import InputWarning
from sci_lightning.measurement import Measurement
from sci_lightning.metrics import psnr

T, SIZE = 8, (64, 64)


@pytest.fixture(scope="module")
def video() -> torch.Tensor:
    return Synthetic(T, SIZE, SIZE, seed=0, scenes_count=1, snapshots_per_scene=1).scenes()[0].video[:1]


@pytest.fixture(scope="module")
def encoder() -> sci.Encoder:
    return sci.Encoder(sci.masks.RandomBinary(T, SIZE, seed=0), sci.sensors.ClipQuantise(bit_depth=8))


@pytest.fixture(scope="module")
def gap_tv() -> sci.decoders.Decoder:
    return sci.load_decoder("gap_tv", ["decoder.iterations=[20]"])


@pytest.fixture(scope="module")
def right(video: torch.Tensor, encoder: sci.Encoder, gap_tv: sci.decoders.Decoder) -> torch.Tensor:
    return sci.Pipeline(encoder, gap_tv)(video)


def quality(estimate: torch.Tensor, video: torch.Tensor) -> float:
    return float(psnr(estimate, video).mean())


LINES = {
    "the obvious one": lambda e, d, x: d(e(x), e.transmittance()),
    "decoder_mask": lambda e, d, x: d(e(x), e.decoder_mask()),
    "the mask alone": lambda e, d, x: d(e(x), e.mask()),
    "reconstruct": lambda e, d, x: sci.Pipeline(e, d).reconstruct(e(x)),
    "reconstruct what was loaded": lambda e, d, x: sci.Pipeline(e, d).reconstruct(torch.from_numpy(e(x).numpy())),
    "decode without linearise": lambda e, d, x: sci.Pipeline(e, d).decode(e(x)),
    "decode with the mask": lambda e, d, x: sci.Pipeline(e, d).decode(e(x), sci.Pipeline(e, d).decoder_mask()),
    "decode after linearise": lambda e, d, x: sci.Pipeline(e, d).decode(sci.Pipeline(e, d).linearise(e(x))),
    "linearised twice": lambda e, d, x: sci.Pipeline(e, d).reconstruct(sci.Pipeline(e, d).linearise(e(x))),
    "normalised": lambda e, d, x: d(e.normalised(e(x)), e.transmittance()),
    "normalised what was loaded": lambda e, d, x: d(e.normalised(torch.from_numpy(e(x).numpy())), e.transmittance()),
    "divided by hand": lambda e, d, x: d(e(x) / e.aperture, e.transmittance()),
    "in DN": lambda e, d, x: d(255 * e(x), e.transmittance()),
    "DN of a file": lambda e, d, x: d(
        sci.Measurement((255 * e(x)).numpy().astype(np.uint8), e.aperture, 255), e.transmittance()
    ),
    "a slice": lambda e, d, x: d(e(x)[:1], e.transmittance()),
    "clamped, copied": lambda e, d, x: d(e(x).clamp(0, 1).clone().detach().to("cpu"), e.transmittance()),
    "in halves": lambda e, d, x: d(0.5 * e(x) + 0.5 * e(x), e.transmittance()),
    "joined": lambda e, d, x: d(torch.cat([e(x), e(x)]), e.transmittance())[:1],
    "a deep copy": lambda e, d, x: d(copy.deepcopy(e(x)), e.transmittance()),
}


@torch.no_grad()
@pytest.mark.parametrize("line", LINES)
def test_right_lines(
    line: str, encoder: sci.Encoder, gap_tv: sci.decoders.Decoder, video: torch.Tensor, right: torch.Tensor
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error", InputWarning)
        estimate = LINES[line](encoder, gap_tv, video)
    assert type(estimate) is torch.Tensor and estimate.shape == video.shape
    assert quality(right, video) > 20
    torch.testing.assert_close(estimate, right, rtol=0, atol=0.01)
    assert quality(estimate, video) == pytest.approx(quality(right, video), abs=0.1)


def saved_and_loaded(measurement: torch.Tensor) -> torch.Tensor:
    file = io.BytesIO()
    torch.save(measurement, file)
    file.seek(0)
    return torch.load(file)


REFUSED = {
    "plain": (lambda e, d, x: d(torch.from_numpy(e(x).numpy()), e.transmittance()), "aperture of|aperture 0.25"),
    "plain, decoder_mask": (lambda e, d, x: d(torch.from_numpy(e(x).numpy()), e.decoder_mask()), "aperture 0.25"),
    "plain, decode": (lambda e, d, x: sci.Pipeline(e, d).decode(torch.from_numpy(e(x).numpy())), "aperture 0.25"),
    "saved": (lambda e, d, x: d(saved_and_loaded(e(x)), e.transmittance()), "aperture 0.25"),
    "another operation": (lambda e, d, x: d(e(x) ** 2.2, e.transmittance()), "scale .*unknown"),
    "times a map": (lambda e, d, x: d(e(x) * torch.rand(SIZE), e.transmittance()), "scale .*unknown"),
    "a difference of two": (lambda e, d, x: d(e(x) - e(x), e.transmittance()), "scale .*unknown"),
    "one snapshot": (lambda e, d, x: d(e(x)[0], e.transmittance()), r"measurement\[None\]"),
    "integers": (lambda e, d, x: d((255 * e(x)).to(torch.uint8), e.mask()), "full_scale"),
    "DN as floats": (lambda e, d, x: d(torch.from_numpy(1023 * e(x).numpy()), e.mask()), "full_scale"),
    "a mask of 0 and 255": (lambda e, d, x: d(e(x), 255 * e.mask()), "transmittance is 0 to 1"),
    "a video of 8 bits": (lambda e, d, x: e((255 * x).to(torch.uint8)), "/ 255"),
    "gray levels as floats": (lambda e, d, x: e((255 * x).round()), "/ 255"),
    "16 bits as floats": (lambda e, d, x: e(65535 * x), "/ 65535"),
    "NaN": (lambda e, d, x: e(x * float("nan")), "NaN"),
    "no batch": (lambda e, d, x: e(x[0]), r"video\[None\]"),
    "time last": (lambda e, d, x: e(x.permute(0, 2, 3, 1)), "permute"),
    "N and T exchanged": (lambda e, d, x: e(x.transpose(0, 1)), "transpose"),
    "mask and measurement exchanged": (lambda e, d, x: d(e.transmittance(), e(x)), "comes first"),
    "the mask's module": (lambda e, d, x: d(e(x), e.mask), "e.transmittance|encoder.transmittance"),
    "an array": (lambda e, d, x: e(x.numpy()), "as_tensor"),
    "negative light": (lambda e, d, x: e(x - x.mean()), "not negative"),
    "a mask of DN": (lambda e, d, x: sci.Encoder(255 * e.mask(), e.sensor), r"\[0, 1\]"),
    "a decoder's name": (lambda e, d, x: sci.reconstruct(e(x), "gap_tv", e), "load_decoder"),
    "scored in gray levels": (lambda e, d, x: psnr(x, (255 * x).to(torch.uint8)), "/ 255"),
    "scored against the measurement": (lambda e, d, x: psnr(x, e(x)), "one shape"),
    "words in one": (lambda e, d, x: sci.train("scale=smoke out=a"), "'scale=smoke', 'out=a'"),
    "through the pipeline": (lambda e, d, x: sci.Pipeline(e, d)((255 * x).to(torch.uint8)), "/ 255"),
}


@torch.no_grad()
@pytest.mark.parametrize("line", REFUSED)
def test_wrong_lines_are_refused(
    line: str, encoder: sci.Encoder, gap_tv: sci.decoders.Decoder, video: torch.Tensor
) -> None:
    wrong, words = REFUSED[line]
    with pytest.raises(sci.BadInput, match=words) as refused:
        wrong(encoder, gap_tv, video)
    assert "\n" not in str(refused.value)


@torch.no_grad()
def test_reconstruct_reads_what_a_measurement_knows(
    encoder: sci.Encoder, gap_tv: sci.decoders.Decoder, video: torch.Tensor, right: torch.Tensor, tmp_path: Path
) -> None:
    """Also where the encoder is not given, and its aperture is not the one that the numbers suggest."""
    dim = sci.Encoder(encoder.mask, encoder.sensor, aperture=0.125)
    np.save(tmp_path / "mask.npy", encoder.mask().numpy())
    for measurement in (dim(video), 255 * dim(video)):
        done = sci.reconstruct(measurement, gap_tv, mask=tmp_path / "mask.npy", say=lambda line: None)
        assert done.aperture == 0.125
        assert quality(torch.from_numpy(done.video), video) == pytest.approx(quality(right, video), abs=0.5)
    with pytest.raises(sci.BadInput, match="undone already"):
        sci.reconstruct(encoder.normalised(encoder(video)), gap_tv, encoder)


@torch.no_grad()
def test_effects_of_the_sensor_are_undone(gap_tv: sci.decoders.Decoder, video: torch.Tensor) -> None:
    effects = [sci.effects.BlackLevel(offset=0.1), sci.effects.Vignetting(strength=0.4)]
    encoder = sci.Encoder(sci.masks.RandomBinary(T, SIZE, seed=0), sci.sensors.ClipQuantise(10), effects=effects)
    pipeline = sci.Pipeline(encoder, gap_tv)
    measurement = encoder(video)
    expected = pipeline(video)
    assert quality(expected, video) > 20
    for estimate in (gap_tv(measurement, encoder.transmittance()), pipeline.reconstruct(measurement.numpy())):
        torch.testing.assert_close(estimate, expected, rtol=0, atol=1e-4)
    linear = encoder.linearise(measurement) / encoder.aperture
    torch.testing.assert_close(gap_tv(linear, encoder.transmittance()), expected, rtol=0, atol=1e-4)
    part = encoder.transmittance()[:, 8:40, 8:40]
    with pytest.raises(sci.BadInput, match="origin"):
        gap_tv(measurement[:, 8:40, 8:40], part)
    inside = encoder.normalised(measurement[:, 8:40, 8:40].recorded(), origin=(8, 8))
    assert quality(gap_tv(inside, part), video[..., 8:40, 8:40]) > 20


def test_a_measurement_says_what_it_is(encoder: sci.Encoder, video: torch.Tensor) -> None:
    measurement = encoder(video)
    assert isinstance(measurement, Measurement) and 0 <= float(measurement.min()) <= float(measurement.max()) <= 1
    assert "aperture 0.25" in repr(measurement) and "unknown" in repr(measurement.exp())
    assert type(measurement[0, 0]) is torch.Tensor and type(encoder.record(video, encoder.mask())) is torch.Tensor
    with pytest.raises(sci.BadInput, match="full_scale"):
        Measurement(np.zeros((1, 4, 4), np.uint8))
    with pytest.raises(sci.BadInput, match="positive"):
        Measurement(torch.zeros(1, 4, 4), aperture=0)


WARNED = {
    "another camera's mask": lambda e, d, x: d(
        e(x), sci.Encoder(sci.masks.RandomBinary(T, SIZE, seed=1), e.sensor).mask()
    ),
    "a structural mask": lambda e, d, x: d(e(x), sci.masks.RandomStructural(4, T, SIZE)()),
    "flipped": lambda e, d, x: d(e(x), e.transmittance().flip(-1)),
    "displaced": lambda e, d, x: d(e(x), e.transmittance().roll(1, -1)),
    "in another order": lambda e, d, x: d(0.5 * e(x), e.transmittance().flip(0)),
}


@torch.no_grad()
@pytest.mark.parametrize("line", WARNED)
def test_lines_that_may_be_meant_are_done_with_a_word(
    line: str, encoder: sci.Encoder, gap_tv: sci.decoders.Decoder, video: torch.Tensor
) -> None:
    with pytest.warns(InputWarning, match="not the one behind which"):
        WARNED[line](encoder, gap_tv, video)


@torch.no_grad()
def test_a_designed_mask_is_an_encoders(
    encoder: sci.Encoder, video: torch.Tensor, gap_tv: sci.decoders.Decoder
) -> None:
    ours = sci.Encoder(encoder.mask(), encoder.sensor)
    assert torch.equal(ours.mask(), encoder.mask()) and ours.aperture == pytest.approx(encoder.aperture, rel=0.05)
    done = sci.reconstruct(ours(video), gap_tv, ours, say=lambda line: None)
    assert quality(done.video, video) == pytest.approx(quality(gap_tv(ours(video), ours.transmittance()), video))


def test_gradients_reach_the_mask(video: torch.Tensor) -> None:
    encoder = sci.Encoder(sci.masks.LearnedBinary(T, SIZE), sci.sensors.ClipQuantise(bit_depth=8))
    decoder = sci.load_decoder("e2e_cnn", ["scale=smoke", "decoder.channels=4"])
    estimate = decoder(encoder(video), encoder.transmittance())
    estimate.square().mean().backward()
    assert all(p.grad is not None and p.grad.abs().max() > 0 for p in encoder.parameters())


def test_an_encoder_says_what_it_is(encoder: sci.Encoder) -> None:
    words = repr(encoder)
    assert all(word in words for word in ("T=8", "64 x 64", "RandomBinary", "1 bit,", "0.25", "8 bits"))
    assert "\n" not in words and len(words) < 200
    shifted = sci.Encoder(sci.masks.RandomBinary(T, SIZE), sci.sensors.Ideal(), effects=[sci.effects.MaskShift(dx=1.0)])
    assert "mask_shift" in repr(shifted)
