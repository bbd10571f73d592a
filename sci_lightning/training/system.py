"""The LightningModule: encoder, decoder and loss, trained together."""

from __future__ import annotations

import inspect
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import lightning as L
import torch

from sci_lightning.configuration.bounds import NonNegative, Positive, Seed, Share
from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.tiling.tile_choice import TileChoice
from sci_lightning.encoder import Encoder
from sci_lightning.errors import BadInput
from sci_lightning.measurement import linear_with_mask
from sci_lightning.metrics import PSNR, SSIM
from sci_lightning.metrics.frame_metric import FrameMetric, as_frame_metric
from sci_lightning.pipeline import Pipeline
from sci_lightning.runs.quiet_libraries import silence_libraries
from sci_lightning.training.cuda_graph import GraphedStages
from sci_lightning.training.gradients import gradient_norm, seed_step
from sci_lightning.training.learning_rates import LearningRates, part_done
from sci_lightning.training.loss import StageLoss
from sci_lightning.training.scoring import Scoring, as_clips
from sci_lightning.training.training_position import TrainingPosition

MEAN_MEASUREMENT = "val_mean_measurement"
"""Under this name validation logs what the mean measurement in every frame would reach, as a decoder must beat it."""


class System(L.LightningModule):
    """Trains a decoder and, if its mask has parameters, the encoder.

    If the clips are smaller than the mask, every training batch is recorded with a random window of the mask. Every
    step seeds torch with (seed, step, process), so that noise and windows do not depend on what ran before: a resumed
    run repeats them.

    A training batch is a tensor of clips ``(N, T, h, w)``; for batches of validation and test see
    :func:`~sci_lightning.training.scoring.as_batch`. ``trainer.test`` returns mean scores as ``test/psnr`` and those of
    every scene as ``test_psnr/SCENE``. ``hparams`` hold the settings, from ``val_every_n_frames`` to ``seed``.

    Args:
        encoder, decoder: plain modules; the system adds nothing to what they compute, see :class:`Pipeline`.
        camera: in a test, the encoder that the decoder believes in; None for ``encoder`` itself.
        metrics: metrics of validation and test, by name: ours, or any torchmetrics metric of two images, of which the
            mean over frames is taken. None for PSNR and, where frames are large enough, SSIM.
        val_every_n_frames: by metric: in validation the metric looks at one in so many frames; in a test at all.
        loss: ``mse``, ``rmse`` or ``frame_rmse``.
        stage_weights: weights of the losses of the decoder's last stages, in their order; the loss is the weighted sum.
            ``(1,)`` takes the final estimate alone. Unfolding networks have many stages, most decoders one.
        lr, final_lr, mask_lr, muon_lr, muon_decay, warmup: see
            :class:`~sci_lightning.training.learning_rates.LearningRates`.
        compile: compile the decoder with ``torch.compile``.
        cuda_graph: replay the decoder's part of a step, see :class:`~sci_lightning.training.cuda_graph.GraphedStages`.
        tile: in a test, how large fields are decoded, see :meth:`Pipeline.decode`.
        seed: seed of everything random in a step.
        run_config: the run's plain, resolved configuration; kept in every checkpoint so that the run can be rebuilt.

    Raises:
        BadInput: unknown loss, bad weights, a metric that is none or sees no frames; in training, more weights than
            stages, or batches that are no clips.
        TrainingDiverged: in training, a loss or gradient that is no longer finite.
    """

    def __init__(
        self,
        encoder: Encoder,
        decoder: Decoder,
        *,
        camera: Encoder | None = None,
        metrics: Mapping[str, Any] | None = None,
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
        stage_weights, val_every_n_frames = tuple(stage_weights), dict(val_every_n_frames or {})  # plain, to be saved
        self.save_hyperparameters(ignore=["encoder", "decoder", "camera", "metrics", "tile", "run_config"])
        silence_libraries()
        if none := [key for key, n in val_every_n_frames.items() if n < 1]:
            raise BadInput(
                f"system.val_every_n_frames.{none[0]} must be at least 1; metrics.{none[0]}=null leaves it out"
            )
        if not 0 <= warmup < 1:
            raise BadInput(f"system.warmup={warmup}: a part of the run, from 0 to below 1, as in 0.02")
        self.encoder = encoder
        self.decoder = decoder
        self._camera = camera
        self.loss = StageLoss(loss, stage_weights)
        if compile and cuda_graph:
            raise BadInput("system.compile=true system.cuda_graph=true: compiled stages cannot be replayed; choose one")
        self.stages = (
            torch.compile(decoder.stages) if compile else GraphedStages(decoder) if cuda_graph else decoder.stages
        )
        self.rates = LearningRates(lr, final_lr, mask_lr, muon_lr, muon_decay, warmup)
        self.tile = tile
        self.seed = seed
        self.run_config = run_config or {}
        if metrics is None:
            metrics = {"psnr": PSNR()} | ({"ssim": SSIM()} if min(encoder.size) >= SSIM.smallest else {})
        self.metrics = {key: as_frame_metric(key, metric) for key, metric in metrics.items()}
        self.val_every_n_frames = val_every_n_frames
        self.scoring: Scoring | None = None
        self.test_name = "test"
        """Under this name the scores of a test are logged."""
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

    def with_encoder(self, encoder: Encoder, metrics: Mapping[str, FrameMetric], name: str) -> System:
        """Return a system that tests the same decoder behind another encoder; scores are logged as ``test_NAME``.

        If both masks are of the same kind, the other encoder's mask gets the values of this one's.
        """
        if type(encoder.mask) is type(self.encoder.mask):
            encoder.mask.load_state_dict(self.encoder.mask.state_dict())
        system = System(encoder, self.decoder, metrics=metrics, seed=self.seed)
        system.test_name = f"test_{name}"
        return system

    def forward(
        self, video: torch.Tensor, mask: torch.Tensor | None = None, origin: tuple[int, int] = (0, 0)
    ) -> torch.Tensor:
        """Record a video ``(N, T, H, W)`` and reconstruct it, see :meth:`Pipeline.forward`."""
        return self.pipeline(video, mask, origin)

    # Training

    def configure_optimizers(self) -> Any:
        # the fused one is twice as fast and differs in the last bits; scaled gradients of float16 it would not clip
        fused = self._trainer is not None and self.trainer.precision == "bf16-mixed"
        optimizer = self.rates.optimizer(self.encoder.parameters(), self.decoder.parameters(), fused)

        def schedule(step: int) -> float:
            # asking for the number of steps before the first would set up the loader before its place is restored
            return self.rates.factor(self.part_done(step) if step else 0.0)

        scheduler = torch.optim.lr_scheduler.LambdaLR(optimizer, schedule)
        return {"optimizer": optimizer, "lr_scheduler": {"scheduler": scheduler, "interval": "step"}}

    def part_done(self, step: int | None = None) -> float:
        """Return the part of the run, 0 to 1, that is over after a step (None: now); 0 in a run without end."""
        return part_done(self.trainer, self.global_step if step is None else step)

    def on_train_batch_start(self, batch: torch.Tensor, batch_idx: int) -> None:
        self.validated = False
        seed_step(self.seed, self.trainer.fit_loop.total_batch_idx, self.global_rank, self.device)

    def training_step(self, batch: Any, batch_idx: int) -> torch.Tensor:
        return self.logged(self.batch_loss(as_clips(batch)))

    def batch_loss(self, video: torch.Tensor) -> torch.Tensor:
        """Record a batch of clips ``(N, T, h, w)`` behind a random window of the mask, decode it, return the loss."""
        return self.loss(self.stages(*self.recorded(video)), video)

    def recorded(self, video: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return what the decoder gets of clips ``(N, T, h, w)``: measurements and the window of the mask."""
        mask, origin = self._window(*video.shape[-2:])
        pipeline = self.pipeline
        linear = pipeline.linearise(pipeline.record(video, mask, origin), origin=origin)
        return linear_with_mask(linear, pipeline.decoder_mask(mask))

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
        due = every > 0 and (self.global_step + 1) % every == 0
        return due or loop.batch_progress.is_last_batch or loop.batch_idx == 0

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
        place = f"epoch {self.current_epoch}, batch {self.trainer.fit_loop.batch_idx} (step {self.global_step})"
        advice = (
            f"at {place}: stopped; give a smaller {self.rates} or check the data; "
            "the checkpoints hold the last good (finite) state"
        )
        norm = gradient_norm(parameters, self._loss, self.trainer.precision == "16-mixed", advice)
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

    # Validation and test

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
        """Add a batch to the scores; return what :meth:`Scoring.add` returns."""
        # sensor noise in a test does not depend on the training before it
        seed_step(self.seed, batch_idx, self.global_rank, self.device, testing=True)
        assert self.scoring is not None  # Lightning calls on_test_epoch_start first
        return self.scoring.add(batch, self.pipeline, self.tile)

    def on_test_epoch_end(self) -> None:
        self.tested = self._log_scores(self.test_name)

    def on_validation_epoch_end(self) -> None:
        self.validated = True
        for key, value in self._log_scores("val")["baseline"].items():
            self.log(f"{MEAN_MEASUREMENT}/{key}", value, sync_dist=True)

    def _log_scores(self, name: str) -> dict[str, Any]:
        assert self.scoring is not None
        values, results = self.scoring.logged(name)
        for key, value in values.items():
            self.log(key, value, prog_bar=key == "val/psnr", sync_dist=True)
        return results

    # Checkpoints

    @classmethod
    def load_from_checkpoint(  # type: ignore[override]  # Lightning's other arguments are refused
        cls, checkpoint_path: Any, map_location: Any = None, *, trusted: Iterable[str] = (), **settings: Any
    ) -> System:
        """Build a system from a checkpoint of this project; nothing in it is executed.

        Args:
            checkpoint_path: RUN/checkpoints/last.ckpt; or, with ``encoder`` and ``decoder`` among the settings, one
                that somebody's own trainer has written.
            map_location: the device to move the system to; None for the CPU.
            trusted: packages beside this one whose classes the checkpoint may name.
            settings: arguments of the class that replace those of the training, such as ``lr`` and ``metrics``.

        Raises:
            BadInput: the file is missing, damaged or not a checkpoint of this project, or a setting that is none.
        """
        from sci_lightning.training.load_system import load_system  # which needs Lightning's, too

        base = inspect.signature(System).parameters
        system: System = load_system(cls, base, checkpoint_path, map_location, trusted, settings)
        return system

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        checkpoint["config"] = self.run_config
        checkpoint["position"] = TrainingPosition.of(self.trainer, self.validated).state()

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Refuse to go on where the loops' states are missing: Lightning would begin again at the first step."""
        if self.trainer.training and "loops" not in checkpoint:
            raise BadInput(
                "this checkpoint is gone on with by Trainer(plugins=TrainingCheckpointIO(system)) of "
                "sci_lightning.training.training_checkpoint, or by the command train"
            )
