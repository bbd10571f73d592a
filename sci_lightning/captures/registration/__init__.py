"""Registration: where in the sensor's field the mirrors of a modulator lie, found from images of known patterns."""

from sci_lightning.captures.registration.registration import Registration, register

__all__ = ["Registration", "register"]
