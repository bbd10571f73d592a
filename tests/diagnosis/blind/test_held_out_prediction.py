"""Held-out pixels are predicted without being seen, and best by the camera that took them."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from sci_lightning.decoder import Linear
from sci_lightning.diagnosis.blind.held_out_pixels import compare_errors
from sci_lightning.diagnosis.blind.snapshots import SnapshotCamera, textured_window
from sci_lightning.diagnosis.blind.unknown_scenes import Predictor, default_decoder, effective_mask
from sci_lightning.errors import BadInput

Record = Callable[..., SnapshotCamera]


def test_a_held_out_pixel_is_not_seen(record: Record) -> None:
    """Its prediction stays the same, bit for bit, whatever was recorded there; also by effects that look around."""
    camera = record(count=2)
    encoder = camera.encoder({"black_level": {"offset": 0.01}, "veiling_glare": {"fraction": 0.1}})
    before = Predictor(camera.measurement, default_decoder(5), folds=1).predictions(encoder)
    place = before[0].isfinite()
    changed = camera.measurement.clone()
    changed[0, place] = 0.9 * torch.rand(int(place.sum()), generator=torch.Generator().manual_seed(1))
    after = Predictor(changed, default_decoder(5), folds=1).predictions(encoder)
    assert torch.equal(before[0, place], after[0, place])
    assert 0.04 < float(place.float().mean()) < 0.06


HYPOTHESES = {
    "nothing": {},
    "mask_shift": {"mask_shift": {"dx": 0.6, "dy": -0.4}},
    "mask_blur": {"mask_blur": {"sigma": 0.7}},
    "mask_contrast": {"mask_contrast": {"leak": 0.2}},
    "black_level": {"black_level": {"offset": 0.05}},
}


@pytest.mark.parametrize("truth", ["nothing", "mask_blur"])
def test_the_right_camera_predicts_best(truth: str, record: Record) -> None:
    camera = record(HYPOTHESES[truth])
    predictor = Predictor(camera.measurement, folds=2)
    errors = {name: predictor.errors(camera.encoder(effects)) for name, effects in HYPOTHESES.items()}
    assert min(errors, key=lambda name: errors[name].prediction_error) == truth
    assert 0 < errors[truth].prediction_error < 1
    for name, other in errors.items():
        if name == truth:
            continue
        for_it, against = compare_errors(other, errors[truth]), compare_errors(errors[truth], other)
        assert for_it.fall > 0 > against.fall and for_it.p_value < 0.05 < against.p_value, name
        assert for_it.agree >= against.agree and for_it.snapshots == 3


def test_another_model_based_decoder(record: Record) -> None:
    camera = record(HYPOTHESES["mask_shift"])
    predictor = Predictor(camera.measurement[:1], Linear(mixture=False), folds=1)
    ideal, right = (predictor.errors(camera.encoder(HYPOTHESES[name])) for name in ("nothing", "mask_shift"))
    assert right.prediction_error < 0.9 * ideal.prediction_error


def test_brightness_does_not_matter(record: Record) -> None:
    """A scene half as bright is predicted as well: nothing depends on the aperture or on the exposure."""
    camera = record()
    encoder = camera.encoder({})
    errors = [Predictor(scale * camera.measurement, folds=1).errors(encoder) for scale in (0.5, 0.25)]
    assert errors[0].prediction_error == pytest.approx(errors[1].prediction_error, rel=1e-3)


def test_pixels_at_full_scale_neither_judge_nor_mislead(record: Record) -> None:
    camera = record()
    measurement = camera.measurement.clone()
    measurement[1, 10:20, 10:20] = 1.0
    errors = Predictor(measurement, default_decoder(5), folds=1).errors(camera.encoder({}))
    assert errors.squared[1, 10:20, 10:20].isnan().all() and errors.squared[0, 10:20, 10:20].isfinite().any()
    assert errors.squared.isfinite().any((1, 2)).all()


@pytest.mark.parametrize(("value", "word"), [(1.0, "saturated"), (0.25, "the same at every pixel")])
def test_nothing_to_predict(value: float, word: str) -> None:
    with pytest.raises(BadInput, match=word):
        Predictor(torch.full((1, 32, 32), value))


def test_a_comparison_of_equals_says_nothing(record: Record) -> None:
    camera = record()
    errors = Predictor(camera.measurement, default_decoder(5), folds=1).errors(camera.encoder({}))
    same = compare_errors(errors, errors)
    assert same.p_value == 1 and same.fall == 0 and same.agree == 0
    few = compare_errors(errors.take([1]), errors.take([1]))
    assert few.snapshots == 1 and few.before == pytest.approx(errors.by_capture[1])


def test_a_blur_of_the_lens_acts_on_the_mask(record: Record) -> None:
    camera = record()
    blurred = effective_mask(camera.encoder({"optical_blur": {"sigma": 0.8}}))
    expected = effective_mask(camera.encoder({"mask_blur": {"sigma": 0.8}}))
    inside = (slice(None), slice(6, -6), slice(6, -6))
    assert torch.allclose(blurred[inside], expected[inside], atol=0.03)


def test_the_window_has_the_texture() -> None:
    image = torch.zeros(1, 96, 96)
    image[0, 50:80, 8:40] = torch.rand(30, 32, generator=torch.Generator().manual_seed(0))
    rows, columns = textured_window(image, 32)
    assert abs(rows.start - 49) <= 6 and abs(columns.start - 8) <= 6 and rows.stop - rows.start == 32
    assert textured_window(image, 200) == (slice(0, 96), slice(0, 96))
