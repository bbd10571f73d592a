"""The best linear estimate of a video from one measurement, block by block, prepared once for a mask."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple, TypeVar

import torch
from torch.nn import functional as F

from sci_lightning.errors import BadInput
from sci_lightning.prior.moments import BlockGrid, BlockMoments, estimated_patches
from sci_lightning.prior.prior import PatchPrior, read_prior

MEMORY = 2**31
"""Bytes of matrices that are kept for the next measurement; a mask that needs more has them computed strip by strip."""

STRIP = 2**27
"""Bytes of patches that are estimated at a time."""

IN_WORK = 5
"""Matrices of a block that exist at once while they are computed: covariance, noise, factor, inverse, and a copy."""

FEW_KINDS = 64
"""Up to so many distinct blocks, all blocks of a kind are multiplied at once; else every block by itself."""


Part = TypeVar("Part")


class PreparedMask(NamedTuple):
    """What is computed once for a mask: the moments of its distinct blocks."""

    mask: torch.Tensor
    """The mask itself, padded to whole blocks."""
    moments: BlockMoments | None
    """Moments of the distinct blocks, as far as ``computed``; None if they are too large to be kept."""
    computed: torch.Tensor
    """Which moments there are by now, ``(K, distinct blocks)`` bool: a block needs those of its likeliest component."""
    apart: BlockMoments | None
    """Moments of the blocks that do not overlap, one after another, or of the distinct ones where those are few."""
    kind: torch.Tensor
    """For every block of the grid, row by row, which of the distinct blocks it is."""

    @property
    def in_order(self) -> bool:
        """Whether all blocks differ, so that the moments stand in the order of the grid."""
        return self.moments is not None and len(self.moments.total) == len(self.kind)

    def size(self) -> int:
        """Return the bytes that this takes."""
        matrices = {id(part): part.inverse.numel() for part in (self.moments, self.apart) if part is not None}
        return 4 * (self.mask.numel() + sum(matrices.values()))


class LinearEstimator:
    r"""The best linear estimate of every block, :math:`m + C A^\top (A C A^\top + \sigma^2)^{-1} (y - A m)`.

    With a mixture of several Gaussians, the component under which the block of the measurement is most likely makes the
    estimate. Blocks overlap, and their estimates are averaged with a smooth window. The matrices depend on the mask
    alone: they are computed when a measurement first needs them, once for every distinct block (a mask that repeats a
    tile has few), and kept for the next ones. Large images are estimated in strips, so that memory stays bounded.

    Args:
        noise: standard deviation of the noise, in units of the measurement: sensor noise, and what the prior misses.
        block: side of the blocks in pixels.
        stride: distance of neighbouring blocks in pixels, at most ``block``.
        mixture: whether to use all components of the prior; else the one Gaussian of the same covariance.
        prior: patch statistics that :meth:`PatchPrior.save` wrote; None for those that come with the package.

    Raises:
        BadInput: a setting out of range, or statistics that cannot be read.
    """

    watch: Callable[[str], object] | None = None
    """Called before every part of what takes long, with words that say which part it is."""

    def __init__(
        self,
        noise: float = 0.02,
        block: int = 8,
        stride: int = 4,
        mixture: bool = True,
        prior: str | Path | None = None,
    ) -> None:
        if not noise > 0:
            raise BadInput(f"noise={noise}: must be positive")
        if not 1 <= stride <= block:
            raise BadInput(f"stride={stride}: must be from 1 to the block's side, {block}")
        self.noise, self.block, self.stride = noise, block, stride
        statistics = read_prior(prior)
        self.prior: PatchPrior = statistics if mixture else statistics.merged()
        if block > self.prior.reach + 1:
            raise BadInput(f"block={block}: the patch statistics reach over {self.prior.reach + 1} pixels")
        self._covariances: dict[tuple[int, torch.device], torch.Tensor] = {}
        self._kept: list[PreparedMask] = []

    @torch.compiler.disable
    def __call__(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return the estimate ``(N, T, H, W)``, in the type of the measurement; differentiable in both arguments.

        It is computed in float32, whatever autocast says.

        Args:
            measurement: ``(N, H, W)``, close to the sum of mask times frame.
            mask: ``(T, H, W)``.
        """
        if measurement.is_meta:  # only operations are being counted, which needs no precision
            return self._estimated(measurement, mask)
        with torch.autocast(measurement.device.type, enabled=False):
            video = self._estimated(measurement.float(), mask.float())
        return video.to(measurement.dtype)

    def _estimated(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        height, width = mask.shape[1:]
        grid = BlockGrid(height, width, self.block, self.stride)
        measurement, mask = grid.pad(measurement), grid.pad(mask)
        covariance = self.covariance(len(mask), mask.device)
        prepared = self._prepare(grid, mask, covariance)
        component = self._components(grid, measurement, prepared, covariance)
        self._complete(grid, prepared, component, covariance)
        window = grid.window(mask.device)
        video = measurement.new_zeros(len(measurement), *mask.shape)
        weight = measurement.new_zeros(mask.shape[1:])
        rows_at_once = max(1, STRIP // (4 * video.shape[0] * video.shape[1] * len(window) * grid.columns))
        for first in self._reported("strip", range(0, grid.rows, rows_at_once)):
            last = min(first + rows_at_once, grid.rows)
            lines = slice(first * grid.stride, (last - 1) * grid.stride + grid.block)
            patches = self._patches(grid, first, last, measurement, prepared, component, covariance)
            video[:, :, lines] += grid.add(patches * window[:, None], last - first)
            weight[lines] += grid.add(window[:, None].expand(1, 1, -1, patches.shape[-1]), last - first)[0, 0]
        return (video / weight)[..., :height, :width]

    def _patches(
        self,
        grid: BlockGrid,
        first: int,
        last: int,
        measurement: torch.Tensor,
        prepared: PreparedMask,
        component: torch.Tensor,
        covariance: torch.Tensor,
    ) -> torch.Tensor:
        """Return the estimates of the blocks in the rows from ``first`` up to ``last``, ``(N, T, n, blocks)``."""
        mask = grid.cut(prepared.mask, first, last).transpose(0, 1)
        blocks = grid.cut(measurement, first, last)
        part = slice(first * grid.columns, last * grid.columns)
        kind, component = prepared.kind[part], component[part]
        moments = prepared.moments
        if moments is None:
            whitened = self._whitened_anew(mask, blocks, component, covariance)
        elif mask.is_meta:
            whitened = (blocks.transpose(0, 1) @ moments.inverse[0, : len(mask)]).mT
        elif len(covariance) > 1:
            whitened = torch.stack(
                [
                    moments.whitened_by_one(one, self.prior.level, best, kind)
                    for best, one in zip(component.unbind(1), blocks, strict=True)
                ],
                dim=2,
            )
        elif len(moments.total) <= FEW_KINDS:
            whitened = self._whitened_by_kind(moments, kind, blocks)[0][0]
        else:
            alike = moments[part] if prepared.in_order else moments[kind]
            whitened = alike.whitened(blocks, self.prior.level)[0][0]
        patches = estimated_patches(whitened, mask, covariance, component, self.prior.level)
        return patches.permute(1, 2, 0).unflatten(1, (len(prepared.mask), -1))

    def _components(
        self, grid: BlockGrid, measurement: torch.Tensor, prepared: PreparedMask, covariance: torch.Tensor
    ) -> torch.Tensor:
        """Return which component of the prior every block has, ``(blocks, N)``: the most likely one.

        The likelihoods of blocks that do not overlap are interpolated between them.
        """
        if len(covariance) == 1 or measurement.is_meta:
            return torch.zeros(len(prepared.kind), len(measurement), dtype=torch.long, device=measurement.device)
        blocks = self._apart(measurement, grid)
        rows, columns = blocks.shape[1:3]
        blocks = blocks.flatten(1, 2)
        moments = prepared.apart
        if moments is None:
            masks = self._apart(prepared.mask, grid).flatten(1, 2).transpose(0, 1)
            count = self._at_once(len(covariance))
            parts = [
                BlockMoments.of(part, covariance, self.noise**2).whitened(some, self.prior.level)[1]
                for part, some in self._reported(
                    "likelihoods", list(zip(masks.split(count), blocks.split(count, dim=1), strict=True))
                )
            ]
            likelihood = torch.cat(parts, dim=1)
        elif moments is prepared.moments:
            kind = self._every(prepared.kind.view(grid.rows, grid.columns), rows, columns).flatten()
            likelihood = self._whitened_by_kind(moments, kind, blocks)[1]
        else:
            likelihood = moments.whitened(blocks, self.prior.level)[1]
        likelihood = likelihood.unflatten(1, (rows, columns)).movedim(-1, 1)
        step = self._step
        between = F.interpolate(
            likelihood, ((rows - 1) * step + 1, (columns - 1) * step + 1), mode="bilinear", align_corners=True
        )
        margin = (0, grid.columns - between.shape[-1], 0, grid.rows - between.shape[-2])
        between = F.pad(between, margin, mode="replicate")
        weights = self.prior.weights.to(measurement.device).log()
        return (between + weights[:, None, None, None]).argmax(0).flatten(1).mT

    @property
    def _step(self) -> int:
        """Every so many blocks, along rows and columns, do not overlap."""
        return max(1, self.block // self.stride)

    def _apart(self, image: torch.Tensor, grid: BlockGrid) -> torch.Tensor:
        """Return the blocks of a padded image ``(C, .., ..)`` that do not overlap, ``(C, rows, columns, n)``."""
        distance = self._step * self.stride
        return image.unfold(1, self.block, distance).unfold(2, self.block, distance).flatten(3)

    def _every(self, blocks: torch.Tensor, rows: int, columns: int) -> torch.Tensor:
        return blocks[:: self._step, :: self._step][:rows, :columns]

    def _whitened_anew(
        self, mask: torch.Tensor, blocks: torch.Tensor, component: torch.Tensor, covariance: torch.Tensor
    ) -> torch.Tensor:
        """Return S^-1 (y - A m), ``(blocks, n, N)``, of blocks whose moments are too large to be kept."""
        whitened = blocks.new_zeros(blocks.shape[1], blocks.shape[2], len(blocks))
        for number in range(len(covariance)):
            one = covariance[number : number + 1]
            concerned = (component == number).any(1).nonzero()[:, 0].split(self._at_once(1))
            for members in self._reported(f"component {number + 1} of {len(covariance)}", concerned):
                values = BlockMoments.of(mask[members], one, self.noise**2).whitened(
                    blocks[:, members], self.prior.level
                )
                whitened[members] += torch.where((component[members] == number)[:, None], values[0][0], 0)
        return whitened

    def _reported(self, what: str, parts: Sequence[Part]) -> Iterator[Part]:
        """Yield parts one after another, and say which one is next."""
        for number, part in enumerate(parts, 1):
            if self.watch is not None:
                self.watch(f"{what}, part {number} of {len(parts)}")
            yield part

    def _at_once(self, components: int) -> int:
        """Return the number of blocks whose matrices are computed at a time."""
        return max(1, STRIP // (4 * components * self.block**4))

    def _whitened_by_kind(
        self, moments: BlockMoments, kind: torch.Tensor, blocks: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Return :meth:`BlockMoments.whitened` of blocks ``(N, blocks, n)`` of few kinds: one matrix product each."""
        whitened = blocks.new_empty(len(self.prior.weights), blocks.shape[1], blocks.shape[2], len(blocks))
        likelihood = blocks.new_empty(whitened.shape[0], whitened.shape[1], whitened.shape[3])
        for number in kind.unique():
            members = (kind == number).nonzero()[:, 0]
            alike = blocks[:, members].flatten(0, 1)[:, None]  # (N * members, 1, n): many measurements of one block
            one, likely = moments[number : number + 1].whitened(alike, self.prior.level)
            whitened[:, members] = one[:, 0].unflatten(-1, (len(blocks), -1)).permute(0, 3, 1, 2)
            likelihood[:, members] = likely[:, 0].unflatten(-1, (len(blocks), -1)).mT
        return whitened, likelihood

    def kept_bytes(self, height: int, width: int) -> int:
        """Return the memory that the matrices of a mask take at most, kept or while they are computed."""
        grid = BlockGrid(height, width, self.block, self.stride)
        return min(self._matrices(grid.rows * grid.columns), MEMORY) + IN_WORK * STRIP

    def _matrices(self, blocks: int) -> int:
        """Return the bytes of the matrices of so many distinct blocks; every fourth has a copy in :attr:`apart`."""
        return 5 * len(self.prior.weights) * blocks * self.block**4

    def covariance(self, frames: int, device: torch.device) -> torch.Tensor:
        """Return the covariance of patches, ``(K, T, n, T, n)``, which is computed once for every T and device."""
        key = frames, device
        if key not in self._covariances:
            with torch.inference_mode(False), torch.no_grad():  # what is kept may meet a training later
                self._covariances[key] = self.prior.covariance(frames, self.block).to(device)
        return self._covariances[key]

    def _prepare(self, grid: BlockGrid, mask: torch.Tensor, covariance: torch.Tensor) -> PreparedMask:
        """Return the moments of the distinct blocks of a padded mask: those kept from an earlier call, or new ones."""
        if mask.is_meta:  # only operations are being counted, and preparing the mask does not count
            blocks, pixels = grid.rows * grid.columns, self.block**2
            inverse = mask.new_empty(1, 1, pixels, pixels).expand(len(covariance), blocks, -1, -1)  # takes no memory
            moments = BlockMoments(mask.new_empty(blocks, pixels), inverse, inverse[:, :, 0, 0])
            return PreparedMask(mask, moments, mask.new_empty(0), moments, mask.new_empty(blocks, dtype=torch.long))
        if torch.is_grad_enabled() and mask.requires_grad:
            return self._computed(grid, mask, covariance, least_memory=False)
        for number, prepared in enumerate(self._kept):
            same_place = prepared.mask.shape == mask.shape and prepared.mask.device == mask.device
            if same_place and torch.equal(prepared.mask, mask):
                self._kept.insert(0, self._kept.pop(number))
                return prepared
        with torch.inference_mode(False), torch.no_grad():  # what is kept may meet a training later
            prepared = self._computed(grid, mask.detach().clone(), covariance)
        self._kept.insert(0, prepared)
        while len(self._kept) > 1 and sum(kept.size() for kept in self._kept) > MEMORY:
            self._kept.pop()
        return prepared

    def _computed(
        self, grid: BlockGrid, mask: torch.Tensor, covariance: torch.Tensor, least_memory: bool = True
    ) -> PreparedMask:
        blocks = grid.cut(mask, 0, grid.rows).transpose(0, 1)
        examples, kind = distinct_blocks(blocks)
        blocks = blocks[examples]
        computed = torch.ones(len(covariance), len(blocks), dtype=torch.bool, device=mask.device)
        if not least_memory:
            moments = BlockMoments.of(blocks, covariance, self.noise**2)
            return PreparedMask(mask, moments, computed, moments, kind)
        if self._matrices(len(blocks)) > MEMORY:
            return PreparedMask(mask, None, ~computed, None, kind)
        if len(blocks) <= FEW_KINDS or len(covariance) == 1:
            moments = self._moments(blocks, covariance)
            return PreparedMask(mask, moments, computed, moments, kind)
        rows, columns = self._apart(mask[:1], grid).shape[1:3]
        kinds, place = self._every(kind.view(grid.rows, grid.columns), rows, columns).unique(return_inverse=True)
        apart = self._moments(blocks[kinds], covariance)[place.flatten()]
        return PreparedMask(mask, BlockMoments.to_be_filled(blocks, len(covariance)), ~computed, apart, kind)

    def _moments(self, blocks: torch.Tensor, covariance: torch.Tensor) -> BlockMoments:
        """Return the moments of blocks by all components, computed with little memory beside the result."""
        moments, count = BlockMoments.to_be_filled(blocks, len(covariance)), self._at_once(len(covariance))
        parts = [slice(first, first + count) for first in range(0, len(blocks), count)]
        for part in self._reported("matrices", parts):
            one = BlockMoments.of(blocks[part], covariance, self.noise**2)
            moments.inverse[:, part], moments.log_determinant[:, part] = one.inverse, one.log_determinant
        return moments

    def _complete(
        self, grid: BlockGrid, prepared: PreparedMask, component: torch.Tensor, covariance: torch.Tensor
    ) -> None:
        """Compute the moments of the distinct blocks by the components ``(blocks, N)`` that are not there yet."""
        if prepared.moments is None or component.is_meta or prepared.computed.all():
            return
        wanted = torch.zeros_like(prepared.computed)
        wanted[component, prepared.kind.unsqueeze(1)] = True
        missing = wanted & ~prepared.computed
        with torch.inference_mode(False), torch.no_grad():  # as what was prepared before
            masks = grid.cut(prepared.mask, 0, grid.rows).transpose(0, 1)
            examples = torch.zeros(len(prepared.moments.total), dtype=torch.long, device=masks.device)
            examples[prepared.kind] = torch.arange(len(masks), device=masks.device)
            for number in missing.any(1).nonzero()[:, 0].tolist():
                kinds = missing[number].nonzero()[:, 0].split(self._at_once(1))
                for some in self._reported(f"component {number + 1} of {len(covariance)}", kinds):
                    one = BlockMoments.of(masks[examples[some]], covariance[number : number + 1], self.noise**2)
                    prepared.moments.inverse[number, some] = one.inverse[0]
            prepared.computed.logical_or_(missing)


def distinct_blocks(blocks: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return which of the blocks ``(blocks, T, n)`` are one example of every kind, and the kind of every block.

    If all blocks differ, both are 0, 1, 2, .. in order.
    """
    bits = blocks.detach().contiguous().flatten(1).view(torch.int32).long()
    generator = torch.Generator().manual_seed(0)
    factors = torch.randint(-(2**62), 2**62, (bits.shape[1],), generator=generator).to(bits.device)
    digest = (bits * factors).sum(1)  # wraps around: equal blocks have equal digests, others practically never
    values, kind = digest.unique(return_inverse=True)
    everything = torch.arange(len(blocks), device=blocks.device)
    if len(values) == len(blocks):
        return everything, everything
    examples = everything.new_full((len(values),), len(blocks)).scatter_reduce(0, kind, everything, "amin")
    return examples, kind
