"""``python -m tests.diagnosis.cassi_tsa FOLDER OUT``: five real snapshots of a spectral camera, diagnosed blind.

It writes the report to OUT, and the measurements and the picture of docs/results/real-snapshots.md. FOLDER holds
``mask.mat`` and ``scene1.mat`` to ``scene5.mat``; scenes 4 and 5 only verify.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from matplotlib.image import imread

from sci_lightning.captures import Captures
from sci_lightning.captures.snapshots import captures_of_snapshots, read_snapshots
from sci_lightning.diagnosis.blind.blind_diagnosis import SEARCHED_SIDE_PX, BlindDiagnosis, diagnose_blind
from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood
from sci_lightning.diagnosis.blind.prior import BLOCK, ScenePrior, statistics_for
from sci_lightning.diagnosis.blind.snapshots import observe_snapshots, textured_part
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import datasheet_noise
from sci_lightning.diagnosis.report.report import write_report
from sci_lightning.diagnosis.report.sentences import headline
from sci_lightning.diagnosis.report.svg import AFTER, BEFORE, FAINT, style
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.encoder.effects import MaskContrast
from sci_lightning.files.picture_file import matching_files
from tests.measurements_file import Column, MeasurementsFile

VERIFY = (3, 4)
"""Numbers of the snapshots that only judge."""
RESULTS = Path("docs/results")
COMMAND = "python -m tests.diagnosis.cassi_tsa FOLDER OUT"
SIGMAS = (0.0, 0.4, 0.6, 0.8, 1.0, 1.5, 2.5)
"""Pixels by which the mask is blurred, one after another."""


def read_cassi(folder: Path) -> Captures:
    """Return the snapshots with their mask, which moves by two columns from slot to slot."""
    dn, _ = read_snapshots(matching_files(folder / "scene*.mat"))
    return captures_of_snapshots(dn, 12, folder / "mask.mat", step=(0, 2), verification=VERIFY)


def by_snapshot(diagnosis: BlindDiagnosis) -> list[dict[str, Any]]:
    """Return the prediction errors of every snapshot, and how much error the likeliest camera removes."""
    judged, seen = diagnosis.prediction, diagnosis.predicted
    assert judged is not None and seen is not None
    pairs = zip(seen.number.tolist(), judged.gap.by_capture, judged.without_mask.by_capture, strict=True)
    return [
        {
            "snapshot": f"scene {number + 1}",
            "role": "verifies" if number in VERIFY else "fitted",
            "before": before,
            "after": after,
            "fall": 100 * (1 - after / before),
            "without_mask": without,
        }
        for number, (before, after), (without, _) in sorted(pairs)
    ]


def by_hypothesis(captures: Captures) -> list[dict[str, Any]]:
    """Return the log-likelihood per pixel of a few hypotheses, in the order of the table."""
    part = textured_part(captures, SEARCHED_SIDE_PX, VERIFY)
    observation = observe_snapshots(part, leave_out=VERIFY)
    model = CameraModel(observation, vocabulary(), {"mask_contrast": MaskContrast})
    likelihood = BlindLikelihood(
        model, ScenePrior(observation.frames, statistics_for(observation.frames, observation.patterns))
    )
    noise, _ = datasheet_noise(observation)
    hypotheses = {f"mask blurred by {sigma:.1f} pixels": {"mask_blur": {"sigma": sigma}} for sigma in SIGMAS[1:]}
    hypotheses = {"mask as it is": {}} | hypotheses
    hypotheses["mask displaced by (0.35, 0.35) pixels"] = {"mask_shift": {"dx": 0.35, "dy": 0.35}}
    hypotheses["no mask: the same everywhere"] = {"mask_contrast": {"leak": 1.0}}
    rows = []
    for name, effects in hypotheses.items():
        hypothesis = noise
        for effect, setting in effects.items():
            hypothesis = hypothesis.with_effect(effect, setting)
        score = likelihood.evaluate(hypothesis).log_likelihood
        rows.append({"camera": name, "nats": float(score.nanmean() / BLOCK**2)})
    return [{**row, "gained": row["nats"] - rows[0]["nats"]} for row in rows]


def picture(rows: list[dict[str, Any]], report: Path) -> Figure:
    """Draw the report's reconstructions above the prediction errors of every scene."""
    with style():
        figure = Figure(figsize=(8.6, 6.6), layout="constrained")
        above, below = figure.subplots(2, 1, height_ratios=(2.2, 1))
        above.imshow(imread(report / "reconstruction.png"), interpolation="lanczos")
        above.set_axis_off()
        bars = ((-0.27, BEFORE, "before", "the mask of the file"), (0.0, AFTER, "after", "the likeliest camera"))
        for shift, colour, key, label in (*bars, (0.27, FAINT, "without_mask", "no mask")):
            places = [place + shift for place in range(len(rows))]
            below.bar(places, [row[key] for row in rows], 0.25, color=colour, label=label)
        names = [f"{row['snapshot']}\n({row['role']})" for row in rows]
        below.set_xticks(range(len(rows)), names)
        below.set(ylabel="error of held-out pixels")
        below.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3)
        return figure


def main(folder: Path, out: Path) -> None:
    captures = read_cassi(folder)
    about = {"machine": "one thread", "seeds": "0", "command": COMMAND}
    scale = f"the {SEARCHED_SIDE_PX} x {SEARCHED_SIDE_PX} pixels with the most texture, 28 slots"
    file = MeasurementsFile(RESULTS / "cassi-tsa.json", scale=scale, **about)
    likely = MeasurementsFile(RESULTS / "cassi-tsa-blur.json", scale=f"{scale}; scenes 1 to 3", **about)
    diagnosis = diagnose_blind(captures, on_progress=lambda line: print(line, flush=True))
    write_report(diagnosis, out)
    columns: list[Column] = [
        ("snapshot", "snapshot", None),
        ("role", "role", None),
        ("before", "the mask of the file", 3),
        ("after", "the likeliest camera", 3),
        ("fall", "error removed (%)", 1),
        ("without_mask", "no mask", 3),
    ]
    for effect in diagnosis.effects:
        print(effect.name, {name: (one.value, one.std) for name, one in effect.parameters.items()})
    said = f"The report: {diagnosis.verdict}. {headline(diagnosis)}"
    print(said)
    rows = by_snapshot(diagnosis)
    file.write(columns, rows, [said])
    picture(rows, out).savefig(RESULTS / "real-snapshots.png", dpi=110, facecolor="white")
    columns = [("camera", "camera", None), ("nats", "nats per pixel", 3), ("gained", "gained", 3)]
    likely.write(columns, by_hypothesis(captures))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
