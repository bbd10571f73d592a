"""The base class of all decoders: the call, and the check of its arguments."""

from __future__ import annotations

from typing import ClassVar, Literal, NamedTuple, TypeAlias

import torch
from torch import nn
from torch.nn import functional as F

from sci_lightning.decoder.kernels.switch import are_plain
from sci_lightning.errors import BadInput
from sci_lightning.imaging.operator import SnapshotOperator
from sci_lightning.imaging.patches import LinearEstimator

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

    The measurement ``(N, H, W)`` is the sum over t of M_t x_t, the mask M is ``(T, H, W)`` in [0, 1], and the video x
    is ``(N, T, H, W)``. A subclass implements :meth:`decode`, or :meth:`decode_stages` if it makes several estimates
    one after another. The shapes are checked before either is called.

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
    published_names: ClassVar[tuple[tuple[str, str], ...]] = ()
    """What the authors call our state-dict keys: (regular expression of our key, replacement to make it theirs).

    An expression has to match all of a key. Where several match, the authors' tensors are joined in this order.
    """
    published_unused: ClassVar[tuple[str, ...]] = ()
    """Regular expressions of published state-dict keys that are not used on purpose."""

    def __init__(self, first_estimate: FirstEstimate = "published") -> None:
        super().__init__()
        if first_estimate not in ("published", "linear"):
            raise BadInput(f"decoder.first_estimate={first_estimate}: choose published or linear")
        self.linear_estimator = LinearEstimator(mixture=False) if first_estimate == "linear" else None

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
        return FirstVideo(self.linear_estimator(measurement, mask), True)

    def forward(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return the estimated video ``(N, T, H, W)``, nominally in [0, 1], not clipped: the last of :meth:`stages`.

        Raises:
            BadInput: the shapes do not fit together, or the architecture cannot take them.
        """
        return self.stages(measurement, mask)[-1]

    def stages(self, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
        """Return all estimates of the video from first to last, ``(N, T, H, W)`` each, for losses that use them.

        Raises:
            BadInput: as for the call.
        """
        if measurement.ndim != 3 or mask.ndim != 3 or measurement.shape[1:] != mask.shape[1:]:
            raise BadInput(
                f"decoder called with measurement {tuple(measurement.shape)} and mask {tuple(mask.shape)}; "
                "it takes measurement (N, H, W) and mask (T, H, W) of the same H and W"
            )
        if self.frames is not None and len(mask) != self.frames:
            raise BadInput(f"this {type(self).__name__} was built for {self.frames} frames, the mask has {len(mask)}")
        height, width = mask.shape[1:]
        margin = (0, -width % self.multiple, 0, -height % self.multiple)
        if any(margin):  # measurement and mask alike, so that they keep fitting each other
            measurement, mask = (F.pad(x, margin, mode="replicate") for x in (measurement, mask))
        estimates = self.decode_stages(measurement, mask)
        # Under autocast a network may end in a lower precision; losses and metrics want that of the measurement.
        return [estimate[..., :height, :width].to(measurement.dtype).contiguous() for estimate in estimates]

    def decode_stages(self, measurement: torch.Tensor, mask: torch.Tensor) -> list[torch.Tensor]:
        """Return the estimates of :meth:`stages`; the shapes have been checked and padded."""
        return [self.decode(measurement, mask)]

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        """Return the estimate of a decoder that makes only one; the shapes have been checked and padded."""
        raise NotImplementedError

    @staticmethod
    def operator(mask: torch.Tensor) -> SnapshotOperator:
        """Return the snapshot operator of a mask ``(T, H, W)``, in the form that is fastest inside a network."""
        return SnapshotOperator(mask, slot_by_slot=not are_plain())
