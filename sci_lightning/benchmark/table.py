"""The table of a benchmark: on the terminal, and as Markdown."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from rich import box
from rich.table import Table

Cost = Mapping[str, Any]

COLUMNS: dict[str, Callable[[Cost], str]] = {
    "params (M)": lambda cost: f"{cost['parameters'] / 1e6:.2f}",
    "MACs (G)": lambda cost: f"{cost['macs'] / 1e9:.2f}",
    "as the paper counts": lambda cost: f"{cost['macs_as_paper'] / 1e9:.2f}",
    "time (s)": lambda cost: f"{cost['seconds']:.3g}",
    "memory (MiB)": lambda cost: f"{cost['memory'] / 2**20:.0f}",
    "GFLOP/s": lambda cost: f"{cost['gflops']:.0f}",
    "of matmul": lambda cost: f"{cost['gflops'] / cost['product_gflops']:.0%}",
}
PAPER: dict[str, Callable[[Cost], str]] = {
    "params (M)": lambda cost: f"{cost['paper']['parameters_M']:.2f}",
    "as the paper counts": lambda cost: f"{cost['paper']['macs_G']:.2f}",
    "time (s)": lambda cost: f"{cost['paper']['seconds']:.2f}",
}


def title(content: Mapping[str, Any]) -> str:
    """What was measured, and on what."""
    sides, compiled = " x ".join(map(str, content["size"])), ", compiled" if content["compile"] else ""
    brackets = "; in brackets the paper's Table 4, whose time is of a GPU" if _comparable(content) else ""
    return f"{sides}, T = {content['frames']}, on {content['device']}, {content['precision']}{compiled}{brackets}"


def rows(content: Mapping[str, Any]) -> list[list[str]]:
    """The heading, and one row for each decoder; empty cells where there is no figure.

    The paper's figures are for 256 x 256 and T = 8, and stand beside ours at that size only.

    Args:
        found: the content of ``benchmark.json``.
    """
    body = []
    for name, cost in content["decoders"].items():
        cells = [_cell(column, cost) for column in COLUMNS.values()]
        if _comparable(content) and "paper" in cost:
            published = [_cell(PAPER[heading], cost) if heading in PAPER else "" for heading in COLUMNS]
            cells = [f"{cell} ({paper})" if paper else cell for cell, paper in zip(cells, published, strict=True)]
        body.append([name, *cells])
    return [["decoder", *COLUMNS], *body]


def as_table(content: Mapping[str, Any]) -> Table:
    """For the terminal."""
    heading, *body = rows(content)
    table = Table(title=title(content), title_justify="left", box=box.SIMPLE_HEAD)
    for number, column in enumerate(heading):
        table.add_column(column, justify="right" if number else "left", no_wrap=not number)
    for row in body:
        table.add_row(*row)
    return table


def as_markdown(content: Mapping[str, Any]) -> str:
    """For a README."""
    heading, *body = rows(content)
    ruled = [heading, ["---", *["---:"] * (len(heading) - 1)], *body]
    return "\n".join([title(content), "", *(f"| {' | '.join(row)} |" for row in ruled), ""])


def _comparable(content: Mapping[str, Any]) -> bool:
    return (content["frames"], *content["size"]) == (8, 256, 256)


def _cell(column: Callable[[Cost], str], cost: Cost) -> str:
    try:
        return column(cost)
    except KeyError:  # this system does not tell its memory, or no matrix product was asked for
        return ""
