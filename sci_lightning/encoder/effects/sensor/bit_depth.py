"""Bit depth: the converter has fewer effective bits than nominal ones."""

from __future__ import annotations

from sci_lightning.encoder.effects.parameter import Parameter, Value
from sci_lightning.encoder.effects.stage import SensorEffect


class BitDepth(SensorEffect):
    """Only ``2 ** bits`` codes occur, spread evenly from 0 to full scale.

    Args:
        bits: effective bits, 1 to 16; no effect where the converter has no more than that.
    """

    name = "bit_depth"
    rank = 60
    about = {"bits": Parameter("bits", 16, choices=tuple(range(1, 17)))}
    sentence = "only {bits} bits of the converter count"
    bits: int

    @classmethod
    def starts(cls, frames: int, size: tuple[int, int], bit_depth: int) -> list[dict[str, Value]]:
        return [{"bits": bits} for bits in range(1, bit_depth)]

    def effective_bits(self, bits: int) -> int:
        return min(self.bits, bits)
