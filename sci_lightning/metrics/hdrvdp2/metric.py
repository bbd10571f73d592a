"""The Q-Score as a torchmetrics metric."""

from __future__ import annotations

import torch

from sci_lightning.metrics.frame_metric import FrameMetric
from sci_lightning.metrics.hdrvdp2.quality import check_convention, hdrvdp2_q
from sci_lightning.metrics.hdrvdp2.steerable_pyramid import SMALLEST


class HDRVDP2(FrameMetric):
    """The mean over frames of :func:`hdrvdp2_q`.

    Args:
        encoding, pixels_per_degree, dtype: see :func:`hdrvdp2_q`.
        clip_negative: whether estimates below 0 count as 0, as on a display; otherwise they are refused.

    Raises:
        BadInput: unknown encoding or impossible resolution; in ``update``, what :func:`hdrvdp2_q` refuses.

    Example:
        >>> truth = torch.linspace(0, 1, 8 * 32 * 32).reshape(8, 32, 32)
        >>> metric = HDRVDP2()
        >>> metric.update(0.9 * truth, truth)
        >>> print(f"{metric.compute():.2f}")
        89.58
    """

    smallest = SMALLEST
    plot_upper_bound = 100.0

    def __init__(
        self,
        encoding: str = "luma-display",
        pixels_per_degree: float = 30.0,
        *,
        clip_negative: bool = False,
        dtype: torch.dtype = torch.float64,
    ) -> None:
        super().__init__()
        check_convention(encoding, pixels_per_degree)
        self.encoding = encoding
        self.pixels_per_degree = pixels_per_degree
        self.clip_negative = clip_negative
        self.computed_in = dtype
        self.convention = (
            f"Q of HDR-VDP-2.2.2, {encoding}, {pixels_per_degree:g} pixels per degree, per frame, mean over frames, "
            f"then over scenes{'; estimates below 0 count as 0' if clip_negative else ''}"
        )

    def score(self, estimate: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        """Return Q of every frame, ``(N,)``.

        Args:
            estimate, truth: ``(..., H, W)``, or with four axes or more ``(..., 3, H, W)`` for ``sRGB-display``.
        """
        if self.clip_negative:
            estimate = estimate.clamp(min=0)
        colour = self.encoding == "sRGB-display" and truth.dim() > 3
        test, reference = (x.reshape(-1, *x.shape[-3 if colour else -2 :]) for x in (estimate, truth))
        return hdrvdp2_q(
            test,
            reference,
            encoding=self.encoding,
            pixels_per_degree=self.pixels_per_degree,
            dtype=self.computed_in,
        )
