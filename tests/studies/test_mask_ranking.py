"""The ranking of masks: every mask is trained once, what is there is kept, and the correlation is written."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from sci_lightning.errors import BadInput
from tests.clips import clips
from tests.studies import mask_ranking as study


def few(frames: int, side: int, seed: int) -> dict[str, Callable[[], torch.Tensor]]:
    return {str(level): lambda level=level: torch.full((frames, side, side), level) for level in (0.2, 0.5, 1.0)}


def test_resumed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    clips(tmp_path / "clips", "folder")
    clips(tmp_path / "held_out", "folder")
    monkeypatch.setattr(study, "masks", few)
    settings = {**study.SETTINGS, "frames": 4, "side": 16, "channels": 4, "blocks": 1, "seconds": 0.2}
    places = tmp_path / "clips", tmp_path / "held_out", tmp_path / "r"
    study.rank_masks(*places, settings)
    assert "rank correlation of 3 masks" in capsys.readouterr().out
    content = json.loads((tmp_path / "r" / "mask_ranking.json").read_text())
    assert len(content["masks"]) == 3 and all(row["psnr_dB"] > 0 for row in content["masks"])
    (tmp_path / "r" / "cases" / "0.5.json").unlink()
    monkeypatch.setattr(study, "trained_psnr", lambda *_: 99.0)
    study.rank_masks(*places, settings)
    again = json.loads((tmp_path / "r" / "mask_ranking.json").read_text())["masks"]
    assert [row["psnr_dB"] == 99 for row in again] == [False, True, False]
    with pytest.raises(BadInput, match=r"0\.2\.json: .*seconds=0\.2, now 0\.3"):
        study.rank_masks(*places, {**settings, "seconds": 0.3})


def test_masks_of_different_kinds(monkeypatch: pytest.MonkeyPatch) -> None:
    blank = type("Design", (), {"levels": torch.zeros(3, 8, 8)})
    for name in ("design_structural", "design_binary"):
        monkeypatch.setattr(study, name, lambda *_, **__: blank)
    result = [make() for make in study.masks(3, 20, 0).values()]
    assert len(result) == 24
    assert all(mask.shape == (3, 20, 20) and mask.min() >= 0 and mask.max() <= 1 for mask in result)
