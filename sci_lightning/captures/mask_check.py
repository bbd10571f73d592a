r"""Test before decoding whether a mask belongs to a snapshot, and whether its slots are in the order of the frames.

Inside a block of a few pixels a scene hardly changes from pixel to pixel, so that the snapshot is close to
:math:`y(p) = c_0 + \sum_t c_t M_t(p)`: its fine structure is the mask's. The least-squares residual of this model,
block by block, is small for the right mask only. It is compared with the residual that the same mask leaves when it is
displaced far (which has the same statistics and certainly does not belong), and with what the mask's sum over time must
imprint on a snapshot of this brightness.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import torch

from sci_lightning.files.tiff_file import BAYER
from sci_lightning.operator import SnapshotOperator

BLOCK = 8
"""Side of a block in pixels; twice that for masks of more than ``FEW_SLOTS`` slots, which need more equations."""
FEW_SLOTS = 20
MIN_BLOCKS = 48
FAR_SHIFTS = 5
"""Far displacements of the mask, for comparison."""
SEARCH_RADIUS = 2
"""Displacements of the mask by up to so many pixels in either direction are tried."""
MIN_EXPECTED_SHARE = 0.1
"""The test says nothing if the mask's sum should account for a smaller part of the snapshot's fine structure.

That is so for structural masks, whose sum is the same everywhere: behind all of them a scene at rest looks the same.
"""
UNRELATED = 0.08
"""The part of the expected share that masks of other files do not reach, twice over: see :data:`MIN_EXPLAINED`."""

MIN_EXPLAINED = 0.3
"""The part of the expected share that has to be there.

Set between values measured on the six test scenes (19 snapshots with the mask in their files) and on 53 clips recorded
with binary and gray random masks, without noise, with a sensor's, and with that at a tenth of the light. The right
mask: 0.88 to 5.5 in 233 cases; half a pixel off: 0.83 and more in 72; so no false alarm. The mask of another file,
displaced, flipped or transposed: -0.04 to 0.04 in 287 cases. A random mask in place of the structural one that the
snapshot was recorded with: at most 0.3 in 71 of 72.
"""
MIN_STANDARD_ERRORS = 5.0
"""Another position or orientation has to be better by so many standard errors.

On the same scenes no other position or orientation was better than the right mask by so much, for structural masks
either (447 cases). Masks shifted by one pixel or flipped were recognised: all random ones, and three quarters of the
structural ones, which only motion tells apart.
"""
MIN_GAIN = 0.02
"""Another position or orientation has to be better by so many nats per block."""
MOSAIC_SPREAD, MOSAIC_ALIKE, MOSAIC_CERTAINTY = 0.06, 0.3, 8.0
"""What makes a mosaic of colours: how far the four answers within a cell of 2 x 2 pixels lie apart, as a part of their
mean, how much less those of green differ, and by how many standard errors."""
SATURATED = 0.999
MAX_SNAPSHOTS = 4
MAX_BLOCKS = 1500
"""Blocks that are used; of more blocks, so many at equal distances."""


@dataclass(frozen=True)
class MaskCheck:
    """The result of the test.

    Attributes:
        share: the part of the snapshot's fine structure that the mask's sum over time must account for, from 0 to 1.
        explained: the part of that share that is there: near 1 for the right mask, near 0 for another; 1 where the
            share is too small to tell.
        better: the position or orientation in which the mask fits better, in words; empty if there is none.
        order: an order of the slots, from 0, in which the scene moves more steadily; empty if there is no doubt.
    """

    share: float
    explained: float
    better: str
    order: tuple[int, ...] = ()

    @property
    def belongs(self) -> bool:
        """False if the snapshot contradicts the mask; True if it does not or cannot tell."""
        return (
            not self.better and not self.order and (self.share < MIN_EXPECTED_SHARE or self.explained >= MIN_EXPLAINED)
        )


def is_colour_mosaic(image: torch.Tensor, expected: torch.Tensor) -> bool:
    """Return whether the pixels of 2 x 2 cells answer as those of a Bayer filter: one diagonal alike, the rest not.

    On 34 real snapshots and scenes of grey cameras the four answers differ by at most 2 %.

    Args:
        image: ``(H, W)``, linear in the light.
        expected: ``(H, W)``, what every pixel would have in even light.
    """
    height, width = (2 * (side // 2) for side in image.shape)
    values, light = (
        part[:height, :width].double().unfold(0, 2, 2).unfold(1, 2, 2).reshape(-1, 4) for part in (image, expected)
    )
    if len(values) < MIN_BLOCKS or not (light.sum(0) > 0).all() or not (values.sum(0) > 0).all():
        return False
    answers = values.sum(0) / light.sum(0)
    rest = values - light * values.sum() / light.sum()
    rest = rest - rest.mean(1, keepdim=True)
    certainty = rest.mean(0).abs() / (rest.std(0) / len(rest) ** 0.5 + 1e-9)
    spread = float((answers.max() - answers.min()) / answers.mean())
    alike = float(min((answers[0] - answers[3]).abs(), (answers[1] - answers[2]).abs()) / answers.mean())
    return spread > MOSAIC_SPREAD and alike < MOSAIC_ALIKE * spread and float(certainty.max()) > MOSAIC_CERTAINTY


@torch.no_grad()
def check_mask(measurement: torch.Tensor, mask: torch.Tensor) -> MaskCheck | None:
    """Test whether a snapshot was recorded with a mask.

    Args:
        measurement: ``(H, W)``, linear in the light, 1.0 is full scale.
        mask: ``(T, H, W)`` in [0, 1].

    Returns:
        The result; None if the two are too small, too saturated or too dark for a test.
    """
    side = BLOCK if len(mask) <= FEW_SLOTS else 2 * BLOCK
    if len(mask) > side * side // 3:
        return None
    blocks = _blocks(measurement, side)
    if not blocks.numel():
        return None
    usable = (blocks.amax(-1) < SATURATED * float(blocks.max().clamp(min=1))) & (blocks.amax(-1) > blocks.amin(-1))
    used = usable.nonzero()[:, 0]
    if len(used) < MIN_BLOCKS:
        return None
    used = used[:: -(-len(used) // MAX_BLOCKS)]
    blocks = blocks[used]

    def residual(other: torch.Tensor) -> torch.Tensor:
        return _residual(blocks, _blocks(other, side)[:, used])

    rounding = side**2 * torch.finfo(torch.float32).eps
    height, width = measurement.shape
    far = [
        (height * k // (FAR_SHIFTS + 2) + 3, width * (k + 1) // (FAR_SHIFTS + 2) + 5) for k in range(1, FAR_SHIFTS + 1)
    ]
    unrelated = torch.stack([residual(mask.roll(shift, (1, 2))) for shift in far]).mean(0) + rounding
    given = residual(mask) + rounding
    total = _blocks(SnapshotOperator(mask).total(), side)[used]
    dark = float(measurement.flatten().kthvalue(max(1, measurement.numel() // 100)).values)  # a black level is no light
    light = (blocks.mean(-1) - dark).clamp(min=0) / total.mean(-1).clamp(min=1e-6)
    freedom = 1 - (len(mask) + 1) / side**2
    expected = (total.var(-1, correction=0) * side**2 * light.square() * freedom / unrelated).clamp(max=1)
    share = float(expected.mean())
    explained = float((1 - given / unrelated).mean()) / share if share >= MIN_EXPECTED_SHARE else 1.0
    gains = {}
    for words, other in _elsewhere(mask):
        gain = (given / (residual(other) + rounding)).log()
        if float(gain.mean()) > max(MIN_GAIN, MIN_STANDARD_ERRORS * float(gain.std()) / len(gain) ** 0.5):
            gains[words] = float(gain.mean())
    better = max(gains, key=lambda words: gains[words], default="")
    undisputed = share < MIN_EXPECTED_SHARE or explained >= MIN_EXPLAINED
    order = better_order(blocks, _blocks(mask, side)[:, used]) if undisputed and not better else []
    return MaskCheck(share, explained, better, tuple(order))


def mask_warning(measurement: torch.Tensor, mask: torch.Tensor) -> str:
    """Return one line that says that a mask does not seem to belong to snapshots, and what to check.

    A mosaic of colours is named first. The line is empty if at least half of the snapshots that can tell do not
    contradict the mask.

    Args:
        measurement: ``(N, H, W)``, linear in the light, 1.0 is full scale; at most ``MAX_SNAPSHOTS`` are tested.
        mask: ``(T, H, W)`` in [0, 1].
    """
    if len(mask) > 1 and bool((mask == mask[:1]).all()):
        return "all slots of the mask are equal: they code nothing, so that the frames cannot be told apart"
    brightest = mask.amax(0)  # also where the mask was calibrated through the same filters
    if is_colour_mosaic(measurement[0], mask.sum(0)) or is_colour_mosaic(brightest, torch.ones_like(brightest)):
        return f"seems to be {BAYER}"
    checks = [check_mask(one, mask) for one in measurement[:MAX_SNAPSHOTS]]
    answers = [check for check in checks if check is not None]
    doubts = [check for check in answers if not check.belongs]
    if len(doubts) * 2 <= len(answers):
        return ""
    if better := next((check.better for check in doubts if check.better), ""):
        return f"the mask fits this snapshot better when it is {better}: check its orientation and position"
    if order := next((check.order for check in doubts if check.order), ()):
        slots = ", ".join(str(slot + 1) for slot in order)
        return (
            f"the scene moves more steadily with the mask's slots in the order {slots}: check the order of the frames"
        )
    explained = max(0.0, max(check.explained for check in doubts))
    if explained > UNRELATED:
        return (
            f"{explained:.0%} of the fine structure that the mask must leave is found in this snapshot, less than of a "
            "sharp mask of the same session: it may be blurred or displaced, or a random one in place of a structural "
            "one; `diagnose` with the same measurement= and mask= tells"
        )
    return (
        f"the mask does not seem to belong to this snapshot, in which {explained:.0%} is found of the fine structure "
        "that it must leave: check whether it is this camera's and this session's, its orientation (flipped, "
        "transposed), its size, a shift of more than two pixels, and which of several arrays or patterns it is"
    )


def _blocks(image: torch.Tensor, side: int) -> torch.Tensor:
    """Cut ``(..., H, W)`` into ``(..., blocks, side * side)``, without an incomplete right and lower edge."""
    height, width = (length // side for length in image.shape[-2:])
    cut = image[..., : height * side, : width * side].unflatten(-1, (width, side)).unflatten(-3, (height, side))
    return cut.transpose(-2, -3).flatten(-2).flatten(-3, -2)


def _residual(blocks: torch.Tensor, patterns: torch.Tensor) -> torch.Tensor:
    """Return the sum of squared residuals of a least-squares fit in every block, ``(blocks,)``.

    Args:
        blocks: ``(blocks, n)`` pixels of the snapshot.
        patterns: ``(T, blocks, n)`` pixels of the mask, whose combination and a constant are fitted.
    """
    target = (blocks - blocks.mean(-1, keepdim=True)).unsqueeze(-1)
    model = (patterns - patterns.mean(-1, keepdim=True)).permute(1, 2, 0)
    normal = model.mT @ model + 1e-4 * model.shape[1] * torch.eye(model.shape[-1])  # for patterns that are alike
    explained = torch.linalg.solve_triangular(torch.linalg.cholesky(normal), model.mT @ target, upper=False)
    return (target.square().sum((1, 2)) - explained.square().sum((1, 2))).clamp(min=0)


def _elsewhere(mask: torch.Tensor) -> Iterator[tuple[str, torch.Tensor]]:
    """Yield the mask at other positions and in other orientations, with their names."""
    steps = range(-SEARCH_RADIUS, SEARCH_RADIUS + 1)
    for down, right in ((down, right) for down in steps for right in steps if down or right):
        yield f"shifted by {right} to the right and {down} down (pixels)", mask.roll((down, right), (1, 2))
    yield "flipped left to right", mask.flip(2)
    yield "flipped upside down", mask.flip(1)
    yield "turned by 180 degrees", mask.flip(1, 2)
    if mask.shape[1] == mask.shape[2]:
        yield "transposed", mask.mT
        yield "transposed along the other diagonal", mask.mT.flip(1, 2)
        yield "turned by 90 degrees", mask.rot90(1, (1, 2))
        yield "turned by 270 degrees", mask.rot90(3, (1, 2))


MAX_ORDERED_SLOTS = 16
"""The order of more slots is not tested."""
MIN_ORDER_EXCESS = 0.4
"""The given order is doubted if its changes exceed the best order's by this part of the mean order's excess.

Set together with ``MIN_ORDER_ERRORS`` on 57 snapshots of T = 8, where right orders reached 0.29 at most. Measured
then: no right order was doubted (27 snapshots of the six test scenes; 318 of 53 clips, 128 and 192 pixels wide, behind
binary, gray and structural masks with a sensor's noise). A random order, and all even slots before the odd ones, were
doubted in all 11 files of the test scenes and in a third of the clips; a sequence that starts three slots late in half
of the files and few clips; two exchanged slots never.
"""
MIN_ORDER_ERRORS = 5.0
"""Significance of that excess, in standard errors, on blocks that the search for the best order did not use."""


@torch.no_grad()
def better_order(blocks: torch.Tensor, patterns: torch.Tensor) -> list[int]:
    """Return an order of the slots, from 0, in which the scene moves more steadily; empty if there is no doubt.

    A mask explains the snapshot with its slots in any order, but in a wrong order the video that it implies jumps back
    and forth. The brightness :math:`c_t` of every slot in a block is estimated by least squares; in the right order it
    changes little from slot to slot. Reversed time cannot be seen, nor any order if nothing moves.

    Args:
        blocks: the snapshot in blocks of n pixels, ``(blocks, n)``.
        patterns: the mask in the same blocks, ``(T, blocks, n)``.
    """
    slots = len(patterns)
    if not 3 <= slots <= MAX_ORDERED_SLOTS or len(blocks) < 2:
        return []
    changes = _slot_changes(blocks, patterns)
    order = _steadiest(changes[::2].mean(0))
    held_out = changes[1::2]
    given, best = (_along(held_out, way) for way in (list(range(slots)), order))
    mean = held_out.sum((1, 2)) / slots  # over all orders: T - 1 times the mean change
    excess, mean_excess = given - best, mean - best
    significant = float(excess.mean()) > MIN_ORDER_ERRORS * float(excess.std()) / len(excess) ** 0.5
    return order if significant and float(excess.mean()) > MIN_ORDER_EXCESS * float(mean_excess.mean()) > 0 else []


def _slot_changes(blocks: torch.Tensor, patterns: torch.Tensor) -> torch.Tensor:
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
    best = min(ways, key=lambda way: _path_length(length, way))
    return best if best[0] < best[-1] else best[::-1]


def _improved(length: list[list[float]], way: list[int]) -> list[int]:
    """Reverse parts of a path as long as that makes it shorter (2-opt)."""
    shortest, improved = _path_length(length, way), True
    while improved:
        improved = False
        for first in range(len(way) - 1):
            for last in range(first + 2, len(way) + 1):
                other = way[:first] + way[first:last][::-1] + way[last:]
                if (total := _path_length(length, other)) < shortest - 1e-9:
                    way, shortest, improved = other, total, True
    return way


def _path_length(length: list[list[float]], way: list[int]) -> float:
    return sum(length[one][other] for one, other in pairwise(way))


def _along(changes: torch.Tensor, way: list[int]) -> torch.Tensor:
    """Return the sum ``(blocks,)`` of the changes ``(blocks, T, T)`` along an order of the slots."""
    return changes[:, way[:-1], way[1:]].sum(-1)
