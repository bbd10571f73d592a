"""The camera of an imperfect set-up: light sampled by rays and instants, in front of a sensor with photon transfer.

The sensor follows EMVA Standard 1288, release 4.0: characterization of image sensors and cameras.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.sparse import csr_matrix, diags

from sci_lightning.virtual_camera.hardware.camera import Camera
from sci_lightning.virtual_camera.hardware.converter import ReadNoise, ShotNoise
from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.hardware.exposure import Part, Timing
from sci_lightning.virtual_camera.hardware.fixed_pattern import Prnu
from sci_lightning.virtual_camera.hardware.modulator import MaskLag, PatternOrder, SyncOffset
from sci_lightning.virtual_camera.hardware.optics import Image, OpticsEffect
from sci_lightning.virtual_camera.hardware.relay import Relay
from sci_lightning.virtual_camera.hardware.sensor import Readout, SensorEffect
from sci_lightning.virtual_camera.random_numbers import stream
from sci_lightning.virtual_camera.rays.tracing import gathered, landing, settled, slot_shares, through_the_relay
from sci_lightning.virtual_camera.session import BEYOND, Acquisition, Session


@dataclass(frozen=True)
class Imperfections:
    """What is never quite right, in any camera that has been built.

    Attributes:
        fill_factor: part of a mirror's cell that reflects; the rest is a dark gap around it.
        exposure_jitter: relative standard deviation of the light of a capture.
        print_error: relative standard deviation of a printed target's reflectance from what the file says.
        prnu: relative standard deviation of the pixels' responses (EMVA 1288 PRNU), half of its variance in blotches.
        dsnu_e: standard deviation of the pixels' offsets (EMVA 1288 DSNU), electrons; half of its variance in blotches.
        dark_current_e: electrons that gather in the dark during the nominal exposure. The black clamp takes their mean
            away, but not their shot noise; the data sheet's read noise contains it.
        blotch: standard deviation of the Gaussian that makes blotches of independent values, pixel.
        strata: rays that leave a mirror, and bundles that reach a pixel, are ``strata`` x ``strata``.
        cells: cells per pixel and axis on which light is gathered where it is blurred afterwards.
    """

    fill_factor: float = 0.92
    exposure_jitter: float = 0.005
    print_error: float = 0.01
    prnu: float = 0.005
    dsnu_e: float = 1.0
    dark_current_e: float = 1.0
    blotch: float = 1.5
    strata: int = 32
    cells: int = 2


FAULTLESS = Imperfections(1.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Nothing but the error of sampling, to compare the two formulations with."""


@dataclass(frozen=True)
class PhotonTransfer:
    """The pixels of one sensor.

    Attributes:
        response: (H, W) relative response of every pixel to light, mean 1.
        offset_e: (H, W) offset of every pixel, electrons, mean 0.
        dark_current_e: electrons that gather in the dark during the nominal exposure, on average.
    """

    response: np.ndarray
    offset_e: np.ndarray
    dark_current_e: float

    def respond(self, signal: np.ndarray, readout: Readout, full_well: float) -> np.ndarray:
        """Return the signal (N, H, W) after the electrons have been counted and the black clamp applied.

        Args:
            signal: (N, H, W) light, 1 at full scale.
            readout: exposures and noise; without a source of noise, the standard deviation is that of the light's
                electrons, because the data sheet's read noise holds that of the dark current.
            full_well: electrons at full scale.
        """
        light = signal * self.response * full_well
        dark = self.dark_current_e * readout.exposure[:, None, None]
        if readout.random is None:
            electrons = np.maximum(light + readout.shot_noise_sigmas * np.sqrt(light), 0)
        else:
            electrons = readout.random.poisson(light + dark) - dark
        return (electrons + self.offset_e) / full_well


def blotchy(random: np.random.Generator, size: tuple[int, int], blotch: float) -> np.ndarray:
    """Return a map (H, W) of mean 0 and standard deviation 1, half of whose variance is in blotches.

    Args:
        random: source of the values.
        size: (H, W).
        blotch: standard deviation of the Gaussian that makes the blotches, pixel.
    """
    maps = []
    for smoothing in (0.0, blotch):
        values = gaussian_filter(random.standard_normal(size), smoothing, mode="wrap")
        maps.append((values - values.mean()) / values.std())
    both = maps[0] + maps[1]
    return (both - both.mean()) / both.std()


WIDTHS = 12
"""Constant blurs that a blur which varies over the field is mixed of."""
PRINTED = ("static", "dynamic", "unknown")
"""Kinds of captures in front of printed targets; the others look at a lamp."""


class RayCamera(Camera):
    """A camera with its hidden effects in a set-up that is imperfect without them.

    Args:
        session, effects, seed: as of :class:`.Camera`.
        imperfections: of the set-up.
    """

    def __init__(
        self, session: Session, effects: Mapping[str, Effect], seed: int, imperfections: Imperfections | None = None
    ) -> None:
        super().__init__(session, effects, seed)
        self.imperfections = imperfections or Imperfections()
        spread = 0.0 if Prnu.name in effects else self.imperfections.prnu  # a hidden one is all that there is
        self.photon_transfer = PhotonTransfer(
            response=1 + spread * blotchy(stream(seed, "responses"), session.size, self.imperfections.blotch),
            offset_e=self.imperfections.dsnu_e
            * blotchy(stream(seed, "offsets"), session.size, self.imperfections.blotch),
            dark_current_e=self.imperfections.dark_current_e,
        )

    def irradiance(self, acquisition: Acquisition) -> np.ndarray:
        """Return the light that every pixel collects over the exposure, without noise: (N, H, W), 1 at full scale."""
        acquisition = self.happened(acquisition)
        captures, slots = acquisition.sequence.shape
        count, height, width = acquisition.patterns.shape
        relay, timing, images = self._light_path()
        parts, _ = self._displayed(acquisition, timing)
        patterns = np.concatenate([part.patterns for part in parts])
        scenes = self._printed(self._shown(acquisition), acquisition.kind)
        border = acquisition.border
        if self.session.surround != "dark":  # where rays come from that a large displacement brings in
            border = max(border, BEYOND, _farthest(relay, (height, width)))
            around = [(border - acquisition.border,) * 2] * 2
            patterns = np.pad(patterns, [(0, 0), *around], mode="edge")
            scenes = np.pad(scenes, [(0, 0), (0, 0), *around], mode="edge")
        shares = [self._shares(timing, part, slots, height, border) for part in parts]
        sharp = images == [Image()]
        cells = 1 if sharp else self.imperfections.cells
        shape = (patterns.shape[1] * cells, patterns.shape[2] * cells)
        onto_pixels = None if sharp else self._gathered("images", images, shape, cells, cells, (height, width))
        jitter = 1 + self.imperfections.exposure_jitter * stream(self.seed, "exposure jitter").standard_normal(captures)
        power = timing.power(captures) * acquisition.aperture * jitter
        field = (slice(border, border + height), slice(border, border + width))
        light = np.empty((captures, height, width))
        relayed: tuple[Relay, np.ndarray] | None = None
        for number, (sequence, scene) in enumerate(zip(acquisition.sequence, scenes, strict=True)):
            now = relay.during(number, captures)
            if relayed is None or relayed[0] != now:
                relayed = now, self._transmitted(now, patterns, (height, width), cells)
            change, modulated = timing.change(scene), np.zeros(relayed[1].shape[1:])
            for first, (share, moment) in zip(range(0, len(patterns), count), shares, strict=True):
                passed = np.einsum("rsf,frc->src", share, scene) * power[number]
                if change is not None:
                    passed += np.einsum("rsf,frc->src", moment, change) * power[number]
                for pattern in np.unique(sequence):
                    lit = passed[sequence == pattern].sum(0)
                    modulated += relayed[1][first + pattern] * lit.repeat(cells, 0).repeat(cells, 1)
            modulated = np.maximum(modulated, 0)  # a scene that changes evenly within a slot may fall below 0
            landed = modulated.ravel() if onto_pixels is None else onto_pixels @ modulated.ravel()
            light[number] = landed.reshape(patterns.shape[1:])[field]
        for effect in self._stage(OpticsEffect):
            light = effect.change_irradiance(light, acquisition.exposure, self.fixed_maps)
        return light

    def signal(
        self,
        light: np.ndarray,
        acquisition: Acquisition,
        random: np.random.Generator | None = None,
        shot_noise_sigmas: float = 0.0,
    ) -> np.ndarray:
        """Return the signal that reaches the converter, see :meth:`.Camera.signal`."""
        readout = Readout(self.full_scale, acquisition.exposure, self.fixed_maps, random, shot_noise_sigmas)
        for step in self._stage(SensorEffect):
            if isinstance(step, ShotNoise):
                light = self.photon_transfer.respond(light, readout, step.full_well)
            elif isinstance(step, ReadNoise):
                light = self._amplifier(step).respond(light, readout)
            else:
                light = step.respond(light, readout)
        return light

    def _amplifier(self, stated: ReadNoise) -> ReadNoise:
        """Return the noise that the amplifier adds: the data sheet's without the dark current's shot noise."""
        dn_per_electron = self.full_scale / self.part(ShotNoise).full_well
        dark = self.imperfections.dark_current_e * dn_per_electron**2
        return replace(stated, std=float(np.sqrt(max(stated.std**2 - dark, 0))))

    def _printed(self, scenes: np.ndarray, kinds: tuple[str, ...]) -> np.ndarray:
        """Return the scenes (N, T, H, W) as printed: at rest one print, in motion one for every frame."""
        random = stream(self.seed, "prints")
        printed = scenes.astype(np.float64)
        for frames, kind in zip(printed, kinds, strict=True):
            if kind in PRINTED:
                prints = 1 if kind == "static" else len(frames)
                size = (prints, *frames.shape[1:])
                frames *= np.maximum(1 + self.imperfections.print_error * random.standard_normal(size), 0)
        return printed

    def _shares(self, timing: Timing, part: Part, slots: int, rows: int, border: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the light of every frame that passes every commanded pattern, (H + 2 border, T, T).

        And the same for the scene's change within a slot, see :func:`.slot_shares`.
        """
        order = sum(effect.offset for effect in self._stage(PatternOrder))
        lag = sum(effect.lag for effect in self._stage(MaskLag))
        late = sum(effect.offset for effect in self._stage(SyncOffset))
        shown = settled(order, lag, slots)
        shares = slot_shares(timing, part, shown, late, rows, stream(self.seed, "instants"))
        one, moments = (np.pad(share, ((border, border), (0, 0), (0, 0)), mode="edge") for share in shares)
        return one, moments

    def _transmitted(self, relay: Relay, patterns: np.ndarray, field: tuple[int, int], cells: int) -> np.ndarray:
        """Return the irradiance (P, rows, columns) of the cells of the image plane for every pattern."""
        imperfect, size = self.imperfections, patterns.shape[1:]
        sigma_y, sigma_x = relay.sigmas
        finer = imperfect.cells if sigma_y or sigma_x else cells
        rays = stream(self.seed, "rays")
        mirrors = patterns.reshape(len(patterns), -1).T
        colours = [
            through_the_relay(colour, size, field, imperfect.fill_factor, imperfect.strata, finer, rays) @ mirrors
            for colour in relay.colours
        ]
        seen = np.mean(colours, axis=0)
        if sigma_y or sigma_x:
            blurred = Image(sigma=sigma_y, sigma_x=float(np.sqrt(max(sigma_x**2 - sigma_y**2, 0))))
            shape = (size[0] * finer, size[1] * finer)
            seen = self._gathered("relay", [blurred], shape, finer, finer // cells, field) @ seen
        return seen.T.reshape(len(patterns), size[0] * cells, size[1] * cells)

    def _gathered(
        self,
        purpose: str,
        images: list[Image],
        shape: tuple[int, int],
        cells: int,
        targets: int,
        field: tuple[int, int],
    ) -> csr_matrix:
        """Return the matrix from cells to targets of all images together, see :func:`.gathered`.

        A blur that varies over the field is a mixture of ``WIDTHS`` constant ones, interpolated in their variances.
        """
        strata = (
            self.imperfections.strata if targets > 1 else self.imperfections.strata // 2
        )  # four times as many targets
        random, dark = stream(self.seed, purpose), self.session.surround == "dark"
        y, x = ((np.arange(length) + 0.5 - length / 2) / cells for length in shape)
        matrices = []
        for image in images:
            sigma = image.sigma_at(y[:, None], x, field).ravel()
            widths = np.linspace(sigma.min(), sigma.max(), WIDTHS) if image.varies else sigma[:1]
            for number, width in enumerate(widths):
                constant = replace(image, sigma=float(width), centre=0.0, corner=0.0)
                matrix = gathered(constant, shape, cells, targets, strata, random, dark)
                share = np.interp(sigma**2, widths**2, np.eye(len(widths))[number])
                matrices.append(matrix @ diags(share) if image.varies else matrix)
        return sum(matrices[1:], matrices[0])


def _farthest(relay: Relay, field: tuple[int, int]) -> int:
    """Return by how many pixels at most the relay moves what belongs into the field, rounded up."""
    corners = np.array([(y, x) for y in (-0.5, 0.5) for x in (-0.5, 0.5)]).T * np.array(field)[:, None]
    places = [np.array(landing(colour, corners[0], corners[1], field)[:2]) for colour in relay.colours]
    return int(np.ceil(max(np.abs(place - corners).max() for place in places))) + 1


CAMERAS: dict[str, type[Camera]] = {"overlap": Camera, "rays": RayCamera}
"""The camera of every formulation, by the name that a session gives it."""


def build_camera(session: Session, effects: Mapping[str, Effect], seed: int) -> Camera:
    """Return the session's camera with the hidden effects in it and the maps of the seed."""
    return CAMERAS[session.formulation](session, effects, seed)
