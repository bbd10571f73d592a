"""Settings that make every decoder of the configuration small."""

from __future__ import annotations

ITERATIVE = ["decoder.iterations=[3]", "decoder.motion.after=1", "decoder.motion.reach=2"]

START = [setting.replace("decoder.", "decoder.start.") for setting in ITERATIVE]

PNP = ["decoder.iterations=[2]", "decoder.motion.reach=2", *START]

SMALL = {
    "admm_net": ["decoder.stages=3", "decoder.channels=[4,6,8]"],
    "admm_tv": ITERATIVE,
    "birnat": ["decoder.channels=16", "decoder.hidden=4"],
    "desci": ["decoder.iterations=[1,1]", "decoder.denoiser.reach=2", *START],
    "e2e_cnn": ["decoder.channels=8", "decoder.blocks=2"],
    "efficientsci": ["decoder.channels=8", "decoder.blocks=2"],
    "elp_unfolding": ["decoder.channels=16", "decoder.iterations=2", "decoder.priors=3"],
    "gap_tv": ITERATIVE,
    "gap_net": ["decoder.stages=3", "decoder.channels=[4,6,8]"],
    "metasci": ["decoder.channels=16", "decoder.blocks=2"],
    "pnp_fastdvdnet": ["decoder.strengths=[0.2]", *PNP, "decoder.denoiser.channels=[4,6,8]"],
    "pnp_ffdnet": ["decoder.strengths=[0.2]", *PNP, "decoder.denoiser.channels=8"],
    "res2former": ["decoder.dim=16", "decoder.depths=[1,1]"],
    "res2former_l": ["decoder.dim=16", "decoder.depths=[1,1]", "decoder.groups=[2,4]"],
    "revsci": ["decoder.blocks=2", "decoder.channels=16"],
    "sci3d": ["decoder.phases=3", "decoder.channels=[8,16,32]", "decoder.inner=3"],
    "stformer": ["decoder.dim=8", "decoder.units=1"],
    "universal": ["decoder.widths=[4,6,8]", "decoder.passes=2", "decoder.window=4", *START],
}
