"""Fixtures for every test: where the repository, its configuration and the shared real data are."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from hydra import compose, initialize_config_dir
from omegaconf import DictConfig

from sci_lightning.command import CONF

ROOT = Path(__file__).parents[1]
SHARED = ROOT.parent / "shared"


def members(group: str) -> list[str]:
    """The names in a group of the configuration, found by listing it: a new member is tested by being there."""
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))


@pytest.fixture
def configuration() -> Callable[..., DictConfig]:
    """``configuration("train", "decoder=e2e_cnn", ..)``: what a command would run with."""

    def composed(name: str, *overrides: str) -> DictConfig:
        with initialize_config_dir(str(CONF), version_base="1.3"):
            return compose(name, overrides=list(overrides))

    return composed


@pytest.fixture
def shared_data() -> Path:
    """The folder of real scenes and clips, which is not part of the repository."""
    folder = SHARED / "data"
    if not folder.is_dir():
        pytest.skip(f"real data not present ({folder})")
    return folder


@pytest.fixture
def command(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """``command("train", "encoder=lsw_sr", ..)`` runs a command in a process of its own, in an empty folder."""

    def run(name: str, *overrides: str, timeout: float = 300) -> subprocess.CompletedProcess[str]:
        module = f"sci_lightning.{name}" if name else "sci_lightning"
        return subprocess.run(
            [sys.executable, "-m", module, *overrides], cwd=tmp_path, capture_output=True, text=True, timeout=timeout
        )

    return run


@pytest.fixture(autouse=True)
def _seeded() -> None:
    torch.manual_seed(0)
