"""``python -m sci_lightning.mismatch.finetuning``: what fine-tuning with the diagnosed camera is worth."""

from __future__ import annotations

import shlex
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import yaml
from annotated_types import DocInfo
from rich.table import Table

from sci_lightning.cli.composition import Composition, compose, plain
from sci_lightning.cli.settings import CommandSettings
from sci_lightning.configuration.bounds import Repeats
from sci_lightning.console import PlainConsole, styled
from sci_lightning.errors import BadInput

if TYPE_CHECKING:  # --help answers without torch
    from sci_lightning.decoder import Decoder
    from sci_lightning.studies.mismatch.prepare import PreparedStudy

MEAN = "mean_measurement"
"""What records call the decoder whose estimate has the mean measurement in every frame."""


@dataclass(frozen=True)
class MismatchFinetuningSettings(CommandSettings):
    overrides: Annotated[str, DocInfo("overrides of every training, as one text")]
    protocol: Annotated[str, DocInfo("overrides of the protocol, as one text")]
    recipe: Annotated[str, DocInfo("overrides of every fine-tuning, as one text")]
    seeds: Repeats


def mismatch_finetuning(composition: Composition) -> None:
    """Train behind the ideal camera, fine-tune and train anew behind the diagnosed one, and score them all.

    Everything that is finished is kept in ``out``: the same command goes on after an interruption.
    """
    from sci_lightning.cli.notebook import train
    from sci_lightning.studies.engine import run_cases
    from sci_lightning.studies.mismatch.prepare import Score, prepare, trained_decoder
    from sci_lightning.studies.mismatch.records import mismatch_records
    from sci_lightning.studies.mismatch.scenarios import MeanMeasurement
    from sci_lightning.studies.mismatch.summary import finetuning_table

    cfg, out, console = composition.cfg, Path(composition.cfg.out).resolve(), PlainConsole()
    training, protocol, recipe = (_words(cfg, key) for key in ("overrides", "protocol", "recipe"))
    settings = compose("mismatch", [*protocol, "cameras=[published]"])
    command = "python -m sci_lightning.mismatch.finetuning"
    prepared = prepare(plain(settings.cfg), settings.choice("data"), out / "protocol", command)
    (camera,) = prepared.cameras
    prepared.protocol.on_progress = lambda line: None
    name = compose("train", [*training]).choice("decoder")
    console.say(styled(camera.name), ": its calibration captures are diagnosed")
    kept = mismatch_records(out / "records")

    def score(name: str, decoder: Decoder, described: dict[str, Any], wanted: list[str]) -> dict[str, Any]:
        case = prepared.case(camera, name, described, wanted)
        for _ in run_cases(Score(prepared, {name: decoder}, kept), kept.missing([case]), kept):
            pass
        (record,) = kept.all_of([case], console.print)
        return record.as_json()

    records = [score(MEAN, MeanMeasurement().eval(), {"decoder": MEAN}, ["ideal", "calibrated"])]
    corrected = out / "protocol" / "cameras" / camera.name / "calibrated" / "encoder.yaml"
    ideal = _write_ideal_encoder(prepared, out / "ideal.yaml")
    places = [word for word in training if "/" in word.partition("=")[2]]  # a checkpoint's folders have to be repeated
    light = [f"encoder.aperture={prepared.bench.aperture}"]
    for seed in range(cfg.seeds):
        folder = out / f"seed{seed}"
        words = [*training, *light, f"seed={seed}"]
        plans = {
            "ideal": [*words, f"encoder='{ideal}'"],
            "finetuned": [
                f"ckpt_path='{folder / 'ideal' / 'checkpoints' / 'last.ckpt'}'",
                "experiment=finetune",
                f"encoder='{corrected}'",
                *light,
                *places,
                *recipe,
            ],
            "anew": [*words, f"encoder='{corrected}'"],
        }
        for kind, overrides in plans.items():
            console.say(styled(f"seed {seed}"), f": training, {kind}")
            checkpoint = train([*overrides, "resume=true", f"out='{folder / kind}'"]).checkpoint
            decoder, described = trained_decoder(checkpoint, name)
            wanted = ["ideal", "mismatched", "calibrated"] if kind == "ideal" else ["calibrated"]
            described = {**described, "training": kind, "training_seed": seed}
            label = f"{name}-{kind}-{seed}"
            records.append(score(label, decoder, described, wanted))
            scores = {key: f"{values['mean']['psnr']:.2f} dB" for key, values in records[-1]["scenarios"].items()}
            console.say(styled(f"seed {seed}"), f": {kind}: {scores}")
    heading, *rows = finetuning_table(records)
    table = Table(*heading, title="mean PSNR of the scenes (dB)", title_justify="left")
    for row in rows:
        table.add_row(*row)
    console.print(table)
    console.say(styled(out), ": records/, seed*/ (trainings), protocol/ (the diagnosis)")


def _words(cfg: Any, key: str) -> list[str]:
    try:
        return shlex.split(cfg[key] or "")
    except ValueError as error:
        raise BadInput(f"{key}={cfg[key]}: {str(error).lower()}; give words as on a command line") from error


def _write_ideal_encoder(prepared: PreparedStudy, path: Path) -> Path:
    """Write the encoder file of the ideal camera with the noise of the datasheet."""
    from sci_lightning.files.atomic_file import atomic_write

    session = prepared.bench.session
    content = {
        "_target_": "sci_lightning.encoder.Encoder",
        "aperture": "auto",
        "mask": {
            "_target_": "sci_lightning.encoder.mask.Measured",
            "file": str(Path(session.mask).relative_to(path.parent)),
            "key": None,
            "frames": session.frames,
            "size": list(session.size),
        },
        "sensor": {
            "_target_": "sci_lightning.encoder.sensor.ClipQuantise",
            "bit_depth": session.bit_depth,
            "full_well": float(session.full_well_e),
            "read_noise": float(session.read_noise_dn),
        },
    }
    with atomic_write(path) as temporary:
        temporary.write_text(yaml.safe_dump(content, sort_keys=False))
    return path
