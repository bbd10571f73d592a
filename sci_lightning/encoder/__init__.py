"""From light to numbers: masks, effects, sensors, and the encoder that joins them. Plain torch modules."""

from sci_lightning.encoder.encoder import Encoder
from sci_lightning.encoder.mask.structure import structure

__all__ = ["Encoder", "structure"]
