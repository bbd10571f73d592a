"""What the capitals on the pages stand for: small files of every kind that a command reads."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from runpy import run_module
from types import ModuleType

import numpy as np
import pytest
import torch
from hydra.core.config_store import ConfigStore
from scipy.io import savemat
from skimage.io import imsave

import sci_lightning
from sci_lightning.decoder import Res2former
from sci_lightning.virtual_camera import Session, VirtualCamera
from tests.clips import clips
from tests.conftest import ROOT
from tests.decoder.transcriptions import as_published
from tests.documentation.pages import ONLY_IMPORTED, SMALL, SMALL_DECODER, own_files, reduced, split
from tests.encoder_files import encoder_file

Run = Callable[[str], None]
CORRECTED = """
_target_: sci_lightning.encoder.Encoder
mask: {_target_: sci_lightning.encoder.mask.Measured, frames: 8, size: [32, 32], file: patterns.npy}
sensor: {_target_: sci_lightning.encoder.sensor.ClipQuantise, bit_depth: 8}
effects:
  mask_shift: {_target_: sci_lightning.encoder.effects.MaskShift, dx: 0.61, dy: -0.35}
  sync_offset: {_target_: sci_lightning.encoder.effects.SyncOffset, offset: 0.2}
  black_level: {_target_: sci_lightning.encoder.effects.BlackLevel, offset: 0.04}
"""
"""What a diagnosis would write: the diagnosis of the example on its page takes too long for a test."""


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that holds what the pages' capitals stand for."""
    place = tmp_path_factory.mktemp("documentation")
    clips(place / "CLIPS", "folder")
    clips(place / "VALIDATION", "folder")
    (place / "COLOURS").mkdir()
    colours = np.random.default_rng(2).integers(0, 256, (8, 32, 32, 3), np.uint8)
    np.savez(place / "COLOURS" / "clip.npz", frames=colours)
    (place / "SCENES").mkdir()
    for scene in ("kobe", "traffic", "runner", "drop", "crash", "aerial"):
        frames = torch.randint(256, (32, 32, 48), dtype=torch.uint8).numpy()
        savemat(place / "SCENES" / f"{scene}_cacti.mat", {"orig": frames})
    mask = np.random.default_rng(1).integers(0, 2, (32, 32, 8))
    savemat(place / "SCENES" / "lab01.mat", {"orig": frames[..., :8], "mask": mask})
    toolbox = {"meas_bayer": mask.sum(-1) * 100.0, "mask_bayer": mask, "orig": colours.transpose(1, 2, 3, 0)}
    savemat(place / "COLOUR.mat", toolbox)
    savemat(place / "MASK.mat", {"mask": np.random.default_rng(0).integers(0, 2, (32, 32, 8))})
    imsave(place / "SNAPSHOT.tiff", (torch.rand(32, 32) * 255).byte().numpy(), check_contrast=False)
    own_files(place)
    (place / "LAB").mkdir()
    np.save(place / "LAB" / "masks.npy", np.full((8, 32, 32), 1 / 8))
    imsave(place / "LAB" / "grey.tif", np.full((32, 32), 100, np.uint8), check_contrast=False)
    recipe = "{bit_depth: 8, patterns: masks.npy, captures: [{measurement: grey.tif, scene: 0.4}]}"
    (place / "LAB" / "captures.yaml").write_text(recipe)
    session = Session(size=(32, 32), frames=4, dark=2, flat=2, all_on=1, all_off=1, static=2, dynamic=2)
    VirtualCamera(session).write(place / "CAPTURES.h5", seed=0)
    encoder_file(place / "CAMERA", 32)
    encoder_file(place / "FOUND", 32, CORRECTED)
    state = {f"decoder.{key}": value for key, value in as_published(Res2former()).items()}
    torch.save({"state_dict": {"encoder.weight": torch.full((8, 16, 16), 1 / 8), **state}}, place / "PUBLISHED.pth")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        patch.setenv("XDG_CACHE_HOME", str(place / "cache"))
        in_this_process("sci_lightning.train", *SMALL, "decoder=e2e_cnn", *SMALL_DECODER["e2e_cnn"], "out=RUN")
    return place


@pytest.fixture
def stand_ins(folder: Path, short_pictures: None, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of stand-ins as the current one; what a page's commands write stays in it for the next ones."""
    monkeypatch.chdir(folder)
    monkeypatch.syspath_prepend(folder)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    monkeypatch.setenv("MPLBACKEND", "agg")
    return folder


@pytest.fixture
def run_command(stand_ins: Path) -> Run:
    """``run_command("python -m sci_lightning.train ...")`` runs a command of a page at a small size, or fails."""

    def run(command: str) -> None:
        program, *arguments = shlex.split(command)
        if program == "make":
            done = subprocess.run(["make", "--dry-run", "--always-make", "-C", ROOT, *arguments], capture_output=True)
            assert done.returncode == 0 and done.stdout, f"{command}\n{done.stderr.decode()}"
        elif program == "tensorboard":
            (stand_ins / "outputs").mkdir(exist_ok=True)
            done = subprocess.run([sys.executable, "-m", "tensorboard.main", "--inspect", *arguments], timeout=300)
            assert done.returncode == 0, command
        elif program == "pip":
            assert arguments == ["install", "."], "tests/test_wheel.py installs the package"
        elif program == "source":
            assert arguments == [".venv/bin/activate"], "the environment that `make` creates"
        elif (module := split(command)[0]) in ONLY_IMPORTED:
            assert find_spec(module) is not None, command
        else:
            in_this_process(*reduced(split(command)))

    return run


def in_this_process(module: str, *overrides: str) -> None:
    """Run ``python -m module overrides`` without the seconds that a new process needs to import torch."""
    environment = dict(os.environ)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", [module, *overrides])
        patch.delenv("HYDRA_FULL_ERROR", raising=False)
        try:
            run_module(module, run_name="__main__", alter_sys=True)
        except SystemExit as stop:
            assert not stop.code, f"python -m {shlex.join([module, *overrides])} ended with status {stop.code}"
        finally:
            for name in sci_lightning.PUBLIC_NAMES:  # a module of that name would hide the function
                if isinstance(vars(sci_lightning).get(name), ModuleType) and ":" in sci_lightning.PUBLIC_NAMES[name]:
                    delattr(sci_lightning, name)
            # what the command added to these groups: an encoder that it read from a file, the benchmark's decoder=all
            for group in ("encoder", "decoder"):
                ConfigStore.instance().repo.pop(group, None)
            os.environ.clear()
            os.environ.update(environment)
