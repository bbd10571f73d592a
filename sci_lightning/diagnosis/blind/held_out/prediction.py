"""Prediction of held-out pixels: how well a hypothesis about the camera explains snapshots of unknown scenes.

Some pixels of a snapshot are held out, the scene is reconstructed from the others under the hypothesis, and the
reconstruction predicts the held-out pixels. The right camera predicts them best, whatever prior the decoder has: no
prior knows what the mask does at a pixel that it has not seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import torch
from torch.nn import functional as F

from sci_lightning.decoder import GAP
from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.denoiser import TotalVariation
from sci_lightning.decoder.iterative import Iterative
from sci_lightning.diagnosis.blind.held_out.held_out_pixels import blue_noise_folds, fill_in
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.border import Border
from sci_lightning.encoder.effects import OpticsEffect, SensorEffect
from sci_lightning.encoder.signal import Signal
from sci_lightning.errors import BadInput
from sci_lightning.operator import SnapshotOperator

BRIGHT = 0.99
"""Quantile of a snapshot's light that counts as white: decoders expect videos in [0, 1]."""


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


@dataclass(frozen=True)
class HeldOutErrors:
    """How well a hypothesis predicts held-out pixels.

    Attributes:
        squared: float32 ``(N, H, W)`` squared error of every held-out pixel, in units of full scale; NaN elsewhere.
        variance: ``(N,)`` variance of the recorded values of the held-out pixels.
        origin: (row, column) of the first pixel in the field.
    """

    squared: torch.Tensor
    variance: torch.Tensor
    origin: tuple[int, int] = (0, 0)

    @property
    def by_capture(self) -> tuple[float, ...]:
        """RMS error of every snapshot's held-out pixels, as a part of their standard deviation."""
        mean = self.squared.double().flatten(1).nanmean(1)
        return tuple((mean / self.variance.double()).sqrt().tolist())

    @property
    def prediction_error(self) -> float:
        """Root mean square of :attr:`by_capture`."""
        ratios = torch.tensor(self.by_capture, dtype=torch.float64)
        return float(ratios.square().mean().sqrt())

    @property
    def pixels(self) -> int:
        """Number of held-out pixels of all snapshots."""
        return int(self.squared.isfinite().sum())

    def take(self, snapshots: Sequence[int]) -> HeldOutErrors:
        """Return the errors of some of the snapshots, by their numbers."""
        which = torch.tensor(list(snapshots), dtype=torch.long)
        return HeldOutErrors(self.squared[which], self.variance[which], self.origin)


class Predictor:
    """Predicts held-out pixels of snapshots under any hypothesis about the camera.

    What does not depend on the hypothesis is prepared once: which pixels are held out, what fills them in, and how
    bright the scenes are. Pixels at full scale are not used, neither to reconstruct nor to judge.

    Args:
        measurement: ``(N, H, W)`` snapshots, normalised by full scale.
        decoder: iterative decoder or another model-based one, ``decoder(measurement, mask) -> video``; None for
            :func:`default_decoder`. Where it has no start of its own, it starts from the mean frame with held-out
            pixels filled in.
        share: part of the pixels that one fold holds out.
        folds: number of folds; every one costs a reconstruction.
        seed: of the choice of pixels.
        border: pixels along the sides that do not judge, because some hypothesis says that they depend on what lies
            beyond the field.
        window: rows and columns of the field that are reconstructed and judged; None for all.

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
        self._judging = [usable & fold & inside[rows, columns] for fold in self._folds]
        judging = torch.stack(self._judging).any(0)
        recorded = torch.where(judging, self.measurement, self.measurement.new_tensor(float("nan")))
        mean = recorded.flatten(1).nanmean(1)[:, None, None]
        self.variance = (recorded - mean).square().flatten(1).nanmean(1)
        for number, variance in enumerate(self.variance.tolist()):
            if not variance > 0:
                reason = "saturated" if not judging[number].any() else "the same at every pixel"
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
        for fold, judging, bright in zip(self._folds, self._judging, self._bright, strict=True):
            known, scale = self._usable & ~fold, bright / nominal
            visible = fill_in(self.measurement, known)
            video = self._decode(encoder.linearise(visible, self.origin) / scale, mask, known)
            recorded = self._respond(encoder, SnapshotOperator(mask)(video) * scale)
            predicted = torch.where(judging, recorded, predicted)
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


def textured_window(measurement: torch.Tensor, side: int, border: int = 0) -> tuple[slice, slice]:
    """Return the square window in which all snapshots together vary most, as rows and columns.

    Args:
        measurement: ``(N, H, W)``, normalised by full scale; pixels at full scale count as if they did not vary.
        side: of the window in pixels; a smaller field is taken whole.
        border: pixels along the sides that the window avoids where the field is large enough.
    """
    height, width = measurement.shape[-2:]
    border = min(border, max(0, (min(height, width) - side) // 2))
    h, w = min(side, height - 2 * border), min(side, width - 2 * border)
    usable = (measurement < 1).float()
    spread = measurement.flatten(1).std(1).clamp(min=1e-9)[:, None, None]
    level = usable * measurement / spread
    texture = F.pad(level.diff(dim=1).square(), (0, 0, 0, 1)) + F.pad(level.diff(dim=2).square(), (0, 1))
    variance = F.avg_pool2d(texture.mean(0)[None], (h, w), max(1, side // 8))[0]
    step = max(1, side // 8)
    rows, columns = variance.shape
    allowed = [
        (float(variance[r, c]), r * step, c * step)
        for r in range(rows)
        for c in range(columns)
        if border <= r * step <= height - h - border and border <= c * step <= width - w - border
    ]
    _, top, left = max(allowed, default=(0.0, border, border))
    return slice(top, top + h), slice(left, left + w)


def _brightness(images: torch.Tensor, known: torch.Tensor) -> torch.Tensor:
    """Return what counts as white in every image, ``(N, 1, 1)``, from its known pixels: a high quantile."""
    thin = max(1, images[0].numel() // 500_000)
    levels = [
        image[good][::thin].quantile(BRIGHT) if good.any() else image.new_ones(())
        for image, good in zip(images, known, strict=True)
    ]
    return torch.stack(levels).clamp(min=1e-6)[:, None, None]
