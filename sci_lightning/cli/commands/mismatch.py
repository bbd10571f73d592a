"""``python -m sci_lightning.mismatch``: what a wrong model of the camera costs, and what a diagnosis wins back."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from annotated_types import DocInfo, MinLen
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Table

from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition, built, compose, plain
from sci_lightning.cli.settings import Aperture, BitDepth, Count, Name, NamedOrPath, Place, StudySettings
from sci_lightning.configuration.bounds import Frames, NonNegative, Positive, Repeats, Seed, Size
from sci_lightning.console import PlainConsole, styled
from sci_lightning.errors import BadInput

if TYPE_CHECKING:  # --help answers without torch
    from sci_lightning.decoder import Decoder


@dataclass(frozen=True)
class MismatchSettings(StudySettings):
    decoders: Annotated[Sequence[Name], MinLen(1)] | None
    weights: Mapping[str, Place]
    trusted: Sequence[Name]
    cameras: Sequence[Name]
    scenarios: Sequence[Literal["ideal", "ideal_noisy", "mismatched", "known", "calibrated", "blind"]]
    drawn: Count
    mismatch: Annotated[Mapping[str, Any], DocInfo("effects with their parameters, mismatch.gain.factor=1.05")]
    ranges: Annotated[Mapping[str, Any], DocInfo("effects with ranges, 'ranges.gain.factor=[0.5,1.5]'")]
    mask: NamedOrPath | None
    size: Size
    crop: Size
    middle: Size | None
    frames: Frames
    seed: Seed
    bit_depth: BitDepth
    full_well_e: Positive
    read_noise_dn: NonNegative
    aperture: Aperture | None
    calibration: Annotated[Mapping[str, Any], DocInfo("numbers of captures by kind, calibration.dark=4")]
    snapshots: Repeats
    device: Name


def mismatch(composition: Composition) -> None:
    """Run every camera with every decoder; what has a record is not computed again.

    Raises:
        MachineFailure: cases failed; the others have their records.
    """
    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.studies.engine import FailedCase, run_cases
    from sci_lightning.studies.mismatch.prepare import Score, prepare
    from sci_lightning.studies.mismatch.records import mismatch_records
    from sci_lightning.studies.mismatch.summary import summary_table

    out, console = Path(composition.cfg.out), PlainConsole()
    decoders = {name: _decoder(composition, name) for name in _names(composition)}
    prepared = prepare(plain(composition.cfg), composition.choice("data"), out, _command(composition))
    records = mismatch_records(out / "cases")
    cases = [
        prepared.case(camera, name, described)
        for name, (_, described) in decoders.items()
        for camera in prepared.cameras  # of which the first decoder's cases make the diagnoses
    ]
    cfg = composition.cfg
    missing = records.missing(cases, cfg.job)
    waiting = {case.name for case in missing}
    for before in records.all_of([case for case in cases if case.name not in waiting], console.print):
        console.say(styled(before.camera), f", {before.decoder}: {_line(before.as_json())}, done before")
    columns = (BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left:"), TimeRemainingColumn())
    with Progress(*columns, TextColumn("{task.description}"), console=console, speed_estimate_period=3600) as progress:
        task = progress.add_task("", total=len(missing))
        prepared.protocol.on_progress = lambda line: progress.update(task, description=line)
        prepared.protocol.on_result = console.print
        work = Score(prepared, {name: decoder for name, (decoder, _) in decoders.items()}, records)
        for ended in run_cases(work, missing, records, cfg.workers, cfg.threads, cfg.job):
            if isinstance(ended, FailedCase):
                console.say(styled("failed", "red"), f" {ended}")
            else:
                console.say(styled(ended.camera), f", {ended.decoder}: {_line(ended.as_json())}")
            progress.advance(task)
    if not (done := records.all_of(cases, console.print)):
        return
    heading, *rows = summary_table([record.as_json() for record in done])
    table = Table(*heading, title="mean PSNR of the scenes (dB)", title_justify="left")
    for row in rows:
        table.add_row(*row)
    console.print(table)
    console.say(styled(out), ": cases/ (a record for every camera and decoder), cameras/ (diagnoses)")
    for path in sorted(out.glob("cameras/*/calibrated/encoder.yaml"))[:1]:
        paths: dict[str, str | Path] = {"ckpt_path": "RUN/checkpoints/last.ckpt", "encoder": path}
        print_next(console, invocation("train", "experiment=finetune", paths=paths))


def _names(composition: Composition) -> list[str]:
    """Return the decoders that were chosen, in order and each once."""
    return list(dict.fromkeys(composition.cfg.decoders or [composition.choice("decoder")]))


def _decoder(composition: Composition, name: str) -> tuple[Decoder, dict[str, Any]]:
    """Return a decoder, filled with its weights if it has any, and what identifies it."""
    from sci_lightning.decoder.complexity import count_parameters
    from sci_lightning.studies.mismatch.prepare import trained_decoder

    weights = plain(composition.cfg.weights)
    if unknown := sorted(weights.keys() - set(_names(composition))):
        raise BadInput(f"weights.{unknown[0]}: decoder={','.join(_names(composition))} does not name this decoder")
    own = [word for word in composition.overrides if word.lstrip("+~").startswith(("decoder.", "frames="))]
    own_composition = compose("mismatch", [f"decoder={name}", *own])
    config = own_composition.cfg
    if name in weights:
        changed = plain(config.decoder) if any("decoder." in word for word in own) else None
        return trained_decoder(str(weights[name]), name, tuple(composition.cfg.trusted), changed)
    decoder: Decoder = built(config, "decoder")
    if parameters := count_parameters(decoder):
        raise BadInput(
            f"decoder={name} has {parameters:,} parameters to learn: train it first, and give "
            f"+weights.{name}=RUN/checkpoints/last.ckpt"
        )
    return decoder.eval(), {"decoder": plain(config.decoder)}


def _line(record: Mapping[str, Any]) -> str:
    """Return the mean PSNR of every scenario, and what the diagnoses won back."""
    from sci_lightning.studies.mismatch.scenarios import SCENARIOS

    parts = [f"{SCENARIOS[key].title} {scores['mean']['psnr']:.2f}" for key, scores in record["scenarios"].items()]
    parts += [f"{kind} recovers {100 * part:.1f} %" for kind, part in record.get("recovery", {}).items()]
    return f"{', '.join(parts)} ({record['seconds']:.0f} s)"


def _command(composition: Composition) -> str:
    """Return the command line without the places of this machine, and how many processes shared the work."""
    words = [word for word in composition.overrides if "/" not in word.partition("=")[2]]
    words = [word for word in words if word.partition("=")[0] not in ("workers", "threads", "job")]
    return shlex.join(["python", "-m", "sci_lightning.mismatch", *words])


def list_decoders(words: list[str]) -> list[str]:
    """Return the words of a command line with ``decoder=a,b`` as ``decoder=a`` and ``'decoders=[a,b]'``, no sweep."""
    listed = []
    for word in words:
        key, _, value = word.partition("=")
        several = key == "decoder" and "," in value
        listed += [f"decoder={value.partition(',')[0]}", f"decoders=[{value}]"] if several else [word]
    return listed


def main() -> None:
    """Run the command."""
    if not {"-m", "--multirun"} & set(sys.argv):
        sys.argv[1:] = list_decoders(sys.argv[1:])
    run("mismatch", mismatch)
