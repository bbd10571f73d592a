"""``python -m sci_lightning.design_mask``: the mask with the best score that a search finds, before any training."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

from rich.progress import Progress

from sci_lightning.cli.composition import Composition, plain
from sci_lightning.cli.settings import Aperture, BitDepth, CommandSettings, NamedOrPath
from sci_lightning.configuration.bounds import Bits, Frames, NonNegative, Positive, Repeats, Seed, Share, Size
from sci_lightning.console import PlainConsole, styled


@dataclass(frozen=True)
class DesignMaskSettings(CommandSettings):
    frames: Frames
    size: Size
    kind: Literal["structural", "binary"]
    bits: Bits
    density: Share
    tile: Any
    steps: Repeats
    bit_depth: BitDepth
    read_noise: NonNegative
    full_well: Positive | None
    aperture: Aperture | None
    prior: NamedOrPath | None
    seed: Seed


def design_mask(composition: Composition) -> None:
    """Write ``mask.npy`` (T, H, W), ``mask.mat`` (H, W, T), ``design.json`` and pictures of the mask."""
    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.studies.mask_design import design_mask as design_and_write

    cfg, console = plain(composition.cfg), PlainConsole()
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task("Designing", total=cfg["steps"])

        def show(step: int, reached: float) -> None:
            progress.update(bar, completed=step, description=f"Designing: {reached:.2f} dB")

        design = design_and_write(cfg, show)
    console.print(
        f"{cfg['kind']} mask of {design.bits} bit, {cfg['frames']} slots, tile {cfg['tile'][0]} x {cfg['tile'][1]}: "
        f"expected PSNR of the best linear decoder {design.score_db:.2f} dB, of the random start "
        f"{design.random_start_db:.2f} dB"
    )
    console.say(styled(design.folder), ": mask.npy, mask.mat, mask.png, design.json")
    _, height, width = design.mask.shape
    place = [f"frames={cfg['frames']}", f"size=[{height},{width}]"]
    words = ["decoder=linear", "encoder=rbw_sr", "encoder/mask=measured", "data=synthetic", *place]
    print_next(console, invocation("evaluate", *words, paths={"encoder.mask.file": design.folder / "mask.npy"}))
