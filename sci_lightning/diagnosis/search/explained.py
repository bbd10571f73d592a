"""Captures explained: the ideal camera, and the corrected one with the effects that the search named."""

from __future__ import annotations

from dataclasses import dataclass

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.fit.split import split
from sci_lightning.diagnosis.model.camera_model import CameraModel, ParameterName, datasheet_noise
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

    def corrected(self, empirical: bool) -> Fit:
        """Return the corrected camera, with the deviations that have no name if ``empirical``."""
        fit, unnamed = self.explanation.fit, self.explanation.unnamed
        if empirical or not unnamed:
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
    return Explained(fitter, ideal, explanation, stated)
