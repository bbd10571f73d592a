"""Mean and covariance of a snapshot's blocks when the scene is random, and what follows from them in closed form."""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch.nn import functional as F

from sci_lightning.errors import BadInput

LEAST_WEIGHT = 1e-3
"""Weight of a block's estimate at its corners; above 0, because at the image's corners no other block helps."""


@dataclass(frozen=True)
class BlockGrid:
    """A grid of blocks of ``block`` x ``block`` pixels, ``stride`` pixels apart, that covers an image ``(H, W)``.

    Images are padded by replication at the right and lower edge where the last blocks reach beyond it.

    Attributes:
        height, width: H and W in pixels.
        block: B, side of a block in pixels.
        stride: distance of neighbouring blocks in pixels, at most B.
    """

    height: int
    width: int
    block: int
    stride: int

    @property
    def rows(self) -> int:
        """The number of blocks from top to bottom."""
        return self._count(self.height)

    @property
    def columns(self) -> int:
        """The number of blocks from left to right."""
        return self._count(self.width)

    def _count(self, length: int) -> int:
        return 1 + max(0, math.ceil((length - self.block) / self.stride))

    def pad(self, image: torch.Tensor) -> torch.Tensor:
        """Return an image ``(C, H, W)`` with the rows and columns that the last blocks reach beyond it."""
        down, right = (
            (count - 1) * self.stride + self.block - length
            for count, length in ((self.rows, self.height), (self.columns, self.width))
        )
        return F.pad(image, (0, right, 0, down), mode="replicate") if down or right else image

    def cut(self, padded: torch.Tensor, first: int, last: int) -> torch.Tensor:
        """Return the blocks of some rows of a padded image ``(C, .., ..)``.

        Args:
            padded: what :meth:`pad` returned.
            first, last: numbers of the first row of blocks and of the one after the last.

        Returns:
            ``(C, blocks, B * B)``, row by row.
        """
        rows = padded[:, first * self.stride : (last - 1) * self.stride + self.block]
        blocks = rows.unfold(1, self.block, self.stride).unfold(2, self.block, self.stride)
        return blocks.flatten(3).flatten(1, 2)

    def window(self, device: torch.device | None = None) -> torch.Tensor:
        """Return the weights ``(B * B,)`` of a block's pixels in the blend: a raised cosine in both directions."""
        centres = (torch.arange(self.block, device=device) + 0.5) / self.block
        profile = torch.sin(math.pi * centres).square()
        return (profile[:, None] * profile).flatten() + LEAST_WEIGHT

    def add(self, blocks: torch.Tensor, rows: int) -> torch.Tensor:
        """Return the sum ``(N, C, .., ..)`` of blocks ``(N, C, B * B, blocks)``, of whole rows, at their places."""
        size = ((rows - 1) * self.stride + self.block, (self.columns - 1) * self.stride + self.block)
        return F.fold(blocks.flatten(1, 2), size, self.block, stride=self.stride)


MOST_PRODUCTS = 2**19
"""So many products of two mask values are computed at a time: 2 MiB, which a core's cache holds."""


def block_covariance(mask: torch.Tensor, covariance: torch.Tensor) -> torch.Tensor:
    r"""Return :math:`A C A^\top`, the covariance of a snapshot's blocks without noise.

    .. math:: (A C A^\top)_{pq} = \sum_{t, s} M_t(p)\, C_{tp, sq}\, M_s(q)

    Args:
        mask: M, blocks of a mask, ``(blocks, T, n)`` for n pixels.
        covariance: C, ``(K, T, n, T, n)`` for K different priors.

    Returns:
        ``(K, blocks, n, n)``; differentiable in both arguments.
    """
    slots, pixels = mask.shape[1:]
    p, q = torch.tril_indices(pixels, pixels, device=mask.device)  # the result is symmetric
    pair = torch.zeros(pixels, pixels, dtype=torch.long, device=mask.device)
    pair[p, q] = pair[q, p] = torch.arange(len(p), device=mask.device)
    of_pairs = covariance.permute(2, 4, 0, 1, 3)[p, q].flatten(2).split(list(range(1, pixels + 1)))
    parts = []
    for part in mask.split(max(1, MOST_PRODUCTS // (pixels * slots**2))):
        values = part.permute(2, 1, 0).contiguous()  # blocks last: the products below are then those of long rows
        rows = [
            of_row @ (values[row].unsqueeze(1) * values[: row + 1].unsqueeze(1)).flatten(1, 2)  # (row + 1, K, blocks)
            for row, of_row in enumerate(of_pairs)
        ]
        parts.append(torch.cat(rows).permute(1, 2, 0).contiguous()[..., pair.flatten()])
    return torch.cat(parts, dim=1).unflatten(2, (pixels, pixels))


@dataclass(frozen=True)
class PatchFactors:
    r"""Covariances of patches as :math:`C \approx F F^\top + \mathrm{diag}(d)`: the strongest modes, and what is left.

    The covariance of a snapshot's blocks then costs a few small products instead of one for every pair of values.

    Attributes:
        factors: F, ``(n, T, K, r)``, so that one product serves all components.
        rest: d, ``(K, T, n)``.
    """

    factors: torch.Tensor
    rest: torch.Tensor

    def to(self, precision: torch.dtype) -> PatchFactors:
        """Return the same in another precision."""
        return PatchFactors(self.factors.to(precision), self.rest.to(precision))

    @classmethod
    def of(cls, covariance: torch.Tensor, rank: int, floor: float = 0.0) -> PatchFactors:
        """Factor covariances of patches of stationary processes, which look the same from the other end.

        A patch read backwards, in time and in space, has the same covariance. Its modes are therefore even or odd, and
        are found in two halves, four times as fast as those of the whole.

        Args:
            covariance: C, ``(K, T, n, T, n)``, with :math:`C_{-i, -j} = C_{ij}`.
            rank: number of modes that are kept at most.
            floor: smallest eigenvalue; smaller ones are raised to it.
        """
        slots, pixels = covariance.shape[1:3]
        values = slots * pixels
        first, rest = values // 2, values - values // 2
        whole = covariance.reshape(-1, values, values)
        near, far = whole[:, :first, :first], whole[:, :first, rest:].flip(2)
        even, odd = whole[:, :rest, :rest].clone(), near - far
        even[:, :first, :first] = near + far
        if rest > first:  # the value in the middle belongs to the even modes
            even[:, first, :first] *= math.sqrt(2)
            even[:, :first, first] *= math.sqrt(2)
        halves = [torch.linalg.eigh(half) for half in (even, odd)]
        eigenvalues, order = torch.cat([half.eigenvalues for half in halves], 1).sort(1)
        vectors = whole.new_zeros(len(whole), values, values)
        top = torch.cat([half.eigenvectors[:, :first] for half in halves], 2) / math.sqrt(2)
        vectors[:, :first] = top
        vectors[:, rest:, :rest] = top[..., :rest].flip(1)
        vectors[:, rest:, rest:] = -top[..., rest:].flip(1)
        if rest > first:
            vectors[:, first, :rest] = halves[0].eigenvectors[:, first]
        vectors = vectors.gather(2, order[:, None].expand_as(vectors))
        rank = min(rank, values)
        eigenvalues = eigenvalues.clamp(min=floor)[:, None]
        factors = vectors[..., -rank:] * eigenvalues[..., -rank:].sqrt()
        left = (vectors[..., :-rank].square() * eigenvalues[..., :-rank]).sum(2)
        shape = (-1, slots, pixels)
        return cls(factors.unflatten(1, shape[1:]).permute(2, 1, 0, 3).contiguous(), left.reshape(shape))

    def block_covariance(self, mask: torch.Tensor, operator: torch.Tensor | None = None) -> torch.Tensor:
        """Return :func:`block_covariance` of these covariances, seen through optics if there are any.

        Args:
            mask: blocks of a mask, ``(blocks, T, n)``.
            operator: how much of the light of every pixel reaches every pixel of the image, ``(m, n)``; None: its own.

        Returns:
            ``(K, blocks, m, m)`` in the precision of the mask.
        """
        components = self.factors.shape[2]
        every = torch.ones(len(mask), components, dtype=torch.bool, device=mask.device)
        covariance = self.covariance_of(mask, operator, every)
        return covariance.unflatten(0, (-1, components)).transpose(0, 1).to(mask.dtype)

    def covariance_of(self, mask: torch.Tensor, operator: torch.Tensor | None, wanted: torch.Tensor) -> torch.Tensor:
        """Return the covariances of some blocks by some components, as :meth:`block_covariance` does of all.

        Args:
            mask: blocks of a mask, ``(blocks, T, n)``.
            operator: as there.
            wanted: ``(blocks, K)`` bool, the P pairs that are asked for.

        Returns:
            ``(P, m, m)`` in the order of ``wanted.nonzero()``, in the precision of the factors, in which they are
            computed.
        """
        precision, (pixels, _, _, rank) = self.factors.dtype, self.factors.shape
        pairs = wanted.flatten().nonzero()[:, 0]
        seen = mask.permute(2, 0, 1).to(precision) @ self.factors.flatten(2)  # (n, blocks, K * r)
        seen = seen.reshape(pixels, -1, rank).transpose(0, 1)[pairs]  # (P, n, r)
        left = torch.einsum("btn,ktn->bkn", mask.square().to(precision), self.rest).flatten(0, 1)[pairs]
        if operator is None:
            covariance = seen @ seen.mT
            covariance.diagonal(dim1=-2, dim2=-1).add_(left)
            return covariance
        operator = operator.to(precision)
        formed = operator @ seen
        return formed @ formed.mT + (operator * left[:, None]) @ operator.mT


@dataclass(frozen=True)
class BlockMoments:
    r"""The first two moments of blocks of a snapshot, for a prior with K components.

    With a patch of video x of mean m and covariance C, and a snapshot :math:`y = A x + e`, the snapshot has the mean
    :math:`A m` and the covariance :math:`S = A C A^\top + N`.

    Attributes:
        total: sum of the mask over time, ``(blocks, n)``: the mean over the level m of the scene.
        inverse: :math:`S^{-1}`, ``(K, blocks, n, n)``.
        log_determinant: of S, ``(K, blocks)``.

    Source: for the estimate any textbook of estimation theory, as Kay, "Fundamentals of statistical signal
    processing", 1993, Section 10.6; in video SCI Yang et al., "Video compressive sensing using Gaussian mixture
    models", IEEE Trans. Image Processing 2014.
    """

    total: torch.Tensor
    inverse: torch.Tensor
    log_determinant: torch.Tensor

    @classmethod
    def of(cls, mask: torch.Tensor, covariance: torch.Tensor, noise_variance: torch.Tensor | float) -> BlockMoments:
        """Compute the moments.

        Args:
            mask: blocks of a mask, ``(blocks, T, n)``.
            covariance: of patches, ``(K, T, n, T, n)``.
            noise_variance: N, of every pixel: a number, ``(blocks, 1)`` or ``(blocks, n)``; positive.

        Raises:
            BadInput: the covariance of a snapshot is not positive definite: the noise is too small for it.
        """
        signal = block_covariance(mask, covariance)
        noise = torch.as_tensor(noise_variance, dtype=mask.dtype, device=mask.device)
        noise = noise.expand(len(mask), mask.shape[2]) if noise.ndim < 2 else noise.expand(-1, mask.shape[2])
        factor, failed = torch.linalg.cholesky_ex(signal + torch.diag_embed(noise))
        if not failed.is_meta and failed.any():
            raise BadInput(
                "the covariance of a snapshot's blocks is not positive definite: the noise is too small for the "
                "precision of a float; set a larger noise"
            )
        log_determinant = 2 * factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)
        inverse = torch.cholesky_inverse(factor).mT.contiguous()  # symmetric, and torch returns columns
        return cls(mask.sum(1), inverse, log_determinant)

    @classmethod
    def to_be_filled(cls, mask: torch.Tensor, components: int) -> BlockMoments:
        """Return moments of blocks ``(blocks, T, n)`` whose inverses and determinants have still to be written."""
        blocks, pixels = len(mask), mask.shape[2]
        inverse = mask.new_empty(components, blocks, pixels, pixels)
        return cls(mask.sum(1), inverse, mask.new_empty(components, blocks))

    def __getitem__(self, blocks: torch.Tensor | slice) -> BlockMoments:
        """Return the moments of some of the blocks."""
        return BlockMoments(self.total[blocks], self.inverse[:, blocks], self.log_determinant[:, blocks])

    def whitened_by_one(
        self, measurement: torch.Tensor, level: float, component: torch.Tensor, kind: torch.Tensor
    ) -> torch.Tensor:
        """Return S^-1 (y - A m), ``(blocks, n)``, of blocks y ``(blocks, n)`` with one component each.

        Args:
            measurement: y.
            level: m, the mean of the video.
            component: of every block, ``(blocks,)``.
            kind: which of the blocks of these moments each block is, ``(blocks,)``.
        """
        pixels = measurement.shape[1]
        deviation = measurement - level * self.total[kind]
        first = (component * self.inverse.shape[1] + kind) * pixels
        rows = first.unsqueeze(1) + torch.arange(pixels, device=first.device)
        # A sum of rows with weights is a product with a symmetric matrix, and reads every matrix once without a copy.
        return F.embedding_bag(rows, self.inverse.reshape(-1, pixels), per_sample_weights=deviation, mode="sum")

    def whitened(self, measurement: torch.Tensor, level: float) -> tuple[torch.Tensor, torch.Tensor]:
        """Return S^-1 (y - A m) and the log-likelihood of y, for every component.

        Args:
            measurement: y, ``(N, blocks, n)``.
            level: m, the mean of the video.

        Returns:
            ``(K, blocks, n, N)`` and, in nats, ``(K, blocks, N)``.
        """
        deviation = (measurement - level * self.total).transpose(0, 1)
        whitened = deviation @ self.inverse  # symmetric, and from this side several times faster on a CPU
        distance = (whitened * deviation).sum(3)
        constant = math.log(2 * math.pi) * deviation.shape[2]
        return whitened.mT, -0.5 * (distance + self.log_determinant.unsqueeze(-1) + constant)


def estimated_patches(
    whitened: torch.Tensor, mask: torch.Tensor, covariance: torch.Tensor, component: torch.Tensor, level: float
) -> torch.Tensor:
    r"""Return the best linear estimate :math:`m + C A^\top S^{-1} (y - A m)` of patches of video.

    Args:
        whitened: S^-1 (y - A m), ``(blocks, n, N)``.
        mask: ``(blocks, T, n)``.
        covariance: C, ``(K, T, n, T, n)``.
        component: which of the K priors each patch has, ``(blocks, N)``.
        level: m.

    Returns:
        ``(blocks, N, T * n)``.
    """
    values = mask.shape[1] * mask.shape[2]
    back = (mask.unsqueeze(1) * whitened.transpose(1, 2).unsqueeze(2)).flatten(2)
    if len(covariance) == 1 or back.is_meta:  # without values nobody knows the components
        return back @ covariance[0].reshape(values, values) + level
    patches = torch.zeros_like(back)
    for number, matrix in enumerate(covariance.reshape(-1, values, values)):
        members = component == number
        patches[members] = back[members] @ matrix
    return patches + level
