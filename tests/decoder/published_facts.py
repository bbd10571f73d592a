"""What is known of the published networks."""

from __future__ import annotations

PUBLISHED = {  # parameters, exact multiply-accumulates at 256 x 256 x 8
    "admm_net": (4_213_809, 58_284_048_384),
    "birnat": (4_131_640, 421_051_498_496),
    "e2e_cnn": (817_608, 53_485_764_608),
    "efficientsci": (8_824_321, 1_425_325_162_496),
    "elp_unfolding": (565_733_402, 4_634_940_801_024),
    "gap_net": (5_618_400, 77_712_064_512),
    "metasci": (2_066_968, 36_230_397_952),
    "res2former": (11_022_625, 864_597_049_344),
    "res2former_l": (17_697_153, 1_368_618_172_416),
    "revsci": (5_655_393, 758_263_054_336),
    "sci3d": (61_951_477, 3_974_106_710_016),
    "stformer": (19_490_177, 2_972_060_123_136),
}

FILES = {"admm_net": "admmnet", "gap_net": "gapnet"}
"""Decoders whose reference file bears another name."""
