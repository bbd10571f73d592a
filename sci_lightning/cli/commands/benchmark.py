"""``python -m sci_lightning.benchmark``: what decoding one measurement costs here, beside the paper's figures."""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from annotated_types import Interval
from hydra.core.config_store import ConfigStore
from omegaconf import OmegaConf
from rich.progress import Progress, TaskID

from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition, built, compose, group_members, plain
from sci_lightning.cli.failure_line import one_line
from sci_lightning.cli.settings import CommandSettings, Count, Kernels, Name, Precision
from sci_lightning.configuration.bounds import ExistingPath, Frames, NonNegative, Pixels, Repeats, Seed, Size
from sci_lightning.console import PlainConsole, styled
from sci_lightning.errors import BadInput

if TYPE_CHECKING:
    from sci_lightning.runs.checkpoint import Checkpoint

SETTINGS = ("frames", "tile", "compile", "warm_up", "repeats", "budget", "product", "training")
"""What is handed to the measurement, and written down, as it is."""


@dataclass(frozen=True)
class BenchmarkSettings(CommandSettings):
    ckpt_path: ExistingPath | None
    trusted: Sequence[Name]
    reduced: Name | None
    size: Size | Pixels
    crop: Size | None
    frames: Frames
    seed: Seed
    tile: Any
    only: Sequence[Name] | None
    device: Name
    precision: Precision
    training: Annotated[int, Interval(ge=0, le=65536)]
    compile: bool
    warm_up: Count
    repeats: Repeats
    budget: NonNegative
    product: Annotated[int, Interval(ge=0, le=65536)]
    kernels: Kernels


def benchmark(composition: Composition) -> None:
    """Write ``benchmark.json`` and ``benchmark.md`` and print the table; a decoder that fails does not stop the others.

    The files are there from the first decoder on, so that an interrupted benchmark keeps what it has measured.
    """
    import torch

    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.files.atomic_file import atomic_write
    from sci_lightning.files.json_file import write_json
    from sci_lightning.runs.device import device_name, resolve_device
    from sci_lightning.runs.precision import multiplies_bfloat16, resolve_precision
    from sci_lightning.runs.provenance import provenance_now
    from sci_lightning.studies.benchmark.decoder_cost import decoder_cost, scene_snapshot
    from sci_lightning.studies.benchmark.table import as_markdown, as_tables
    from sci_lightning.studies.tables.paper_figures import paper_figures

    cfg = composition.cfg
    out, console, names = Path(cfg.out), PlainConsole(), _names(composition)
    scales = group_members("scale")
    if cfg.reduced is not None and cfg.reduced not in scales:
        raise BadInput(f"reduced={cfg.reduced}: no such scale of networks; choose one of {', '.join(scales)}")
    device = resolve_device(cfg.device)
    if cfg.precision == "auto":
        precisions = ["32-true", "bf16-mixed"] if multiplies_bfloat16(device) else ["32-true"]
    else:
        precisions = [resolve_precision(cfg.precision, device)]
    checkpoint = _checkpoint(composition, names)
    if checkpoint is not None:
        cfg.size, cfg.frames = checkpoint.config["size"], checkpoint.config["frames"]
    elif isinstance(cfg.size, int):
        cfg.size = [cfg.size, cfg.size]
    cfg.crop = cfg.crop or list(cfg.size)
    for count in ("scenes_count", "snapshots_per_scene"):
        if count in cfg.data:  # of made scenes only what is decoded: large ones take gigabytes
            cfg.data[count] = 1
    scene, *snapshot = scene_snapshot(built(cfg, "data"), checkpoint, cfg.seed)
    settings = plain(OmegaConf.masked_copy(cfg, list(SETTINGS))) | {"size": tuple(cfg.size), "precisions": precisions}
    command = shlex.join(["python", "-m", "sci_lightning.benchmark", *composition.overrides])
    reduced = f"networks of scale={cfg.reduced}" if cfg.reduced else "full networks"
    reduced = "the network of a checkpoint" if checkpoint is not None else reduced
    described = f"{reduced}, one snapshot at {cfg.size[0]} x {cfg.size[1]}, T = {cfg.frames}"
    load = f"load {os.getloadavg()[0]:.1f} when it began" if hasattr(os, "getloadavg") else ""
    content: dict[str, Any] = {
        "format": "sci-benchmark",
        "format_version": 2,
        "provenance": provenance_now(device_name(device), described, [cfg.seed], command, load).as_json(),
        "torch": torch.__version__,
        "device": device_name(device),
        "threads": torch.get_num_threads(),
        **settings,
        "kernels": cfg.kernels,
        "scene": f"{composition.choice('data')}: {scene}",
        "weights": "random weights" if checkpoint is None else f"trained weights ({checkpoint.path.name})",
        "decoders": {},
        "failed": {},
    }
    settings |= {"threads": torch.get_num_threads(), "plain_kernels": cfg.kernels == "plain", "snapshot": snapshot}
    settings["state"] = None if checkpoint is None else checkpoint.check_fit("decoder", checkpoint.decoder())
    paper = paper_figures()["decoders"]
    with Progress(console=console, transient=True) as progress:
        task = progress.add_task("", total=len(names))
        for name in names:
            progress.update(task, description=name)
            figures = {"paper": paper[name]} if name in paper else {}
            rules = paper[name]["macs_rules"] if name in paper else 2022
            try:
                config = _decoder(composition, name) if checkpoint is None else checkpoint.config["decoder"]
                cost = decoder_cost(
                    config,
                    on_progress=partial(_show, progress, task, name),
                    device=str(device),
                    rules=rules,
                    **settings,
                )
                content["decoders"][name] = {**cost, **figures}
            except Exception as error:
                if len(names) == 1:
                    raise
                content["failed"][name] = one_line(error)
            write_json(content, out / "benchmark.json")
            with atomic_write(out / "benchmark.md") as temporary:
                temporary.write_text(as_markdown(content))
            progress.advance(task)
    for table in as_tables(content):
        console.print(table)
    console.say(styled(out), ": benchmark.json, benchmark.md")
    name = names[0] if len(names) == 1 else "e2e_cnn"
    if name in ("linear", "gap_tv", "admm_tv", "desci"):  # nothing to learn
        words = ["evaluate", f"decoder={name}", "data=synthetic", "size=[64,64]"]
    else:
        words = ["train", "experiment=quickstart", f"decoder={name}"]
    print_next(console, invocation(*words, *composition.own_folders()))
    if failed := content["failed"]:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in failed.items())
        raise BadInput(f"{len(failed)} of {len(names)} decoders could not be measured: {reasons}")


def _show(progress: Progress, task: TaskID, name: str, words: str) -> None:
    """Show what a decoder's process says; how it is cut into tiles stays to be read."""
    progress.update(task, description=f"{name}: {words}")
    if words.startswith("tile=auto"):
        progress.console.print(f"{name}: {words}")


def _checkpoint(composition: Composition, names: list[str]) -> Checkpoint | None:
    """Return the checkpoint whose decoder is measured; its name takes the place of ``decoder=`` in ``names``."""
    from sci_lightning.runs.checkpoint import read_checkpoint

    cfg = composition.cfg
    if cfg.ckpt_path is None:
        return None
    checkpoint = read_checkpoint(cfg.ckpt_path, cfg.trusted)
    names[:] = [checkpoint.config["names"]["decoder"]]
    return checkpoint


def _decoder(composition: Composition, name: str) -> dict[str, Any]:
    """Return the decoder's plain configuration: with its overrides if it was chosen by itself."""
    cfg = composition.cfg
    if cfg.reduced is not None:  # what the rows of a sweep train
        overrides = [word for word in composition.overrides if word.startswith("decoder.")]
        scaled = [f"decoder={name}", f"scale={cfg.reduced}", f"frames={cfg.frames}", *overrides]
        return plain(compose("train", scaled).cfg.decoder)
    if name == composition.choice("decoder"):
        return plain(cfg.decoder)
    return plain(compose("benchmark", [f"decoder={name}", f"frames={cfg.frames}"]).cfg.decoder)


def _names(composition: Composition) -> list[str]:
    """Return the decoder that was chosen, or every one of ``conf/decoder`` that ``only`` does not leave out."""
    if composition.choice("decoder") != "all":
        return [composition.choice("decoder")]
    every, cfg = group_members("decoder"), composition.cfg
    if unknown := sorted(set(cfg.only or []) - set(every)):
        raise BadInput(f"only={unknown}: no such decoder; choose from {', '.join(every)}")
    return [name for name in every if cfg.only is None or name in cfg.only]


def main() -> None:
    """Run the command; ``all`` is no file in ``conf/decoder``, whose members are decoders."""
    ConfigStore.instance().store("all", {}, group="decoder")
    run("benchmark", benchmark)
