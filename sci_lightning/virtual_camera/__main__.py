"""``python -m sci_lightning.virtual_camera``: captures of a camera in which effects are hidden."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition, plain
from sci_lightning.cli.console import PlainConsole, styled


def virtual_camera(composition: Composition) -> None:
    """Write a captures file and beside it what is hidden in it; say where, but not what.

    Args:
        composition: of ``conf/virtual_camera.yaml``.
    """
    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.virtual_camera import Session, capture_session, write_captures

    cfg = composition.cfg
    given = plain(cfg)
    settings: dict[str, Any] = {
        field.name: tuple(value) if isinstance(value := given[field.name], list) else value for field in fields(Session)
    }
    session = Session(**settings)
    captures = capture_session(
        session, given["effects"], given["seed"], number=given["number"], magnitude=given["magnitude"]
    )
    truth = write_captures(cfg.out, captures)
    console = PlainConsole()
    count, height, width = captures.measurement.shape
    console.print(f"{count} captures of {height} x {width}, {session.frames} slots each, {session.bit_depth} bits")
    console.say(styled(cfg.out), "; what is hidden in it: ", styled(truth))
    print_next(console, invocation("diagnose", paths={"captures": cfg.out}))


if __name__ == "__main__":
    run("virtual_camera", virtual_camera)
