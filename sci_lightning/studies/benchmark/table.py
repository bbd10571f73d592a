"""The tables of a benchmark: on the terminal, as Markdown, and in the documentation."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from statistics import median
from typing import Any

from rich import box
from rich.table import Table

from sci_lightning.plain_text import markdown_table

Column = Callable[[Mapping[str, Any]], str]
Rows = list[list[str]]

SHORT = {"32-true": "float32", "bf16-mixed": "bfloat16", "16-mixed": "float16"}
"""What a precision is called in a table."""

COUNTS: dict[str, Column] = {
    "params (M)": lambda cost: f"{cost['parameters'] / 1e6:.2f}" if cost["parameters"] else "",
    "MACs (G)": lambda cost: f"{cost['macs'] / 1e9:.2f}" if cost["macs"] else "",
    "as the paper counts": lambda cost: f"{cost['macs_as_paper'] / 1e9:.2f}" if cost["macs_as_paper"] else "",
}
PAPER: dict[str, Column] = {
    "params (M)": lambda cost: f"{cost['paper']['parameters_M']:.2f}",
    "as the paper counts": lambda cost: f"{cost['paper']['macs_G']:.2f}",
}
SPEEDS = {
    "product_gflops": "matrix product of side {product}",
    "convolution_gflops": "3 x 3 convolution, 64 to 64 channels",
    "convolution_training_gflops": "the same with its gradients",
}


def title(content: Mapping[str, Any]) -> str:
    """Return what was measured, and on what."""
    sides, compiled = " x ".join(map(str, content["size"])), ", compiled" if content["compile"] else ""
    return (
        f"{sides}, T = {content['frames']}, on {content['device']}{compiled}; "
        f"decoded: {content['scene']}, {content['weights']}"
    )


def tables(content: Mapping[str, Any]) -> dict[str, Rows]:
    """Return heading and rows of every table by name; columns and tables without any figure are left out.

    ``counts``: parameters and operations, in brackets the paper's where it was the same measurement. ``forward``:
    decoding by precision. ``training``: training steps by precision.
    ``machine``: the machine's own speed.

    Args:
        content: of ``benchmark.json``.
    """
    built = {
        "counts": _counts(content),
        "forward": _by_precision(content, _forward_columns(content)),
        "training": _by_precision(content, _training_columns(content)),
        "machine": _machine(content),
    }
    return {name: filled for name, rows in built.items() if len((filled := _filled(rows))[0]) > 1 and len(filled) > 1}


def as_tables(content: Mapping[str, Any]) -> list[Table]:
    """Return the tables for the terminal."""
    shown = []
    for number, (heading, *body) in enumerate(tables(content).values()):
        about = {} if number else {"title": title(content), "title_justify": "left"}
        table = Table(**about, box=box.SIMPLE_HEAD)  # type: ignore[arg-type]
        for place, column in enumerate(heading):
            table.add_column(column, justify="right" if place else "left", no_wrap=not place)
        for row in body:
            table.add_row(*row)
        shown.append(table)
    return shown


def as_markdown(content: Mapping[str, Any]) -> str:
    """Return the tables as Markdown."""
    lines = [title(content), ""]
    for heading, *body in tables(content).values():
        lines += [markdown_table(heading, body, right=range(1, len(heading))), ""]
    return "\n".join(lines)


def _counts(content: Mapping[str, Any]) -> Rows:
    comparable = (content["frames"], *content["size"]) == (8, 256, 256)
    body = []
    for name, cost in content["decoders"].items():
        cells = []
        for heading, column in COUNTS.items():
            paper = PAPER[heading](cost) if comparable and "paper" in cost and heading in PAPER else ""
            cells.append(f"{column(cost)} ({paper})" if paper else column(cost))
        body.append([name, *cells])
    return [["decoder", *COUNTS], *body]


def _forward_columns(content: Mapping[str, Any]) -> Callable[[Mapping[str, Any], str], dict[str, str]]:
    exact = content["precisions"][0]

    def cells(cost: Mapping[str, Any], precision: str) -> dict[str, str]:
        own, speed = cost["precisions"][precision], cost.get("machine", {}).get(precision)
        shares = speed if speed and cost["macs"] else {}
        return {
            "time (s)": f"{own['seconds']:.3g}",
            "memory (MiB)": f"{own['memory'] / 2**20:.0f}" if "memory" in own else "",
            "GFLOP/s": f"{own['gflops']:.0f}" if cost["macs"] else "",
            "of matmul": f"{own['gflops'] / shares['product_gflops']:.0%}" if shares else "",
            "of conv": f"{own['gflops'] / shares['convolution_gflops']:.0%}" if shares else "",
            "dB lost": "" if precision == exact else f"{cost['precisions'][exact]['psnr'] - own['psnr']:.3f}",
        }

    return cells


def _training_columns(content: Mapping[str, Any]) -> Callable[[Mapping[str, Any], str], dict[str, str]]:
    exact = content["precisions"][0]

    def cells(cost: Mapping[str, Any], precision: str) -> dict[str, str]:
        if "training" not in cost:
            return {}
        training = cost["training"]
        own = training["precisions"][precision]
        speed = cost.get("machine", {}).get(precision, {}).get("convolution_training_gflops")
        return {
            "snapshots": str(training["snapshots"]),
            "training step (s)": f"{own['seconds']:.3g}",
            "GFLOP/s": f"{own['gflops']:.0f}",
            "of conv": f"{own['gflops'] / speed:.0%}" if speed else "",
            "times as fast": "" if precision == exact else f"{training['times_as_fast']:.2f}",
        }

    return cells


def _by_precision(content: Mapping[str, Any], columns: Callable[[Mapping[str, Any], str], dict[str, str]]) -> Rows:
    """Return one row for every decoder and precision that has cells."""
    rows, heading = [], ["decoder", "precision"]
    for name, cost in content["decoders"].items():
        for precision in content["precisions"]:
            if cells := columns(cost, precision):
                heading = ["decoder", "precision", *cells]
                rows.append([name, SHORT[precision], *cells.values()])
    return [heading, *rows]


def _machine(content: Mapping[str, Any]) -> Rows:
    """Return the machine's own speed, the median over the decoders that it was measured beside."""
    costs = [cost["machine"] for cost in content["decoders"].values() if "machine" in cost]
    rows = [["the machine's own speed, GFLOP/s", *(SHORT[precision] for precision in content["precisions"])]]
    for key, name in SPEEDS.items():
        speeds = [
            [cost[precision][key] for cost in costs if key in cost[precision]] for precision in content["precisions"]
        ]
        if all(speeds):
            rows.append([name.format(**content), *(f"{median(values):.0f}" for values in speeds)])
    return rows


def _filled(rows: Rows) -> Rows:
    """Return rows without the columns that are empty below their heading."""
    filled = [place for place in range(len(rows[0])) if not place or any(row[place] for row in rows[1:])]
    return [[row[place] for place in filled] for row in rows]
