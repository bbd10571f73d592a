"""The scenes of all captures: which are lit, and how an effect of the laboratory changes them."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.target_effects import SceneEffect


def lit_scenes(scenes: list[torch.Tensor]) -> torch.Tensor:
    """Return which scenes are not even and dark, ``(N,)`` bool."""
    return torch.tensor([scene.shape[1:] != (1, 1) or bool(scene.any()) for scene in scenes])


def changed_scenes(effect: SceneEffect, scenes: list[torch.Tensor]) -> list[torch.Tensor]:
    """Return scenes changed by an effect, all frames of a shape at once.

    Splines swing below 0 beside steep edges; no target does.
    """
    changed: list[torch.Tensor] = [torch.zeros(())] * len(scenes)
    for shape in {scene.shape[1:] for scene in scenes}:
        members = [n for n, scene in enumerate(scenes) if scene.shape[1:] == shape]
        frames = effect.change(torch.cat([scenes[n] for n in members])).clamp(min=0)
        for n, part in zip(members, frames.split([len(scenes[n]) for n in members]), strict=True):
            changed[n] = part
    return changed
