"""Image taps: the modulated image is smeared by a small free kernel."""

from __future__ import annotations

from sci_lightning.encoder.effects.stage import OpticsEffect
from sci_lightning.encoder.free_form.free_form import NeighbourTaps
from sci_lightning.encoder.signal import Signal


class ImageTaps(NeighbourTaps, OpticsEffect):
    """The light of every pixel also falls on its neighbours. See :class:`NeighbourTaps`."""

    name = "image_taps"
    rank = 43
    where = "the image is smeared"

    def form(self, signal: Signal) -> Signal:
        signal = signal.pooled()
        return signal.with_mean(self.smear(signal.mean))
