"""Sources of video, one in a file: ``clips()`` returns clips to train on, ``scenes()`` returns scenes to test on."""

from sci_lightning.data.davis import Davis
from sci_lightning.data.folder import Folder
from sci_lightning.data.six_scenes import SixScenes
from sci_lightning.data.source import Clips, Scene, Source
from sci_lightning.data.synthetic import Synthetic

__all__ = ["Clips", "Davis", "Folder", "Scene", "SixScenes", "Source", "Synthetic"]
