"""What a run found: ``metrics.json`` and the table on the terminal."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from sci_lightning.atomic_file import whole_file
from sci_lightning.console import PlainConsole
from sci_lightning.decoder.complexity import count_macs, count_parameters
from sci_lightning.system import System

UNITS = {"psnr": "PSNR (dB)", "ssim": "SSIM", "qscore": "Q-Score"}


def results(system: System, names: Mapping[str, str], config: Mapping[str, Any]) -> dict[str, Any]:
    """Everything ``metrics.json`` holds, from a system that has just been tested.

    Args:
        system: after ``trainer.test``.
        names: ``encoder``, ``decoder`` and ``test_encoder`` as the configuration calls them.
        config: the run's plain configuration.
    """
    mask = system.encoder.mask
    return {
        "format": "sci-metrics",
        "format_version": 1,
        **names,
        **system.tested,
        "parameters": count_parameters(system.decoder),
        "macs": count_macs(system.decoder, mask.frames, *mask.size),
        "config": dict(config),
    }


def write_json(content: Mapping[str, Any], path: Path) -> None:
    """Write JSON whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n")


def print_results(found: Mapping[str, Any], console: PlainConsole) -> None:
    """A table of the scenes, their mean, and the baseline in which every frame is the mean measurement."""
    trained = f"trained on {found['encoder']}, " if found["parameters"] else ""
    title = f"{found['decoder']}, {trained}tested on {found['test_encoder']}"
    conventions = "\n".join(f"{UNITS.get(key, key)}: {text}" for key, text in found["conventions"].items())
    table = Table(title=title, title_justify="left", caption=conventions or None, caption_justify="left")
    table.add_column("scene")
    keys = list(found["mean"])
    for key in keys:
        table.add_column(UNITS.get(key, key), justify="right")
    rows = [*found["scenes"].items(), ("mean", found["mean"])]
    for name, scores in rows:
        table.add_row(name, *(_number(key, scores[key]) for key in keys), style="bold" if name == "mean" else "")
    table.add_row(
        "every frame = mean measurement", *(_number(key, found["baseline"][key]) for key in keys), style="dim"
    )
    console.print(table)


def _number(key: str, value: float) -> str:
    return f"{value:.4f}" if key == "ssim" else f"{value:.2f}"


def hparams(found: Mapping[str, Any]) -> dict[str, Any]:
    """The choices that tell runs apart, flat, for TensorBoard's table of hyper-parameters."""
    config = found["config"]
    chosen = {key: found[key] for key in ("encoder", "decoder")}
    chosen["mask_bits"] = config["encoder"]["mask"].get("bits", 1)
    chosen.update({key: config[key] for key in ("scale", "frames", "batch_size", "seed")})
    chosen.update({key: config["system"][key] for key in ("loss", "lr", "final_lr")})
    chosen["size"] = "x".join(map(str, config["size"]))
    chosen.update(found["conventions"])
    return chosen
