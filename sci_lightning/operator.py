r"""The snapshot operator: what a camera of perfect optics and sensor does to a video, and the steps back from there.

The encoder records with it, decoders take their data steps with it, and the diagnosis predicts captures with it; the
sum of mask times frame is written nowhere else. The virtual camera is the exception: it is an independent second
implementation that the first one is checked against.
"""

from __future__ import annotations

import torch
from torch.nn import functional as F

from sci_lightning.measurement import Measurement


class SnapshotOperator:
    r"""The linear operator A of video snapshot compressive imaging, for binary and gray masks.

    .. math::
        y = A x = \sum_{t=1}^{T} M_t \odot x_t, \qquad
        (A^\top y)_t = M_t \odot y, \qquad
        A A^\top = \mathrm{diag}\Big(\sum_t M_t^2\Big) = R

    As :math:`A A^\top` is diagonal, the pseudo-inverse and the projection onto all videos that explain a measurement
    have closed forms. A pixel at which no slot opens (R = 0) tells nothing about the video: every division by R, or by
    the sum of the masks, divides by 1 there, so that the video stays as it was.

    Args:
        mask: M, transmittance ``(T, qH, qW)`` in [0, 1].
        cells: q; the mask is given on q x q cells per pixel of the video, and so is the image that comes out.
        slot_by_slot: add one product after another, which needs no memory of the video's size and is the fastest way
            inside a network. The result may differ from the plain sum in the last bit of a float.

    Source: "Deep Optics for Video Snapshot Compressive Imaging" (ICCV 2023), Eq. 1.

    Example:
        >>> import torch
        >>> import sci_lightning as sci
        >>> operator = sci.SnapshotOperator(torch.tensor([[[1.0]], [[0.5]]]))  # T = 2 slots, one pixel
        >>> measurement = operator(torch.tensor([[[[0.2]], [[0.4]]]]))
        >>> round(float(measurement), 6)
        0.4
        >>> estimate = operator.pseudo_inverse(measurement)
        >>> bool(torch.isclose(operator(estimate), measurement))
        True
    """

    def __init__(self, mask: torch.Tensor, cells: int = 1, slot_by_slot: bool = False) -> None:
        self.mask = mask
        self.cells = cells
        self.slot_by_slot = slot_by_slot

    def __call__(self, video: torch.Tensor) -> torch.Tensor:
        """Return the measurement ``A x``, ``(N, qH, qW)``, of a video x ``(N, T, H, W)``."""
        video = self.on_cells(video)
        if not self.slot_by_slot:
            return (video * self.mask).sum(1)
        first, *others = zip(self.mask, video.unbind(1), strict=True)
        total = torch.mul(*first)
        for slot, frame in others:
            total = torch.addcmul(total, slot, frame)
        return total

    def static_scene(self, frame: torch.Tensor, total: torch.Tensor | None = None) -> torch.Tensor:
        """Return the measurement ``(N, qH, qW)`` of a scene at rest: one frame ``(N, H, W)`` in all T slots.

        Args:
            frame: ``(N, H, W)``.
            total: the result of :meth:`total`, for callers that need it for several scenes; None computes it.
        """
        return (self.total() if total is None else total) * self.on_cells(frame)

    def uniform_scene(self, levels: torch.Tensor) -> torch.Tensor:
        """Return measurements ``(.., qH, qW)`` of frames without structure, of one brightness each, ``(.., T)``."""
        return torch.tensordot(levels, self.mask, 1)

    def adjoint(self, measurement: torch.Tensor) -> torch.Tensor:
        """Return ``A^T y``, ``(N, T, H, W)``: the measurement y ``(N, H, W)`` times the mask of every slot."""
        return self.mask * _linear(measurement).unsqueeze(1)

    def pseudo_inverse(self, measurement: torch.Tensor) -> torch.Tensor:
        """Return ``A^T R^-1 y``, ``(N, T, H, W)``: the video of least norm that explains y ``(N, H, W)``."""
        return self.mask / self.sum_of_squares() * _linear(measurement).unsqueeze(1)

    def project(self, video: torch.Tensor, measurement: torch.Tensor) -> torch.Tensor:
        """Return the video nearest to ``video`` that explains the measurement: :meth:`data_step` with R as weight."""
        return self.data_step(video, measurement, self.sum_of_squares())

    def data_step(
        self,
        video: torch.Tensor,
        measurement: torch.Tensor,
        weight: torch.Tensor,
        out: torch.Tensor | None = None,
    ) -> torch.Tensor:
        r"""Return :math:`x + A^\top \big((y - A x) / w\big)`, the data-consistency step of iterative decoders.

        With w = R (:meth:`sum_of_squares`) it is the projection of generalised alternating projection (GAP). With
        w = R + gamma it is the minimum over z of :math:`|y - A z|^2 + \gamma |z - x|^2` (ADMM, half-quadratic
        splitting). Several published networks take the sum of the masks for w (:meth:`total_or_one`), which is the same
        for binary masks and a shorter step for gray ones.

        Args:
            video: x, ``(N, T, H, W)``.
            measurement: y, ``(N, H, W)``.
            weight: w, ``(H, W)``, positive.
            out: where the result goes, which may be ``video`` itself; None: new memory. Without gradients only.

        Source: Liao, Li and Carin, "Generalized alternating projection for weighted-l2,1 minimization with
        applications to model-based compressive sensing", SIAM J. Imaging Sciences 2014.
        """
        residual = (_linear(measurement) - self(video)) / weight
        return torch.addcmul(video, self.mask, residual.unsqueeze(1), out=out)

    def mean_frame(self, measurement: torch.Tensor) -> torch.Tensor:
        """Return the frame ``(N, H, W)`` that a scene at rest would have: the measurement over the sum of the masks."""
        return _linear(measurement) / self.total_or_one()

    def mean_video(self, measurement: torch.Tensor) -> torch.Tensor:
        """Return :meth:`mean_frame` in every slot, ``(N, T, H, W)``: the baseline that any decoder must beat."""
        return self.mean_frame(measurement).unsqueeze(1).expand(-1, self.mask.shape[0], -1, -1)

    def total(self) -> torch.Tensor:
        """Return the sum of the masks over time, ``(qH, qW)``."""
        return self.mask.sum(0)

    def total_or_one(self) -> torch.Tensor:
        """Return :meth:`total` as a divisor: 1 where no slot opens."""
        return _or_one(self.total())

    def sum_of_squares(self) -> torch.Tensor:
        """Return R, the sum of the squared masks over time, ``(qH, qW)``, as a divisor: 1 where no slot opens."""
        return _or_one(self.mask.square().sum(0))

    def in_pixels(self) -> SnapshotOperator:
        """Return the operator on whole pixels, whose mask is the mean over the cells of each pixel."""
        if self.cells == 1:
            return self
        return SnapshotOperator(F.avg_pool2d(self.mask, self.cells), slot_by_slot=self.slot_by_slot)

    def on_cells(self, image: torch.Tensor) -> torch.Tensor:
        """Return an image or video ``(.., H, W)`` on the cells of the mask, ``(.., qH, qW)``."""
        if self.cells == 1:
            return image
        height, width, cells = *image.shape[-2:], self.cells
        apart = image[..., :, None, :, None].expand(*image.shape[:-2], height, cells, width, cells)
        return apart.flatten(-4, -3).flatten(-2, -1)


def _or_one(divisor: torch.Tensor) -> torch.Tensor:
    return torch.where(divisor == 0, torch.ones_like(divisor), divisor)


def _linear(measurement: torch.Tensor) -> torch.Tensor:
    return measurement.linear() if isinstance(measurement, Measurement) else measurement
