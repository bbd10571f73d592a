"""Random binary mask in which every pixel is open equally often."""

from __future__ import annotations

from sci_lightning.configuration.bounds import Frames, Pixels, Seed, Share, Size
from sci_lightning.encoder.mask.mask import Mask
from sci_lightning.encoder.mask.structure import uniform
from sci_lightning.errors import BadInput


class RandomOverlap(Mask):
    r"""Every pixel is open in the same number of slots, :math:`k = \mathrm{overlap} \cdot T`, drawn from ``seed``.

    The slots that are open at one pixel overlap on the sensor. ``overlap=1/T`` is a mask without overlap, in which
    every pixel sees one frame; a random binary mask has 1/2 on average.

    Args:
        frames, size, tile, repeat: see :class:`~sci_lightning.encoder.mask.Mask`.
        overlap: part of the slots in which a pixel is open; rounded to whole slots, at least one.
        seed: of the draw.

    Raises:
        BadInput: an overlap of 0.

    Source: the overlapping rate of Li et al., "SCINeRF: Neural radiance fields from a snapshot compressive image",
    CVPR 2024.
    """

    def __init__(
        self,
        frames: Frames,
        size: Size,
        overlap: Share = 0.25,
        tile: Size | None = None,
        seed: Seed = 0,
        repeat: Pixels = 1,
    ) -> None:
        super().__init__(frames, size, tile, repeat)
        if not 0 < overlap <= 1:
            raise BadInput(f"encoder.mask.overlap={overlap}: expected a part of the slots, above 0 and up to 1")
        self.open_slots = max(1, round(overlap * frames))
        rank = uniform(self.pattern_shape, seed).argsort(0).argsort(0)
        self.register_buffer("pattern", (rank < self.open_slots).float())

    @property
    def automatic_aperture(self) -> float:
        """1/k: every pixel is open in k slots."""
        return 1 / self.open_slots
