"""What looks on while a system trains."""

from sci_lightning.callbacks.best_checkpoint import BestCheckpoint
from sci_lightning.callbacks.last_checkpoint import LastCheckpoint
from sci_lightning.callbacks.pictures import Pictures
from sci_lightning.callbacks.progress import Progress
from sci_lightning.callbacks.scalar_layout import ScalarLayout
from sci_lightning.callbacks.scene_pictures import ScenePictures
from sci_lightning.callbacks.throughput import Throughput

__all__ = [
    "BestCheckpoint",
    "LastCheckpoint",
    "Pictures",
    "Progress",
    "ScalarLayout",
    "ScenePictures",
    "Throughput",
]
