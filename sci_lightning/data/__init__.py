"""Where video comes from: one source a file, all with ``clips()`` to train on and ``scenes()`` to test on."""

from sci_lightning.data.benchmark import Benchmark
from sci_lightning.data.davis import Davis
from sci_lightning.data.folder import Folder
from sci_lightning.data.source import Clips, Scene, Source
from sci_lightning.data.synthetic import Synthetic

__all__ = ["Benchmark", "Clips", "Davis", "Folder", "Scene", "Source", "Synthetic"]
