"""What looks on while a system trains."""

from sci_lightning.callbacks.pictures import Pictures
from sci_lightning.callbacks.progress import Progress
from sci_lightning.callbacks.throughput import Throughput

__all__ = ["Pictures", "Progress", "Throughput"]
