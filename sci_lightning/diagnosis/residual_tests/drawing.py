"""Pictures of residual tests on axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.image import AxesImage

from sci_lightning.diagnosis.residual_tests.residual_test import Picture

MAX_SCALE_RATIO = 3.0
"""Factor between two scales beyond which what fills the smaller one can no longer be made out on the larger."""
OWN = "after, on its own scale"
MAX_BAR_LABELS = 10
"""Bars at most that are labelled one by one."""


def draw_test(
    figure: FigureBase,
    pictures: Sequence[Picture],
    titles: Sequence[str],
    colours: Sequence[str],
    own: bool = False,
) -> None:
    """Draw pictures of one test of several models, side by side and to the same scale.

    Args:
        figure: where to.
        pictures: of the same kind.
        titles: one for each.
        colours: of curves and bars, one for each.
        own: whether the last picture is drawn once more, on its own scale; see :func:`hidden_by`.
    """
    count = len(pictures)
    panels = list(zip(pictures, titles, colours, [limits(pictures)] * count, strict=True))
    if own:
        panels.append((pictures[-1], OWN, colours[-1], limits(pictures[-1:])))
    grid = figure.subplots(1, len(panels), squeeze=False)[0]
    images = []
    for axes, (picture, title, colour, (low, high)) in zip(grid, panels, strict=True):
        axes.set_title(title, loc="left")
        if picture.kind == "map":
            images.append(draw_map(axes, picture, low, high))
            continue
        (_curve if picture.kind == "curve" else _bars)(axes, picture, colour)
        axes.set_ylim(low, high)
        axes.axhline(picture.middle, color="#8a8f98", linewidth=0.8, zorder=0)
        axes.set_xlabel(picture.axes[0])
    if not images:
        grid[0].set_ylabel(pictures[0].unit)
        for axes in grid[1:count]:
            axes.tick_params(labelleft=False)
    for image, panel in zip(images[count - 1 :], (grid[:count], grid[count:]), strict=False):
        figure.colorbar(image, ax=list(panel), shrink=0.85, label=pictures[0].unit).outline.set_visible(False)


def hidden_by(before: Picture, after: Picture) -> bool:
    """Return whether a picture could not be made out if it were drawn only on the scale of the one before."""
    spans = [high - low for low, high in (limits([before, after]), limits([after]))]
    return spans[0] > MAX_SCALE_RATIO * spans[1]


def draw_map(axes: Axes, picture: Picture, low: float, high: float) -> AxesImage:
    """A map in colours that go two ways from its middle; returns the image, for a colour bar."""
    values = np.ma.masked_invalid(picture.values.numpy())
    drawn = axes.imshow(values, cmap="RdBu_r", vmin=low, vmax=high, extent=picture.extent, interpolation="nearest")
    axes.set_xlabel(picture.axes[0])
    axes.set_ylabel(picture.axes[1])
    axes.spines[:].set_visible(False)
    return drawn


def nearly_largest(values: torch.Tensor) -> float:
    """Return the 99.8 % quantile; of about a million values where there are more, which torch would refuse."""
    return float(torch.quantile(values.flatten()[:: max(1, values.numel() // 10**6)], 0.998))


def limits(pictures: Sequence[Picture]) -> tuple[float, float]:
    """Values between which all the pictures are drawn: symmetrical for maps, a few far ones cut off."""
    middle = pictures[0].middle
    away = torch.cat([(entry.values.double() - middle).flatten() for entry in pictures])
    away = away[away.isfinite()]
    if not len(away):
        return middle - 1, middle + 1
    if pictures[0].kind == "map":
        far = max(nearly_largest(away.abs()), 3.0 if middle == 0 and pictures[0].unit == "standard errors" else 1e-6)
        return middle - far, middle + far
    own = 1.0 if pictures[0].unit == "standard errors" else 0.0
    errors = [entry.errors if entry.errors is not None else torch.full_like(entry.values, own) for entry in pictures]
    spread = torch.cat([entry.double().flatten() for entry in errors]).nan_to_num(0.0)
    low, high = float((away - 2 * spread).min()), float((away + 2 * spread).max())
    margin = 0.06 * max(high - low, 1e-9)
    return middle + low - margin, middle + high + margin


def _curve(axes: Axes, picture: Picture, colour: str) -> None:
    place, values = np.array(picture.x, float), picture.values.numpy()
    if picture.errors is not None:
        band = 2 * picture.errors.numpy()
        axes.fill_between(place, values - band, values + band, color=colour, alpha=0.22, linewidth=0)
    axes.plot(place, values, color=colour, linewidth=1.2, marker="." if len(place) < 60 else "", markersize=4)


def _bars(axes: Axes, picture: Picture, colour: str) -> None:
    values = picture.values.numpy()
    place = np.arange(len(values))
    errors = None if picture.errors is None else 2 * picture.errors.numpy()
    axes.bar(place, values, width=0.7, color=colour, yerr=errors, error_kw={"elinewidth": 0.9, "ecolor": "#8a8f98"})
    every = max(1, -(-len(values) // MAX_BAR_LABELS))
    labels = [str(entry) for entry in picture.x][::every]
    turned = max(map(len, labels), default=0) > 3 and sum(map(len, labels)) > 24
    axes.set_xticks(place[::every], labels, rotation=30 if turned else 0, ha="right" if turned else "center")
