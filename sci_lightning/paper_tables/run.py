"""What one run found, read from its ``metrics.json``."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput

NAME = "metrics.json"


@dataclass(frozen=True)
class Setting:
    """What runs must share to be averaged or compared.

    Attributes:
        scale: of ``conf/scale``; "own" is none of these.
        size: (H, W) of the tested frames.
        scenes: names of the tested scenes.
        conventions: of the scores, by metric.
    """

    scale: str
    size: tuple[int, ...]
    scenes: tuple[str, ...]
    conventions: tuple[tuple[str, str], ...]

    def __str__(self) -> str:
        number = len(self.scenes)
        return f"{self.scale}: {' x '.join(map(str, self.size))}, {number} scene{'s' * (number != 1)}"


@dataclass(frozen=True)
class Run:
    """One ``metrics.json``.

    Attributes:
        path: of the file.
        fields: what rows and columns are matched by: ``encoder``, ``decoder``, ``test_encoder``, the mask's class
            ``mask``, and its ``bits`` (1 for masks that have none). An encoder with effects is not the paper's: its
            name carries them.
        setting: see :class:`Setting`.
        parameters: of the decoder, which runs of one row must share as well.
        macs: its multiply-accumulates for one measurement of the mask's size.
        seed: of the training.
        scores: mean over the scenes, by metric.
        baseline: the same of the mean measurement in every frame, which trained decoders beat; empty if not told.
        seconds: to decode one measurement.
        device: on which it was decoded.
    """

    path: Path
    fields: Mapping[str, str | int]
    setting: Setting
    parameters: int
    macs: int
    seed: int
    scores: Mapping[str, float]
    baseline: Mapping[str, float]
    seconds: float
    device: str

    @property
    def group(self) -> tuple[Setting, int]:
        """What runs must have in common to be averaged or compared."""
        return self.setting, self.parameters


def read_run(path: Path) -> Run:
    """Read a ``metrics.json``.

    Raises:
        BadInput: unreadable, no JSON, or not what ``train`` and ``evaluate`` write.
    """
    try:
        content = json.loads(path.read_text())
    except (OSError, ValueError) as error:
        raise BadInput(f"{path}: not readable as JSON ({error}); run it again, or leave it out") from error
    about = (content.get("format"), content.get("format_version")) if isinstance(content, dict) else None
    if about != ("sci-metrics", 1):
        raise BadInput(
            f"{path}: not the metrics of a run: expected format sci-metrics 1, which train and evaluate write"
        )
    try:
        return _run(path, content)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInput(f"{path}: incomplete metrics ({type(error).__name__}: {error}); run it again") from error


def find_runs(folders: Iterable[Path]) -> tuple[list[Run], list[str]]:
    """Every ``metrics.json`` below the folders, and a line for each that is of no use.

    Of several runs that differ in nothing but their place, the latest counts.

    Raises:
        BadInput: none is of use.
    """
    runs: dict[Any, Run] = {}
    lines: list[str] = []
    for folder in folders:
        files = sorted(folder.rglob(NAME), key=lambda path: path.stat().st_mtime)
        if not files:
            lines.append(f"{folder}: {f'no {NAME} in it' if folder.is_dir() else 'no such folder'}")
        for path in files:
            try:
                run = read_run(path)
            except BadInput as error:
                lines.append(str(error))
                continue
            key = (tuple(sorted(run.fields.items())), run.group, run.seed)
            if key in runs and runs[key].path.resolve() != path.resolve():
                lines.append(f"{runs[key].path}: left out, {path} is the same row and seed, and later")
            runs[key] = run
    if not runs:
        raise BadInput(f"no runs: {'; '.join(lines) or 'runs= is empty'}; give runs=DIR of train or of a sweep")
    return list(runs.values()), lines


def _run(path: Path, content: Mapping[str, Any]) -> Run:
    config = content["config"]
    tested = config.get("evaluate", {})
    mask = config["encoder"]["mask"]
    fields = {
        "encoder": content["encoder"] + _effects(config["encoder"]),
        "decoder": content["decoder"],
        "test_encoder": content["test_encoder"] + _effects(tested.get("encoder") or config["encoder"]),
        "mask": mask["_target_"].rpartition(".")[2],
        "bits": mask.get("bits", 1),
    }
    setting = Setting(
        scale=config.get("scale", "own"),
        size=tuple(int(side) for side in tested.get("size") or config["size"]),
        scenes=tuple(sorted(content["scenes"])),
        conventions=tuple(sorted(content.get("conventions", {}).items())),
    )
    told = (content["mean"], content.get("baseline", {}))
    scores, baseline = ({str(key): float(value) for key, value in found.items()} for found in told)
    return Run(
        path=path,
        fields=fields,
        setting=setting,
        parameters=int(content["parameters"]),
        macs=int(content["macs"]),
        seed=int(config["seed"]),
        scores=scores,
        baseline=baseline,
        seconds=float(content["seconds_per_measurement"]),
        device=str(content["device"]),
    )


def _effects(encoder: Mapping[str, Any]) -> str:
    return "".join(f"+{name}" for name in encoder.get("effects", {}))
