"""The input of the camera for a number of captures: patterns, scenes and exposure settings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sci_lightning.errors import BadInput


@dataclass(frozen=True)
class World:
    """Patterns and scenes with what lies beyond the field, which no captures file states.

    Attributes:
        border: B, pixels on each side of the field.
        patterns: (P, H + 2 B, W + 2 B) in [0, 1]; their middle is what the modulator is commanded to display.
        scene: (N, T, H + 2 B, W + 2 B) float32 irradiance in [0, 1].
    """

    border: int
    patterns: np.ndarray
    scene: np.ndarray


@dataclass(frozen=True)
class Acquisition:
    """Everything that is set before N captures are taken.

    Attributes:
        patterns: (P, H, W) in [0, 1], the patterns in the modulator's memory.
        sequence: (N, T) index of the pattern that is commanded for every slot.
        scene: (N, T, H, W) float32 irradiance in [0, 1], also for captures whose scene the file does not state.
        aperture: (N,) scale of the light.
        exposure: (N,) integration time relative to nominal. It scales what collects without the scene's light (hot
            pixels, a light leak) and nothing else: a scene's irradiance is what arrives over its whole exposure.
        kind: N labels.
        world: patterns and scenes as they go on beyond the field; None if there is nothing but the field.

    Raises:
        BadInput: shapes that do not go together, or a sequence with indices outside the patterns.
    """

    patterns: np.ndarray
    sequence: np.ndarray
    scene: np.ndarray
    aperture: np.ndarray
    exposure: np.ndarray
    kind: tuple[str, ...]
    world: World | None = None

    def __post_init__(self) -> None:
        count, slots = self.sequence.shape
        if self.scene.shape != (count, slots, *self.patterns.shape[1:]):
            raise BadInput(
                f"scene is {self.scene.shape}, expected (N, T, H, W) = {(count, slots, *self.patterns.shape[1:])} "
                "of the sequence and the patterns"
            )
        if self.sequence.size and not 0 <= self.sequence.min() <= self.sequence.max() < len(self.patterns):
            raise BadInput(f"sequence has indices outside the patterns 0 to {len(self.patterns) - 1}")
        if self.world is not None and self.world.scene.shape[2:] != self.world.patterns.shape[1:]:
            raise BadInput("world: patterns and scene must have the same size")
        if not len(self.aperture) == len(self.exposure) == len(self.kind) == count:
            raise BadInput(f"aperture, exposure and kind must have {count} entries, one per capture")

    @property
    def border(self) -> int:
        """Pixels on each side of the field that are known of the world beyond it."""
        return 0 if self.world is None else self.world.border
