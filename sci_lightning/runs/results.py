"""What a run found: ``metrics.json`` and the table on the terminal."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rich.table import Table

from sci_lightning.cli.console import PlainConsole
from sci_lightning.decoder.complexity import count_macs, count_parameters
from sci_lightning.files.atomic_file import whole_file
from sci_lightning.training.system import System

UNITS = {"psnr": "PSNR (dB)", "ssim": "SSIM", "qscore": "Q-Score"}


def results(system: System, names: Mapping[str, str], config: Mapping[str, Any]) -> dict[str, Any]:
    """Everything ``metrics.json`` holds, from a system that has just been tested.

    ``effects`` and ``test_effects`` name the effects of the encoder that was trained and of the one that was tested
    with; they are absent where there are none, and of a real camera, whose effects nobody knows.

    Args:
        system: after ``trainer.test``.
        names: ``encoder``, ``decoder`` and ``test_encoder`` as the configuration calls them.
        config: the run's plain configuration.
    """
    mask = system.encoder.mask
    trained = [name for name, effect in (config["encoder"].get("effects") or {}).items() if effect is not None]
    tested: list[str] = [] if config.get("evaluate", {}).get("captures") else system.encoder.path.names
    trained.sort(key=lambda name: tested.index(name) if name in tested else len(tested))  # as the light meets them
    effects = {"effects": trained, "test_effects": tested}
    return {
        "format": "sci-metrics",
        "format_version": 1,
        **names,
        **{key: value for key, value in effects.items() if value},
        **system.tested,
        "parameters": count_parameters(system.decoder),
        "macs": count_macs(system.decoder, mask.frames, *mask.size),
        "config": dict(config),
    }


def with_effects(name: str, effects: Iterable[str]) -> str:
    """An encoder's name with those of its effects, such as ``lsw_sr + mask_shift``."""
    return " + ".join([name, *effects])


def write_json(content: Mapping[str, Any], path: str | Path) -> None:
    """Write JSON whole or not at all."""
    with whole_file(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n")


def print_results(found: Mapping[str, Any], console: PlainConsole) -> None:
    """A table of the scenes, their mean, and the baseline in which every frame is the mean measurement."""
    encoder, tested = (
        with_effects(found[name], found.get(effects, []))
        for name, effects in (("encoder", "effects"), ("test_encoder", "test_effects"))
    )
    trained = f"trained on {encoder}, " if found["parameters"] else ""
    title = f"{found['decoder']}, {trained}tested on {tested}"
    conventions = "\n".join(f"{UNITS.get(key, key)}: {text}" for key, text in found["conventions"].items())
    table = Table(title=title, title_justify="left", caption=conventions or None, caption_justify="left")
    table.add_column("scene")
    keys = list(found["mean"])
    for key in keys:
        table.add_column(UNITS.get(key, key), justify="right")
    rows = [*found["scenes"].items(), ("mean", found["mean"])]
    for name, scores in rows:
        table.add_row(name, *(number(key, scores[key]) for key in keys), style="bold" if name == "mean" else "")
    table.add_row("every frame = mean measurement", *(number(key, found["baseline"][key]) for key in keys), style="dim")
    console.print(table)


def number(key: str, value: float) -> str:
    """Return a score with the digits that its metric is printed with."""
    return f"{value:.4f}" if key == "ssim" else f"{value:.2f}"


def hparams(found: Mapping[str, Any]) -> dict[str, Any]:
    """The choices that tell runs apart, flat, for TensorBoard's table of hyper-parameters."""
    config = found["config"]
    chosen = {key: found[key] for key in ("encoder", "decoder")}
    chosen["effects"] = ", ".join(found.get("effects", [])) or "none"
    chosen["mask_bits"] = config["encoder"]["mask"].get("bits", 1)
    chosen.update({key: config[key] for key in ("scale", "frames", "batch_size", "seed")})
    chosen.update({key: config["system"][key] for key in ("loss", "lr", "final_lr")})
    chosen["size"] = "x".join(map(str, config["size"]))
    chosen.update(found["conventions"])
    return chosen
