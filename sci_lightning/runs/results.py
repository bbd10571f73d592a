"""The results of a run: ``metrics.json`` and the table on the terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal

from rich.table import Table

from sci_lightning.configuration.bounds import CHANNELS
from sci_lightning.console import PlainConsole
from sci_lightning.files.json_file import JsonFile, says
from sci_lightning.runs.cluster_job import ClusterJob
from sci_lightning.runs.provenance import Provenance

MOST = 10**18
"""Parameters and multiply-accumulates of a network."""

UNITS = {"psnr": "PSNR (dB)", "ssim": "SSIM", "qscore": "Q-Score"}


Scores = dict[str, float]
"""PSNR in dB, SSIM, Q-Score and others by the name of the metric."""


class RunMetrics(JsonFile):
    """``metrics.json``: what a run was, and how well it reconstructs; written when the run is finished."""

    format: Literal["sci-metrics"] = "sci-metrics"
    format_version: Literal[1] = 1
    encoder: str = says("that the decoder was trained with, as the configuration calls it")
    decoder: str = says("as the configuration calls it")
    test_encoder: str = says("that took the tested measurements")
    effects: list[str] = says("of the encoder that was trained with, in the order of the light", default=[])
    test_effects: list[str] = says("of the encoder that was tested with; absent for a real camera", default=[])
    scenes: dict[str, Scores] = says("metrics of every tested scene by its name, means over its snapshots")
    mean: Scores = says("means over the scenes")
    conventions: dict[str, str] = says("how a metric is computed where there is more than one way", default={})
    baseline: Scores = says("means of an estimate in which every frame is the mean measurement", default={})
    seconds_per_measurement: float = says("median time to decode one")
    device: str = says("on which it was decoded")
    parameters: int = says("that the decoder learned", ge=0, le=MOST)
    macs: int = says("multiply-accumulates to decode one measurement of the mask's size", ge=0, le=MOST)
    training_steps: int | None = says("of the optimiser in the whole training, if it recorded them", default=None, ge=0)
    clips_seen: int | None = says(
        "in the whole training, where they are not its steps times the batch", default=None, ge=0
    )
    config: Mapping[str, Any] = says("the run's plain configuration")
    mask_score: float | None = says("dB expected of a linear decoder behind the mask, in kept rows", default=None)
    job: ClusterJob | None = says("of the cluster that computed the run", default=None)
    provenance: Provenance | None = says("in rows that are kept for the tables", default=None)

    def as_json(self) -> dict[str, Any]:
        """Return the content of the file; effects and training steps are absent where there are none."""
        return {key: value for key, value in super().as_json().items() if value is not None and value != []}


def with_effects(name: str, effects: Iterable[str]) -> str:
    """Return an encoder's name with those of its effects, such as ``lsw_sr + mask_shift``."""
    return " + ".join([name, *effects])


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
        name, _, channel = key.rpartition("_")
        table.add_column(f"{name.upper()} {channel}" if channel in CHANNELS else UNITS.get(key, key), justify="right")
    for name, values in [*metrics.scenes.items(), ("mean", metrics.mean)]:
        table.add_row(name, *(number(key, values[key]) for key in keys), style="bold" if name == "mean" else "")
    baseline = (number(key, metrics.baseline[key]) for key in keys)
    table.add_row("every frame = mean measurement", *baseline, style="dim")
    console.print(table)


def number(key: str, value: float) -> str:
    """Return a value with the digits that its metric is printed with."""
    return f"{value:.4f}" if key.startswith("ssim") else f"{value:.2f}"


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
