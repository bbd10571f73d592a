"""What is kept of a finished row: its metrics, with their provenance and without the places of one machine."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput
from sci_lightning.files.json_file import read_json, write_json
from sci_lightning.runs.provenance import Provenance
from sci_lightning.runs.results import RunMetrics
from sci_lightning.studies.tables.rows.plan import TableRow

RECIPE = (
    "batch_size",
    "benchmark",
    "core_minutes",
    "crop",
    "data",
    "decoder",
    "encoder",
    "frames",
    "initialisation",
    "precision",
    "size",
    "system",
    "trainer.accumulate_grad_batches",
    "trainer.gradient_clip_val",
    "trainer.limit_train_batches",
    "trainer.max_epochs",
    "trainer.max_steps",
    "trainer.max_time",
)
"""Entries of a configuration that rows of one table must share with the present one, as far as both have them."""

NO_RECIPE = ("root", "store", "val_root", "compile", "cuda_graph")
"""Settings that say where something lies on one machine, and those that change how fast a step is, not what it does."""


def kept_files(row: TableRow, results: str | Path) -> list[Path]:
    """Return the files that are kept of a row: its test, and one for every further encoder that it is tested behind."""
    results = Path(results)
    names = ["", *(f"_{test}" for test in row.tests)]
    return [results / row.name / f"seed{row.seed}{name}.json" for name in names]


def is_kept(row: TableRow, results: str | Path) -> bool:
    """Return whether everything is kept of a row."""
    results = Path(results)
    return all(path.is_file() for path in kept_files(row, results))


def keep(row: TableRow, run: str | Path, results: str | Path, provenance: Provenance) -> list[Path]:
    """Copy the metrics of a finished training to the results; the file of its own test comes last.

    Args:
        row: that was trained.
        run: the training's folder.
        results: the folder of all rows' results.
        provenance: of the training.

    The score of the mask that was trained, see :class:`~sci_lightning.prior.MaskScore`, is added.

    Returns:
        the files that were written.
    """
    run = Path(run)
    results = Path(results)
    files = kept_files(row, results)
    score = _mask_score(run)
    sources = [run / "metrics.json", *(run / f"test_{test}" / "metrics.json" for test in row.tests)]
    for source, path in reversed(list(zip(sources, files, strict=True))):
        content = json.loads(source.read_text())
        path.parent.mkdir(parents=True, exist_ok=True)
        write_json({**_without_places(content), **score, "provenance": provenance.as_json()}, path)
    return files


def _mask_score(run: Path) -> dict[str, float]:
    """Return what the best linear decoder is expected to reach behind the trained mask, in dB; empty without a mask."""
    import torch

    from sci_lightning.prior import MaskScore, SensorNoise
    from sci_lightning.runs.checkpoint import read_checkpoint

    checkpoint = run / "checkpoints" / "last.ckpt"
    if not checkpoint.is_file():
        return {}
    encoder = read_checkpoint(checkpoint).encoder()
    keys = ("bit_depth", "read_noise", "full_well")
    stated = {key: getattr(encoder.sensor, key) for key in keys if hasattr(encoder.sensor, key)}
    noise = SensorNoise(**{"bit_depth": None, **stated})
    with torch.no_grad():
        mask = encoder.mask()
        return {"mask_score": float(MaskScore(len(mask), noise)(mask))}


def check_recipe(row: TableRow, results: str | Path, config: Mapping[str, Any]) -> None:
    """Check that a kept row was trained as it would be trained now; two recipes in one table would mislead.

    Args:
        row: that is kept.
        results: the folder of all rows' results.
        config: what the row would be trained with now, composed and plain.

    Raises:
        BadInput: it was trained otherwise.
    """
    results = Path(results)
    path = kept_files(row, results)[0]
    earlier, now = read_json(path, RunMetrics).config, _without_places(config)
    for key in RECIPE:
        before, after = _flat(_entry(earlier, key), key), _flat(_entry(now, key), key)
        for name in sorted(before.keys() & after.keys()):
            if name.rpartition(".")[2] not in NO_RECIPE and before[name] != after[name]:
                raise BadInput(
                    f"{path}: trained with {name}={before[name]}, now it is {after[name]}; remove {path.parent} to "
                    "train the row again, or give label=NAME for results of their own"
                )


def _entry(config: Any, key: str) -> Any:
    """Return the entry under a dotted key; an empty mapping where there is none."""
    for part in key.split("."):
        config = config.get(part, {}) if isinstance(config, Mapping) else {}
    return config


def _flat(value: Any, key: str) -> dict[str, Any]:
    if not isinstance(value, Mapping):
        return {key: value}
    return {inner: entry for name, part in value.items() for inner, entry in _flat(part, f"{key}.{name}").items()}


def _without_places(content: Any) -> Any:
    """Plain values with the last part of paths in their place: folders of one machine say nothing to others."""
    if isinstance(content, Mapping):
        return {key: _without_places(value) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [_without_places(value) for value in content]
    if isinstance(content, str) and "/" in content and " " not in content:
        return os.path.basename(content.rstrip("/"))
    return content
