"""Two processes train one mask."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

import lightning as L
import torch

from tests.end_to_end.test_train import TINY


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
