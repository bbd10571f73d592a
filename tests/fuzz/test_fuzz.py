"""Mutated checkpoints, encoder files and overrides end with an object or with one line, and nothing is executed.

The same cases in every run of the tests, about a minute of one core; ``-m slow`` draws new ones for about an hour.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from hydra import compose, initialize_config_dir
from hydra.core.config_store import ConfigStore
from hydra.errors import HydraException
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf
from omegaconf.errors import OmegaConfBaseException

from sci_lightning.cli.composition import built
from sci_lightning.cli.encoder_file import adopt_encoder_files
from sci_lightning.cli.settings import check_command_settings
from sci_lightning.configuration.build import build_from_file
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.decoder import Decoder
from sci_lightning.encoder import Encoder
from sci_lightning.errors import BadInput
from sci_lightning.runs.checkpoint import Checkpoint, read_checkpoint, write_weights
from tests.fuzz.hostile import mutations, values
from tests.runs.small_checkpoint import CONFIG, content
from tests.training.small_training import TINY

SHORT = settings(
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
KEYS = st.sampled_from(
    [
        "_target_",
        "_args_",
        "_partial_",
        "defaults",
        "hydra",
        "a",
        "frames",
        "size",
        "seed",
        "mask",
        "effects",
        "${x}",
        "",
    ]
)
CAMERA: dict[str, Any] = {
    **CONFIG["encoder"],
    "aperture": "auto",
    "mask": {**CONFIG["encoder"]["mask"], "frames": "${frames}", "size": "${size}"},
    "effects": {"mask_shift": {"_target_": "sci_lightning.encoder.effects.MaskShift", "dx": 0.5, "dy": 0.0}},
}


def check_line(error: Exception) -> None:
    """A message that a terminal can show on one line."""
    assert str(error).isprintable(), repr(str(error))
    assert len(str(error)) < 1000


def open_checkpoint(path: Path) -> tuple[Checkpoint, Encoder, Decoder] | None:
    """A checkpoint, its encoder and its decoder, or None where it is refused."""
    try:
        checkpoint = read_checkpoint(path)
        return checkpoint, checkpoint.encoder(), checkpoint.decoder()
    except BadInput as error:
        check_line(error)
        return None


def mutated_checkpoint(folder: Path, changed: Any) -> None:
    torch.save(changed, folder / "a.ckpt")
    if opened := open_checkpoint(folder / "a.ckpt"):
        _, encoder, decoder = opened
        assert isinstance(encoder, Encoder) and isinstance(decoder, Decoder)


def damaged_checkpoint(folder: Path, name: str, place: int, change: bytes, cut: bool) -> None:
    whole = content()
    write_weights(folder / name, whole["config"], whole["state_dict"])
    written = bytearray((folder / name).read_bytes())
    place %= len(written)
    if cut:
        del written[place:]
    else:
        written[place : place + len(change)] = change
    (folder / name).write_bytes(written)
    if opened := open_checkpoint(folder / name):
        checkpoint, *_ = opened
        assert checkpoint.config == whole["config"]
        assert all(torch.equal(value, checkpoint.state[key]) for key, value in whole["state_dict"].items())


def mutated_encoder_file(folder: Path, changed: Any) -> None:
    path = folder / "camera.yaml"
    path.write_text(yaml.safe_dump(changed, allow_unicode=True))
    try:
        adopted = adopt_encoder_files([f"encoder={path}"])
        with initialize_config_dir(str(CONF), version_base="1.3"):
            cfg = compose("train", [*adopted, "frames=4", "size=[8,8]"])
        cfg.encoder.pop("from_file")
        settings_ = OmegaConf.to_container(cfg.encoder, resolve=True)
        assert isinstance(settings_, dict) and settings_["_target_"] == changed["_target_"]
        assert isinstance(build_from_file(settings_, path, "encoder"), Encoder)  # type: ignore[arg-type]
    except BadInput as error:
        check_line(error)
    except (HydraException, OmegaConfBaseException):  # what is missing or does not compose; one line by the commands
        pass
    finally:
        ConfigStore.instance().repo.pop("encoder", None)


def wrong_override(folder: Path, key: str, value: Any) -> None:
    try:
        with initialize_config_dir(str(CONF), version_base="1.3"):
            cfg = compose("train", [*TINY, "out=out"])
        OmegaConf.update(cfg, key, value)
        check_command_settings(cfg, "train")
        for part in ("encoder", "decoder", "data"):
            built(cfg, part)
    except BadInput as error:
        check_line(error)
    except (HydraException, OmegaConfBaseException):
        pass


OVERRIDES = st.sampled_from(
    [
        *("frames", "size", "crop", "seed", "batch_size", "workers", "out", "resume", "trusted"),
        *("encoder.mask", "encoder.mask.bits", "encoder.mask.frames", "encoder.mask.size", "encoder.mask.tile"),
        *("encoder.mask.seed", "encoder.mask.sharpness", "encoder.aperture", "encoder.sensor.bit_depth"),
        *("encoder.sensor.full_well", "encoder.sensor.read_noise", "decoder.channels", "decoder.blocks"),
        *("decoder.frames", "decoder.input_residual", "data.clips_per_epoch", "data.size", "data.scenes_count"),
    ]
)
BYTES = (
    st.sampled_from(["a.ckpt", "a.safetensors"]),
    st.integers(0, 10**6),
    st.binary(min_size=1, max_size=8),
    st.booleans(),
)


@settings(SHORT, max_examples=100)
@given(mutations({**content(), "config": CONFIG}, KEYS))
def test_mutated_checkpoint(alone: Path, changed: Any) -> None:
    mutated_checkpoint(alone, changed)


@settings(SHORT, max_examples=100)
@given(mutations(CONFIG, KEYS))
def test_mutated_configuration(alone: Path, changed: Any) -> None:
    mutated_checkpoint(alone, {**content(), "config": changed})


@settings(SHORT, max_examples=100)
@given(*BYTES)
def test_damaged_checkpoint(alone: Path, name: str, place: int, change: bytes, cut: bool) -> None:
    damaged_checkpoint(alone, name, place, change, cut)


@settings(SHORT, max_examples=25)
@given(mutations(CAMERA, KEYS))
def test_mutated_encoder_file(alone: Path, changed: Any) -> None:
    mutated_encoder_file(alone, changed)


@settings(SHORT, max_examples=12)
@given(OVERRIDES, values())
def test_wrong_override(alone: Path, key: str, value: Any) -> None:
    wrong_override(alone, key, value)


LONG = settings(SHORT, derandomize=False)


@pytest.mark.slow
@settings(LONG, max_examples=40_000)
@given(mutations({**content(), "config": CONFIG}, KEYS, most=6))
def test_mutated_checkpoint_for_long(alone: Path, changed: Any) -> None:
    mutated_checkpoint(alone, changed)


@pytest.mark.slow
@settings(LONG, max_examples=40_000)
@given(mutations(CONFIG, KEYS, most=6))
def test_mutated_configuration_for_long(alone: Path, changed: Any) -> None:
    mutated_checkpoint(alone, {**content(), "config": changed})


@pytest.mark.slow
@settings(LONG, max_examples=40_000)
@given(*BYTES)
def test_damaged_checkpoint_for_long(alone: Path, name: str, place: int, change: bytes, cut: bool) -> None:
    damaged_checkpoint(alone, name, place, change, cut)


@pytest.mark.slow
@settings(LONG, max_examples=3_000)
@given(mutations(CAMERA, KEYS, most=6))
def test_mutated_encoder_file_for_long(alone: Path, changed: Any) -> None:
    mutated_encoder_file(alone, changed)


@pytest.mark.slow
@settings(LONG, max_examples=3_000)
@given(OVERRIDES, values())
def test_wrong_override_for_long(alone: Path, key: str, value: Any) -> None:
    wrong_override(alone, key, value)
