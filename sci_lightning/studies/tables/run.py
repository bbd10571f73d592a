"""What one run found, read from its ``metrics.json``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from sci_lightning.errors import BadInput
from sci_lightning.files.folder import files_below, is_inside
from sci_lightning.files.json_file import LONGEST_TEXT, check_part, read_json
from sci_lightning.plain_text import excerpt
from sci_lightning.runs.provenance import Provenance
from sci_lightning.runs.results import MOST, RunMetrics

NAMES = ("metrics.json", "seed[0-9]*.json")
"""Files of runs: what a run leaves, and what is kept of the rows of the tables (docs/results/tables/)."""
MOST_SCENES = 10_000
MOST_EFFECTS = 64
SHOWN = 5
"""Files of no use that are named in the one line that says that there are no others."""
PAPERS_FRAMES = 8
"""T of the paper's tables, which is not repeated in the description of a setting."""


@dataclass(frozen=True)
class RunSetting:
    """What runs must share to be averaged or compared.

    Attributes:
        scale: of ``conf/scale``, with the core minutes of a training that was given so many; "own" is none of these.
        frames: T, frames of one snapshot.
        size: (H, W) of the tested frames.
        scenes: names of the tested scenes.
        conventions: of the scores, by metric.
        recipe: what all of them may share or not besides, in words: ``masks tiled 8 x 8`` or ``untiled masks``, and
            ``linear first estimate``.
    """

    scale: str
    frames: int
    size: tuple[int, int]
    scenes: tuple[str, ...]
    conventions: tuple[tuple[str, str], ...]
    recipe: tuple[str, ...] = ()

    def __str__(self) -> str:
        number = len(self.scenes)
        frames = "" if self.frames == PAPERS_FRAMES else f"T = {self.frames}, "
        size = f"{frames}{' x '.join(map(str, self.size))}, {number} scene{'s' * (number != 1)}"
        return ", ".join([f"{self.scale}: {size}", *self.recipe])


@dataclass(frozen=True)
class ScoredRun:
    """One ``metrics.json``.

    Attributes:
        path: of the file.
        fields: what rows and columns are matched by: ``encoder``, ``decoder``, ``test_encoder``, the mask's class
            ``mask``, and its ``bits`` (1 for masks that have none). An encoder with effects is not the paper's: its
            name carries them, as in ``lsw_sr + mask_shift``; so does the name of a decoder that was fine-tuned to
            another camera or assumes another one in the test. Texts hold no control characters.
        setting: see :class:`RunSetting`.
        parameters: of the decoder, which runs of one row must share as well.
        macs: its multiply-accumulates for one measurement of the mask's size.
        seed: of the training.
        scores: mean over the scenes, by metric.
        scenes: scores by metric, of each scene.
        baseline: the same of the mean measurement in every frame, which trained decoders beat; empty if not stated.
        seconds: to decode one measurement.
        device: on which it was decoded.
        training_steps: of the optimiser; None where the run did not record them.
        computation: of the training in operations, 6 for each multiply-accumulate of decoding its clips (one forward
            pass, a backward pass twice as long, two operations each); None where its clips are not known.
        variant: what tells apart runs of the same fields and setting, in words: ``designed start``, ``aperture 1/T``.
        mask_score: expected PSNR of the best linear decoder behind the mask, in dB; None where it was not computed.
        provenance: of a row that is kept; None of others.
    """

    path: Path
    fields: Mapping[str, str | int]
    setting: RunSetting
    parameters: int
    macs: int
    seed: int
    scores: Mapping[str, float]
    scenes: Mapping[str, Mapping[str, float]]
    baseline: Mapping[str, float]
    seconds: float
    device: str
    training_steps: int | None = None
    computation: float | None = None
    variant: tuple[str, ...] = ()
    mask_score: float | None = None
    provenance: Provenance | None = None

    @property
    def group(self) -> tuple[RunSetting, int, tuple[str, ...]]:
        """What runs must have in common to be averaged."""
        return self.setting, self.parameters, self.variant

    @property
    def checkpoint(self) -> Path | None:
        """The checkpoint that the training left beside it; a link out of the run's folder is not followed."""
        path = self.path.parent / "checkpoints" / "last.ckpt"
        return path if is_inside(path, self.path.parent) else None


def _checked_name(name: str) -> str:
    if not name.isprintable():
        raise ValueError("a name that is not printable")
    return name


Name = Annotated[str, Field(max_length=LONGEST_TEXT), AfterValidator(_checked_name)]
Score = Annotated[float, Field(ge=-1e6, le=1e6)]
Size = Annotated[list[Annotated[int, Field(ge=1, le=100_000)]], Field(min_length=2, max_length=2)]


class _Part(BaseModel):
    """The entries of an object that runs are compared by; others are passed over."""

    model_config = ConfigDict(strict=True)


class _Mask(_Part):
    target: str = Field(alias="_target_", max_length=LONGEST_TEXT)
    bits: int | None = Field(None, ge=1, le=64)
    tile: Size | None = None
    start: Name = "published"


class _Camera(_Part):
    effects: dict[Name, Any] | None = None
    aperture: float | Name | None = None
    known: bool = Field(True, alias="told")


class _Encoder(_Camera):
    mask: _Mask


class _Decoder(_Part):
    first_estimate: Name = "published"


class _Tested(_Part):
    encoder: _Camera | None = None
    size: Size | None = None
    captures: Any = None
    camera: Any = None


class _Trainer(_Part):
    max_steps: int | None = Field(None, ge=-1, le=MOST)
    accumulate_grad_batches: int = Field(1, ge=1, le=MOST)


class _Config(_Part):
    encoder: _Encoder
    decoder: _Decoder = _Decoder()
    evaluate: _Tested | None = None
    test_encoders: dict[str, _Camera | None] | None = None
    trainer: _Trainer | None = None
    scale: str | None = Field(None, max_length=LONGEST_TEXT)
    core_minutes: float | None = Field(None, ge=0, le=1e9)
    frames: int | None = Field(None, ge=1, le=10_000)
    size: Size
    crop: Size | None = None
    batch_size: int | None = Field(None, ge=1, le=MOST)
    seed: int = Field(ge=-(2**63), le=2**64)
    finetune: Any = None


class _Metrics(_Part):
    """What tables take from a :class:`RunMetrics`, within bounds that a table can show."""

    encoder: Name
    decoder: Name
    test_encoder: Name
    scenes: dict[Name, dict[Name, Score]]
    mean: dict[Name, Score]
    conventions: dict[Name, str] = {}
    baseline: dict[Name, Score] = {}
    seconds_per_measurement: float = Field(ge=0, le=1e9)
    device: str
    parameters: int
    macs: int
    training_steps: int | None = None
    clips_seen: int | None = None
    mask_score: Score | None = None
    provenance: Provenance | None = None
    config: _Config


def read_run(path: str | Path) -> ScoredRun:
    """Read a ``metrics.json``, which may come from anybody: every entry is checked, and no path in it is followed.

    Raises:
        BadInput: unreadable, no JSON, not what ``train`` and ``evaluate`` write, or an entry of another type or out of
            bounds.
    """
    path = Path(path)
    metrics = read_json(path, RunMetrics)
    return _run(path, check_part(path, "", metrics.as_json(), _Metrics))


def find_runs(folders: Iterable[str | Path]) -> tuple[list[ScoredRun], list[str]]:
    """Every ``metrics.json`` below the folders, and a line for each that is of no use.

    Of several runs that differ in nothing but their place, the latest counts.

    Raises:
        BadInput: none is of use.
    """
    runs: dict[Any, ScoredRun] = {}
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


def _run(path: Path, metrics: _Metrics) -> ScoredRun:
    config = metrics.config
    tested = config.evaluate or _Tested()
    fields: dict[str, str | int] = {
        "encoder": excerpt(metrics.encoder) + _effects(config.encoder),
        "decoder": excerpt(metrics.decoder)
        + (" + fine-tuning" if config.finetune is True else "")
        + (" + assumed camera" if tested.camera else ""),
        "test_encoder": excerpt(metrics.test_encoder) + _effects(_tested_camera(config, tested, metrics.test_encoder)),
        "mask": excerpt(config.encoder.mask.target.rpartition(".")[2]),
        "bits": config.encoder.mask.bits or 1,
    }
    scale, steps = excerpt(config.scale or "own"), config.trainer.max_steps if config.trainer else None
    if config.core_minutes is not None:
        scale += f", {config.core_minutes:g} core minutes"
    elif steps is not None and steps > 0:
        scale += f", {steps} steps"
    clips, crop = metrics.clips_seen, config.crop or config.size
    if clips is None and metrics.training_steps is not None and config.batch_size:
        accumulated = config.trainer.accumulate_grad_batches if config.trainer else 1
        clips = metrics.training_steps * config.batch_size * accumulated
    part = crop[0] * crop[1] / (config.size[0] * config.size[1])  # macs are those of the mask's size
    height, width = tested.size or config.size
    mask, camera = config.encoder.mask, _tested_camera(config, tested, metrics.test_encoder)
    recipe = []
    if "tile" in mask.model_fields_set:
        recipe.append(f"masks tiled {mask.tile[0]} x {mask.tile[1]}" if mask.tile else "untiled masks")
    recipe += [f"{excerpt(config.decoder.first_estimate)} first estimate"] * (
        config.decoder.first_estimate != "published"
    )
    variant = [f"{excerpt(mask.start)} start"] * (mask.start != "published")
    if camera and camera.aperture not in (None, "auto", 1):
        variant.append(f"aperture {excerpt(str(camera.aperture))}" + ("" if camera.known else ", not told"))
    setting = RunSetting(
        scale=scale,
        frames=config.frames or PAPERS_FRAMES,
        size=(height, width),
        scenes=tuple(sorted(list(metrics.scenes)[:MOST_SCENES])),
        conventions=tuple(sorted((key, excerpt(text)) for key, text in metrics.conventions.items())),
        recipe=tuple(recipe),
    )
    return ScoredRun(
        path=path,
        fields=fields,
        setting=setting,
        parameters=metrics.parameters,
        macs=metrics.macs,
        seed=config.seed,
        scores=metrics.mean,
        scenes={name: metrics.scenes[name] for name in setting.scenes},
        baseline=metrics.baseline,
        seconds=metrics.seconds_per_measurement,
        device=excerpt(metrics.device),
        training_steps=metrics.training_steps,
        computation=None if clips is None else 6.0 * metrics.macs * part * clips,
        variant=tuple(variant),
        mask_score=metrics.mask_score,
        provenance=metrics.provenance,
    )


def _effects(camera: _Camera | None) -> str:
    """The effects of an encoder as they follow its name; one that is null is none."""
    effects = (camera.effects if camera else None) or {}
    names = [name for name, effect in effects.items() if effect is not None]
    return "".join(f" + {name}" for name in names[:MOST_EFFECTS])


def _tested_camera(config: _Config, tested: _Tested, name: str) -> _Camera | None:
    """The encoder that was tested with: of ``evaluate``, of ``test_encoders``, or the trained one."""
    if tested.captures is not None:  # a real camera's, which nobody knows
        return None
    return tested.encoder or (config.test_encoders or {}).get(name) or config.encoder
