"""Masks designed before anything is recorded or trained: the tile with the best score that a search finds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import torch

from sci_lightning.encoder.mask.structure import check_bits, structure, uniform
from sci_lightning.errors import BadInput
from sci_lightning.prior import MaskScore

TILE = (8, 8)
"""Tile that is designed for masks whose every value is free: its repetition is their start."""

LEARNING_RATE = 0.05
"""Learning rate of Adam, for a real-valued mask in [0, 1]."""

MOST_MOVES = 16
"""Moves of one open slot that are compared at a time."""


@dataclass(frozen=True)
class MaskDesign:
    """A designed mask.

    Attributes:
        levels: the transmittance ``(T, h, w)``.
        real: a real-valued mask in [0, 1] from which the levels follow, for a training that goes on from there.
        scores: the best score after every step, in dB; the first is that of the random start.
    """

    levels: torch.Tensor
    real: torch.Tensor
    scores: tuple[float, ...]


def design_structural(
    frames: int,
    bits: int,
    tile: tuple[int, int] = TILE,
    score: MaskScore | None = None,
    steps: int = 300,
    seed: int = 0,
    on_progress: Callable[[int, float], object] = lambda step, score: None,
) -> MaskDesign:
    """Design a structural mask: levels of ``bits`` bits that sum to 1 over time.

    From 2 bits on Adam ascends the score of the discrete mask, whose gradient passes Algorithm 1 unchanged
    (straight-through). The index of the brightest slot, a mask of 1 bit, has no useful gradient of that kind: there
    open slots are moved one at a time, see :func:`design_binary`.

    Args:
        frames: T.
        bits: 1 to 8.
        tile: (h, w) in pixels of the pattern that will be repeated.
        score: what is maximised; None for an 8-bit sensor without further noise.
        steps: of Adam; for 1 bit every step visits one pixel.
        seed: of the random start.
        on_progress: called with the number of every step and the best score so far.

    Raises:
        BadInput: bits outside 1 to 8, fewer than two slots, no steps or an empty tile.
    """
    _check(steps, tile)
    score = score or MaskScore(frames)
    if check_bits(bits) == 1:
        start = structure(uniform((frames, *tile), seed), 1)
        return _exchange(start, score, steps, seed, on_progress)
    weight = uniform((frames, *tile), seed).requires_grad_()
    optimiser = torch.optim.Adam([weight], lr=LEARNING_RATE)
    scores: list[float] = []
    best = weight.detach().clone()
    with torch.enable_grad():
        for step in range(steps + 1):
            value = score(structure(weight, bits))
            reached = float(value.detach())
            if not scores or reached > scores[-1]:
                best = weight.detach().clone()
            scores.append(max([reached, *scores[-1:]]))
            on_progress(step, scores[-1])
            optimiser.zero_grad()
            (-value).backward()
            for group in optimiser.param_groups:
                group["lr"] = LEARNING_RATE * (1 - 0.9 * step / max(1, steps))
            optimiser.step()
            with torch.no_grad():
                weight.clamp_(0, 1)
    with torch.no_grad():
        return MaskDesign(structure(best, bits), best, tuple(scores))


def design_binary(
    frames: int,
    density: float = 0.5,
    tile: tuple[int, int] = TILE,
    score: MaskScore | None = None,
    steps: int = 300,
    seed: int = 0,
    on_progress: Callable[[int, float], object] = lambda step, score: None,
) -> MaskDesign:
    """Design a binary mask by exchange: an open slot of a pixel moves to where the score is best, pixel after pixel.

    Every pixel keeps the number of its open slots, T times the density, rounded up in some pixels and down in others.

    Args:
        frames, tile, score, seed, on_progress: see :func:`design_structural`.
        density: the part of all slots that is open, above 0 and below 1.
        steps: visits of a pixel; the search ends earlier when no move improves the score.

    Raises:
        BadInput: a density outside 0 to 1, or one that leaves no slot open or none shut.
    """
    _check(steps, tile)
    if not 0 < density < 1:
        raise BadInput(f"density={density}: must be above 0 and below 1, the part of slots that is open")
    number = round(density * frames * tile[0] * tile[1])
    if not 0 < number < frames * tile[0] * tile[1]:
        raise BadInput(f"density={density}: leaves no slot of a tile of {tile[0]} x {tile[1]} open, or none shut")
    random = uniform((frames, *tile), seed)
    pixels = tile[0] * tile[1]
    fewest, more = divmod(number, pixels)
    counts = torch.full((pixels,), fewest)
    counts[torch.randperm(pixels, generator=torch.Generator().manual_seed(seed))[:more]] += 1
    ranks = random.flatten(1).argsort(0).argsort(0)
    start = (ranks < counts).float().unflatten(1, tile)
    return _exchange(start, score or MaskScore(frames), steps, seed, on_progress)


def _check(steps: int, tile: tuple[int, int]) -> None:
    if steps < 1:
        raise BadInput(f"steps={steps}: must be at least 1")
    if min(tile) < 1:
        raise BadInput(f"tile={list(tile)}: must be two positive whole numbers [height, width]")


@torch.no_grad()
def _exchange(
    mask: torch.Tensor, score: MaskScore, steps: int, seed: int, on_progress: Callable[[int, float], object]
) -> MaskDesign:
    """Move one open slot of a pixel after the other to the slot with the best score."""
    generator = torch.Generator().manual_seed(seed)
    scores = [float(score(mask))]
    on_progress(0, scores[0])
    width = mask.shape[2]
    order: list[int] = []
    unimproved = 0
    for step in range(1, steps + 1):
        order = order or torch.randperm(mask[0].numel(), generator=generator).tolist()
        row, column = divmod(order.pop(), width)
        moves = torch.cartesian_prod(mask[:, row, column].nonzero()[:, 0], (mask[:, row, column] == 0).nonzero()[:, 0])
        moves = moves[torch.randperm(len(moves), generator=generator)[:MOST_MOVES]]
        if len(moves):
            candidates = mask.repeat(len(moves), 1, 1, 1)
            which = torch.arange(len(moves))
            candidates[which, moves[:, 0], row, column] = 0
            candidates[which, moves[:, 1], row, column] = 1
            values = score(candidates)
            best = int(values.argmax())
            reached = float(values[best])
            unimproved = 0 if reached > scores[-1] else unimproved + 1
            if not unimproved:
                mask = candidates[best]
            scores.append(max(reached, scores[-1]))
            on_progress(step, scores[-1])
        if unimproved >= 2 * mask[0].numel():
            break
    return MaskDesign(mask, 0.25 + 0.5 * mask, tuple(scores))


@lru_cache(maxsize=32)
def designed_start(frames: int, bits: int, structural: bool, tile: tuple[int, int], seed: int) -> torch.Tensor:
    """Return a real-valued mask ``(T, h, w)`` from which a learned mask can start, for an 8-bit sensor.

    It is computed once in a process for every set of arguments, in about ten seconds.
    """
    steps = 200 if structural and bits > 1 else 2 * tile[0] * tile[1]
    design = (
        design_structural(frames, bits, tile, steps=steps, seed=seed)
        if structural
        else design_binary(frames, 0.5, tile, steps=steps, seed=seed)
    )
    return design.real
