"""What ``evaluate`` leaves beside its numbers: a picture of every scene, and effects wherever an encoder is named."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import lightning as L
import numpy as np
import pytest
import torch
from matplotlib.figure import Figure
from PIL import Image

from sci_lightning.data.source import Scene
from sci_lightning.runs.results import with_effects
from sci_lightning.training.callbacks import Pictures, ScenePictures
from tests.training.small_training import BATCHES, EPOCHS, scenes, system_and_trainer

QUICK = ["decoder=gap_tv", "decoder.iterations=[2]", "data=synthetic", "size=[32,32]", "metrics.qscore=null"]
QUICK += ["trainer.accelerator=cpu"]


def test_pictures_of_every_scene_and_effects_in_titles(ran: Callable[..., str], tmp_path: Path) -> None:
    printed = ran("evaluate", *QUICK, "encoder=lsw_sr", "effect=[mask_shift,prnu]", "data.scenes_count=3", "out=run")
    assert "gap_tv, tested on lsw_sr + mask_shift + prnu" in printed and "metrics.json, pictures/" in printed
    result = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert result["test_encoder"] == "lsw_sr" and result["test_effects"] == ["mask_shift", "prnu"]
    pictures = sorted((tmp_path / "run" / "pictures").iterdir())
    assert [path.stem for path in pictures] == sorted(result["scenes"]) and len(pictures) == 3
    for path in pictures:
        with Image.open(path) as picture:
            assert picture.width > 800 and np.asarray(picture.convert("L")).std() > 20


def test_pictures_can_be_limited_and_switched_off(ran: Callable[..., str], tmp_path: Path) -> None:
    printed = ran("evaluate", *QUICK, "data.scenes_count=2", "pictures=1", "out=one")
    assert "gap_tv, tested on rbw_osr " in printed and "rbw_osr +" not in printed
    assert len(list((tmp_path / "one" / "pictures").iterdir())) == 1
    assert "effects" not in json.loads((tmp_path / "one" / "metrics.json").read_text())
    assert ", pictures/" not in ran("evaluate", *QUICK, "data.scenes_count=1", "pictures=0", "out=none")
    assert not (tmp_path / "none" / "pictures").exists()


@pytest.mark.parametrize("names", [["../a", "..*a", "b"], ["$x$", "[/]", "\x1b[2J"]])
def test_names_of_scenes_are_file_names_and_titles(names: list[str], tmp_path: Path) -> None:
    import lightning as L

    from sci_lightning.data.loader import scene_loader
    from sci_lightning.decoder.denoiser import TotalVariation
    from sci_lightning.decoder.gap import GAP
    from sci_lightning.encoder import Encoder
    from sci_lightning.encoder.mask import RandomBinary
    from sci_lightning.encoder.sensor import Ideal
    from sci_lightning.metrics import PSNR
    from sci_lightning.training.system import System

    encoder = Encoder(RandomBinary(2, (16, 16)), Ideal())
    system = System(encoder, GAP(TotalVariation(), strengths=[0.1], iterations=[1]), metrics={"psnr": PSNR()})
    pictures = ScenePictures(tmp_path / "out" / "pictures")
    trainer = L.Trainer(logger=False, enable_progress_bar=False, accelerator="cpu", callbacks=[pictures])
    trainer.test(system, scene_loader([Scene(name, torch.rand(2, 2, 16, 16)) for name in names]), verbose=False)
    written = sorted(tmp_path.rglob("*.png"))
    assert len(written) == 3 and all(path.parent == tmp_path / "out" / "pictures" for path in written)
    assert with_effects("lsw_sr", []) == "lsw_sr"


def test_pictures_of_a_training_replace_links(tmp_path: Path) -> None:
    """A picture is not written through a link that leads out of the folder."""
    (tmp_path / "thesis.tex").write_text("precious")
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "mask.png").symlink_to(tmp_path / "thesis.tex")
    trainer: Any = SimpleNamespace(loggers=[], global_step=0)
    Pictures(str(tmp_path / "pictures"))._show(trainer, [("mask", Figure(), Figure())])
    assert (tmp_path / "thesis.tex").read_text() == "precious"
    assert (tmp_path / "pictures" / "mask.png").read_bytes().startswith(b"\x89PNG")


def test_short_epochs_are_not_all_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Drawing takes a small part of the time; the state at the end is drawn whatever it takes."""
    drawn: list[int] = []

    def show(_: Pictures, trainer: L.Trainer, figures: Any) -> None:
        drawn.append(trainer.global_step)
        time.sleep(0.3)

    monkeypatch.setattr(Pictures, "_show", show)
    system, trainer, clips = system_and_trainer(tmp_path, [Pictures(str(tmp_path / "pictures"))])
    trainer.fit(system, clips, scenes())
    assert drawn == [0, BATCHES, EPOCHS * BATCHES]
