"""The contact sheet shows every kind, what is dark and what is saturated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.image import imread

from sci_lightning.captures import read_captures
from sci_lightning.captures.contact_sheet import MOST, RED, contact_sheet, contact_sheet_figure, selected


def texts(figure):
    figure.canvas.draw()
    result = [figure.get_suptitle()]
    for part in figure.subfigs:
        for axes in part.axes:
            result += [axes.get_title(), *(text.get_text() for text in axes.texts)]
    return result


@pytest.mark.parametrize("size", [(5, 6), (400, 300), (3, 2000)])
def test_png(file, tmp_path, size):
    captures = read_captures(file())
    rows, columns = (np.arange(side) % old for side, old in zip(size, captures.size, strict=True))
    large = {name: getattr(captures, name)[..., rows, :][..., columns] for name in ("patterns", "measurement", "scene")}
    assert contact_sheet(tmp_path / "deep" / "sheet.png", replace(captures, **large)) == 0
    height, width = imread(tmp_path / "deep" / "sheet.png").shape[:2]
    assert 300 < height < 1500 and 900 < width < 2500
    assert 5000 < (tmp_path / "deep" / "sheet.png").stat().st_size < 2_000_000


def test_labels_stretch_and_saturation(file):
    measurement = np.full((3, 5, 6), 100, np.uint8)
    measurement[0] = np.arange(30).reshape(5, 6) % 8 + 3
    measurement[1, 2, 2] = 255
    path = file(
        measurement=measurement,
        kind=["dark", "flat", "flat"],
        exposure=np.array([2, 1, 1]),
        aperture=np.array([1, 0.25, 1]),
        attrs={"name": "a $name$ that is no formula and goes on and on"},
    )
    figure = contact_sheet_figure(read_captures(path))
    result = texts(figure)
    assert "0 dark\nmean 6.3 DN" in result and "1 flat\nmean 105 DN" in result
    assert "exposure 2\nstretched: 3 to 10 DN" in result and "aperture 0.25" in result
    images = [axes.images[0].get_array() for axes in figure.subfigs[1].axes if axes.images]
    np.testing.assert_allclose(images[1][2, 2], RED)
    assert (images[1] == images[1][..., :1]).all(-1).sum() == 29  # all others are grey
    assert images[0].max() == 1 and images[0].min() == 0


def test_no_more_than_sixty_and_every_kind(file, tmp_path):
    captures = read_captures(file()).take([*[0] * 100, 1, *[2] * 40])
    shown = selected(captures.kind)
    assert len(shown) == MOST == len(set(shown)) and shown == sorted(shown)
    assert 100 in shown and {0, 99, 101, 140} <= set(shown)
    assert contact_sheet(tmp_path / "a.png", captures) == 81
    assert "141 captures (60 shown, 81 left out)" in texts(contact_sheet_figure(captures))[0]
    assert selected(("flat",) * 3) == [0, 1, 2]


def test_failure_leaves_nothing(file, tmp_path, monkeypatch):
    captures = read_captures(file())

    def interrupt(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("matplotlib.figure.Figure.savefig", interrupt)
    with pytest.raises(KeyboardInterrupt):
        contact_sheet(tmp_path / "out" / "a.png", captures)
    assert not list((tmp_path / "out").iterdir())
