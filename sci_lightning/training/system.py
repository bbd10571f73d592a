"""The LightningModule: encoder, decoder and loss, trained together."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import torch

from sci_lightning.configuration.arguments import check_arguments
from sci_lightning.configuration.bounds import NonNegative, Positive, Seed, Share
from sci_lightning.console import silence_libraries
from sci_lightning.decoder.decoder import Decoder
from sci_lightning.decoder.tiling.tile_choice import TileChoice
from sci_lightning.encoder import Encoder
from sci_lightning.errors import BadInput
from sci_lightning.measurement import linear_with_mask
from sci_lightning.runs.checkpoint import load_file, read_checkpoint
from sci_lightning.training.cuda_graph import GraphedStages
from sci_lightning.training.learning_rates import LearningRates
from sci_lightning.training.scored_pipeline import ScoredPipeline
from sci_lightning.training.scoring import as_clips
from sci_lightning.training.step import StageLoss, clip_finite_gradients, is_logged, seed_step
from sci_lightning.training.training_position import TrainingPosition


class System(ScoredPipeline):
    """Trains a decoder and, if its mask has parameters, the encoder.

    If the clips are smaller than the mask, every training batch is recorded with a random window of the mask. Every
    step seeds torch with (seed, step, process), so that noise and windows do not depend on what ran before: a resumed
    run repeats them.

    A training batch is a tensor of clips ``(N, T, h, w)``; for validation and test see
    :class:`~sci_lightning.training.scored_pipeline.ScoredPipeline`. ``hparams`` hold the settings, from
    ``val_every_n_frames`` to ``seed``.

    Args:
        encoder, decoder, camera, metrics, val_every_n_frames, tile: see
            :class:`~sci_lightning.training.scored_pipeline.ScoredPipeline`.
        loss: ``mse``, ``rmse`` or ``frame_rmse``.
        stage_weights: weights of the losses of the decoder's last stages, in their order; the loss is the weighted sum.
            ``(1,)`` takes the final estimate alone. Unfolding networks have many stages, most decoders one.
        lr, final_lr, mask_lr, muon_lr, muon_decay, warmup, cooldown: see
            :class:`~sci_lightning.training.learning_rates.LearningRates`.
        compile: compile the decoder with ``torch.compile``.
        cuda_graph: replay the decoder's part of a step, see :class:`~sci_lightning.training.cuda_graph.GraphedStages`.
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
        cooldown: Share | None = None,
        compile: bool = False,
        cuda_graph: bool = False,
        tile: TileChoice | str = "none",
        seed: Seed = 0,
        run_config: dict[str, Any] | None = None,
    ) -> None:
        stage_weights, val_every_n_frames = tuple(stage_weights), dict(val_every_n_frames or {})  # plain, to be saved
        super().__init__(
            encoder,
            decoder,
            camera=camera,
            metrics=metrics,
            val_every_n_frames=val_every_n_frames,
            tile=tile,
            seed=seed,
        )
        self.save_hyperparameters(ignore=["encoder", "decoder", "camera", "metrics", "tile", "run_config"])
        silence_libraries()
        if encoder.sensor.pattern is not None:
            raise BadInput(
                "encoder/sensor=bayer is for evaluate and reconstruct: a network decodes its mosaic as four gray "
                "snapshots, and is trained in gray with encoder/sensor=clip_quantise"
            )
        if compile and cuda_graph:
            raise BadInput("system.compile=true system.cuda_graph=true: compiled stages cannot be replayed; choose one")
        self.loss = StageLoss(loss, stage_weights)
        self.stages: Callable[..., Sequence[torch.Tensor]] = (
            torch.compile(decoder.stages) if compile else GraphedStages(decoder) if cuda_graph else decoder.stages
        )
        self.rates = LearningRates(lr, final_lr, mask_lr, muon_lr, muon_decay, warmup, cooldown)
        self.run_config = run_config or {}
        self.validated = True
        """False from the start of a training batch until the validation that may follow it is over."""
        self._is_logged = False
        if compile:
            self.decoder.compile()

    def configure_optimizers(self) -> Any:
        return self.rates.optimizer_and_schedule(self.trainer, self.encoder.parameters(), self.decoder.parameters())

    def on_train_batch_start(self, batch: torch.Tensor, batch_idx: int) -> None:
        self.validated = False
        self._is_logged = is_logged(self.trainer)
        seed_step(self.seed, self.trainer.fit_loop.total_batch_idx, 0, self.device)

    def training_step(self, batch: Any, batch_idx: int) -> torch.Tensor:
        video = as_clips(batch)
        measurement, mask = self.observe(video)
        loss = self.loss(self.stages(measurement, mask), video)
        self._loss = loss.detach()
        if self._is_logged:
            self.log("train/loss", self._loss, prog_bar=True)
        return loss

    def observe(self, video: torch.Tensor) -> tuple[torch.Tensor, Any]:
        """Record clips ``(N, T, h, w)`` behind a random window of the mask; ``record`` refuses clips larger than it.

        Returns:
            What the decoder gets: measurements ``(N, h, w)``, linearised, and the window ``(T, h, w)``.
        """
        height, width = video.shape[-2:]
        top, left = (
            int(torch.randint(max(1, full - part + 1), ()))
            for full, part in zip(self.encoder.size, (height, width), strict=True)
        )
        if self.global_rank:  # one window for all processes of a training, and noise of its own for every process
            seed_step(self.seed, self.trainer.fit_loop.total_batch_idx, self.global_rank, self.device)
        mask = self.encoder.transmittance_window(top, left, height, width)
        recorded = self.pipeline.record(video, mask, (top, left))
        linear = self.pipeline.linearise(recorded, origin=(top, left))
        return linear_with_mask(linear, self.pipeline.decoder_mask(mask))

    def configure_gradient_clipping(
        self,
        optimizer: torch.optim.Optimizer,
        gradient_clip_val: float | None = None,
        gradient_clip_algorithm: str | None = None,
    ) -> None:
        """Check, clip and log the gradients; raises TrainingDiverged where they or the loss are not finite."""
        norm = clip_finite_gradients(
            self, optimizer, self._loss, gradient_clip_val, gradient_clip_algorithm, f"give a smaller {self.rates}"
        )
        if self._is_logged:
            self.log("train/gradient_norm", norm)
            self.log("train/lr", optimizer.param_groups[0]["lr"])

    def optimizer_step(self, *args: Any, **kwargs: Any) -> None:
        super().optimizer_step(*args, **kwargs)
        self.encoder.mask.project_()  # here, not at the batch's end, where a checkpoint may already have been written

    def on_validation_epoch_end(self) -> None:
        self.validated = True
        super().on_validation_epoch_end()

    def on_train_epoch_end(self) -> None:
        self.validated = True

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        checkpoint["config"] = self.run_config
        batches = int(self.trainer.num_training_batches)
        checkpoint["position"] = asdict(TrainingPosition(self.trainer.global_step, batches, self.validated))

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Refuse to go on where the loops' states are missing: Lightning would begin again at the first step."""
        if self.trainer.training and "loops" not in checkpoint:
            raise BadInput(
                "this checkpoint is gone on with by Trainer(plugins=TrainingCheckpointIO(system)) of "
                "sci_lightning.training.training_checkpoint, or by the command train"
            )

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
        settings.pop("weights_only", None)  # of Lightning: never anything else here
        weights = None
        if {"encoder", "decoder"} <= settings.keys():
            content = load_file(Path(checkpoint_path))
            config, trained, weights = {}, content.get("hyper_parameters", {}), content.get("state_dict", {})
        else:
            checkpoint = read_checkpoint(checkpoint_path, trusted)
            config, trained = checkpoint.config, checkpoint.config.get("system", {})
            settings = {"encoder": checkpoint.encoder(), "decoder": checkpoint.decoder(trainable=True), **settings}
        known = {*inspect.signature(System).parameters, *inspect.signature(cls).parameters}
        arguments = {**{key: value for key, value in trained.items() if key in known}, **settings}
        check_arguments(cls, arguments, "system")
        system = cls(**arguments, run_config=config)
        if weights is not None:
            try:
                system.load_state_dict(weights)
            except (RuntimeError, TypeError) as error:
                raise BadInput(f"{checkpoint_path}: does not fit this encoder and decoder ({error})") from error
        return system.to(map_location)
