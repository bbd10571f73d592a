"""The likelihood of snapshots when their scenes are unknown: the scenes are integrated out, block by block."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.blind.prior import BLOCK, ScenePrior
from sci_lightning.diagnosis.blind.sensor_response import SensorResponse
from sci_lightning.diagnosis.model.camera_model import CameraModel, Hypothesis, effect_key
from sci_lightning.diagnosis.model.recent import Recent
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects import OpticsEffect
from sci_lightning.encoder.effects.stage import ExposureEffect, ModulatorEffect, RelayEffect
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.signal import Signal

REACH = 2
"""Pixels around a block from which the optics bring light into it; what comes from further away counts as even."""
WINDOW = 33
"""Side in pixels of the image on which the optics are probed."""
CENTRE = 0.125
"""Part of the field, on every side, that does not count for the mean brightness of a snapshot."""
LEAST_LIGHT = 1e-4
"""Mean light below which a snapshot counts as that bright; black snapshots are left out before."""
IMAGES = 4
"""Images of the patterns that are kept: most hypotheses differ from the last ones elsewhere."""
CHUNK = 8
"""Blocks whose covariances are computed at a time: their matrices stay in the processor's cache."""


@dataclass(frozen=True)
class BlockScores:
    """How likely blocks of snapshots are by one hypothesis.

    Attributes:
        log_likelihood: ``(blocks, N)`` nats; NaN for blocks that were not evaluated or that do not count.
        weights: ``(K,)`` shares of the prior's components that were used.
    """

    log_likelihood: torch.Tensor
    weights: torch.Tensor


@dataclass(frozen=True)
class SeenBlocks:
    """Some blocks of some snapshots in relative light, 1 being the mean of the snapshot, and what is expected there.

    Attributes:
        places: ``(b,)``, which of the blocks that were asked for.
        members: ``(M,)``, which snapshots.
        measured: ``(b, M, n)``.
        per_light: ``(b, M, n)``, recorded signal per relative light, 1.0 being full scale.
        log_density: ``(b, M)``, logarithm of the density of recorded values over that of relative light.
        mean: ``(b, n)``, expected.
        covariance: ``(K, b, n, n)`` of the light, by component of the prior.
        noise: ``(b, n)``, variance of the noise.
    """

    places: torch.Tensor
    members: torch.Tensor
    measured: torch.Tensor
    per_light: torch.Tensor
    log_density: torch.Tensor
    mean: torch.Tensor
    covariance: torch.Tensor
    noise: torch.Tensor


class BlindLikelihood:
    r"""The likelihood of a hypothesis about the camera, whatever the scenes are.

    A snapshot y is turned into light by the inverse of the sensor's response, and into relative light by its mean.
    With a scene x of mean 1 and covariance C, drawn from the prior, a block of it behind the mask matrix A is Gaussian:

    .. math:: y \sim \mathcal{N}\big(A 1,\; A C A^\top + N\big)

    The mask is divided by the mean of its sum over time, so that the likelihood does not depend on the brightness of a
    scene. Blocks do not overlap, and count as independent (a composite likelihood). The prior is a mixture of
    Gaussians, whose shares are estimated for every hypothesis.

    Args:
        model: knows the snapshots and builds the light path of a hypothesis.
        prior: of the scenes.

    Attributes:
        rows, columns: numbers of blocks.
        usable: ``(blocks, N)`` bool: blocks without a saturated pixel.

    Source: Varin, Reid and Firth, "An overview of composite likelihood methods", Statistica Sinica 2011.
    """

    def __init__(self, model: CameraModel, prior: ScenePrior) -> None:
        self.model = model
        self.prior = prior
        observation = model.observation
        height, width = observation.size
        self.rows, self.columns = height // BLOCK, width // BLOCK
        top, left = (height - self.rows * BLOCK) // 2, (width - self.columns * BLOCK) // 2
        self.origin = top, left
        self._images: Recent[torch.Tensor] = Recent(IMAGES)
        signal = observation.dn.double() / observation.full_scale
        self._signal = self.cut(signal, 0).transpose(0, 1)  # (blocks, N, n)
        saturated = self.cut((observation.dn >= observation.full_scale).float(), 0).transpose(0, 1)
        self.usable = ~saturated.bool().any(2)
        down, across = max(1, int(CENTRE * height)), max(1, int(CENTRE * width))
        self._centre = slice(down, height - down), slice(across, width - across)
        self._flat_signal = signal[:, self._centre[0], self._centre[1]].flatten(1)

    def cut(self, image: torch.Tensor, reach: int) -> torch.Tensor:
        """Return the blocks of images ``(C, H, W)`` with ``reach`` pixels around them, ``(C, blocks, n)``."""
        top, left = self.origin
        padded = torch.nn.functional.pad(image[None], (reach,) * 4, mode="replicate")[0] if reach else image
        side = BLOCK + 2 * reach
        padded = padded[:, top : top + self.rows * BLOCK + 2 * reach, left : left + self.columns * BLOCK + 2 * reach]
        return padded.unfold(1, side, BLOCK).unfold(2, side, BLOCK).flatten(3).flatten(1, 2)

    def inside(self, border: Border) -> torch.Tensor:
        """Return ``(blocks,)`` bool: the blocks that lie inside a border."""
        height, width = self.model.observation.size
        counted = torch.zeros(1, height, width)
        rows, columns = border.rounded().window((height, width))
        counted[0, rows, columns] = 1
        return self.cut(counted, 0)[0].bool().all(1)

    @torch.no_grad()
    def evaluate(
        self, hypothesis: Hypothesis, blocks: torch.Tensor | None = None, weights: torch.Tensor | None = None
    ) -> BlockScores:
        """Return the log-likelihood of blocks of every snapshot.

        Args:
            hypothesis: about the camera.
            blocks: ``(blocks,)`` bool, the blocks to be evaluated; None for all. Blocks that depend on what lies
                beyond the patterns do not count.
            weights: ``(K,)`` shares of the prior's components, of which those without a share are left out; None to
                estimate them from these blocks.
        """
        used = torch.ones_like(self.prior.weights, dtype=torch.bool) if weights is None else weights > 0
        counted = self.inside(self.model.border(hypothesis))
        numbers = (counted if blocks is None else counted & blocks).nonzero()[:, 0]
        observation = self.model.observation
        scores = torch.full((int(used.sum()), len(numbers), len(observation)), math.nan, dtype=torch.float64)
        usable = self.usable[numbers]
        for seen in self.moments(hypothesis, numbers):
            covariance = seen.covariance if used.all() else seen.covariance[used]
            covariance.diagonal(dim1=-2, dim2=-1).add_(seen.noise)
            factor = torch.linalg.cholesky(covariance)
            deviation = (seen.measured - seen.mean[:, None]).mT
            whitened = torch.linalg.solve_triangular(factor, deviation, upper=False)
            distance = whitened.square().sum(2)
            determinant = 2 * factor.diagonal(dim1=-2, dim2=-1).log().sum(-1)
            scores[:, seen.places[:, None], seen.members] = seen.log_density - 0.5 * (
                distance + determinant[..., None] + BLOCK**2 * math.log(2 * math.pi)
            )
        if weights is None:
            weights = self.prior.estimate_weights(scores[:, usable])
        mixed = (scores + weights[used].log()[:, None, None]).logsumexp(0)
        every = torch.full(self.usable.shape, math.nan, dtype=torch.float64)
        every[numbers] = torch.where(usable, mixed, math.nan)
        return BlockScores(every, weights)

    @torch.no_grad()
    def moments(self, hypothesis: Hypothesis, numbers: torch.Tensor) -> Iterator[SeenBlocks]:
        """Yield what is expected of some blocks, and what is recorded there, a part of the blocks at a time.

        Args:
            hypothesis: about the camera.
            numbers: of the blocks.
        """
        observation, path = self.model.observation, self.model.path(hypothesis)
        response = SensorResponse.of(path, observation.full_scale)
        light, log_slope = response.light(self._signal[numbers])
        brightness = response.light(self._flat_signal)[0].mean(1).clamp(min=LEAST_LIGHT)
        measured = light / brightness[:, None]
        log_density = -log_slope.sum(2) - BLOCK**2 * brightness.log()
        typical = brightness.mean()
        for which, sequence in enumerate(observation.sequences):
            members = (observation.sequence == which).nonzero()[:, 0]
            relative, operator = self._relative_mask(path, sequence), self._optics(path)
            masks = self.cut(relative, REACH if operator is not None else 0)[:, numbers].transpose(0, 1)
            for part in torch.arange(len(numbers)).split(CHUNK):
                mean, covariance = self._moments(masks[part], operator)
                yield SeenBlocks(
                    places=part,
                    members=members,
                    measured=measured[part][:, members],
                    per_light=brightness[members, None] * log_slope[part][:, members].exp(),
                    log_density=log_density[part][:, members],
                    mean=mean,
                    covariance=covariance,
                    noise=response.noise(mean * typical) / typical.square(),
                )

    def relative_mask(self, hypothesis: Hypothesis, sequence: torch.Tensor) -> torch.Tensor:
        """Return the patterns as the sensor sees them, divided by the mean of their sum, ``(T, H, W)`` float64.

        Args:
            hypothesis: about the camera.
            sequence: which pattern every slot shows, ``(T,)``.
        """
        return self._relative_mask(self.model.path(hypothesis), sequence)

    def _relative_mask(self, path: LightPath, sequence: torch.Tensor) -> torch.Tensor:
        displayed = (*path.of(ModulatorEffect), *path.of(RelayEffect))
        seen = LightPath([*displayed, *path.of(ExposureEffect)], path.grid)
        key = tuple(effect_key(effect) for effect in displayed)
        images = self._images.get(key, lambda: seen.images(self.model.observation.patterns))
        shown = seen.during(images, sequence[None])[0].double()
        return shown / shown.sum(0)[self._centre].mean().clamp(min=1e-6)

    def _optics(self, path: LightPath) -> torch.Tensor | None:
        """Return how much of the light of every pixel around a block falls on every pixel of it, ``(n, m)``."""
        effects = path.of(OpticsEffect)
        if not effects:
            return None
        side, observation = BLOCK + 2 * REACH, self.model.observation
        inner = (WINDOW - side) // 2
        impulses = torch.zeros(side * side, WINDOW, WINDOW)
        places = torch.arange(side * side)
        impulses[places, inner + places // side, inner + places % side] = 1
        size = observation.size
        origin = (size[0] - WINDOW) // 2, (size[1] - WINDOW) // 2
        signal = Signal(impulses, torch.zeros(()), torch.ones(1, 1, 1), 1 / observation.full_scale, origin, size)
        for effect in effects:
            signal = effect.form(signal)
        first = inner + REACH
        formed = signal.mean[:, first : first + BLOCK, first : first + BLOCK]
        return formed.flatten(1).mT.double()

    def _moments(self, mask: torch.Tensor, operator: torch.Tensor | None) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the mean ``(blocks, n)`` and the covariance ``(K, blocks, n, n)`` of blocks without noise."""
        if operator is None:
            return mask.sum(1), self.prior.at_every_contrast(self.prior.factors().block_covariance(mask))
        from_afar = (1 - operator.sum(1)).clamp(min=0)
        covariance = self.prior.factors(BLOCK + 2 * REACH).block_covariance(mask, operator)
        return mask.sum(1) @ operator.mT + from_afar, self.prior.at_every_contrast(covariance)
