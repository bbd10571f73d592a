"""The trainings that Tables 2 to 5 need, in the order in which they are run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

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


def plan(tables: Mapping[str, Any], seeds: int, only: Sequence[str] = (), other_seeds: int = 1) -> list[TableRow]:
    """Return every training of the tables, those first that decide claims.

    The order: the deciding rows of seed 0, then of seed 1 (from two seeds on there are intervals), then all other rows,
    then the deciding rows of the further seeds, at last the other rows of theirs.

    Args:
        tables: of ``paper_figures.yaml``.
        seeds: seeds of the deciding rows.
        only: parts of names of tables or rows (``table5``, ``res2former``); empty for all.
        other_seeds: seeds of every other row.
    """
    rows = [row for row in _single(tables) if not only or any(part in (row[0], *row[1].name.split("/")) or
            part in row[1].name for part in only)]  # fmt: skip
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
    return [TableRow(row.experiment, row.encoder, row.bits, row.decoder, seed, row.tests) for row in rows]
