"""Lightning callbacks of a training: checkpoints, progress, pictures and throughput."""

from sci_lightning.training.callbacks.best_checkpoint import BestCheckpoint
from sci_lightning.training.callbacks.failed_training import FailedTraining
from sci_lightning.training.callbacks.last_checkpoint import LastCheckpoint
from sci_lightning.training.callbacks.pictures import Pictures
from sci_lightning.training.callbacks.progress import Progress
from sci_lightning.training.callbacks.scene_pictures import ScenePictures
from sci_lightning.training.callbacks.throughput import Throughput

__all__ = [
    "BestCheckpoint",
    "FailedTraining",
    "LastCheckpoint",
    "Pictures",
    "Progress",
    "ScenePictures",
    "Throughput",
]
