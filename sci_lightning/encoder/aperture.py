"""The aperture: the scale of the light before the sensor, and whether decoders know it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch

from sci_lightning.encoder.mask import Mask
from sci_lightning.errors import BadInput

PER_SNAPSHOT = "per_snapshot"
PER_SLOT = "1/T"
WORDS = ("auto", PER_SLOT, PER_SNAPSHOT)


@dataclass(frozen=True)
class Aperture:
    r"""The scale a of :math:`y = R(a\,\ell)` with the light :math:`\ell = \sum_t M_t \odot x_t`.

    - ``auto``: the mask's own, 2/T for binary masks and 1 for structural ones: white fills the sensor on average.
    - a number.
    - ``1/T``: nothing can overexpose, since white behind a pixel that is open in all slots just fills the sensor.
    - ``per_snapshot``: :math:`a_n = 1 / \max_p \ell_n(p)`, so that the brightest pixel of every snapshot just fills the
      sensor; it counts as one DN at least.

    A decoder divides by a. Where it does not know a, it divides by the automatic aperture instead, as the released code
    of the paper does with real captures behind random masks (it multiplies them by T/2).

    Args:
        setting: a positive number or one of :data:`WORDS`.
        is_known: whether decoders know a.

    Raises:
        BadInput: a setting that is neither.

    Source: "Deep Optics for Video Snapshot Compressive Imaging" (ICCV 2023), Section 5.2, "automatic aperture is
    simulated by scaling before sensor response", which does not say by how much; ``docs/results/aperture.md``.
    """

    setting: float | str = "auto"
    is_known: bool = True

    def __post_init__(self) -> None:
        valid = self.setting in WORDS if isinstance(self.setting, str) else 0 < self.setting < math.inf
        if not valid:
            raise BadInput(
                f"encoder.aperture={self.setting}: expected a positive number, auto, {PER_SLOT} or {PER_SNAPSHOT}"
            )

    @property
    def is_carried(self) -> bool:
        """Whether only the measurement can say what its scale was."""
        return self.setting == PER_SNAPSHOT and self.is_known

    def divisor(self, mask: Mask) -> float:
        """Return the number by which decoders divide.

        Raises:
            BadInput: every snapshot has a number of its own.
        """
        if self.is_carried:
            raise BadInput(
                "encoder.aperture=per_snapshot: every snapshot has a light scale of its own, which this one does not "
                "state: give what the encoder returned, or aperture=NUMBER (auto: white fills the sensor)"
            )
        return self._of(mask) if self.is_known else mask.automatic_aperture

    def scale(self, light: torch.Tensor, mask: Mask, cells: int, dn: float) -> torch.Tensor | float:
        """Return a: a number, or ``(N, 1, 1)``.

        Args:
            light: ``(N, qH, qW)`` on q x q cells per pixel.
            mask: behind which it was collected.
            cells: q.
            dn: one DN as a fraction of full scale.
        """
        if self.setting != PER_SNAPSHOT:
            return self._of(mask)
        pixels = light if cells == 1 else torch.nn.functional.avg_pool2d(light, cells)
        return 1 / pixels.amax((-2, -1), keepdim=True).clamp(min=dn)

    def _of(self, mask: Mask) -> float:
        if isinstance(self.setting, str):
            return 1 / mask.frames if self.setting == PER_SLOT else mask.automatic_aperture
        return float(self.setting)

    def in_words(self, mask: Mask) -> str:
        """Return what one line says of it, such as ``0.25`` or ``per_snapshot, not told``."""
        text = PER_SNAPSHOT if self.setting == PER_SNAPSHOT else f"{self._of(mask):.4g}"
        return text if self.is_known else f"{text}, not told"
