"""``python -m sci_lightning.virtual_camera``: captures of a camera in which effects are hidden."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

from sci_lightning.cli.composition import Composition, plain
from sci_lightning.cli.settings import Aperture, BitDepth, CommandSettings, Count, Name, NamedOrPath
from sci_lightning.configuration.bounds import Bits, Frames, NonNegative, Positive, Repeats, Seed, Size
from sci_lightning.console import PlainConsole, styled


@dataclass(frozen=True)
class VirtualCameraSettings(CommandSettings):
    seed: Seed
    effects: Any
    number: Count
    magnitude: Name
    size: Size
    frames: Frames
    bit_depth: BitDepth
    mask: NamedOrPath
    bits: Bits
    dark: Count
    flat: Count
    all_on: Count
    all_off: Count
    pattern: Count | None
    static: Count
    dynamic: Count
    unknown: Count
    aperture: Aperture
    dark_exposures: Sequence[Positive]
    full_well_e: Positive
    read_noise_dn: NonNegative
    datasheet: bool
    oversampling: Repeats
    datasheet_factor: Positive
    formulation: Name
    surround: Name


def virtual_camera(composition: Composition) -> None:
    """Write a captures file and its truth file; print where they are, but not what is hidden."""
    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.virtual_camera import Session, VirtualCamera

    cfg = composition.cfg
    given = plain(cfg)
    settings: dict[str, Any] = {field.name: given[field.name] for field in fields(Session)}
    settings = {name: tuple(value) if isinstance(value, list) else value for name, value in settings.items()}
    camera = VirtualCamera(Session(**settings), given["effects"], given["number"], given["magnitude"])
    simulation = camera.simulate(given["seed"])
    truth = simulation.write(cfg.out)
    console = PlainConsole()
    count, height, width = simulation.measurement.shape
    slots, bits = camera.session.frames, camera.session.bit_depth
    console.print(f"{count} captures of {height} x {width}, {slots} slots each, {bits} bits")
    console.say(styled(cfg.out), "; what is hidden in it: ", styled(truth))
    print_next(console, invocation("diagnose", paths={"captures": cfg.out}))
