"""``python -m sci_lightning.diagnose``: where do captures and model disagree, and which effect is missing?"""

from __future__ import annotations

import shlex
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from annotated_types import DocInfo

from sci_lightning.cli.composition import Composition, plain
from sci_lightning.cli.settings import BitDepth, CommandSettings, Count, Name, NamedOrPath, Offset
from sci_lightning.configuration.bounds import ExistingPath, Frames, NonNegative, Positive, Seed, Size, Step
from sci_lightning.console import PlainConsole, styled
from sci_lightning.diagnosis.search_settings import SearchSettings

if TYPE_CHECKING:
    from omegaconf import DictConfig

    from sci_lightning.captures import Captures
    from sci_lightning.diagnosis.blind.blind_diagnosis import BlindDiagnosis
    from sci_lightning.diagnosis.diagnosis import Diagnosis
    from sci_lightning.diagnosis.report.snapshot_report import SnapshotReport
    from sci_lightning.encoder.effects import Effect


PART = "covered_snapshots.npy"
"""File of the part of the snapshots that the mask covers; no name that snapshots themselves are likely to have."""
OF_MASK = ("mask_key", "mask_dark", "mask_white", "mask_step", "mask_origin", "mask_slots", "verification")
OF_SNAPSHOTS = ("key", "bit_depth", "raw_format", "raw_size", "mask", *OF_MASK)
"""Settings that say how snapshots and masks of separate files are read."""
FACTS = "snapshots.json"
"""File of what snapshots tell by themselves."""


@dataclass(frozen=True)
class DiagnoseSettings(CommandSettings):
    search: SearchSettings
    captures: ExistingPath | None
    measurement: ExistingPath | None
    key: Name | None
    raw_format: Name | None
    raw_size: Size | None
    bit_depth: BitDepth | None
    mask: NamedOrPath | None
    mask_key: Name | None
    mask_dark: NonNegative | None
    mask_white: Positive | None
    mask_step: Step | None
    mask_origin: Offset | None
    mask_slots: Frames | None
    verification: Sequence[Count] | None
    seed: Seed
    budget: Positive | None
    prior: NamedOrPath | None
    free_forms: bool
    candidates: Annotated[Mapping[str, Name], DocInfo("effects of your own, +candidates.mine=my_module.Mine")]
    leave_out: Sequence[Name]


@dataclass(frozen=True)
class Given:
    """What was read.

    Attributes:
        captures: to be diagnosed; None where no mask is given, so that there is nothing more to diagnose.
        snapshots: what those of unknown scenes tell by themselves; None where there are none.
        is_part: whether the captures hold a part of the snapshots only, that which the mask covers.
    """

    captures: Captures | None
    snapshots: SnapshotReport | None = None
    is_part: bool = False


def diagnose(composition: Composition) -> None:
    """Write ``report.html``, ``report.json``, ``encoder.yaml`` and pictures, and print what was found.

    Captures of which no scene is known are diagnosed blind. Of snapshots without a mask only ``snapshots.json`` is
    written: what they tell by themselves.
    """
    from sci_lightning.cli.next_command import invocation, nearest, print_next
    from sci_lightning.diagnosis.report.pictures import figures
    from sci_lightning.diagnosis.report.report import log_diagnosis, write_report
    from sci_lightning.diagnosis.report.report_folder import check_no_foreign_report, report_folder
    from sci_lightning.diagnosis.report.report_page import ReportProvenance
    from sci_lightning.diagnosis.report.terminal import print_report, search_progress
    from sci_lightning.diagnosis.vocabulary import vocabulary
    from sci_lightning.files.stored_array import readable_shape

    cfg = composition.cfg
    start, out, console = time.perf_counter(), Path(cfg.out), PlainConsole()
    candidates = vocabulary(cfg.candidates, composition.targets("effect"), cfg.leave_out)
    check_no_foreign_report(out)
    given = read_input(cfg)
    captures, snapshots = given.captures, given.snapshots
    read = [path.absolute() for name in (cfg.captures, cfg.measurement, cfg.mask) if name for path in _files(name)]

    def write_beside(folder: Path) -> None:
        """Write what was told by the snapshots themselves, and the part of them that was diagnosed."""
        if snapshots is not None:
            snapshots.write(folder / FACTS)
        if given.is_part and captures is not None:
            _write_part(captures, folder)

    if snapshots is not None:
        snapshots.print(console)
    if captures is None:
        with report_folder(out, read) as folder:
            write_beside(folder)
        console.say(styled(out / FACTS))
        return
    known = bool(captures.known.any())
    if not known:
        console.say("no scene is known: the diagnosis is blind")
    with search_progress(console, cfg.search.max_effects) as on_progress:
        result = _diagnosed(captures, candidates, cfg, on_progress)
        on_progress("writing the report")
        drawn = figures(result)
        with report_folder(out, read) as folder:
            provenance = ReportProvenance(
                file=Path(cfg.captures or cfg.measurement).name,
                name=captures.name,
                date=datetime.now(timezone.utc).isoformat(timespec="seconds"),
                runtime_s=time.perf_counter() - start,
                command=shlex.join(["python", "-m", "sci_lightning.diagnose", *composition.overrides]),
            )
            write_report(result, folder, provenance, drawn)
            write_beside(folder)
    if cfg.get("logger"):
        from sci_lightning.training.loggers import build_loggers  # and with it Lightning, which takes seconds

        for logger in build_loggers(plain(cfg.logger), "diagnosis"):
            log_diagnosis(logger, result, drawn)
    print_report(result, console)
    console.say(styled(out / "report.html"), "; beside it report.json, encoder.yaml and pictures")
    if given.is_part:
        pixels = readable_shape(captures.size)
        console.say(styled(out / PART), f": the {pixels} pixels of the snapshots that the mask covers")
    lines = [invocation("train", "experiment=quickstart", paths={"encoder": out / "encoder.yaml"})]
    if result.verdict == "undecided":
        lines = []
    # a report on unknown scenes has no chi2 to be revealed
    if known and cfg.captures and (truth := Path(cfg.captures).with_suffix(".truth.json")).is_file():
        lines.append(invocation("virtual_camera.reveal", nearest(truth), nearest(out / "report.json")))
    print_next(console, *lines)


def _diagnosed(
    captures: Captures, candidates: Mapping[str, type[Effect]], cfg: DictConfig, on_progress: Callable[[str], None]
) -> Diagnosis | BlindDiagnosis:
    """Return the diagnosis of the captures with known scenes, or of all where no scene is known."""
    from sci_lightning.diagnosis import diagnosis as library
    from sci_lightning.diagnosis.blind.blind_diagnosis import diagnose_blind
    from sci_lightning.diagnosis.blind.prior import scene_statistics
    from sci_lightning.errors import BadInput

    settings = SearchSettings(**cfg.search)
    if captures.known.any():
        if cfg.prior is not None:
            raise BadInput(f"prior={cfg.prior}: the scenes are known, so that nothing is assumed of them; leave it out")
        return library.diagnose(captures, candidates, cfg.seed, cfg.free_forms, settings, on_progress, cfg.budget)
    if cfg.budget is not None:
        raise BadInput(f"budget={cfg.budget:g}: no scene is known, and the search has no budget then; leave it out")
    if cfg.free_forms:
        raise BadInput("free_forms=true: no scene is known, so that nothing without a name is looked for; leave it out")
    statistics = None if cfg.prior is None else scene_statistics(cfg.prior)
    return diagnose_blind(captures, candidates, cfg.seed, settings, on_progress, statistics)


def _files(name: str) -> list[Path]:
    """Return the files of a name or a pattern."""
    from sci_lightning.files.picture_file import matching_files

    return [Path(path) for path in matching_files(name)]


def _write_part(captures: Captures, out: Path) -> None:
    """Write the part of the snapshots that was diagnosed, which is what the corrected camera records."""
    import numpy as np

    from sci_lightning.files.atomic_file import atomic_write

    with atomic_write(out / PART) as temporary, temporary.open("wb") as file:
        np.save(file, captures.measurement)


def read_input(cfg: DictConfig) -> Given:
    """Return the captures to diagnose, and what those of unknown scenes tell by themselves.

    Args:
        cfg: ``captures``, or ``measurement`` with ``mask`` and what belongs to them.

    Raises:
        BadInput: both or neither, or files that cannot be used.
    """
    from sci_lightning.captures import read_captures
    from sci_lightning.captures.snapshots import captures_of_snapshots, read_snapshots
    from sci_lightning.diagnosis.blind.snapshot_facts import snapshot_facts
    from sci_lightning.diagnosis.report.snapshot_report import SnapshotReport
    from sci_lightning.errors import BadInput
    from sci_lightning.files.packed_file import raw_layout
    from sci_lightning.files.picture_file import matching_files

    if (cfg.captures is None) == (cfg.measurement is None):
        raise BadInput(
            "give captures=FILE.h5, or measurement=FILE mask=FILE for snapshots of unknown scenes (one of the two)"
        )
    of_files = [key for key in OF_SNAPSHOTS if cfg[key] is not None]
    if cfg.captures is not None and of_files:
        raise BadInput(
            f"{of_files[0]}={cfg[of_files[0]]}: belongs to measurement=; a captures file holds its mask and "
            "what belongs to it: leave this out"
        )
    of_mask = [key for key in of_files if key in OF_MASK]
    if cfg.mask is None and of_mask:
        raise BadInput(f"{of_mask[0]}={cfg[of_mask[0]]}: belongs to a mask; give mask=FILE as well")
    if cfg.captures is not None:
        captures = read_captures(cfg.captures)
        unknown = ~captures.known
        if not unknown.any():
            return Given(captures)
        facts = snapshot_facts(captures.measurement[unknown], captures.bit_depth, str(cfg.captures))
        return Given(captures, SnapshotReport(facts, Path(cfg.captures).name, True, not unknown.all()))
    raw = raw_layout(cfg.raw_format, cfg.raw_size)
    dn, bit_depth = read_snapshots(matching_files(cfg.measurement), cfg.key, cfg.bit_depth, raw)
    facts = snapshot_facts(dn, bit_depth, str(cfg.measurement))
    name = Path(cfg.measurement).name
    if cfg.mask is None:
        return Given(None, SnapshotReport(facts, name, False, False))
    captures = captures_of_snapshots(
        dn,
        bit_depth,
        cfg.mask,
        key=cfg.mask_key,
        levels=(cfg.mask_dark, cfg.mask_white),
        step=cfg.mask_step,
        origin=cfg.mask_origin,
        slots=cfg.mask_slots,
        verification=cfg.verification,
        name=name,
    )
    is_part = captures.measurement.shape != dn.shape
    return Given(captures, SnapshotReport(facts, name, True, False), is_part)
