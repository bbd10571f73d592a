"""Scene detail: the target changes within a pixel, where the file states the mean over each."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.target_effects.scene_effect import SceneEffect
from sci_lightning.encoder.effects.parameter import Parameter


class SceneDetail(SceneEffect):
    """Within a pixel, targets slope as their means over pixels do; they have no steps from pixel to pixel.

    That shows where the lens blurs them or where the mask is displaced, and nowhere else. It is a matter of the
    captures and no fault of anything.

    Args:
        share: of the slopes between the means of neighbouring pixels, 0 (steps from pixel to pixel) to 1.5.
    """

    name = "scene_detail"
    rank = 5
    of_captures = imperfection = True
    about = {"share": Parameter("1", 0.0, 0, 1.5, step=0.05, starts=(1.0,))}
    sentence = "targets slope within a pixel by {share} of what their neighbours say"
    share: torch.Tensor

    def on_cells(self, scene: torch.Tensor, cells: int) -> torch.Tensor:
        """Return the scene ``(T, H, W)`` on q x q cells per pixel, ``(T, qH, qW)``; an even one as it is."""
        if scene.shape[-2:] == (1, 1) or cells == 1:
            return scene
        place = ((torch.arange(cells) + 0.5) / cells - 0.5).to(scene)
        place = place * (1 / 12 / place.square().mean()).sqrt()  # the slope's variance over a pixel, not over its cells
        centre, down, across = (
            field[..., :, None, :, None]
            for field in (scene, self.share * _slope(scene, -2), self.share * _slope(scene, -1))
        )
        fine = centre + down * place[:, None, None] + across * place
        return fine.flatten(-4, -3).flatten(-2, -1).clamp(min=0)


def _slope(scene: torch.Tensor, axis: int) -> torch.Tensor:
    """Return half of what the neighbours of every pixel differ by along an axis; beyond the ends the pixel itself."""
    length = scene.shape[axis]
    place = torch.arange(length)
    after, before = (scene.index_select(axis, (place + step).clamp(0, length - 1)) for step in (1, -1))
    return 0.5 * (after - before)
