"""Two processes train one mask."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import lightning as L
import pytest
import torch

from tests.conftest import ROOT
from tests.training.small_training import TINY


class KeepMask(L.Callback):
    """Every process writes the real-valued mask it ends with."""

    def __init__(self, folder: str) -> None:
        self.folder = Path(folder)

    def on_train_end(self, trainer: L.Trainer, pl_module: L.LightningModule) -> None:
        torch.save(pl_module.encoder.mask.weight.detach(), self.folder / f"mask_{trainer.global_rank}.pt")


def test_two_processes_end_with_the_same_mask(
    command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    keep = ["+callbacks.keep._target_=tests.end_to_end.test_ddp.KeepMask", f"+callbacks.keep.folder={tmp_path}"]
    done = command("train", *TINY, "trainer.devices=2", "trainer.strategy=ddp", *keep, "out=run")
    assert done.returncode == 0, done.stderr
    first, second = (torch.load(tmp_path / f"mask_{rank}.pt", weights_only=True) for rank in (0, 1))
    assert torch.equal(first, second)
    from sci_lightning.encoder.mask import LearnedStructural

    assert not torch.equal(first, LearnedStructural(4, 8, (32, 32)).weight)
    assert (tmp_path / "run" / "metrics.json").is_file()
    assert len(list(tmp_path.glob("**/metrics.json"))) == 1


@pytest.mark.slow
def test_one_process_and_two_end_alike(
    command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path
) -> None:
    """The same batches, shared out: gradients of the parts are the whole's, windows of the mask are those of one."""
    words = [*TINY, "size=[40,40]", "crop=[32,32]", "batch_size=4", "data.clips_per_epoch=32", "precision=32"]
    ended = []
    for processes in (1, 2):
        out = f"of_{processes}"
        done = command(
            "train", *words, "trainer=ddp", f"trainer.devices={processes}", "metrics.qscore=null", f"out={out}"
        )
        assert done.returncode == 0, done.stderr
        last = tmp_path / out / "checkpoints" / "last.ckpt"
        ended.append(torch.load(last, weights_only=True)["state_dict"])
    torch.testing.assert_close(*ended, rtol=1e-3, atol=1e-5)


class Die(L.Callback):
    """One process is killed in the middle of the training."""

    def __init__(self, rank: int) -> None:
        self.rank = rank

    def on_train_batch_start(self, trainer: L.Trainer, *others: object) -> None:
        if trainer.global_rank == self.rank and trainer.global_step == 2:
            os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.slow
@pytest.mark.parametrize("rank", [0, 1])
def test_the_death_of_one_process_ends_the_other_with_one_line(rank: int, tmp_path: Path) -> None:
    two = ["trainer.devices=2", "trainer.strategy=ddp", "callbacks.last.every_n_steps=1", "out=run"]
    die = ["+callbacks.die._target_=tests.end_to_end.test_ddp.Die", f"+callbacks.die.rank={rank}"]
    process = subprocess.Popen(
        [sys.executable, "-m", "sci_lightning.train", *TINY, *two, *die],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    _, told = process.communicate(timeout=120)  # ends when every process has closed its standard error
    lines = [line for line in told.splitlines() if "Initializing distributed" not in line]
    assert len(lines) == 1, told
    assert "ended from outside" in lines[0]
    assert "go on with ckpt_path=" in lines[0] and process.returncode == (-9 if rank == 0 else 1)
