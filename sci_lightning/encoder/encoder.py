"""The encoder: mask, effects and sensor in the order light travels."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import torch
from torch import nn

from sci_lightning.configuration.bounds import Size
from sci_lightning.encoder.aperture import Aperture
from sci_lightning.encoder.effects.effect import Effect
from sci_lightning.encoder.effects.stage import OpticsEffect, SensorEffect
from sci_lightning.encoder.irradiance import check_irradiance, misfit
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.mask import Mask, Measured
from sci_lightning.encoder.modulator_grid import ModulatorGrid
from sci_lightning.encoder.physics import deepinv_physics
from sci_lightning.encoder.sensor.bayer import check_bayer, mosaic
from sci_lightning.encoder.sensor.sensor import Sensor
from sci_lightning.encoder.signal import Signal
from sci_lightning.errors import BadInput, MachineFailure
from sci_lightning.full_precision import full_precision
from sci_lightning.measurement import Measurement, as_float_tensor, marked
from sci_lightning.operator import SnapshotOperator

LEAST_VARIANCE = 1e-11
"""Noise of less variance is not drawn: it is a fifth of a 16-bit step, and the size of rounding errors."""

LEAST_LIGHT = 0.05
"""Sum of the squared mask over time, as a part of its mean over the field, below which a pixel counts as dark. At the
dark edge any value from 0.01 to 0.2 gives the same PSNR to 0.04 dB (GAP-TV, moving textures of the virtual camera)."""

OF_PIXELS = ("vignetting", "illumination")
"""Effects of optics that act on every pixel by itself, as a mosaic of colours needs it."""


class Encoder(nn.Module):
    r"""A video SCI camera: :math:`y = R(a \sum_t M_t \odot x_t)`, with the effects by which a real one differs.

    Effects act in the order of the light, in whatever order they are given: modulator, relay and exposure effects on
    the mask, then the aperture, then optics and sensor effects on the sum; their noise is drawn last, as a Gaussian
    from torch's global generator. The sensor then adds its own noise, clips and rounds. Without effects nothing of this
    is computed. :mod:`sci_lightning.encoder.effects.stage` has the formula with effects.

    On the command line ``'effect=[mask_shift,prnu]' encoder.effects.mask_shift.dx=0.6`` adds members of
    ``conf/effect``, and ``+encoder.effects.mine._target_=my_module.Mine`` adds an effect of your own.

    Args:
        mask: the transmittance M, ``(T, H, W)`` in [0, 1].
        sensor: the response R, light to measurement.
        aperture: a, scale of the light before the sensor: ``auto`` (the mask's own "automatic aperture"), a number > 0,
            ``1/T`` or ``per_snapshot``, see :class:`~sci_lightning.encoder.aperture.Aperture`.
        effects: effects, each name at most once; None is ignored, and of a mapping only the values are used.
        sensor_to_modulator: nominal homography, 3 x 3, of a mask whose values belong to mirrors on a grid of their own:
            homogeneous (x, y, 1) of a pixel's centre to (u, v, 1) in mirrors, both from 0 at the first centre. None
            where every value of the mask is a pixel's.
        size: (H, W) of the field in pixels, with a homography; the mask's own size is then that of the modulator.
        told: whether decoders know a; else they take it to be the mask's own, and are wrong by what it is not.

    Raises:
        BadInput: an aperture that is no positive number and none of these words; an effect given twice; noise stated
            both by the sensor and as an effect; an effect of fewer bits with a sensor that does not round; a homography
            that is singular or shows the field too little of the mask, or one without a size.

    It is computed in full precision even under ``torch.autocast``.

    Source: "Deep Optics for Video Snapshot Compressive Imaging" (ICCV 2023), Eq. 1 to 3.
    """

    def __init__(
        self,
        mask: Mask | torch.Tensor,
        sensor: Sensor,
        aperture: float | str = "auto",
        effects: Mapping[str, Effect | None] | Iterable[Effect | None] | None = (),
        sensor_to_modulator: Sequence[Sequence[float]] | None = None,
        size: Size | None = None,
        told: bool = True,
    ) -> None:
        super().__init__()
        self.mask = Measured.of(mask) if isinstance(mask, torch.Tensor) else mask
        self.sensor = sensor
        self.aperture_setting = Aperture(aperture, told)
        given = effects.values() if isinstance(effects, Mapping) else effects or ()
        if sensor_to_modulator is not None and size is None:
            raise BadInput("encoder.sensor_to_modulator needs 'encoder.size=[H,W]', the field in pixels")
        grid = (
            None
            if sensor_to_modulator is None or size is None
            else ModulatorGrid(sensor_to_modulator, size, self.mask.size)
        )
        if grid is None and size is not None and tuple(size) != self.mask.size:
            raise BadInput(
                f"encoder.size={list(size)}: the mask is {list(self.mask.size)}; with another size than the field's it "
                "needs encoder.sensor_to_modulator, which says where its values lie"
            )
        self.path = LightPath((effect for effect in given if effect is not None), grid)
        self._refuse_noise_stated_twice()
        if sensor.pattern is not None:
            check_bayer(sensor.pattern, self.size)
            if mixing := [effect.name for effect in self.path.of(OpticsEffect) if effect.name not in OF_PIXELS]:
                raise BadInput(f"{mixing[0]} mixes pixels that see several colours: not with encoder/sensor=bayer")
        if sensor.bit_depth is None and self.path.effective_bits(16) < 16:
            raise BadInput(
                f"an effect leaves {self.path.effective_bits(16)} bits to a sensor that does not round "
                f"({type(sensor).__name__}); choose one with a bit depth: encoder/sensor=clip_quantise"
            )

    def _refuse_noise_stated_twice(self) -> None:
        for effect in self.path.of(SensorEffect):
            argument = effect.sensor_argument
            if argument and getattr(self.sensor, argument, None) and not effect.is_neutral:
                (value,) = effect.values.values()
                raise BadInput(
                    f"{effect.name.replace('_', ' ')} is stated twice, as encoder.sensor.{argument}="
                    f"{getattr(self.sensor, argument):g} and as the effect {effect.name} with {value:g}: state it once"
                )

    @property
    def size(self) -> tuple[int, int]:
        """(H, W) of the field, in pixels."""
        return self.mask.size if self.path.grid is None else self.path.grid.field

    @property
    def aperture(self) -> float:
        """The scale by which decoders divide: that of the light before the sensor, unless they are not told it.

        Raises:
            BadInput: it is another one for each snapshot, which the measurement carries.
        """
        return self.aperture_setting.divisor(self.mask)

    @property
    def dn(self) -> float:
        """One DN as a fraction of full scale; a sensor that does not round counts as one of 8 bits."""
        return 1 / (2 ** (self.sensor.bit_depth or 8) - 1)

    @full_precision()
    def transmittance(self) -> torch.Tensor:
        """Return what the frames are multiplied with: the mask after the effects of modulator, relay and exposure.

        Returns:
            ``(T, qH, qW)``, with q x q cells per pixel (``path.cells``) where a displaced mask is seen through a
            blurring lens, else q = 1. It remembers the aperture, see :mod:`sci_lightning.measurement`.
        """
        return self._marked(self.path.transmittance(self.mask()))

    def transmittance_window(self, top: int, left: int, height: int, width: int) -> torch.Tensor:
        """Return the part ``(T, qh, qw)`` of :meth:`transmittance` of h x w pixels from pixel (top, left) on.

        Of a mask that is seen as commanded only this part is computed.
        """
        if self.path.shows_patterns_as_commanded:
            return self.mask.window(top, left, height, width)
        q = self.path.cells
        return self.transmittance()[:, q * top : q * (top + height), q * left : q * (left + width)]

    def decoder_mask(self, mask: torch.Tensor | None = None) -> torch.Tensor:
        """Return the mask ``(T, H, W)`` for a decoder: the transmittance ``(T, qH, qW)`` averaged over whole pixels.

        Where effects come between the patterns and the light, pixels of less than :data:`LEAST_LIGHT` are shut: at the
        dark edge of a displaced mask a decoder would otherwise divide noise by next to nothing.

        Args:
            mask: a window of :meth:`transmittance`; None for all of it.
        """
        pixels = SnapshotOperator(self.transmittance() if mask is None else mask, self.path.cells).in_pixels().mask
        if not self.path.shows_patterns_as_commanded:
            light = pixels.square().sum(0)
            pixels = pixels * (light >= LEAST_LIGHT * light.mean())
        return self._marked(pixels)

    def forward(self, video: torch.Tensor) -> Measurement:
        """Record ``video`` (N, T, H, W) with the whole mask, as :meth:`record` does.

        Returns:
            ``(N, H, W)``, normalised by the sensor's full scale: a tensor from which decoders undo aperture, optics and
            sensor, ``decoder(encoder(video), encoder.transmittance())``.

        Raises:
            BadInput: as :meth:`record`; a video that is no irradiance: integers, values of 0 to 255, NaN.
        """
        check_irradiance(video)
        mask = self.transmittance()
        shown = mask if self.path.cells == 1 and self.path.shows_patterns_as_commanded else None
        recorded = self.record(video, mask)
        aperture = recorded.aperture if isinstance(recorded, Measurement) else self.aperture
        return Measurement.recorded_by(self._linearising, recorded, aperture, shown)

    @property
    def _linearising(self) -> Encoder | None:
        return self if bool(self.path.of(OpticsEffect)) or bool(self.path.of(SensorEffect)) else None

    def _marked(self, mask: torch.Tensor) -> torch.Tensor:
        return marked(mask, None if self.aperture_setting.is_carried else self.aperture, self._linearising is not None)

    @full_precision()
    def record(self, video: torch.Tensor, mask: torch.Tensor, origin: tuple[int, int] = (0, 0)) -> torch.Tensor:
        """Record one snapshot of every video.

        Args:
            video: float32 ``(N, T, H, W)`` irradiance; 1.0 fills the sensor's range when fully transmitted. Before a
                Bayer sensor ``(N, 3, T, H, W)``, red, green and blue.
            mask: ``(T, qH, qW)`` from :meth:`transmittance`, or a window of whole pixels of it.
            origin: (row, column) of the window's first pixel in the field.

        Returns:
            measurement ``(N, H, W)``, normalised by the sensor's full scale; a :class:`.Measurement` where decoders are
            told a scale for each snapshot, else a plain tensor.

        Raises:
            BadInput: video and mask differ in T, H or W; a window that is not inside the field.
        """
        q = self.path.cells
        if self.sensor.pattern is not None and video.ndim == 5 and video.shape[1] == 3:
            video = mosaic(video, self.sensor.pattern)
        if video.ndim != 4 or (video.shape[1], video.shape[2] * q, video.shape[3] * q) != mask.shape:
            raise misfit(tuple(video.shape), (len(mask), mask.shape[1] // q, mask.shape[2] // q))
        image = SnapshotOperator(mask, q)(video)
        aperture = self.aperture_setting.scale(image, self.mask, q, self.dn)
        image = aperture * image
        if not len(self.path.effects):
            recorded = self.sensor(image)
        else:
            light = self._signal(image, origin, q)
            light = self.path.respond(self.path.form(light))
            recorded = self._convert(_draw(light) if self.path.of(SensorEffect) else light.mean)
        if isinstance(aperture, torch.Tensor) and self.aperture_setting.is_known:
            return Measurement.recorded_by(self._linearising, recorded, aperture.flatten())
        return recorded

    @full_precision()
    def linearise(self, measurement: torch.Tensor, origin: tuple[int, int] = (0, 0)) -> torch.Tensor:
        """Undo the effects of sensor and optics where possible, as a calibrated camera's software does before decoding.

        Args:
            measurement: ``(N, H, W)``, normalised by full scale.
            origin: (row, column) of its first pixel in the field.

        Raises:
            BadInput: a window that is not inside the field.
        """
        passed: list[OpticsEffect | SensorEffect] = [*self.path.of(OpticsEffect), *self.path.of(SensorEffect)]
        if not passed:
            return measurement
        if isinstance(measurement, Measurement):
            undone = self.linearise(measurement.recorded(), origin)
            return Measurement.recorded_by(None, undone, measurement.aperture)
        signal = self._signal(measurement, origin)
        for effect in reversed(passed):
            signal = effect.undo(signal)
        return signal.mean

    def normalised(
        self,
        measurement: torch.Tensor,
        aperture: torch.Tensor | float | None = None,
        origin: tuple[int, int] = (0, 0),
    ) -> Measurement:
        """Return the measurement ``(N, H, W)`` as decoders take it: linearised, over the aperture, near sum_t M_t x_t.

        Args:
            measurement: a :class:`.Measurement`, or plain values normalised by full scale, a tensor or an array.
            aperture: the light scale that it was recorded with, one number or one for each snapshot ``(N,)``; None for
                what the measurement carries, and of plain values this encoder's own.
            origin: (row, column) of its first pixel in the field.

        Raises:
            BadInput: a window that is not inside the field, integers, or values of unknown scale.
        """
        if isinstance(measurement, Measurement):
            recorded = measurement.recorded()
            if measurement.is_linear:
                return Measurement.of_linear(recorded)
            aperture = measurement.aperture if aperture is None else aperture
        else:
            recorded = as_float_tensor(measurement)
            if not recorded.is_floating_point():
                raise BadInput(
                    f"the measurement is {recorded.dtype}: for DN give sci.Measurement(dn, full_scale=.., aperture=..)"
                )
        scale = self.aperture if aperture is None else aperture
        if isinstance(scale, torch.Tensor):
            scale = scale[..., None, None].to(recorded.device)
        return Measurement.of_linear(self.linearise(recorded, origin) / scale)

    def __repr__(self) -> str:
        """Say in one line what the camera is: T, size, mask, bits, aperture, sensor and effects."""
        height, width = self.size
        bits = getattr(self.mask, "bits", None)
        depth = f"{bits} bit{'s' * (bits != 1)}, " if bits else ""
        response = type(self.sensor).__name__ + (f" of {self.sensor.bit_depth} bits" if self.sensor.bit_depth else "")
        effects = f", effects: {', '.join(self.path.names)}" if self.path.names else ""
        return (
            f"Encoder(T={self.mask.frames}, {height} x {width} pixels, {type(self.mask).__name__} mask, {depth}"
            f"aperture {self.aperture_setting.in_words(self.mask)}, {response}{effects})"
        )

    @torch.no_grad()
    def as_deepinv(self) -> Any:
        """Return the linear part as deepinv's physics, see :func:`~sci_lightning.encoder.physics.deepinv_physics`.

        The linear part is the mask, the effects up to the exposure, and the aperture. Give solvers the measurement as
        ``linearise(measurement)[:, None]``.

        Raises:
            BadInput: deepinv is not installed.
        """
        return deepinv_physics(self.decoder_mask(), self.aperture)

    def _signal(self, light: torch.Tensor, origin: tuple[int, int], cells: int = 1) -> Signal:
        field, part = self.size, (light.shape[-2] // cells, light.shape[-1] // cells)
        if any(first < 0 or first + side > full for first, side, full in zip(origin, part, field, strict=True)):
            raise BadInput(f"{part} pixels (H, W) from {origin} on are not inside the encoder's field of {field}")
        return Signal(light, light.new_zeros(()), light.new_ones(len(light), 1, 1), self.dn, origin, field, cells)

    def _convert(self, light: torch.Tensor) -> torch.Tensor:
        depth = self.sensor.bit_depth
        bits = None if depth is None else self.path.effective_bits(depth)
        return self.sensor(light) if bits == depth else self.sensor(light, bits)


def _draw(signal: Signal) -> torch.Tensor:
    deviation = signal.variance.clamp(min=LEAST_VARIANCE).sqrt()  # a bound, or the root's gradient is infinite
    noise = torch.randn_like(signal.mean) * deviation
    return signal.mean + torch.where(signal.variance > LEAST_VARIANCE, noise, 0)


@torch.no_grad()
def check_recording(encoder: Encoder, where: str) -> None:
    """Record and linearise a dark scene: settings can be valid one by one and fail together.

    The state of the random generator does not change.

    Args:
        encoder: the encoder to try.
        where: the file that configures it, for the message.

    Raises:
        BadInput: the recording fails, for whatever reason a library gives.
    """
    with torch.random.fork_rng(devices=[]):
        try:
            mask = encoder.transmittance()
            dark = mask.new_zeros(()).expand(1, encoder.mask.frames, *encoder.size)
            encoder.linearise(encoder.record(dark, mask))
        except (BadInput, MachineFailure, OSError, MemoryError):
            raise
        except Exception as error:  # every library has exceptions of its own
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise BadInput(f"{where}: cannot record with these settings ({reason})") from error
