"""The figures that others published for this protocol, to be shown beside ours and never mixed with them."""

from __future__ import annotations

from collections.abc import Mapping

SOURCE = "InverseNet, arXiv 2603.04538"

MEANS: Mapping[str, Mapping[str, float]] = {
    "gap_tv": {"ideal": 26.75, "mismatched": 15.81, "known": 26.01},
    "pnp_ffdnet": {"ideal": 29.28, "mismatched": 11.43, "known": 25.39},
    "elp_unfolding": {"ideal": 34.09, "mismatched": 15.47, "known": 29.40},
    "efficientsci": {"ideal": 35.39, "mismatched": 14.81, "known": 27.38},
}
"""Mean PSNR in dB of the six scenes, by decoder and scenario."""
