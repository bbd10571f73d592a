"""Fine-tuning: a decoder gets used to another camera, whose mask stays fixed; and the table of what it is worth."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from sci_lightning.cli import command as command_frame
from sci_lightning.cli.commands.mismatch_finetuning import mismatch_finetuning
from sci_lightning.cli.composition import compose
from sci_lightning.cli.encoder_file import adopt_encoder_files
from sci_lightning.cli.notebook import train
from sci_lightning.cli.settings import complete
from sci_lightning.cli.stored_run import with_stored_choices
from sci_lightning.errors import BadInput
from tests.encoder_files import encoder_file
from tests.training.small_training import TINY

pytestmark = pytest.mark.usefixtures("adopted_encoders")

QUIET = ["metrics.qscore=null", "data.scenes_count=1", "callbacks.pictures=null", "logger=none"]
FIXED = ["system.lr=1e-30", "system.final_lr=1e-30"]
"""Learning rates with which no weight changes."""


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The last checkpoint of a tiny training behind a learned mask, with a recipe of its own."""
    own = ["effect=[gain]", "encoder.mask.bits=2", "system.lr=1e-3", "seed=3"]
    return train([*TINY, *QUIET, *own, f"out={tmp_path_factory.mktemp('trained') / 'RUN'}"]).checkpoint


def state(path: Path, part: str) -> dict[str, torch.Tensor]:
    return {k: v for k, v in torch.load(path, weights_only=True)["state_dict"].items() if k.startswith(part)}


@pytest.mark.slow
def test_a_decoder_learns_behind_a_fixed_mask(
    ran: Callable[..., str], refused: Callable[..., str], trained: Path, tmp_path: Path
) -> None:
    encoder_file(tmp_path / "FOUND")
    tune = [f"ckpt_path={trained}", "encoder=FOUND/encoder.yaml", "experiment=finetune", *QUIET]
    text = ran("train", *tune, "out=TUNED")
    path = tmp_path / "TUNED" / "checkpoints" / "last.ckpt"
    config = json.loads((tmp_path / "TUNED" / "metrics.json").read_text())["config"]
    assert config["finetune"] is True and (config["system"]["lr"], config["trainer"]["max_epochs"]) == (3e-4, 2)
    assert (config["decoder"]["channels"], config["batch_size"], config["seed"]) == (8, 2, 3)  # as it was trained
    assert list(config["encoder"]["effects"]) != ["gain"] and "bits" not in config["encoder"]["mask"]
    assert "goes on" not in text and "finished before" not in text
    before, after = state(trained, "decoder"), state(path, "decoder")
    assert before.keys() == after.keys() and not all(torch.equal(before[key], after[key]) for key in before)
    mask = state(path, "encoder.mask")["encoder.mask.pattern"]
    np.testing.assert_array_equal(mask, np.load(tmp_path / "FOUND" / "patterns.npy").astype(np.float32))
    assert "finished before, kept" in ran("train", *tune, "out=TUNED", "resume=true")
    assert "holds an earlier run" in refused("train", *tune, "out=TUNED")

    ran("train", *tune, *FIXED, "trainer.max_epochs=1", "out=SAME")  # it begins with what was trained
    same = state(tmp_path / "SAME" / "checkpoints" / "last.ckpt", "decoder")
    assert all(torch.equal(before[key], same[key]) for key in before)


@pytest.mark.slow
def test_a_mask_that_could_learn_stays_fixed(ran: Callable[..., str], trained: Path, tmp_path: Path) -> None:
    learned = ["encoder=rbw_sr", "encoder/mask=learned_binary"]
    for name, rates in (("A", []), ("B", FIXED)):
        ran("train", f"ckpt_path={trained}", *learned, "experiment=finetune", *QUIET, *rates, f"out={name}")
    one, other = (state(tmp_path / name / "checkpoints" / "last.ckpt", "encoder") for name in "AB")
    assert one.keys() == other.keys() and all(torch.equal(one[key], other[key]) for key in one)


@pytest.mark.slow
def test_an_interrupted_fine_tuning_goes_on(ran: Callable[..., str], trained: Path, tmp_path: Path) -> None:
    encoder_file(tmp_path / "FOUND")
    tune = [f"ckpt_path={trained}", "encoder=FOUND/encoder.yaml", "experiment=finetune", *QUIET]
    ran("train", *tune, "trainer.max_epochs=1", "out=TUNED")
    (tmp_path / "TUNED" / "metrics.json").unlink()
    path = tmp_path / "TUNED" / "checkpoints" / "last.ckpt"
    assert "goes on from" in ran("train", f"ckpt_path={path}", "trainer.max_epochs=2", *QUIET)
    assert torch.load(path, weights_only=True)["global_step"] == 8  # two epochs of four steps, not three
    before = path.read_bytes()
    again = ["encoder=rbw_sr", f"out={tmp_path / 'TUNED'}"]  # another camera: a new fine-tuning, which has no folder
    with pytest.raises(BadInput, match="encoder=FOUND, now it is rbw_sr"):
        train([*TINY, *QUIET, f"ckpt_path={path}", "finetune=true", *again])
    assert path.read_bytes() == before


@pytest.mark.usefixtures("short_design")
def test_the_configuration_of_a_fine_tuning(tmp_path: Path) -> None:
    words = ["experiment=quickstart", *TINY, *QUIET, "encoder.mask.bits=2", "crop=[16,16]", "trainer.max_epochs=1"]
    path = train([*words, f"out={tmp_path}/RUN"]).checkpoint
    found = encoder_file(tmp_path / "FOUND")
    given = [f"ckpt_path={path}", f"encoder={found}", "experiment=finetune", "batch_size=1"]
    config = complete(compose("train", adopt_encoder_files(with_stored_choices(given))), "train").cfg
    assert (config.crop, config.size, config.decoder.channels, config.batch_size) == ([16, 16], [32, 32], 8, 1)
    assert config.encoder.mask._target_.endswith("Measured") and "RUN" not in config.out
    assert (config.trainer.max_epochs, config.trainer.accelerator, config.system.lr) == (2, "cpu", 3e-4)


def test_bad_input(refused: Callable[..., str], trained: Path, tmp_path: Path) -> None:
    result = encoder_file(tmp_path / "FOUND")
    line = refused("train", *TINY, f"encoder={result}", "experiment=finetune", *QUIET)
    assert "trained already: ckpt_path=" in line
    before = trained.read_bytes()
    line = refused(
        "train", f"ckpt_path={trained}", f"encoder={result}", "finetune=true"
    )  # it would go on in that folder
    assert "experiment=finetune" in line and trained.read_bytes() == before
    words = [f"encoder={result}", f"out={trained.parent.parent}"]  # on top of what it would begin with
    line = refused("train", f"ckpt_path={trained}", "experiment=finetune", *words)
    assert "which would be lost; give another out=" in line and trained.read_bytes() == before
    line = refused("train", f"ckpt_path={trained}", "experiment=finetune")
    assert "Give encoder=FOUND/encoder.yaml" in line
    line = refused("train", f"ckpt_path={trained}", f"encoder={result}", "experiment=finetune", "decoder=res2former")
    assert "cannot be fine-tuned as decoder=res2former" in line
    line = refused("train", f"ckpt_path={trained}", f"encoder={result}", "experiment=finetune", "decoder.channels=4")
    assert "does not fit decoder=e2e_cnn" in line
    np.save(result.parent / "patterns.npy", np.ones((4, 32, 32)) / 4)
    line = refused("train", f"ckpt_path={trained}", f"encoder={result}", "experiment=finetune")
    assert "was trained for 8 slots, the camera has 4" in line


@pytest.mark.slow
def test_what_it_is_worth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Every step of the table, at a size that learns nothing; the same command goes on where it stopped."""
    null = ["mask_shift", "mask_rotation", "mask_blur", "sync_offset", "duty_cycle", "black_level"]
    small = " ".join(["data=synthetic data.scenes_count=1 size=[32,32]", *(f"mismatch.{name}=null" for name in null)])
    tiny = " ".join([*(word for word in TINY if not word.startswith("size")), *QUIET])
    words = [f"protocol='{small}'", f"overrides='{tiny}'", "seeds=1", "out=a"]
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["mismatch_finetuning", *words])
    command_frame.run("mismatch_finetuning", mismatch_finetuning)
    records = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "a" / "records").glob("[!.]*")}
    assert len(records) == 4
    command_frame.run("mismatch_finetuning", mismatch_finetuning)
    assert records == {path.name: path.stat().st_mtime_ns for path in (tmp_path / "a" / "records").glob("[!.]*")}
