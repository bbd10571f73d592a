"""How good a reconstruction is: one metric a file or folder, function and class of the same name."""

from sci_lightning.metrics.hdrvdp2 import HDRVDP2, hdrvdp2_q
from sci_lightning.metrics.psnr import PSNR, psnr
from sci_lightning.metrics.ssim import SSIM, ssim

__all__ = ["HDRVDP2", "PSNR", "SSIM", "hdrvdp2_q", "psnr", "ssim"]
