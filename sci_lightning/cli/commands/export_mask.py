"""``python -m sci_lightning.export_mask``: a trained mask as the files that a modulator displays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sci_lightning.cli.composition import Composition
from sci_lightning.cli.settings import CommandSettings, Name
from sci_lightning.configuration.bounds import ExistingPath, NonNegative, Positive, Repeats, Size
from sci_lightning.console import PlainConsole, styled


@dataclass(frozen=True)
class ExportMaskSettings(CommandSettings):
    ckpt_path: ExistingPath
    trusted: Sequence[Name]
    repeat: Repeats
    canvas: Size | None
    frame_rate: Positive
    binary_rate: Positive
    gray_rate: Positive
    order: Literal["msb_first", "lsb_first"]
    reset_time: NonNegative


def export_mask(composition: Composition) -> None:
    """Write bit planes, 8-bit frames and ``planes.json``, read the planes back, and say whether the timing fits."""
    import torch

    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.errors import MachineFailure
    from sci_lightning.files.modulator_files import Layout, read_planes, timing_of, write_planes
    from sci_lightning.runs.checkpoint import read_checkpoint

    cfg = composition.cfg
    out, console = Path(cfg.out), PlainConsole()
    module = read_checkpoint(cfg.ckpt_path, cfg.trusted).encoder().mask
    with torch.no_grad():
        mask = module()
    bits = getattr(module, "bits", 1)
    height, width = module.size
    canvas = (cfg.repeat * height, cfg.repeat * width) if cfg.canvas is None else tuple(cfg.canvas)
    layout = Layout((height, width), cfg.repeat, canvas)
    timing = timing_of(module.frames, bits, cfg.frame_rate, cfg.binary_rate, cfg.gray_rate, cfg.reset_time)
    write_planes(mask, bits, out, layout, timing, cfg.order)
    if not torch.equal(read_planes(out), mask):
        raise MachineFailure(f"{out}: the planes do not read back as the mask; is the disk full?")
    console.print(f"{module.frames} slots of {bits} bit, {height} x {width}, on {canvas[0]} x {canvas[1]} mirrors")
    for way, what in (("planes", "by_planes"), ("gray_frames", "by_gray_frames")):
        fits = "fits" if getattr(timing, f"{way}_fit") else styled("too fast", "red")
        most = getattr(timing, f"fastest_{what}_Hz")
        console.say(f"{cfg.frame_rate:g} snapshots/s by {way}: ", fits, f", at most {most:.1f}")
    if bits > 1 or timing.phased_reset_slots:
        effects = f"bit_planes.order={cfg.order}, phased_reset.delay={timing.phased_reset_slots:.3g}"
        console.print(f"the encoder's effects of this display: {effects}")
    console.say(styled(out), ": planes/, frames/, planes.json (exposure of each plane; timing)")
    words = (*composition.trusted(), "measurement=SNAPSHOT.tiff")
    print_next(console, invocation("reconstruct", *words, paths={"ckpt_path": cfg.ckpt_path}))
