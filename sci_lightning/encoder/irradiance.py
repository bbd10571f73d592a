"""Videos that an encoder refuses: values that are no irradiance, and shapes that do not fit the mask."""

from __future__ import annotations

import math

import torch

from sci_lightning.errors import BadInput
from sci_lightning.plain_text import with_article

DARKEST = -0.2
"""Irradiance that is refused: resampling overshoots a little below 0, a video minus its mean falls further."""

BRIGHTEST = 16.0
"""Irradiance beyond which a video must be one of gray levels: four stops over white."""


def check_irradiance(video: torch.Tensor) -> None:
    """Refuse a video whose values cannot be irradiance, of which 1.0 fills the sensor.

    Args:
        video: any shape.

    Raises:
        BadInput: no tensor, integers, or floating values that are NaN, negative or reach as far as gray levels do.
    """
    if not isinstance(video, torch.Tensor):
        raise BadInput(f"the video is {with_article(type(video).__name__)}, not a tensor; give torch.as_tensor(video)")
    if not video.is_floating_point():
        levels = {torch.uint8: 255, torch.uint16: 65535, torch.int16: 65535}.get(video.dtype)
        by = f"video.float() / {levels}" if levels else "video.float(), over the value of white"
        raise BadInput(f"the video is {video.dtype}, but irradiance is floating, 1.0 being white; give {by}")
    least, most = (float(value) for value in torch.aminmax(video.detach())) if video.numel() else (0.0, 0.0)
    if not (math.isfinite(least) and math.isfinite(most)):
        raise BadInput("the video holds NaN or infinite values; irradiance is finite, 1.0 being white")
    if least < DARKEST:
        raise BadInput(f"the video's values reach down to {least:.3g}, but irradiance is not negative; 0 is dark")
    if most > BRIGHTEST or (most > 1.5 and bool((video == video.round()).all())):
        levels = 255 if most <= 255 else 2 ** math.ceil(math.log2(most + 1)) - 1
        raise BadInput(
            f"the video's values reach {most:.4g}, but 1.0 is white and fills the sensor: gray levels? Give "
            f"video / {levels}"
        )


def misfit(video: tuple[int, ...], mask: tuple[int, ...]) -> BadInput:
    """Return what is wrong with a video of a shape, before a mask ``(T, H, W)`` in pixels, and what would be right."""
    if video == mask:
        advice = "the axis N of videos is missing: give video[None]"
    elif len(video) == 4 and (video[3], *video[1:3]) == mask:
        advice = "time comes second: give video.permute(0, 3, 1, 2)"
    elif len(video) == 4 and (video[0], *video[2:]) == mask:
        advice = "N and T are exchanged: give video.transpose(0, 1)"
    elif len(video) == 5 and video[1] == 3:
        advice = "in colour it needs a sensor with filters, encoder/sensor=bayer"
    elif len(video) == 5 and 1 in video:
        advice = "one axis too many: give a gray video without an axis of colours"
    else:
        advice = "T, H and W must agree: crop the video, or make a mask of its size (frames= and size= of a command)"
    return BadInput(f"the video is {video} (N, T, H, W), the mask {mask} (T, H, W): {advice}")
