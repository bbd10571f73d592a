"""The Q-Score: how visible the differences between two images are to the eye, as HDR-VDP-2 predicts it.

Versions of HDR-VDP-2 differ; this is Q of version 2.2.2, of every frame by itself, in a stated convention (display
encoding, pixels per degree). quality.py calls the stages from light to the score: eye.py, steerable_pyramid.py, and
the masking and pooling of its own.

R. Mantiuk, K. J. Kim, A. G. Rempel, W. Heidrich: HDR-VDP-2, ACM Transactions on Graphics 30(4), 2011.
M. Narwaria, R. K. Mantiuk, M. Perreira Da Silva, P. Le Callet: HDR-VDP-2.2, J. Electronic Imaging 24(1), 2015.
"""

from sci_lightning.metrics.hdrvdp2.quality import HDRVDP2, hdrvdp2_q

__all__ = ["HDRVDP2", "hdrvdp2_q"]
