"""Masks: transmittance ``(T, H, W)`` in [0, 1], one kind per file."""

from sci_lightning.encoder.mask.design import MaskDesign, design_binary, design_structural
from sci_lightning.encoder.mask.learned_binary import LearnedBinary
from sci_lightning.encoder.mask.learned_index import LearnedIndex
from sci_lightning.encoder.mask.learned_structural import LearnedStructural
from sci_lightning.encoder.mask.mask import Mask
from sci_lightning.encoder.mask.measured import Measured, read_mask
from sci_lightning.encoder.mask.published import published_mask
from sci_lightning.encoder.mask.random_binary import RandomBinary
from sci_lightning.encoder.mask.random_overlap import RandomOverlap
from sci_lightning.encoder.mask.random_structural import RandomStructural
from sci_lightning.encoder.mask.shifting import Shifting, moved_pattern

__all__ = [
    "LearnedBinary",
    "LearnedIndex",
    "LearnedStructural",
    "Mask",
    "MaskDesign",
    "Measured",
    "RandomBinary",
    "RandomOverlap",
    "RandomStructural",
    "Shifting",
    "design_binary",
    "design_structural",
    "moved_pattern",
    "published_mask",
    "read_mask",
]
