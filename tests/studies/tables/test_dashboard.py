"""Runs as trials of TensorBoard, read back as TensorBoard reads them."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.plugins.hparams.plugin_data_pb2 import HParamsPluginData

from sci_lightning.errors import BadInput
from sci_lightning.studies.tables.dashboard import check_dashboard, write_dashboard
from sci_lightning.studies.tables.run import find_runs

Made = Callable[..., Path]


def trial(folder: Path) -> tuple[dict[str, Any], dict[str, float]]:
    """The settings and the scores of the trial in a folder."""
    log = EventAccumulator(str(folder)).Reload()
    content = log.summary_metadata["_hparams_/session_start_info"].plugin_data.content
    settings = HParamsPluginData.FromString(content).session_start_info.hparams
    values = {key: getattr(value, value.WhichOneof("kind")) for key, value in settings.items()}
    return values, {tag: log.Scalars(tag)[-1].value for tag in log.Tags()["scalars"]}


def test_every_run_is_a_trial_with_its_settings_and_scores(made: Made, tmp_path: Path) -> None:
    made("runs/a", "lsw_sr", "e2e_cnn", 30.0, bits=4, seed=2)
    made("runs/b", "rbw_osr", "e2e_cnn", 28.0)
    tested = made("runs/c", "rbw_osr", "e2e_cnn", 26.0, test="rbw_sr")
    tested.write_text(json.dumps({**json.loads(tested.read_text()), "training_steps": 4000, "mask_score": 25.25}))
    runs = sorted(find_runs([tmp_path / "runs"])[0], key=lambda run: run.path)
    write_dashboard(runs, tmp_path / "log")
    names = {path.parent.relative_to(tmp_path / "log").as_posix() for path in tmp_path.glob("log/**/events.*")}
    assert names == {"lsw_sr_4bit_e2e_cnn/seed2", "rbw_osr_1bit_e2e_cnn/seed0", "rbw_osr_1bit_e2e_cnn/seed0_2"}
    settings, scores = trial(tmp_path / "log" / "lsw_sr_4bit_e2e_cnn" / "seed2")
    assert (settings["encoder"], settings["encoder_tested"], settings["mask_bits"]) == ("lsw_sr", "lsw_sr", 4)
    assert (settings["seed"], settings["setting"]) == (2, "small: 64 x 64, 3 scenes")
    assert scores["test/psnr"] == 30.0 and "mask_score" not in scores
    settings, scores = trial(tmp_path / "log" / "rbw_osr_1bit_e2e_cnn" / "seed0_2")
    assert (settings["encoder_tested"], settings["training_steps"]) == ("rbw_sr", 4000)
    assert (scores["test/psnr"], scores["mask_score"]) == (26.0, 25.25)


def test_names_of_strangers_stay_in_the_folder(made: Made, tmp_path: Path) -> None:
    for number, name in enumerate(("../../up", "..", "a/b", "a:b", "a_b")):
        path = made(f"runs/{number}", "rbw_sr", "e2e_cnn", 20.0)
        path.write_text(json.dumps({**json.loads(path.read_text()), "decoder": name}))
    before = set(tmp_path.rglob("*"))
    write_dashboard(find_runs([tmp_path / "runs"])[0], tmp_path / "log")
    assert {path.relative_to(tmp_path).parts[0] for path in set(tmp_path.rglob("*")) - before} == {"log"}
    assert len(list(tmp_path.glob("log/*/seed*/events.*"))) == 5


def test_a_dashboard_that_is_there_is_left_alone(tmp_path: Path) -> None:
    check_dashboard(tmp_path / "log")
    (tmp_path / "log").mkdir()
    check_dashboard(tmp_path / "log")
    (tmp_path / "log" / "events").touch()
    with pytest.raises(BadInput, match=r"log is there already.* out="):
        check_dashboard(tmp_path / "log")
    with pytest.raises(BadInput, match="there already"):
        check_dashboard(tmp_path / "log" / "events")
