"""``python -m tests.decoder.transcription_time NAME SIDE``: a network in turns with its plain transcription, timed.

Both decode the same snapshot of T = 8 with the same random weights, in float32.
"""

from __future__ import annotations

import statistics
import sys

import torch

import sci_lightning as sci
from sci_lightning.studies.benchmark.timing import seconds_in_turns, times_as_fast
from tests.decoder.transcriptions import TRANSCRIPTIONS, as_published


def main(name: str, side: int) -> None:
    """Print the median seconds of both, and the median of their ratio."""
    decoder, plain = sci.load_decoder(name, ["frames=8"]), TRANSCRIPTIONS[name]
    mask = (torch.rand(8, side, side) < 0.5).float()
    measurement, weights = (mask * torch.rand(8, side, side)).sum(0, keepdim=True), as_published(decoder)
    calls = {"ours": lambda: decoder(measurement, mask), "plain": lambda: plain(weights, measurement, mask)}
    with torch.inference_mode():
        seconds = seconds_in_turns(calls, torch.device("cpu"), 1, 7, 300)
    ours, theirs = (statistics.median(seconds[key]) for key in ("ours", "plain"))
    print(f"{name}, {side} x {side}: {ours:.3g} s, transcription {theirs:.3g} s")
    print(f"{times_as_fast(seconds['ours'], seconds['plain']):.2f} times as fast")


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
