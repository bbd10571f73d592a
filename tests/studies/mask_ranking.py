"""``python -m tests.studies.mask_ranking CLIPS VALIDATION OUT``: does the score of a mask predict which mask is better?

A small network is trained anew behind each of 24 masks, for the same processor time on the same clips. What has a
record in OUT is not trained again; ``mask_ranking.json`` there holds all of them and their rank correlation.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any, Literal

import torch
from scipy.stats import spearmanr

from sci_lightning.data import Folder
from sci_lightning.decoder import E2ECNN
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.mask import Measured, design_binary, design_structural
from sci_lightning.encoder.mask.structure import structure, uniform
from sci_lightning.encoder.sensor import ClipQuantise
from sci_lightning.files.json_file import says, write_json
from sci_lightning.pipeline import Pipeline
from sci_lightning.prior import MaskScore
from sci_lightning.studies.engine import CaseRecord, FailedCase, Records, digest_of, run_cases

SETTINGS: Mapping[str, Any] = {
    "frames": 8,
    "side": 64,
    "channels": 32,
    "blocks": 3,
    "first_estimate": "published",
    "seconds": 75,
    "seed": 0,
}
"""Slots and pixels of clips and masks, the reduced E2E-CNN, the processor time behind one mask, and the seed."""


class RankedMask(CaseRecord):
    """``cases/NAME.json``: what is kept of one mask."""

    format: Literal["sci-ranked-mask"] = "sci-ranked-mask"
    format_version: Literal[1] = 1
    mask: str = says("its name")
    score_dB: float = says("expected of a linear decoder", ge=-1e3, le=1e3)
    psnr_dB: float = says("that the network reached", ge=-1e3, le=1e3)
    settings: dict[str, Any] = says("what all masks of one ranking share")


@dataclass(frozen=True)
class MaskCase:
    """One mask that is scored and trained behind.

    Attributes:
        name: one of :func:`masks`.
        folders: of the clips to train on and of those to test on.
        settings: as :data:`SETTINGS`.
    """

    name: str
    folders: tuple[Path, Path]
    settings: Mapping[str, Any]

    @property
    def digest(self) -> str:
        """Digest of the mask and the shared settings."""
        return digest_of({"mask": self.name, **self.settings})

    def describe(self) -> dict[str, Any]:
        """Return what its record says of it."""
        about = {"format": "sci-ranked-mask", "format_version": 1, "mask": self.name}
        return {**about, "digest": self.digest, "settings": dict(self.settings)}


def rank(case: MaskCase) -> dict[str, float]:
    """Return the score of a mask and what the network reaches behind it, both in dB."""
    settings = case.settings
    frames, side, seed = settings["frames"], settings["side"], settings["seed"]
    (root, validation), size = case.folders, (side, side)
    source = Folder(root, frames, size, size, seed, val_root=validation, clips_per_epoch=1)
    mask = masks(frames, side, seed)[case.name]()
    return {"score_dB": float(MaskScore(frames)(mask)), "psnr_dB": trained_psnr(mask, source, settings)}


def masks(frames: int, side: int, seed: int) -> dict[str, Callable[[], torch.Tensor]]:
    """Return what makes masks ``(T, side, side)``: random and designed ones, free and tiled, 24 of them by name."""
    whole, tile = (frames, side, side), (frames, 8, 8)

    def tiled(make: Callable[[], torch.Tensor]) -> Callable[[], torch.Tensor]:
        return lambda: make().repeat(1, -(-side // 8), -(-side // 8))[:, :side, :side]

    def binary(shape: tuple[int, int, int], density: float) -> torch.Tensor:
        return (uniform(shape, seed) < density).float()

    def structural(shape: tuple[int, int, int], bits: int, sharpness: int = 1) -> torch.Tensor:
        return structure(uniform(shape, seed) ** sharpness, bits)

    def shifted() -> torch.Tensor:
        row = binary((1, side, side + frames), 0.5)
        return torch.cat([row[..., slot : slot + side] for slot in range(frames)])

    def designed(bits: int, steps: int) -> torch.Tensor:
        return design_structural(frames, bits, steps=steps).levels

    made: dict[str, Callable[[], torch.Tensor]] = {}
    for density in (0.15, 0.3, 0.5, 0.7):
        made[f"random_binary_{density}"] = partial(binary, whole, density)
        made[f"random_binary_tile_{density}"] = tiled(partial(binary, tile, density))
    made |= {"shifted_binary": shifted, "open_shutter": partial(torch.ones, whole)}
    for bits in (1, 2, 3, 4, 8):
        made[f"random_structural_{bits}"] = partial(structural, whole, bits)
    for bits in (1, 4):
        made[f"random_structural_tile_{bits}"] = tiled(partial(structural, tile, bits))
    made["sharp_structural_4"] = partial(structural, whole, 4, 4)
    for steps, bits in product((10, 200), (2, 4)):
        made[f"designed_structural_{bits}_{steps}"] = tiled(partial(designed, bits, steps))
    made["designed_structural_1"] = tiled(partial(designed, 1, 128))
    made["designed_binary_0.5"] = tiled(lambda: design_binary(frames, 0.5, steps=128).levels)
    return made


def trained_psnr(mask: torch.Tensor, source: Any, settings: Mapping[str, Any]) -> float:
    """Return the mean PSNR in dB on the source's scenes of a small network trained behind a mask, through 8-bit SR.

    Args:
        mask: ``(T, H, W)``.
        source: of clips and scenes of this size.
        settings: as :data:`SETTINGS`.
    """
    torch.manual_seed(settings["seed"])
    fixed = Measured(None, settings["frames"], mask.shape[1:])
    fixed.pattern.copy_(mask)
    size = settings["channels"], settings["blocks"]
    decoder = E2ECNN(settings["frames"], *size, first_estimate=settings["first_estimate"])
    pipeline = Pipeline(Encoder(fixed, ClipQuantise(8)), decoder)
    optimiser = torch.optim.Adam(decoder.parameters(), lr=1e-3)
    clips, number, start = source.clips(), 0, time.process_time()
    while (spent := (time.process_time() - start) / settings["seconds"]) < 1:
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


def rank_masks(clips: Path, validation: Path, out: Path, settings: Mapping[str, Any] = SETTINGS) -> None:
    """Train behind every mask that has no record yet, write ``mask_ranking.json``, and print the correlation.

    Raises:
        MachineFailure: masks failed; the others have their records.
    """
    records = Records(out / "cases", RankedMask)
    made = masks(settings["frames"], settings["side"], settings["seed"])
    cases = [MaskCase(name, (clips, validation), settings) for name in made]
    for ended in run_cases(rank, records.missing(cases), records):
        if not isinstance(ended, FailedCase):
            print(f"{ended.mask}: score {ended.score_dB:.2f} dB, trained {ended.psnr_dB:.2f} dB")
    rows = records.all_of(cases, print)
    correlation, p_value = spearmanr([row.score_dB for row in rows], [row.psnr_dB for row in rows])
    content = {"rank_correlation": float(correlation), "p_value": float(p_value), "settings": dict(settings)}
    shown = [row.model_dump(include={"mask", "score_dB", "psnr_dB"}) for row in rows]
    write_json({**content, "masks": shown}, out / "mask_ranking.json")
    print(f"rank correlation of {len(rows)} masks: {correlation:.2f} (p = {p_value:.2g})")


if __name__ == "__main__":
    rank_masks(*map(Path, sys.argv[1:4]))
