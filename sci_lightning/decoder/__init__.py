"""Decoders, one network or algorithm in a file: ``decoder(measurement, mask)`` estimates the video."""

from sci_lightning.decoder.admm import ADMM
from sci_lightning.decoder.admm_net import ADMMNet
from sci_lightning.decoder.birnat import BIRNAT
from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.denoiser.motion_filter import MotionFilter
from sci_lightning.decoder.e2e_cnn import E2ECNN
from sci_lightning.decoder.efficientsci import EfficientSCI
from sci_lightning.decoder.elp_unfolding import ELPUnfolding
from sci_lightning.decoder.gap import GAP
from sci_lightning.decoder.gap_net import GAPNet
from sci_lightning.decoder.linear import Linear
from sci_lightning.decoder.metasci import MetaSCI
from sci_lightning.decoder.res2former import Res2former
from sci_lightning.decoder.revsci import RevSCI
from sci_lightning.decoder.sci3d import SCI3D
from sci_lightning.decoder.stformer import STFormer
from sci_lightning.decoder.universal import Universal

__all__ = [
    "ADMM",
    "BIRNAT",
    "E2ECNN",
    "GAP",
    "SCI3D",
    "ADMMNet",
    "Decoder",
    "ELPUnfolding",
    "EfficientSCI",
    "GAPNet",
    "Linear",
    "MetaSCI",
    "MotionFilter",
    "Res2former",
    "RevSCI",
    "STFormer",
    "Universal",
]
