"""Scores of many masks, and what a network reaches behind them: does the score predict which mask is better?

The network is trained anew behind every mask, for the same processor time on the same clips.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import product
from typing import Any, Literal

import torch

from sci_lightning.data import Folder
from sci_lightning.decoder import E2ECNN
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.mask import Measured, design_binary, design_structural
from sci_lightning.encoder.mask.structure import structure, uniform
from sci_lightning.encoder.sensor import ClipQuantise
from sci_lightning.files.json_file import says
from sci_lightning.pipeline import Pipeline
from sci_lightning.prior import MaskScore
from sci_lightning.studies.engine.records import CaseRecord, digest_of

SHARED = ("frames", "side", "channels", "blocks", "first_estimate", "seconds", "seed")
"""Settings that all masks of one ranking share."""


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
        settings: of ``conf/mask_ranking.yaml``, as plain data.
    """

    name: str
    settings: Mapping[str, Any]

    @property
    def digest(self) -> str:
        """Digest of the mask and the shared settings."""
        return digest_of({"mask": self.name, **self._shared()})

    def describe(self) -> dict[str, Any]:
        """Return what its record says of it."""
        about = {"format": "sci-ranked-mask", "format_version": 1, "mask": self.name}
        return {**about, "digest": self.digest, "settings": self._shared()}

    def _shared(self) -> dict[str, Any]:
        return {key: self.settings[key] for key in SHARED}


def rank(case: MaskCase) -> dict[str, float]:
    """Return the score of a mask and what the network reaches behind it, both in dB."""
    settings = case.settings
    frames, side, seed = settings["frames"], settings["side"], settings["seed"]
    source = Folder(
        settings["root"], frames, (side, side), (side, side), seed, val_root=settings["val_root"], clips_per_epoch=1
    )
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
        settings: of ``conf/mask_ranking.yaml``.
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
