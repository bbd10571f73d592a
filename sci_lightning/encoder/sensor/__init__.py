"""Sensors: light ``(N, H, W)`` to measurement ``(N, H, W)``, one kind per file."""

from sci_lightning.encoder.sensor.bayer import Bayer
from sci_lightning.encoder.sensor.clip_quantise import ClipQuantise
from sci_lightning.encoder.sensor.ideal import Ideal
from sci_lightning.encoder.sensor.sensor import Sensor

__all__ = ["Bayer", "ClipQuantise", "Ideal", "Sensor"]
