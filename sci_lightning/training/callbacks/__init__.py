"""Lightning callbacks of a training: checkpoints, progress, pictures and throughput."""

from sci_lightning.training.callbacks.checkpoints import BestCheckpoint, LastCheckpoint
from sci_lightning.training.callbacks.failed_training import FailedTraining
from sci_lightning.training.callbacks.pictures import Pictures, ScenePictures
from sci_lightning.training.callbacks.progress import Progress, Throughput

__all__ = [
    "BestCheckpoint",
    "FailedTraining",
    "LastCheckpoint",
    "Pictures",
    "Progress",
    "ScenePictures",
    "Throughput",
]
