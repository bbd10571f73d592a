"""What a run finds in its folder: its own work is kept, anything else is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from omegaconf import DictConfig

from sci_lightning.cli.composition import plain
from sci_lightning.errors import BadInput
from sci_lightning.files.json_file import write_json
from sci_lightning.runs.results import RunMetrics
from sci_lightning.runs.resume import (
    check_nothing_lost,
    check_same_run,
    find_resumable_checkpoint,
    load_finished_metrics,
)

Configuration = Callable[..., DictConfig]


def test_nothing_there(configuration: Configuration, tmp_path: Path) -> None:
    config = plain(configuration("train"))
    assert load_finished_metrics(tmp_path, config) is None and find_resumable_checkpoint(tmp_path, config) is None


def test_finished(configuration: Configuration, tmp_path: Path) -> None:
    earlier = plain(configuration("train", "decoder=e2e_cnn", "out=/somewhere/else"))
    figures = {"seconds_per_measurement": 1.0, "device": "cpu", "parameters": 1, "macs": 1, "scenes": {}}
    names = dict.fromkeys(("encoder", "decoder", "test_encoder"), "a")
    written = RunMetrics(**names, **figures, mean={"psnr": 30.0}, config=earlier)  # type: ignore[arg-type]
    write_json(written.as_json(), tmp_path / "metrics.json")
    result = load_finished_metrics(
        tmp_path, plain(configuration("train", "decoder=e2e_cnn", f"out={tmp_path}", "workers=3"))
    )
    assert result is not None and result == written
    with pytest.raises(BadInput, match=r"decoder\.blocks is 5, now 4.* out="):
        load_finished_metrics(tmp_path, plain(configuration("train", "decoder=e2e_cnn", "decoder.blocks=4")))
    (tmp_path / "metrics.json").write_text("[]")
    with pytest.raises(BadInput, match="not the metrics of a run"):
        load_finished_metrics(tmp_path, earlier)


def test_interrupted(configuration: Configuration, tmp_path: Path) -> None:
    path = tmp_path / "checkpoints" / "last.ckpt"
    path.parent.mkdir()
    config = plain(configuration("train", "decoder=e2e_cnn", f"out={tmp_path}"))
    names = {"encoder": "lsw_sr", "decoder": "e2e_cnn"}
    torch.save({"config": {**config, "names": names}, "state_dict": {}}, path)
    assert find_resumable_checkpoint(tmp_path, config) == str(path)
    with pytest.raises(BadInput, match="seed is 0, now 1"):
        find_resumable_checkpoint(tmp_path, {**config, "seed": 1})
    path.write_bytes(b"damaged")
    with pytest.raises(BadInput, match="damaged"):
        find_resumable_checkpoint(tmp_path, config)


@pytest.mark.parametrize(
    "content", ["[" * 100_000, "[1]", '{"config": 5}', '{"config": {}}', '{"config": {}, "mean": 5}']
)
def test_metrics_that_are_none(configuration: Configuration, tmp_path: Path, content: str) -> None:
    (tmp_path / "metrics.json").write_text(content)
    with pytest.raises(BadInput, match="not the metrics of a run"):
        load_finished_metrics(tmp_path, plain(configuration("train")))


@pytest.mark.parametrize("out", ["", ",", '"', None, 5, [1]])
def test_a_run_whose_folder_has_an_odd_name(configuration: Configuration, out: object) -> None:
    config = {**plain(configuration("train")), "names": {}, "out": out}
    assert check_same_run("a.ckpt", config, config) == []


@pytest.mark.parametrize("name", ["metrics.json", "checkpoints/last.ckpt", "checkpoints/best.ckpt"])
def test_a_training_is_not_overwritten(tmp_path: Path, name: str) -> None:
    check_nothing_lost(tmp_path / "absent", training=True)
    (tmp_path / "notes.txt").touch()  # somebody else's files do not stand in the way
    check_nothing_lost(tmp_path, training=True)
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).touch()
    with pytest.raises(BadInput, match=rf"\({name}\).*resume=true .*another out="):
        check_nothing_lost(tmp_path, training=True)
    check_nothing_lost(tmp_path, training=True, resume=True)
    if name == "metrics.json":  # evaluate replaces its own
        check_nothing_lost(tmp_path, training=False)
    else:
        with pytest.raises(BadInput, match=r"holds a training .* another out="):
            check_nothing_lost(tmp_path, training=False)


def test_a_training_goes_on_in_its_own_folder_with_its_last_checkpoint(tmp_path: Path) -> None:
    checkpoints = tmp_path / "checkpoints"
    checkpoints.mkdir()
    for name in ("last", "best"):
        (checkpoints / f"{name}.ckpt").touch()
    check_nothing_lost(tmp_path, training=True, ckpt_path=str(checkpoints / "last.ckpt"))
    with pytest.raises(BadInput, match="resume=true"):  # what came after the best one would be lost
        check_nothing_lost(tmp_path, training=True, ckpt_path=str(checkpoints / "best.ckpt"))


def test_what_is_no_longer_shown_is_said(configuration: Configuration) -> None:
    now = {**plain(configuration("train", "out=a")), "names": {}}
    earlier = {**now, "callbacks": {**now["callbacks"], "mine": {"_target_": "mine.Callback"}}}
    assert check_same_run("a.ckpt", earlier, now) == ["without callbacks.mine"]
    assert check_same_run("a.ckpt", now, {**now, "logger": {"csv": {}}}) == ["without logger.tensorboard"]
