"""The commands take every reading of the aperture: train, go on, evaluate behind another one, reconstruct."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from sci_lightning.studies.tables.rows import without_places
from tests.encoder_files import TEXT, encoder_file
from tests.training.small_training import TINY

TEST = ["metric=[psnr]", "trainer.accelerator=cpu", "pictures=0"]


def recorded(run: Path) -> dict[str, Any]:
    return json.loads((run / "metrics.json").read_text())  # type: ignore[no-any-return]


def test_from_a_training_to_a_reconstruction(
    ran: Callable[..., str], refused: Callable[..., str], tmp_path: Path
) -> None:
    checkpoint = "ckpt_path=a/checkpoints/last.ckpt"
    per_snapshot = ["encoder=rbw_sr", "encoder.aperture=per_snapshot"]
    ran("train", *TINY, *per_snapshot, "metric=[psnr]", "out=a")
    ran("train", checkpoint, "trainer.max_epochs=3", "out=b")
    config = recorded(tmp_path / "b")["config"]
    assert (config["encoder"]["aperture"], config["encoder"]["told"]) == ("per_snapshot", True)
    scores = {}
    for name, words in {"told": [], "not told": ["encoder.told=false"]}.items():
        ran("evaluate", checkpoint, *per_snapshot, *words, "data=synthetic", *TEST, f"out={name}")
        scores[name] = recorded(tmp_path / name)["mean"]["psnr"]
    ran("evaluate", checkpoint, "data=synthetic", *TEST, "out=own")
    assert recorded(tmp_path / "own")["mean"]["psnr"] == scores["told"] != scores["not told"]
    np.save(tmp_path / "snapshot.npy", np.full((32, 32), 100, np.uint8))
    assert "aperture=NUMBER" in refused("reconstruct", checkpoint, "measurement=snapshot.npy", "out=c")
    assert "aperture=0.25" in ran("reconstruct", checkpoint, "measurement=snapshot.npy", "aperture=0.25", "out=d")


def test_of_a_camera_in_a_file(ran: Callable[..., str], tmp_path: Path) -> None:
    """The word that looks like a path stays what it is, also in what is kept of a row of the tables."""
    path = encoder_file(tmp_path / "camera", text=TEXT.replace("aperture: 1.0", "aperture: 1/T\ntold: false"))
    ran("train", *TINY, f"encoder={path}", "metric=[psnr]", "out=a")
    assert "1/T" not in ran("evaluate", "ckpt_path=a/checkpoints/last.ckpt", "data=synthetic", *TEST, "out=b")
    encoder = without_places(recorded(tmp_path / "a")["config"]["encoder"])
    assert (encoder["aperture"], encoder["told"]) == ("1/T", False)
