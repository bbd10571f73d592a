"""Every configuration composes, and everything it names can be built."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf, open_dict

from sci_lightning.cli.composition import plain
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.encoder import Encoder
from sci_lightning.metrics.frame_metric import FrameMetric
from sci_lightning.training.loggers import RUN_ID
from sci_lightning.training.step import LOSSES
from tests.clips import clips
from tests.conftest import members

GROUPS = sorted(
    {
        str(path.parent.relative_to(CONF))
        for path in CONF.rglob("*.yaml")
        if path.parent != CONF and "hydra" not in str(path.relative_to(CONF))
    }
)


def test_all_groups_are_known() -> None:
    assert set(GROUPS) == {
        "callbacks",
        "data",
        "decoder",
        "effect",
        "encoder",
        "encoder/mask",
        "encoder/sensor",
        "experiment",
        "hparams_search",
        "logger",
        "metric",
        "scale",
        "scale/denoiser/quickstart",
        "system",
        "trainer",
    }


@pytest.mark.parametrize(("group", "name"), [(group, name) for group in GROUPS for name in members(group)])
def test_member_composes_and_instantiates(
    group: str, name: str, configuration: Callable[..., DictConfig], tmp_path: Path
) -> None:
    choice = [f"{group}={name}"]
    if group == "scale/denoiser/quickstart":  # chosen by these two
        choice = ["scale=quickstart", f"decoder={name}"]
    if group == "logger" and name in RUN_ID:
        pytest.importorskip(name, reason=f"pip install sci-lightning[{name}]")
    if group == "hparams_search":
        pytest.importorskip("hydra_plugins.hydra_optuna_sweeper", reason="pip install sci-lightning[optuna]")
    if group == "trainer" and name in ("gpu", "fsdp") and not torch.cuda.is_available():
        pytest.skip("Lightning refuses it without a GPU")
    # Lightning does not know precision=auto, which the commands resolve
    cfg = configuration("train", *choice, "precision=32-true", "size=[64,64]", f"out={tmp_path}")
    with open_dict(cfg):
        if OmegaConf.is_missing(cfg.encoder.mask, "file"):
            np.save(tmp_path / "mask.npy", np.ones((8, 64, 64)) / 8)
            cfg.encoder.mask.file = str(tmp_path / "mask.npy")
        if OmegaConf.is_missing(cfg.data, "root"):
            cfg.data.root = str(clips(tmp_path, cfg.data._target_.rpartition(".")[2].lower()))
        if cfg.encoder.mask.get("start") == "designed":  # a search of half a minute, which tests/encoder makes shorter
            cfg.encoder.mask.start = "published"
    plain(cfg)
    assert isinstance(instantiate(cfg.encoder, _convert_="all"), Encoder)
    built = [instantiate(cfg[part], _convert_="all") for part in ("data", "trainer")]
    with torch.device("meta"):  # the largest decoder's weights would take gigabytes
        built.append(instantiate(cfg.decoder, _convert_="all"))
    built += [instantiate(each) for part in ("callbacks", "logger") for each in cfg[part].values() if each]
    assert all(part is not None for part in built)
    assert instantiate(cfg.system, _partial_=True).keywords["loss"] in LOSSES
    assert all(isinstance(instantiate(metric), FrameMetric) for metric in cfg.metrics.values())


@pytest.mark.parametrize("name", sorted(path.stem for path in CONF.glob("*.yaml")))
def test_command_composes(name: str, configuration: Callable[..., DictConfig]) -> None:
    cfg = configuration(name)
    if name not in ("reveal", "captures_register"):  # which only print, or write into what they read
        assert cfg.out.startswith(f"outputs/{'captures' if name.startswith('captures_') else name}/")
    assert "debug" in cfg
    with open_dict(cfg):
        for key in [key for key in cfg if OmegaConf.is_missing(cfg, key)]:
            cfg[key] = "given"
        if "data" in cfg and OmegaConf.is_missing(cfg.data, "root"):
            cfg.data.root = "given"
    plain(cfg)
