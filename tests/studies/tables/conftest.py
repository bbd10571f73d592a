"""Hand-made ``metrics.json`` files."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

MASKS = {"rbw": "RandomBinary", "rsw": "RandomStructural", "fsw": "RandomStructural", "lsw": "LearnedStructural"}

Made = Callable[..., Path]


@pytest.fixture
def made(tmp_path: Path) -> Made:
    """``made("runs/a", "lsw_sr", "e2e_cnn", 30.0, bits=4)``: the file of a run with that PSNR."""

    def make(
        place: str,
        encoder: str,
        decoder: str,
        psnr: float,
        *,
        test: str | None = None,
        bits: int | None = None,
        seed: int = 0,
        scale: str = "small",
        size: tuple[int, int] = (64, 64),
        metrics: tuple[str, ...] = ("psnr", "ssim", "qscore"),
        effects: dict[str, Any] | None = None,
        baseline: float = 15.0,
        unevenness: float = 0.0,
        steps: int | None = None,
        parameters: int = 1000,
        mask: dict[str, Any] | None = None,
    ) -> Path:
        target = f"sci_lightning.encoder.mask.{MASKS[encoder[:3]]}"
        settings = {"_target_": target, **({"bits": bits} if bits else {}), **(mask or {})}
        config = {"encoder": {"mask": settings, "effects": effects or {}}, "seed": seed, "size": size, "scale": scale}
        every = {"psnr": psnr, "ssim": psnr / 40, "qscore": psnr + 15}
        mean = {key: every[key] for key in metrics}
        scenes = {
            scene: {key: value + number * unevenness for key, value in mean.items()}
            for number, scene in ((-1, "kobe"), (0, "runner"), (1, "drop"))
        }
        content = {
            "format": "sci-metrics",
            "format_version": 1,
            "encoder": encoder,
            "decoder": decoder,
            "test_encoder": test or encoder,
            "scenes": scenes,
            "mean": mean,
            "baseline": {**mean, "psnr": baseline},
            "conventions": {"qscore": "Q of HDR-VDP-2.2.2"},
            "parameters": parameters,
            "macs": 1000,
            "seconds_per_measurement": 0.25,
            "device": "cpu (x86-64)",
            **({} if steps is None else {"training_steps": steps}),
            "config": config,
        }
        path = tmp_path / place / "metrics.json"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(content))
        return path

    return make
