"""The likelihood of snapshots when their scenes are unknown: the scenes are integrated out, block by block."""

from __future__ import annotations

import math
from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.blind.block_optics import REACH, optics_of_blocks
from sci_lightning.diagnosis.blind.parallel_map import on_every_core
from sci_lightning.diagnosis.blind.prior import BLOCK, ScenePrior
from sci_lightning.diagnosis.blind.sensor_response import SensorResponse
from sci_lightning.diagnosis.model.camera_model import CameraModel, effect_key
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.model.recent import Recent
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects import Effect
from sci_lightning.encoder.effects.stage import ExposureEffect, ModulatorEffect, RelayEffect
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.relay import RelayGeometry

CENTRE = 0.125
"""Part of the field, on every side, that does not count for the mean brightness of a snapshot."""
LEAST_LIGHT = 1e-4
"""Mean light below which a snapshot counts as that bright; black snapshots are left out before."""
IMAGES = 4
"""Images of the patterns that are kept for every thread: most hypotheses differ from the last ones elsewhere."""
VALUES_AT_A_TIME = 2**26
"""Values of images of patterns that are held at a time, at about 40 bytes each: eight hypotheses about eight slots of
1024 x 1024 pixels."""
BRIGHTNESS = 1e4
"""Variance of the relative brightness of a block: so large that nothing is assumed about it."""
LEAST_SHARE = 1e-2
"""A component matters in a block if it explains this part of it, in one of the snapshots at least."""
DARKEST_PART = 1e-3
"""Part of a snapshot's pixels that may be defects, and darker than no light."""
CHUNK = 8
"""Blocks whose covariances are computed at a time, by one thread."""


@dataclass(frozen=True)
class BlockScores:
    """How likely blocks of snapshots are by one hypothesis.

    Attributes:
        log_likelihood: ``(blocks, N)`` nats; NaN for blocks that were not evaluated or that do not count.
        weights: ``(K,)`` shares of the prior's components that were used.
        likely: ``(K, blocks)`` bool, the components that matter in every block, see :data:`LEAST_SHARE`.
        by_likely: ``log_likelihood`` by these components alone.
    """

    log_likelihood: torch.Tensor
    weights: torch.Tensor
    likely: torch.Tensor
    by_likely: torch.Tensor


@dataclass(frozen=True)
class SeenBlocks:
    """Some blocks of some snapshots in relative light, and what is expected there.

    Relative light is 1 where the light is the mean of the snapshot, what the camera adds to it included; what it adds
    is subtracted.

    Attributes:
        places: ``(b,)``, which of the requested blocks.
        members: ``(M,)``, which snapshots.
        measured: ``(b, M, n)``.
        per_light: ``(b, M, n)``, recorded signal per relative light, 1.0 being full scale.
        log_density: ``(b, M)``, logarithm of the density of recorded values over that of relative light.
        mask: ``(b, T, m)``, the relative mask of the blocks, with pixels around them where there are optics.
        operator: ``(n, m)``, how much of the light of every pixel of the mask falls on every pixel; None: its own.
        mean: ``(b, n)``, expected of scenes of relative brightness 1.
        noise: ``(b, n)``, variance of the noise.
    """

    places: torch.Tensor
    members: torch.Tensor
    measured: torch.Tensor
    per_light: torch.Tensor
    log_density: torch.Tensor
    mask: torch.Tensor
    operator: torch.Tensor | None
    mean: torch.Tensor
    noise: torch.Tensor

    @property
    def deviation(self) -> torch.Tensor:
        """How far the blocks are from what is expected, ``(b, n, M)``."""
        return (self.measured - self.mean[:, None]).mT

    def with_brightness(self, covariance: torch.Tensor, blocks: torch.Tensor) -> torch.Tensor:
        """Return covariances ``(P, n, n)`` of ``blocks`` (P,) of which nobody knows how bright they are."""
        mean = self.mean[blocks]
        return covariance.addcmul(mean[:, :, None], mean[:, None], value=BRIGHTNESS)


class BlindLikelihood:
    r"""The likelihood of a hypothesis about the camera, whatever the scenes are.

    A snapshot y is turned into light by the inverse of the sensor's response, light that is the same everywhere is
    subtracted, and the rest is divided by the snapshot's mean. With a scene x of mean 1 and covariance C, drawn from
    the prior, a block of it behind the mask matrix A is Gaussian:

    .. math:: y \sim \mathcal{N}\big(A 1,\; A C A^\top + b\, A 1\, (A 1)^\top + N\big)

    The mask is divided by the mean of its sum over time, so that the likelihood does not depend on the brightness of a
    scene; nor does it depend on that of a block, whose variance b is nearly endless. The mean that a snapshot is
    divided by is that of all it recorded: were it to depend on a black level, how much texture a scene is expected
    to have would tell the black level, and that is known only roughly. Blocks do not overlap, and count as independent
    (a composite likelihood). The prior is a mixture of Gaussians, whose shares are estimated for every hypothesis.

    Args:
        model: knows the snapshots and builds the light path of a hypothesis.
        prior: of the scenes.

    Attributes:
        rows, columns: numbers of blocks.
        usable: ``(blocks, N)`` bool: blocks without a saturated pixel.

    Sources: Varin, Reid and Firth, "An overview of composite likelihood methods", Statistica Sinica 2011; Patterson and
    Thompson, "Recovery of inter-block information when block sizes are unequal", Biometrika 1971, for the brightness.
    """

    def __init__(self, model: CameraModel, prior: ScenePrior) -> None:
        self.model = model
        self.prior = prior
        observation = model.observation
        height, width = observation.size
        self.rows, self.columns = height // BLOCK, width // BLOCK
        top, left = (height - self.rows * BLOCK) // 2, (width - self.columns * BLOCK) // 2
        self.origin = top, left
        self._images: Recent[torch.Tensor] = Recent(IMAGES * min(torch.get_num_threads(), self.at_a_time))
        recorded, level = observation.dn.unique(return_inverse=True)
        self._levels = recorded.double() / observation.full_scale  # (L,), the values that were recorded at all
        self._level = self.cut(level, 0).transpose(0, 1)  # (blocks, N, n), which of them
        saturated = self.cut((observation.dn >= observation.full_scale).float(), 0).transpose(0, 1)
        self.usable = ~saturated.bool().any(2)
        down, across = max(1, int(CENTRE * height)), max(1, int(CENTRE * width))
        self._centre = slice(down, height - down), slice(across, width - across)
        at_centre = level[:, self._centre[0], self._centre[1]].flatten(1)
        counts = torch.stack([one.bincount(minlength=len(recorded)) for one in at_centre])
        self._shares_of_levels = counts.double() / at_centre.shape[1]  # (N, L)
        pixels = level.flatten(1)
        self._darkest = self._levels[pixels.kthvalue(1 + int(DARKEST_PART * pixels.shape[1])).values]  # (N,)

    @property
    def at_a_time(self) -> int:
        """How many hypotheses may be evaluated at a time: each holds the patterns' images of the whole field."""
        observation = self.model.observation
        height, width = observation.size
        return max(1, VALUES_AT_A_TIME // (observation.frames * height * width))

    def with_prior(self, prior: ScenePrior) -> BlindLikelihood:
        """Return the likelihood of the same snapshots with another prior."""
        view = copy(self)
        view.prior = prior
        return view

    def cut(self, image: torch.Tensor, reach: int, numbers: torch.Tensor | None = None) -> torch.Tensor:
        """Return blocks of images ``(C, H, W)`` with ``reach`` pixels around them, ``(C, blocks, n)``; None for all."""
        top, left = self.origin
        padded = torch.nn.functional.pad(image[None], (reach,) * 4, mode="replicate")[0] if reach else image
        side = BLOCK + 2 * reach
        padded = padded[:, top : top + self.rows * BLOCK + 2 * reach, left : left + self.columns * BLOCK + 2 * reach]
        blocks = padded.unfold(1, side, BLOCK).unfold(2, side, BLOCK)
        if numbers is None:
            return blocks.flatten(3).flatten(1, 2)
        return blocks[:, numbers // self.columns, numbers % self.columns].flatten(2)

    def inside(self, border: Border) -> torch.Tensor:
        """Return ``(blocks,)`` bool: the blocks that lie inside a border."""
        height, width = self.model.observation.size
        counted = torch.zeros(1, height, width)
        rows, columns = border.rounded().window((height, width))
        counted[0, rows, columns] = 1
        return self.cut(counted, 0)[0].bool().all(1)

    @torch.no_grad()
    def evaluate(
        self,
        hypothesis: Hypothesis,
        blocks: torch.Tensor | None = None,
        weights: torch.Tensor | None = None,
        likely: torch.Tensor | None = None,
    ) -> BlockScores:
        """Return the log-likelihood of blocks of every snapshot.

        Args:
            hypothesis: about the camera.
            blocks: ``(blocks,)`` bool, the blocks to be evaluated; None for all. Blocks that depend on what lies
                beyond the patterns do not count.
            weights: ``(K,)`` shares of the prior's components, of which those without a share are left out; None to
                estimate them from these blocks.
            likely: ``(K, blocks)`` bool, the components that count in every block; None for all.
        """
        counted = self.inside(self.model.border(hypothesis))
        numbers = (counted if blocks is None else counted & blocks).nonzero()[:, 0]
        count, observation = len(self.prior.weights), self.model.observation
        requested = self.prior.active[:, None].expand(-1, len(numbers)) if likely is None else likely[:, numbers]
        if weights is not None:
            requested = requested & (weights > 0)[:, None]
        scores = torch.full((count, len(numbers), len(observation)), -math.inf, dtype=torch.float64)

        def score(seen: SeenBlocks) -> None:
            """Write the log-likelihood of some blocks by every requested component."""
            deviation = seen.deviation
            for component, block, covariance in self.prior.covariances(
                seen.mask, seen.operator, requested[:, seen.places]
            ):
                covariance = seen.with_brightness(covariance, block)
                covariance.diagonal(dim1=-2, dim2=-1).add_(seen.noise[block])
                factor = torch.linalg.cholesky(covariance)
                whitened = torch.linalg.solve_triangular(factor, deviation[block], upper=False)
                distance = whitened.square().sum(1)
                determinant = 2 * factor.diagonal(dim1=-2, dim2=-1).log().sum(-1, keepdim=True)
                nats = -0.5 * (distance + determinant + BLOCK**2 * math.log(2 * math.pi))
                scores[component[:, None], seen.places[block, None], seen.members] = seen.log_density[block] + nats

        on_every_core(score, self.moments(hypothesis, numbers))
        usable = self.usable[numbers]
        if weights is None:
            weights = self.prior.estimate_weights(scores[:, usable])
        weighted = scores + weights.log()[:, None, None]
        # Fits differentiate by the components that matter in a block alone; the others explain too little to count.
        share = torch.where(usable, weighted.softmax(0), 0.0).amax(2)
        matters = share > (share.amax(0) / 2).clamp(max=LEAST_SHARE)

        def of_every_block(by_component: torch.Tensor) -> torch.Tensor:
            every = torch.full(self.usable.shape, math.nan, dtype=torch.float64)
            every[numbers] = torch.where(usable, by_component.logsumexp(0), math.nan)
            return every

        in_blocks = torch.zeros(count, len(self.usable), dtype=torch.bool)
        in_blocks[:, numbers] = matters
        by_likely = of_every_block(weighted.masked_fill(~matters[..., None], -math.inf))
        return BlockScores(of_every_block(weighted), weights, in_blocks, by_likely)

    @torch.no_grad()
    def moments(self, hypothesis: Hypothesis, numbers: torch.Tensor) -> Iterator[SeenBlocks]:
        """Yield what is expected of some blocks, and what is recorded there, a part of the blocks at a time.

        Args:
            hypothesis: about the camera.
            numbers: of the blocks.
        """
        observation, path = self.model.observation, self.model.path(hypothesis)
        response = SensorResponse.of(path, observation.full_scale)
        light_of_level, log_slope_of_level = response.light(self._levels)
        light, log_slope = light_of_level[self._level[numbers]], log_slope_of_level[self._level[numbers]]
        brightness = (self._shares_of_levels @ light_of_level).clamp(min=LEAST_LIGHT)
        operator, everywhere = optics_of_blocks(path, observation)
        unit = (brightness + response.without_light).clamp(min=LEAST_LIGHT)
        measured = (light - everywhere * brightness[:, None]) / unit[:, None]
        log_density = -log_slope.sum(2) - BLOCK**2 * unit.log()
        typical = unit.mean()  # a black level included, of which the noise would otherwise tell
        for which, sequence in enumerate(observation.sequences):
            members = (observation.sequence == which).nonzero()[:, 0]
            reach = 0 if operator is None else REACH
            relative = self._relative_mask(path, sequence, self._pixels_of(numbers, reach))
            masks = self.cut(relative, reach, numbers).transpose(0, 1)
            total = masks.sum(1)
            mean = total if operator is None else total @ operator.mT + (1 - operator.sum(1)).clamp(min=0)
            expected = torch.lerp(mean, torch.ones_like(mean), everywhere) * typical
            noise = response.noise(expected) / typical.square()
            light_of_members, per_light = measured[:, members], unit[members, None] * log_slope[:, members].exp()
            for first in range(0, len(numbers), CHUNK):
                part = slice(first, first + CHUNK)
                yield SeenBlocks(
                    places=torch.arange(len(numbers))[part],
                    members=members,
                    measured=light_of_members[part],
                    per_light=per_light[part],
                    log_density=log_density[part][:, members],
                    mask=masks[part],
                    operator=operator,
                    mean=mean[part],
                    noise=noise[part],
                )

    @torch.no_grad()
    def below_no_light(self, hypothesis: Hypothesis) -> float:
        """Return by how much the darkest pixels of a snapshot had less light than none, in standard deviations.

        The Gaussian prior does not know that light is never negative, so that a black level or a veiling glare may come
        out above what was recorded where it is darkest. Defects do not count; without any light, noise alone would
        bring the darkest of the other pixels to three standard deviations. The largest figure of any snapshot is
        returned; it is negative where there is light.

        Args:
            hypothesis: about the camera.
        """
        path = self.model.path(hypothesis)
        response = SensorResponse.of(path, self.model.observation.full_scale)
        light_of_level, _ = response.light(self._levels)
        brightness = (self._shares_of_levels @ light_of_level).clamp(min=LEAST_LIGHT)
        everywhere = optics_of_blocks(path, self.model.observation)[1] * brightness
        darkest, _ = response.light(self._darkest)
        return float(((everywhere - darkest) / response.noise(everywhere).sqrt()).max())

    def relative_mask(
        self, hypothesis: Hypothesis, sequence: torch.Tensor, requested: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Return the patterns as the sensor sees them, divided by the mean of their sum, ``(T, H, W)`` float64.

        Args:
            hypothesis: about the camera.
            sequence: which pattern every slot shows, ``(T,)``.
            requested: ``(H, W)`` bool, where they are asked for; None: everywhere.
        """
        return self._relative_mask(self.model.path(hypothesis), sequence, requested)

    def _relative_mask(
        self, path: LightPath, sequence: torch.Tensor, requested: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Return the relative mask ``(T, H, W)``, which is right where it is ``requested``; None: everywhere.

        The image of a turned or distorted mask takes long, and is computed there only. What it is divided by is the
        mean of the mask that is neither turned nor distorted, so that it does not depend on what is requested: the mean
        over so many mirrors is the same.
        """
        effects = [effect for effect in path.effects.values() if isinstance(effect, Effect)]
        upright = [effect for effect in effects if path.grid is not None or not _turns(effect)]
        even = self._shown(LightPath(upright, path.grid), sequence)
        seen = even if len(upright) == len(effects) else self._shown(path, sequence, requested)
        return seen / even.sum(0)[self._centre].mean().clamp(min=1e-6)

    def _shown(self, path: LightPath, sequence: torch.Tensor, requested: torch.Tensor | None = None) -> torch.Tensor:
        """Return what multiplies each frame of the scene where it is ``requested``, ``(T, H, W)`` float64."""
        before_lens = (*path.of(ModulatorEffect), *path.of(RelayEffect), *path.of(ExposureEffect))
        seen = LightPath(before_lens, path.grid)
        where = None if requested is None else requested.numpy().tobytes()
        key = (where, *(effect_key(effect) for effect in seen.imaging))
        images = self._images.get(key, lambda: seen.images(self.model.observation.patterns, requested))
        return seen.during(images, sequence[None])[0].double()

    def _pixels_of(self, numbers: torch.Tensor, reach: int) -> torch.Tensor:
        """Return the pixels of blocks and as many around them as ``reach`` says, ``(H, W)`` bool."""
        chosen = torch.zeros(1, 1, self.rows, self.columns)
        chosen.view(-1)[numbers] = 1
        (height, width), (top, left) = self.model.observation.size, self.origin
        below, right = height - top - self.rows * BLOCK, width - left - self.columns * BLOCK
        field = chosen.repeat_interleave(BLOCK, -2).repeat_interleave(BLOCK, -1)
        field = torch.nn.functional.pad(field, (left, right, top, below))
        return torch.nn.functional.max_pool2d(field, 2 * reach + 1, stride=1, padding=reach)[0, 0].bool()


def _turns(effect: Effect) -> bool:
    """Return whether an effect turns or distorts the image of the mask."""
    return isinstance(effect, RelayEffect) and effect.aim(RelayGeometry()).turned


def spread(blocks: torch.Tensor, count: int) -> torch.Tensor:
    """Return so many of the blocks, spread evenly."""
    numbers = blocks.nonzero()[:, 0]
    if len(numbers) > count:
        numbers = numbers[torch.linspace(0, len(numbers) - 1, count).round().long()]
    spread = torch.zeros_like(blocks)
    spread[numbers] = True
    return spread
