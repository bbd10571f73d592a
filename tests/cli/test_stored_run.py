"""A run is gone on with by its checkpoint alone; a stranger's checkpoint can ask for plain values and no more."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf

from sci_lightning.cli.composition import Composition, compose, plain
from sci_lightning.cli.settings import complete
from sci_lightning.cli.stored_run import to_repeat, with_stored_choices
from sci_lightning.errors import BadInput
from sci_lightning.runs.checkpoint_contents import checkpoint_digest
from tests.conftest import ROOT
from tests.encoder_files import encoder_file
from tests.training.small_training import TINY
from tests.warm_process import WarmProcesses

Ran = Callable[..., str]
SETTLED = [
    "encoder=rbw_sr",
    "encoder/mask=learned_binary",
    "encoder.mask.bits=3",
    "decoder.depths=[1,2]",
    "data=folder",
    "effect=[mask_shift,prnu]",
    "experiment=quickstart",
    "size=[64,64]",
    "system.lr=1e-3",
    "metrics.qscore=null",
    "+trainer.limit_val_batches=2",
    "trainer.max_epochs=4",
    "logger=csv",
    "logger=[tensorboard,csv]",
    "logger=none",
    "kernels=plain",
    "callbacks.pictures=null",
    "callbacks.failed_training.stop=false",
    "logger.tensorboard=null",
    "logger.csv.flush_logs_every_n_steps=1",
    *("out=RUN", "resume=true", "ckpt_path=a.ckpt", "dry_run=true"),
]
"""Words that going on needs no more: the checkpoint holds what they say, or they are of one command."""

REPEATED = [
    "workers=3",
    "callbacks.last.folder=etc",
    "+callbacks.more={_target_: os.system}",
    "callbacks=mine",
    "logger=wandb",
    "logger=[csv,mlflow]",
    "logger.tensorboard.save_dir=etc",
    "logger.tensorboard.version=../../etc",
    "logger.csv.name=a/b",
    "logger.mlflow.tracking_uri=somewhere",
    "logger.csv={save_dir: etc}",
    "hydra.run.dir=/etc",
    "hydra/launcher=joblib",
    "trainer.default_root_dir=/etc",
    "+trainer.plugins=x",
    "+trainer.profiler=simple",
    "data.store=/etc",
    "metric=[psnr,mine]",
    "data=mine",
]


@pytest.mark.parametrize("line", SETTLED)
def test_what_a_checkpoint_settles_is_not_repeated(line: str, tmp_path: Path) -> None:
    assert to_repeat(tmp_path / "checkpoints" / "last.ckpt", composition(tmp_path, line)) == []


@pytest.mark.parametrize("line", REPEATED)
def test_anything_else_is_repeated(line: str, tmp_path: Path) -> None:
    assert to_repeat(tmp_path / "checkpoints" / "last.ckpt", composition(tmp_path, line)) == [line]


def composition(out: Path, *overrides: str, search_path: tuple[str, ...] = (), **sections: Any) -> Composition:
    return Composition(OmegaConf.create({"out": str(out), **sections}), {}, overrides, search_path=search_path)


def test_other_command_lines_stay_as_they_are(tmp_path: Path) -> None:
    for arguments in (["decoder=e2e_cnn"], ["ckpt_path=null"], ["resume=true", f"out={tmp_path}"], ["--help"]):
        assert with_stored_choices(arguments) == arguments


SHORT = [*TINY, "seed=3", "data.scenes_count=1", "metrics.qscore=null", "logger=none", "callbacks.pictures=null"]


@pytest.fixture(scope="module")
def half_a_run(tmp_path_factory: pytest.TempPathFactory, warm_processes: WarmProcesses) -> Path:
    """The folder of a run of which half is done."""
    place = tmp_path_factory.mktemp("half")
    words = [*SHORT, "trainer.max_epochs=1", "out=RUN"]
    done = warm_processes.run("sci_lightning.train", words, place, {**os.environ, "PYTHONPATH": str(ROOT)})
    assert done.returncode == 0, done.stderr
    (place / "RUN" / "metrics.json").unlink()
    return place / "RUN"


@pytest.fixture
def unfinished(half_a_run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The last checkpoint of such a run, in the current folder."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(half_a_run, "RUN")
    return tmp_path / "RUN" / "checkpoints" / "last.ckpt"


def rewritten(path: Path, change: Callable[[dict[str, Any]], Any]) -> Path:
    """The checkpoint with its configuration changed by somebody who knows how to make it look whole."""
    content = torch.load(path, weights_only=True)
    change(content["config"])
    content["digest"] = checkpoint_digest(content["config"], content["state_dict"])
    torch.save(content, path)
    return path


def test_a_checkpoint_alone(ran: Ran, refused: Ran, unfinished: Path, tmp_path: Path) -> None:
    before = sorted(tmp_path.iterdir())
    shown = ran("train", f"ckpt_path={unfinished}", "trainer.max_epochs=2", "workers=1")
    assert "trainer.max_epochs=2 (was 1), workers=1 (was 0)" in " ".join(shown.split())
    assert sorted(tmp_path.iterdir()) == before  # it went on in the run's own folder
    result = json.loads((tmp_path / "RUN" / "metrics.json").read_text())
    assert result["config"]["callbacks"]["pictures"] is None and not (tmp_path / "RUN" / "pictures").exists()
    assert (result["decoder"], result["config"]["seed"], result["config"]["decoder"]["channels"]) == ("e2e_cnn", 3, 8)
    assert torch.load(unfinished, weights_only=True)["global_step"] == 8

    assert "finished before, kept" in ran("train", "resume=true", "out=RUN")
    line = refused("train", f"ckpt_path={unfinished}", "decoder=res2former")
    assert "decoder=e2e_cnn, now it is res2former" in line and "convert" in line
    for override, both in (("seed=4", "seed=3, now it is 4"), ("batch_size=1", "batch_size=2, now it is 1")):
        assert both in refused("train", f"ckpt_path={unfinished}", override)
    line = refused("train", f"ckpt_path={unfinished}", "trainer.max_epochs=1")
    assert re.search(r"8 steps .* 2: .*trainer\.max_epochs=1", line)


def test_a_folder_alone(ran: Ran, unfinished: Path, tmp_path: Path) -> None:
    ran("train", "resume=true", "out=RUN")
    assert json.loads((tmp_path / "RUN" / "metrics.json").read_text())["config"]["decoder"]["channels"] == 8


def test_the_encoder_of_a_file_comes_from_the_checkpoint(ran: Ran, tmp_path: Path) -> None:
    file = encoder_file(tmp_path / "CAMERA", 32)
    ran("train", *SHORT, f"encoder={file}", "trainer.max_epochs=1", "out=RUN")
    file.unlink()
    ran("train", "ckpt_path=RUN/checkpoints/last.ckpt", "trainer.max_epochs=2")
    content = torch.load(tmp_path / "RUN" / "checkpoints" / "last.ckpt", weights_only=True)
    assert content["global_step"] == 8 and content["config"]["names"]["encoder"] == "CAMERA"


def test_a_strangers_configuration_is_checked_before_anything_is_built(
    refused: Ran, unfinished: Path, tmp_path: Path
) -> None:
    """In place of the class, or as one more argument: neither is built, in whatever section it stands."""
    touch = {"_target_": "pathlib.Path.touch", "_args_": [str(tmp_path / "touched")]}
    for key in ("system", "data", "decoder", "encoder", "benchmark", "metrics", "trainer", "callbacks", "logger"):
        for change in (touch, {"more": touch}):

            def swap(config: dict[str, Any], key: str = key, change: dict[str, Any] = change) -> None:
                config[key] = {**config[key], **change}

            original = unfinished.read_bytes()
            rewritten(unfinished, swap)
            if key in ("trainer", "callbacks", "logger"):  # of these only listed values are taken
                assert "touch" not in str(plain(settled(f"ckpt_path={unfinished}").cfg)[key])
            elif key == "system":
                assert "_args_" in refused("train", f"ckpt_path={unfinished}")
            else:  # as the command does before it builds anything
                with pytest.raises(BadInput, match="_args_"):
                    settled(f"ckpt_path={unfinished}")
            unfinished.write_bytes(original)
    assert not (tmp_path / "touched").exists()


@pytest.mark.parametrize(
    ("section", "key", "value"),
    [
        ("data", "scale", "${oc.env:HOME}"),
        ("trainer", "devices", 10_000),
        ("frames", None, "many"),
        ("data", None, "text"),
        ("benchmark", None, ["a"]),
        ("callbacks", None, 5),
        ("logger", None, True),
        ("data", "_partial_", True),
        ("data", "_target_", "lightning.Trainer"),
        ("metrics", "_target_", "sci_lightning.training.callbacks.LastCheckpoint"),
        ("data", "root", "~nobody_of_that_name/a"),
        ("data", "root", "a\0b"),
        ("seed", None, -1),
    ],
)
def test_values_that_a_checkpoint_may_not_hold(
    refused: Ran, unfinished: Path, section: str, key: str | None, value: Any
) -> None:
    def change(config: dict[str, Any]) -> None:
        config[section] = value if key is None else {**config[section], key: value}

    line = refused("train", f"ckpt_path={rewritten(unfinished, change)}")
    assert (str(value) if key == "_target_" else key or section) in line and "unforeseen" not in line


def test_where_a_run_writes_and_sends_is_never_taken_of_a_checkpoint(unfinished: Path) -> None:
    def change(config: dict[str, Any]) -> None:
        config["out"] = "/etc"
        config["trainer"] |= {"default_root_dir": "/etc", "plugins": ["x"], "profiler": "simple"}
        config["data"]["store"] = config["benchmark"]["store"] = "/etc"
        config["callbacks"]["last"]["folder"] = "/etc"
        config["logger"] = {"wandb": {"_target_": "x.Wandb", "host": "somewhere"}}
        config["trusted"] = ["os"]

    rewritten(unfinished, change)
    config = plain(settled(f"ckpt_path={unfinished}").cfg)
    assert not {"/etc", "somewhere", "os"} & set(map(str, leaves(config)))
    assert "plugins" not in config["trainer"] and "wandb" not in config["logger"]


def leaves(content: Any) -> Iterator[Any]:
    if isinstance(content, (dict, list)):
        for value in content.values() if isinstance(content, dict) else content:
            yield from leaves(value)
    else:
        yield content


def settled(*overrides: str) -> Composition:
    return complete(compose("train", with_stored_choices(overrides)), "train")


def test_the_folder_of_a_stranger_leads_nowhere_else(refused: Ran, unfinished: Path, tmp_path: Path) -> None:
    """Gone on with by its checkpoint alone, a run is written where the checkpoint lies, and nowhere else."""
    (tmp_path / "thesis.tex").write_text("precious")
    link = tmp_path / "RUN" / "train.log"
    link.unlink(missing_ok=True)
    link.symlink_to(tmp_path / "thesis.tex")
    assert "a link that leads out of the run's folder" in refused("train", f"ckpt_path={unfinished}")
    assert (tmp_path / "thesis.tex").read_text() == "precious"
    link.unlink()
    (tmp_path / "RUN").rename(tmp_path / "${oc.env:HOME}")
    (tmp_path / "RUN").symlink_to("${oc.env:HOME}")
    assert f"out='{tmp_path / 'RUN'}'" in with_stored_choices(["ckpt_path=" + str(unfinished)])


def test_files_that_lie_elsewhere_have_to_be_named_again(refused: Ran, unfinished: Path, tmp_path: Path) -> None:
    """Whoever wrote a checkpoint must not choose which of the reader's files become training data."""
    secret = tmp_path.parent / "secret"
    secret.mkdir(exist_ok=True)
    original = unfinished.read_bytes()
    rewritten(unfinished, lambda config: config["benchmark"].update(root=str(secret)))
    line = refused("train", f"ckpt_path={unfinished}")
    assert f"benchmark.root={secret}" in line
    assert settled(f"ckpt_path={unfinished}", f"benchmark.root={secret}").cfg.benchmark.root == str(secret)
    (tmp_path / "link").symlink_to(secret)
    places = {
        "benchmark": {"root": "link"},
        "metrics": {"x": {"place": "../secret"}},
        "encoder": {"effects": {"prnu": {"file": "~/a.npy"}}},
    }
    for section, change in places.items():
        unfinished.write_bytes(original)
        rewritten(unfinished, lambda config, section=section, change=change: config[section].update(change))
        assert "neither in the current folder" in refused("train", f"ckpt_path={unfinished}")


def test_what_is_read_from_the_own_folders_is_shown(
    unfinished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "SCENES").mkdir()
    rewritten(unfinished, lambda config: config["benchmark"].update(root="SCENES"))
    assert settled(f"ckpt_path={unfinished}").cfg.benchmark.root == "SCENES"
    assert "reads benchmark.root=SCENES" in " ".join(capsys.readouterr().out.split())


def test_the_line_to_go_on_with_says_what_a_checkpoint_may_not_ask_for(tmp_path: Path) -> None:
    run, outside = tmp_path / "RUN", str(tmp_path.parent / "masks" / "mask.mat")
    last = run / "checkpoints" / "last.ckpt"
    encoder = {"mask": {"_target_": "sci_lightning.encoder.mask.Measured", "file": outside}}
    made = composition(run, "workers=3", "seed=3", encoder=encoder, benchmark={"root": str(run / "scenes")})
    assert to_repeat(last, made) == [f"encoder.mask.file={outside}", "workers=3"]
    words = ("decoder.width=5", "decoder=mine", "encoder.mask.bits=3")
    own = composition(run, *words, search_path=("file://own",), decoder={"_target_": "mine.Decoder"})
    mine = ["decoder=mine", "decoder.width=5"]  # chosen again, it has its own defaults again
    assert to_repeat(last, own) == ["hydra.searchpath=[file://own]", "trusted=[mine]", *mine]
    assert to_repeat(tmp_path / "elsewhere" / "last.ckpt", composition(run)) == [f"out={run}"]


def test_a_member_of_ones_own_is_looked_for_where_one_says(refused: Ran, unfinished: Path, tmp_path: Path) -> None:
    rewritten(unfinished, lambda config: config["metrics"].update(mine={"_target_": "mine.Metric"}))
    line = refused("train", f"ckpt_path={unfinished}")
    assert "mine.Metric" in line and "hydra.searchpath=[FOLDER]" in line
    (tmp_path / "own" / "metric").mkdir(parents=True)
    (tmp_path / "own" / "metric" / "mine.yaml").write_text("# @package metrics.mine\n_target_: mine.Metric\n")
    own = [f"hydra.searchpath=[file://{tmp_path / 'own'}]", "metric=[psnr,mine]"]
    composed = compose("train", with_stored_choices([f"ckpt_path={unfinished}", *own]))
    assert composed.cfg.metrics.mine._target_ == "mine.Metric"
