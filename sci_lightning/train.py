"""``python -m sci_lightning.train``: learn a mask and a decoder together, then test them."""

from __future__ import annotations

import signal
import sys
from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from sci_lightning.cli.command import built, chosen, plain, run
from sci_lightning.cli.console import PlainConsole, styled
from sci_lightning.cli.continued_run import recorded, repeated
from sci_lightning.errors import BadInput
from sci_lightning.runs.run_folder import is_first_process
from sci_lightning.training.lost_process import lost_process
from sci_lightning.training.stop_signal import STATUS, Stopped, StopSignal


def train(cfg: DictConfig) -> float:
    """Train, test, write ``metrics.json`` and say where everything is; returns the mean PSNR in dB.

    Ctrl-C or SIGTERM end it with a line that says how to go on, and status 130.

    Args:
        cfg: ``conf/train.yaml``, composed.
    """
    with StopSignal() as stop:
        try:
            return _train(cfg, stop)
        except (Stopped, KeyboardInterrupt, SystemExit) as end:
            asked = not isinstance(end, SystemExit) or isinstance(end.__context__, (Stopped, KeyboardInterrupt))
            if not asked:
                raise
        except RuntimeError as error:
            if lost := lost_process(error, cfg.out):
                raise lost from error
            raise
        if not is_first_process():
            sys.exit(0)
        last = Path(cfg.out) / "checkpoints" / "last.ckpt"
        if not last.is_file():
            print("stopped before the first step was finished; nothing is lost", file=sys.stderr)
        else:
            from sci_lightning.cli.next_command import invocation

            words = repeated(last, HydraConfig.get().overrides.task, plain(cfg)["encoder"])
            line = invocation("train", *words, paths={"ckpt_path": last})
            print(f"stopped; go on with:\n  {line}", file=sys.stderr)
        sys.exit(STATUS)


def _train(cfg: DictConfig, stop: StopSignal) -> float:
    import torch
    from lightning.fabric.plugins.environments.slurm import SLURMEnvironment
    from lightning.pytorch.loggers import TensorBoardLogger

    from sci_lightning.cli.loggers import chosen_loggers, run_name
    from sci_lightning.cli.metrics import chosen_metrics
    from sci_lightning.cli.next_command import dashboard, invocation, override, print_next
    from sci_lightning.data.loader import ClipLoader, scene_loader
    from sci_lightning.decoder import kernels
    from sci_lightning.decoder.complexity import count_parameters
    from sci_lightning.encoder.trial import check_recording
    from sci_lightning.runs.checkpoint import read_checkpoint
    from sci_lightning.runs.results import hparams, print_results, results, write_json
    from sci_lightning.runs.resume import check_same_run, finished, interrupted
    from sci_lightning.training.callbacks import LastCheckpoint
    from sci_lightning.training.training_checkpoint import TrainingCheckpointIO, remove_slurm_checkpoints

    kernels.use(cfg.kernels)
    out = Path(cfg.out)
    if any(part > full for part, full in zip(cfg.crop, cfg.size, strict=True)):
        raise BadInput(f"crop={cfg.crop} is larger than size={cfg.size}: a training clip must fit under the mask")
    config = plain(cfg)
    names = {"encoder": chosen("encoder"), "decoder": chosen("decoder")}
    if cfg.resume:
        if (done := finished(out, config)) is not None:
            PlainConsole().say(styled(out), ": finished before, kept")
            return float(done["mean"]["psnr"])
        cfg.ckpt_path = cfg.ckpt_path or interrupted(out, config)
    torch.manual_seed(cfg.seed)  # the decoder's first weights
    encoder, decoder = built(cfg, "encoder"), built(cfg, "decoder")
    check_recording(encoder, f"encoder={names['encoder']}")
    if not count_parameters(decoder):
        raise BadInput(f"decoder={names['decoder']} has nothing to learn: evaluate and reconstruct take it untrained")
    overrides = recorded(HydraConfig.get().overrides.task)
    run_config = {**config, "names": names, "overrides": overrides}
    modules = {"encoder": encoder, "decoder": decoder, "metrics": chosen_metrics(cfg)}
    system = built(cfg, "system", **modules, run_config=run_config)
    resumed = None
    if cfg.ckpt_path:
        checkpoint = read_checkpoint(cfg.ckpt_path)
        if checkpoint.resumable:
            resumed = cfg.ckpt_path
            changes = check_same_run(resumed, checkpoint.config, run_config)
            if is_first_process():
                but = f", but {', '.join(changes)}" if changes else ""
                PlainConsole().say("goes on from ", styled(resumed), f" as configured there{but}")
        checkpoint.fill("decoder", decoder, names["decoder"])
        checkpoint.fill("encoder", encoder, names["encoder"])

    loggers = chosen_loggers(cfg, run_name(run_config))
    source = built(cfg, "data")
    held_out = source.scenes()
    tested_on = built(cfg, "benchmark").scenes() if cfg.benchmark.root else held_out
    checkpoint_io = TrainingCheckpointIO(system)
    callbacks = [built(cfg, f"callbacks.{name}") for name, callback in cfg.callbacks.items() if callback]
    for callback in callbacks:
        if isinstance(callback, LastCheckpoint):
            callback.stop = stop
    trainer = built(
        cfg,
        "trainer",
        callbacks=callbacks,
        logger=loggers,
        plugins=[checkpoint_io],
    )
    if SLURMEnvironment.detect():  # Lightning queues the job again
        stop.leave(signal.SIGTERM)
    share = {"rank": trainer.global_rank, "world_size": trainer.world_size}
    clips = checkpoint_io.clips = ClipLoader(source.clips(), cfg.batch_size, workers=cfg.workers, **share)
    trainer.fit(system, clips, scene_loader(held_out, **share), ckpt_path=resumed)
    trainer.save_checkpoint(out / "checkpoints" / "last.ckpt")
    if trainer.is_global_zero:
        remove_slurm_checkpoints(out)
    stop.act_at_once()
    test_scenes = scene_loader(tested_on, **share)
    for name in cfg.test_encoders:
        tested = system.with_encoder(built(cfg, f"test_encoders.{name}"), chosen_metrics(cfg))
        trainer.test(tested, test_scenes, verbose=False)
        if trainer.is_global_zero:
            found = results(tested, {**names, "test_encoder": name}, config)
            write_json(found, out / f"test_{name}" / "metrics.json")
            print_results(found, PlainConsole())
    trainer.test(system, test_scenes, verbose=False)
    found = results(system, {**names, "test_encoder": names["encoder"]}, config)
    if trainer.is_global_zero:  # metrics.json last: it says that the run is finished
        write_json(found, out / "metrics.json")
        for logger in trainer.loggers:
            if isinstance(logger, TensorBoardLogger):
                logger.log_hyperparams(hparams(found), {f"test/{key}": value for key, value in found["mean"].items()})
        console = PlainConsole()
        print_results(found, console)
        folders = [f"{name}/" for name in ("pictures", *(cfg.get("logger") or {})) if (out / name).is_dir()]
        console.say(styled(out), f": {', '.join(['metrics.json', 'checkpoints/last.ckpt', *folders])}")
        tested = ("six_scenes", cfg.benchmark.root) if cfg.benchmark.root else (chosen("data"), cfg.data.get("root"))
        paths = {"ckpt_path": out / "checkpoints" / "last.ckpt"}
        trusted = [override("trusted", f"[{','.join(cfg.trusted)}]")] if cfg.trusted else []
        lines = [
            invocation(
                "evaluate", f"data={tested[0]}", *trusted, paths=paths | ({"data.root": tested[1]} if tested[1] else {})
            ),
            invocation("export_mask", *trusted, paths=paths),
        ]
        if (out / "tensorboard").is_dir():
            lines.append(dashboard(out))
        print_next(console, *lines)
    return float(found["mean"]["psnr"])


if __name__ == "__main__":
    run("train", train)
