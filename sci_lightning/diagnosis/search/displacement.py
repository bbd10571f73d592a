"""Where a far displacement of the mask's image is looked for: by correlation, at all displacements at once.

A mask of independent mirrors looks like no copy of itself that is displaced by more than a mirror. The misfit therefore
says nothing about a displacement that is further away, and starts on a grid would have to be as many as mirrors.
"""

from __future__ import annotations

import math

import torch

from sci_lightning.diagnosis.fit.fit import Fit, Fitter
from sci_lightning.diagnosis.model.camera_model import Setting
from sci_lightning.diagnosis.model.displacement import beside, displacing_effects, starts_at

NEAR = 1.5
"""Pixels up to which the effect's own starts lead to a displacement."""
LEAST_EXPLAINED = 0.25
"""Part of the misfit in the overlap that a displacement by whole pixels must explain. Halfway between two pixels in
both directions it explains more than half where nothing else is wrong, and by chance it explains a few per cent."""
PEAKS = 2
"""Displacements that are proposed."""
ASIDE = 0.4
"""Pixels from a whole number at which a fit starts: linear interpolation has a kink there."""
LEAST_SCENE = 0.05
"""Irradiance below which a pixel says nothing about the mask."""


def far_displacements(fitter: Fitter, base: Fit) -> dict[str, list[Setting]]:
    """Return settings with a far displacement of the mask's image from which a fit may start, by effect.

    Captures of scenes at rest are y = s Q, with the scene s and an image Q of the mask. With the prediction m of Q, the
    information w about it and V = 1 at pixels that count, a displacement d of the image gains
    sum w V(x - d) [(Q(x) - m(x))^2 - (Q(x) - m(x - d))^2] / 2 nats, Q and m without their means. That is a sum of
    correlations, computed by Fourier transforms.

    Args:
        fitter: holds captures, split and model.
        base: the model without a displacement.
    """
    observation, settings = fitter.model.observation, fitter.settings
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
        seen = shown.clamp(min=LEAST_SCENE)
        weight = seen.square() / base.prediction.total_variance[n] * fitter.fitted[n]
        weight = weight * (shown >= LEAST_SCENE) * (fitter.dn[n] < observation.full_scale)
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
    possible = (down.abs() <= farthest[0]) & (across.abs() <= farthest[1]) & (down.hypot(across) > NEAR)
    clear = possible & (nats > LEAST_EXPLAINED * all_nats) & (nats > settings.abandon_nats)
    places = torch.where(clear, nats, -torch.inf).flatten().topk(PEAKS).indices.tolist()
    peaks = [divmod(place, size[1]) for place in places if clear.flatten()[place]]
    displacements = beside(((float(across[0, column]), float(down[row, 0])) for row, column in peaks), ASIDE)
    return starts_at(displacements, effects, fitter.model)
