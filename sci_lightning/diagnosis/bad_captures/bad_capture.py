"""One capture that does not fit the others, as reports name it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

Role = Literal["fits and choices", "verification"]
"""What a capture would have been used for: see :mod:`~sci_lightning.diagnosis.fit.verification`."""


@dataclass(frozen=True)
class BadCapture:
    """A capture that contradicts all others, and is therefore left out.

    Attributes:
        number: of the capture in the file, from 0.
        kind: of the capture by its label.
        role: what it would have been used for.
        chi2: mean square of its residuals, clipped, under the model of the other captures; 1 for a capture that fits.
        others_chi2: the largest such number of all other captures.
        appearance: what it looks like, a clause such as "its sequence looks like that of capture 12".
    """

    number: int
    kind: str
    role: Role
    chi2: float
    others_chi2: float
    appearance: str

    @property
    def sentence(self) -> str:
        """What a report says about it."""
        role = ", kept for verification" if self.role == "verification" else ""
        return f"capture {self.number} ({self.kind}{role}) does not fit the others: {self.appearance}"

    def describe(self) -> dict[str, Any]:
        """Return the capture as it stands in ``report.json``."""
        return {
            "capture": self.number,
            "kind": self.kind,
            "role": self.role,
            "chi2": self.chi2,
            "others_chi2": self.others_chi2,
            "sentence": self.sentence,
        }
