"""Denoisers, the priors of iterative decoders, one in a file: ``denoiser(video, strength)``."""

from sci_lightning.decoder.denoiser.denoiser import Denoiser
from sci_lightning.decoder.denoiser.fastdvdnet import FastDVDnet
from sci_lightning.decoder.denoiser.ffdnet import FFDNet
from sci_lightning.decoder.denoiser.total_variation import TotalVariation
from sci_lightning.decoder.denoiser.wnnm import WNNM

__all__ = ["WNNM", "Denoiser", "FFDNet", "FastDVDnet", "TotalVariation"]
