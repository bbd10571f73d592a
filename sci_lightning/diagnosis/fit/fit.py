"""Joint fits: all parameters of a hypothesis and its maps, by Newton's method on the interval likelihood."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import torch

from sci_lightning.diagnosis.fit.split import Split
from sci_lightning.diagnosis.model.camera_model import CameraModel, Hypothesis, Prediction
from sci_lightning.diagnosis.model.ceiling import Ceiling
from sci_lightning.diagnosis.model.fixed_pattern_map import Chart, chart_of, derivative
from sci_lightning.diagnosis.model.likelihood import Intervals, Score, log_likelihood, score
from sci_lightning.diagnosis.model.map_system import ChartSystem
from sci_lightning.diagnosis.search_settings import SearchSettings

DIFFERENCE = 0.1
"""Derivatives are differences over so much of a parameter's step .."""
FINE = 1e-3
""".. and those of the log-likelihood itself, which is curved, over so much of it."""
SHORTER = 0.4
"""Part of a map's step that is tried next when the whole was too far."""

Name = tuple[str, str]
"""Effect and parameter."""


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis.

    Attributes:
        hypothesis: with its best parameters and maps.
        prediction: of every capture.
        fitted: log-likelihood of the fitted pixels, the maps' prior and uncertainty counted in, nats.
        held: log-likelihood of the pixels held out.
        free: what was fitted.
        information: ``(p, p)`` of the free parameters (as fitted: of logarithms, where they are), maps marginalised.
        jacobian: ``(p, N, H, W)`` of the mean, DN per unit; None unless asked for.
        charts: the maps' own statistics, by effect.
    """

    hypothesis: Hypothesis
    prediction: Prediction
    fitted: float
    held: float
    free: tuple[Name, ...] = ()
    information: torch.Tensor = field(default_factory=lambda: torch.zeros(0, 0))
    charts: dict[str, Chart] = field(default_factory=dict)

    @property
    def total(self) -> float:
        """Nats, fitted and held out."""
        return self.fitted + self.held


class Fitter:
    """Fits hypotheses to the fitted part of the captures.

    Args:
        model: what predicts.
        split: which pixels may be seen.
        settings: thresholds and budgets; None for the defaults.
    """

    def __init__(self, model: CameraModel, split: Split, settings: SearchSettings | None = None) -> None:
        self.model = model
        self.split = split
        self.settings = settings or SearchSettings()
        self.use = split.fitted.float()
        self._intervals: dict[int, Intervals] = {}

    def intervals(self, bits: int) -> Intervals:
        """Of the captures' DN, for so many effective bits."""
        if bits not in self._intervals:
            seen = self.model.observation
            self._intervals[bits] = Intervals.of(seen.dn, seen.bit_depth, bits)
        return self._intervals[bits]

    def score(self, prediction: Prediction) -> Score:
        """Log-likelihood and derivatives of every pixel."""
        return score(self.intervals(prediction.bits), prediction.mean, prediction.deviation, prediction.ceiling)

    def values(self, prediction: Prediction) -> torch.Tensor:
        """Log-likelihood of every pixel ``(N, H, W)``."""
        intervals = self.intervals(prediction.bits)
        return log_likelihood(intervals, prediction.mean, prediction.deviation, prediction.ceiling)

    def explained(self, fit: Fit, before: Fit, noise: Fit) -> float:
        """Nats that the mean of one fit gains on another's where the noise is a third's: noise explains nothing."""
        deviation, bits = noise.prediction.deviation, fit.prediction.bits
        after, ideal = (Prediction(each.prediction.mean, deviation, bits) for each in (fit, before))
        return max(0.0, float((self.values(after) - self.values(ideal)).sum(dtype=torch.float64)))

    def charts(self, hypothesis: Hypothesis, prediction: Prediction, now: Score) -> list[Chart]:
        """The state of every map of a hypothesis."""
        return [
            chart_of(self.model, hypothesis, name, prediction, now, self.use)
            for name in hypothesis.effects
            if self.model.known[name].map_kind
        ]

    def free_parameters(self, hypothesis: Hypothesis) -> list[Name]:
        """All numbers that a fit may move; choices and the sizes of maps are found otherwise."""
        found = []
        for name in hypothesis.effects:
            effect = self.model.known[name]
            if effect.map_kind is None:
                found += [(name, each) for each in hypothesis.effects[name] if not effect.about[each].choices]
        return found

    def fit(
        self, hypothesis: Hypothesis, iterations: int = 12, fixed: tuple[Name, ...] = (), charts: bool = True
    ) -> Fit:
        """The best parameters near those given.

        Args:
            hypothesis: where to start.
            iterations: at most.
            fixed: parameters that stay as they are.
            charts: whether maps are fitted too.
        """
        free = [each for each in self.free_parameters(hypothesis) if each not in fixed]
        damping, value = 1e-3, -math.inf
        prediction = self.model.predict(hypothesis)
        found: dict[str, Chart] = {}
        information = torch.zeros(len(free), len(free))
        for _ in range(iterations):
            now = self.score(prediction)
            if charts:
                found = {chart.name: chart for chart in self.charts(hypothesis, prediction, now)}
            system = ChartSystem(list(found.values()), now.weight * self.use)
            slope, information, follow = self._newton(hypothesis, free, prediction, now, system)
            alone = system.solve(system.pull[None])
            if not math.isfinite(value):
                value = float((now.value * self.use).sum(dtype=torch.float64)) - sum(c.cost for c in found.values())
            before = value
            for attempt in range(6):
                moved, step = self._move(hypothesis, free, slope, information, damping)
                steps = system.parts((alone - step @ follow) * SHORTER**attempt)
                for chart, each in zip(system.charts, steps, strict=True):
                    setting, values = chart.moved(each[0])
                    moved = moved.having(chart.name, setting, values)
                trial = self.model.predict(moved)
                reached = float((self.values(trial) * self.use).sum(dtype=torch.float64))
                if found:
                    weight = now.weight * self.use * _variance(prediction) / _variance(trial)
                    for name, chart in found.items():
                        weights = chart.gather(derivative(self.model, moved, name, trial).square() * weight).double()
                        reached -= chart.cost_of(moved.charts[name], weights)
                if reached >= value:
                    hypothesis, prediction, value = moved, trial, reached
                    damping = max(damping / 10, 1e-6)
                    break
                damping = max(damping * 20, 1e-2)
            if value - before < self.settings.min_progress_nats:
                break
        held = float((self.values(self.uncertain(prediction, found)) * (1 - self.use)).sum(dtype=torch.float64))
        return Fit(hypothesis, prediction, value, held, tuple(free), information, found)

    def jacobian(self, hypothesis: Hypothesis, free: list[Name], prediction: Prediction) -> torch.Tensor:
        """Derivatives of the mean, ``(p, N, H, W)``."""
        found = torch.empty(len(free), *prediction.mean.shape)
        for i, (step, _, shifted) in enumerate(self._beside(hypothesis, free)):
            found[i] = (shifted.mean - prediction.mean) / step
        return found

    def _derivatives(
        self,
        hypothesis: Hypothesis,
        free: list[Name],
        prediction: Prediction,
        charts: list[Chart],
        weight: torch.Tensor,
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Of the mean, of the logarithm of the deviation, and ``(p,)`` of what the maps' uncertainty costs in nats.

        The last is why a gain is not estimated too large beside a map that scales with it.
        """
        mean, spread = torch.empty(2, len(free), *prediction.mean.shape)
        toll = torch.zeros(len(free), dtype=torch.float64)
        for i, (step, beside, shifted) in enumerate(self._beside(hypothesis, free)):
            mean[i] = (shifted.mean - prediction.mean) / step
            spread[i] = (shifted.deviation / prediction.deviation).log() / step
            for chart in charts:
                if chart.kind != "hot":
                    change = (derivative(self.model, beside, chart.name, shifted) - chart.jacobian) / step
                    toll[i] += float((chart.cross(change[None] * weight)[0] * chart.variance).sum())
        return mean, spread, toll

    def _beside(
        self, hypothesis: Hypothesis, free: list[Name], part: float = DIFFERENCE
    ) -> Iterator[tuple[float, Hypothesis, Prediction]]:
        """For each parameter a small ``part`` of its step, the hypothesis so much on, and what it predicts."""
        for name, parameter in free:
            about = self.model.known[name].about[parameter]
            value = float(hypothesis.effects[name][parameter])
            step = about.step * part
            at = math.log(value) if about.log else value
            moved = math.exp(at + step) if about.log else at + step
            if not about.low <= moved <= about.high:
                step = -step
                moved = math.exp(at + step) if about.log else at + step
            beside = hypothesis.having(name, {**hypothesis.effects[name], parameter: moved})
            yield step, beside, self.model.predict(beside)

    def _newton(
        self, hypothesis: Hypothesis, free: list[Name], prediction: Prediction, now: Score, system: ChartSystem
    ) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Slope and information of the free parameters, the maps eliminated; ``(p, S)`` how the maps follow them."""
        weight = now.weight * self.use
        mean, spread, toll = self._derivatives(hypothesis, free, prediction, system.charts, weight)
        weighted, spread_weighted = mean * weight, spread * (now.spread_weight * self.use)
        slope = ((mean * now.slope + spread * now.spread) * self.use).flatten(1).sum(1, dtype=torch.float64)
        information = (
            weighted.flatten(1) @ mean.flatten(1).T + spread_weighted.flatten(1) @ spread.flatten(1).T
        ).double()
        if prediction.ceiling is not None and free:  # mean and deviation do not tell all
            slope, spike = self._at_ceiling(hypothesis, free, prediction.ceiling, now)
            information += spike
        # a map follows the noise and leaves less of it: what it took must not be missed in the deviation
        lever = sum(chart.jacobian.square() * chart.variance.float() for chart in system.charts)
        slope += (spread * (weight * lever)).flatten(1).sum(1, dtype=torch.float64) - toll
        cross = system.cross(weighted)
        follow = system.solve(cross)
        return slope - follow @ system.pull, information - follow @ cross.T, follow

    def _at_ceiling(
        self, hypothesis: Hypothesis, free: list[Name], ceiling: Ceiling, now: Score
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Slope of the log-likelihood by the parameters, and what the spike says about them where it is mixed."""
        slopes, moved = [], []
        sides = (self._beside(hypothesis, free, part) for part in (FINE, -FINE))  # one alone is curved by the spike
        for (step, _, beside), (back, _, before) in zip(*sides, strict=True):
            gained = (self.values(beside) - (now.value if step == back else self.values(before))) * self.use
            slopes.append(gained.sum(dtype=torch.float64) / (step if step == back else step - back))
            level = ceiling.level if beside.ceiling is None else beside.ceiling.level
            moved.append(((level - ceiling.level) / step).expand_as(ceiling.mean).flatten())
        weight = ceiling.mixed * (1 - ceiling.kept) / (ceiling.read.square() + 1 / 12) * self.use
        rises = torch.stack(moved)
        return torch.stack(slopes), ((rises * weight.flatten()) @ rises.T).double()

    def _move(
        self, hypothesis: Hypothesis, free: list[Name], slope: torch.Tensor, information: torch.Tensor, damping: float
    ) -> tuple[Hypothesis, torch.Tensor]:
        """One damped step, within bounds: parameters that press against theirs stay there."""
        count = len(free)
        step = torch.zeros(count, dtype=torch.float64)
        inside = torch.ones(count, dtype=torch.bool)
        diagonal = information.diagonal().clamp(min=1e-9)
        for _ in range(count + 1):
            index = inside.nonzero()[:, 0]
            if not len(index):
                break
            matrix = information[index][:, index] + torch.diag(damping * diagonal[index])
            step.zero_()
            step[index] = torch.linalg.lstsq(matrix, slope[index][:, None], driver="gelsd").solution[:, 0]
            pressed = [
                i
                for i in index.tolist()
                if self._limit(hypothesis, free[i], float(step[i])) is not None
                and abs(self._limit(hypothesis, free[i], float(step[i])) or 0.0) < 1e-12
            ]
            if not pressed:
                break
            inside[pressed] = False
        step[~inside] = 0
        moved = hypothesis
        for i, (name, parameter) in enumerate(free):
            limit = self._limit(hypothesis, (name, parameter), float(step[i]))
            if limit is not None:
                step[i] = limit
            about = self.model.known[name].about[parameter]
            value = float(hypothesis.effects[name][parameter])
            new = value * math.exp(float(step[i])) if about.log else value + float(step[i])
            new = min(max(new, about.low), about.high)
            moved = moved.having(name, {**moved.effects[name], parameter: new})
        return moved, step

    def _limit(self, hypothesis: Hypothesis, which: Name, step: float) -> float | None:
        """What is left of a step that leaves the parameter's range, or goes further than its derivative can tell."""
        name, parameter = which
        about = self.model.known[name].about[parameter]
        value = float(hypothesis.effects[name][parameter])
        if about.log:
            low, high = math.log(max(about.low, 1e-300) / value), math.log(about.high / value)
            low, high = max(low, -1.5), min(high, 1.5)
        else:
            low, high = max(about.low - value, -20 * about.step), min(about.high - value, 20 * about.step)
        if step < low:
            return low
        return high if step > high else None

    def uncertain(self, prediction: Prediction, charts: dict[str, Chart]) -> Prediction:
        """The prediction with the maps' uncertainty in its deviation, as fair for pixels that were not fitted."""
        variance = prediction.deviation.square()
        for chart in charts.values():
            variance = variance + chart.jacobian.square() * chart.variance.float()
        return replace(prediction, deviation=variance.sqrt()) if charts else prediction


def _variance(prediction: Prediction) -> torch.Tensor:
    """Of a pixel's DN, quantisation counted as noise."""
    return prediction.deviation.square() + 1 / 12
