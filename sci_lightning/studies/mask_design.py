"""A mask designed before any training and written to files: what ``design_mask`` and ``sci.design_mask`` share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from sci_lightning.encoder.mask.design import design_binary, design_structural
from sci_lightning.errors import BadInput
from sci_lightning.figures.figure import write_figure
from sci_lightning.figures.mask_design import design_figure, write_mask
from sci_lightning.files.json_file import write_json
from sci_lightning.prior import MaskScore, SensorNoise
from sci_lightning.prior.prior import read_prior
from sci_lightning.prior.score import MOST_SLOTS


@dataclass(frozen=True)
class DesignedMask:
    """The mask that a search found.

    Attributes:
        folder: with ``mask.npy`` (T, H, W), ``mask.mat`` (H, W, T), ``mask.png`` and ``design.json``.
        mask: float32 ``(T, H, W)`` in [0, 1], the tile repeated over the field.
        bits: of its levels.
        score_db: expected PSNR of the best linear decoder behind it, in dB.
        random_start_db: that of the random mask with which the search began.
    """

    folder: Path
    mask: torch.Tensor
    bits: int
    score_db: float
    random_start_db: float


def design_mask(
    settings: Mapping[str, Any], on_step: Callable[[int, float], object] = lambda step, reached: None
) -> DesignedMask:
    """Design a mask and write it, see :class:`DesignedMask`.

    Args:
        settings: of ``conf/design_mask.yaml``, as plain data.
        on_step: called with the number of every step of the search and the best score so far, in dB.

    Raises:
        BadInput: a setting out of its range, or a tile larger than the mask.
    """
    tile, size = settings["tile"], list(settings["size"])
    if not isinstance(tile, Sequence) or len(tile) != 2:
        raise BadInput(f"tile={tile}: expected two positive whole numbers, height and width, as in 'tile=[8,8]'")
    if settings["kind"] not in ("structural", "binary"):
        raise BadInput(f"kind={settings['kind']}: choose structural or binary")
    if not 2 <= settings["frames"] <= MOST_SLOTS:
        raise BadInput(
            f"frames={settings['frames']}: must be from 2 to {MOST_SLOTS}, the slots over which a mask can be scored"
        )
    if tile[0] > size[0] or tile[1] > size[1]:
        raise BadInput(f"tile={list(tile)}: larger than the mask, size={size}")
    out, kind, frames, (height, width) = Path(settings["out"]), settings["kind"], settings["frames"], settings["size"]
    tile = (int(tile[0]), int(tile[1]))
    prior = None if settings["prior"] is None else read_prior(settings["prior"])
    noise = SensorNoise(settings["bit_depth"], settings["read_noise"], settings["full_well"])
    score = MaskScore(frames, noise, prior, settings["aperture"])
    search: dict[str, Any] = {
        "score": score,
        "on_progress": on_step,
        **{key: settings[key] for key in ("steps", "seed")},
    }
    if kind == "binary":
        design, bits = design_binary(frames, settings["density"], tile, **search), 1
    else:
        design, bits = design_structural(frames, settings["bits"], tile, **search), settings["bits"]
    repeats = (1, -(-height // tile[0]), -(-width // tile[1]))
    mask = design.levels.repeat(repeats)[:, :height, :width].to(torch.float32)
    write_mask(mask, out)
    title = f"{kind}, {bits} bit, {frames} slots: {design.scores[-1]:.2f} dB expected of a linear decoder"
    write_figure(design_figure(mask, tile, bits, title), out / "mask.png")
    content = {
        "format": "sci-mask-design",
        "format_version": 1,
        "score_dB": design.scores[-1],
        "random_start_dB": design.scores[0],
        "steps": len(design.scores) - 1,
        "settings": dict(settings),
    }
    write_json(content, out / "design.json")
    return DesignedMask(out, mask, bits, design.scores[-1], design.scores[0])
