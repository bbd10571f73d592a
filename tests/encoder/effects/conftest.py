"""Small encoders with effects, and every member of conf/effect at its own values."""

from __future__ import annotations

from functools import cache
from typing import Any

import torch
from hydra import compose, initialize_config_dir
from hydra.utils import get_class

from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.effects import Effect
from sci_lightning.encoder.mask import Mask, RandomStructural
from sci_lightning.encoder.sensor import ClipQuantise, Ideal

T, H, W = 4, 18, 18


class Told(Mask):
    """A mask of given values."""

    def __init__(self, pattern: torch.Tensor) -> None:
        super().__init__(pattern.shape[0], pattern.shape[1:])
        self.pattern = torch.nn.Parameter(pattern.clone())

    def forward(self) -> torch.Tensor:
        return self.pattern


@cache
def configured(name: str) -> dict[str, Any]:
    """What ``conf/effect/<name>.yaml`` says, for a field of T, H, W."""
    with initialize_config_dir(str(CONF), version_base="1.3"):
        cfg = compose("train", overrides=[f"effect={name}", f"frames={T}", f"size=[{H},{W}]"])
    (only,) = cfg.encoder.effects
    assert only == name
    return {str(key): value for key, value in cfg.encoder.effects[name].items()}


def build(name: str, **values: Any) -> Effect:
    """A member of conf/effect, with other values."""
    arguments = {**configured(name), **values}
    return get_class(arguments.pop("_target_"))(**arguments)


def encoder(*effects: Effect, pattern: torch.Tensor | None = None, bits: int | None = None) -> Encoder:
    """With a structural mask (or the pattern told), of ``bits`` or without rounding, aperture 1."""
    mask = RandomStructural(2, T, (H, W), seed=3)() if pattern is None else pattern
    return Encoder(Told(mask), Ideal() if bits is None else ClipQuantise(bits), 1.0, list(effects))


def video(number: int = 2, height: int = H, width: int = W) -> torch.Tensor:
    """Moving stripes with some noise, 0.05 to 0.95."""
    y, x, t = torch.meshgrid(torch.arange(height), torch.arange(width), torch.arange(T), indexing="ij")
    wave = 0.5 + 0.35 * torch.sin(0.7 * x + 0.4 * y + 1.1 * t)
    noise = torch.rand(number, height, width, T, generator=torch.Generator().manual_seed(5))
    return (wave + 0.2 * (noise - 0.5)).clamp(0.05, 0.95).permute(0, 3, 1, 2).contiguous()


def seen(effect: Effect, pattern: torch.Tensor, scene: torch.Tensor | None = None) -> torch.Tensor:
    """``(H, W)``: mean of what one effect makes of a pattern (T, H, W) and a scene like it, an even one by default."""
    scene = torch.ones_like(pattern) if scene is None else scene
    with torch.no_grad():
        return encoder(effect, pattern=pattern)(scene[None])[0]
