"""Fixtures for every test: where the repository, its configuration and the shared real data are."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from copy import deepcopy
from importlib import import_module
from pathlib import Path

import pytest
import torch
from hydra import compose, initialize_config_dir
from hydra.core.config_store import ConfigStore
from hydra.core.plugins import Plugins
from omegaconf import DictConfig

from sci_lightning.cli import command as command_frame
from sci_lightning.cli.composition import store_defaults
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.encoder.mask import design
from tests.parsed_once import parse_once
from tests.warm_process import WarmProcesses

ROOT = Path(__file__).parents[1]
SHARED = ROOT.parent / "shared"


LONGEST = (
    "test_ddp.py",
    "test_sweep.py",
    "test_wheel.py",
    "test_resume.py",
    "test_diagnosis.py",
    "test_how_to.py",
    "test_bad_input.py",
    "test_stop_signal.py",
    "test_every_decoder.py",
    "test_trial.py",
)
"""Files that take minutes: begun first, so that no process is left with one of them when the others are done."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the files that take longest; the order is otherwise as collected."""
    items.sort(key=lambda item: item.path.name not in LONGEST)


def members(group: str) -> list[str]:
    """The names in a group of the configuration, found by listing it: a new member is tested by being there."""
    return sorted(path.stem for path in (CONF / group).glob("*.yaml"))


def next_lines(printed: str) -> list[str]:
    """The lines that a command says to run next."""
    return re.findall(r"^(?:next:|  or:) (.*)$", printed, re.MULTILINE)


@pytest.fixture
def short_design(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The search for a designed mask, which takes seconds, ends after one step; what it found is forgotten after."""
    for name in ("design_structural", "design_binary"):
        search = getattr(design, name)
        monkeypatch.setattr(design, name, lambda *given, search=search, **more: search(*given, **{**more, "steps": 1}))
    design.designed_start.cache_clear()
    yield
    design.designed_start.cache_clear()


@pytest.fixture
def short_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """The picture of a table shows a few of its rows and says how many more there are; all would take seconds."""
    monkeypatch.setattr("sci_lightning.studies.tables.grid.MOST_DRAWN", 3)


@pytest.fixture
def adopted_encoders() -> Iterator[None]:
    """Encoder files that a test adopts in this process are gone after it."""
    yield
    ConfigStore.instance().repo.pop("encoder", None)


@pytest.fixture
def configuration() -> Callable[..., DictConfig]:
    """``configuration("train", "decoder=e2e_cnn", ..)``: what a command would run with."""

    def composed(name: str, *overrides: str) -> DictConfig:
        store_defaults()
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


@pytest.fixture(scope="session")
def shared_reference() -> Path:
    """The folder of reference values of other people's programs, which is not part of the repository."""
    folder = SHARED / "reference"
    if not folder.is_dir():
        pytest.skip(f"reference values not present ({folder})")
    return folder


@pytest.fixture
def reference() -> Path:
    """The folder of facts about published decoders (JSON), which is not part of the repository."""
    folder = SHARED / "reference" / "decoders"
    if not folder.is_dir():
        pytest.skip(f"facts about published decoders not present ({folder})")
    return folder


@pytest.fixture(scope="session")
def warm_processes() -> Iterator[WarmProcesses]:
    """Processes in which the libraries are imported already, see :mod:`tests.warm_process`."""
    processes = WarmProcesses(ROOT)
    yield processes
    processes.close()


@pytest.fixture
def command(tmp_path: Path, warm_processes: WarmProcesses) -> Callable[..., subprocess.CompletedProcess[str]]:
    """``command("train", "encoder=lsw_sr", ..)`` runs a command in a process of its own, in an empty folder."""

    def run(name: str, *overrides: str, timeout: float = 300) -> subprocess.CompletedProcess[str]:
        module = f"sci_lightning.{name}" if name else "sci_lightning"
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}  # callbacks of the tests can be named in overrides
        return warm_processes.run(module, overrides, tmp_path, environment, timeout)

    return run


@pytest.fixture
def ran(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """``ran("convert", "out=a.ckpt", ..)``: run a command in this process, return what it prints."""

    def run(name: str, *overrides: str) -> str:
        monkeypatch.chdir(tmp_path)
        # what one command adds to Hydra's choices, another one of the same process does not have
        Plugins.instance()  # whose choices are there for good
        monkeypatch.setattr(ConfigStore.instance(), "repo", deepcopy(ConfigStore.instance().repo))
        monkeypatch.setattr(sys, "argv", [name, *overrides])
        monkeypatch.delenv("HYDRA_FULL_ERROR", raising=False)
        capsys.readouterr()
        module = import_module(f"sci_lightning.cli.commands.{name}")
        command_frame.run(name, getattr(module, name))
        return capsys.readouterr().out

    return run


@pytest.fixture
def refused(ran: Callable[..., str], capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """``refused("train", "decoder=none")``: run a command in this process, see it refuse, return its one line."""

    def run(name: str, *overrides: str, status: int = 2) -> str:
        with pytest.raises(SystemExit) as caught:
            ran(name, *overrides)
        lines = [line for line in capsys.readouterr().err.splitlines() if line.startswith("error: ")]
        assert len(lines) == 1, lines
        assert caught.value.code == status, lines[0]
        return lines[0]

    return run


@pytest.fixture(scope="session", autouse=True)
def _files_of_the_configuration_are_parsed_once() -> None:
    parse_once()


@pytest.fixture(autouse=True)
def _seeded() -> None:
    torch.manual_seed(0)
