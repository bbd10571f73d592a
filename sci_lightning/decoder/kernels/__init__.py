"""Faster ways of computing what the layers, networks and denoisers of this package define.

Layers are written as their papers have them. With the default, ``use("auto")``, they hand the steps that take the time
to the functions in this folder, which return the same values to rounding. ``use("plain")`` turns all of that off, to
check a result or to find out where a difference comes from; on the command line it is ``kernels=plain``.

What is here: convolution over time (:mod:`.convolution3d`, :mod:`.winograd`), attention along time and between
positions (:mod:`.attention`), total variation in place (:mod:`.total_variation`), the layout of features in memory
(:mod:`.layout`), and the sizes of the blocks in which work fits the processor's cache (:mod:`.block_sizes`).
"""

from sci_lightning.decoder.kernels.switch import KERNELS, are_plain, use

__all__ = ["KERNELS", "are_plain", "use"]
