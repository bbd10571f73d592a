"""The sensor's photon transfer after EMVA 1288: electrons of light and of dark current, and pixels that differ.

EMVA Standard 1288, release 4.0: characterization of image sensors and cameras.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter

from sci_lightning.virtual_camera.hardware.sensor import Readout


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
