"""The light behind the modulator: what its patterns let through of the scene of every capture."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from sci_lightning.diagnosis.model.observation import Observation
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.imaging.operator import SnapshotOperator, even_light


def modulated_light(
    path: LightPath, shown: torch.Tensor, observation: Observation, scenes: Sequence[torch.Tensor], lit: torch.Tensor
) -> torch.Tensor:
    """Return the sum over the slots of mask times scene, ``(N, qH, qW)``.

    Args:
        path: of the light.
        shown: ``(P, qH, qW)``, images of the patterns on the sensor.
        observation: the captures.
        scenes: of the captures, ``(T, H, W)``; one frame where a scene is at rest, one pixel where it is even.
        lit: ``(N,)`` bool, scenes that are not dark.
    """
    light = shown.new_zeros(len(observation), *shown.shape[-2:])
    if not path.mixes_slots(observation.frames):
        numbers = lit.nonzero()[:, 0].tolist()
        _add_up(light, numbers, shown, observation.sequences, observation.sequence, scenes, path.cells)
        return light
    in_order = torch.arange(observation.frames)[None]
    for which, sequence in enumerate(observation.sequences):  # one by one: the masks of all do not fit in memory
        numbers = ((observation.sequence == which) & lit).nonzero()[:, 0].tolist()
        if numbers:
            masks = path.during(shown, sequence[None])[0]
            _add_up(light, numbers, masks, in_order, torch.zeros_like(observation.sequence), scenes, path.cells)
    return light


def _add_up(
    light: torch.Tensor,
    numbers: Sequence[int],
    images: torch.Tensor,
    sequences: torch.Tensor,
    sequence: torch.Tensor,
    scenes: Sequence[torch.Tensor],
    cells: int,
) -> None:
    """Write the sum over the slots for some captures into ``light``.

    Args:
        light: ``(N, qH, qW)`` of all captures.
        numbers: of the captures.
        images: ``(P, qH, qW)``, what multiplies the scenes.
        sequences: ``(U, T)``, which image each slot has.
        sequence: ``(N,)``, which sequence each capture has.
        scenes: of all captures.
        cells: q.
    """
    even, still, moving = [], list[int](), dict[int, list[int]]()
    for number in numbers:
        scene = scenes[number]
        if scene.shape[1:] == (1, 1):
            even.append(number)
        elif len(scene) == 1:
            still.append(number)
        else:
            moving.setdefault(int(sequence[number]), []).append(number)
    if even:
        levels = torch.stack([scenes[number].flatten().expand(sequences.shape[1]) for number in even])
        light[even] = even_light(images, sequences[sequence[even]], levels)
    if still:
        used, which = torch.unique(sequence[still], return_inverse=True)
        totals = even_light(images, sequences[used], torch.ones(len(used), sequences.shape[1]))
        operator = SnapshotOperator(images, cells)
        for number, place in zip(still, which.tolist(), strict=True):
            light[number] = operator.static_scene(scenes[number], totals[place])[0]
    for place, members in moving.items():
        # cells are many: they are added up slot by slot, without memory for every slot's product
        operator = SnapshotOperator(images[sequences[place]], cells, slot_by_slot=cells > 1)
        for number in members:
            light[number] = operator(scenes[number][None])[0]
