"""``metrics.json`` files and folders of runs that somebody else wrote, with intent or without."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image

from sci_lightning.errors import BadInput
from sci_lightning.files import folder
from sci_lightning.files.json_file import LARGEST_FILE
from sci_lightning.studies.figures import mosaic
from sci_lightning.studies.figures.mosaic import mosaics
from sci_lightning.studies.tables.grid import Grid
from sci_lightning.studies.tables.run import find_runs, read_run
from sci_lightning.studies.tables.score_table import run_table
from tests.studies.tables.conftest import Made

HOSTILE = (
    "x/../../y | `a` <img src=x onerror=alert(1)> [/] [bold]b [link=file:///x]c \\input{/etc/passwd} $\\frac{$ \x1b[31m"
)


def changed(path: Path, *keys: str, value: Any) -> Path:
    """The file with another value at the place that the keys name."""
    content = json.loads(path.read_text())
    part = content
    for key in keys[:-1]:
        part = part[key]
    part[keys[-1]] = value
    path.write_text(json.dumps(content))
    return path


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        (("config", "scale"), "x" * 201),
        (("config", "scale"), ["small"]),
        (("encoder",), 7),
        (("decoder",), {"a": 1}),
        (("test_encoder",), None),
        (("device",), [1]),
        (("config",), "text"),
        (("config", "encoder"), [1]),
        (("config", "encoder", "mask"), "x"),
        (("config", "encoder", "mask", "_target_"), 3),
        (("config", "encoder", "mask", "bits"), "4"),
        (("config", "encoder", "mask", "bits"), True),
        (("config", "encoder", "mask", "bits"), 10**4000),
        (("config", "encoder", "effects"), ["mask_shift"]),
        (("config", "encoder", "effects"), {"a\nb": {}}),
        (("config", "seed"), 1e30),
        (("config", "size"), [64, 64, 64]),
        (("config", "size"), [64, -1]),
        (("config", "size"), 64),
        (("mean",), [30.0]),
        (("mean", "psnr"), "30"),
        (("mean", "psnr"), float("nan")),
        (("mean", "psnr"), float("inf")),
        (("mean", "psnr"), 1e300),
        (("mean", "psnr"), None),
        (("mean", "x" * 300), 1.0),
        (("baseline",), 3),
        (("scenes",), ["kobe"]),
        (("scenes", "\x1b[2J"), {}),
        (("conventions", "psnr"), {"deep": 1}),
        (("parameters",), -1),
        (("parameters",), 1.5),
        (("macs",), 10**400),
        (("seconds_per_measurement",), "fast"),
        (("format_version",), "1"),
    ],
)
def test_a_wrong_value_is_one_line(made: Made, keys: tuple[str, ...], value: Any) -> None:
    path = changed(made("a", "lsw_sr", "e2e_cnn", 30.0, bits=4), *keys, value=value)
    with pytest.raises(BadInput) as caught:
        read_run(path)
    line = str(caught.value)
    assert line.startswith(f"{path}: ") and len(line) < len(str(path)) + 300 and line.isprintable()


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"[" * 100_000, "not readable as JSON"),
        (b'{"a":' * 100_000, "not readable as JSON"),
        (
            b'{"format": "sci-metrics", "format_version": 1, "config": [' + b"[]," * 2_000_000 + b"[]]}",
            "100,000 values",
        ),
        (b'{"a": 1e999}', "format sci-metrics 1"),
        (b'{"a": ' + b"9" * 5000 + b"}", "sci-metrics 1"),
        (b"\xff\xfe{}", "not readable as JSON"),
        (b'{"a": "\\ud800"}', "format sci-metrics 1"),
        (b" " * (LARGEST_FILE + 1), "larger than 8,388,608 bytes"),
        (b"", "not readable as JSON"),
    ],
)
def test_content_that_is_no_metrics(tmp_path: Path, content: bytes, reason: str) -> None:
    path = tmp_path / "metrics.json"
    path.write_bytes(content)
    with pytest.raises(BadInput, match=reason) as caught:
        read_run(path)
    assert "\n" not in str(caught.value)


def test_a_huge_file_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "metrics.json"
    with path.open("wb") as file:
        file.truncate(2**40)  # a hole of a terabyte
    with pytest.raises(BadInput, match="larger than"):
        read_run(path)


def test_what_is_no_regular_file_below_the_folder_is_not_opened(made: Made, tmp_path: Path) -> None:
    good = made("runs/good", "lsw_sr", "e2e_cnn", 30.0)
    outside = made("outside", "rbw_sr", "e2e_cnn", 20.0)
    for name in ("pipe", "loop", "link", "folder", "gone"):
        (tmp_path / "runs" / name).mkdir()
    os.mkfifo(tmp_path / "runs" / "pipe" / "metrics.json")
    (tmp_path / "runs" / "loop" / "metrics.json").symlink_to("metrics.json")
    (tmp_path / "runs" / "link" / "metrics.json").symlink_to(outside)
    (tmp_path / "runs" / "gone" / "metrics.json").symlink_to("/nowhere")
    (tmp_path / "runs" / "folder" / "metrics.json").mkdir()
    (tmp_path / "runs" / "up").symlink_to(tmp_path, target_is_directory=True)
    runs, lines = find_runs([tmp_path / "runs"])
    assert [run.path for run in runs] == [good] and lines == []
    with pytest.raises(BadInput, match="not a readable file"):
        read_run(tmp_path / "runs" / "pipe" / "metrics.json")


def test_deep_and_wide_trees(made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    deep = "/".join("d" * 300)
    path = made("a", "lsw_sr", "e2e_cnn", 30.0)
    os.makedirs(tmp_path / "runs" / deep)
    path.rename(tmp_path / "runs" / deep / "metrics.json")
    assert len(find_runs([tmp_path / "runs"])[0]) == 1
    monkeypatch.setattr(folder, "MOST_ENTRIES", 100)
    with pytest.raises(BadInput, match=r"runs: more than 100 files"):
        find_runs([tmp_path / "runs"])


def test_hundreds_of_bad_files_are_one_line(tmp_path: Path) -> None:
    for number in range(200):
        (tmp_path / str(number)).mkdir()
        (tmp_path / str(number) / "metrics.json").write_text("{")
    with pytest.raises(BadInput, match="and 195 more; give runs=DIR") as caught:
        find_runs([tmp_path])
    assert len(str(caught.value)) < 2000


@pytest.mark.slow
def test_hostile_texts_stay_texts_and_in_the_folder(made: Made, tmp_path: Path, ran: Callable[..., str]) -> None:
    changed(made("runs/a", "lsw_sr", "e2e_cnn", 30.0, bits=4), "config", "scale", value=HOSTILE)
    path = changed(made("runs/b", "lsw_sr", "res2former", 30.0, bits=4), "device", value=HOSTILE)
    changed(changed(path, "conventions", "qscore", value=HOSTILE), "encoder", value=HOSTILE)
    changed(made("runs/c", "rbw_sr", "e2e_cnn", 30.0), "decoder", value="../../../e2e_cnn")
    (tmp_path / "runs" / "a" / "checkpoints").mkdir()
    torch.save({"config": {}, "state_dict": {}}, tmp_path / "runs" / "a" / "checkpoints" / "last.ckpt")
    before = {path for path in tmp_path.rglob("*") if "out" not in path.name}
    printed = ran("tables", "runs=runs", "out='deep/o[/]ut[bold]'")
    out = tmp_path / "deep" / "o[/]ut[bold]"
    assert "deep/o[/]ut[bold]: table1" in printed
    assert "\x1b" not in printed and "[/]" in printed
    inside = {path for path in tmp_path.rglob("*") if path.is_relative_to(tmp_path / "deep")}
    assert set(tmp_path.rglob("*")) - before - inside == set()
    assert all(re.fullmatch(r"[\w+-][\w.+-]*", path.name) for path in out.iterdir() if path.is_file())
    for path in out.glob("*.md"):
        assert "<img" not in path.read_text() and "\x1b" not in path.read_text()
    for path in out.glob("*.tex"):
        text = path.read_text()
        assert "\\input" not in text and "$\\frac" not in text and "\\x1b" not in text
    with Image.open(out / "cost.png") as picture:
        assert picture.width > 300


def test_a_bad_checkpoint_beside_a_run_costs_one_line(made: Made, tmp_path: Path) -> None:
    outside = tmp_path / "outside.ckpt"
    outside.write_bytes(b"secret")
    for number, content in enumerate((b"", b"PK", {"config": {}, "state_dict": {}}, None, {"config": {"encoder": 3}})):
        path = made(f"runs/{number}", "lsw_sr", "e2e_cnn", 30.0, bits=number + 1).parent / "checkpoints" / "last.ckpt"
        path.parent.mkdir()
        if content is None:
            path.symlink_to(outside)
        elif isinstance(content, bytes):
            path.write_bytes(content)
        else:
            torch.save({"state_dict": {}, **content}, path)
    lines: list[str] = []
    assert not list(mosaics(find_runs([tmp_path / "runs"])[0], 24, lines.append))
    assert len(lines) == 4 and all("last.ckpt" in line and "\n" not in line for line in lines)
    assert not any("outside" in line for line in lines)


def test_scales_that_differ_in_nothing_a_file_name_shows(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for number, scale in enumerate(("a/b", "a:b", "..")):
        folder = changed(made(str(number), "lsw_sr", "e2e_cnn", 30.0), "config", "scale", value=scale).parent
        (folder / "checkpoints").mkdir()
        (folder / "checkpoints" / "last.ckpt").touch()
    picture = {str(number): torch.zeros(4, 4) for number in range(4)}
    monkeypatch.setattr(mosaic, "_pictures", lambda path, side: picture)
    names = [name for name, _ in mosaics(find_runs([tmp_path])[0], 24, print)]
    assert sorted(names) == ["mosaic_.._e2e_cnn", "mosaic_a_b_e2e_cnn", "mosaic_a_b_e2e_cnn_2"]


def test_a_thousand_rows_are_a_picture_that_can_be_drawn() -> None:
    grid = Grid("many", "many", ["a", "b"], [["x", "y"]] * 1000)
    cells = grid.as_figure().axes[0].tables[0].get_celld()
    assert max(row for row, _ in cells) == 151 and cells[151, 0].get_text().get_text() == "and 850 more rows"
    assert grid.as_markdown().count("| x | y |") == 1000


def test_runs_with_effects_are_among_all_runs(made: Made, tmp_path: Path) -> None:
    made("a", "lsw_sr", "e2e_cnn", 30.0, bits=2, effects={"mask_shift": {"dx": 1.0}, "prnu": None})
    for seed in (0, 1):
        made(f"b{seed}", "rbw_osr", "e2e_cnn", 28.0 + seed, seed=seed, test="rbw_sr")
    rows = run_table(find_runs([tmp_path])[0]).rows
    scale = "small: 64 x 64, 3 scenes"
    assert rows == [
        ["lsw_sr + mask_shift", "2", "e2e_cnn", "itself", "30.00, 0.750, 45.00", "1,000", scale, "1"],
        ["rbw_osr", "1", "e2e_cnn", "rbw_sr", "28.50 ± 0.71, 0.712 ± 0.018, 43.50 ± 0.71", "1,000", scale, "2"],
    ]


def test_what_was_tested_with_has_effects_of_its_own(made: Made) -> None:
    path = made("a", "lsw_sr", "e2e_cnn", 30.0, test="rbw_sr", effects={"mask_shift": {"dx": 1.0}})
    other = {"rbw_sr": {"mask": {}, "effects": {"gain": {}}}}
    assert read_run(changed(path, "config", "test_encoders", value=other)).fields["test_encoder"] == "rbw_sr + gain"
    tested = {"encoder": {"effects": {"prnu": {}}}, "size": [32, 32]}
    run = read_run(changed(path, "config", "evaluate", value=tested))
    assert run.fields["test_encoder"] == "rbw_sr + prnu" and run.setting.size == (32, 32)
    run = read_run(changed(path, "config", "evaluate", value={**tested, "captures": "c.h5"}))
    assert run.fields["test_encoder"] == "rbw_sr"
