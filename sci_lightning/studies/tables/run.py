"""What one run found, read from its ``metrics.json``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput
from sci_lightning.files.folder import files_below
from sci_lightning.files.json_fields import Fields, read_json

NAMES = ("metrics.json", "seed[0-9]*.json")
"""Files of runs: what a run leaves, and what is kept of the rows of the tables (docs/results/tables/)."""
MOST_SCENES = 10_000
MOST_EFFECTS = 64
SHOWN = 5
"""Files of no use that are named in the one line that says that there are no others."""
LARGEST_SCORE = 1e6
LARGEST_COUNT = 10**18
"""Of parameters and multiply-accumulates."""
LARGEST_FRAMES = 10_000
PAPERS_FRAMES = 8
"""T of the paper's tables, which is not repeated in the description of a setting."""


@dataclass(frozen=True)
class Setting:
    """What runs must share to be averaged or compared.

    Attributes:
        scale: of ``conf/scale``, with the core minutes of a training that was given so many; "own" is none of these.
        frames: T, frames of one snapshot.
        size: (H, W) of the tested frames.
        scenes: names of the tested scenes.
        conventions: of the scores, by metric.
    """

    scale: str
    frames: int
    size: tuple[int, int]
    scenes: tuple[str, ...]
    conventions: tuple[tuple[str, str], ...]

    def __str__(self) -> str:
        number = len(self.scenes)
        frames = "" if self.frames == PAPERS_FRAMES else f"T = {self.frames}, "
        return f"{self.scale}: {frames}{' x '.join(map(str, self.size))}, {number} scene{'s' * (number != 1)}"


@dataclass(frozen=True)
class Run:
    """One ``metrics.json``.

    Attributes:
        path: of the file.
        fields: what rows and columns are matched by: ``encoder``, ``decoder``, ``test_encoder``, the mask's class
            ``mask``, and its ``bits`` (1 for masks that have none). An encoder with effects is not the paper's: its
            name carries them, as in ``lsw_sr + mask_shift``; so does the name of a decoder that was fine-tuned to
            another camera or assumes another one in the test. Texts hold no control characters.
        setting: see :class:`Setting`.
        parameters: of the decoder, which runs of one row must share as well.
        macs: its multiply-accumulates for one measurement of the mask's size.
        seed: of the training.
        scores: mean over the scenes, by metric.
        scenes: scores by metric, of each scene.
        baseline: the same of the mean measurement in every frame, which trained decoders beat; empty if not stated.
        seconds: to decode one measurement.
        device: on which it was decoded.
        training_steps: of the optimiser; None where the run did not record them.
        mask_score: expected PSNR of the best linear decoder behind the mask, in dB; None where it was not computed.
    """

    path: Path
    fields: Mapping[str, str | int]
    setting: Setting
    parameters: int
    macs: int
    seed: int
    scores: Mapping[str, float]
    scenes: Mapping[str, Mapping[str, float]]
    baseline: Mapping[str, float]
    seconds: float
    device: str
    training_steps: int | None = None
    mask_score: float | None = None

    @property
    def group(self) -> tuple[Setting, int]:
        """What runs must have in common to be averaged or compared."""
        return self.setting, self.parameters


def read_run(path: str | Path) -> Run:
    """Read a ``metrics.json``, which may come from anybody: every entry is checked, and no path in it is followed.

    Raises:
        BadInput: unreadable, no JSON, not what ``train`` and ``evaluate`` write, or an entry of another type or out of
            bounds.
    """
    content = read_json(path)
    if (content.content.get("format"), content.content.get("format_version")) != ("sci-metrics", 1):
        raise BadInput(
            f"{path}: not the metrics of a run: expected format sci-metrics 1, which train and evaluate write"
        )
    return _run(content)


def find_runs(folders: Iterable[str | Path]) -> tuple[list[Run], list[str]]:
    """Every ``metrics.json`` below the folders, and a line for each that is of no use.

    Of several runs that differ in nothing but their place, the latest counts.

    Raises:
        BadInput: none is of use.
    """
    runs: dict[Any, Run] = {}
    lines: list[str] = []
    paths: list[Path] = []
    empty: list[str] = []
    for folder in map(Path, folders):
        files = files_below(folder, *NAMES)
        if not files:
            empty.append(f"{folder}: {f'no {NAMES[0]} in it' if folder.is_dir() else 'no such folder'}")
        paths += files
    for path in sorted(paths, key=lambda path: path.stat().st_mtime):
        try:
            run = read_run(path)
        except BadInput as error:
            lines.append(str(error))
            continue
        key = (tuple(sorted(run.fields.items())), run.group, run.seed)
        if key in runs and runs[key].path.resolve() != path.resolve():
            lines.append(f"{runs[key].path}: {path} is the same row and seed, and later")
        runs[key] = run
    lines += empty
    if not runs:
        more = [f"and {len(lines) - SHOWN} more"] if len(lines) > SHOWN else []
        reasons = "; ".join([*lines[:SHOWN], *more]) or "runs= is empty"
        raise BadInput(f"no runs: {reasons}; give runs=DIR of train or of a sweep")
    return list(runs.values()), lines


def _run(content: Fields) -> Run:
    config = content.part("config")
    tested = config.part("evaluate", optional=True)
    encoder = config.part("encoder")
    mask = encoder.part("mask")
    name = content.text("test_encoder")
    fields: dict[str, str | int] = {
        "encoder": content.text("encoder") + _effects(encoder),
        "decoder": content.text("decoder") + _departures(config, tested),
        "test_encoder": name + _tested_effects(config, name),
        "mask": mask.text("_target_").rpartition(".")[2],
        "bits": mask.whole("bits", 1, 64, default=1),
    }
    conventions = content.part("conventions", optional=True)
    scale = config.text("scale", "own")
    if "core_minutes" in config:
        scale += f", {config.number('core_minutes', 0, 1e9):g} core minutes"
    elif (steps := config.part("trainer", optional=True).whole("max_steps", -1, LARGEST_COUNT, default=-1)) > 0:
        scale += f", {steps} steps"
    scenes = content.part("scenes")
    setting = Setting(
        scale=scale,
        frames=config.whole("frames", 1, LARGEST_FRAMES, default=PAPERS_FRAMES),
        size=(tested if "size" in tested else config).size("size"),
        scenes=tuple(sorted(scenes.names()[:MOST_SCENES])),
        conventions=tuple(sorted((key, conventions.text(key)) for key in conventions.names())),
    )
    return Run(
        path=content.path,
        fields=fields,
        setting=setting,
        parameters=content.whole("parameters", 0, LARGEST_COUNT),
        macs=content.whole("macs", 0, LARGEST_COUNT),
        seed=config.whole("seed", -(2**63), 2**64),
        scores=_scores(content.part("mean")),
        scenes={name: _scores(scenes.part(name)) for name in setting.scenes},
        baseline=_scores(content.part("baseline", optional=True)),
        seconds=content.number("seconds_per_measurement", 0, 1e9),
        device=content.text("device"),
        training_steps=content.whole("training_steps", 0, LARGEST_COUNT) if "training_steps" in content else None,
        mask_score=content.number("mask_score", -LARGEST_SCORE, LARGEST_SCORE) if "mask_score" in content else None,
    )


def _scores(part: Fields) -> dict[str, float]:
    return {key: part.number(key, -LARGEST_SCORE, LARGEST_SCORE) for key in part.names()}


def _departures(config: Fields, tested: Fields) -> str:
    """What was done with a decoder that is not in the paper, as it follows its name."""
    finetuned = " + fine-tuning" if config.content.get("finetune") is True else ""
    return finetuned + (" + assumed camera" if tested.content.get("camera") else "")


def _effects(encoder: Fields) -> str:
    """The effects of an encoder as they follow its name; one that is null is none."""
    effects = encoder.part("effects", optional=True)
    return "".join(f" + {name}" for name in effects.names()[:MOST_EFFECTS] if name in effects)


def _tested_effects(config: Fields, name: str) -> str:
    """The effects of the encoder that was tested with: of ``evaluate``, of ``test_encoders``, or the trained one's."""
    tested, others = config.part("evaluate", optional=True), config.part("test_encoders", optional=True)
    if "captures" in tested:  # a real camera's, which nobody knows
        return ""
    places = ((tested, "encoder"), (others, name), (config, "encoder"))
    return _effects(next(part.part(key) for part, key in places if key in part))
