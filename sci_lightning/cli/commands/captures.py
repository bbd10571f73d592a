"""``python -m sci_lightning.captures``: plan a session, pack and register what was recorded, see what is in a file."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from annotated_types import DocInfo, Len

from sci_lightning.cli.command import run
from sci_lightning.cli.command_line import with_keys
from sci_lightning.cli.composition import Composition
from sci_lightning.cli.next_command import invocation, nearest, print_next
from sci_lightning.cli.settings import BitDepth, CommandSettings, Count, NamedOrPath
from sci_lightning.configuration.bounds import ExistingPath, Frames, NonNegative, Positive, Seed, Size
from sci_lightning.console import PlainConsole, styled, warn
from sci_lightning.plain_text import one_printable_line

USAGE = """python -m sci_lightning.captures plan FOLDER            write a session's shot list and what to display
python -m sci_lightning.captures pack FOLDER out=FILE   make one captures file of a folder of pictures
python -m sci_lightning.captures register PLACE         find where the mirrors lie in a file's or folder's field
python -m sci_lightning.captures info FILE              check a captures file, sum it up and draw its contact sheet

Each takes --help, which lists its settings."""


@dataclass(frozen=True)
class CapturesInfoSettings(CommandSettings):
    captures: ExistingPath


@dataclass(frozen=True)
class CapturesPackSettings(CommandSettings):
    folder: ExistingPath


@dataclass(frozen=True)
class CapturesPlanSettings(CommandSettings):
    mask: NamedOrPath | None
    size: Size
    frames: Frames
    field: Size | None
    seed: Seed
    bit_depth: BitDepth
    read_noise_dn: NonNegative | None
    full_well_e: Positive | None
    dark: Count
    long_dark: Count
    long_exposure: Positive
    flat: Count
    all_on: Count
    all_off: Count
    target: Count


@dataclass(frozen=True)
class CapturesRegisterSettings(CommandSettings):
    captures: ExistingPath
    perspective: bool
    pitch: Annotated[Sequence[Positive], Len(2, 2), DocInfo("two positive numbers [ACROSS,DOWN]")] | None
    again: bool


def plan(composition: Composition) -> None:
    """Write the plan of a calibration session into a new folder."""
    from sci_lightning.captures.plan import plan_session, random_binary, read_coding_patterns, write_plan

    cfg, console = composition.cfg, PlainConsole()
    counts = ("dark", "long_dark", "flat", "all_on", "all_off", "target")
    session = plan_session(
        random_binary(cfg.seed, cfg.frames, cfg.size) if cfg.mask is None else read_coding_patterns(cfg.mask),
        seed=cfg.seed,
        bit_depth=cfg.bit_depth,
        datasheet={name: cfg[name] for name in ("read_noise_dn", "full_well_e") if cfg[name] is not None},
        long_exposure=cfg.long_exposure,
        field=cfg.field,
        **{name: cfg[name] for name in counts},
    )
    write_plan(session, cfg.out)
    console.print(f"{session.captures} captures to record, {len(session.shots)} settings")
    console.say(styled(Path(cfg.out)), ": plan.md, captures.yaml, patterns/, targets/, shots/")
    if cfg.field is None:
        print_next(console, invocation("captures", "pack", nearest(cfg.out), "out=lab.h5"))
    else:
        print_next(console, invocation("captures", "register", nearest(cfg.out)))


def pack(composition: Composition) -> None:
    """Pack a folder into a captures file and print what went in."""
    from sci_lightning.captures.pack import pack_captures
    from sci_lightning.captures.table import summary_lines

    cfg, console = composition.cfg, PlainConsole()
    for line in summary_lines(pack_captures(cfg.folder, cfg.out, on_warning=warn)):
        console.print(line)
    console.print(styled(cfg.out))
    print_next(console, invocation("diagnose", paths={"captures": cfg.out}))


def register(composition: Composition) -> None:
    """Find the homography of a captures file's patterns, print what it means, and write it into the file."""
    from sci_lightning.captures.registration import register as find_homography
    from sci_lightning.captures.registration.registration import read_unregistered, write_homography
    from sci_lightning.homography import covered, pixels_per_mirror

    cfg, console = composition.cfg, PlainConsole()
    captures = read_unregistered(cfg.captures, cfg.again)
    pitch = None if cfg.pitch is None else (float(cfg.pitch[0]), float(cfg.pitch[1]))
    registration = find_homography(captures, cfg.perspective, pitch, on_progress=console.print)
    across, down = pixels_per_mirror(registration.matrix, captures.size)
    part = covered(registration.matrix, captures.size, captures.mirrors).mean()
    written = write_homography(cfg.captures, registration.matrix)
    bent = (
        f"lens distortion {registration.distortion:+.3f}, residual without it"
        if registration.distortion
        else "residual"
    )
    console.print(
        f"{captures.mirrors[0]} x {captures.mirrors[1]} mirrors of {across:.4g} x {down:.4g} pixels (wide, high) cover "
        f"{100 * part:.0f} % of the field; {bent} {registration.residual:.2f} pixels, correlation "
        f"{registration.correlation:.3f}, from {len(registration.captures)} captures"
    )
    console.say(styled(written), ": sensor_to_modulator")
    if Path(cfg.captures).is_dir():
        print_next(console, invocation("captures", "pack", nearest(cfg.captures), "out=lab.h5"))
    else:
        print_next(console, invocation("diagnose", paths={"captures": cfg.captures}))


def info(composition: Composition) -> None:
    """Print the table of a captures file and write its contact sheet."""
    from sci_lightning.captures.contact_sheet import contact_sheet
    from sci_lightning.captures.read import read_captures
    from sci_lightning.captures.table import summary_lines, summary_table

    cfg = composition.cfg
    captures = read_captures(cfg.captures)
    sheet = Path(cfg.out)
    if sheet.suffix.lower() != ".png":
        sheet /= "contact_sheet.png"
    console = PlainConsole()
    console.print(summary_table(captures))
    for line in summary_lines(captures):
        console.print(line)
    left_out = contact_sheet(sheet, captures)
    console.say(styled(sheet), f" ({left_out} captures left out)" if left_out else "")
    print_next(console, invocation("diagnose", paths={"captures": cfg.captures}))


COMMANDS = {
    "plan": (plan, "out"),
    "pack": (pack, "folder"),
    "register": (register, "captures"),
    "info": (info, "captures"),
}
"""Function of every command, and the setting that its plain word stands for."""


def main() -> None:
    """Run ``plan``, ``pack``, ``register`` or ``info`` with the words that follow it."""
    program, name, *words = sys.argv if len(sys.argv) > 1 else (*sys.argv, "nothing")
    if name in ("--help", "-h"):
        print(USAGE)
        return
    if name not in COMMANDS:
        print(
            f"error: {one_printable_line(name)}: no such command; choose plan, pack, register or info", file=sys.stderr
        )
        sys.exit(2)
    task, key = COMMANDS[name]
    sys.argv = [program, *with_keys(words, [key])]
    run(f"captures_{name}", task)
    if name == "pack" and {"--help", "-h"} & set(words):
        from sci_lightning.captures import recipe

        print(f"\n{recipe.__doc__}")
