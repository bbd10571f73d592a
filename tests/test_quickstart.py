"""``experiment=quickstart`` with every encoder, trainable decoder and bit depth: what a new user varies first."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch
from hydra.utils import instantiate
from lightning import Trainer
from omegaconf import DictConfig, OmegaConf

from sci_lightning.decoder.complexity import count_parameters
from sci_lightning.training.system import System
from tests.conftest import members

Configuration = Callable[..., DictConfig]

UNTRAINED = {"admm_tv", "desci", "gap_tv", "linear"}
DECODERS = [name for name in members("decoder") if name not in UNTRAINED]
SHORT = ("quickstart", "cpu", "gpu30")
TINY = ["size=[16,16]", "crop=[16,16]", "batch_size=1"]


def depths(encoder: str) -> range:
    return range(1, 9) if encoder in ("lsw_sr", "rsw_sr") else range(1, 2)


CAMERAS = [(encoder, bits) for encoder in members("encoder") for bits in depths(encoder)]


def one_step(cfg: DictConfig) -> System:
    """Build a run's system and train it on one clip."""
    encoder, decoder = (instantiate(cfg[part], _convert_="all") for part in ("encoder", "decoder"))
    system = instantiate(cfg.system, _partial_=True)(encoder, decoder)
    system.trainer = Trainer(accelerator="cpu", barebones=True)
    optimizer = system.configure_optimizers()["optimizer"]
    system.training_step(torch.rand(1, cfg.frames, *cfg.crop), 0).backward()
    optimizer.step()
    encoder.mask.project_()
    assert isinstance(system, System) and all(torch.isfinite(value).all() for value in system.parameters())
    return system


@pytest.mark.usefixtures("short_design")
@pytest.mark.parametrize(("encoder", "bits"), CAMERAS)
def test_encoders_and_bits(encoder: str, bits: int, configuration: Configuration) -> None:
    choices = [f"encoder={encoder}", f"encoder.mask.bits={bits}", "decoder.channels=4", "decoder.blocks=1"]
    system = one_step(configuration("train", "experiment=quickstart", *choices, *TINY))
    assert system.encoder.mask.bits == bits
    assert system.encoder.mask().unique().numel() <= 2**bits + 1


@pytest.mark.parametrize("decoder", DECODERS)
def test_decoders(decoder: str, configuration: Configuration) -> None:
    """Reduced, by one recipe and one budget of processor time, which is as long on every machine."""
    cfg = configuration("train", "experiment=quickstart", f"decoder={decoder}", "encoder=rbw_sr")
    full = configuration("train", f"decoder={decoder}")
    with torch.device("meta"):
        ours, published = (count_parameters(instantiate(one.decoder, _convert_="all")) for one in (cfg, full))
    assert 0 < ours < published
    assert 0 < cfg.core_minutes <= 2 and cfg.trainer.max_time is None
    assert cfg.decoder.get("first_estimate", "linear") == "linear"
    for key in ("size", "crop"):
        cfg[key] = [16, 16]
    one_step(cfg)


@pytest.mark.parametrize("decoder", sorted(UNTRAINED))
def test_decoders_that_need_no_training(decoder: str, refused: Callable[..., str]) -> None:
    line = refused("train", "experiment=quickstart", f"decoder={decoder}", "out=run")
    assert "nothing to learn: " in line


def test_the_recipe_is_stated_once(configuration: Configuration) -> None:
    """What trains for minutes to an hour has the same loss and rates, whatever the scale."""
    ours, *others = (configuration("train", f"scale={scale}", "decoder=e2e_cnn").system for scale in SHORT)
    assert ours.muon_decay > 0 and all(other == ours for other in others)


def test_the_published_input_is_one_override_away(configuration: Configuration) -> None:
    cfg = configuration("train", "experiment=quickstart", "decoder.first_estimate=published")
    assert instantiate(cfg.decoder, _convert_="all").linear_estimator is None


def test_a_smaller_scale(configuration: Configuration) -> None:
    """The experiment chooses encoder and decoder, the scale the rest."""
    cfg = configuration("train", "experiment=quickstart", "scale=smoke")
    assert cfg.decoder == configuration("train", "scale=smoke", "decoder=e2e_cnn").decoder and cfg.size == [32, 32]


def test_an_encoder_of_its_own_file(configuration: Configuration, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is added to what the file says."""
    from hydra.core.config_store import ConfigStore

    content = OmegaConf.create({"_target_": "sci_lightning.encoder.Encoder", "mask": {"file": "mask.npy"}})
    monkeypatch.setattr(ConfigStore.instance(), "repo", {**ConfigStore.instance().repo})
    ConfigStore.instance().store(group="encoder", name="from_a_file", node=content)
    for choice in ("experiment=quickstart", "scale=cpu", "scale=smoke"):
        assert configuration("train", choice, "encoder=from_a_file").encoder == content


@pytest.mark.slow
@pytest.mark.parametrize("decoder", DECODERS)
def test_every_combination(decoder: str, configuration: Configuration) -> None:
    for encoder, bits in CAMERAS:
        choices = [f"encoder={encoder}", f"encoder.mask.bits={bits}", f"decoder={decoder}"]
        one_step(configuration("train", "experiment=quickstart", *choices, *TINY))
