r"""Are a mask's slots in the order of the frames? Asked of a snapshot and its mask, before anything is decoded.

With its slots in any order a mask explains the snapshot, but by a video that jumps to and fro. The brightness
:math:`c_t` of every slot in a block of pixels follows from least squares, as in
:mod:`sci_lightning.imaging.mask_check`; in the right order it changes little from slot to slot.
Reversed time cannot be seen, nor any order where nothing moves.
"""

from __future__ import annotations

from itertools import pairwise

import torch

MOST_SLOTS = 16
"""Of more the order is not looked for."""
LEAST_PART = 0.4
"""The part of the way from the mean over all orders to the best order by which the given one has to be worse.

Chosen on 57 snapshots of T = 8, together with ``CERTAIN``: the largest part of a right order that is certain was 0.29.
Measured then: no right order was doubted (27 snapshots of the benchmark's scenes; 318 of 53 clips, 128 and 192 pixels
wide, behind binary, gray and structural masks with a sensor's noise). A random order and one of even slots before odd
ones were doubted in all 11 benchmark files and in a third of the clips, slots that begin three late in half of the
files and few clips, two slots in exchange never.
"""
CERTAIN = 5.0
"""Standard errors by which it does so, in blocks that it was not looked for in."""


@torch.no_grad()
def better_order(blocks: torch.Tensor, patterns: torch.Tensor) -> list[int]:
    """Return an order of the slots in which the scene moves more steadily, counted from 0; empty: no doubt.

    Args:
        blocks: snapshot in blocks of n pixels, ``(blocks, n)``.
        patterns: the mask in the same blocks, ``(T, blocks, n)``.
    """
    slots = len(patterns)
    if not 3 <= slots <= MOST_SLOTS or len(blocks) < 2:
        return []
    changes = _changes(blocks, patterns)
    order = _steadiest(changes[::2].mean(0))
    judged = changes[1::2]
    given, found = (_along(judged, way) for way in (list(range(slots)), order))
    gain, room = given - found, judged.sum((1, 2)) / slots - found  # the mean over all orders is (T - 1) mean changes
    certain = float(gain.mean()) > CERTAIN * float(gain.std()) / len(gain) ** 0.5
    return order if certain and float(gain.mean()) > LEAST_PART * float(room.mean()) > 0 else []


def _changes(blocks: torch.Tensor, patterns: torch.Tensor) -> torch.Tensor:
    """Squared differences of the brightness of every two slots less what noise adds, ``(blocks, T, T)``, weighted."""
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
    """The shortest way through all slots that nearest neighbours and reversals of parts (2-opt) find."""
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
    """The sum of changes ``(blocks, T, T)`` from each slot of a way to the next, ``(blocks,)``."""
    return changes[:, way[:-1], way[1:]].sum(-1)
