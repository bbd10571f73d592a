"""What is not perfect in a set-up in which nothing is hidden, of the size that data sheets and lamp makers state."""

from __future__ import annotations

from dataclasses import dataclass


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
