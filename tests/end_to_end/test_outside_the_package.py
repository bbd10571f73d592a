"""A decoder and an effect in a folder of the user's own, beside an installed wheel, as the how-to pages show it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat
from skimage.io import imsave

from sci_lightning.virtual_camera import Session, VirtualCamera
from tests.conftest import ROOT
from tests.documentation.pages import commands, own_files, reduced, split

ONE_AFTER_THE_OTHER = """
import json, runpy, sys
from hydra.core.config_store import ConfigStore
for module, *words in json.loads(sys.argv[1]):
    sys.argv = [module, *words]
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except SystemExit as stop:
        assert not stop.code, (module, words)
    for group in ("encoder", "decoder"):  # to which a command adds what it reads from files
        ConfigStore.instance().repo.pop(group, None)
"""
"""What ``python -m`` does with each of several command lines, in one process, which imports torch once."""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the installed package and nothing else."""
    place = tmp_path_factory.mktemp("wheel")
    build = ["-m", "build", "--wheel", "--no-isolation", "--outdir", str(place), str(ROOT)]
    subprocess.run([sys.executable, *build], check=True, capture_output=True)
    (built,) = place.glob("*.whl")
    install = ["-m", "pip", "install", "--quiet", "--no-deps", "--target", str(place / "site"), str(built)]
    subprocess.run([sys.executable, *install], check=True, capture_output=True)
    return place / "site"


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The user's folder: the files that the pages tell them to write, and what their camera recorded."""
    place = tmp_path_factory.mktemp("lab")
    own_files(place)
    session = Session(size=(32, 32), frames=4, dark=2, flat=2, all_on=1, all_off=1, static=2, dynamic=2)
    VirtualCamera(session).write(place / "CAPTURES.h5", seed=0)
    savemat(place / "MASK.mat", {"mask": np.random.default_rng(0).integers(0, 2, (32, 32, 8))})
    imsave(place / "SNAPSHOT.tiff", np.full((32, 32), 100, np.uint8), check_contrast=False)
    return place


def test_the_commands_of_the_pages(wheel: Path, lab: Path) -> None:
    environment = {**os.environ, "PYTHONPATH": str(wheel), "OMP_NUM_THREADS": "1", "MPLBACKEND": "agg"}
    pages = (ROOT / "docs" / "how-to" / f"{page}.md" for page in ("add-a-decoder", "effects"))
    lines = [reduced(split(line)) for page in pages for line in commands(page) if "my_" in line]
    assert len(lines) == 6
    lines = [[*line, "out=FOUND"] if line[0].endswith("diagnose") else line for line in lines]
    run = [sys.executable, "-c", ONE_AFTER_THE_OTHER, json.dumps(lines)]
    done = subprocess.run(run, cwd=lab, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    report = json.loads((lab / "FOUND" / "report.json").read_text())
    assert report["considered"]["shade"] == "my_effect.Shade" and "mask_blur" not in report["considered"]
    assert "of your own: shade (my_effect.Shade)" in (lab / "FOUND" / "report.html").read_text()


def test_the_program_imports_from_the_current_folder(wheel: Path, lab: Path) -> None:
    """``sci-lightning reconstruct`` is ``python -m sci_lightning.reconstruct``, also in this."""
    start = "import sys; sys.path.remove(''); from sci_lightning.__main__ import main; main()"
    words = ["reconstruct", "ckpt_path=MINE/checkpoints/last.ckpt", "measurement=SNAPSHOT.tiff", "mask=MASK.mat"]
    program = [sys.executable, "-c", start, *words, "trusted=[my_decoder]", "out=BY_PROGRAM"]
    environment = {**os.environ, "PYTHONPATH": str(wheel)}
    done = subprocess.run(program, cwd=lab, env=environment, capture_output=True, text=True)
    assert done.returncode == 0 and (lab / "BY_PROGRAM" / "video.gif").is_file(), done.stderr
