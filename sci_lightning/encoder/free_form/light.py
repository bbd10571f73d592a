"""Free-form deviations of the light: how much is collected, what the lens makes of it, and how the sensor responds."""

from __future__ import annotations

from dataclasses import replace

import torch

from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects.map_effect import FixedPatternGain, FixedPatternOffset
from sci_lightning.encoder.effects.parameter import Parameter, Value
from sci_lightning.encoder.effects.stage import ExposureEffect, OpticsEffect, SensorEffect
from sci_lightning.encoder.exposure import Exposure
from sci_lightning.encoder.free_form.free_form import FreeForm, NeighbourTaps, legendre, piecewise_linear, polynomials
from sci_lightning.encoder.signal import Signal


class SlotWeights(FreeForm, ExposureEffect):
    """Slot t collects 1 + c_t times its nominal light.

    Args:
        count: T.
        values: c.
    """

    name = "slot_weights"
    rank = 33
    where = "slots of one exposure collect more or less light than others"
    number = Parameter("1", 0.0, -1, 4, step=0.005)

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return frames

    def expose(self, exposure: Exposure) -> Exposure:
        weight = 1 + self.coefficients.to(exposure.power)
        return replace(
            exposure,
            power=exposure.power * weight.repeat(1 + len(exposure.power) // self.count)[: len(exposure.power), None],
        )


class SourcePower(FreeForm, ExposureEffect):
    """The light of a capture is multiplied by 1 + a polynomial of its position in the file.

    This is a property of the captures and not of the camera.

    Args:
        count: 3, for Legendre polynomials of degree 1 to 3.
        values: coefficients of the polynomials.
    """

    name = "source_power"
    rank = 34
    where = "the light drifts from capture to capture"
    number = Parameter("1", 0.0, -1, 4, step=0.005)
    of_captures = True

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return min(3, captures - 1)

    def form(self, signal: Signal) -> Signal:
        if signal.position is None:
            return signal
        moment = 2 * signal.position.to(signal.mean) / max(int(signal.position.max()), 1) - 1  # from -1 to 1
        basis = torch.stack(legendre(moment, 3)[1 : self.count + 1])
        return signal.with_mean(signal.mean * (1 + self.coefficients.to(signal.mean) @ basis)[:, None, None])


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
"""Pixels within which a displaced copy cannot be distinguished from a blur."""


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
    count = 3

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
    pixel = torch.arange(length).to(distance)
    return (1 - (pixel[:, None] - pixel - distance).abs()).clamp(min=0)


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
    count = (SHADING_DEGREE + 1) * (SHADING_DEGREE + 2) // 2 - 1

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
    count = (SHADING_DEGREE + 1) * (SHADING_DEGREE + 2) // 2

    def form(self, signal: Signal) -> Signal:
        signal = signal.pooled()
        return signal.with_mean(signal.mean + signal.exposure * smooth(signal, self.coefficients, SHADING_DEGREE, True))


class ColumnGain(FixedPatternGain):
    """The signal of every column is multiplied by 1 + a number of its own.

    Args:
        std: standard deviation of the numbers, 0 to 1.
        size, file, seed: see :class:`MapEffect`.
    """

    name = "column_gain"
    rank = 51.5
    where = "columns differ in their gain"
    about = {"std": Parameter("1", 0.0, 0, 1, step=0.002, starts=(0.01,))}
    map_kind = "column"


class RowGain(FixedPatternGain):
    """The signal of every row is multiplied by 1 + a number of its own.

    Args:
        std: standard deviation of the numbers, 0 to 1.
        size, file, seed: see :class:`MapEffect`.
    """

    name = "row_gain"
    rank = 51.6
    where = "rows differ in their gain"
    about = {"std": Parameter("1", 0.0, 0, 1, step=0.002, starts=(0.01,))}
    map_kind = "row"


class ResponseCurve(FreeForm, SensorEffect):
    """The signal plus a curve that connects the numbers, at equidistant levels from 0 to 1.

    Args:
        count: number of levels.
        values: the curve at these levels, fraction of full scale.
    """

    name = "response_curve"
    rank = 55.5
    where = "the response to light is curved"
    number = Parameter("1", 0.0, -1, 1, step=0.002)
    count = 13

    def respond(self, signal: Signal) -> Signal:
        return signal.with_mean(signal.mean + piecewise_linear(signal.mean, self.coefficients.to(signal.mean)))


class CarryOver(FreeForm, SensorEffect):
    """A part c0 of what was recorded is added to the next capture of the file.

    Args:
        count: 1.
        values: c0.
    """

    name = "carry_over"
    rank = 55.7
    where = "a part of each capture is left over in the next"
    number = Parameter("1", 0.0, -1, 1, step=0.001)
    of_captures = True

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return min(1, captures - 1)

    def respond(self, signal: Signal) -> Signal:
        if signal.recorded_before is None:
            return signal
        return signal.with_mean(signal.mean + self.coefficients.to(signal.mean) * signal.recorded_before)


class OffsetMap(FixedPatternOffset):
    """Every pixel's signal plus a number of its own, the same in every capture.

    Args:
        std: standard deviation of the numbers, fraction of full scale, 0 to 1.
        size, file, seed: see :class:`MapEffect`.
    """

    name = "offset_map"
    rank = 57.5
    where = "pixels differ in their offset"
    about = {"std": Parameter("full scale", 0.0, 0, 1, step=0.0005, starts=(0.005,))}
    map_kind = "pixel"
