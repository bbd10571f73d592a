"""Where a far displacement of the mask's image is looked for: by correlation, at all displacements at once.

A mask of independent mirrors looks like no copy of itself that is displaced by more than a mirror. The misfit therefore
says nothing about a displacement that is further away, and starts on a grid would have to be as many as mirrors.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import torch

from sci_lightning.diagnosis.fit.fit import Fit
from sci_lightning.diagnosis.fit.information_criterion import ABANDON_NATS
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Hypothesis, Setting
from sci_lightning.encoder.effects.parameter import within
from sci_lightning.encoder.effects.stage import RelayEffect

Displacement = tuple[float, float]
"""(dx, dy) in pixels, +x right and +y down."""

MIN_FAR_PIXELS = 1.5
"""Pixels up to which the effect's own starts lead to a displacement."""
MIN_EXPLAINED_SHARE = 0.25
"""Part of the misfit in the overlap that a displacement by whole pixels must explain. Halfway between two pixels in
both directions it explains more than half where nothing else is wrong, and by chance it explains a few per cent."""
PROPOSED_DISPLACEMENTS = 2
"""Displacements by whole pixels that are proposed."""
START_FROM_KINK_PIXELS = 0.4
"""Pixels from a whole number at which a fit starts: linear interpolation has a kink there."""
MIN_IRRADIANCE = 0.05
"""Irradiance below which a pixel says nothing about the mask."""


def far_displacements(base: Fit) -> dict[str, list[Setting]]:
    """Return settings with a far displacement of the mask's image from which a fit may start, by effect.

    Captures of scenes at rest are y = s Q, with the scene s and an image Q of the mask. With the prediction m of Q, the
    information w about it and V = 1 at pixels that count, a displacement d of the image gains
    sum w V(x - d) [(Q(x) - m(x))^2 - (Q(x) - m(x - d))^2] / 2 nats, Q and m without their means. That is a sum of
    correlations, computed by Fourier transforms.

    Args:
        base: the model without a displacement.
    """
    fitter, settings = base.fitter, base.fitter.settings
    observation = fitter.model.observation
    effects = displacing_effects(fitter.model, base.hypothesis)
    scenes = fitter.model.scenes(base.hypothesis)
    at_rest = [n for n, scene in enumerate(scenes) if len(scene) == 1 or scene.shape[-2:] == (1, 1)]
    if not effects or not at_rest:
        return {}
    size = [2 * length for length in fitter.dn.shape[-2:]]

    def spectrum(field: torch.Tensor) -> torch.Tensor:
        return torch.fft.rfft2(field, s=size)

    counted = spectrum(torch.ones_like(fitter.dn[0])).conj()
    gain, misfit = torch.zeros_like(counted), torch.zeros_like(counted)
    for n in at_rest:
        shown = fitter.model.windowed(scenes[n])[0] if scenes[n].shape[-1] > 1 else torch.ones(1, 1)
        seen = shown.clamp(min=MIN_IRRADIANCE)
        weight = seen.square() / base.prediction.total_variance[n] * fitter.fitted[n]
        weight = weight * (shown >= MIN_IRRADIANCE) * (fitter.dn[n] < observation.full_scale)
        # without the mean of a capture, a gain, an offset or a leak beside the displacement hardly counts
        image, recorded = (
            field - (field * weight).sum() / weight.sum().clamp(min=1e-12)
            for field in (base.prediction.mean[n] / seen, fitter.dn[n] / seen)
        )
        gain += spectrum(weight * image * (image - 2 * recorded)) * counted
        gain += 2 * spectrum(weight * recorded) * spectrum(image).conj()
        gain -= spectrum(weight) * spectrum(image.square()).conj()
        misfit += spectrum(weight * (recorded - image).square()) * counted
    nats, all_nats = (0.5 * torch.fft.irfft2(total, s=size) for total in (gain, misfit))
    down = torch.fft.fftfreq(size[0], 1 / size[0])[:, None]
    across = torch.fft.fftfreq(size[1], 1 / size[1])[None]
    farthest = [math.floor(settings.border_share * length) for length in observation.size]
    possible = (down.abs() <= farthest[0]) & (across.abs() <= farthest[1]) & (down.hypot(across) > MIN_FAR_PIXELS)
    clear = possible & (nats > MIN_EXPLAINED_SHARE * all_nats) & (nats > ABANDON_NATS)
    places = torch.where(clear, nats, -torch.inf).flatten().topk(PROPOSED_DISPLACEMENTS).indices.tolist()
    peaks = [divmod(place, size[1]) for place in places if clear.flatten()[place]]
    whole = ((float(across[0, column]), float(down[row, 0])) for row, column in peaks)
    displacements = on_all_sides(whole, START_FROM_KINK_PIXELS)
    return starts_at(displacements, effects, fitter.model)


def displacing_effects(model: CameraModel, hypothesis: Hypothesis) -> dict[str, tuple[str, str]]:
    """Return the names of the parameters dx and dy of every effect that displaces and is not in a hypothesis."""
    return {
        name: effect.displacement
        for name, effect in model.vocabulary.items()
        if issubclass(effect, RelayEffect) and effect.displacement and name not in hypothesis.effects
    }


def on_all_sides(peaks: Iterable[Displacement], distance: float) -> list[Displacement]:
    """Return displacements to all four sides of whole numbers of pixels, where linear interpolation has a kink."""
    sides = [(right, below) for right in (-distance, distance) for below in (-distance, distance)]
    return list(dict.fromkeys((dx + right, dy + below) for dx, dy in peaks for right, below in sides))


def starts_at(
    displacements: Iterable[Displacement], effects: dict[str, tuple[str, str]], model: CameraModel
) -> dict[str, list[Setting]]:
    """Return the settings of every effect at the displacements that lie within its bounds."""
    displacements, starts = list(displacements), {}
    for name, (dx, dy) in effects.items():
        there: list[Setting] = [{dx: x, dy: y} for x, y in displacements]
        starts[name] = [setting for setting in there if within(setting, model.effects[name].about)]
    return starts
