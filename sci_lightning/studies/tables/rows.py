"""The trainings that Tables 2 to 5 need, in the order in which they are run, and what is kept of each: its metrics."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sci_lightning.errors import BadInput
from sci_lightning.files.json_file import read_json, write_json
from sci_lightning.runs.provenance import Provenance
from sci_lightning.runs.results import RunMetrics
from sci_lightning.studies.tables.line import lines_of

DECIDING = (
    {"decoder": "e2e_cnn"},
    {"decoder": "res2former", "bits": 1},
    {"decoder": "res2former", "bits": 4},
)
"""Rows that decide a claim by themselves, of which every seed is trained: E2E-CNN in all columns, Res2former at 1 and 4
bits. The spread of their seeds holds for the other rows as well (sci_lightning/studies/tables/verdict.py)."""


@dataclass(frozen=True)
class TableRow:
    """One training of one seed.

    Attributes:
        experiment: of ``conf/experiment``, the first table that needs it.
        encoder, decoder: of the groups of these names.
        bits: of the mask.
        seed: of everything random in the training.
        tests: encoders, besides its own, behind which it is tested.
    """

    experiment: str
    encoder: str
    bits: int
    decoder: str
    seed: int = 0
    tests: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The name of the row's folder of results, such as ``lsw_sr_4bit_e2e_cnn``."""
        return f"{self.encoder}_{self.bits}bit_{self.decoder}"

    @property
    def folder(self) -> str:
        """The folder of the training below the sweep's, as ``conf/experiment/sweep.yaml`` has it."""
        return f"{self.encoder}_{self.bits}bit/{self.decoder}/seed{self.seed}"

    def overrides(self) -> list[str]:
        """Return what makes a ``train`` of it."""
        choices = [f"experiment={self.experiment}", f"encoder={self.encoder}", f"decoder={self.decoder}"]
        return [*choices, f"encoder.mask.bits={self.bits}", f"seed={self.seed}"]


CONTROLS = (
    *(TableRow("table4", "fsw_sr", 4, decoder) for decoder in ("e2e_cnn", "revsci", "stformer")),
    *(TableRow("table5", "fsw_sr", bits, "res2former") for bits in (2, 3, 4)),
    TableRow("table5", "lsw_index_sr", 1, "res2former"),
)
"""Trainings without which claims about learned masks cannot be told from claims about their start; the paper has none.

``fsw_sr`` is the start of ``lsw_sr``'s mask, never trained: of one seed both have the same start, and over the seeds it
is a random mask of that sharpness. At 1 bit the sharpness changes nothing, so that ``rsw_sr`` is that control.
``lsw_index_sr`` learns 1 bit as the released code means it."""


def plan(tables: Mapping[str, Any], seeds: int, only: Sequence[str] = (), other_seeds: int = 1) -> list[TableRow]:
    """Return every training of the tables and their controls, those first that decide claims.

    The order: the deciding rows of seed 0, then of seed 1 (from two seeds on there are intervals), then all other rows,
    then the deciding rows of the further seeds, at last the other rows of theirs.

    Args:
        tables: of ``paper_figures.yaml``.
        seeds: seeds of the deciding rows.
        only: parts of names of tables or rows (``table5``, ``res2former``), or ``controls``; empty for all.
        other_seeds: seeds of every other row.
    """
    every = [*_single(tables), *(("controls", row) for row in CONTROLS)]
    rows = [(name, row) for name, row in every if not only or any(part == name or part in row.name for part in only)]
    first = list(dict.fromkeys(row for _, row in rows))
    deciding = [row for row in first if _decides(row)]
    others = [row for row in first if not _decides(row)]
    waves = [_with_seed(deciding, seed) for seed in range(seeds)]
    further = [_with_seed(others, seed) for seed in range(1, other_seeds)]
    return [row for wave in (*waves[:2], others, *waves[2:], *further) for row in wave]


def _single(tables: Mapping[str, Any]) -> Iterable[tuple[str, TableRow]]:
    """Every table's rows with seed 0; a row that several tables need belongs to all of them and is the same row."""
    wanted: dict[tuple[str, int, str], tuple[str, list[str]]] = {}
    belongs: list[tuple[str, tuple[str, int, str]]] = []
    for name, table in tables.items():
        for line in lines_of(table, []):
            fields = {**table["columns"][line.column], **table["rows"][line.row]["match"]}
            key = (str(fields["encoder"]), int(fields.get("bits", 1)), str(fields["decoder"]))
            _, tests = wanted.setdefault(key, (name, []))
            if fields["test_encoder"] not in (key[0], *tests):
                tests.append(str(fields["test_encoder"]))
            belongs.append((name, key))
    for name, key in belongs:
        yield name, TableRow(wanted[key][0], *key, tests=tuple(wanted[key][1]))


def _decides(row: TableRow) -> bool:
    return any(all(getattr(row, key) == value for key, value in kind.items()) for kind in DECIDING)


def _with_seed(rows: Iterable[TableRow], seed: int) -> list[TableRow]:
    return [replace(row, seed=seed) for row in rows]


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
        write_json({**without_places(content), **score, "provenance": provenance.as_json()}, path)
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
    earlier, now = read_json(path, RunMetrics).config, without_places(config)
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


def without_places(content: Any) -> Any:
    """Plain values with the last part of paths in their place: folders of one machine say nothing to others."""
    if isinstance(content, Mapping):
        return {key: without_places(value) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [without_places(value) for value in content]
    if isinstance(content, str) and "/" in content and " " not in content and content != "1/T":  # an aperture
        return os.path.basename(content.rstrip("/"))
    return content
