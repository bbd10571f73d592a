"""Figures as SVG inside a page, in the page's own text colour and typeface, on a light or a dark ground."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from typing import Any

from matplotlib import style as mpl_style
from matplotlib.figure import Figure

from sci_lightning.plain_text import printable

INK = "#010203"
"""Nearly black where a figure stands alone; replaced by the page's text colour inside a page."""
BEFORE, AFTER, FAINT = "#d6604d", "#2f86bf", "#8a8f98"
"""Colours of the ideal camera, of the corrected one and of neither; distinguishable on white and on black."""

STYLE: dict[str, Any] = {
    "text.color": INK,
    "axes.labelcolor": INK,
    "axes.edgecolor": INK,
    "axes.titlecolor": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.facecolor": "none",
    "legend.frameon": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "sci_lightning",
}


@contextmanager
def style() -> Iterator[None]:
    """Give all figures that are made in this context the same style."""
    with mpl_style.context(STYLE):
        yield


def svg(figure: Figure, label: str) -> str:
    """Return the figure as an ``<svg>`` element that fits its column.

    Args:
        figure: the figure.
        label: what it shows, for those who cannot see it; plain text.
    """
    with io.StringIO() as file, style():
        figure.savefig(file, format="svg", transparent=True, bbox_inches="tight", metadata={"Date": None})
        text = file.getvalue()
    text = text[text.index("<svg") :].replace(INK, "currentColor")
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(
        r' id="(?:figure|axes|patch|text|line2d|matplotlib|xtick|ytick|legend|PathCollection|QuadMesh|'
        r'FillBetweenPolyCollection|LineCollection)[^"]*"',
        "",
        text,
    )
    text = re.sub(r"'DejaVu Sans'[^;\"]*", "system-ui, sans-serif", text)
    width = figure.get_size_inches()[0] * 72
    head = re.compile(r'<svg[^>]*viewBox="([^"]*)"[^>]*>', re.DOTALL)
    return head.sub(
        lambda match: (
            f'<svg viewBox="{match[1]}" role="img" aria-label="{escape(printable(label))}" '
            f'style="max-width:{width * 1.34:.0f}px" xmlns:xlink="http://www.w3.org/1999/xlink">'
        ),
        text,
        count=1,
    )
