"""Reading what runs found."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.studies.tables.cost import share_of_paper
from sci_lightning.studies.tables.run import find_runs, read_run
from tests.studies.tables.conftest import Made


def test_what_a_training_computed(made: Made, tmp_path: Path) -> None:
    """Clips are steps times batch, unless the file counts them; a crop costs as much less as it is smaller."""
    path = made("a", "lsw_sr", "e2e_cnn", 30.0, steps=50)
    assert read_run(path).computation is None  # of how many clips is not said
    content = json.loads(path.read_text())
    content["config"] |= {"batch_size": 4, "crop": [32, 32], "trainer": {"accumulate_grad_batches": 2}}
    path.write_text(json.dumps(content))
    run = read_run(path)
    assert run.computation == 6 * 1000 * (50 * 4 * 2) / 4
    assert share_of_paper(run, 1000) == pytest.approx(400 / 4 / (100 * 24_500))
    path.write_text(json.dumps({**content, "clips_seen": 1000}))
    assert read_run(path).computation == 6 * 1000 * 1000 / 4


def test_fields(made: Made) -> None:
    run = read_run(made("a", "rbw_osr", "e2e_cnn", 30.0, test="rbw_sr", seed=7))
    expected = {"encoder": "rbw_osr", "decoder": "e2e_cnn", "test_encoder": "rbw_sr", "mask": "RandomBinary", "bits": 1}
    assert run.fields == expected and run.seed == 7 and run.scores["psnr"] == 30.0
    assert str(run.setting) == "small: 64 x 64, 3 scenes"
    assert read_run(made("b", "lsw_sr", "e2e_cnn", 30.0, bits=3)).fields["bits"] == 3
    assert str(read_run(made("b", "lsw_sr", "e2e_cnn", 30.0, scale="own")).setting).startswith("own: ")


def test_core_minutes_are_part_of_the_scale(made: Made) -> None:
    path = made("a", "rbw_osr", "e2e_cnn", 30.0, scale="cpu")
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**content, "config": {**content["config"], "core_minutes": 10}}))
    assert str(read_run(path).setting).startswith("cpu, 10 core minutes: ")


def test_files_that_are_kept_of_rows(made: Made, tmp_path: Path) -> None:
    made("a", "rbw_osr", "e2e_cnn", 30.0).rename(tmp_path / "a" / "seed0.json")
    (tmp_path / "a" / "other.json").write_text("{}")
    assert [run.path.name for run in find_runs([tmp_path])[0]] == ["seed0.json"]


def test_an_encoder_with_effects_is_not_the_papers(made: Made) -> None:
    run = read_run(made("a", "lsw_sr", "e2e_cnn", 30.0, effects={"mask_shift": {"dx": 1.0}}))
    assert run.fields["encoder"] == run.fields["test_encoder"] == "lsw_sr + mask_shift"


@pytest.mark.parametrize(
    ("change", "decoder", "setting"),
    [
        ({"frames": 8}, "e2e_cnn", "small: 64 x 64"),
        ({"frames": 16}, "e2e_cnn", "small: T = 16, 64 x 64"),
        ({"finetune": True}, "e2e_cnn + fine-tuning", "small: 64 x 64"),
        ({"evaluate": {"camera": {"mask": {}}}}, "e2e_cnn + assumed camera", "small: 64 x 64"),
    ],
)
def test_what_is_not_in_the_paper_is_a_row_of_its_own(
    change: dict[str, object], decoder: str, setting: str, made: Made
) -> None:
    path = made("a", "lsw_sr", "e2e_cnn", 30.0)
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**content, "config": {**content["config"], **change}}))
    run = read_run(path)
    assert run.fields["decoder"] == decoder and str(run.setting).startswith(setting)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{", "not readable as JSON"),
        ("[1]", "format sci-metrics 1"),
        ('{"format": "sci-metrics", "format_version": 2}', "format sci-metrics 1"),
        ('{"format": "sci-metrics", "format_version": 1, "config": {}}', "encoder is missing"),
    ],
)
def test_files_of_no_use_are_named_and_the_others_go_on(made: Made, tmp_path: Path, text: str, reason: str) -> None:
    good = made("runs/deep/inside/a", "lsw_sr", "e2e_cnn", 30.0)
    bad = tmp_path / "runs" / "b" / "metrics.json"
    bad.parent.mkdir()
    bad.write_text(text)
    runs, lines = find_runs([tmp_path / "runs", tmp_path / "none"])
    assert [run.path for run in runs] == [good]
    assert len(lines) == 2 and str(bad) in lines[0] and reason in lines[0] and "no such folder" in lines[1]
    assert not any("\n" in line for line in lines)
    with pytest.raises(BadInput, match="no runs"):
        find_runs([bad.parent])


def test_the_latest_counts_whatever_folder_is_named_first(made: Made) -> None:
    new, old = (made(f"{name}/a", "lsw_sr", "e2e_cnn", psnr) for name, psnr in (("new", 35.0), ("old", 30.0)))
    os.utime(new, (5000, 5000))
    os.utime(old, (4000, 4000))
    (run,), lines = find_runs([new.parent.parent, old.parent.parent])
    assert run.path == new and lines == [f"{old}: {new} is the same row and seed, and later"]


def test_bytes_that_are_no_text(made: Made, tmp_path: Path) -> None:
    (tmp_path / "metrics.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadInput, match="not readable as JSON"):
        read_run(tmp_path / "metrics.json")


def test_of_equal_runs_the_latest_counts(made: Made, tmp_path: Path) -> None:
    old, new = made("old", "lsw_sr", "e2e_cnn", 30.0), made("new", "lsw_sr", "e2e_cnn", 31.0)
    os.utime(old, (1, 1))
    runs, lines = find_runs([tmp_path])
    assert [run.path for run in runs] == [new] and len(lines) == 1 and str(old) in lines[0]
    result, lines = find_runs([tmp_path / "new", tmp_path / "new"])
    assert len(result) == 1 and not lines


def test_two_sizes_of_a_network_are_two_runs(made: Made, tmp_path: Path) -> None:
    made("one", "lsw_sr", "e2e_cnn", 30.0)
    path = made("other", "lsw_sr", "e2e_cnn", 30.0)
    path.write_text(json.dumps({**json.loads(path.read_text()), "parameters": 2000}))
    assert len(find_runs([tmp_path])[0]) == 2
