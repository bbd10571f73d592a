"""Sensors of megapixels: the memory that decoding them takes, in a process of its own, and the seconds, printed."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROGRAM = """
import resource, sys, time
import torch
import lightning  # which a command has loaded as well
import sci_lightning as sci
from sci_lightning.decoder import Res2former
from sci_lightning.decoder.tiling.tile_choice import TileChoice

def seconds(decoder, frames, height, width):
    mask = (torch.rand(frames, height, width) < 0.5).float()
    measurement = mask.mean(0)[None] * frames / 2
    choice = TileChoice("auto", say=print)
    start = time.process_time()
    tiling = choice.tiling(decoder, measurement, mask)
    decoder(measurement, mask) if tiling is None else decoder.in_tiles(measurement, mask, tiling)
    return time.process_time() - start

torch.manual_seed(0)
torch.set_num_threads(1)
with torch.inference_mode():
    if sys.argv[1] == "res2former":
        decoder = Res2former().eval()
        with torch.autocast("cpu", torch.bfloat16):
            small = min(seconds(decoder, 10, 256, 256) for _ in range(3))
            large = seconds(decoder, 10, 768, 1024)
            again = min(seconds(decoder, 10, 256, 256) for _ in range(2))
        print(f"768 x 1024: {large:.1f} s, {large / (12 * min(small, again)):.3f} times 12 x 256 x 256 ({small:.2f} s)")
    else:
        decoder = sci.load_decoder("gap_tv", [f"decoder.iterations=[{sys.argv[2]}]"])
        rows = 411, 822, 1644
        taken = [seconds(decoder, 40, height, 3840) for height in rows]
        print("; ".join(f"{h} x 3840: {s:.1f} s, {1e6 * s / h / 3840:.2f} us a pixel" for h, s in zip(rows, taken)))
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""


@pytest.mark.slow
@pytest.mark.parametrize(("decoder", "most"), [("res2former", 2.5), ("gap_tv", 6.0)])
def test_memory(decoder: str, most: float) -> None:
    """Res2former at 768 x 1024 x 10 in bfloat16 takes at most 2.5 GiB, GAP-TV at 1644 x 3840 x 40 at most 6."""
    done = subprocess.run([sys.executable, "-c", PROGRAM, decoder, "12"], capture_output=True, text=True, check=True)
    print(done.stdout)
    assert int(done.stdout.splitlines()[-1]) <= most * 2**30
