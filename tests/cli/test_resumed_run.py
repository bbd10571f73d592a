"""A run is gone on with by its checkpoint alone; a stranger's checkpoint can ask for plain values and no more."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from omegaconf import OmegaConf

from sci_lightning.cli.composition import Composition
from sci_lightning.cli.resumed_run import continued, repeated
from sci_lightning.cli.stored_overrides import overrides_of, recorded
from sci_lightning.errors import BadInput
from sci_lightning.runs.checkpoint_contents import checkpoint_digest
from tests.cli.test_encoder_file import encoder_file
from tests.end_to_end.test_train import TINY

Ran = Callable[..., str]
KEPT = [
    "encoder=rbw_sr",
    "encoder/mask=learned_binary",
    "encoder.mask.bits=3",
    "decoder.depths=[1,2]",
    "data=folder",
    "data.root=/some/where",
    "benchmark.root='a folder'",
    "effect=[mask_shift,prnu]",
    "experiment=quickstart",
    "size=[64,64]",
    "system.lr=1e-3",
    "metrics.qscore=null",
    "trainer.max_epochs=4",
    "+trainer.limit_val_batches=2",
    "trainer.max_time={minutes: 4}",
    "trainer.max_time.minutes=4",
    "logger=csv",
    "logger=[tensorboard,csv]",
    "logger=none",
    "logger.tensorboard=null",
    "logger.tensorboard.version=mine",
    "logger.csv.flush_logs_every_n_steps=1",
    "callbacks.pictures=null",
    "callbacks.failed_training.stop=false",
    "callbacks.best.monitor=psnr",
    "initialisation=unit_variance",
    "kernels=plain",
]
NOT_KEPT = [
    "out=RUN",
    "resume=true",
    "ckpt_path=a.ckpt",
    "trusted=[somebody]",
    "workers=3",
    "callbacks.last.folder=/etc",
    "+callbacks.x._target_=os.system",
    "callbacks=mine",
    "logger=wandb",
    "logger=[csv,mlflow]",
    "logger.tensorboard.save_dir=/etc",
    "logger.tensorboard.save_dir=etc",
    "logger.tensorboard.version=../../etc",
    "logger.tensorboard.version=$HOME",
    "logger.csv.name=a/b",
    "logger.mlflow.tracking_uri=somewhere",
    "logger.csv={save_dir: etc}",
    "callbacks.last.folder=etc",
    "callbacks.last.folder=5",
    "callbacks.pictures={folder: etc}",
    "+callbacks.more={_target_: os.system}",
    "hydra.run.dir=/etc",
    "hydra/launcher=joblib",
    "hydra.searchpath=[/tmp]",
    "encoder._target_=os.system",
    "encoder.mask={_target_: os.system}",
    "+encoder.mask.more=[{a: {_target_: os.system}}]",
    "decoder.x=${oc.env:HOME}",
    "decoder='${oc.env:HOME}'",
    "decoder=../../etc/passwd",
    "decoder=a/b",
    "encoder=/tmp/encoder.yaml",
    "decoder@trainer=mine",
    "trainer.default_root_dir=/etc",
    "+trainer.plugins=x",
    "+trainer.logger=true",
    "+trainer.profiler=simple",
    "data.store=/etc",
    "test_encoders={a: 1}",
    "~trainer.max_epochs",
    "seed=1,2",
    "seed=range(3)",
    "system",
    "size=[64,64",
    "seed=1\nout=x",
    "data.root=" + "[" * 2000 + "]" * 2000,
]


@pytest.mark.parametrize("line", KEPT)
def test_what_is_computed_is_kept(line: str) -> None:
    assert recorded([line]) == [line]
    assert [override.input_line for override in overrides_of(Path("a.ckpt"), {"overrides": [line]})] == [line]


@pytest.mark.parametrize("line", NOT_KEPT, ids=lambda line: line[:40])
def test_anything_else_is_refused(line: str) -> None:
    assert recorded([line]) == []
    with pytest.raises(BadInput, match=r"(?s)a\.ckpt: its override .* is not one that a checkpoint may hold"):
        overrides_of(Path("a.ckpt"), {"overrides": [line]})


@pytest.mark.parametrize("lines", ["encoder=lsw_sr", None, [1], ["seed=1"] * 2000])
def test_overrides_that_are_none(lines: Any) -> None:
    with pytest.raises(BadInput, match="its overrides are not a list of texts"):
        overrides_of(Path("a.ckpt"), {"overrides": lines})


def test_other_command_lines_stay_as_they_are(tmp_path: Path) -> None:
    for arguments in (["decoder=e2e_cnn"], ["ckpt_path=null"], ["resume=true", f"out={tmp_path}"], ["--help"]):
        assert continued(arguments, ["lsw_sr"]) == (arguments, {})


SHORT = [*TINY, "seed=3", "data.scenes_count=1", "metrics.qscore=null", "logger=none", "callbacks.pictures=null"]


@pytest.fixture
def unfinished(ran: Ran, tmp_path: Path) -> Path:
    """The last checkpoint of a run of which half is done."""
    ran("train", *SHORT, "trainer.max_epochs=1", "out=RUN")
    (tmp_path / "RUN" / "metrics.json").unlink()
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
    assert "as configured there, but trainer.max_epochs=2 (was 1), workers=1 (was 0)" in " ".join(shown.split())
    assert sorted(tmp_path.iterdir()) == before  # it went on in the run's own folder
    result = json.loads((tmp_path / "RUN" / "metrics.json").read_text())
    assert (result["decoder"], result["config"]["seed"], result["config"]["decoder"]["channels"]) == ("e2e_cnn", 3, 8)
    assert torch.load(unfinished, weights_only=True)["global_step"] == 8

    assert "finished before, kept" in ran("train", "resume=true", "out=RUN")
    line = refused("train", f"ckpt_path={unfinished}", "decoder=res2former")
    assert "decoder=e2e_cnn, now it is res2former" in line and "convert" in line
    for override, both in (("seed=4", "seed=3, now it is 4"), ("batch_size=1", "batch_size=2, now it is 1")):
        assert both in refused("train", f"ckpt_path={unfinished}", override)
    assert "8 steps were made, in epoch 2: more than trainer.max_epochs=1 asks for" in refused(
        "train", f"ckpt_path={unfinished}", "trainer.max_epochs=1"
    )


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


def test_a_strangers_configuration_is_compared_never_built(refused: Ran, unfinished: Path, tmp_path: Path) -> None:
    touch = {"_target_": "pathlib.Path.touch", "_args_": [str(tmp_path / "touched")]}
    for key in ("system", "trainer", "data", "decoder", "encoder"):

        def change(config: dict[str, Any], key: str = key) -> None:
            config[key] = {**config[key], "more": touch}

        assert "error" in refused("train", f"ckpt_path={rewritten(unfinished, change)}")
        rewritten(unfinished, lambda config, key=key: config[key].pop("more"))
    line = refused("train", f"ckpt_path={rewritten(unfinished, lambda c: c['overrides'].append('out=/etc'))}")
    assert "'out=/etc' is not one that a checkpoint may hold" in line
    assert not (tmp_path / "touched").exists()


def test_checkpoints_from_before(refused: Ran, unfinished: Path) -> None:
    line = refused("train", f"ckpt_path={rewritten(unfinished, lambda config: config.pop('overrides'))}")
    assert "before checkpoints kept their overrides: repeat those in" in line and ".hydra/overrides.yaml" in line
    assert OmegaConf.load(unfinished.parents[1] / ".hydra" / "overrides.yaml")


def test_overrides_that_hydra_would_read_for_minutes() -> None:
    with pytest.raises(BadInput, match=r"more than 20,000 characters"):
        overrides_of(Path("a.ckpt"), {"overrides": ["seed=" + "1" * 18_000] * 2})
    with pytest.raises(BadInput, match="not one that a checkpoint may hold"):
        overrides_of(Path("a.ckpt"), {"overrides": ["trainer.devices=10000"]})


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
    arguments, _ = continued(["ckpt_path=" + str(unfinished)], ["lsw_sr"])
    assert f"out='{tmp_path / 'RUN'}'" in arguments


def test_files_that_lie_elsewhere_have_to_be_named_again(refused: Ran, unfinished: Path, tmp_path: Path) -> None:
    """Whoever wrote a checkpoint must not choose which of the reader's files become training data."""
    secret = tmp_path.parent / "secret"
    rewritten(unfinished, lambda config: config["overrides"].append(f"benchmark.root={secret}"))
    line = refused("train", f"ckpt_path={unfinished}")
    assert "neither in the current folder nor in the run's" in line and f"benchmark.root={secret}" in line
    assert continued([f"ckpt_path={unfinished}", f"benchmark.root={secret}"], ["lsw_sr"])[0]
    (tmp_path / "RUN" / "link").symlink_to(secret)
    rewritten(unfinished, lambda config: config["overrides"].pop())
    for text in ("benchmark.root=RUN/link", "metrics.x.place=../secret", "effects.prnu={file: '~/a.npy'}"):
        rewritten(unfinished, lambda config, text=text: config["overrides"].append(text))
        assert "neither in the current folder" in refused("train", f"ckpt_path={unfinished}")
        rewritten(unfinished, lambda config: config["overrides"].pop())


def test_what_is_read_from_the_own_folders_is_shown(
    unfinished: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rewritten(unfinished, lambda config: config["overrides"].append("benchmark.root=SCENES"))
    arguments, _ = continued([f"ckpt_path={unfinished}"], ["lsw_sr"])
    assert "benchmark.root=SCENES" in arguments
    assert "reads benchmark.root=SCENES" in " ".join(capsys.readouterr().out.split())


def test_the_line_to_go_on_with_says_what_a_checkpoint_may_not_ask_for(tmp_path: Path) -> None:
    last = tmp_path / "RUN" / "checkpoints" / "last.ckpt"
    outside = str(tmp_path.parent / "masks" / "mask.mat")
    encoder = {"mask": {"_target_": "x.Measured", "file": outside}}
    again = ["workers=3", "trusted=[mine]", "+callbacks.mine={_target_: mine.Callback}", "logger=wandb"]
    once = ["debug=true", f"out={tmp_path / 'RUN'}", "resume=true", "ckpt_path=a.ckpt"]
    kept = ["logger.tensorboard=null", "callbacks.failed_training.stop=false", "seed=3"]
    files = [f"encoder.mask.file={outside}", f"benchmark.root={tmp_path / 'RUN' / 'scenes'}"]
    cfg = OmegaConf.create({"out": str(tmp_path / "RUN")})

    def composition(*overrides: str, search_path: tuple[str, ...] = ()) -> Composition:
        return Composition(cfg, {}, overrides, search_path=search_path)

    assert repeated(last, composition(*files, *kept, *once, *again), encoder) == [files[0], *again]
    assert repeated(last, composition("seed=3"), {"mask": {"file": None}}) == []
    own = composition("decoder=mine", search_path=("file://own",))
    assert repeated(last, own, {}) == ["hydra.searchpath=['file://own']"]
    assert repeated(tmp_path / "elsewhere" / "last.ckpt", composition(), {}) == [f"out={tmp_path / 'RUN'}"]


def test_a_member_of_ones_own_is_looked_for_where_one_says(refused: Ran, unfinished: Path, tmp_path: Path) -> None:
    rewritten(unfinished, lambda config: config["overrides"].append("metric=[psnr,mine]"))
    line = refused("train", f"ckpt_path={unfinished}")
    assert "metric=mine" in line and "hydra.searchpath=[FOLDER]" in line
    own = "hydra.searchpath=[file://own]"
    assert "metric=[psnr,mine]" in continued([f"ckpt_path={unfinished}", own], ["lsw_sr"])[0]
