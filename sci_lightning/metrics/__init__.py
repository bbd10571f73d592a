"""How good a reconstruction is: one metric a file, function and class of the same name."""

from sci_lightning.metrics.psnr import PSNR, psnr
from sci_lightning.metrics.ssim import SSIM, ssim

__all__ = ["PSNR", "SSIM", "psnr", "ssim"]
