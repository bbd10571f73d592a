"""Ten fixed cases, five diagnoses and five decoders, give the figures that were recorded earlier.

``same_figures.json`` was recorded by ``python -m tests.end_to_end.test_same_figures``, with the processor and the
version of torch beside it. The world of these captures is dark beyond the field, their files say so, and no
capture is kept for verification, and later names are left out. On that processor and version every bit agrees;
elsewhere sums are taken in another order, and the figures agree to rounding. So do the figures inside a sentence, to
one unit of the last digit that is printed: 0.755 is 0.76 on one processor and 0.75 on another.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest
import torch

from sci_lightning import decoder as decoders

RECORD = Path(__file__).with_name("same_figures.json")

DECODERS: dict[str, dict[str, Any]] = {
    "Res2former": {"dim": 32, "depths": [1, 1], "groups": [2, 4], "heads": 2},
    "STFormer": {"frames": 8, "dim": 16, "units": 1},
    "RevSCI": {"blocks": 3, "channels": 32},
    "E2ECNN": {"frames": 8, "channels": 32, "blocks": 2},
    "GAP": {},
}

DIAGNOSES: dict[str, list[str]] = {
    "nothing": ["effects=none", "seed=1"],
    "mask_shift": ["effects=[{name:mask_shift,dx:0.61,dy:-0.35}]", "seed=2"],
    "gain_and_black_level": ["effects=[{name:gain,factor:0.9},{name:black_level,offset:0.02}]", "seed=3"],
    "prnu": ["effects=[{name:prnu,std:0.03}]", "seed=4"],
    "outside": ["effects=interlaced_gain", "seed=6"],
}

LATER = (
    "leave_out=[scene_shift,scene_rotation,scene_scale,scene_blur,scene_gamma,mask_distortion,mask_keystone,"
    "duty_cycle,illumination]"
)
"""Effects that had no name when the diagnoses were recorded."""


def processor() -> str:
    """The processor's model and the version of torch, on which the last bits of a sum depend."""
    content = Path("/proc/cpuinfo").read_text() if Path("/proc/cpuinfo").exists() else ""
    facts = dict(re.findall(r"^(vendor_id|cpu family|model|model name)\s*: (.*)$", content, re.MULTILINE))
    return f"{' '.join(facts.values()) or platform.machine()}, torch {torch.__version__}"


def decode(name: str) -> dict[str, Any]:
    """A digest over the bits of one reconstruction, and some of its values."""
    torch.manual_seed(0)
    torch.set_num_threads(1)
    decoder = build_decoder(name).eval()
    mask = torch.rand(8, 32, 32)
    measurement = (mask * torch.rand(2, 8, 32, 32)).sum(1) / 8
    with torch.no_grad():
        video = decoder(measurement, mask)
    digest = hashlib.sha256(video.contiguous().numpy().tobytes()).hexdigest()
    return {"digest": digest, "values": [float(value) for value in video.flatten()[::1009]]}


def build_decoder(name: str) -> torch.nn.Module:
    """The decoder of this name, reduced; the iterative one has total variation for a denoiser."""
    if name == "GAP":
        from sci_lightning.decoder.denoiser import TotalVariation

        return decoders.GAP(TotalVariation(), strengths=[0.1], iterations=[10])
    decoder: torch.nn.Module = getattr(decoders, name)(**DECODERS[name])
    return decoder


def diagnose(name: str, folder: Path) -> dict[str, Any]:
    """What ``report.json`` says of captures that the virtual camera takes, without times and paths."""
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}  # sums are taken in one order
    camera = [f"out={folder}/captures.h5", "size=[32,32]", "surround=dark", *DIAGNOSES[name]]
    for command, words in (
        ("virtual_camera", camera),
        ("diagnose", [f"captures={folder}/captures.h5", f"out={folder}/out", "search.verification_one_in=0", LATER]),
    ):
        subprocess.run(
            [sys.executable, "-m", f"sci_lightning.{command}", *words], check=True, capture_output=True, env=environment
        )
    report = json.loads((folder / "out" / "report.json").read_text())
    return {key: report[key] for key in ("verdict", "effects", "gap", "unnamed")}


def numbers(content: Any, path: str = "") -> dict[str, Any]:
    """Every number and word in nested data by its place, without names of pictures and what reports say only now."""
    if isinstance(content, dict):
        return {
            key: value
            for part, inner in content.items()
            if part not in ("picture", "nats")
            for key, value in numbers(inner, f"{path}/{part}").items()
        }
    if isinstance(content, list):
        return {
            key: value
            for index, inner in enumerate(content)
            for key, value in numbers(inner, f"{path}/{index}").items()
        }
    return {path: content}


def check(now: dict[str, Any], then: dict[str, Any], same_processor: bool) -> None:
    """Compare bit by bit on the processor of the record, to rounding elsewhere."""
    now, then = numbers(now), numbers(then)
    if same_processor:
        assert now == then
        return
    now.pop("/digest", None), then.pop("/digest", None)
    assert now.keys() == then.keys()
    for place, value in then.items():
        if isinstance(value, float):
            assert now[place] == pytest.approx(value, rel=1e-3, abs=1e-4), place
        elif isinstance(value, str):
            assert same_sentence(now[place], value), (place, now[place], value)
        elif not isinstance(value, int):
            assert now[place] == value, place


def same_sentence(now: str, then: str) -> bool:
    """Whether two sentences have the same words, and figures within one unit of the last digit printed."""
    figure = r"\d+(?:\.\d+)?"
    if re.split(figure, now) != re.split(figure, then):
        return False
    pairs = zip(re.findall(figure, now), re.findall(figure, then), strict=True)
    return all(abs(float(one) - float(other)) <= 1.001 * 10.0 ** -decimals(other) for one, other in pairs)


def decimals(figure: str) -> int:
    """How many digits a printed figure has after its point."""
    return len(figure.partition(".")[2])


def test_sentences_of_other_processors() -> None:
    """A figure may differ by rounding; a word, a digit more, or another figure is another sentence."""
    sentence = "mask_shift dx 0.76 nats, and 12 of 24"
    assert same_sentence("mask_shift dx 0.75 nats, and 12 of 24", sentence)
    assert not same_sentence("mask_shift dx 0.74 nats, and 12 of 24", sentence)
    assert not same_sentence("mask_shift dy 0.76 nats, and 12 of 24", sentence)
    assert not same_sentence("mask_shift dx 0.76 nats, and 12 of 26", sentence)
    assert not same_sentence("mask_shift dx 0.76 nats, and -12 of 24", sentence)


@pytest.mark.parametrize("name", DECODERS)
def test_decoder(name: str) -> None:
    record = json.loads(RECORD.read_text())
    check(decode(name), record["decoders"][name], record["processor"] == processor())


@pytest.mark.slow
@pytest.mark.parametrize("name", DIAGNOSES)
def test_diagnosis(name: str, tmp_path: Path) -> None:
    record = json.loads(RECORD.read_text())
    check(diagnose(name, tmp_path), record["diagnoses"][name], record["processor"] == processor())


if __name__ == "__main__":
    outputs = {name: decode(name) for name in DECODERS}
    diagnoses = {}
    for case in DIAGNOSES:
        with tempfile.TemporaryDirectory() as scratch:
            diagnoses[case] = diagnose(case, Path(scratch))
    content = {"processor": processor(), "decoders": outputs, "diagnoses": diagnoses}
    RECORD.write_text(json.dumps(content, indent=1) + "\n")
