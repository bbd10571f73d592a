"""Synthetic video: pictures that move, turn and occlude each other."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle, islice

import numpy as np
import torch
from torch.nn import functional as F

from sci_lightning.data.photographs import Photograph

MOMENTS = 4
"""Moments within a slot, whose mean is a blurred frame: at most 1.5 pixels apart at the fastest motion."""


@dataclass(frozen=True)
class Motion:
    """A smooth, endless path in the neighbourhood of its centre.

    At time t (frames) the layer's centre is at ``centre + reach * sin(rate * t + phase)`` pixels from the
    middle of the picture, per axis, its angle is ``angle + spin * t`` (radian), and it is
    ``exp(zoom * sin(rate * t))`` times as large as at rest. The peak speed is ``reach * rate``.
    """

    centre: np.ndarray
    reach: np.ndarray
    phase: np.ndarray
    rate: float
    angle: float
    spin: float
    zoom: float

    @classmethod
    def draw(
        cls,
        random: np.random.Generator,
        centre: np.ndarray,
        *,
        reach: float,
        speed: float,
        tilt: float,
        spin: float,
    ) -> Motion:
        """Draw a random motion within ``reach`` (pixels), at up to ``speed`` (pixels per frame).

        The layer starts turned by up to ``tilt`` (radian) and turns by up to ``spin`` (radian per frame).
        """
        return cls(
            centre=centre,
            reach=reach * random.uniform(0.3, 1, 2),
            phase=random.uniform(0, 2 * math.pi, 2),
            rate=speed / reach,
            angle=random.uniform(-tilt, tilt),
            spin=random.uniform(-spin, spin),
            zoom=random.uniform(0, 0.15),
        )

    def to_layer(self, times: torch.Tensor) -> torch.Tensor:
        """Return maps (T, 2, 3) from pixels of the picture to pixels of the layer, both counted from the middle."""
        centre, reach, phase = map(torch.from_numpy, (self.centre, self.reach, self.phase))
        place = centre + reach * torch.sin(self.rate * times[:, None] + phase)
        angle = self.angle + self.spin * times
        size = torch.exp(self.zoom * torch.sin(self.rate * times))
        cos, sin = torch.cos(angle) / size, torch.sin(angle) / size
        turn = torch.stack((cos, sin, -sin, cos), 1).reshape(-1, 2, 2)
        return torch.cat((turn, -turn @ place[:, :, None]), 2)


@dataclass(frozen=True)
class Layer:
    """A texture and its motion.

    Attributes:
        texture: (1, H, W) luma, or (2, H, W) luma times opacity, and opacity.
        step: pixels of the texture per pixel of the picture, at rest.
        motion: the path of the layer.
    """

    texture: torch.Tensor
    step: float
    motion: Motion


class MovingScene:
    """A panning background and one to four soft-edged objects in front of it, each with a motion of its own.

    All random choices are made when the scene is built; rendering is deterministic.

    Args:
        photographs: that of the background, then those from which objects are cut in turn; two or more.
        random: source of all random choices.
        size: ``(h, w)`` in pixels of the rendered frames.
        blurred: whether frames are blurred by the motion within a part of their slots, uniform in [0, 1], during which
            the shutter is open; else each is a moment.
    """

    def __init__(
        self,
        photographs: Sequence[Photograph],
        random: np.random.Generator,
        size: Sequence[int],
        blurred: bool = False,
    ) -> None:
        self.size = tuple(size)
        self._background = self._draw_background(photographs[0], random)
        count = int(random.integers(1, 4, endpoint=True))
        self._objects = [self._draw_object(p, random) for p in islice(cycle(photographs[1:]), count)]
        self._moments = [0.0]
        if blurred:
            opening = random.uniform(0, 1)
            self._moments = [opening * part / MOMENTS for part in range(MOMENTS)]

    def render(self, frames: int) -> torch.Tensor:
        """Return the video, float32 ``(frames, h, w)`` in [0, 1]."""
        times = torch.arange(frames, dtype=torch.float64)
        return torch.stack([self._render_at(times + moment) for moment in self._moments]).mean(0)

    def _render_at(self, times: torch.Tensor) -> torch.Tensor:
        video = self._look_at(self._background, times, "reflection")[:, 0]
        for layer in self._objects:
            light, opacity = self._look_at(layer, times, "zeros").unbind(1)
            video = video.mul_(1 - opacity).add_(light)
        return video.clamp_(0, 1)

    def _look_at(self, layer: Layer, times: torch.Tensor, padding: str) -> torch.Tensor:
        """Return the layer as the camera sees it, (T, channels, h, w)."""
        height, width = self.size
        rows, columns = layer.texture.shape[1:]
        x = torch.arange(width) - (width - 1) / 2
        y = torch.arange(height) - (height - 1) / 2
        to_layer = layer.motion.to_layer(times) * layer.step
        to_grid = to_layer * torch.tensor([2 / columns, 2 / rows])[:, None]  # -1 to 1 across the layer
        x_step, y_step, origin = to_grid.float()[:, None, None].unbind(-1)
        grid = (x[:, None] * x_step) + (y[:, None, None] * y_step + origin)  # affine_grid is 8 times slower
        texture = layer.texture.expand(len(times), -1, -1, -1)
        return F.grid_sample(texture, grid, padding_mode=padding, align_corners=False)

    def _draw_background(self, photograph: Photograph, random: np.random.Generator) -> Layer:
        window = np.array(self.size)
        picture = np.array(photograph.levels[0].shape)
        fit = 0.9 * float(min(picture / window))  # where the picture is smaller, reflection fills in
        scale = _log_uniform(random, min(0.75, fit), min(2.5, fit))
        texture, step = photograph.level(scale)
        margin = np.maximum(0, picture / scale - window) / 2
        centre = (random.uniform(-1, 1, 2) * margin)[::-1].copy()
        speed = _log_uniform(random, 0.5, 6) * (random.random() < 0.8)  # else the camera stands still
        motion = Motion.draw(random, centre, reach=0.3 * min(window), speed=speed, tilt=0.2, spin=0.005)
        return Layer(_relight(texture, random)[None], step, motion)

    def _draw_object(self, photograph: Photograph, random: np.random.Generator) -> Layer:
        window = np.array(self.size)
        picture, _ = photograph.level(random.uniform(0.75, 2))
        side = min(*picture.shape, max(4, round(min(window) * random.uniform(0.25, 0.7))))
        top, left = (int(random.integers(length - side, endpoint=True)) for length in picture.shape)
        light = _relight(picture[top : top + side, left : left + side], random)
        opacity = _soft_shape(side, random)
        centre = random.uniform(-0.3, 0.3, 2) * window[::-1]
        speed = _log_uniform(random, 0.5, 6)
        motion = Motion.draw(random, centre, reach=0.4 * min(window), speed=speed, tilt=math.pi, spin=0.06)
        return Layer(torch.stack((light * opacity, opacity)), 1.0, motion)


def _log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    return math.exp(random.uniform(math.log(low), math.log(high)))


def _relight(picture: torch.Tensor, random: np.random.Generator) -> torch.Tensor:
    """Change contrast and brightness, so that the same photograph is not always equally bright."""
    return ((picture - 0.5) * random.uniform(0.7, 1.3) + random.uniform(0.35, 0.65)).clamp_(0, 1)


def _soft_shape(side: int, random: np.random.Generator) -> torch.Tensor:
    """Return the opacity (side, side) of a superellipse, between a rhombus and nearly a rectangle."""
    exponent = _log_uniform(random, 1, 10)
    axis = (torch.arange(side) + 0.5) * 2 / side - 1
    x = (axis / random.uniform(0.5, 0.95)).abs() ** exponent
    y = (axis / random.uniform(0.5, 0.95)).abs() ** exponent
    inside = 1 - (x + y[:, None]) ** (1 / exponent)
    return (inside * side / 3).clamp_(0, 1)  # the edge is one to two pixels wide
