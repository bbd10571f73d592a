import numpy as np
import pytest
import torch

from sci_lightning.data.augmentation import Augmentation
from sci_lightning.errors import BadInput

OFF = {"max_stride": 1, "reverse": False, "scale": (1, 1), "flip": False, "rotate": False}


def draws(clip, frames=4, crop=(16, 16), count=60, **arguments):
    augmentation = Augmentation(frames, crop, **{**OFF, **arguments})
    return [augmentation(clip, np.random.default_rng(i)) for i in range(count)]


def ramp(axis, frames=20, height=30, width=40):
    """A clip whose value is the position along one axis."""
    position = np.arange((frames, height, width)[axis], dtype=np.uint8)
    return np.broadcast_to(np.expand_dims(position, [a for a in range(3) if a != axis]), (frames, height, width))


def steps(videos, axis):
    """The differences along ``axis`` that occur, in DN."""
    return {int(step) for video in videos for step in (video * 255).round().diff(dim=axis).unique()}


def test_shape_type_and_range(noise):
    for video in draws(noise(), crop=(16, 20), max_stride=3, reverse=True, scale=(0.5, 2.5), flip=True):
        assert video.shape == (4, 16, 20)
        assert video.dtype == torch.float32
        assert video.is_contiguous()
        assert 0 <= video.min() <= video.max() <= 1


def test_with_all_switched_off_it_is_a_plain_crop(noise):
    clip = noise()
    windows = np.lib.stride_tricks.sliding_window_view(clip, (4, 16, 16))
    places = set()
    for video in draws(clip):
        pixels = (video * 255).round().numpy().astype(np.uint8)
        ((*place,),) = np.argwhere((windows[..., 0, 0, 0] == pixels[0, 0, 0]) & (windows == pixels).all((3, 4, 5)))
        places.add(tuple(place))
    assert len(places) > 50
    assert {t for t, _, _ in places} == set(range(9))


def test_the_same_generator_state_gives_the_same_clip(noise):
    first, second = (draws(noise(), scale=(0.5, 2), max_stride=3, flip=True, rotate=True, count=9) for _ in "ab")
    assert all(map(torch.equal, first, second))
    assert not torch.equal(first[0], first[1])


@pytest.mark.parametrize(("frames", "strides"), [(4, {1, 2, 3}), (7, {1, 2, 3}), (8, {1, 2}), (20, {1})])
def test_stride_is_drawn_as_far_as_the_clip_is_long_enough(frames, strides):
    assert steps(draws(ramp(0), frames, max_stride=3), 0) == strides


def test_one_frame_is_enough():
    assert draws(ramp(0, frames=1), frames=1, max_stride=3, reverse=True)[0].shape == (1, 16, 16)


@pytest.mark.parametrize(
    ("axis", "argument"), [(0, {"reverse": True}), (1, {"flip": True}), (2, {"flip": True}), (1, {"rotate": True})]
)
def test_each_axis_is_played_both_ways(axis, argument):
    assert {-1, 1} <= steps(draws(ramp(axis), **argument), axis)
    assert steps(draws(ramp(axis)), axis) == {1}


def test_rotation_swaps_the_axes_of_square_crops_only():
    assert 0 in steps(draws(ramp(1), rotate=True), 1)
    assert steps(draws(ramp(1), crop=(16, 20), rotate=True), 1) == {1}


def test_scale_resizes_as_far_as_the_clip_is_large_enough():
    slopes = [(video[0, 0].diff() * 255).median().item() for video in draws(ramp(2), scale=(0.5, 9))]
    assert 0.5 - 1e-3 < min(slopes) < 0.7
    assert 1.6 < max(slopes) < 30 / 16 + 1e-3  # the clip is 30 pixels high


def test_resizing_is_antialiased():
    stripes = np.broadcast_to(np.tile(np.array([0, 255], np.uint8), 32), (4, 64, 64))
    (video,) = draws(stripes, scale=(4, 4), count=1)
    assert (video - 0.5).abs().max() < 0.05


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"frames": 0}, "frames=0, crop=.*at least 1"),
        ({"crop": (0, 8)}, r"crop=\(0, 8\).*at least 1"),
        ({"max_stride": 0}, "max_stride=0: must be at least 1"),
        ({"scale": (0, 1)}, "scale=.*rising positive"),
        ({"scale": (2, 1)}, "scale=.*rising positive"),
    ],
)
def test_arguments_out_of_range_are_refused(arguments, message):
    with pytest.raises(BadInput, match=message):
        Augmentation(**{"frames": 4, "crop": (16, 16), **arguments})


def test_clips_too_short_or_too_small_are_named():
    augmentation = Augmentation(8, (32, 40), scale=(0.5, 2))
    augmentation.check((8, 16, 20), "just enough")
    with pytest.raises(BadInput, match=r"a clip: has 7 frames; .* 8"):
        augmentation.check((7, 16, 20), "a clip")
    with pytest.raises(BadInput, match=r"a clip: has 16 x 19 .* 16 x 20"):
        augmentation.check((8, 16, 19), "a clip")


def test_the_smallest_clip_that_passes_the_check_can_be_drawn_from(noise):
    augmentation = Augmentation(8, (32, 40), scale=(0.5, 2))
    for i in range(9):
        assert augmentation(noise(8, 16, 20), np.random.default_rng(i)).shape == (8, 32, 40)
