"""Random binary mask (RBw)."""

from __future__ import annotations

from sci_lightning.configuration.bounds import Bits, Frames, Pixels, Seed, Size
from sci_lightning.encoder.mask.mask import Mask
from sci_lightning.encoder.mask.structure import check_binary, uniform


class RandomBinary(Mask):
    """Every pixel of every slot is open (1) or shut (0) with probability 1/2, drawn from ``seed``.

    Args:
        frames, size, tile, repeat: see :class:`~sci_lightning.encoder.mask.Mask`.
        seed: seed of the Bernoulli(1/2) draw.
        bits: mask bit depth, always 1: it is there so that a sweep over bits can name every mask.

    Raises:
        BadInput: ``bits`` other than 1.
    """

    def __init__(
        self, frames: Frames, size: Size, tile: Size | None = None, seed: Seed = 0, bits: Bits = 1, repeat: Pixels = 1
    ) -> None:
        super().__init__(frames, size, tile, repeat)
        self.bits = check_binary(bits)
        self.register_buffer("pattern", (uniform(self.pattern_shape, seed) < 0.5).float())

    @property
    def automatic_aperture(self) -> float:
        """2/T: half of the T slots are open on average."""
        return 2 / self.frames
