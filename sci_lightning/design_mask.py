"""``python -m sci_lightning.design_mask``: the mask with the best score that a search finds, before any training."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.progress import Progress

from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition, plain
from sci_lightning.cli.console import PlainConsole, styled


def design_mask(composition: Composition) -> None:
    """Write ``mask.npy`` (T, H, W), ``mask.mat`` (H, W, T), ``design.json`` and pictures of the mask.

    Args:
        composition: of ``conf/design_mask.yaml``.
    """
    import torch

    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.encoder.mask.design import design_binary, design_structural
    from sci_lightning.errors import BadInput
    from sci_lightning.imaging.figures import write_figure
    from sci_lightning.imaging.mask_design_figure import design_figure, write_mask
    from sci_lightning.imaging.patches import MaskScore, SensorNoise
    from sci_lightning.imaging.patches.prior import read_prior
    from sci_lightning.imaging.patches.score import MOST_SLOTS
    from sci_lightning.runs.results import write_json

    cfg = composition.cfg
    out, console = Path(cfg.out), PlainConsole()
    height, width = (int(side) for side in cfg.size)
    if not isinstance(cfg.tile, Sequence) or len(cfg.tile) != 2:
        raise BadInput(f"tile={cfg.tile}: expected two positive whole numbers, height and width, as in 'tile=[8,8]'")
    tile = (int(cfg.tile[0]), int(cfg.tile[1]))
    if cfg.kind not in ("structural", "binary"):
        raise BadInput(f"kind={cfg.kind}: choose structural or binary")
    if not 2 <= cfg.frames <= MOST_SLOTS:
        raise BadInput(
            f"frames={cfg.frames}: must be from 2 to {MOST_SLOTS}, the slots over which a mask can be scored"
        )
    if tile[0] > height or tile[1] > width:
        raise BadInput(f"tile={list(tile)}: larger than the mask, size={[height, width]}")
    prior = None if cfg.prior is None else read_prior(cfg.prior)
    noise = SensorNoise(cfg.bit_depth, cfg.read_noise, cfg.full_well)
    score = MaskScore(cfg.frames, noise, prior, cfg.aperture)
    with Progress(console=console, transient=True) as progress:
        bar = progress.add_task("Designing", total=cfg.steps)

        def show(step: int, reached: float) -> None:
            progress.update(bar, completed=step, description=f"Designing: {reached:.2f} dB")

        search = {"score": score, "steps": cfg.steps, "seed": cfg.seed, "on_progress": show}
        if cfg.kind == "binary":
            design, bits = design_binary(cfg.frames, cfg.density, tile, **search), 1
        else:
            design, bits = design_structural(cfg.frames, cfg.bits, tile, **search), cfg.bits
    repeats = (1, -(-height // tile[0]), -(-width // tile[1]))
    mask = design.levels.repeat(repeats)[:, :height, :width].to(torch.float32)
    write_mask(mask, out)
    title = f"{cfg.kind}, {bits} bit, {cfg.frames} slots: {design.scores[-1]:.2f} dB expected of a linear decoder"
    write_figure(design_figure(mask, tile, bits, title), out / "mask.png")
    content = {
        "format": "sci-mask-design",
        "format_version": 1,
        "score_dB": design.scores[-1],
        "random_start_dB": design.scores[0],
        "steps": len(design.scores) - 1,
        "settings": plain(cfg),
    }
    write_json(content, out / "design.json")
    console.print(
        f"{cfg.kind} mask of {bits} bit, {cfg.frames} slots, tile {tile[0]} x {tile[1]}: expected PSNR of the best "
        f"linear decoder {design.scores[-1]:.2f} dB, of the random start {design.scores[0]:.2f} dB"
    )
    console.say(styled(out), ": mask.npy, mask.mat, mask.png, design.json")
    place = [f"frames={cfg.frames}", f"size=[{height},{width}]"]
    words = ["decoder=linear", "encoder=rbw_sr", "encoder/mask=measured", "data=synthetic", *place]
    print_next(console, invocation("evaluate", *words, paths={"encoder.mask.file": out / "mask.npy"}))


if __name__ == "__main__":
    run("design_mask", design_mask)
