"""The LightningModule that validates and tests encoder and decoder, scene by scene."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import lightning as L
import torch

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.tiling.tile_choice import TileChoice
from sci_lightning.encoder import Encoder
from sci_lightning.errors import BadInput
from sci_lightning.metrics import PSNR, SSIM
from sci_lightning.metrics.frame_metric import FrameMetric, as_frame_metric
from sci_lightning.pipeline import Pipeline
from sci_lightning.training.scoring import Scoring
from sci_lightning.training.step import seed_step

MEAN_MEASUREMENT = "val_mean_measurement"
"""Under this name validation logs what the mean measurement in every frame would reach, as a decoder must beat it."""


class ScoredPipeline(L.LightningModule):
    """Encoder and decoder as a Lightning trainer validates and tests them; it adds nothing to what they compute.

    For batches of validation and test see :func:`~sci_lightning.training.scoring.as_batch`. ``trainer.test`` returns
    mean scores as ``test/psnr`` and those of every scene as ``test_psnr/SCENE``.

    Args:
        encoder, decoder: plain modules, see :class:`~sci_lightning.pipeline.Pipeline`.
        camera: in a test, the encoder that the decoder believes in; None for ``encoder`` itself.
        metrics: metrics of validation and test, by name: ours, or any torchmetrics metric of two images, of which the
            mean over frames is taken. None for PSNR and, where frames are large enough, SSIM.
        val_every_n_frames: by metric: in validation the metric looks at one in so many frames; in a test at all.
        tile: in a test, how large fields are decoded, see :meth:`.Pipeline.decode`.
        seed: of the noise in a test, which does not depend on the training before it.
        name: under this name the scores of a test are logged.

    Raises:
        BadInput: a metric that is none or sees no frames.
    """

    def __init__(
        self,
        encoder: Encoder,
        decoder: Decoder,
        *,
        camera: Encoder | None = None,
        metrics: Mapping[str, Any] | None = None,
        val_every_n_frames: Mapping[str, int] | None = None,
        tile: TileChoice | str = "none",
        seed: int = 0,
        name: str = "test",
    ) -> None:
        super().__init__()
        self.encoder = encoder
        self.decoder = decoder
        self._camera = camera
        if metrics is None:
            metrics = {"psnr": PSNR()} | ({"ssim": SSIM()} if min(encoder.size) >= SSIM.smallest else {})
        self.metrics = {key: as_frame_metric(key, metric) for key, metric in metrics.items()}
        self.val_every_n_frames = val_every_n_frames or {}
        if none := [key for key, n in self.val_every_n_frames.items() if n < 1]:
            raise BadInput(
                f"system.val_every_n_frames.{none[0]} must be at least 1; metrics.{none[0]}=null leaves it out"
            )
        self.tile = tile
        self.seed = seed
        self.test_name = name
        self.scoring: Scoring | None = None
        self.tested: dict[str, Any] = {}
        """Results of the last test: metrics by scene, mean, conventions, the baseline's mean, seconds and device."""

    @cached_property
    def pipeline(self) -> Pipeline:
        """Encoder, decoder and camera model as one plain module.

        As a cached property it is no submodule: parameters stand in checkpoints once, as ``encoder.*`` and
        ``decoder.*``.
        """
        return Pipeline(self.encoder, self.decoder, self._camera)

    def behind(self, encoder: Encoder, metrics: Mapping[str, FrameMetric], name: str) -> ScoredPipeline:
        """Return the same decoder behind another encoder, whose scores are logged as ``test_NAME``.

        If both masks are of the same kind, the other encoder's mask gets the values of this one's.
        """
        if type(encoder.mask) is type(self.encoder.mask):
            encoder.mask.load_state_dict(self.encoder.mask.state_dict())
        return ScoredPipeline(encoder, self.decoder, metrics=metrics, seed=self.seed, name=f"test_{name}")

    def forward(
        self, video: torch.Tensor, mask: torch.Tensor | None = None, origin: tuple[int, int] = (0, 0)
    ) -> torch.Tensor:
        """Record a video ``(N, T, H, W)`` and reconstruct it, see :meth:`.Pipeline.forward`."""
        return self.pipeline(video, mask, origin)

    def on_validation_epoch_start(self) -> None:
        baseline = {key: metric for key, metric in self.metrics.items() if key == "psnr"}
        self.scoring = Scoring(
            self.trainer.val_dataloaders, self.metrics, baseline, self.val_every_n_frames, self.device
        )

    def on_test_epoch_start(self) -> None:
        self.scoring = Scoring(self.trainer.test_dataloaders, self.metrics, self.metrics, None, self.device)

    def validation_step(self, batch: Any, batch_idx: int) -> None:
        self.test_step(batch, batch_idx)

    def test_step(self, batch: Any, batch_idx: int) -> dict[str, torch.Tensor]:
        """Add a batch to the scores; return what :meth:`.Scoring.add` returns."""
        seed_step(self.seed, batch_idx, self.global_rank, self.device, testing=True)
        assert self.scoring is not None  # Lightning calls on_test_epoch_start first
        return self.scoring.add(batch, self.pipeline, self.tile)

    def on_test_epoch_end(self) -> None:
        self.tested = self._log_scores(self.test_name)

    def on_validation_epoch_end(self) -> None:
        for key, value in self._log_scores("val")["baseline"].items():
            self.log(f"{MEAN_MEASUREMENT}/{key}", value, sync_dist=True)

    def _log_scores(self, name: str) -> dict[str, Any]:
        assert self.scoring is not None
        values, results = self.scoring.logged(name)
        for key, value in values.items():
            self.log(key, value, prog_bar=key == "val/psnr", sync_dist=True)
        return results
