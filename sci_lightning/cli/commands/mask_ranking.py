"""``python -m sci_lightning.tables.mask_ranking``: scores of many masks, and what a network reaches.

The network is trained anew behind every mask, for the same processor time on the same clips. The rank correlation
of score and PSNR says whether the score predicts which mask is better.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition
from sci_lightning.cli.settings import CommandSettings
from sci_lightning.configuration.bounds import Depth, ExistingPath, Frames, Pixels, Positive, Seed, Width
from sci_lightning.console import PlainConsole
from sci_lightning.errors import BadInput
from sci_lightning.files.json_file import JsonObject, read_json, says
from sci_lightning.plain_text import excerpt

if TYPE_CHECKING:
    import torch

FILE = "mask_ranking.json"
SETTINGS = ("frames", "side", "channels", "blocks", "first_estimate", "seconds", "seed")
"""What all masks of one ranking share."""


@dataclass(frozen=True)
class MaskRankingSettings(CommandSettings):
    """Types and ranges of ``conf/mask_ranking.yaml``, which states the defaults and what they mean."""

    root: ExistingPath
    val_root: ExistingPath
    frames: Frames
    side: Pixels
    channels: Width
    blocks: Depth
    first_estimate: Literal["published", "linear"]
    seconds: Positive
    seed: Seed


class RankedMask(JsonObject):
    """What is kept of one mask, in a file of its name."""

    mask: str
    score_dB: float = says("expected of a linear decoder", ge=-1e3, le=1e3)
    psnr_dB: float = says("that the network reached", ge=-1e3, le=1e3)
    settings: dict[str, Any] = says("what all masks of one ranking share", default={})


def mask_ranking(composition: Composition) -> None:
    """Train behind every mask that has no file yet, and write ``mask_ranking.json``.

    Args:
        composition: of ``conf/mask_ranking.yaml``.
    """
    from scipy.stats import spearmanr

    from sci_lightning.data import Folder
    from sci_lightning.files.json_file import write_json
    from sci_lightning.prior import MaskScore

    cfg, console, out = composition.cfg, PlainConsole(), Path(composition.cfg.out)
    side = (cfg.side, cfg.side)
    source = Folder(cfg.root, cfg.frames, side, side, cfg.seed, val_root=cfg.val_root, clips_per_epoch=1)
    score = MaskScore(cfg.frames)
    rows: list[dict[str, Any]] = []
    settings = {key: cfg[key] for key in SETTINGS}
    for name, mask in masks(cfg.frames, cfg.side, cfg.seed):
        file = out / f"{name}.json"
        if not file.is_file():
            row = {"mask": name, "score_dB": float(score(mask)), "psnr_dB": trained_psnr(mask, source, cfg)}
            write_json({**row, "settings": settings}, file)
        rows.append(_row(file, settings))
        console.print(f"{name}: score {rows[-1]['score_dB']:.2f} dB, trained {rows[-1]['psnr_dB']:.2f} dB")
    scores, reached = ([row[key] for row in rows] for key in ("score_dB", "psnr_dB"))
    rank, p_value = spearmanr(scores, reached)
    content = {"rank_correlation": float(rank), "p_value": float(p_value), "settings": settings, "masks": rows}
    write_json(content, out / FILE)
    console.print(f"rank correlation of {len(rows)} masks: {rank:.2f} (p = {p_value:.2g}); {out / FILE}")


def _row(file: Path, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return what is kept of a mask.

    Raises:
        BadInput: it is unreadable, or was measured with other settings: one ranking cannot hold both.
    """
    content = read_json(file, RankedMask)
    earlier = content.settings
    if different := [key for key in settings if key in earlier and earlier[key] != settings[key]]:
        were = ", ".join(f"{key}={excerpt(str(earlier[key]))}" for key in different)
        raise BadInput(f"{file}: measured with {were}; give these, or another folder with out=")
    return {"mask": content.mask, "score_dB": content.score_dB, "psnr_dB": content.psnr_dB}


def masks(frames: int, side: int, seed: int) -> Iterator[tuple[str, torch.Tensor]]:
    """Yield names and masks ``(T, side, side)`` of different kinds: random and designed, free and tiled, 24 of them."""
    import torch

    from sci_lightning.encoder.mask import design_binary, design_structural
    from sci_lightning.encoder.mask.structure import structure, uniform

    whole, tile = (frames, side, side), (frames, 8, 8)

    def repeated(pattern: torch.Tensor) -> torch.Tensor:
        return pattern.repeat(1, -(-side // 8), -(-side // 8))[:, :side, :side]

    for density in (0.15, 0.3, 0.5, 0.7):
        yield f"random_binary_{density}", (uniform(whole, seed) < density).float()
        yield f"random_binary_tile_{density}", repeated((uniform(tile, seed) < density).float())
    row = (uniform((1, side, side + frames), seed) < 0.5).float()
    yield "shifted_binary", torch.cat([row[..., slot : slot + side] for slot in range(frames)])
    yield "open_shutter", torch.ones(whole)
    for bits in (1, 2, 3, 4, 8):
        yield f"random_structural_{bits}", structure(uniform(whole, seed), bits)
    for bits in (1, 4):
        yield f"random_structural_tile_{bits}", repeated(structure(uniform(tile, seed), bits))
    yield "sharp_structural_4", structure(uniform(whole, seed) ** 4, 4)
    for steps in (10, 200):
        for bits in (2, 4):
            yield f"designed_structural_{bits}_{steps}", repeated(design_structural(frames, bits, steps=steps).levels)
    yield "designed_structural_1", repeated(design_structural(frames, 1, steps=128).levels)
    yield "designed_binary_0.5", repeated(design_binary(frames, 0.5, steps=128).levels)


def trained_psnr(mask: torch.Tensor, source: Any, cfg: Any) -> float:
    """Return the mean PSNR in dB on the source's scenes of a small network trained behind a mask, through 8-bit SR.

    Args:
        mask: ``(T, H, W)``.
        source: of clips and scenes of this size.
        cfg: the settings of ``conf/mask_ranking.yaml``.
    """
    import torch

    from sci_lightning.decoder import E2ECNN
    from sci_lightning.encoder import Encoder
    from sci_lightning.encoder.mask import Measured
    from sci_lightning.encoder.sensor import ClipQuantise
    from sci_lightning.pipeline import Pipeline

    torch.manual_seed(cfg.seed)
    fixed = Measured(None, cfg.frames, mask.shape[1:])
    fixed.pattern.copy_(mask)
    decoder = E2ECNN(cfg.frames, cfg.channels, cfg.blocks, first_estimate=cfg.first_estimate)
    pipeline = Pipeline(Encoder(fixed, ClipQuantise(8)), decoder)
    optimiser = torch.optim.Adam(decoder.parameters(), lr=1e-3)
    clips, number, start = source.clips(), 0, time.process_time()
    while (spent := (time.process_time() - start) / cfg.seconds) < 1:
        video = torch.stack([clips[number + index] for index in range(4)])
        number += 4
        for group in optimiser.param_groups:
            group["lr"] = 1e-3 * min(1.0, 20 * spent + 0.05) * (1 - 0.95 * spent)
        optimiser.zero_grad()
        (pipeline(video) - video).square().mean().backward()
        optimiser.step()
    errors = []
    with torch.no_grad():
        for scene in source.scenes():
            for index in range(len(scene.video)):
                video = scene.video[index][None]
                errors.append((pipeline(video).clamp(0, 1) - video).square().mean((2, 3)).log10().mul(-10).mean())
    return float(torch.stack(errors).mean())


def main() -> None:
    """Run the command."""
    run("mask_ranking", mask_ranking)
