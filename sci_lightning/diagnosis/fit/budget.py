"""The processor time that a diagnosis may take, and what it leaves out when that is used up."""

from __future__ import annotations

import time

SECONDS_PER_PIXEL = 120.0 / (34 * 64 * 64)
"""Default: 120 s for 34 captures of 64 x 64 pixels."""
SEARCH_SHARE = 0.7
"""Part of the budget after which the search begins nothing new; the rest is for errors, tests and the report."""
EXCHANGE_SHARE = 0.8
"""Part of it after which no other effect is tried in place of a named one."""


class Budget:
    """Counts the processor time of this process since it was made.

    Args:
        seconds: that may be used; infinite for no limit.

    Attributes:
        seconds: that may be used.
        not_tried: what was left out for lack of time, in words, in order.
    """

    def __init__(self, seconds: float) -> None:
        self.seconds = seconds
        self.not_tried: list[str] = []
        self._start = time.process_time()

    @property
    def used(self) -> float:
        """Seconds of processor time since the budget was made."""
        return time.process_time() - self._start

    def allows(self, what: str, share: float = SEARCH_SHARE) -> bool:
        """Return whether there is time to begin something; if not, it is noted as not tried.

        Args:
            what: would be begun, in words.
            share: of the budget after which it is not begun.
        """
        if self.used < share * self.seconds:
            return True
        if what not in self.not_tried:
            self.not_tried.append(what)
        return False
