r"""Test from a snapshot and its mask alone, before decoding, whether the mask's slots are in the order of the frames.

A mask explains the snapshot with its slots in any order, but in a wrong order the video that it implies jumps back and
forth. The brightness :math:`c_t` of every slot in a block of pixels is estimated by least squares, as in
:mod:`sci_lightning.captures.mask_check`; in the right order it changes little from slot to slot. The test cannot see
reversed time, nor any order if nothing moves.
"""

from __future__ import annotations

from itertools import pairwise

import torch

MAX_SLOTS = 16
"""The order of more slots is not tested."""
MIN_EXCESS = 0.4
"""The given order is doubted if its changes exceed the best order's by this part of the mean order's excess.

Set together with ``MIN_STANDARD_ERRORS`` on 57 snapshots of T = 8, where right orders reached 0.29 at most. Measured
then: no right order was doubted (27 snapshots of the six test scenes; 318 of 53 clips, 128 and 192 pixels wide, behind
binary, gray and structural masks with a sensor's noise). A random order, and all even slots before the odd ones, were
doubted in all 11 files of the test scenes and in a third of the clips; a sequence that starts three slots late in half
of the files and few clips; two exchanged slots never.
"""
MIN_STANDARD_ERRORS = 5.0
"""Significance of that excess, in standard errors, on blocks that the search for the best order did not use."""


@torch.no_grad()
def better_order(blocks: torch.Tensor, patterns: torch.Tensor) -> list[int]:
    """Return an order of the slots, from 0, in which the scene moves more steadily; empty if there is no doubt.

    Args:
        blocks: the snapshot in blocks of n pixels, ``(blocks, n)``.
        patterns: the mask in the same blocks, ``(T, blocks, n)``.
    """
    slots = len(patterns)
    if not 3 <= slots <= MAX_SLOTS or len(blocks) < 2:
        return []
    changes = _changes(blocks, patterns)
    order = _steadiest(changes[::2].mean(0))
    held_out = changes[1::2]
    given, best = (_along(held_out, way) for way in (list(range(slots)), order))
    mean = held_out.sum((1, 2)) / slots  # over all orders: T - 1 times the mean change
    excess, mean_excess = given - best, mean - best
    significant = float(excess.mean()) > MIN_STANDARD_ERRORS * float(excess.std()) / len(excess) ** 0.5
    return order if significant and float(excess.mean()) > MIN_EXCESS * float(mean_excess.mean()) > 0 else []


def _changes(blocks: torch.Tensor, patterns: torch.Tensor) -> torch.Tensor:
    """Return squared differences of brightness between any two slots, ``(blocks, T, T)``, over the noise's variance.

    The expected contribution of the noise is subtracted.
    """
    model = patterns.permute(1, 2, 0)
    pixels, slots = model.shape[1:]
    inverse = torch.linalg.inv(model.mT @ model + 1e-3 * pixels * torch.eye(slots))
    level = inverse @ (model.mT @ blocks.unsqueeze(-1))
    noise = (blocks - (model @ level)[..., 0]).square().sum(-1) / (pixels - slots)
    variance = inverse.diagonal(dim1=1, dim2=2)
    spread = (variance[:, :, None] + variance[:, None, :] - 2 * inverse) * noise[:, None, None]
    squares = (level - level.mT).square() - spread
    return squares / (noise + noise.mean()).clamp(min=1e-12)[:, None, None]


def _steadiest(changes: torch.Tensor) -> list[int]:
    """Return a short path through all slots: the best of nearest-neighbour paths improved by 2-opt reversals."""
    slots, length = len(changes), changes.tolist()
    ways = []
    for first in range(slots):
        way = [first]
        while len(way) < slots:
            way.append(min(set(range(slots)) - set(way), key=lambda slot: length[way[-1]][slot]))
        ways.append(_improved(length, way))
    best = min(ways, key=lambda way: _total(length, way))
    return best if best[0] < best[-1] else best[::-1]


def _improved(length: list[list[float]], way: list[int]) -> list[int]:
    """Reverse parts of a path as long as that makes it shorter (2-opt)."""
    shortest, improved = _total(length, way), True
    while improved:
        improved = False
        for first in range(len(way) - 1):
            for last in range(first + 2, len(way) + 1):
                other = way[:first] + way[first:last][::-1] + way[last:]
                if (total := _total(length, other)) < shortest - 1e-9:
                    way, shortest, improved = other, total, True
    return way


def _total(length: list[list[float]], way: list[int]) -> float:
    return sum(length[one][other] for one, other in pairwise(way))


def _along(changes: torch.Tensor, way: list[int]) -> torch.Tensor:
    """Return the sum ``(blocks,)`` of the changes ``(blocks, T, T)`` along an order of the slots."""
    return changes[:, way[:-1], way[1:]].sum(-1)
