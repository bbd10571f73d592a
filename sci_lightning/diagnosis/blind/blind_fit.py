"""Fits of a hypothesis to snapshots of unknown scenes, and how precisely its parameters are known."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import torch
from scipy.stats import t as student

from sci_lightning.diagnosis.blind.likelihood import BlindLikelihood, spread
from sci_lightning.diagnosis.blind.parallel_map import on_every_core
from sci_lightning.diagnosis.blind.prior import BLOCK
from sci_lightning.diagnosis.fit.information_criterion import bic_penalty
from sci_lightning.diagnosis.fit.levenberg_marquardt import MIN_PROGRESS_NATS, maximise
from sci_lightning.diagnosis.fit.parameters import FreeParameters
from sci_lightning.diagnosis.model.hypothesis import NOISE_GUESS, Hypothesis, ParameterName

DIFFERENCE_STEP = 0.5
"""Part of a parameter's step over which the likelihood is differentiated."""
CATCH_UP_SHARE = 0.05
"""Part of what a fit lacks to what it competes with that an iteration must gain; a slower one does not catch up."""
MAX_ATTEMPTS = 5
"""Steps that are tried in an iteration, each with more damping than the one before."""
ROUGH_BLOCKS = 64
"""Blocks that are enough for the direction of a Newton step, spread evenly over those that are fitted."""
TILE = 2
"""Blocks along the side of a tile; blocks of one tile do not count as independent of each other."""
MIN_BLOCKS_FOR_TILES = 64
"""Of fewer blocks every one counts by itself: tiles would be too few to say anything."""
MIN_SNAPSHOTS = 3
"""Snapshots from which their differences are a measure of the uncertainty."""


@dataclass(frozen=True)
class BlindFit:
    """A fitted hypothesis.

    Attributes:
        hypothesis: with its most likely parameters.
        log_likelihood: ``(blocks, N)`` nats; NaN for blocks that were not evaluated or that do not count.
        blocks: ``(blocks,)`` bool, the blocks that were fitted.
        free: names of the fitted parameters.
        covariance: ``(p, p)`` of their errors, from the differences between blocks and snapshots.
        weights: ``(K,)`` shares of the prior's components.
        likely: ``(K, blocks)`` bool, the components that matter in every block.
        by_likely: ``(blocks, N)`` log-likelihood by these components alone, which is what is differentiated.
    """

    hypothesis: Hypothesis
    log_likelihood: torch.Tensor
    blocks: torch.Tensor
    free: tuple[ParameterName, ...] = ()
    covariance: torch.Tensor = field(default_factory=lambda: torch.zeros(0, 0))
    weights: torch.Tensor = field(default_factory=lambda: torch.zeros(0))
    likely: torch.Tensor | None = None
    by_likely: torch.Tensor = field(default_factory=lambda: torch.zeros(0))

    @property
    def nats(self) -> float:
        """Log-likelihood of all blocks that count."""
        return float(self.log_likelihood.nansum())


@dataclass(frozen=True)
class BlindDerivatives:
    """Derivatives of the log-likelihood with respect to p parameters.

    Attributes:
        scores: ``(p, blocks, N)`` of every block.
        information: ``(p, p)``, positive definite.
        curvature: ``(p, p)`` second derivatives of the sum.
    """

    scores: torch.Tensor
    information: torch.Tensor
    curvature: torch.Tensor


class BlindFitter:
    """Fits hypotheses to snapshots.

    Args:
        likelihood: of a hypothesis.
    """

    def __init__(self, likelihood: BlindLikelihood) -> None:
        self.likelihood = likelihood
        self.model = likelihood.model
        self._fixed = tuple((name, parameter) for name, (parameter, _) in NOISE_GUESS.items())

    def evaluate(self, hypothesis: Hypothesis, blocks: torch.Tensor, weights: torch.Tensor | None = None) -> BlindFit:
        """Return a hypothesis as it stands, without fitting anything but the prior's shares."""
        scores = self.likelihood.evaluate(hypothesis, blocks, weights)
        fit = BlindFit(hypothesis, scores.log_likelihood, blocks, weights=scores.weights)
        return replace(fit, likely=scores.likely, by_likely=scores.by_likely)

    def fit(
        self,
        hypothesis: Hypothesis,
        blocks: torch.Tensor,
        iterations: int = 10,
        alone: str | None = None,
        errors: bool = True,
        rough: bool = True,
        enough: float | None = None,
        ahead: torch.Tensor | None = None,
    ) -> BlindFit:
        """Maximise the likelihood of some blocks over all parameters but choices and the noise.

        Every iteration differentiates the log-likelihood of every block once and twice by every parameter. The Newton
        step is damped until it does not lower the likelihood (Levenberg and Marquardt).

        Args:
            hypothesis: where to start.
            blocks: ``(blocks,)`` bool: blocks to be fitted.
            iterations: at most.
            alone: the effect whose parameters alone are fitted; None: those of all effects.
            errors: whether the covariance of the parameters' errors is estimated, which takes as long as an iteration.
            rough: whether a part of the blocks is enough for how the errors depend on each other.
            enough: nats below which an iteration that gains no more is the last one; None: ``MIN_PROGRESS_NATS``.
            ahead: ``(blocks, N)`` log-likelihood of what the fit competes with. An iteration that gains less than
                :data:`CATCH_UP_SHARE` of what lacks to it is the last one. None: there is nothing.
        """
        others = () if alone is None else [name for name in hypothesis.effects if name != alone]
        constant = tuple((name, parameter) for name in others for parameter in hypothesis.effects[name])
        free = FreeParameters.of(self.model, hypothesis, (*self._fixed, *constant))
        enough = MIN_PROGRESS_NATS if enough is None else enough
        best = self.evaluate(hypothesis, blocks)
        covariance = torch.zeros(len(free), len(free), dtype=torch.float64)
        if not len(free):
            return replace(best, blocks=blocks, free=free.names, covariance=covariance)
        curvature: torch.Tensor | None = None

        def differentiate(at: BlindFit) -> BlindDerivatives:
            nonlocal curvature  # mixed second derivatives take most of the time: they are computed at the start only
            derivatives = self._differentiate(free, at, curvature, rough=True)
            curvature = derivatives.curvature
            return derivatives

        def step(at: BlindFit, derivatives: BlindDerivatives, damping: float, attempt: int) -> tuple[BlindFit, float]:
            nonlocal blocks  # those that a step loses, because the image of the mask ends there, stay lost
            gradient = derivatives.scores.sum((1, 2))
            moved, _ = free.newton_step(at.hypothesis, gradient, derivatives.information, damping)
            trial = self.evaluate(moved, blocks)
            lost = at.log_likelihood.isfinite() & ~trial.log_likelihood.isfinite()
            if lost.any():
                blocks = blocks & ~lost.any(1)
            return trial, float((trial.log_likelihood - at.log_likelihood).nansum())

        def needed(at: BlindFit) -> float:
            behind = 0.0 if ahead is None else float((ahead - at.log_likelihood).nansum())
            return max(enough, CATCH_UP_SHARE * behind)

        best, _ = maximise(best, differentiate, step, needed, iterations, MAX_ATTEMPTS)
        if errors:
            derivatives = self._differentiate(free, best, rough=rough)
            covariance = errors_of(derivatives.information, clustered(derivatives.scores, self.likelihood.columns))
        return replace(best, blocks=blocks, free=free.names, covariance=covariance)

    def distance(self, fit: BlindFit, name: str) -> float:
        """Return how far an effect is from doing nothing, in nats: half its squared distance in standard deviations.

        It is infinite for a choice, and for parameters without a neutral value.
        """
        offsets = self._offsets(fit, name)
        places = list(offsets)
        if not places:
            return math.inf
        offset = torch.tensor(list(offsets.values()), dtype=torch.float64)
        inverse = torch.linalg.pinv(fit.covariance[places][:, places], hermitian=True)
        return 0.5 * float(offset @ inverse @ offset)

    def weakened(self, fit: BlindFit, name: str, deviations: float) -> Hypothesis:
        """Return a fitted hypothesis with one effect nearer to doing nothing, by so many standard deviations."""
        setting = dict(fit.hypothesis.effects[name])
        for place, offset in self._offsets(fit, name).items():
            error = deviations * math.sqrt(max(float(fit.covariance[place, place]), 0.0))
            parameter = fit.free[place][1]
            setting[parameter] = float(setting[parameter]) - math.copysign(min(abs(offset), error), offset)
        return fit.hypothesis.with_effect(name, setting)

    def _offsets(self, fit: BlindFit, name: str) -> dict[int, float]:
        """Return how far the fitted parameters of an effect are from doing nothing, by their places in ``fit.free``."""
        about, setting = self.model.effects[name].about, fit.hypothesis.effects[name]
        return {
            place: float(setting[parameter]) - neutral
            for place, (effect, parameter) in enumerate(fit.free)
            if effect == name
            and isinstance(neutral := about[parameter].neutral, (int, float))
            and not (about[parameter].choices or about[parameter].log)
        }

    def _differentiate(
        self, free: FreeParameters, fit: BlindFit, earlier: torch.Tensor | None = None, rough: bool = False
    ) -> BlindDerivatives:
        """Differentiate the log-likelihoods of all blocks once and twice, by differences.

        Far from the maximum some directions may be curved upwards; in the information their sign is reversed, so that a
        Newton step still leads uphill.

        Args:
            free: the parameters.
            fit: where the likelihood is differentiated.
            earlier: second derivatives at an earlier place; the mixed ones are taken from there, in proportion to the
                others. None: they are computed.
            rough: whether a part of the blocks is enough for the mixed second derivatives.
        """
        steps = [self._step(fit, *name) for name in free.names]
        count = len(steps)
        mixed = [(i, j) for i in range(count) for j in range(i)] if earlier is None else []
        moves = [
            {name: place * step} for name, (step, places) in zip(free.names, steps, strict=True) for place in places
        ]
        some = replace(fit, blocks=spread(fit.blocks, ROUGH_BLOCKS)) if rough else fit
        tasks = [(fit, move) for move in moves]
        tasks += [(some, {free.names[i]: steps[i][1][0] * steps[i][0] for i in pair}) for pair in mixed]
        changes = on_every_core(lambda task: self._change(*task), tasks, self.likelihood.at_a_time)
        curvature = torch.zeros(count, count, dtype=torch.float64)
        scores, whole_over_some = [], []
        for i, (near, far) in enumerate(zip(changes[: 2 * count : 2], changes[1 : 2 * count : 2], strict=True)):
            a, b = steps[i][1]  # a parabola through three places
            scores.append(((near * b / a - far * a / b) / (b - a)).nan_to_num(0.0))
            second = 2 * (far / b - near / a) / (b - a)
            curvature[i, i] = second.nansum()
            whole_over_some.append(float((curvature[i, i] / second[some.blocks].nansum()).abs().nan_to_num(1.0, 1.0)))
        for (i, j), both in zip(mixed, changes[2 * count :], strict=True):
            apart = float((both - changes[2 * i] - changes[2 * j]).nansum()) / (steps[i][1][0] * steps[j][1][0])
            curvature[i, j] = curvature[j, i] = apart * math.sqrt(whole_over_some[i] * whole_over_some[j])
        scale = torch.tensor([1 / step for step, _ in steps], dtype=torch.float64)
        if earlier is not None:
            before = earlier / (scale[:, None] * scale)
            grown = (curvature.diagonal() / before.diagonal()).abs().nan_to_num(1.0, 1.0).sqrt()
            curvature = (before * grown[:, None] * grown).fill_diagonal_(0.0) + curvature
        values, vectors = torch.linalg.eigh(-curvature)
        least = max(1e-6 * float(values.abs().max()), 1e-9)
        information = vectors @ torch.diag(values.abs().clamp(min=least)) @ vectors.mT
        both = scale[:, None] * scale
        return BlindDerivatives(torch.stack(scores) * scale[:, None, None], information * both, curvature * both)

    def _step(self, fit: BlindFit, name: str, parameter: str) -> tuple[float, tuple[float, float]]:
        """Return a parameter's step for differences, and the two places, in steps, that lie within its bounds."""
        about = self.model.effects[name].about[parameter]
        value = float(fit.hypothesis.effects[name][parameter])
        step = about.step * DIFFERENCE_STEP * (value if about.log else 1.0)
        if value - step >= about.low and value + step <= about.high:
            return step, (-1.0, 1.0)
        return step, (1.0, 2.0) if value + 2 * step <= about.high else (-1.0, -2.0)

    def _change(self, fit: BlindFit, moved: dict[ParameterName, float]) -> torch.Tensor:
        """Return by how much the log-likelihood of every block changes ``(blocks, N)`` if parameters are moved."""
        hypothesis = fit.hypothesis
        for (name, parameter), offset in moved.items():
            setting = hypothesis.effects[name]
            hypothesis = hypothesis.with_effect(name, {**setting, parameter: float(setting[parameter]) + offset})
        moved_scores = self.likelihood.evaluate(hypothesis, fit.blocks, fit.weights, fit.likely)
        return moved_scores.log_likelihood - fit.by_likely


def errors_of(information: torch.Tensor, scores: torch.Tensor) -> torch.Tensor:
    """Return the covariance ``(p, p)`` of the errors of the parameters that make snapshots likeliest.

    The prior is only roughly right, so that the covariance of the scores counts and not the information alone. Where
    snapshots say nothing about a direction, their scores do not differ either: no direction is known better than it
    would be by a right prior.

    Args:
        information: ``(p, p)``, positive definite.
        scores: ``(p, p)``, covariance of the scores of all blocks.
    """
    values, vectors = torch.linalg.eigh(information)
    whitening = vectors / values.sqrt()
    more, directions = torch.linalg.eigh(whitening.mT @ scores @ whitening)
    root = whitening @ directions
    return root @ (more.clamp(min=1.0)[:, None] * root.mT)


def price(fit: BlindFit, other: BlindFit) -> float:
    """Return how many nats the parameters of a fit cost beyond those of another one, by the blocks that both explain.

    It is the penalty of the Bayesian information criterion, one for both: blocks that only one of them loses, because
    the image of the mask ends there, make no parameter cheaper.
    """
    common = fit.log_likelihood.isfinite() & other.log_likelihood.isfinite()
    return price_of(_parameters(fit.hypothesis) - _parameters(other.hypothesis), int(common.sum()))


def price_of(parameters: int, blocks: int) -> float:
    """Return how many nats so many parameters cost that are fitted to so many blocks."""
    return bic_penalty(parameters, max(blocks * BLOCK**2, 2))


def _parameters(hypothesis: Hypothesis) -> int:
    return sum(len(setting) for name, setting in hypothesis.effects.items() if name not in NOISE_GUESS)


def tiles(scores: torch.Tensor, columns: int) -> torch.Tensor:
    """Return the sums of ``scores`` (p, blocks, N) over the blocks of every tile, ``(p, tiles * N)``."""
    grid = scores.reshape(len(scores), -1, columns, scores.shape[2])
    if grid[0].numel() < MIN_BLOCKS_FOR_TILES:
        return grid.flatten(1)
    down, across = (-(-side // TILE) * TILE for side in grid.shape[1:3])
    grid = torch.nn.functional.pad(grid, (0, 0, 0, across - grid.shape[2], 0, down - grid.shape[1]))
    return grid.unflatten(2, (-1, TILE)).unflatten(1, (-1, TILE)).sum((2, 4)).flatten(1)


def clustered(scores: torch.Tensor, columns: int) -> torch.Tensor:
    """Return the covariance ``(p, p)`` of the sums of ``scores`` (p, blocks, N) over blocks and snapshots.

    Tiles of blocks count as independent, and snapshots; of the two estimates the larger one (by its trace) is
    returned. Few snapshots say little about their differences, so that their estimate is enlarged by Student's factor.

    Source: White, "Maximum likelihood estimation of misspecified models", Econometrica 1982, for clusters.
    """
    best = _spread(tiles(scores, columns))
    sums = scores.sum(1)
    sums = sums[:, (sums != 0).any(0)]
    number = sums.shape[1]
    if number >= MIN_SNAPSHOTS:
        between = _spread(sums) * (student.ppf(0.975, number - 1) / 1.96) ** 2
        best = between if float(between.trace()) > float(best.trace()) else best
    elif number == 1:
        best = best * 4  # a single scene says nothing about how scenes differ
    return best


def _spread(values: torch.Tensor) -> torch.Tensor:
    """Return the covariance of the sum of independent values ``(p, n)``, from how they differ; zeros do not count."""
    values = values[:, (values != 0).any(0)]
    number = values.shape[1]
    centred = values - values.mean(1, keepdim=True) if number > 1 else values
    return centred @ centred.mT * (number / max(number - 1, 1))
