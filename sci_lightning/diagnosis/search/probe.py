"""Free-form probes: in which stage something is missing that no effect explains."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import torch
from scipy.stats import chi2

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.linear import Linear
from sci_lightning.diagnosis.model.camera_model import Hypothesis, Setting
from sci_lightning.diagnosis.model.fixed_pattern_map import chart_of
from sci_lightning.encoder import empirical
from sci_lightning.encoder.effects import Effect
from sci_lightning.encoder.empirical import Empirical


@dataclass(frozen=True)
class Probe:
    """A free-form deviation that the captures ask for.

    Attributes:
        name: of the deviation.
        gain: nats, to second order.
        numbers: that it takes.
        p_value: of so large a gain by chance, corrected for the probes asked.
        start: where a fit should begin.
        effect: its class.
    """

    name: str
    gain: float
    numbers: int
    p_value: float
    start: Setting
    effect: type[Effect]

    @property
    def where(self) -> str:
        """What it means, in words."""
        return getattr(self.effect, "where", f"the map of {self.name} has a structure that the name does not promise")

    @property
    def choice(self) -> float:
        """Nats that it costs to say which of its numbers they are."""
        count = getattr(self.effect, "count", self.numbers)
        return math.lgamma(count + 1) - math.lgamma(self.numbers + 1) - math.lgamma(count - self.numbers + 1)

    def worth(self, pixels: float) -> float:
        """Nats beyond the cost of the numbers (BIC) and of their choice."""
        return self.gain - 0.5 * self.numbers * math.log(pixels) - self.choice

    def added(self, fitter: Fitter, hypothesis: Hypothesis) -> Hypothesis:
        """The hypothesis with the probe at its start."""
        return hypothesis.having(self.name, self.start, fitter.model.blank_chart(self.name))


def probes() -> Mapping[str, type[Effect]]:
    """Every free-form deviation by name."""
    members = [getattr(empirical, name) for name in empirical.__all__ if name != "Empirical"]
    return {each.name: each for each in members}


def probe(fitter: Fitter, base: Fit, charts: Mapping[str, type[Effect]] | None = None) -> list[Probe]:
    """Every probe that the hypothesis lacks, the worthiest first.

    Args:
        charts: effects of the vocabulary whose maps may serve as probes too.
    """
    linear, now = Linear(fitter, base), fitter.score(base.prediction)
    seen, pixels = fitter.model.observation, float(fitter.use.sum())
    asked = {**probes(), **(charts or {})}
    found = []
    for name, effect in asked.items():
        if name in base.hypothesis.effects:
            continue
        if effect.map_kind:
            fitter.model.known[name] = effect
            chart = chart_of(fitter.model, base.hypothesis, name, base.prediction, now, fitter.use)
            p_value = float(chi2.sf(2 * max(chart.evidence, 0.0), 1))
            found.append(Probe(name, chart.evidence, 1, p_value, dict.fromkeys(effect.about, chart.std), effect))
        elif issubclass(effect, Empirical):
            each = _free_form(fitter, base, effect, linear, len(seen), seen.frames)
            if each is not None:
                found.append(each)
    found = [
        Probe(each.name, each.gain, each.numbers, min(1.0, each.p_value * len(asked)), each.start, each.effect)
        for each in found
    ]
    return sorted(found, key=lambda each: -each.worth(pixels))


def _free_form(
    fitter: Fitter, base: Fit, effect: type[Empirical], linear: Linear, captures: int, frames: int
) -> Probe | None:
    count = effect.numbers(captures, frames)
    model = fitter.model
    about = effect.of(count)
    model.known[effect.name] = about
    if effect.name == "ghost":
        return _ghost(fitter, base, linear, about)
    if not 0 < count * fitter.use.numel() <= fitter.settings.probe_max_derivatives:
        return None
    hypothesis = base.hypothesis.having(effect.name, dict.fromkeys(about.about, 0.0))
    changes = fitter.jacobian(hypothesis, [(effect.name, name) for name in about.about], base.prediction)
    gain = linear.gain(changes)
    clear = (gain.factors.abs() / gain.deviations).nan_to_num()
    known = int((gain.deviations.isfinite()).sum())
    kept = (clear > fitter.settings.probe_min_sigma).nonzero()[:, 0]
    if not len(kept):
        return None
    kept = clear.argsort(descending=True)[: min(len(kept), fitter.settings.probe_max_numbers)].sort().values
    p_value = float(chi2.sf(2 * max(gain.nats, 0.0), max(known, 1)))
    few = gain.of(kept)
    bounded = few.factors.clamp(effect.number.low, effect.number.high).tolist()
    start: Setting = {f"c{index}": value for index, value in zip(kept.tolist(), bounded, strict=True)}
    return Probe(effect.name, few.nats, len(kept), p_value, start, about)


def _ghost(fitter: Fitter, base: Fit, linear: Linear, effect: type[Empirical]) -> Probe | None:
    """Where a displaced copy of the image would explain most: all displacements at once, by correlation."""
    light, height, width = base.prediction.mean, *fitter.model.observation.size
    padded = (2 * height, 2 * width)

    def spectrum(field: torch.Tensor) -> torch.Tensor:
        return torch.fft.rfft2(field, s=padded)

    pull = torch.fft.irfft2((spectrum(linear.slope) * spectrum(light).conj()).sum(0), s=padded)
    weight = torch.fft.irfft2((spectrum(linear.weight) * spectrum(light.square()).conj()).sum(0), s=padded)
    local = max(3, min(height, width) // 2)
    gain = pull.clamp(min=0).square() / weight.clamp(min=float(weight.max()) * 1e-2)
    rows = torch.fft.fftfreq(padded[0], 1 / padded[0])[:, None]
    columns = torch.fft.fftfreq(padded[1], 1 / padded[1])[None]
    near = rows.square() + columns.square() < 4
    gain = torch.where(near | (rows.abs() > local) | (columns.abs() > local), 0.0, gain)
    best = None
    for index in gain.flatten().topk(4).indices.tolist():
        dy, dx = float(rows[index // padded[1], 0]), float(columns[0, index % padded[1]])
        # linear interpolation has a kink at whole pixels, from which no derivative leads away
        starts: list[Setting] = [
            {"c0": 0.02, "c1": dx + right, "c2": dy + down} for right in (-0.4, 0.4) for down in (-0.4, 0.4)
        ]
        trials = [fitter.model.predict(base.hypothesis.having("ghost", start)).mean for start in starts]
        nats, factors = linear.each(torch.stack(trials) - base.prediction.mean)
        top = int(nats.argmax())
        if best is None or float(nats[top]) > best.gain:
            p_value = min(1.0, height * width * float(chi2.sf(2 * float(nats[top]), 1)))
            start = {**starts[top], "c0": min(0.02 * float(factors[top]), 0.5)}
            best = Probe("ghost", float(nats[top]), 3, p_value, start, effect)
    return best
