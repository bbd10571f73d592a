"""The results of a run: ``metrics.json`` and the table on the terminal."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

from rich.table import Table

from sci_lightning.console import PlainConsole
from sci_lightning.files.atomic_file import atomic_write

UNITS = {"psnr": "PSNR (dB)", "ssim": "SSIM", "qscore": "Q-Score"}


@dataclass(frozen=True)
class RunMetrics:
    """The content of ``metrics.json``: what a run was, and how well it reconstructs.

    Attributes:
        encoder, decoder, test_encoder: as the configuration calls them; it was trained with the first and tested behind
            the last.
        scenes: by the scene's name, then by metric: PSNR in dB, SSIM, Q-Score, ..
        mean: of the scenes, by metric.
        conventions: how a metric was computed, where it has conventions.
        baseline: the means of an estimate in which every frame is the mean measurement.
        seconds_per_measurement: the median time to decode one.
        device: on which it was decoded.
        parameters: of the decoder.
        macs: multiply-accumulates to decode one measurement of the mask's size.
        config: the run's plain configuration.
        training_steps: of the optimiser, in the whole training; None where the training did not record them.
        effects, test_effects: names of the effects of the encoder that was trained and of the one that was tested
            with; none of a real camera, whose effects nobody knows.
    """

    encoder: str
    decoder: str
    test_encoder: str
    scenes: Mapping[str, Mapping[str, float]]
    mean: Mapping[str, float]
    conventions: Mapping[str, str]
    baseline: Mapping[str, float]
    seconds_per_measurement: float
    device: str
    parameters: int
    macs: int
    config: Mapping[str, Any]
    training_steps: int | None = None
    effects: Sequence[str] = ()
    test_effects: Sequence[str] = ()

    def to_json(self) -> dict[str, Any]:
        """Return the dictionary that the file holds; effects and training steps are absent where there are none."""
        content = {field.name: getattr(self, field.name) for field in fields(self)}
        order = ("encoder", "decoder", "test_encoder", "effects", "test_effects")
        first = {key: content.pop(key) for key in order}
        last = content.pop("config")
        if content["training_steps"] is None:
            del content["training_steps"]
        kept = {key: list(value) if key.endswith("effects") else value for key, value in first.items() if value}
        return {"format": "sci-metrics", "format_version": 1, **kept, **content, "config": dict(last)}

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> RunMetrics:
        """Return the metrics of a file of this program; what an earlier version did not write is empty or 0."""
        empty = {"scenes": {}, "conventions": {}, "baseline": {}, "parameters": 0, "macs": 0}
        texts = {"encoder": "", "decoder": "", "test_encoder": "", "device": "", "seconds_per_measurement": math.nan}
        known = {**empty, **texts, **content}
        return cls(**{field.name: known[field.name] for field in fields(cls) if field.name in known})


def with_effects(name: str, effects: Iterable[str]) -> str:
    """Return an encoder's name with those of its effects, such as ``lsw_sr + mask_shift``."""
    return " + ".join([name, *effects])


def write_json(content: Mapping[str, Any], path: str | Path) -> None:
    """Write JSON whole or not at all."""
    with atomic_write(path) as temporary:
        temporary.write_text(json.dumps(content, indent=1) + "\n")


def print_results(metrics: RunMetrics, console: PlainConsole) -> None:
    """Print a table of the scenes, their mean, and the baseline in which every frame is the mean measurement."""
    encoder, tested = with_effects(metrics.encoder, metrics.effects), metrics.test_encoder
    tested = with_effects(tested, metrics.test_effects)
    trained = f"trained on {encoder}, " if metrics.parameters else ""
    title = f"{metrics.decoder}, {trained}tested on {tested}"
    conventions = "\n".join(f"{UNITS.get(key, key)}: {text}" for key, text in metrics.conventions.items())
    table = Table(title=title, title_justify="left", caption=conventions or None, caption_justify="left")
    table.add_column("scene")
    keys = list(metrics.mean)
    for key in keys:
        table.add_column(UNITS.get(key, key), justify="right")
    for name, values in [*metrics.scenes.items(), ("mean", metrics.mean)]:
        table.add_row(name, *(number(key, values[key]) for key in keys), style="bold" if name == "mean" else "")
    baseline = (number(key, metrics.baseline[key]) for key in keys)
    table.add_row("every frame = mean measurement", *baseline, style="dim")
    console.print(table)


def number(key: str, value: float) -> str:
    """Return a value with the digits that its metric is printed with."""
    return f"{value:.4f}" if key == "ssim" else f"{value:.2f}"


def hparams(metrics: RunMetrics) -> dict[str, Any]:
    """Return the choices that tell runs apart, flat, for TensorBoard's table of hyper-parameters."""
    config = metrics.config
    return {
        "encoder": metrics.encoder,
        "decoder": metrics.decoder,
        "effects": ", ".join(metrics.effects) or "none",
        "mask_bits": config["encoder"]["mask"].get("bits", 1),
        **{key: config[key] for key in ("scale", "frames", "batch_size", "seed")},
        **{key: config["system"][key] for key in ("loss", "lr", "final_lr")},
        "size": "x".join(map(str, config["size"])),
        **metrics.conventions,
    }
