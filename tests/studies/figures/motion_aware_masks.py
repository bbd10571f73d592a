"""``python -m tests.studies.figures.motion_aware_masks VALIDATION JSON``: are motion-aware masks decoded better?

It computes the mean measurement behind every mask of docs/results/mask-ranking.json, on the validation clips on which
the networks there were scored, and sets it beside what they reached. With ``trained`` in place of VALIDATION it
collects the same of trainings under docs/results/tables.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from scipy.stats import spearmanr

from sci_lightning.data import Folder
from sci_lightning.studies.figures.motion_aware import awareness
from sci_lightning.studies.mask_ranking import masks
from tests.measurements_file import ROOT, MeasurementsFile

FRAMES, SIDE, SEED = 8, 64, 0


TRAINED = (
    ("random", "reduced Res2former, 4,000 steps", "cpu_4000_steps/rsw_sr_4bit_res2former"),
    ("learned", "reduced Res2former, 4,000 steps", "cpu_4000_steps/lsw_sr_4bit_res2former"),
    ("learned from sharpened random values", "E2E-CNN, 400 s of a GPU", "gpu30_7_minutes/lsw_sr_4bit_e2e_cnn"),
    ("learned from a designed mask", "E2E-CNN, 400 s of a GPU", "gpu30_7_minutes_designed/lsw_sr_4bit_e2e_cnn"),
)


def trained(out: Path) -> None:
    """Write the table of the trainings: every seed that is kept."""
    file = MeasurementsFile(
        out,
        machine="no timing",
        scale="structural masks of 4 bits, six scenes at 256 x 256, 8-bit sensor; trainings under docs/results/tables",
        seeds="in the rows",
        command="python -m tests.studies.figures.motion_aware_masks trained docs/results/motion-aware-trained.json",
    )
    rows = []
    for mask, network, folder in TRAINED:
        for path in sorted((ROOT / "docs/results/tables" / folder).glob("seed?.json")):
            metrics = json.loads(path.read_text())
            scores = {"mean": metrics["baseline"]["psnr"], "psnr": metrics["mean"]["psnr"]}
            rows.append({"mask": mask, "network": network, "seed": int(path.stem[4:]), **scores})
    columns = [
        ("mask", "mask", None),
        ("network", "network", None),
        ("seed", "seed", 0),
        ("mean", "mean measurement (dB)", 2),
        ("psnr", "decoded (dB)", 2),
    ]
    file.write(columns, rows)


def main(validation: Path, out: Path) -> None:
    """Write the table."""
    file = MeasurementsFile(
        out,
        machine="no timing",
        scale="T = 8, 64 x 64, ideal sensor, validation clips; the networks: docs/results/mask-ranking.json",
        seeds="0",
        command="python -m tests.studies.figures.motion_aware_masks VALIDATION docs/results/motion-aware-masks.json",
    )
    ranking = json.loads((ROOT / "docs/results/mask-ranking.json").read_text())["rows"]
    reached = {row["mask"].replace(" ", "_"): row for row in ranking}
    size = (SIDE, SIDE)
    scenes = Folder(validation, FRAMES, size, size, SEED, val_root=validation, clips_per_epoch=1).scenes()
    rows = []
    for name, make in masks(FRAMES, SIDE, SEED).items():
        row = reached[name]
        rows.append({"mask": row["mask"], **awareness(make(), scenes), "psnr": row["psnr"], "score": row["score"]})
    for key in ("frames", "score"):
        rank, p_value = spearmanr([row[key] for row in rows], [row["psnr"] for row in rows])
        print(f"{key}: rank correlation with the PSNR that was reached {rank:.2f} (p = {p_value:.2g})")
    columns = [
        ("mask", "mask", None),
        ("frames", "mean measurement (dB)", 2),
        ("photograph", "against the photograph without a mask (dB)", 2),
        ("psnr", "network (dB)", 2),
        ("score", "score (dB)", 2),
    ]
    file.write(columns, sorted(rows, key=lambda row: -row["frames"]))


if __name__ == "__main__":
    trained(Path(sys.argv[2])) if sys.argv[1] == "trained" else main(Path(sys.argv[1]), Path(sys.argv[2]))
