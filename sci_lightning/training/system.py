"""The LightningModule: encoder, decoder and loss, trained together."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import lightning as L
import numpy as np
import torch

from sci_lightning.configuration.bounds import NonNegative, Positive, Seed, Share
from sci_lightning.decoder.decoder import Decoder
from sci_lightning.encoder import Encoder
from sci_lightning.errors import BadInput, TrainingDiverged
from sci_lightning.imaging.operator import SnapshotOperator
from sci_lightning.imaging.pipeline import Pipeline
from sci_lightning.imaging.tile_choice import TileChoice
from sci_lightning.metrics.frame_metric import FrameMetric
from sci_lightning.metrics.scene_scores import SceneScores
from sci_lightning.runs.device import device_name
from sci_lightning.training.cuda_graph import GraphedStages
from sci_lightning.training.loss import LOSSES
from sci_lightning.training.muon import Muon, is_large
from sci_lightning.training.processor_time import time_limits
from sci_lightning.training.quiet_libraries import silence_libraries
from sci_lightning.training.training_position import TrainingPosition

Batch = tuple[torch.Tensor, ...]

MEAN_MEASUREMENT = "val_mean_measurement"
"""Under this name validation logs what the mean measurement in every frame would reach, as a decoder must beat it."""


class System(L.LightningModule):
    """Trains a decoder and, if its mask has parameters, the encoder.

    If the clips are smaller than the mask, every training batch is recorded with a random window of the mask. Every
    step seeds torch with (seed, step, process), so that noise and windows do not depend on what ran before: a resumed
    run repeats them.

    Args:
        encoder, decoder: plain modules; the system adds nothing to what they compute, see :class:`Pipeline`.
        camera: in a test, the encoder that the decoder believes in; None for ``encoder`` itself.
        metrics: metrics of validation and test, by name.
        val_every_n_frames: by metric: in validation the metric looks at one in so many frames; in a test at all.
        loss: ``mse``, ``rmse`` or ``frame_rmse``.
        stage_weights: weights of the losses of the decoder's last stages, in their order; the loss is the weighted sum.
            ``(1,)`` takes the final estimate alone. Unfolding networks have many stages, most decoders one.
        lr: learning rate of Adam at the start. It falls to ``final_lr`` along a cosine over the whole run, which ends
            after its steps, after the trainer's ``max_time`` or its :class:`ProcessorTime`, whichever comes first.
        mask_lr: learning rate of the mask at the start (same cosine); None for ``lr``.
        muon_lr: learning rate at the start (same cosine) of :class:`~sci_lightning.training.muon.Muon`, which then
            trains the decoder's large weights in Adam's place; None for Adam alone.
        muon_decay: by which part of its learning rate Muon shrinks those weights in every step.
        warmup: part of the run, 0 to below 1, in which all learning rates rise from 0.
        compile: compile the decoder with ``torch.compile``.
        cuda_graph: replay the decoder's part of a step, see :class:`~sci_lightning.training.cuda_graph.GraphedStages`.
        tile: in a test, how large fields are decoded, see :meth:`Pipeline.decode`.
        seed: seed of everything random in a step.
        run_config: the run's plain, resolved configuration; kept in every checkpoint so that the run can be rebuilt.

    Raises:
        BadInput: unknown loss, bad weights, a metric that sees no frames; in training, more weights than stages.
        TrainingDiverged: in training, a loss or gradient that is no longer finite.
    """

    def __init__(
        self,
        encoder: Encoder,
        decoder: Decoder,
        *,
        camera: Encoder | None = None,
        metrics: Mapping[str, FrameMetric] | None = None,
        val_every_n_frames: Mapping[str, int] | None = None,
        loss: str = "mse",
        stage_weights: Sequence[Positive] = (1.0,),
        lr: Positive = 1e-4,
        final_lr: NonNegative = 1e-5,
        mask_lr: NonNegative | None = None,
        muon_lr: Positive | None = None,
        muon_decay: NonNegative = 0.0,
        warmup: Share = 0.0,
        compile: bool = False,
        cuda_graph: bool = False,
        tile: TileChoice | str = "none",
        seed: Seed = 0,
        run_config: dict[str, Any] | None = None,
    ) -> None:
        super().__init__()
        silence_libraries()
        if loss not in LOSSES:
            raise BadInput(f"system.loss={loss}: no such loss; choose one of {', '.join(LOSSES)}")
        if none := [key for key, n in (val_every_n_frames or {}).items() if n < 1]:
            raise BadInput(
                f"system.val_every_n_frames.{none[0]} must be at least 1; metrics.{none[0]}=null leaves it out"
            )
        if not stage_weights or min(stage_weights) <= 0:
            raise BadInput(f"system.stage_weights={list(stage_weights)}: give one or more positive numbers, as [0.5,1]")
        if not 0 <= warmup < 1:
            raise BadInput(f"system.warmup={warmup}: a part of the run, from 0 to below 1, as in 0.02")
        self.encoder = encoder
        self.decoder = decoder
        self._camera = camera
        self.loss = LOSSES[loss]
        self.stage_weights = tuple(stage_weights)
        self.stages = torch.compile(decoder.stages) if compile else decoder.stages
        if cuda_graph:
            self.stages = GraphedStages(decoder)
        self.lr, self.final_lr, self.mask_lr = lr, final_lr, lr if mask_lr is None else mask_lr
        self.muon_lr, self.muon_decay, self.warmup = muon_lr, muon_decay, warmup
        self.tile = tile
        self.seed = seed
        self.run_config = run_config or {}
        self.metrics = dict(metrics or {})
        self.val_every_n_frames = dict(val_every_n_frames or {})
        self.scores = self.baseline = SceneScores([], self.metrics)
        self.seconds: list[float] = []
        self.tested: dict[str, Any] = {}
        """Results of the last test: metrics by scene, mean, conventions, the baseline's mean, seconds and device."""
        self.validated = True
        """False from the start of a training batch until the validation that may follow it is over."""
        if compile:
            self.decoder.compile()

    @property
    def pipeline(self) -> Pipeline:
        """Encoder, decoder and camera model as one plain module.

        It is made anew and not kept, so that parameters stand in checkpoints once: as ``encoder.*`` and ``decoder.*``.
        """
        return Pipeline(self.encoder, self.decoder, self._camera)

    def with_encoder(self, encoder: Encoder, metrics: Mapping[str, FrameMetric]) -> System:
        """Return a system that tests the same decoder behind another encoder.

        If both masks are of the same kind, the other encoder's mask gets the values of this one's.
        """
        if type(encoder.mask) is type(self.encoder.mask):
            encoder.mask.load_state_dict(self.encoder.mask.state_dict())
        return System(encoder, self.decoder, metrics=metrics, seed=self.seed)

    def forward(
        self, video: torch.Tensor, mask: torch.Tensor | None = None, origin: tuple[int, int] = (0, 0)
    ) -> torch.Tensor:
        """Record a video ``(N, T, H, W)`` and reconstruct it, see :meth:`Pipeline.forward`."""
        return self.pipeline(video, mask, origin)

    # Training

    def configure_optimizers(self) -> Any:
        mask = [p for p in self.encoder.parameters() if p.requires_grad]
        weights = list(self.decoder.parameters())
        large = [weight for weight in weights if self.muon_lr is not None and is_large(weight)]
        small = [weight for weight in weights if self.muon_lr is None or not is_large(weight)]
        groups: list[dict[str, Any]] = [{"params": small, "lr": self.lr, "name": "decoder"}]
        if mask:
            groups.append({"params": mask, "lr": self.mask_lr, "name": "mask"})
        if large:
            groups.append({"params": large, "lr": self.muon_lr, "name": "large weights", "muon": True})
        # the fused one is twice as fast and differs in the last bits; scaled gradients of float16 it would not clip
        kind = partial(Muon, decay=self.muon_decay) if large else torch.optim.Adam
        fused = self._trainer is not None and self.trainer.precision == "bf16-mixed"
        optimizer = kind(groups, fused=fused)
        floor = self.final_lr / self.lr

        def schedule(step: int) -> float:
            if step == 0:  # asking for the number of steps now would set up the loader before its place is restored
                return 0.01 if self.warmup else 1.0
            done = self.part_done(step)
            if done < self.warmup:
                return max(0.01, done / self.warmup)
            done = (done - self.warmup) / (1 - self.warmup)
            return floor + (1 - floor) * (1 + math.cos(math.pi * done)) / 2

        scheduler = torch.optim.lr_scheduler.LambdaLR(optimizer, schedule)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": scheduler, "interval": "step"}}

    def rates(self) -> str:
        """Return the decoder's learning rates as words for a message: ``system.lr (it is 0.002)``."""
        rates = {"system.lr": self.lr, "system.muon_lr": self.muon_lr}
        return " and ".join(f"{name} (it is {rate:g})" for name, rate in rates.items() if rate is not None)

    def part_done(self, step: int | None = None) -> float:
        """Return the part of the run, 0 to 1, that is over after a step (None: now); 0 in a run without end."""
        steps = self.global_step if step is None else step
        return min(1.0, max(self._time_spent(), steps / self.trainer.estimated_stepping_batches))

    def _time_spent(self) -> float:
        """Return the part of ``max_time`` or of the processor time that has passed, 0 to 1; 0 in a run without one."""
        budget, timer = time_limits(self.trainer)
        if budget is None and timer is None:
            return 0.0
        spent = 0.0 if budget is None else budget.part_spent
        if timer is not None:
            elapsed = timer.time_elapsed()
            spent = max(spent, elapsed / max(elapsed + (timer.time_remaining() or 0.0), 1e-6))
        return float(self.trainer.strategy.broadcast(spent))  # clocks differ, learning rates may not

    def on_train_batch_start(self, batch: torch.Tensor, batch_idx: int) -> None:
        self.validated = False
        self._seed_step(self.trainer.fit_loop.total_batch_idx)

    def training_step(self, video: torch.Tensor, batch_idx: int) -> torch.Tensor:
        return self.logged(self.batch_loss(video))

    def batch_loss(self, video: torch.Tensor) -> torch.Tensor:
        """Record a batch of clips ``(N, T, h, w)`` behind a random window of the mask, decode it, return the loss."""
        return self.stage_loss(self.stages(*self.recorded(video)), video)

    def recorded(self, video: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return what the decoder gets of clips ``(N, T, h, w)``: measurements and the window of the mask."""
        mask, origin = self._window(*video.shape[-2:])
        pipeline = self.pipeline
        linear = pipeline.linearise(pipeline.record(video, mask, origin), origin=origin)
        return linear, pipeline.decoder_mask(mask)

    def logged(self, loss: torch.Tensor) -> torch.Tensor:
        """Return the loss of a batch, after it was logged if this step is one of those that are."""
        self._loss = loss.detach()
        if self._is_logged():
            self.log("train/loss", self._loss, prog_bar=True)
        return loss

    def _is_logged(self) -> bool:
        """Return whether this step's numbers are logged: in every so many steps, and at both ends of an epoch."""
        if self._trainer is None:
            return False
        loop = self.trainer.fit_loop.epoch_loop
        every = self.trainer.log_every_n_steps  # type: ignore[attr-defined]  # set by Lightning, not declared
        due = every > 0 and (loop._batches_that_stepped + 1) % every == 0
        return due or loop.batch_progress.is_last_batch or loop.batch_idx == 0

    def stage_loss(self, stages: Sequence[torch.Tensor], video: torch.Tensor) -> torch.Tensor:
        """Return the weighted sum of the losses of the last stages."""
        weights = self.stage_weights
        if len(weights) > len(stages):
            raise BadInput(
                f"system.stage_weights={list(weights)}: {len(weights)} weights, but this decoder estimates in "
                f"{len(stages)} stage{'s' * (len(stages) > 1)}; give at most as many"
            )
        losses = [self.loss(stage, video) for stage in stages[-len(weights) :]]
        return torch.stack([weight * loss for weight, loss in zip(weights, losses, strict=True)]).sum()

    def configure_gradient_clipping(
        self,
        optimizer: torch.optim.Optimizer,
        gradient_clip_val: float | None = None,
        gradient_clip_algorithm: str | None = None,
    ) -> None:
        """Check, log and clip the gradients; their norm is computed once, and the device is waited for once.

        Raises:
            TrainingDiverged: the loss or the norm is not finite.
        """
        parameters = [p for group in optimizer.param_groups for p in group["params"] if p.grad is not None]
        norm = torch.nn.utils.get_total_norm([p.grad for p in parameters])
        # under float16 scaling an overflowing gradient is expected: the scaler skips that step by itself
        if self.trainer.precision != "16-mixed" and not torch.isfinite(norm + self._loss):
            raise self._diverged(norm)
        if self._is_logged():
            self.log("train/gradient_norm", norm)
            self.log("train/lr", optimizer.param_groups[0]["lr"])
        if gradient_clip_algorithm == "value":
            self.clip_gradients(optimizer, gradient_clip_val, gradient_clip_algorithm)
        elif gradient_clip_val:
            torch.nn.utils.clip_grads_with_norm_(parameters, gradient_clip_val, norm)

    def on_train_epoch_end(self) -> None:
        self.validated = True

    def optimizer_step(self, *args: Any, **kwargs: Any) -> None:
        super().optimizer_step(*args, **kwargs)
        self.encoder.mask.project_()  # here, not at the batch's end, where a checkpoint may already have been written

    def _window(self, height: int, width: int) -> tuple[torch.Tensor, tuple[int, int]]:
        """Return a random window of the mask, of the clip's size, and its origin; ``record`` refuses larger clips."""
        top, left = (
            int(torch.randint(max(1, full - part + 1), ()))
            for full, part in zip(self.encoder.size, (height, width), strict=True)
        )
        return self.encoder.transmittance_window(top, left, height, width), (top, left)

    def _seed_step(self, step: int, testing: bool = False) -> None:
        # torch's generator of a CPU keeps 32 bits of a seed: all parts must be mixed into each bit
        parts = np.random.SeedSequence((self.seed, int(testing), step, self.global_rank))
        seed = int(parts.generate_state(1, np.uint64)[0])
        if self.device.type == "cpu":
            torch.default_generator.manual_seed(seed)  # torch.manual_seed prints a stack for every other kind of device
        else:
            torch.manual_seed(seed)

    def _diverged(self, norm: torch.Tensor) -> TrainingDiverged:
        loss = float(self._loss)
        what = f"the gradient's norm became {float(norm)}" if math.isfinite(loss) else f"the loss became {loss}"
        return TrainingDiverged(
            f"{what} at epoch {self.current_epoch}, batch {self.trainer.fit_loop.batch_idx} (step {self.global_step}): "
            f"stopped; give a smaller {self.rates()} or check the data; "
            "the checkpoints hold the last good (finite) state"
        )

    # Validation and test. A batch is (scene numbers, videos), of real captures also (measurements, apertures).

    def on_validation_epoch_start(self) -> None:
        self.scores = self._scores(self.trainer.val_dataloaders, self.val_every_n_frames)
        psnr = {key: metric for key, metric in self.metrics.items() if key == "psnr"}
        self.baseline = SceneScores(self.scores.names, psnr).to(self.device)

    def on_test_epoch_start(self) -> None:
        self.scores, self.baseline = (self._scores(self.trainer.test_dataloaders) for _ in range(2))
        self.seconds = []

    def validation_step(self, batch: Batch, batch_idx: int) -> None:
        _, linear, mask, _ = self._score(batch, batch_idx)
        self._score_baseline(batch, linear, mask)

    def test_step(self, batch: Batch, batch_idx: int) -> dict[str, torch.Tensor]:
        """Add a batch to the scores; return its ``measurement`` (N, H, W) as recorded and ``estimate`` (N, T, H, W)."""
        recorded, linear, mask, estimate = self._score(batch, batch_idx)
        self._score_baseline(batch, linear, mask)
        return {"measurement": recorded, "estimate": estimate}

    def on_test_epoch_end(self) -> None:
        scenes, mean = self.scores.compute()
        self.tested = {
            "scenes": scenes,
            "mean": mean,
            "conventions": {key: metric.convention for key, metric in self.metrics.items() if metric.convention},
            "baseline": self.baseline.compute()[1],
            "seconds_per_measurement": statistics.median(self.seconds),
            "device": device_name(self.device),
        }

    def on_validation_epoch_end(self) -> None:
        self.validated = True
        scenes, mean = self.scores.compute()
        for key, value in mean.items():
            self.log(f"val/{key}", value, prog_bar=key == "psnr", sync_dist=True)
        per_scene = {f"val_{key}/{name}": value for name, scene in scenes.items() for key, value in scene.items()}
        self.log_dict(per_scene, sync_dist=True)
        for key, value in self.baseline.compute()[1].items():
            self.log(f"{MEAN_MEASUREMENT}/{key}", value, sync_dist=True)

    def _scores(self, loader: Any, every_n_frames: Mapping[str, int] | None = None) -> SceneScores:
        return SceneScores(loader.dataset.names, self.metrics, every_n_frames).to(self.device)

    def _score(self, batch: Batch, batch_idx: int) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """Add a batch to the scores.

        Returns:
            The measurement as recorded; the linearised measurement, the mask and the estimate of the decoder.
        """
        self._seed_step(batch_idx, testing=True)  # sensor noise in a test does not depend on the training before it
        pipeline = self.pipeline
        scenes, video, *taken = batch
        recorded, aperture = taken if taken else (pipeline.record(video), None)
        linear, mask = pipeline.linearise(recorded, aperture), pipeline.decoder_mask()
        start = self._now()
        estimate = pipeline.decode(linear, mask, self.tile)
        self.seconds.append((self._now() - start) / len(video))
        for scene, x, truth in zip(scenes, estimate, video, strict=True):
            self.scores.update(int(scene), x, truth)
        return recorded, linear, mask, estimate

    def _score_baseline(self, batch: Batch, linear: torch.Tensor, mask: torch.Tensor) -> None:
        """Add the estimate in which every frame is the mean measurement to the baseline's scores."""
        for scene, mean, truth in zip(batch[0], SnapshotOperator(mask).mean_video(linear), batch[1], strict=True):
            self.baseline.update(int(scene), mean, truth)

    def _now(self) -> float:
        if self.device.type == "cuda":
            torch.cuda.synchronize(self.device)
        return time.perf_counter()

    # Checkpoints

    @classmethod
    def load_from_checkpoint(cls, checkpoint_path: Any, *args: Any, **kwargs: Any) -> System:
        """Build a system around the encoder and decoder of a checkpoint of this project; nothing in it is executed.

        Args:
            checkpoint_path: RUN/checkpoints/last.ckpt.
            args, kwargs: Lightning's further arguments, which are ignored: the checkpoint holds the configuration.

        Raises:
            BadInput: the file is missing, damaged or not a checkpoint of this project.
        """
        from sci_lightning.runs.checkpoint import read_checkpoint  # which needs Lightning's file access, as this does

        checkpoint = read_checkpoint(checkpoint_path)
        return cls(checkpoint.encoder(), checkpoint.decoder(), run_config=checkpoint.config)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        checkpoint["config"] = self.run_config
        checkpoint["position"] = TrainingPosition.of(self.trainer, self.validated).state()
        del checkpoint["loops"]  # follows from the position
