"""How much is worked on at a time, so that it stays in the processor's cache.

All of these are sizes of blocks into which independent work is split on a CPU. They change the time, and results in
the last bits of a float at most. They were measured on x86-64 cores with 1 to 2 MB of level-2 cache.
"""

from __future__ import annotations

WINOGRAD_TILES = 256
"""Tiles of 4 x 4 outputs whose 36 products are computed together."""

ATTENTION_TOKENS = 4096
"""Tokens (slots times pixels) of attention along time whose queries, keys, values and weights are computed together."""

ATTENTION_VALUES = 2**20
"""Values of those tokens in bfloat16, of which half as many bytes have to fit."""

POSITION_WEIGHTS = 2**20
"""Weights between positions of BIRNAT's attention that exist at once, for every snapshot; all of them are (H W)^2."""

TOTAL_VARIATION_PIXELS = 2**17
"""Pixels of the frames that total variation denoises together, which needs seven arrays of them."""

MOTION_PIXELS = 2**17
"""Pixels of the frames whose motion is searched for together; more of them need more memory and are no faster."""
