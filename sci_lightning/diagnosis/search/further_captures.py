"""Captures that a laboratory could take next; their use is computed before they are taken."""

from __future__ import annotations

from dataclasses import replace

import torch

from sci_lightning.diagnosis.model.observation import Observation

SEED = 0
"""Seed of the textures."""
STRONG_LIGHT = 16.0
"""Light of captures whose pixels are nominally dark, relative to the nominal light, so that a small leak shows."""


def further_captures(observation: Observation) -> dict[str, Observation]:
    """Return one capture of every kind with the patterns of this camera; keys say what has to be recorded.

    Besides the usual kinds there are the coding patterns in reverse order and every second one twice in a row, and one
    open pattern with light in one slot only: its own, or one of the two after it. The simplest to record come first.
    Measurements are 0: only predictions are of use.
    """
    frames, (height, width) = observation.frames, observation.size
    random = torch.Generator().manual_seed(SEED)
    texture = torch.nn.functional.interpolate(
        torch.rand(1, frames, height // 4 + 1, width // 4 + 1, generator=random), (height, width), mode="bilinear"
    )[0]
    coding = torch.arange(frames) % len(observation.patterns)
    means = observation.patterns.mean((1, 2))
    shown = frames // 2
    single, open_once = (torch.full((frames,), int(means.argmin())) for _ in range(2))
    single[shown] = int(observation.patterns[:frames].var((1, 2), correction=0).argmax())
    open_once[shown] = int(means.argmax())
    open_ = float(observation.patterns[coding].sum(0).mean().clamp(min=1e-3))
    flat, one = torch.ones(frames, 1, 1), torch.ones(1, 1, 1)

    def pulse(after: int) -> torch.Tensor:
        return flat * (torch.arange(frames) == (shown + after) % frames)[:, None, None]

    alone = f"the most open pattern in slot {shown + 1} of {frames} and the most closed one in all others"
    slot = [(shown + after) % frames + 1 for after in range(3)]
    kinds: dict[str, tuple[torch.Tensor, torch.Tensor, float, float]] = {
        "the dark with four times the exposure": (coding, 0 * flat, 1.0, 4.0),
        "a bright even scene behind the coding patterns": (coding, flat, 0.9 / open_, 1.0),
        "a dim even scene behind the coding patterns": (coding, flat, 0.2 / open_, 1.0),
        "a bright even scene behind one coding pattern, the most closed pattern in all other slots": (
            single,
            flat,
            0.9,
            1.0,
        ),
        "a texture at rest behind the coding patterns": (coding, texture[:1], 0.9 / open_, 1.0),
        "a moving texture behind the coding patterns": (coding, texture, 0.9 / open_, 1.0),
        "a moving texture behind the coding patterns in reverse order": (coding.flip(0), texture, 0.9 / open_, 1.0),
        "a moving texture behind every second coding pattern, each shown twice in a row": (
            coding // 2 * 2,
            texture,
            0.9 / open_,
            1.0,
        ),
        f"an even scene that is lit in slot {slot[0]} only, behind {alone}": (open_once, pulse(0), 0.9, 1.0),
    }
    for after in (1, 2):
        lit = (
            f"an even scene that is lit in slot {slot[after]} only, {STRONG_LIGHT:.0f} times as bright, behind {alone}"
        )
        kinds[lit] = (open_once, pulse(after), STRONG_LIGHT, 1.0)
    return {
        kind: replace(
            observation,
            sequences=sequence[None],
            sequence=torch.zeros(1, dtype=torch.long),
            scene=[scene],
            aperture=aperture * one,
            exposure=exposure * one,
            dn=torch.zeros(1, height, width),
            kinds=("further",),
            number=torch.zeros(1, dtype=torch.long),
            position=None,
            before=None,
        )
        for kind, (sequence, scene, aperture, exposure) in kinds.items()
    }
