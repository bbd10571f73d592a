"""Every decoder under every encoder: a step of training, a checkpoint, another step, a test, an export.

By default every decoder is tried under the learned masks and under one other encoder, which take turns.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import lightning as L
import pytest
import torch
from hydra.utils import instantiate
from omegaconf import DictConfig

from sci_lightning.cli.composition import plain
from sci_lightning.data.loader import ClipLoader, scene_loader
from sci_lightning.data.source import Clips, Scene
from sci_lightning.decoder.complexity import count_parameters
from sci_lightning.metrics import PSNR
from sci_lightning.runs.checkpoint import read_checkpoint, write_weights
from sci_lightning.training.system import System
from sci_lightning.training.training_checkpoint import TrainingCheckpointIO
from tests.conftest import members
from tests.decoder.small import SMALL


class OneClip(Clips):
    """An epoch of one clip."""

    def __len__(self) -> int:
        return 1

    def __getitem__(self, index: int) -> torch.Tensor:
        return torch.rand(4, 16, 16)


ENCODERS = members("encoder")
PAIRS = [
    pytest.param(
        decoder,
        encoder,
        marks=() if encoder in ("lsw_sr", ENCODERS[turn % len(ENCODERS)]) else pytest.mark.slow,
    )
    for turn, decoder in enumerate(members("decoder"))
    for encoder in ENCODERS
]


@pytest.mark.parametrize(("decoder", "encoder"), PAIRS)
def test_life(decoder: str, encoder: str, configuration: Callable[..., DictConfig], tmp_path: Path) -> None:
    settings = [f"decoder={decoder}", f"encoder={encoder}", *SMALL.get(decoder, []), "frames=4", "size=[16,16]"]
    cfg = configuration("train", *settings, f"out={tmp_path}")
    run_config = {**plain(cfg), "names": {"encoder": encoder, "decoder": decoder}}

    if not count_parameters(instantiate(cfg.decoder, _convert_="all")):
        pytest.skip(f"{decoder} has nothing to learn")

    def system() -> System:
        parts = [instantiate(cfg[part], _convert_="all") for part in ("encoder", "decoder")]
        return instantiate(cfg.system, _partial_=True)(*parts, metrics={"psnr": PSNR()}, run_config=run_config)

    def trainer(steps: int, system: System) -> L.Trainer:
        quiet = {"logger": False, "enable_progress_bar": False, "enable_model_summary": False}
        once = {"max_steps": steps, "limit_val_batches": 0, "enable_checkpointing": False, "accelerator": "cpu"}
        return L.Trainer(**once, **quiet, default_root_dir=tmp_path, plugins=[TrainingCheckpointIO(system, clips)])

    clips, path = ClipLoader(OneClip(), 1), tmp_path / "last.ckpt"
    started = system()
    first = trainer(1, started)
    before = {key: value.clone() for key, value in started.state_dict().items()}
    first.fit(started, clips)
    first.save_checkpoint(path)
    trained = read_checkpoint(path)
    assert any(not torch.equal(before[key], value) for key, value in trained.state.items() if "decoder." in key)

    resumed = system()
    second = trainer(2, resumed)
    second.fit(resumed, clips, ckpt_path=str(path))
    assert second.global_step == 2 and first.global_step == 1
    second.test(resumed, scene_loader([Scene("still", torch.rand(2, 4, 16, 16))]), verbose=False)
    assert resumed.tested["mean"]["psnr"] > 0

    write_weights(tmp_path / "weights.safetensors", trained.config, trained.state)
    again = read_checkpoint(tmp_path / "weights.safetensors").decoder().eval()
    video, mask = torch.rand(1, 16, 16), torch.rand(4, 16, 16)
    assert torch.equal(again(video, mask), trained.decoder().eval()(video, mask))
