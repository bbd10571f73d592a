"""Encoder and decoder as one plain torch module: record, linearise, decode."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.tiling.tile_choice import TileChoice
from sci_lightning.encoder.encoder import Encoder
from sci_lightning.encoder.irradiance import check_irradiance
from sci_lightning.encoder.sensor.bayer import interleaved, sub_lattices
from sci_lightning.measurement import Measurement, linear_with_mask


class Pipeline(nn.Module):
    r"""A snapshot camera with its decoder: :math:`\hat x = D\big(L(E(x)), M\big)`.

    1. ``record``: the encoder E turns a video into measurements.
    2. ``linearise``: L undoes what the camera model can undo of sensor and optics, and divides by the aperture, so that
       the measurement is close to :math:`\sum_t M_t \odot x_t`, see :mod:`sci_lightning.operator`.
    3. ``decode``: the decoder D estimates the video from that measurement and the mask M that the camera model has.

    Args:
        encoder: what records.
        decoder: what reconstructs; the pipeline never changes its mode (``train``, ``eval``) or its weights.
        camera: the encoder that the decoder believes in, which may differ from the one that records, as a camera in a
            laboratory differs from its model; None for ``encoder`` itself.
        bayer: colours of 2 x 2 pixels of the measurements, which are then decoded as four snapshots of half the height
            and width; the estimate is a mosaic, see :mod:`sci_lightning.encoder.sensor.bayer`. None: as the
            encoder's sensor has them.

    Example:
        >>> import torch
        >>> import sci_lightning as sci
        >>> encoder = sci.Encoder(sci.masks.RandomBinary(frames=4, size=(16, 16)), sci.sensors.ClipQuantise())
        >>> pipeline = sci.Pipeline(encoder, sci.load_decoder("gap_tv", ["decoder.iterations=[3]"]))
        >>> tuple(pipeline(torch.rand(2, 4, 16, 16)).shape)
        (2, 4, 16, 16)
    """

    def __init__(
        self, encoder: Encoder, decoder: Decoder, camera: Encoder | None = None, bayer: str | None = None
    ) -> None:
        super().__init__()
        self.encoder = encoder
        self.decoder = decoder
        self._camera = camera
        self.bayer = encoder.sensor.pattern if bayer is None else bayer

    @property
    def camera(self) -> Encoder:
        """The encoder that the decoder believes in."""
        return self.encoder if self._camera is None else self._camera

    def forward(
        self, video: torch.Tensor, mask: torch.Tensor | None = None, origin: tuple[int, int] = (0, 0)
    ) -> torch.Tensor:
        """Record a video and reconstruct it.

        Args:
            video: irradiance ``(N, T, H, W)``, 1.0 fills the sensor's range when fully transmitted.
            mask: a window of whole pixels of the transmittance, for videos smaller than the mask; None for all of it.
            origin: (row, column) of the window's first pixel in the field.

        Returns:
            The estimate ``(N, T, H, W)``, nominally in [0, 1], not clipped.

        Raises:
            BadInput: shapes that do not fit together.
        """
        check_irradiance(video)
        if mask is None and self._camera is None:  # once for both, where both have the same
            mask = self.encoder.transmittance()
        measurement = self.record(video, mask, origin)
        return self.decode(self.linearise(measurement, origin=origin), self.decoder_mask(mask))

    def reconstruct(
        self,
        measurement: torch.Tensor,
        aperture: torch.Tensor | float | None = None,
        tile: TileChoice | str | Sequence[int] = "none",
    ) -> torch.Tensor:
        """Return the estimate ``(N, T, H, W)`` of what a snapshot shows: linearised, then decoded.

        Args:
            measurement: ``(N, H, W)``, what the encoder returned, or values normalised by full scale.
            aperture: as :meth:`linearise` has it.
            tile: as :meth:`decode` has it.

        Raises:
            BadInput: shapes that do not fit, or values of unknown scale.
        """
        return self.decode(self.linearise(measurement, aperture), tile=tile)

    def record(
        self, video: torch.Tensor, mask: torch.Tensor | None = None, origin: tuple[int, int] = (0, 0)
    ) -> torch.Tensor:
        """Return the measurement ``(N, H, W)``, normalised by full scale; the arguments are those of the call."""
        return self.encoder.record(video, self.encoder.transmittance() if mask is None else mask, origin)

    def linearise(
        self,
        measurement: torch.Tensor,
        aperture: torch.Tensor | float | None = None,
        origin: tuple[int, int] = (0, 0),
    ) -> Measurement:
        """Return the measurement ``(N, H, W)`` as decoders want it, near the sum of mask times frame.

        It is what the camera model makes of it, see :meth:`.Encoder.normalised`, whatever encoder recorded.
        """
        return self.camera.normalised(measurement, aperture, origin)

    def decoder_mask(self, mask: torch.Tensor | None = None) -> torch.Tensor:
        """Return the mask ``(T, H, W)`` that the decoder gets, in whole pixels.

        Args:
            mask: a window of the camera model's transmittance ``(T, qH, qW)``; None for all of it.
        """
        return self.camera.decoder_mask(mask)

    def decode(
        self, linear: torch.Tensor, mask: torch.Tensor | None = None, tile: TileChoice | str | Sequence[int] = "none"
    ) -> torch.Tensor:
        """Return the estimate ``(N, T, H, W)`` from what :meth:`linearise` and :meth:`decoder_mask` return.

        Args:
            linear: ``(N, H, W)``.
            mask: ``(T, H, W)``; None for :meth:`decoder_mask`.
            tile: ``auto``, ``none`` or (height, width) of the tiles in which a large field is decoded one after
                another, see :class:`~sci_lightning.decoder.tiling.tile_choice.TileChoice`. Not for training.

        Raises:
            BadInput: a tile is smaller than the decoder's halo, or more memory is needed than there is.
        """
        linear, mask = linear_with_mask(linear, self.decoder_mask() if mask is None else mask)
        choice = tile if isinstance(tile, TileChoice) else TileChoice(tile)
        if self.bayer is None:
            return self._decode(linear, mask, choice)
        parts = zip(sub_lattices(linear), sub_lattices(mask), strict=True)
        return interleaved([self._decode(*part, choice) for part in parts])

    def _decode(self, linear: torch.Tensor, mask: torch.Tensor, choice: TileChoice) -> torch.Tensor:
        tiling = choice.tiling(self.decoder, linear, mask)
        return self.decoder(linear, mask) if tiling is None else self.decoder.in_tiles(linear, mask, tiling)
