"""Snapshots of unknown scenes beside captures of known ones verify the corrected camera once more, by held-out pixels.

Some pixels of a snapshot are held out, the scene is reconstructed from the others under the hypothesis, and the
reconstruction predicts the held-out pixels. The right camera predicts them best, whatever prior the decoder has: no
prior knows what the mask does at a pixel that it has not seen.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from typing import Any

import torch

from sci_lightning.captures import Captures
from sci_lightning.decoder import GAP
from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.denoiser import TotalVariation
from sci_lightning.decoder.iterative import Iterative
from sci_lightning.diagnosis.blind.held_out_pixels import (
    HeldOutErrors,
    PairedComparison,
    blue_noise_folds,
    compare_errors,
    fill_in,
)
from sci_lightning.diagnosis.blind.snapshots import snapshots_of, textured_window, usable_snapshots
from sci_lightning.diagnosis.model.camera_model import CameraModel, Hypothesis
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects import MaskContrast, OpticsEffect, SensorEffect
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.signal import Signal
from sci_lightning.errors import BadInput
from sci_lightning.operator import SnapshotOperator

BRIGHT = 0.99
"""Quantile of a snapshot's light that counts as white: decoders expect videos in [0, 1]."""
LARGEST_FIELD_PX = 512
"""Side in pixels beyond which only the window of this side with the most texture is predicted."""
WITHOUT_MASK = LightPath([MaskContrast(leak=1.0)])
"""A camera whose mask is the same everywhere."""


def default_decoder(iterations: int = 25) -> Decoder:
    """Return GAP-TV, frame by frame, with little smoothing.

    It has no notion of time, so that it predicts the same whatever the order of the patterns is.
    """
    return GAP(TotalVariation(steps=3), strengths=(0.02,), iterations=(iterations,))


class FilledMeanFrame(Decoder):
    """The mean frame in every slot, with pixels at which no slot opens filled in from their neighbours.

    A decoder that starts from it does not have to find the brightness of held-out pixels first.
    """

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        operator = self.operator(mask)
        frame = fill_in(operator.mean_frame(measurement), operator.total() > 0)
        return frame.unsqueeze(1).expand(-1, len(mask), -1, -1).contiguous()


class Predictor:
    """Predicts held-out pixels of snapshots under any hypothesis about the camera.

    What does not depend on the hypothesis is prepared once: which pixels are held out, what fills them in, and how
    bright the scenes are. Pixels at full scale are not used, neither to reconstruct nor to be predicted.

    Args:
        measurement: ``(N, H, W)`` snapshots, normalised by full scale.
        decoder: iterative decoder or another model-based one, ``decoder(measurement, mask) -> video``; None for
            :func:`default_decoder`. Where it has no start of its own, it starts from the mean frame with held-out
            pixels filled in.
        share: part of the pixels that one fold holds out.
        folds: number of folds; every one costs a reconstruction.
        seed: of the choice of pixels.
        border: pixels along the sides that are not predicted, because by some hypothesis they depend on what lies
            beyond the field.
        window: rows and columns of the field that are reconstructed and predicted; None for all.

    Raises:
        BadInput: snapshots without any difference between pixels, or saturated everywhere.
    """

    def __init__(
        self,
        measurement: torch.Tensor,
        decoder: Decoder | None = None,
        share: float = 0.05,
        folds: int = 4,
        seed: int = 0,
        border: Border | None = None,
        window: tuple[slice, slice] | None = None,
    ) -> None:
        self.field = (int(measurement.shape[-2]), int(measurement.shape[-1]))
        rows, columns = window or (slice(0, self.field[0]), slice(0, self.field[1]))
        self.origin = (rows.indices(self.field[0])[0], columns.indices(self.field[1])[0])
        self.measurement = measurement[:, rows, columns].float()
        self.decoder = start_from_filled_mean(default_decoder() if decoder is None else decoder)
        usable = self.measurement < 1
        inside = torch.zeros(self.field, dtype=torch.bool)
        inside[(border or Border()).rounded().window(self.field)] = True
        self._folds = blue_noise_folds(self.field, share, folds, seed)[:, rows, columns]
        self._usable = usable
        self._predicted = [usable & fold & inside[rows, columns] for fold in self._folds]
        predicted_here = torch.stack(self._predicted).any(0)
        recorded = torch.where(predicted_here, self.measurement, self.measurement.new_tensor(float("nan")))
        mean = recorded.flatten(1).nanmean(1)[:, None, None]
        self.variance = (recorded - mean).square().flatten(1).nanmean(1)
        for number, variance in enumerate(self.variance.tolist()):
            if not variance > 0:
                reason = "saturated" if not predicted_here[number].any() else "the same at every pixel"
                raise BadInput(f"snapshot {number} is {reason}: nothing can be predicted; check the exposure")
        self._bright = [_brightness(self.measurement, usable & ~fold) for fold in self._folds]

    def __len__(self) -> int:
        return len(self.measurement)

    @torch.no_grad()
    def predictions(self, encoder: Encoder) -> torch.Tensor:
        """Return what the other pixels say of the held-out ones, ``(N, h, w)``, normalised by full scale; else NaN.

        Args:
            encoder: mask and effects; its field is that of the snapshots. Its aperture does not matter, since the
                scenes' brightness is unknown.
        """
        height, width = self.measurement.shape[-2:]
        top, left = self.origin
        mask = effective_mask(encoder)[:, top : top + height, left : left + width]
        predicted = torch.full_like(self.measurement, float("nan"))
        # The scale that makes a decoder's video lie in [0, 1] belongs to the snapshot and not to the hypothesis.
        nominal = SnapshotOperator(encoder.mask()).total().mean().clamp(min=1e-6)
        for fold, predicted_here, bright in zip(self._folds, self._predicted, self._bright, strict=True):
            known, scale = self._usable & ~fold, bright / nominal
            visible = fill_in(self.measurement, known)
            video = self._decode(encoder.linearise(visible, self.origin) / scale, mask, known)
            recorded = self._respond(encoder, SnapshotOperator(mask)(video) * scale)
            predicted = torch.where(predicted_here, recorded, predicted)
        return predicted

    def errors(self, encoder: Encoder) -> HeldOutErrors:
        """Return the errors of :meth:`predictions`."""
        squared = (self.predictions(encoder) - self.measurement).square()
        return HeldOutErrors(squared, self.variance, self.origin)

    def _decode(self, light: torch.Tensor, mask: torch.Tensor, known: torch.Tensor) -> torch.Tensor:
        """Return the video ``(N, T, h, w)``; pixels that are not known count as if no slot opened there."""
        if (known == known[:1]).all():
            return self.decoder(light * known[0], mask * known[0])
        return torch.cat([self.decoder((one * own)[None], mask * own) for one, own in zip(light, known, strict=True)])

    def _respond(self, encoder: Encoder, light: torch.Tensor) -> torch.Tensor:
        """Return the recorded mean of light that :meth:`Encoder.linearise` would return."""
        zero = light.new_zeros(())
        signal = Signal(light, zero, light.new_ones(len(light), 1, 1), encoder.dn, self.origin, encoder.mask.size)
        for effect in encoder.path.of(OpticsEffect):
            if can_be_undone(effect):
                signal = effect.form(signal)
        return encoder.path.respond(signal).mean


def can_be_undone(effect: OpticsEffect | SensorEffect) -> bool:
    """Return whether an effect says how a measurement is without it."""
    return type(effect).undo not in (OpticsEffect.undo, SensorEffect.undo)


@torch.no_grad()
def effective_mask(encoder: Encoder) -> torch.Tensor:
    """Return what multiplies every frame by the time its light is recorded, ``(T, H, W)``, on the sensor's pixels.

    An effect of the optics that cannot be undone on the measurement, a blur, acts on the mask instead: for a scene
    without detail of the mask's size that is the same.
    """
    mask, q = encoder.transmittance(), encoder.path.cells
    ones = mask.new_ones(len(mask), 1, 1)
    signal = Signal(mask, mask.new_zeros(()), ones, encoder.dn, (0, 0), encoder.mask.size, q)
    for effect in encoder.path.of(OpticsEffect):
        if not can_be_undone(effect):
            signal = effect.form(signal)
    return signal.pooled().mean


def start_from_filled_mean(decoder: Decoder) -> Decoder:
    """Return an iterative decoder without a start of its own as one that starts from :class:`FilledMeanFrame`."""
    if not isinstance(decoder, Iterative) or decoder.start is not None:
        return decoder
    started = copy(decoder)
    started._modules = dict(decoder._modules)
    started.start = FilledMeanFrame()
    return started


def _brightness(images: torch.Tensor, known: torch.Tensor) -> torch.Tensor:
    """Return what counts as white in every image, ``(N, 1, 1)``, from its known pixels: a high quantile."""
    thin = max(1, images[0].numel() // 500_000)
    levels = [
        image[good][::thin].quantile(BRIGHT) if good.any() else image.new_ones(())
        for image, good in zip(images, known, strict=True)
    ]
    return torch.stack(levels).clamp(min=1e-6)[:, None, None]


@dataclass(frozen=True)
class UnknownScenes:
    """How well two cameras predict held-out pixels of snapshots whose scenes nobody knows.

    Attributes:
        captures: numbers of the snapshots in their file.
        gap: the ideal camera against the corrected one.
        without_mask: a camera whose mask is the same everywhere against the corrected one.
    """

    captures: tuple[int, ...]
    gap: PairedComparison
    without_mask: PairedComparison

    def describe(self) -> dict[str, Any]:
        """Return this as it stands in ``report.json``."""
        gap = self.gap
        return {
            "captures": list(self.captures),
            "prediction_error": {"before": gap.before, "after": gap.after, "without_mask": self.without_mask.before},
            "agree": [gap.agree, gap.snapshots],
            "p_value": gap.p_value,
        }

    def sentence(self) -> str:
        """Return what they say about the corrected camera, in a sentence."""
        gap, count = self.gap, len(self.captures)
        return (
            f"{count} snapshot{'s' * (count > 1)} of unknown scenes: held-out pixels are predicted to {gap.before:.3g} "
            f"of their spread by the ideal camera, to {gap.after:.3g} by the corrected one ({gap.agree} of "
            f"{gap.snapshots} support it), and to {self.without_mask.before:.3g} without any mask."
        )


def judged_by_unknown_scenes(
    captures: Captures,
    model: CameraModel,
    ideal: Hypothesis,
    corrected: Hypothesis,
    seed: int,
    on_progress: Callable[[str], None],
) -> UnknownScenes | None:
    """Predict held-out pixels of the captures with unknown scenes by the ideal and by the corrected camera.

    Args:
        captures: with known and unknown scenes.
        model: builds the light path of a hypothesis.
        ideal, corrected: what the known scenes say; effects of the laboratory do not act on other scenes.
        seed: of the held-out pixels.
        on_progress: called with a one-line message at the end.

    Returns:
        None where no scene is unknown, or where no snapshot is of use: black, saturated, without a mask.
    """
    if captures.known.all():
        return None
    useful = usable_snapshots(captures).tolist()
    if not useful:
        return None
    try:
        camera = snapshots_of(captures.take(useful), model.vocabulary)
        border = (model.border(ideal) | model.border(corrected)).rounded()
        window = textured_window(camera.measurement, LARGEST_FIELD_PX) if max(camera.size) > LARGEST_FIELD_PX else None
        predictor = Predictor(camera.measurement, folds=2, seed=seed, border=border, window=window)
    except BadInput:
        return None
    paths = (model.path(ideal), model.path(corrected), WITHOUT_MASK)
    before, after, without_mask = (predictor.errors(camera.encoder_of(path)) for path in paths)
    numbers = tuple(useful[place] for place in camera.numbers)
    judged = UnknownScenes(numbers, compare_errors(before, after), compare_errors(without_mask, after))
    on_progress(f"snapshots of unknown scenes: prediction error {judged.gap.before:.4f} to {judged.gap.after:.4f}")
    return judged
