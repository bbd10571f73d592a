"""The wheel, built from the source distribution, trains outside the repository as a checkout does."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import ROOT

SMALL = [
    "experiment=quickstart",
    "data.clips_per_epoch=8",
    "data.scenes_count=1",
    "metrics.qscore=null",
    "trainer.max_epochs=1",
    "trainer.accelerator=cpu",
]


@pytest.mark.slow
def test_wheel(command: Callable[..., subprocess.CompletedProcess[str]], tmp_path: Path) -> None:
    build = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(tmp_path), str(ROOT)]
    assert subprocess.run(build, capture_output=True).returncode == 0
    (wheel,) = tmp_path.glob("*.whl")
    site = tmp_path / "site"
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", str(site), str(wheel)]
    assert subprocess.run(install, capture_output=True).returncode == 0
    weights = ("weights/universal.safetensors", "weights/universal.md")
    carried = ("conf/train.yaml", "studies/tables/paper_figures.yaml", "py.typed", *weights)
    assert all((site / "sci_lightning" / path).is_file() for path in carried)

    outside = tmp_path / "outside"
    outside.mkdir()
    train = [sys.executable, "-m", "sci_lightning.train", *SMALL, "out=run"]
    environment = {**os.environ, "PYTHONPATH": str(site)}
    done = subprocess.run(train, cwd=outside, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    mask = np.random.default_rng(0).random((8, 32, 32)) < 0.5
    np.save(outside / "mask.npy", mask.astype(np.uint8))
    np.save(outside / "snapshot.npy", (200 * mask.mean(0)).astype(np.uint8))
    decode = [
        sys.executable,
        "-m",
        "sci_lightning.reconstruct",
        "measurement=snapshot.npy",
        "mask=mask.npy",
        "out=decoded",
    ]
    done = subprocess.run(decode, cwd=outside, env=environment, capture_output=True, text=True)
    assert done.returncode == 0 and "weights=universal" in done.stdout, done.stderr
    assert np.load(outside / "decoded" / "reconstruction.npy").shape == (1, 8, 32, 32)

    show = [sys.executable, "-m", "sci_lightning.demo", "out=demo"]
    done = subprocess.run(show, cwd=outside, env=environment, capture_output=True, text=True)
    assert done.returncode == 0 and (outside / "demo" / "demo.gif").stat().st_size > 100_000, done.stderr

    where = [sys.executable, "-c", "import sci_lightning.configuration.conf_folder as c; print(c.CONF)"]
    result = subprocess.run(where, cwd=outside, env=environment, capture_output=True, text=True).stdout
    assert result.strip() == str(site / "sci_lightning" / "conf")

    assert command("train", *SMALL, "out=checkout").returncode == 0
    one, other = (json.loads((path / "metrics.json").read_text()) for path in (outside / "run", tmp_path / "checkout"))
    assert one["scenes"] == other["scenes"]
