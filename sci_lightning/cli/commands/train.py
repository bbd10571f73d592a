"""``python -m sci_lightning.train``: learn a mask and a decoder together, then test them."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from omegaconf import OmegaConf

from sci_lightning.cli.composition import Composition, plain
from sci_lightning.cli.settings import CommandSettings, Kernels, Name, Precision, Workers
from sci_lightning.cli.stored_run import to_repeat
from sci_lightning.configuration.bounds import Bits, ExistingPath, Frames, Positive, Repeats, Seed, Size
from sci_lightning.console import PlainConsole, styled
from sci_lightning.errors import INTERRUPTED, BadInput
from sci_lightning.runs.run_folder import is_first_process, undo_if_refused
from sci_lightning.training.stop_signal import Stopped, StopSignal, lost_process

if TYPE_CHECKING:
    from sci_lightning.training.run import Run


@dataclass(frozen=True)
class TrainSettings(CommandSettings):
    frames: Frames
    size: Size
    crop: Size
    batch_size: Repeats
    workers: Workers
    core_minutes: Positive | None
    mask_tile: Size | None
    mask_bits: Bits
    mask_sharpness: Positive
    mask_start: Literal["published", "designed"]
    seed: Seed
    dry_run: bool
    resume: bool
    test_encoders: Mapping[str, Any]
    ckpt_path: ExistingPath | None
    finetune: bool
    trusted: Sequence[Name]
    precision: Precision
    initialisation: Literal["layers", "unit_variance"]
    kernels: Kernels
    scale: Name


def train(composition: Composition) -> float | None:
    """Train, test, write ``metrics.json`` and say where everything is; returns the mean PSNR in dB.

    With ``dry_run=true`` it only says what that would take, and returns None. Ctrl-C or SIGTERM end it with a line that
    says how to go on, and status 130.
    """
    if composition.cfg.dry_run:
        _print_plan(composition)
        undo_if_refused(composition.cfg.out, "train")  # the folder that Hydra has made
        return None
    config = plain(composition.cfg)
    with StopSignal() as stop:
        try:
            if is_first_process() and not (config["resume"] and (Path(config["out"]) / "metrics.json").is_file()):
                _print_plan(composition)
            from sci_lightning.training.run import run_training

            done = run_training(config, composition.names(), stop=stop, on_resume=_say_resumed, on_start=_say)
        except (Stopped, KeyboardInterrupt, SystemExit) as end:
            asked = not isinstance(end, SystemExit) or isinstance(end.__context__, (Stopped, KeyboardInterrupt))
            if not asked:
                raise
        except RuntimeError as error:
            if lost := lost_process(error, config["out"]):
                raise lost from error
            raise
        else:
            if is_first_process():
                _print_run(done, composition)
            return done.metrics.mean["psnr"]
        if is_first_process():
            folder = (config["callbacks"].get("last") or {}).get("folder", Path(config["out"]) / "checkpoints")
            _say_stopped(Path(folder) / "last.ckpt", composition)
        stop.queue_again()
        sys.exit(INTERRUPTED if is_first_process() else 0)


def _print_plan(composition: Composition) -> None:
    """Print steps, memory and expected hours of a training, and above a day what would make sense in its place."""
    from sci_lightning.training.training_plan import DAY, training_plan

    cfg, console = composition.cfg, PlainConsole()
    config = OmegaConf.to_container(cfg, resolve=True)  # data.root may be missing
    if not isinstance(config, dict):
        raise TypeError("expected a mapping")
    if OmegaConf.is_missing(cfg.data, "root") and not cfg.data.clips_per_epoch:
        raise BadInput("data.root is missing: give it, or data.clips_per_epoch=.., which is all that a dry run needs")
    plan = training_plan({str(key): value for key, value in config.items()})
    for line in plan.lines():
        console.print(line, soft_wrap=True)
    if plan.seconds > DAY:
        from sci_lightning.cli.next_command import invocation

        again = (
            [] if cfg.dry_run else [f"{invocation('train', *composition.overrides, 'dry_run=true')}   (only says this)"]
        )
        short = invocation("train", "experiment=quickstart", f"decoder={composition.choice('decoder')}")
        console.say("here it makes more sense to begin with")
        for line in (f"{short}   (the same kind of network, reduced, in minutes)", *again):
            console.say(f"  {line}")
    console.file.flush()


def _say(line: str) -> None:
    if is_first_process():
        PlainConsole().say(line)


def _say_resumed(path: str, changes: list[str]) -> None:
    """Print which checkpoint a training goes on from, and what differs from it."""
    if is_first_process():
        but = f", but {', '.join(changes)}" if changes else ""
        PlainConsole().say("goes on from ", styled(path), f" as configured there{but}")


def _say_stopped(last: Path, composition: Composition) -> None:
    """Print how to go on with a training that was asked to stop."""
    from sci_lightning.cli.next_command import invocation

    if not last.is_file():
        print("stopped before the first step was finished; nothing is lost", file=sys.stderr)
        return
    line = invocation("train", *to_repeat(last, composition), paths={"ckpt_path": last})
    print(f"stopped; go on with:\n  {line}", file=sys.stderr)


def _print_run(done: Run, composition: Composition) -> None:
    """Print the tables of a run, where it lies and what to run next."""
    from sci_lightning.cli.next_command import dashboard, invocation, print_next
    from sci_lightning.runs.results import print_results

    cfg, out, console = composition.cfg, done.folder, PlainConsole()
    if done.finished_before:
        console.say(styled(out), ": finished before, kept")
        return
    for metrics in (*done.tests.values(), done.metrics):
        print_results(metrics, console)
    folders = [f"{name}/" for name in ("pictures", *(cfg.get("logger") or {})) if (out / name).is_dir()]
    console.say(styled(out), f": {', '.join(['metrics.json', 'checkpoints/last.ckpt', *folders])}")
    root = cfg.benchmark.root or cfg.data.get("root")
    data = "six_scenes" if cfg.benchmark.root else composition.choice("data")
    paths = {"ckpt_path": done.checkpoint}
    trusted, words = composition.trusted(), [*composition.own_folders(), f"data={data}"]
    lines = [
        invocation("evaluate", *words, *trusted, paths=paths | ({"data.root": root} if root else {})),
        invocation("export_mask", *trusted, paths=paths),
    ]
    if (out / "tensorboard").is_dir():
        lines.append(dashboard(out))
    print_next(console, *lines)
