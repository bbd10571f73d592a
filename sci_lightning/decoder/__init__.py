"""Numbers to video: one network or algorithm a file, all called as ``decoder(measurement, mask)``."""

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.e2e_cnn import E2ECNN
from sci_lightning.decoder.res2former import Res2former

__all__ = ["E2ECNN", "Decoder", "Res2former"]
