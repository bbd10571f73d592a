"""``python -m tests.studies.tables.aperture_readings SCENES CLIPS FOLDER RUNS``: what readings of the aperture do.

It writes FOLDER/aperture.json (trainings whose ``metrics.json`` lie in folders of RUNS) and
FOLDER/aperture-printed.json (which reading leads from the figures that the paper prints
without sensor to those that it prints with one), from which the tables of docs/results/aperture.md are made.

The second file has no network in it. A network that reaches P dB without sensor is taken to estimate s x + e + w: w is
white noise of P dB, s the scale of the light over the one that the decoder divides by, and e what clipping and rounding
leave of the measurement, spread evenly over the open slots, (y' - s y) / sum of M. The SSIM is the printed one times
that of s x + e.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

import sci_lightning as sci
from sci_lightning.data import Folder, SixScenes
from sci_lightning.encoder.aperture import PER_SNAPSHOT
from sci_lightning.files.json_file import read_json
from sci_lightning.metrics import ssim
from sci_lightning.runs.results import RunMetrics
from sci_lightning.studies.tables.paper_figures import paper_figures
from tests.measurements_file import MeasurementsFile

T, SIZE = 8, (256, 256)
READINGS = {
    "no sensor": (1.0, True),
    "2/T": ("auto", True),
    "1/T": ("1/T", True),
    "1/max(y), not told": (PER_SNAPSHOT, False),
}
"""Setting and told of each. The last decoder divides by the constant that fits the training clips best."""
PROFILE = {"kobe": -0.80, "traffic": -4.33, "runner": 5.45, "drop": 8.77, "crash": -5.03, "aerial": -4.06}
"""Published PSNR of a scene less the mean of the six scenes, in dB, mean of U-net, BIRNAT, MetaSCI, RevSCI, SCI3D, ELP
and STFormer (the README files of ucaswangls/cacti)."""
CLIPS = 64


def cameras(mask: sci.masks.Mask, constant: float) -> dict[str, tuple[sci.Encoder, sci.Encoder]]:
    """Return for every reading the camera, and the one that the decoder believes in."""
    made = {}
    for name, (setting, told) in READINGS.items():
        sensor = sci.sensors.Ideal() if name == "no sensor" else sci.sensors.ClipQuantise()
        camera = sci.Encoder(mask, sensor, setting, told=told)
        assumed = sci.Encoder(mask, sensor, constant) if name == "1/max(y), not told" else camera
        made[name] = camera, assumed
    return made


@torch.no_grad()
def constant_of(mask: sci.masks.Mask, clips: Path) -> float:
    """Return the one aperture by which a decoder of 1/max(y) divides with the least squared error of light on clips."""
    source = Folder(clips, T, SIZE, SIZE, seed=0, clips_per_epoch=CLIPS).clips()
    light = torch.stack([(source[number] * mask()).sum(0) for number in range(CLIPS)])
    power, scale = light.square().sum((-2, -1)), 1 / light.amax((-2, -1))
    return float((power * scale.square()).sum() / (power * scale).sum())


TRAINED = {
    "rbw_osr": ("E2E-CNN", "no sensor"),
    "test_auto": ("E2E-CNN", "2/T"),
    "test_one_over_T": ("E2E-CNN", "1/T"),
    "test_per_snapshot_told": ("E2E-CNN", "1/max(y), told"),
    "test_per_snapshot_as_0.145": ("E2E-CNN", "1/max(y), not told, taken for 0.145"),
    "test_per_snapshot_not_told": ("E2E-CNN", "1/max(y), not told, taken for 2/T"),
    "retrained_auto": ("E2E-CNN, trained again", "2/T"),
    "retrained_one_over_T": ("E2E-CNN, trained again", "1/T"),
    "retrained_per_snapshot_told": ("E2E-CNN, trained again", "1/max(y), told"),
    "retrained_per_snapshot_not_told": ("E2E-CNN, trained again", "1/max(y), not told"),
}
"""Folders of RUNS: the network, and the reading that it meets. ``python -m sci_lightning.`` makes them, DATA being
``data=folder data.root=CLIPS data.val_root=VALIDATION benchmark.root=SCENES`` and FIX ``scale=cpu core_minutes=null
trainer.max_epochs=10000 logger=none seed=0 resume=true``::

    train encoder=rbw_osr decoder=e2e_cnn FIX trainer.max_steps=4000 DATA out=RUNS/rbw_osr
    evaluate ckpt_path=RUNS/rbw_osr/checkpoints/last.ckpt encoder=rbw_sr encoder.mask.tile=[8,8] encoder.mask.seed=0
        data.root=SCENES pictures=0 READING out=RUNS/test_READING
    train experiment=finetune ckpt_path=RUNS/rbw_osr/checkpoints/last.ckpt encoder=rbw_sr crop=[256,256] batch_size=1
        trainer.max_steps=400 FIX DATA READING out=RUNS/retrained_READING

READING is ``encoder.aperture=auto``, ``1/T``, ``per_snapshot`` or ``per_snapshot encoder.told=false``, in the tests
also with ``encoder@camera=rbw_sr camera.mask.tile=[8,8] camera.mask.seed=0 camera.aperture=0.145``.
"""


def trained(folder: Path) -> list[dict[str, Any]]:
    """Return the scores of the runs in a folder, as :data:`TRAINED` names them."""
    rows: list[dict[str, Any]] = []
    for name, (decoder, reading) in TRAINED.items():
        mean = read_json(folder / name / "metrics.json", RunMetrics).mean
        scores = [mean[key] for key in ("psnr", "ssim", "qscore")]
        rows.append({"decoder": decoder, "reading": reading, "scores": scores})
    return rows


def printed() -> list[tuple[str, dict[str, list[float]]]]:
    """Return the networks of Table 2 with what the paper prints: without sensor, with it, and retrained (Table 3)."""
    tables = paper_figures()["tables"]
    networks = []
    for name, row in tables["table2"]["rows"].items():
        figures = {"no sensor": row["train RBw/oSR, test RBw/oSR"], "Table 2": row["train RBw/oSR, test RBw/SR"]}
        if name in tables["table3"]["rows"]:
            figures["Table 3"] = tables["table3"]["rows"][name]["train and test RBw/SR"]
        networks.append((name, figures))
    return networks


@torch.no_grad()
def predicted(scenes: Mapping[str, torch.Tensor], mask: torch.Tensor, made: Any) -> list[dict[str, Any]]:
    """Return for every network what is printed, and what every reading predicts from its figures without sensor."""
    total = mask.sum(0).clamp(min=1)
    facts: dict[str, list[tuple[float, torch.Tensor, float]]] = {}
    for reading, (camera, assumed) in made.items():
        for scene, video in scenes.items():
            light = (video * mask).sum(1)
            scale = torch.as_tensor(camera.aperture_setting.scale(light, camera.mask, 1, 1 / 255))
            assumed_scale = scale if camera.aperture_setting.is_carried else assumed.aperture
            s = (scale / assumed_scale).expand(len(video), 1, 1)
            linear = camera.sensor(scale * light) / assumed_scale
            distorted = s[:, None] * video + ((linear - s * light) / total)[:, None]
            error = (distorted - video).square().mean((-2, -1))
            facts.setdefault(reading, []).append((PROFILE[scene], error, float(ssim(distorted, video).mean())))
    rows = []
    for name, figures in printed():
        row: dict[str, Any] = {"network": name} | {key: values[:2] for key, values in figures.items()}
        level, structure = figures["no sensor"][:2]
        for reading, scenes_facts in list(facts.items())[1:]:
            levels = [-10 * torch.log10(10 ** (-(level + more) / 10) + error).mean() for more, error, _ in scenes_facts]
            similar = sum(similarity for *_, similarity in scenes_facts) / len(scenes_facts)
            row[reading] = [float(sum(levels) / len(levels)), structure * similar]
        rows.append(row)
        print(row, flush=True)
    return rows


def main(root: Path, clips: Path, out: Path, runs: Path) -> None:
    scenes = {scene.name: torch.as_tensor(scene.video) for scene in SixScenes(root, T, SIZE).scenes()}
    mask = sci.masks.RandomBinary(T, SIZE, seed=0)
    constant = constant_of(mask, clips)
    print(f"constant {constant:.4f}", flush=True)
    made = cameras(mask, constant)
    common = {
        "machine": "one core",
        "seeds": "0",
        "command": "python -m tests.studies.tables.aperture_readings SCENES CLIPS docs/results RUNS",
    }
    scale = f"the six scenes, a random binary mask without a tile; constant of the last reading {constant:.4f}"
    file = MeasurementsFile(out / "aperture-printed.json", scale=scale, **common)
    columns = [(key, key, [2, 3]) for key in ("no sensor", "Table 2", "Table 3", *list(READINGS)[1:])]
    file.write([("network", "network: PSNR (dB) / SSIM", None), *columns], predicted(scenes, mask(), made))
    scale = "the six scenes, a random binary mask that repeats every 8 pixels"
    file = MeasurementsFile(out / "aperture.json", scale=scale, **common)
    titles = [("decoder", "decoder", None), ("reading", "reading", None)]
    file.write([*titles, ("scores", "PSNR (dB) / SSIM / Q", [2, 3, 2])], trained(runs))


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
