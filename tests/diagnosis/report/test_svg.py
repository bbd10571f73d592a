"""Figures inside a page."""

from __future__ import annotations

import xml.etree.ElementTree as ET

from matplotlib.figure import Figure

from sci_lightning.diagnosis.report.svg import BEFORE, INK, style, svg


def drawn() -> str:
    with style():
        figure = Figure(figsize=(3, 2), layout="constrained")
        axes = figure.subplots()
        axes.plot([0, 1], color=BEFORE)
        axes.set_xlabel("place <pixel>")
    return svg(figure, "a line")


def test_it_is_one_element_in_the_colour_and_type_of_the_page() -> None:
    text = drawn()
    root = ET.fromstring(text.replace("<svg ", '<svg xmlns="http://www.w3.org/2000/svg" ', 1))
    assert root.get("aria-label") == "a line"
    assert "place &lt;pixel&gt;" in text  # text remains text
    assert "currentColor" in text and INK not in text
    assert BEFORE in text
    assert "DejaVu" not in text


def test_it_is_the_same_every_time() -> None:
    assert drawn() == drawn()
