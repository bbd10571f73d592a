"""Free-form deviations of the optics: what happens to the modulated image."""

from __future__ import annotations

import torch

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.parameter import Parameter, Value
from sci_lightning.encoder.effects.stage import OpticsEffect
from sci_lightning.encoder.free_form.free_form import FreeForm, NeighbourTaps, polynomials
from sci_lightning.encoder.signal import Signal


class ImageTaps(NeighbourTaps, OpticsEffect):
    """The light of every pixel also falls on its neighbours. See :class:`NeighbourTaps`."""

    name = "image_taps"
    rank = 43
    where = "the image is smeared"

    def form(self, signal: Signal) -> Signal:
        signal = signal.pooled()
        return signal.with_mean(self.smear(signal.mean))


PART = 0.02
"""The part of the light in the second image with which displacements are tried."""
LARGEST_PART = 0.5
PEAKS = 4
"""Displacements that are tried."""
NEAR = 2.0
"""Pixels within which a displaced copy cannot be told from a blur."""


class Ghost(FreeForm, OpticsEffect):
    """A part c0 of the light forms a second image, displaced by (c1, c2) pixels, +x right and +y down.

    Args:
        count: 3.
        values: part, dx, dy.
    """

    name = "ghost"
    rank = 44
    where = "a second image lies beside the first"
    number = Parameter("part; pixel; pixel", 0.0, -1024, 1024, step=0.01)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return 3

    @classmethod
    def proposals(
        cls, light: torch.Tensor, gradient: torch.Tensor, curvature: torch.Tensor
    ) -> list[list[dict[str, Value]]]:
        """Return settings around the displacements at which a copy of the image would explain most.

        To second order, a faint copy displaced by d gains (sum g l(.-d))^2 / (2 sum w l(.-d)^2) in log-likelihood, with
        the light l, the gradient g and the curvature w: two correlations give the gain for all displacements at once.
        """
        height, width = light.shape[-2:]
        padded = (2 * height, 2 * width)

        def spectrum(field: torch.Tensor) -> torch.Tensor:
            return torch.fft.rfft2(field, s=padded)

        slope = torch.fft.irfft2((spectrum(gradient) * spectrum(light).conj()).sum(0), s=padded)
        weight = torch.fft.irfft2((spectrum(curvature) * spectrum(light.square()).conj()).sum(0), s=padded)
        farthest = max(3, min(height, width) // 2)
        gain = slope.clamp(min=0).square() / weight.clamp(min=float(weight.max()) * 1e-2)
        rows = torch.fft.fftfreq(padded[0], 1 / padded[0])[:, None]
        columns = torch.fft.fftfreq(padded[1], 1 / padded[1])[None]
        near = rows.square() + columns.square() < NEAR**2
        gain = torch.where(near | (rows.abs() > farthest) | (columns.abs() > farthest), 0.0, gain)
        groups: list[list[dict[str, Value]]] = []
        for index in gain.flatten().topk(PEAKS).indices.tolist():
            dy, dx = float(rows[index // padded[1], 0]), float(columns[0, index % padded[1]])
            # linear interpolation has a kink at whole pixels, from which no derivative leads away
            sides = [(right, down) for right in (-0.4, 0.4) for down in (-0.4, 0.4)]
            groups.append([{"c0": PART, "c1": dx + right, "c2": dy + down} for right, down in sides])
        return groups

    @classmethod
    def scaled(cls, setting: dict[str, Value], factor: float) -> dict[str, Value]:
        return {**setting, "c0": min(PART * factor, LARGEST_PART)}

    def border(self, size: tuple[int, int]) -> Border:
        part, dx, dy = self.coefficients.tolist()
        return Border.of_displacement(dx, dy) if part else Border()

    def form(self, signal: Signal) -> Signal:
        signal = signal.pooled()
        part, dx, dy = self.coefficients.to(signal.mean)
        height, width = signal.mean.shape[-2:]
        ghost = _moved(height, dy) @ signal.mean @ _moved(width, dx).T
        return signal.with_mean((1 - part) * signal.mean + part * ghost)


def _moved(length: int, distance: torch.Tensor) -> torch.Tensor:
    """Return the matrix ``(length, length)`` that displaces along one axis, by linear interpolation, dark beyond."""
    place = torch.arange(length).to(distance)
    return (1 - (place[:, None] - place - distance).abs()).clamp(min=0)


SHADING_DEGREE = 4


class Shading(FreeForm, OpticsEffect):
    """The light is multiplied by 1 + a polynomial of the position.

    Args:
        count: 14 for polynomials up to degree 4 without the constant.
        values: coefficients of the products of Legendre polynomials, by degree.
    """

    name = "shading"
    rank = 45
    where = "parts of the image receive less light than others"
    number = Parameter("1", 0.0, -4, 4, step=0.005)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return (SHADING_DEGREE + 1) * (SHADING_DEGREE + 2) // 2 - 1

    def form(self, signal: Signal) -> Signal:
        signal = signal.pooled()
        return signal.with_mean(signal.mean * (1 + smooth(signal, self.coefficients, SHADING_DEGREE, constant=False)))


def smooth(signal: Signal, coefficients: torch.Tensor, degree: int, constant: bool) -> torch.Tensor:
    """Return a polynomial of the position in the field, ``(H, W)``."""
    y, x = signal.coordinates()
    basis = polynomials(y * (2 / signal.field[0]), x * (2 / signal.field[1]), degree)
    return torch.einsum("k,khw->hw", coefficients.to(signal.mean), basis if constant else basis[1:])


class StrayLight(FreeForm, OpticsEffect):
    """The light plus a polynomial of the position that grows with the integration time, in dark captures as well.

    Args:
        count: 15 for polynomials up to degree 4.
        values: coefficients of the products of Legendre polynomials, by degree, fraction of full scale.
    """

    name = "stray_light"
    rank = 46
    where = "light reaches the sensor that does not come from the scene"
    number = Parameter("1", 0.0, -1, 1, step=0.001)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return (SHADING_DEGREE + 1) * (SHADING_DEGREE + 2) // 2

    def form(self, signal: Signal) -> Signal:
        signal = signal.pooled()
        return signal.with_mean(signal.mean + signal.exposure * smooth(signal, self.coefficients, SHADING_DEGREE, True))
