"""What is left: names that do not fit what they stand for are taken back, and free-form probes say where it sits."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.model.camera_model import Hypothesis
from sci_lightning.diagnosis.search.map_check import p_value_of
from sci_lightning.diagnosis.search.probe import Probe, probe
from sci_lightning.diagnosis.search.search import prune, worth
from sci_lightning.encoder.effects import Effect


@dataclass(frozen=True)
class Unnamed:
    """Something that no effect of the vocabulary explains.

    Attributes:
        name: of the free-form deviation that shows it.
        stage: modulator, relay, exposure, optics or sensor.
        where: in words.
        p_value: of so much by chance, corrected for how many probes were asked.
        nats: gained by the free-form deviation.
        picture: ``(H, W)`` or a curve ``(n,)`` that shows it.
    """

    name: str
    stage: str
    where: str
    p_value: float
    nats: float
    picture: torch.Tensor


def leftover(
    fitter: Fitter,
    fit: Fit,
    before: Fit,
    noise: Hypothesis,
    found: Sequence[Probe] = (),
    told: Callable[[str], None] = lambda text: None,
) -> tuple[Fit, list[Unnamed]]:
    """The fit with what no name explains in free form, and without the names that this makes superfluous.

    Args:
        fitter: of the captures.
        fit: with all that could be named.
        before: the ideal camera.
        noise: effects that stay whatever happens.
        found: probes that are in the fit already.
        told: is called with a line of text for every probe that is added.
    """
    settings = fitter.settings
    unlike = {name: p_value_of(chart) for name, chart in fit.charts.items()}
    unlike = {name: p_value for name, p_value in unlike.items() if p_value < settings.max_map_p_value}
    maps = {name: fitter.model.known[name] for name in unlike if name not in {each.name for each in found}}
    for name in maps:
        told(f"the map of {name} has structure: not that")
        fit = fitter.fit(fit.hypothesis.without(name), iterations=20)
    found, gained = [*found], 0.0
    for _ in range(settings.max_unnamed - len(found)):
        least = unnamed_threshold(fitter, fit, before, noise=fit) + settings.surrogate_fraction * gained
        best, more = likeliest(fitter, fit, least, maps)
        if best is None:
            break
        told(f"unnamed: {best.where}")
        gained = max(gained, more.total - fit.total)
        fit = prune(
            fitter, more, Hypothesis({**noise.effects, best.name: {}}), margin=settings.surrogate_fraction * gained
        )
        found = [each for each in (*found, best) if each.name in fit.hypothesis.effects]
    # in the order of the light: what is wrong with mirrors also shows as a gain of the pixels behind them
    return fit, [_unnamed(fitter, fit, each, unlike) for each in sorted(found, key=lambda each: each.effect.rank)]


def unnamed_threshold(fitter: Fitter, fit: Fit, ideal: Fit, noise: Fit) -> float:
    """Return the nats beyond its cost that a free-form deviation must gain beside a fit."""
    settings = fitter.settings
    return settings.unnamed_min_gain_nats + settings.unnamed_formula_error * fitter.explained(fit, ideal, noise)


def likeliest(
    fitter: Fitter, fit: Fit, least: float, maps: Mapping[str, type[Effect]] | None = None
) -> tuple[Probe | None, Fit]:
    """The probe that is worth most in a joint fit, if any is worth more than ``least`` nats, and that fit."""
    promising = [each for each in probe(fitter, fit, maps) if each.worth(float(fitter.use.numel())) > least]
    best, most, largest = None, fit, least
    for each in promising[: fitter.settings.probes_fitted]:
        fitter.model.known[each.name] = each.effect
        trial = fitter.fit(each.added(fitter, fit.hypothesis), iterations=15)
        value = worth(fitter, fit, trial) - each.choice
        if each.effect.map_kind and each.name in (maps or {}):  # a map with structure can stand in for much
            value *= 1 - fitter.settings.surrogate_fraction
        if value > largest:
            best, most, largest = each, trial, value
    return best, most


def _unnamed(fitter: Fitter, fit: Fit, each: Probe, unlike: dict[str, float]) -> Unnamed:
    without = fitter.fit(fit.hypothesis.without(each.name), iterations=8)
    nats = fit.total - without.total
    change = (fit.prediction.mean - without.prediction.mean).square().mean(0).sqrt()
    p_value = min(each.p_value, unlike.get(each.name, 1.0))
    return Unnamed(each.name, each.effect.stage, each.where, p_value, nats, change)
