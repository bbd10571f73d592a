"""Captures explained: the ideal camera, and the corrected one with the effects that the search named."""

from __future__ import annotations

from dataclasses import dataclass, replace

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.split import split
from sci_lightning.diagnosis.model.camera_model import CameraModel, ParameterName, datasheet_noise
from sci_lightning.diagnosis.search.map_test import map_p_value
from sci_lightning.diagnosis.search.search import Explanation, OnProgress, search
from sci_lightning.diagnosis.search_settings import SearchSettings


@dataclass(frozen=True)
class Explained:
    """The result of a search over some captures.

    Attributes:
        fitter: leaves out what depends on the unknown surround in the explanation.
        ideal: the ideal camera with the datasheet's noise.
        explanation: the most likely model.
        stated: parameters of the noise that the file states.
    """

    fitter: Fitter
    ideal: Fit
    explanation: Explanation
    stated: tuple[ParameterName, ...]

    def corrected(self, free_forms: bool) -> Fit:
        """Return the corrected camera, with the deviations that have no name if ``free_forms``."""
        fit, unnamed = self.explanation.fit, self.explanation.unnamed
        if free_forms or not unnamed:
            return fit
        named = fit.hypothesis
        for deviation in unnamed:
            named = named.without(deviation.name)
        noise, _ = datasheet_noise(self.fitter.model.observation)
        # the noise keeps its values: it must not absorb what has no name
        fixed = tuple((effect, parameter) for effect in noise.effects for parameter in noise.effects[effect])
        return self.fitter.fit(named, fixed=fixed)


def ideal_camera(model: CameraModel, settings: SearchSettings) -> tuple[Fitter, Fit]:
    """Divide the captures of a model into fitted and held-out pixels, and fit the ideal camera to them."""
    fitter = Fitter(model, split(model.observation, settings), settings)
    noise, stated = datasheet_noise(model.observation)
    return fitter, fitter.fit(noise, fixed=stated, iterations=30)


def explain(fitter: Fitter, ideal: Fit, on_progress: OnProgress) -> Explained:
    """Search for the effects that explain the captures.

    Args:
        fitter: of the captures.
        ideal: the ideal camera, fitted.
        on_progress: called with a one-line message after every step of the search.
    """
    noise, stated = datasheet_noise(fitter.model.observation)
    explanation = search(fitter, ideal, noise, on_progress)
    if explanation.fitter is not fitter:
        fitter = explanation.fitter
        ideal = fitter.fit(noise, fixed=stated, iterations=30)
    return _without_contradicted_maps(Explained(fitter, ideal, explanation, stated), on_progress)


def _without_contradicted_maps(explained: Explained, on_progress: OnProgress) -> Explained:
    """Take the names of maps back that are not what their effects are once deviations without a name are left out.

    Beside such a deviation, which takes what does not fit, any map looks right.
    """
    settings = explained.fitter.settings
    maps = explained.corrected(free_forms=False).maps if explained.explanation.unnamed else {}
    for name in [name for name in explained.explanation.names if name in maps]:
        if map_p_value(maps[name]) < settings.max_map_p_value:
            on_progress(f"{name} is set aside: its map is not what its name says")
            explanation = explained.explanation
            fit = explained.fitter.fit(explanation.fit.hypothesis.without(name), iterations=20)
            names = tuple(other for other in explanation.names if other != name)
            explained = replace(explained, explanation=replace(explanation, fit=fit, names=names))
    return explained
