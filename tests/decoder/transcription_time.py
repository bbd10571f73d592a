"""``python -m tests.decoder.transcription_time SIDE JSON NAME .. [FILE]``: networks in turns with plain ones.

Networks and their plain transcriptions decode the same snapshot of T = 8 with the same random weights, in float32 and
in bfloat16, on an idle machine. FILE, which is executed, is the authors' ``model/digital_layer.py`` (pwangcs/
DeepOpticsSCI; it needs einops and timm): its networks, with random weights of their own, take their turns as well.
"""

from __future__ import annotations

import importlib.util
import os
import statistics
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import torch

import sci_lightning as sci
from sci_lightning.runs.precision import mixed_precision
from sci_lightning.studies.benchmark.timing import seconds_in_turns, times_as_fast
from tests.decoder.transcriptions import TRANSCRIPTIONS, as_published
from tests.measurements_file import MeasurementsFile

COLUMNS = [
    ("network", "network", None),
    ("precision", "precision", None),
    ("plain", "plain transcription (s)", 3),
    ("ours", "ours (s)", 3),
    ("gain", "times as fast", 2),
]
AUTHORS = [("authors", "the authors' code (s)", 3), ("gain_authors", "times as fast as it", 2)]
PUBLISHED: dict[str, Callable[[Any], torch.nn.Module]] = {
    "res2former": lambda module: module.Res2former(dim=96, stage_num=1, depth_num=[3, 3]),
    "stformer": lambda module: module.STFormer(color_channels=1, units=4, dim=64, frames=8),
    "revsci": lambda module: module.RevSCI(num_block=50),
    "e2e_cnn": lambda module: module.Unet(in_ch=8, out_ch=64),
}
"""How the authors' ``model/joint_optimization.py`` builds its networks."""


def module_of(file: Path) -> Any:
    """Execute a file and return its module."""
    spec = importlib.util.spec_from_file_location("authors", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def main(side: int, out: Path, names: Sequence[str], authors: Path | None = None) -> None:
    """Write the median seconds of all, and the medians of their ratios."""
    published = None if authors is None else module_of(authors)
    words = [*names, *([] if authors is None else [authors.name])]
    file = MeasurementsFile(
        out,
        machine=f"cpu ({torch.get_num_threads()} of {os.cpu_count()} threads)",
        scale=f"full networks, one snapshot at {side} x {side}, T = 8; the median of up to 7 pairs",
        seeds="0",
        command=f"python -m tests.decoder.transcription_time {side} {out} {' '.join(words)}",
    )
    rows = []
    for name in names:
        torch.manual_seed(0)
        decoder, plain = sci.load_decoder(name, ["frames=8"]), TRANSCRIPTIONS[name]
        mask = (torch.rand(8, side, side) < 0.5).float()
        measurement, weights = (mask * torch.rand(8, side, side)).sum(0, keepdim=True), as_published(decoder)
        calls = {
            "ours": lambda: decoder(measurement, mask),  # noqa: B023, called within this turn of the loop
            "plain": lambda: plain(weights, measurement, mask),  # noqa: B023
        }
        if published is not None and name in PUBLISHED:
            network = PUBLISHED[name](published).eval()
            assert sum(x.numel() for x in network.parameters()) == sum(x.numel() for x in decoder.parameters())
            calls["authors"] = lambda: network(measurement, mask)  # noqa: B023, called within this turn of the loop
        for precision, shown in (("32-true", "float32"), ("bf16-mixed", "bfloat16")):
            with torch.inference_mode(), mixed_precision(precision, torch.device("cpu")):
                seconds = seconds_in_turns(calls, torch.device("cpu"), 1, 7, 60)
            medians = {key: statistics.median(values) for key, values in seconds.items()}
            gains = {"gain": times_as_fast(seconds["ours"], seconds["plain"])}
            if "authors" in seconds:
                gains["gain_authors"] = times_as_fast(seconds["ours"], seconds["authors"])
            rows.append({"network": name, "precision": shown, **medians, **gains})
            print(rows[-1], flush=True)
    file.write([*COLUMNS, *([] if published is None else AUTHORS)], rows)


if __name__ == "__main__":
    asked = sys.argv[3:]
    code = Path(asked.pop()) if asked[-1].endswith(".py") else None
    main(int(sys.argv[1]), Path(sys.argv[2]), asked, code)
