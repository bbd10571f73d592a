"""Light to numbers: photo-electrons, charge, voltage, converter (EMVA standard 1288; Janesick, Photon Transfer)."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import convolve

from tests.textbook_camera.camera import Camera, Datasheet


def exact(rng: np.random.Generator, shape: tuple[int, ...], std: float) -> np.ndarray:
    """Return Gaussian numbers whose mean (0) and standard deviation over ``shape`` are exact, as the truth states."""
    drawn = rng.standard_normal(shape)
    return std * (drawn - drawn.mean()) / drawn.std()


def charge(camera: Camera, light: np.ndarray, maps: np.random.Generator, noise: np.random.Generator) -> np.ndarray:
    """Return the electrons ``(N, H, W)`` of each pixel for the light ``(N, H, W)`` in parts of full scale.

    ``maps`` draws what is the same in every capture, ``noise`` the arrival of the photons.
    """
    height, width = light.shape[1:]
    efficiency = camera.quantum_efficiency * (1.0 + exact(maps, (height, width), camera.pixel_gain))
    mean = light * camera.full_scale_e * efficiency
    row, column = np.ogrid[:height, :width]
    place = maps.uniform(0.25, 0.75, 2)
    distance2 = (row / height - place[0]) ** 2 + (column / width - place[1]) ** 2
    mean += camera.stray_spot * camera.full_scale_e * np.exp(-0.5 * distance2 / 0.15**2)
    if camera.crosstalk:  # diffusion of charge below the pixels
        part = camera.crosstalk
        kernel = np.array([[0.0, part, 0.0], [part, 1.0 - 4.0 * part, part], [0.0, part, 0.0]])
        mean = convolve(mean, kernel[None], mode="nearest")
    electrons = noise.poisson(np.clip(mean, 0.0, None)).astype(float)
    for index in range(1, len(electrons)):
        electrons[index] += camera.image_lag * electrons[index - 1]
    well = camera.well * camera.full_scale_e
    if camera.blooming:
        for _ in range(4):
            above = np.clip(electrons - well, 0.0, None)
            electrons -= above
            spill = 0.5 * camera.blooming * above
            electrons[:, 1:] += spill[:, :-1]
            electrons[:, :-1] += spill[:, 1:]
    return np.minimum(electrons, well)


def response(camera: Camera, signal: np.ndarray) -> np.ndarray:
    """Return the voltage for a charge, both in parts of full scale: exponent, then cubic curvature, then a knee."""
    signal = signal**camera.response_exponent
    signal = signal + camera.cubic * (signal**3 - signal)
    if camera.knee is not None:
        start, slope = camera.knee
        signal = np.where(signal > start, start + slope * (signal - start), signal)
    return signal


def read_out(
    camera: Camera, datasheet: Datasheet, light: np.ndarray, maps: np.random.Generator, noise: np.random.Generator
) -> np.ndarray:
    """Return the raw values ``(N, H, W)``, uint16, from 0 to the datasheet's full scale."""
    height, width = light.shape[1:]
    full, levels = datasheet.full_scale_dn, 2**camera.converter_bits - 1
    signal = response(camera, charge(camera, light, maps, noise) / camera.full_scale_e)
    signal += camera.pedestal + exact(maps, (height, width), camera.pixel_offset)
    signal += exact(maps, (1, width), camera.column_offset) + exact(maps, (height, 1), camera.row_offset)
    hot = maps.permutation(height * width)[: round(camera.hot * height * width)]
    leakage = np.zeros(height * width)
    leakage[hot] = maps.uniform(0.2, 0.9, len(hot))
    signal += leakage.reshape(height, width) + noise.standard_normal(signal.shape) * camera.read_noise_dn / full
    # A coarser converter's codes are spread over the file's whole range, as frame grabbers do.
    code = np.clip(np.rint(signal * levels), 0, levels)
    return np.rint(code * (full / levels)).astype(np.uint16)
