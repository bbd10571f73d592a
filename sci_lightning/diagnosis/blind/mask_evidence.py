"""What snapshots of unknown scenes say for the mask itself: a camera without any mask is the control."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MaskEvidence:
    """What the snapshots say for the mask: the likeliest camera is compared with one without any mask.

    Attributes:
        gained: nats per pixel that the likeliest camera gains over the ideal one.
        gained_without: the same of a camera whose mask is the same everywhere.
        needed: nats per pixel that a camera without any mask must lack, as the prior of the scenes is not better known.
        distinct: whether the snapshots distinguish the likeliest camera from that.
    """

    gained: float
    gained_without: float
    needed: float
    distinct: bool

    @property
    def visible(self) -> bool:
        """Whether the snapshots are likelier with the mask than with none."""
        return self.gained > self.gained_without

    @property
    def decides(self) -> bool:
        """Whether a camera without any mask does not explain nearly as much as the likeliest one."""
        return self.distinct and self.gained - self.gained_without >= self.needed
