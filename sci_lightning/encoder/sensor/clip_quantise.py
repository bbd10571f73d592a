"""Sensor response (SR): noise, saturation, quantisation."""

from __future__ import annotations

import torch

from sci_lightning.configuration.bounds import NonNegative, Positive
from sci_lightning.encoder.rounding import round_half_up, straight_through
from sci_lightning.encoder.sensor.sensor import Sensor
from sci_lightning.errors import BadInput


class ClipQuantise(Sensor):
    r"""Light to numbers: :math:`R(x) = \lfloor (2^d - 1)\, \mathrm{clip}(x + n, 0, 1) + 1/2 \rfloor / (2^d - 1)`.

    Clipping has its ordinary gradient (zero outside [0, 1]); rounding passes the gradient through. Shot noise is a
    true Poisson draw; in the backward pass the draw's deviation in units of its standard deviation stays fixed, so that
    training takes into account how the noise grows with the light. Noise is drawn from torch's global generator, in
    training and in testing alike.

    Noise may be stated here or as the effects ``shot_noise`` and ``read_noise``; an encoder refuses to take both.

    Args:
        bit_depth: d, bits of the analogue-to-digital converter, 1 to 16.
        full_well: electrons at full scale; None for no shot noise.
        read_noise: standard deviation in DN (steps of the converter); 0 for none.

    Raises:
        BadInput: a parameter out of its range.

    Source: "Deep Optics for Video Snapshot Compressive Imaging" (ICCV 2023), Eq. 2 and Section 4.1.
    """

    def __init__(self, bit_depth: int = 8, full_well: Positive | None = None, read_noise: NonNegative = 0.0) -> None:
        super().__init__()
        if not isinstance(bit_depth, int) or not 1 <= bit_depth <= 16:
            raise BadInput(f"sensor bit_depth must be a whole number from 1 to 16, got {bit_depth!r}")
        if full_well is not None and not full_well > 0:
            raise BadInput(f"sensor full_well must be a positive number of electrons or null, got {full_well!r}")
        if not read_noise >= 0:
            raise BadInput(f"sensor read_noise must be a standard deviation in DN, 0 or more, got {read_noise!r}")
        self.bit_depth: int = bit_depth
        self.full_well = full_well
        self.read_noise = read_noise

    @property
    def full_scale(self) -> int:
        """The largest DN, ``2**bit_depth - 1``."""
        return 2**self.bit_depth - 1

    def forward(self, light: torch.Tensor, bits: int | None = None) -> torch.Tensor:
        """Return the measurement ``(N, H, W)`` in {0, 1/(2^d - 1), .., 1} of light ``(N, H, W)``, 1.0 at full scale.

        With fewer effective ``bits`` only 2^bits values occur, evenly from 0 to 1, rounded to the nearest DN.
        """
        if self.full_well is not None:
            light = self._shot_noise(light, self.full_well)
        if self.read_noise:
            light = light + torch.randn_like(light) * (self.read_noise / self.full_scale)
        clipped = light.clamp(0, 1)
        code = clipped if bits is None else round_half_up(clipped * (2**bits - 1)) / (2**bits - 1)
        return straight_through(round_half_up(code * self.full_scale) / self.full_scale, clipped)

    @staticmethod
    def _shot_noise(light: torch.Tensor, full_well: float) -> torch.Tensor:
        electrons = (light * full_well).clamp(min=0)
        deviation = electrons.clamp(min=1e-6).sqrt()  # a bound, or the root's gradient is infinite in the dark
        with torch.no_grad():
            standardised = (torch.poisson(electrons) - electrons) / deviation
        return (electrons + standardised * deviation) / full_well

    def extra_repr(self) -> str:
        return f"bit_depth={self.bit_depth}, full_well={self.full_well}, read_noise={self.read_noise}"
