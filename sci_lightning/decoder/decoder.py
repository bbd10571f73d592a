"""The base class of all decoders: the call, and the check of its arguments."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, TypeAlias

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.decoder.tiling.tiling import SEAM_TOLERANCE, SeamsDiffer, Tiling
from sci_lightning.errors import BadInput
from sci_lightning.full_precision import full_precision
from sci_lightning.measurement import linear_with_mask
from sci_lightning.operator import SnapshotOperator

if TYPE_CHECKING:
    from sci_lightning.prior.estimator import LinearEstimator

HALO = 16
"""Pixels around a tile that are decoded with it to begin with, where the receptive field is larger."""

WIDEST_HALO = 256
"""Pixels around a tile beyond which nothing is tried."""

ROUNDING_WINDOW = 64
"""Height and width in pixels of the window on which the rounding of a lower precision is measured."""

BRIGHTEST_SUM = 16.0
"""How many times brighter than behind white frames a measurement may be."""

MASK_ROUNDING = 1e-3
"""How far a mask may lie beyond 0 to 1: effects interpolate."""

FirstEstimate: TypeAlias = Literal["published", "linear"]
"""Which video a network gets as its input, see :meth:`Decoder.first_video`."""


class FirstVideo(NamedTuple):
    """The video that a network gets as its input or begins with."""

    video: torch.Tensor
    """``(N, T, H, W)``."""
    improved: bool
    """Whether the network's result is a change of this video; else the result stands for itself."""

    def plus(self, result: torch.Tensor) -> torch.Tensor:
        """Return the network's estimate, made of its result."""
        return self.video + result if self.improved else result


class Decoder(nn.Module):
    """A decoder: ``decoder(measurement, mask) -> video``.

    The measurement ``(N, H, W)`` is what an encoder returned, a :class:`~sci_lightning.measurement.Measurement`, of
    which the decoder undoes the aperture; or, as a plain tensor, the sum over t of M_t x_t. The mask M is ``(T, H, W)``
    in [0, 1], and the video x is ``(N, T, H, W)``. A subclass implements :meth:`decode`, or :meth:`decode_stages` if it
    makes several estimates one after another. The shapes are checked before either is called.

    Args:
        first_estimate: for networks: ``published`` gives them the input that their authors describe, ``linear`` the
            linear estimate of the video: networks that make one estimate add their result to it, and those of several
            stages begin with it.

    Raises:
        BadInput: another name.
    """

    frames: int | None = None
    """T, if the architecture is built for one number of frames; None if it takes any."""
    multiple: ClassVar[int] = 1
    """H and W must be multiples of this; other sizes are padded by replication, and the video is cropped back."""
    global_steps: ClassVar[bool] = False
    """Whether the decoder works in steps on the whole field, and calls :meth:`locally` for what has to be done in
    tiles; else a tile is decoded by itself."""
    period: ClassVar[int | None] = None
    """Measurement and mask that are shifted by a multiple of so many pixels give the estimate, shifted; None:
    ``multiple``."""
    receptive_field: int | None = None
    """The distance in pixels, along rows and columns, beyond which measurement and mask do not act on a pixel of the
    estimate; None if that is not known, or if there is no such distance."""
    published_names: ClassVar[tuple[tuple[str, str], ...]] = ()
    """What the authors call our state-dict keys: (regular expression of our key, replacement to make it theirs).

    An expression has to match all of a key. Where several match, the authors' tensors are joined in this order.
    """
    published_unused: ClassVar[tuple[str, ...]] = ()
    """Regular expressions of published state-dict keys that are not used on purpose."""

    plain_formulas: bool = False
    """Whether it is computed by the formulas as they are written, see :mod:`~sci_lightning.decoder.layers.kernels`."""
    watch: Callable[[Any], object] | None = None
    """Called while a measurement is decoded, with something whose text says how far it is."""

    _tiling: Tiling | None = None

    def __init__(self, first_estimate: FirstEstimate = "published") -> None:
        super().__init__()
        if first_estimate not in ("published", "linear"):
            raise BadInput(f"decoder.first_estimate={first_estimate}: choose published or linear")
        self.linear_estimator: LinearEstimator | None = None
        if first_estimate == "linear":
            from sci_lightning.prior.estimator import LinearEstimator  # and with it torch's compiler

            self.linear_estimator = LinearEstimator(mixture=False)

    @torch.no_grad()
    def begin_at_first_video(self, *networks: nn.Module) -> None:
        """Let a training begin at the linear estimate, if there is one: the last layers of networks start from 0."""
        for network in networks if self.linear_estimator is not None else ():
            *_, last = (
                module for module in network.modules() if next(module.parameters(recurse=False), None) is not None
            )
            for parameter in last.parameters(recurse=False):
                parameter.zero_()

    def first_video(self, published: torch.Tensor, measurement: torch.Tensor, mask: torch.Tensor) -> FirstVideo:
        """Return the video that the network gets or begins with: ``published``, or the linear estimate."""
        if self.linear_estimator is None:
            return FirstVideo(published, False)
        self.linear_estimator.watch = self.watch
        return FirstVideo(self.linear_estimator(measurement, mask), True)

    def forward(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return the estimated video ``(N, T, H, W)``, nominally in [0, 1], not clipped: the last of :meth:`stages`.

        Raises:
            BadInput: the shapes do not fit together, the architecture cannot take them, or the values are those of
                integers, DN or another light scale.
        """
        measurement, mask = linear_with_mask(measurement, mask)
        if not (measurement.is_meta or self.training):
            check_levels(measurement, mask)
        return self.stages(measurement, mask)[-1]

    def stages(self, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
        """Return all estimates of the video from first to last, ``(N, T, H, W)`` each, for losses that use them.

        Raises:
            BadInput: as for the call.
        """
        measurement, mask = linear_with_mask(measurement, mask)
        if measurement.ndim != 3 or mask.ndim != 3 or measurement.shape[1:] != mask.shape[1:]:
            alone = measurement.ndim == 2 and mask.ndim == 3 and measurement.shape == mask.shape[1:]
            raise BadInput(
                f"decoder called with measurement {tuple(measurement.shape)} and mask {tuple(mask.shape)}; "
                "it takes measurement (N, H, W) and mask (T, H, W) of the same H and W"
                f"{'; give measurement[None]' if alone else ''}"
            )
        if self.frames is not None and len(mask) != self.frames:
            raise BadInput(f"this {type(self).__name__} was built for {self.frames} frames, the mask has {len(mask)}")
        height, width = mask.shape[1:]
        margin = (0, -width % self.multiple, 0, -height % self.multiple)
        if any(margin):  # measurement and mask alike, so that they keep fitting each other
            measurement, mask = (F.pad(x, margin, mode="replicate") for x in (measurement, mask))
        estimates = self.decode_stages(measurement, mask)
        if not torch.compiler.is_compiling():  # where sizes are symbols
            self._check_estimates(estimates, (len(measurement), len(mask)), (height, width))
        # Under autocast a network may end in a lower precision; losses and metrics want that of the measurement.
        return [estimate[..., :height, :width].to(measurement.dtype).contiguous() for estimate in estimates]

    def _check_estimates(self, estimates: list[torch.Tensor], frames: tuple[int, int], size: tuple[int, int]) -> None:
        """Refuse what somebody else's decoder returned, if that is no video of N, T (``frames``) and H, W or more."""
        for estimate in estimates:
            given = tuple(estimate.shape) if isinstance(estimate, torch.Tensor) else ()
            if len(given) != 4 or given[:2] != frames or given[2] < size[0] or given[3] < size[1]:
                raise BadInput(
                    f"{type(self).__name__} returned {given or type(estimate).__name__}, expected a video "
                    f"{(*frames, *size)} (N, T, H, W): as many frames as the mask has slots, and its height and width"
                )

    @property
    def alignment(self) -> int:
        """Tiles begin at multiples of so many pixels, with and without their halo."""
        period = self.multiple if self.period is None else self.period
        return period if self.linear_estimator is None else math.lcm(period, self.linear_estimator.stride)

    @property
    def halo(self) -> int:
        """Pixels around a tile that are decoded with it: the receptive field, but no more than :data:`HALO`.

        Far fewer pixels than the receptive field has act noticeably: :meth:`in_tiles` measures that.
        """
        return HALO if self.receptive_field is None else min(self.receptive_field, HALO)

    def in_tiles(self, measurement: torch.Tensor, mask: torch.Tensor, tiling: Tiling) -> torch.Tensor:
        """Return the estimate ``(N, T, H, W)`` of the call to 0.01 dB, decoded tile by tile in little memory.

        Decoders with :attr:`global_steps` have no seams. Of others, what two neighbouring tiles say of the pixels at
        the seam between them is compared: where they differ by more than ``SEAM_TOLERANCE`` of
        :mod:`~sci_lightning.decoder.tiling.tiling`, decoding begins again with a halo of twice the width. In a lower
        precision each of the two rounds in its own way, which no halo changes: then they may differ by the root of the
        sum of that number's square and those of both roundings.

        Args:
            measurement, mask: as for the call.
            tiling: how the field is cut.

        Raises:
            BadInput: as for the call, a tile is smaller than the halo, or even :data:`WIDEST_HALO` is not enough.
        """
        measurement, mask = linear_with_mask(measurement, mask)
        if self.global_steps:
            self._tiling = tiling
            try:
                return self(measurement, mask)
            finally:
                self._tiling = None
        field, halo = math.inf if self.receptive_field is None else self.receptive_field, self.halo
        if self.linear_estimator is not None:
            field += self.linear_estimator.block
        tolerance = math.hypot(SEAM_TOLERANCE, 2**0.5 * self._rounding(measurement, mask)) if halo < field else None
        while True:
            try:
                return tiling.apply(self, halo, self.alignment, measurement, mask, seam_tolerance=tolerance)
            except SeamsDiffer as seam:
                if halo >= WIDEST_HALO:
                    raise BadInput(
                        f"{type(self).__name__} cannot be decoded in tiles here: neighbouring ones differ by "
                        f"{seam.difference:.2g} even with a halo of {halo} pixels; give tile=none"
                    ) from seam
                halo = int(min(2 * halo, field, WIDEST_HALO))
                tolerance = tolerance if halo < field else None
                size = tiling.size
                if size is not None and any(s < min(halo, f) for s, f in zip(size, mask.shape[-2:], strict=True)):
                    raise BadInput(
                        f"tile=[{size[0]},{size[1]}]: neighbouring tiles differ by {seam.difference:.2g} at their "
                        f"seams, and are smaller than the wider halo of {halo} pixels that would be tried next; give "
                        f"at least 'tile=[{halo},{halo}]', or tile=auto"
                    ) from seam

    def _rounding(self, measurement: torch.Tensor, mask: torch.Tensor) -> float:
        """Return how much a lower precision changes the estimate in the middle of the field, as a root mean square."""
        if measurement.is_meta or not torch.is_autocast_enabled(measurement.device.type):
            return 0.0
        top, left = (max(0, (side - ROUNDING_WINDOW) // 2) for side in mask.shape[1:])
        window = (..., slice(top, top + ROUNDING_WINDOW), slice(left, left + ROUNDING_WINDOW))
        measurement, mask = measurement[window], mask[window]
        rounded = self(measurement, mask)
        with full_precision():
            return float((self(measurement, mask) - rounded).square().mean().sqrt())

    def counted(self) -> Decoder:
        """Return a decoder with the same multiply-accumulates, which may leave out what has none."""
        return self

    def abridged(self) -> Decoder:
        """Return a decoder that needs as much memory in less time, by which :mod:`.tiling.memory` judges."""
        return self

    def kept_bytes(self, height: int, width: int) -> int:
        """Return the memory, whatever the number of snapshots, of what is prepared for a mask of H x W pixels."""
        return 0 if self.linear_estimator is None else self.linear_estimator.kept_bytes(height, width)

    def locally(
        self, function: Callable[..., torch.Tensor], halo: int, *images: torch.Tensor, reduced: int = 1
    ) -> torch.Tensor:
        """Return ``function(*images)``, computed in the tiles of :meth:`in_tiles`, if it has been called.

        Args:
            function: see :meth:`~sci_lightning.decoder.tiling.tiling.Tiling.apply`.
            halo: pixels, along rows and columns, over which images act on the result.
            images: images or videos ``(.., H, W)`` of the same H and W.
            reduced: resolution of the video over that of the images.
        """
        if self._tiling is None:
            return function(*images)
        return self._tiling.apply(function, halo, self.alignment, *images, reduced=reduced)

    def with_estimate(self, estimates: list[torch.Tensor], estimate: torch.Tensor) -> list[torch.Tensor]:
        """Return the list with one more estimate; in tiles only this one, as memory has no room for all stages."""
        return [*estimates, estimate] if self._tiling is None else [estimate]

    def decode_stages(self, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
        """Return the estimates of :meth:`stages`; the shapes have been checked and padded."""
        return [self.decode(measurement, mask)]

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return the estimate of a decoder that makes only one; the shapes have been checked and padded."""
        raise NotImplementedError

    def operator(self, mask: torch.Tensor) -> SnapshotOperator:
        """Return the snapshot operator of a mask ``(T, H, W)``, in the form that is fastest inside a network."""
        return SnapshotOperator(mask, slot_by_slot=not self.plain_formulas)


def check_levels(measurement: torch.Tensor, mask: torch.Tensor) -> None:
    """Refuse values that no measurement and mask have, and that a decoder would turn into nonsense without a word.

    Args:
        measurement: ``(N, H, W)``, the sum over t of M_t x_t.
        mask: M, ``(T, H, W)``.

    Raises:
        BadInput: integers; a mask beyond [0, 1]; more than :data:`BRIGHTEST_SUM` times the light of white frames.
    """
    if not measurement.is_floating_point():
        raise BadInput(
            f"the measurement is {measurement.dtype}: for DN give sci.Measurement(dn, full_scale=.., aperture=..)"
        )
    if measurement.numel() == 0 or mask.numel() == 0 or mask.ndim != 3:
        return
    least, most = (float(value) for value in torch.aminmax(mask.detach()))
    if not (least >= -MASK_ROUNDING and most <= 1 + MASK_ROUNDING):
        raise BadInput(
            f"the mask holds {least:.4g} to {most:.4g}, but a transmittance is 0 to 1: divide it by the value "
            "that lets all light pass"
        )
    white, brightest = float(mask.detach().sum(0).max()), float(measurement.detach().max())
    if brightest > BRIGHTEST_SUM * max(white, 1.0):
        raise BadInput(
            f"the measurement reaches {brightest:.4g}, white frames give at most {white:.4g}, the sum of the mask: "
            "for DN give sci.Measurement(dn, full_scale=.., aperture=..)"
        )
