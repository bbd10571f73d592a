"""The paper's figures: what they show of runs, and of the encoders themselves."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from sci_lightning.encoder import Encoder
from sci_lightning.encoder.mask import LearnedStructural, RandomBinary
from sci_lightning.encoder.sensor import ClipQuantise, Ideal
from sci_lightning.studies.figures.dynamic_range import checker, distinguishable_steps, patch_error, wedge
from sci_lightning.studies.tables.cost import cost_figure
from sci_lightning.studies.tables.paper_figures import paper_figures
from sci_lightning.studies.tables.run import find_runs
from tests.studies.tables.conftest import Made
from tests.training.small_training import TINY

PAPER: dict[str, Any] = paper_figures()


def test_told_apart() -> None:
    exact = torch.linspace(0, 1, 11)[:, None].expand(-1, 500)
    assert distinguishable_steps(exact) == 11
    assert distinguishable_steps(torch.zeros(11, 500)) == 1
    noise = torch.randn(11, 500, generator=torch.Generator().manual_seed(0))
    assert distinguishable_steps(exact + 0.1 * noise) in (5, 6, 7)  # two pixels differ by 0.14: every other step
    assert distinguishable_steps(exact.clamp(max=0.5)) == 6


def test_a_sensor_limits_the_range_and_a_structural_mask_wins_it_back() -> None:
    masks = {"random": RandomBinary(8, (32, 32)), "structural": LearnedStructural(4, 8, (32, 32))}
    ideal = wedge(Encoder(masks["random"], Ideal(), aperture=1.0))
    assert distinguishable_steps(ideal) == len(ideal) == 256
    torch.testing.assert_close(ideal.mean(1), torch.linspace(0, 1, 256))
    random, structural = (wedge(Encoder(mask, ClipQuantise(8, 10000, 1.0))) for mask in masks.values())
    assert random.shape[1] < 1024 == structural.shape[1]  # of a random mask some pixels never open
    assert distinguishable_steps(random) < distinguishable_steps(structural) < 256
    noiseless = Encoder(masks["structural"], ClipQuantise(8))
    assert distinguishable_steps(wedge(noiseless)) == 256 and distinguishable_steps(wedge(noiseless, 512)) == 256


def test_cost_figure(made: Made, tmp_path: Path) -> None:
    made("a", "lsw_sr", "e2e_cnn", 30.0, bits=4)
    made("b", "lsw_sr", "e2e_cnn", 32.0, bits=4, seed=1)
    made("c", "lsw_sr", "res2former", 35.0, bits=4, scale="paper")
    figure = cost_figure(PAPER["tables"]["table4"], find_runs([tmp_path])[0], PAPER["decoders"])
    titles = ["the paper: 256 x 256", "ours, paper: 64 x 64, 3 scenes", "ours, small: 64 x 64, 3 scenes"]
    panels = {axes.get_title(): axes for axes in figure.axes}
    assert sorted(panels) == sorted(titles)
    points = {title: [tuple(dot.get_offsets()[0]) for dot in panels[title].collections[:-2]] for title in titles}
    assert points[titles[0]][:2] == [(53.49, 29.45), (53.49, 32.42)] and len(points[titles[0]]) == 8
    assert points[titles[1]] == [(1e-6, 35.0)] and points[titles[2]] == [(1e-6, 31.0)]  # the mean of two seeds
    areas = [dot.get_sizes()[0] for dot in panels[titles[0]].collections[:2]]
    assert areas[0] == pytest.approx(700 * 0.82 / 19.48)


@pytest.mark.slow
def test_mosaics_of_trained_runs(ran: Callable[..., str], tmp_path: Path) -> None:
    for encoder in ("rbw_sr", "lsw_sr"):
        quick = ["size=[32,32]", "data.clips_per_epoch=2", "trainer.max_epochs=1", "metrics.qscore=null", "logger=none"]
        ran("train", *TINY, *quick, f"encoder={encoder}", f"out=runs/{encoder}", "trainer.accelerator=cpu")
    small = ["decoder=revsci", "decoder.blocks=2", "decoder.channels=4"]
    words = [word for word in TINY if not word.startswith("decoder")]
    ran("train", *words, *quick, *small, "encoder=rbw_sr", "out=runs/revsci", "trainer.accelerator=cpu")
    assert "mosaic_own_e2e_cnn" in ran("tables", "runs=runs", "out=out", "mosaic=24")
    with Image.open(tmp_path / "out" / "mosaic_own_e2e_cnn.png") as picture:
        assert picture.height > 400
    with Image.open(tmp_path / "out" / "retrained_own.png") as picture:
        assert picture.width > 2 * picture.height  # the truth and two networks
    with Image.open(tmp_path / "out" / "colour_checker_own_e2e_cnn.png") as picture:
        assert picture.width > 2 * picture.height  # the truth and two encoders


def test_colour_checker() -> None:
    video = checker(3, (96, 144))
    assert video.shape == (3, 96, 144) and torch.equal(video[0], video[2])
    assert len(video[0].unique()) == 19  # black, and 18 values among the 24 patches
    assert video[0, -12, 12] == 1 and video[0, 0, 0] == 0 and patch_error(video[0]) < 1e-6
    assert patch_error(video[0].clamp(max=0.5)) > 0.05 and patch_error(video[0] + 0.1) == pytest.approx(0.1, rel=0.02)


def test_a_network_stands_beside_its_own_circle() -> None:
    figure = cost_figure(PAPER["tables"]["table4"], [], PAPER["decoders"])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    (axes,) = figure.axes
    labels = {text.get_text().split(",")[0]: text for text in axes.texts}
    boxes = {name: text.get_window_extent() for name, text in labels.items()}
    assert len(labels) == 5
    for name, text in labels.items():
        x, y = axes.transData.transform(text.xy)
        box = boxes[name]
        assert not any(other.overlaps(box) for key, other in boxes.items() if key != name)
        beside, above = abs(box.y0 + box.y1 - 2 * y) < 4, abs(box.x0 + box.x1 - 2 * x) < 4
        assert beside or (above and not name.startswith("Res2former"))
