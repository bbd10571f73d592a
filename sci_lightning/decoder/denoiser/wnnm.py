"""Weighted nuclear norm minimisation: similar patches, stacked, are nearly a matrix of low rank."""

from __future__ import annotations

from typing import Annotated

import torch
from annotated_types import Interval
from torch.nn import functional as F

from sci_lightning.configuration.bounds import Depth, Positive, Reach, Repeats
from sci_lightning.decoder.denoiser.denoiser import Denoiser
from sci_lightning.errors import BadInput

Side = Annotated[int, Interval(ge=1, le=64)]
"""Side of a patch, in pixels."""

FAR = 1e3
"""Value beyond the border, which makes every patch that contains it dissimilar to all others."""


class WNNM(Denoiser):
    """Groups of similar patches from all frames, whose singular values are shrunk; overlapping patches are averaged.

    The mean of a group's m patches is subtracted first. A singular value s of the rest becomes
    (s + sqrt(s^2 - 4 C)) / 2 with C = 2 weight sqrt(m) strength^2, the larger solution of s' = s - C / s', and 0 where
    there is none: large singular values are shrunk less. H and W are padded to the grid of patches inside. No
    gradients flow through it.

    Args:
        patch: side of a patch in pixels; in a smaller frame the frame's side.
        step: distance in pixels between the patches for which groups are formed.
        reach: largest displacement in rows and columns of similar patches, in pixels; in time all frames are searched.
        neighbours: number of patches in a group, including the one it is formed for.
        every: number of calls for which a search is used; :meth:`reset` ends that early.
        weight: weight of the nuclear norm; with 2.8 the strength is about the standard deviation of the noise.

    Raises:
        BadInput: a number is below 1 (reach: below 0), the step is larger than the patch, or the weight is
            not positive.

    Source: Gu, Xie, Meng, Zuo, Feng and Zhang, "Weighted nuclear norm minimization and its applications to low level
    vision", IJCV 2017; for video SCI: Liu, Yuan, Suo, Brady and Dai, "Rank minimization for snapshot compressive
    imaging", TPAMI 2019.
    """

    def __init__(
        self,
        patch: Side = 8,
        step: Side = 5,
        reach: Reach = 7,
        neighbours: Depth = 20,
        every: Repeats = 8,
        weight: Positive = 2.8,
    ) -> None:
        super().__init__()
        for name, value, least in (
            ("patch", patch, 1),
            ("step", step, 1),
            ("reach", reach, 0),
            ("neighbours", neighbours, 1),
            ("every", every, 1),
        ):
            if value < least:
                raise BadInput(f"decoder.denoiser.{name}={value}: must be at least {least}")
        if step > patch:
            raise BadInput(f"decoder.denoiser.step={step}: must be at most patch={patch}, or pixels are left out")
        if not weight > 0:
            raise BadInput(f"decoder.denoiser.weight={weight}: must be positive")
        self.patch, self.step, self.reach, self.neighbours = patch, step, reach, neighbours
        self.every, self.weight = every, weight
        # A patch that covers the pixel, the group's own, and how far both are from those that they are compared with.
        self.receptive_field = 2 * (patch + reach)
        self.alignment = step
        self.reset()

    def reset(self) -> None:
        self._groups: list[torch.Tensor] = []
        self._calls = 0

    @torch.no_grad()
    def forward(self, video: torch.Tensor, strength: float) -> torch.Tensor:
        """Denoise; ``strength`` is the standard deviation of the noise, in units of the video."""
        height, width = video.shape[-2:]
        patch = min(self.patch, height, width)
        step = min(self.step, patch)
        full = F.pad(video, (0, (patch - width) % step, 0, (patch - height) % step), mode="replicate")
        if self._calls % self.every == 0:
            self._groups = [self._similar(frames, patch, step) for frames in full]
        self._calls += 1
        denoised = [
            self._low_rank(frames, groups, patch, strength) for frames, groups in zip(full, self._groups, strict=True)
        ]
        return torch.stack(denoised)[..., :height, :width]

    def _similar(self, frames: torch.Tensor, patch: int, step: int) -> torch.Tensor:
        """Return the positions of the most similar patches, ``(T, groups, m)``, counted over all frames."""
        t, height, width = frames.shape
        rows, columns = height - patch + 1, width - patch + 1
        reach = self.reach
        around = F.pad(frames, (reach,) * 4, value=FAR)
        offsets = [(dy, dx) for dy in range(-reach, reach + 1) for dx in range(-reach, reach + 1)]
        moves = torch.tensor([dy * columns + dx for dy, dx in offsets], device=frames.device)
        moves = (moves[:, None] + rows * columns * torch.arange(t, device=frames.device)).flatten()
        start = torch.arange(rows * columns, device=frames.device).view(rows, columns)[::step, ::step].flatten()
        groups = []
        for number, frame in enumerate(frames):
            windows = (around[:, reach + dy :, reach + dx :][:, :height, :width] for dy, dx in offsets)
            far = torch.stack([F.avg_pool2d((window - frame).square_(), patch, step) for window in windows])
            far[len(offsets) // 2, number] = -1  # itself comes first, also where others are equal
            nearest = far.flatten(0, 1).flatten(1).topk(min(self.neighbours, len(moves)), 0, largest=False)
            # Where a small frame has too few patches, the group's own patch replaces those beyond the border.
            places = torch.where(
                nearest.values < FAR, start + moves[nearest.indices], start + moves[nearest.indices[0]]
            )
            groups.append(places.T)
        return torch.stack(groups)

    def _low_rank(self, frames: torch.Tensor, groups: torch.Tensor, patch: int, strength: float) -> torch.Tensor:
        """Return the mean ``(T, H, W)`` of all shrunk patches, frame by frame."""
        height, width = frames.shape[1:]
        patches = F.unfold(frames[:, None], patch).transpose(1, 2).flatten(0, 1)  # (places, pixels)
        total, count = torch.zeros_like(patches), patches.new_zeros(len(patches), 1)
        for group in groups:
            stack = patches[group]  # (groups, m, pixels)
            total.index_add_(0, group.flatten(), self._shrink(stack, strength).flatten(0, 1))
            count.index_add_(0, group.flatten(), count.new_ones(group.numel(), 1))
        t = len(frames)
        layers = torch.stack([total, count.expand_as(total)]).view(2 * t, -1, patches.shape[1]).transpose(1, 2)
        summed, counted = F.fold(layers, (height, width), patch).view(2, t, height, width)
        return summed / counted

    def _shrink(self, stack: torch.Tensor, strength: float) -> torch.Tensor:
        """Shrink the singular values of groups ``(groups, m, pixels)`` around the mean of their patches."""
        mean = stack.mean(1, keepdim=True)
        rest = stack - mean
        square, basis = torch.linalg.eigh(
            rest @ rest.mT
        )  # of an m x m matrix: cheaper than the singular vectors of m x pixels
        c = 2 * self.weight * stack.shape[1] ** 0.5 * strength**2
        value = square.clamp(min=0).sqrt()
        kept = torch.where(square > 4 * c, (value + (square - 4 * c).clamp(min=0).sqrt()) / 2, 0)
        share = kept / value.clamp(min=1e-12)
        return mean + (basis * share[:, None]) @ (basis.mT @ rest)
