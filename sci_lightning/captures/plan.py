"""The plan of a calibration session: what to display, what to put before the camera, and which file to save it as."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from PIL import Image
from scipy.ndimage import gaussian_filter

from sci_lightning.captures.recipe import FILE
from sci_lightning.errors import BadInput, MachineFailure
from sci_lightning.files.mask_file import read_mask_file

COMPARED = 5
"""Captures of a kind from which one is left for verification: a diagnosis keeps one in five of a kind."""

MOST_CAPTURES = 1000
"""More than anybody records in a session."""

REGISTRATION = (
    "5. The mirrors are not the camera's pixels: `python -m sci_lightning.captures register FOLDER` finds where they",
    "   lie in its field from these recordings, and writes `sensor_to_modulator` into `captures.yaml`.",
)
"""Step of the shot list where the modulator has a grid of its own."""


@dataclass(frozen=True)
class Shot:
    """One row of the shot list; it is recorded ``count`` times with the same settings.

    Attributes:
        name: files to save are ``shots/<name>_<number>.tif``.
        kind: label of the captures, see :mod:`sci_lightning.captures.kind`.
        count: recordings.
        sequence: pattern of every slot as ``captures.yaml`` says it; None: the coding patterns in their order.
        display: the same in words.
        scene: irradiance of an even scene, or the target's file; 1.0 fills the sensor's range.
        aperture: light relative to nominal.
        exposure: integration time relative to nominal.
        reveals: what only this kind of capture shows.
    """

    name: str
    kind: str
    count: int
    sequence: str | tuple[int | str, ...] | None
    display: str
    scene: float | str
    aperture: float
    exposure: float
    reveals: str


@dataclass(frozen=True)
class Plan:
    """A calibration session.

    Attributes:
        patterns: the coding patterns, uint8 (T, H, W); 255 is a transmittance of 1.
        targets: pictures to show, uint8 (K, H, W) of the camera's field; 255 is the irradiance 1.0.
        shots: the shot list in the order in which it is recorded.
        bit_depth: of the camera.
        datasheet: ``read_noise_dn`` and ``full_well_e`` where they are known.
        field: (H, W) of the camera in pixels; None: every mirror is a pixel.
    """

    patterns: np.ndarray
    targets: np.ndarray
    shots: tuple[Shot, ...]
    bit_depth: int
    datasheet: dict[str, float]
    field: tuple[int, int] | None = None

    @property
    def captures(self) -> int:
        """Number of recordings."""
        return sum(shot.count for shot in self.shots)


def plan_session(
    patterns: np.ndarray,
    *,
    seed: int,
    bit_depth: int,
    datasheet: dict[str, float],
    dark: int,
    long_dark: int,
    long_exposure: float,
    flat: int,
    all_on: int,
    all_off: int,
    target: int,
    field: Sequence[int] | None = None,
) -> Plan:
    """Return a session that shows every effect of the vocabulary, with the captures of most dark signal first.

    The light of the captures behind the coding patterns is chosen so that a white scene fills the sensor's range on
    average: their aperture is 1 / mean over pixels of sum over t of pattern t.

    Args:
        patterns: coding patterns, (T, H, W) in [0, 1]; they are rounded to the 8 bits that a display has.
        seed: of the targets.
        bit_depth: of the camera.
        datasheet: ``read_noise_dn`` and ``full_well_e`` where they are known.
        dark, flat, all_on, all_off, target: number of captures, see ``conf/captures_plan.yaml``; besides them, every
            coding pattern is recorded once in a slot of its own.
        long_dark: number of dark captures of ``long_exposure`` times the integration time.
        field: (H, W) of the camera in pixels where the modulator's mirrors are not its pixels; the targets are of this
            size. None: that of the patterns.

    Raises:
        BadInput: a pattern that is dark everywhere, no captures or too many.
    """
    if not 0 < (total := dark + long_dark + flat + all_on + all_off + target) <= MOST_CAPTURES:
        raise BadInput(f"{total} captures besides those of single patterns, expected 1 to {MOST_CAPTURES:,}")
    levels = np.round(255 * patterns).astype(np.uint8)
    slots = len(levels)
    for slot, level in enumerate(levels):
        if not level.any():
            raise BadInput(f"mask: pattern {slot} is dark everywhere; a coding pattern must open somewhere")
    coded = round(1 / float((levels / 255).sum(0).mean()), 6)
    shots = [
        Shot("dark", "dark", dark, "all_off", "all mirrors off", 0.0, coded, 1.0, "black level, read noise, offsets"),
        Shot("long_dark", "dark", long_dark, "all_off", "all mirrors off", 0.0, coded, long_exposure, "dark current"),
    ]
    for number, level in enumerate(_levels(flat), 1):
        reveals = "gain, response, PRNU, vignetting"
        shots.append(Shot(f"flat_{number}", "flat", 1, None, "coding patterns", level, coded, 1.0, reveals))
    for number, level in enumerate(_levels(all_on), 1):
        reveals = "even light, saturation, shot noise"
        shots.append(Shot(f"all_on_{number}", "flat", 1, "all_on", "all mirrors on", level, 1 / slots, 1.0, reveals))
    for number, level in enumerate(_levels(all_off), 1):
        reveals = "contrast of the mirrors, stray light"
        shots.append(Shot(f"all_off_{number}", "pattern", 1, "all_off", "all mirrors off", level, 1.0, 1.0, reveals))
    for slot in range(slots):
        sequence = tuple(slot if other == slot else "all_off" for other in range(slots))
        display = f"coding pattern {slot} in slot {slot}, the other slots off"
        reveals = "where the mask's image lies, its sharpness, its timing"
        shots.append(Shot(f"slot_{slot}", "pattern", 1, sequence, display, 0.9, 1.0, 1.0, reveals))
    size = (levels.shape[1], levels.shape[2]) if field is None else (int(field[0]), int(field[1]))
    targets = _targets(np.random.default_rng(seed), target, size)
    for number in range(1, target + 1):
        file, reveals = f"targets/target_{number}.png", "blur of the lens, position of the scene"
        shots.append(Shot(f"target_{number}", "static", 1, None, "coding patterns", file, coded, 1.0, reveals))
    kept = tuple(shot for shot in shots if shot.count)
    return Plan(levels, targets, kept, bit_depth, datasheet, None if field is None else size)


def read_coding_patterns(path: str | Path) -> np.ndarray:
    """Return the coding patterns of a file, (T, H, W) float64 in [0, 1]; raises BadInput as ``read_mask_file`` does."""
    return read_mask_file(path).astype(np.float64)


def random_binary(seed: int, frames: int, size: Sequence[int]) -> np.ndarray:
    """Return random patterns (T, H, W) of 0 and 1 with equal probability."""
    return np.random.default_rng(seed).integers(2, size=(frames, *size)).astype(np.float64)


def write_plan(plan: Plan, folder: str | Path) -> None:
    """Write ``plan.md``, ``captures.yaml``, ``patterns/``, ``targets/`` and an empty ``shots/``, all of them or none.

    Args:
        plan: the session.
        folder: a new folder, or an empty one.

    Raises:
        BadInput: the folder has contents, or lies in a file.
        MachineFailure: the disk is full or write-protected.
    """
    folder = Path(folder)
    if folder.resolve() == Path.cwd():
        raise BadInput(f"{folder}: is the current folder; name a new one")
    if folder.is_symlink() or folder.is_file() or (folder.is_dir() and any(folder.iterdir())):
        raise BadInput(f"{folder}: is there already; name a new folder, so that no recordings are lost")
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = Path(tempfile.mkdtemp(prefix=f".{folder.name}_", dir=folder.parent))
    except FileExistsError as error:
        raise BadInput(f"{folder}: {error.filename} is a file, expected a folder") from error
    except OSError as error:
        raise MachineFailure(f"{folder}: {error.strerror}") from error
    try:
        _write(plan, temporary)
        temporary.chmod(0o755)
        os.replace(temporary, folder)
    except OSError as error:
        raise MachineFailure(f"{folder}: {error.strerror}") from error
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def _write(plan: Plan, folder: Path) -> None:
    (folder / "shots").mkdir()
    blank = np.zeros(plan.patterns.shape[1:], np.uint8)
    pictures = {f"patterns/slot_{slot:02d}.png": pattern for slot, pattern in enumerate(plan.patterns)}
    pictures |= {"patterns/off.png": blank, "patterns/on.png": blank + 255}
    pictures |= {f"targets/target_{number}.png": target for number, target in enumerate(plan.targets, 1)}
    for name, picture in pictures.items():
        (folder / name).parent.mkdir(exist_ok=True)
        Image.fromarray(picture).save(folder / name)
    (folder / "plan.md").write_text(shot_list(plan), encoding="utf-8")
    (folder / FILE).write_text(recipe_text(plan), encoding="utf-8")


def recipe_text(plan: Plan) -> str:
    """Return the ``captures.yaml`` of the session, which :func:`~sci_lightning.captures.pack.pack_captures` reads."""
    top: dict[str, object] = {"bit_depth": plan.bit_depth, **plan.datasheet, "frames": len(plan.patterns)}
    top["patterns"] = ["patterns/slot_*.png", "all_off", "all_on"]
    head = yaml.safe_dump(top, sort_keys=False, default_flow_style=None)
    lines = [yaml.safe_dump(_entry(shot), sort_keys=False, default_flow_style=True, width=1000) for shot in plan.shots]
    return (
        "# Written by `captures plan`. Where a recording differs from the plan, say here what was done.\n"
        f"{head}captures:\n" + "".join(f"  - {line}" for line in lines)
    )


def _entry(shot: Shot) -> dict[str, object]:
    entry: dict[str, object] = {"measurement": f"shots/{shot.name}_*.tif", "kind": shot.kind}
    if shot.sequence is not None:
        entry["sequence"] = shot.sequence if isinstance(shot.sequence, str) else list(shot.sequence)
    entry["scene"] = shot.scene
    entry |= {name: value for name, value in (("aperture", shot.aperture), ("exposure", shot.exposure)) if value != 1}
    return entry


def shot_list(plan: Plan) -> str:
    """Return the shot list as Markdown: how to set the light, then a row for every shot."""
    slots, *mirrors = plan.patterns.shape
    height, width = plan.field or mirrors
    own_grid = "" if plan.field is None else f" behind {mirrors[0]} x {mirrors[1]} mirrors"
    full = 2**plan.bit_depth - 1
    level = round(0.95 * full)
    registration: Sequence[str] = () if plan.field is None else REGISTRATION
    last = 6 if registration else 5
    few = [shot.name for shot in plan.shots if shot.name in ("dark", "long_dark") and shot.count < COMPARED]
    rows = [
        f"| {number} | `shots/{shot.name}_*.tif` | {shot.count} | {shot.display} | {_before_the_camera(shot)} "
        f"| {shot.aperture:.4g} | {shot.exposure:.4g} | {shot.reveals} |"
        for number, shot in enumerate(plan.shots, 1)
    ]
    lines = [
        "# Shot list",
        "",
        f"{plan.captures} captures of {height} x {width} pixels{own_grid}, {slots} slots, {plan.bit_depth} bits.",
        "",
        "1. Warm the camera up; switch off automatic exposure, gain, gamma, black level, denoising and compression.",
        "2. Set the light: with all mirrors on (`patterns/on.png` in every slot) and the aperture of that row, an even",
        f"   scene of irradiance 0.95 should read about {level} of {full} DN. The other irradiances are in proportion",
        "   to this light: dim the lamp, and measure it with a light meter.",
        "3. The aperture is the light relative to that of aperture 1: change it by the lamp, filters or the lens,",
        "   never by the camera's gain. The exposure is the integration time relative to the nominal one; where a",
        "   longer one gathers more light, the aperture says so: twice the time at the same lamp is aperture 2.",
        "4. Save raw DN as TIFF, one file a capture: `shots/dark_1.tif`, `shots/dark_2.tif` and so on.",
        *registration,
        f"{last}. Change `captures.yaml` wherever you did something else, then run",
        "   `python -m sci_lightning.captures pack FOLDER out=lab.h5`; it names the file that is missing or unlikely.",
        "",
        "| | save as | captures | modulator | before the camera | aperture | exposure | reveals |",
        "| ---: | --- | ---: | --- | --- | ---: | ---: | --- |",
        *rows,
        "",
        "A diagnosis opens one in five captures of each kind only at its end, for verification.",
    ]
    if few:
        lines += ["", f"{' and '.join(few)}: fewer than {COMPARED} captures leave none of them for verification."]
    return "\n".join(lines) + "\n"


def _before_the_camera(shot: Shot) -> str:
    if isinstance(shot.scene, str):
        return f"`{shot.scene}`, filling the field"
    return "cap on" if shot.kind == "dark" else f"even scene, irradiance {shot.scene:g}"


def _levels(count: int) -> list[float]:
    """Return irradiances spread evenly over 0.1 to 0.95; a single one is the brightest."""
    return [round(float(level), 3) for level in (np.linspace(0.1, 0.95, count) if count > 1 else [0.95] * count)]


def _targets(random: np.random.Generator, count: int, size: tuple[int, ...]) -> np.ndarray:
    """Return pictures (K, H, W) with edges and grains of 1 to 6 pixels, from 5 % to 95 % of the range."""
    targets = np.empty((count, *size), np.uint8)
    for number in range(count):
        fine = gaussian_filter(random.random(size), random.uniform(0.8, 1.5), mode="wrap")
        coarse = gaussian_filter(random.random(size), random.uniform(3, 6), mode="wrap")
        edges = np.where(coarse > np.median(coarse), 1.0, 0.0)
        ranks = np.argsort(np.argsort(fine, None)).reshape(size) / fine.size
        mixed = 0.6 * gaussian_filter(edges, 0.5, mode="wrap") + 0.4 * ranks
        targets[number] = np.round(255 * (0.05 + 0.9 * mixed))
    return targets
