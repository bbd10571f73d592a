"""The Q-Score: what the eye would make of the differences between two images, as HDR-VDP-2 predicts it.

A version of the program returns one Q; this is 2.2.2's, in a stated convention (display encoding, pixels per degree),
of every frame by itself. From light to the score, one stage a file: display, optics, photoreceptors,
steerable_pyramid, contrast_sensitivity, masking, pooling; quality.py goes through them.

R. Mantiuk, K. J. Kim, A. G. Rempel, W. Heidrich: HDR-VDP-2, ACM Transactions on Graphics 30(4), 2011.
M. Narwaria, R. K. Mantiuk, M. Perreira Da Silva, P. Le Callet: HDR-VDP-2.2, J. Electronic Imaging 24(1), 2015.
"""

from sci_lightning.metrics.hdrvdp2.metric import HDRVDP2
from sci_lightning.metrics.hdrvdp2.quality import hdrvdp2_q

__all__ = ["HDRVDP2", "hdrvdp2_q"]
