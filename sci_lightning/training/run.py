"""A training from its configuration to its results, without Hydra: what ``train`` and ``sci.train`` call."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import lightning as L
import torch
from lightning.fabric.plugins.environments.slurm import SLURMEnvironment
from lightning.pytorch.loggers import TensorBoardLogger

from sci_lightning.configuration.build import build
from sci_lightning.decoder.complexity import count_macs, count_parameters
from sci_lightning.decoder.layers import kernels
from sci_lightning.encoder.encoder import check_recording
from sci_lightning.errors import BadInput
from sci_lightning.files.json_file import write_json
from sci_lightning.runs.checkpoint import Checkpoint, read_checkpoint
from sci_lightning.runs.cluster_job import job_of_this_process
from sci_lightning.runs.precision import describe_precision, device_of_accelerator, resolve_precision
from sci_lightning.runs.results import RunMetrics, hparams
from sci_lightning.runs.resume import check_same_run, find_resumable_checkpoint, load_finished_metrics
from sci_lightning.training.callbacks import LastCheckpoint
from sci_lightning.training.cuda_graph import check_graphed
from sci_lightning.training.initialisation import start_at_unit_variance
from sci_lightning.training.learning_rates import ProcessorTime
from sci_lightning.training.loggers import build_loggers, run_name, with_run_ids
from sci_lightning.training.scored_pipeline import ScoredPipeline
from sci_lightning.training.scoring import build_metrics
from sci_lightning.training.stop_signal import StopSignal
from sci_lightning.training.system import System
from sci_lightning.training.training_checkpoint import TrainingCheckpointIO
from sci_lightning.training.video_data import VideoData
from sci_lightning.weights import ANY_MASK


@dataclass(frozen=True)
class Run:
    """What a training left behind.

    Attributes:
        folder: with ``metrics.json``, ``checkpoints/``, pictures and logs.
        metrics: of the test that followed: PSNR in dB, SSIM and the like, by scene and their means.
        checkpoint: of the encoder and the decoder as they were at the end; ``sci.load_checkpoint`` reads it.
        tests: metrics behind other encoders (``test_encoders``), by their names.
        finished_before: whether everything was there already and nothing was computed (``resume=true``).
    """

    folder: Path
    metrics: RunMetrics
    checkpoint: Path
    tests: Mapping[str, RunMetrics] = field(default_factory=dict)
    finished_before: bool = False


def run_training(
    config: Mapping[str, Any],
    names: Mapping[str, str],
    *,
    stop: StopSignal | None = None,
    on_resume: Callable[[str, list[str]], None] = lambda path, changes: None,
    on_start: Callable[[str], None] = lambda line: None,
) -> Run:
    """Train, test, write checkpoints and ``metrics.json``.

    Args:
        config: ``conf/train.yaml``, composed, resolved and plain.
        names: what was chosen of each group, ``encoder`` and ``decoder`` among them; kept in checkpoints and results.
        stop: asks the training to stop; without it nothing does.
        on_resume: called with the path of the checkpoint that the training goes on from, and what differs from it.
        on_start: called with a line that says in which precision networks are computed.

    Raises:
        BadInput: settings that do not go together, or a checkpoint of another training.
        TrainingDiverged: a loss or a gradient is no longer finite.
    """
    out = Path(config["out"])
    if any(part > full for part, full in zip(config["crop"], config["size"], strict=True)):
        raise BadInput(
            f"crop={config['crop']} is larger than size={config['size']}: a training clip must fit under the mask"
        )
    start_from = config["ckpt_path"]
    if config["resume"]:
        if (done := load_finished_metrics(out, config)) is not None:
            return Run(out, done, out / "checkpoints" / "last.ckpt", finished_before=True)
        if config.get("finetune"):  # what ckpt_path= names is where it began
            start_from = find_resumable_checkpoint(out, config) or start_from
        else:
            start_from = start_from or find_resumable_checkpoint(out, config)
    checkpoint = read_checkpoint(start_from) if start_from else None
    run_config = {**config, "names": dict(names)}
    run_config, line = _with_precision(run_config, checkpoint)
    on_start(line)
    system = _build_system(run_config)
    goes_on = checkpoint is not None and checkpoint.resumable
    if config.get("finetune"):
        goes_on = goes_on and _is_finetuning(checkpoint, run_config)
        last = out / "checkpoints" / "last.ckpt"
        if not goes_on and last.is_file() and start_from and last.samefile(start_from):
            raise BadInput(
                f"{out}: holds the training that is to be fine-tuned, which would be lost; give another out="
            )
        _fix_mask(system, checkpoint, run_config)
    if checkpoint is not None and (goes_on or not config.get("finetune")):
        _load(system, checkpoint, run_config, on_resume)
    resumed = start_from if goes_on else None

    benchmark = build(config["benchmark"], "benchmark") if config["benchmark"]["root"] else None
    data = VideoData(build(config["data"], "data"), config["batch_size"], config["workers"], test=benchmark)
    checkpoint_io = TrainingCheckpointIO(system)
    earlier = checkpoint.config.get("logger") if checkpoint is not None and goes_on else None
    trainer = data.trainer = system.trainer = _build_trainer(run_config, checkpoint_io, stop, earlier)
    checkpoint_io.clips = data.train_dataloader()
    if checkpoint is None and config["initialisation"] == "unit_variance":
        start_at_unit_variance(system, data.source.clips())
    if resumed:
        checkpoint_io.prepare(resumed)
    # what can be refused has been: from here on the loggers write
    system.run_config = {**system.run_config, "logger": with_run_ids(config.get("logger"), trainer.loggers)}
    trainer.fit(system, datamodule=data, ckpt_path=resumed)
    trainer.save_checkpoint(out / "checkpoints" / "last.ckpt")
    if stop is not None:
        stop.act_at_once()
    return _test(system, trainer, data, run_config)


def _build_system(config: Mapping[str, Any]) -> System:
    """Build the encoder, the decoder with its first weights, and the LightningModule around them."""
    names = config["names"]
    torch.manual_seed(config["seed"])  # the decoder's first weights
    encoder, decoder = build(config["encoder"], "encoder"), build(config["decoder"], "decoder")
    kernels.use(decoder, config["kernels"])
    check_recording(encoder, f"encoder={names['encoder']}")
    if not count_parameters(decoder):
        raise BadInput(f"decoder={names['decoder']} has nothing to learn: evaluate and reconstruct take it untrained")
    metrics = build_metrics(config.get("metrics", {}), config["size"])
    parts = {"encoder": encoder, "decoder": decoder, "metrics": metrics}
    system: System = build(config["system"], "system", **parts, run_config=dict(config))
    return system


def _with_precision(config: Mapping[str, Any], checkpoint: Checkpoint | None) -> tuple[dict[str, Any], str]:
    """Return a configuration with the precision that ``auto`` stands for, and a line about it.

    A training that goes on keeps the precision that it began with, unless the configuration asks for one.
    """
    trainer = config["trainer"]
    asked = trainer.get("precision")
    if asked == "auto" and checkpoint is not None and checkpoint.resumable:
        asked = checkpoint.config["trainer"].get("precision", asked)
    device = device_of_accelerator(trainer.get("accelerator", "auto"))
    precision = resolve_precision(asked, device)
    return {**config, "trainer": {**trainer, "precision": precision}}, describe_precision(precision, device)


def _load(
    system: System, checkpoint: Checkpoint, config: Mapping[str, Any], on_resume: Callable[[str, list[str]], None]
) -> None:
    """Fill the encoder and the decoder from a checkpoint, which the training itself goes on from if it is resumable.

    Weights that were trained behind any mask fill the decoder alone.
    """
    if checkpoint.resumable:
        on_resume(str(checkpoint.path), check_same_run(checkpoint.path, checkpoint.config, config))
    checkpoint.fill("decoder", system.decoder, config["names"]["decoder"])
    if checkpoint.config["names"]["encoder"] != ANY_MASK:
        checkpoint.fill("encoder", system.encoder, config["names"]["encoder"])


def _is_finetuning(checkpoint: Checkpoint | None, config: Mapping[str, Any]) -> bool:
    """Return whether a checkpoint is of this very fine-tuning, which then goes on; else of the training before it."""
    earlier = {} if checkpoint is None else checkpoint.config
    return bool(earlier.get("finetune")) and earlier["encoder"] == config["encoder"]


def _fix_mask(system: System, checkpoint: Checkpoint | None, config: Mapping[str, Any]) -> None:
    """Take the decoder from a checkpoint, and let nothing else of the system learn.

    Raises:
        BadInput: there is no checkpoint, or its decoder does not fit.
    """
    if checkpoint is None:
        raise BadInput(
            "finetune=true needs a decoder that is trained already: ckpt_path=RUN/checkpoints/last.ckpt, and "
            "encoder=FOUND/encoder.yaml for the camera that it shall get used to"
        )
    if checkpoint.config.get("frames", config["frames"]) != config["frames"]:
        raise BadInput(
            f"{checkpoint.path}: its decoder was trained for {checkpoint.config['frames']} slots, the camera has "
            f"{config['frames']}; fine-tuning needs a camera of as many slots"
        )
    checkpoint.fill("decoder", system.decoder, config["names"]["decoder"])
    system.encoder.requires_grad_(False)


def _build_trainer(
    config: Mapping[str, Any],
    checkpoint_io: TrainingCheckpointIO,
    stop: StopSignal | None,
    earlier: Mapping[str, Any] | None,
) -> L.Trainer:
    """Build Lightning's trainer with the loggers and the callbacks of the configuration."""
    loggers = build_loggers(config.get("logger"), run_name(config), earlier)
    callbacks = [build(entry, f"callbacks.{name}") for name, entry in config["callbacks"].items() if entry]
    if config["core_minutes"] is not None:
        callbacks.append(ProcessorTime(config["core_minutes"]))
    for callback in callbacks:
        if isinstance(callback, LastCheckpoint):
            callback.stop = stop
    plugins: list[Any] = [checkpoint_io]
    if SLURMEnvironment.detect():
        plugins.append(SLURMEnvironment(auto_requeue=False))  # the command queues its job again, see StopSignal
    trainer: L.Trainer = build(config["trainer"], "trainer", callbacks=callbacks, logger=loggers, plugins=plugins)
    if config["system"].get("cuda_graph"):
        check_graphed(trainer.accumulate_grad_batches, trainer.world_size)
    return trainer


def _test(system: System, trainer: L.Trainer, data: VideoData, config: Mapping[str, Any]) -> Run:
    """Test behind every encoder of ``test_encoders``, then behind the trained one; write a ``metrics.json`` of each."""
    out, names, tests = Path(config["out"]), config["names"], {}
    steps = trainer.global_step
    recorded = {key: value for key, value in config.items() if key != "names"}
    for name, settings in config["test_encoders"].items():
        metrics = build_metrics(config.get("metrics", {}), config["size"])
        tested = system.behind(build(settings, f"test_encoders.{name}"), metrics, name)
        trainer.test(tested, datamodule=data, verbose=False)
        if trainer.is_global_zero:
            tests[name] = run_metrics(tested, {**names, "test_encoder": name}, recorded, steps)
            write_json(tests[name].as_json(), out / f"test_{name}" / "metrics.json")
    trainer.test(system, datamodule=data, verbose=False)
    scores = run_metrics(system, {**names, "test_encoder": names["encoder"]}, recorded, steps)
    if trainer.is_global_zero:  # metrics.json last: it says that the run is finished
        write_json(scores.as_json(), out / "metrics.json")
        for logger in trainer.loggers:
            if isinstance(logger, TensorBoardLogger):
                logger.log_hyperparams(
                    hparams(scores), {f"test/{key}": value for key, value in scores.mean.items()}, steps
                )
    return Run(out, scores, out / "checkpoints" / "last.ckpt", tests)


def run_metrics(
    system: ScoredPipeline, names: Mapping[str, str], config: Mapping[str, Any], training_steps: int | None = None
) -> RunMetrics:
    """Return the metrics of a system that has just been tested.

    Args:
        system: after ``trainer.test``.
        names: ``encoder``, ``decoder`` and ``test_encoder`` as the configuration calls them.
        config: the run's plain configuration.
        training_steps: of the optimiser, in the training that has just ended; None after no training.
    """
    trained = [name for name, effect in (config["encoder"].get("effects") or {}).items() if effect is not None]
    tested: list[str] = [] if config.get("evaluate", {}).get("captures") else system.encoder.path.names
    trained.sort(key=lambda name: tested.index(name) if name in tested else len(tested))  # as the light meets them
    return RunMetrics(
        encoder=names["encoder"],
        decoder=names["decoder"],
        test_encoder=names["test_encoder"],
        effects=trained,
        test_effects=tested,
        **system.tested,
        parameters=count_parameters(system.decoder),
        macs=count_macs(system.decoder, system.encoder.mask.frames, *system.encoder.size),
        config=config,
        training_steps=training_steps,
        job=job_of_this_process(),
    )
