"""The encoder: mask and sensor in the order light travels."""

from __future__ import annotations

import torch
from torch import nn

from sci_lightning.encoder.mask import Mask
from sci_lightning.errors import BadInput


class Encoder(nn.Module):
    r"""A video SCI camera: :math:`y = R(a \sum_t M_t \odot x_t)`.

    Args:
        mask: the transmittance M, ``(T, H, W)`` in [0, 1].
        sensor: the response R, light to measurement.
        aperture: a, scale of the light before the sensor, > 0. ``auto`` asks the mask ("automatic aperture": 2/T
            for binary masks, 1 for structural ones), so that a white scene just fills the sensor on average.

    Raises:
        BadInput: aperture neither ``auto`` nor a positive number.

    Source: "Deep Optics for Video Snapshot Compressive Imaging" (ICCV 2023), Eq. 1 to 3.
    """

    def __init__(self, mask: Mask, sensor: nn.Module, aperture: float | str = "auto") -> None:
        super().__init__()
        self.mask = mask
        self.sensor = sensor
        if aperture != "auto" and (isinstance(aperture, str) or not aperture > 0):
            raise BadInput(f"encoder aperture must be 'auto' or a positive number, got {aperture!r}")
        self._aperture = aperture

    @property
    def aperture(self) -> float:
        """Scale of the light before the sensor."""
        return self.mask.automatic_aperture if isinstance(self._aperture, str) else float(self._aperture)

    def forward(self, video: torch.Tensor) -> torch.Tensor:
        """Record ``video`` (N, T, H, W) with the whole mask; see :meth:`record`."""
        return self.record(video, self.mask())

    def record(self, video: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """One snapshot of each video.

        Args:
            video: float32 ``(N, T, H, W)`` irradiance; 1.0 fills the sensor's range when fully transmitted.
            mask: ``(T, H, W)`` what ``self.mask()`` gave, or a window of it.

        Returns:
            measurement ``(N, H, W)``, normalised by the sensor's full scale.

        Raises:
            BadInput: video and mask differ in T, H or W.
        """
        if video.ndim != 4 or video.shape[1:] != mask.shape:
            raise BadInput(
                f"the video is {tuple(video.shape)} (N, T, H, W), the mask {tuple(mask.shape)} (T, H, W): "
                f"T, H and W must agree; set frames= and size= to the data's, or crop the data"
            )
        return self.sensor(self.aperture * (video * mask).sum(1))

    def rescale(self, measurement: torch.Tensor) -> torch.Tensor:
        """Measurement ``(N, H, W)`` as the decoder wants it: divided by the aperture, so near sum_t M_t x_t."""
        return measurement / self.aperture
