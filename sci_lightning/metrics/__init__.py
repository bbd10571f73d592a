"""Metrics of reconstructions, one in a file or folder, each a function and a torchmetrics class of the same name."""

from sci_lightning.metrics.hdrvdp2 import HDRVDP2, hdrvdp2_q
from sci_lightning.metrics.psnr import PSNR, psnr
from sci_lightning.metrics.ssim import SSIM, ssim

__all__ = ["HDRVDP2", "PSNR", "SSIM", "hdrvdp2_q", "psnr", "ssim"]
