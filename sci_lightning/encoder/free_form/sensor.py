"""Free-form deviations of the sensor: gains, offsets and responses of pixels, columns and rows."""

from __future__ import annotations

from sci_lightning.encoder.effects.map_effect import FixedPatternGain, FixedPatternOffset
from sci_lightning.encoder.effects.parameter import Parameter
from sci_lightning.encoder.effects.stage import SensorEffect
from sci_lightning.encoder.free_form.free_form import FreeForm, piecewise_linear
from sci_lightning.encoder.signal import Signal


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

    @classmethod
    def numbers(cls, captures: int, frames: int) -> int:
        return 13

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
