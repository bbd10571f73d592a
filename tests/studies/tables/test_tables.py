"""The tables, from hand-made runs."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from PIL import Image

from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.console import PlainConsole
from sci_lightning.studies.tables.grid import Grid
from sci_lightning.studies.tables.line import METRICS, lines_of
from sci_lightning.studies.tables.paper_figures import paper_figures
from sci_lightning.studies.tables.run import find_runs
from sci_lightning.studies.tables.score_table import run_table, score_table
from tests.conftest import SHARED
from tests.studies.tables.conftest import Made

PAPER: dict[str, Any] = paper_figures()
TABLES = PAPER["tables"]


def grid_of(name: str, folder: Path) -> Grid:
    return score_table(name, TABLES[name], find_runs([folder])[0])


def row(grid: Grid, *labels: str) -> list[str]:
    (result,) = [cells for cells in grid.rows if cells[: len(labels)] == list(labels)]
    return result


def test_means_spreads_and_differences(made: Made, tmp_path: Path) -> None:
    for seed, psnr in enumerate((28.0, 28.1, 28.2)):
        made(f"seed{seed}", "rbw_osr", "e2e_cnn", psnr, seed=seed)
    made("tested", "rbw_osr", "e2e_cnn", 26.5, test="rbw_sr")
    grid = grid_of("table2", tmp_path)
    ours, paper, difference, scale, seeds = row(grid, "E2E-CNN", "train RBw/oSR, test RBw/oSR")[2:]
    assert ours == "28.10 ± 0.10, 0.703 ± 0.003, 43.10 ± 0.10"
    assert paper == "29.45, 0.882, 47.31"
    assert difference == "-1.35, -0.179, -4.21"  # 28.1 / 40 - 0.882 = -0.1795
    assert (scale, seeds) == ("small: 64 x 64, 3 scenes", "3")
    assert row(grid, "E2E-CNN", "train RBw/oSR, test RBw/SR")[2] == "26.50, 0.662, 41.50"


def test_what_was_not_run_is_empty(made: Made, tmp_path: Path) -> None:
    made("a", "rbw_sr", "e2e_cnn", 20.0)
    grid = grid_of("table3", tmp_path)
    assert row(grid, "SCI3D")[2:] == ["", "27.54, 0.939, 49.51", "", "", ""]
    assert len(grid.rows) == 4


def test_settings_are_not_mixed(made: Made, tmp_path: Path) -> None:
    made("a", "rbw_sr", "e2e_cnn", 20.0)
    made("b", "rbw_sr", "e2e_cnn", 30.0, scale="paper", size=(256, 256), seed=1)
    made("c", "rbw_sr", "e2e_cnn", 25.0, size=(96, 96), seed=1)
    cells = [cells[2:] for cells in grid_of("table3", tmp_path).rows if cells[0] == "E2E-CNN"]
    assert [(each[0][:5], each[3].split(",")[0], each[4]) for each in cells] == [
        ("30.00", "paper: 256 x 256", "1"),
        ("20.00", "small: 64 x 64", "1"),
        ("25.00", "small: 96 x 96", "1"),
    ]


def test_a_metric_that_was_not_computed_is_a_dash(made: Made, tmp_path: Path) -> None:
    made("a", "rbw_sr", "e2e_cnn", 20.0, metrics=("psnr", "ssim"))
    assert row(grid_of("table3", tmp_path), "E2E-CNN")[2:5] == [
        "20.00, 0.500, -",
        "24.67, 0.878, 46.25",
        "-4.67, -0.378, -",
    ]


def test_random_and_learned_and_bits(made: Made, tmp_path: Path) -> None:
    made("r2", "rsw_sr", "res2former", 22.0, bits=2)
    made("l2", "lsw_sr", "res2former", 32.0, bits=2)
    made("l4", "lsw_sr", "res2former", 34.0, bits=4)
    made("other", "lsw_sr", "e2e_cnn", 10.0, bits=3)
    grid = grid_of("table5", tmp_path)
    result = {(cells[0], cells[1]): cells[2][:5] for cells in grid.rows if cells[2]}
    assert result == {("2-bit", "Random"): "22.00", ("2-bit", "Learned"): "32.00", ("4-bit", "Learned"): "34.00"}
    assert row(grid_of("table4", tmp_path), "Res2former")[2].startswith("34.00")  # one run serves both tables


def test_scores_of_masks_are_a_column_once_there_are_some(made: Made, tmp_path: Path) -> None:
    path = made("l2", "lsw_sr", "res2former", 32.0, bits=2)
    assert grid_of("table5", tmp_path).heading[-1] == "seeds"
    path.write_text(json.dumps({**json.loads(path.read_text()), "mask_score": 26.25}))
    grid = grid_of("table5", tmp_path)
    assert grid.heading[-1] == "score of the mask (dB)"
    assert {cells[-1] for cells in grid.rows if cells[2]} == {"26.25"} and {len(cells) for cells in grid.rows} == {8}


def test_training_steps_are_a_column_once_some_are_recorded(made: Made, tmp_path: Path) -> None:
    """Rows trained for as many minutes on processors of different speed are not alike, and the table shows it."""

    def record(seed: int, steps: int | None = None) -> None:
        made(f"l{seed}", "lsw_sr", "e2e_cnn", 30.0 + seed, bits=4, seed=seed, steps=steps)

    for seed in (0, 1, 2):
        record(seed)
    made("b", "rbw_osr", "e2e_cnn", 28.0)
    assert "training steps" not in grid_of("table4", tmp_path).heading
    record(0, 12515)
    record(1, 3000)
    grid = grid_of("table4", tmp_path)
    steps = {cells[1]: cells[grid.heading.index("training steps")] for cells in grid.rows if cells[0] == "E2E-CNN"}
    assert steps == {"previous (RBw/oSR)": "", "deep optics (LSw/SR)": "3,000 to 12,515 (2 of 3 seeds)", "Gain": ""}
    assert {len(cells) for cells in grid.rows} == {len(grid.heading)}
    record(2, 3000)
    assert any(cells[-1] == "3,000 to 12,515" for cells in grid_of("table4", tmp_path).rows)


def test_a_mask_of_another_kind_is_left_out(made: Made, tmp_path: Path) -> None:
    path = made("a", "lsw_sr", "res2former", 30.0, bits=2)
    path.write_text(path.read_text().replace("LearnedStructural", "Measured"))
    assert not any(cells[2] for cells in grid_of("table5", tmp_path).rows)


def test_gain(made: Made, tmp_path: Path) -> None:
    made("a", "rbw_osr", "e2e_cnn", 28.0)
    made("b", "lsw_sr", "e2e_cnn", 30.0, bits=4)
    made("c", "lsw_sr", "e2e_cnn", 40.0, bits=4, scale="paper")  # has nothing to be compared with
    gains = [cells for cells in grid_of("table4", tmp_path).rows if cells[:2] == ["E2E-CNN", "Gain"]]
    assert [cells[2] for cells in gains] == ["", "+2.00, +0.050, +2.00"]
    assert gains[1][3:5] == ["+2.97, +0.058, +2.41", "-0.97, -0.008, -0.41"]


@pytest.mark.usefixtures("short_pictures")
def test_the_command(made: Made, tmp_path: Path, ran: Callable[..., str], capsys: pytest.CaptureFixture[str]) -> None:
    made("runs/a", "lsw_sr", "res2former", 30.0, bits=4)
    made("more/a", "rbw_osr", "e2e_cnn", 28.0)
    (tmp_path / "runs" / "metrics.json").write_text("{")
    printed = ran("tables", "runs=[runs,more]", "out=out")
    assert "definition of the encoders" in printed and "2 runs" in printed
    for name in ("table1", "table2", "table3", "table4", "table5", "claims", "verdicts"):
        assert (tmp_path / "out" / f"{name}.md").read_text().startswith("**")
        latex = (tmp_path / "out" / f"{name}.tex").read_text()
        rows = [line for line in latex.splitlines() if line.endswith(r"\\")]
        assert len({len(re.findall(r"(?<!\\)&", line)) for line in rows}) == 1 and latex.count(r"\hline") == 3
        with Image.open(tmp_path / "out" / f"{name}.png") as picture:
            assert picture.width > 300
    fourth = (tmp_path / "out" / "table4.md").read_text()
    assert "11.02 (11.02) | 861.76 (861.76) | 0.25 (0.19)" in fourth and "0.82 (0.82) | 53.49 (53.49)" in fourth
    assert "17.70 (17.70) | 1362.51 (1362.51)" in fourth
    for name in ("cost", "dynamic_range", "dynamic_range_map"):
        with Image.open(tmp_path / "out" / f"{name}.png") as picture:
            assert picture.width > 300
    assert not list((tmp_path / "out").glob("mosaic*"))  # these runs left no checkpoint
    first = (tmp_path / "out" / "table1.md").read_text()
    assert "| lsw_sr | learned structural, 4 bits | clip quantise, 8 bits | auto | LSw/SR |" in first


def test_no_runs(refused: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    assert "empty: no metrics.json in it" in refused("tables", "runs=empty")
    assert "runs" in refused("tables")


def test_every_line_of_the_paper_has_an_encoder_of_ours() -> None:
    for table in TABLES.values():
        for line in lines_of(table, []):
            assert set(line.paper) == set(METRICS) and line.decoder
        for fields in table["columns"].values():
            assert (CONF / "encoder" / f"{fields['encoder']}.yaml").is_file()


def test_the_papers_figures_are_the_papers() -> None:
    """Every triple of figures stands in the paper's source, as often as here or more, and the other way round."""
    source = SHARED / "paper" / "deep-optics-iccv2023.tex"
    if not source.is_file():
        pytest.skip(f"the paper's source is not present ({source})")
    printed = set(re.findall(r"\d+\.\d\d, \d\.\d{3}, \d+\.\d\d", source.read_text()))
    ours = {
        "{:.2f}, {:.3f}, {:.2f}".format(*figures)
        for table in TABLES.values()
        for cells in table["rows"].values()
        for column, figures in cells.items()
        if column != "match"
    }
    assert ours == printed
    for figures in PAPER["decoders"].values():
        assert (
            f"{figures['macs_G']:.2f}" in source.read_text() and f"{figures['parameters_M']:.2f}" in source.read_text()
        )


def test_names_are_whole_on_a_narrow_terminal(made: Made, tmp_path: Path) -> None:
    effects = {name: {} for name in ("mask_shift", "column_noise", "response_gamma", "veiling_glare")}
    made("a", "lsw_sr", "elp_unfolding", 30.0, test="rbw_sr", effects=effects)
    grid = run_table(find_runs([tmp_path])[0])
    for width in (60, 80, 200):
        console = PlainConsole(width=width, record=True, file=io.StringIO())
        console.print(grid.as_table(width))
        text = console.export_text()
        assert "…" not in text and all(name in text for name in (*effects, *grid.heading, "elp_unfolding"))
        assert max(map(len, text.splitlines())) <= width
