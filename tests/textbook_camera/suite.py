"""The sealed suite: 64 cameras of a round, their hidden deviations, and the truth that a diagnosis is judged by.

The seed of a case is the number in the first 8 bytes (big-endian) of sha256(b"textbook-camera <round> <case number>");
cases count from 1, and number 0 draws what is dealt to them. A new sealed round is one other number.

* Cases 1 to 6 hide nothing, 7 to 30 one deviation, 31 to 44 two, 45 to 52 three, 53 to 64 one without a word.
* The words are dealt from a shuffled deck of all of them, then from another one, so that each is hidden at least once
  in a round; a word that cannot be told from one in the same case, or excludes it (``APART``), waits for the next
  case. The deviations without a word are dealt from a deck of their own.
* Cases whose number and round add up to an even number stand in the ``clean`` world, the others in the ``laboratory``.
* Strengths are drawn as ``vocabulary.py`` states.

In the clean world scenes are shown frame by frame, in step with the slots; in the laboratory, and with bit planes, they
move within a slot. In both worlds they have detail within a pixel. The nominal camera is exact all the same, because a
mirror covers a pixel; a mask displaced by a fraction of a pixel is not quite the product of its pixel means with the
scene's (a reduced chi-square up to 2 in textured captures at (1.2, -0.5) pixels, 1 in flat ones). That remainder is
no hidden deviation: a name for it is wrong.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from tests.textbook_camera.camera import PIXEL_UM, Camera, Datasheet
from tests.textbook_camera.recording import capture
from tests.textbook_camera.vocabulary import OUTSIDE, WORDS, Deviation, Values

GROUPS = {"nothing": (6, 0), "single": (24, 1), "pair": (14, 2), "triple": (8, 3), "outside": (12, 1)}
"""Cases of each group, and deviations in each of its cases."""

APART = (
    {"gain", "duty_cycle"},
    {"mask_lag", "sync_offset", "pattern_order"},
    {"optical_blur", "field_blur"},
    {"vignetting", "illumination"},
    {"rolling_shutter", "phased_reset"},
    {"response_gamma", "scene_gamma"},
    {"bit_planes", "mask_level_gamma"},
    {"bit_planes", "mask_lag"},
    {"mask_orientation", "mask_rotation"},
    {"mask_orientation", "mask_shift"},
)
"""Groups of which a case holds one at most: the same to the captures, or meaningless together."""

RELAY_MAGNITUDES = {"mask_rotation": ("angle", np.pi / 180.0, 0.0), "mask_scale": ("scale", 1.0, 1.0)}
"""Parameter of the relative displacement that a deviation of the relay makes, its unit, and its ideal value."""


@dataclass(frozen=True)
class Case:
    """One camera: its world, ``clean`` or ``laboratory``, and what is hidden in it, in the contract's units."""

    world: str = "clean"
    hidden: dict[str, Values] = field(default_factory=dict)
    datasheet: Datasheet = field(default_factory=Datasheet)
    group: str = "free"
    number: int = 0
    round: int | None = None


def seed_of(round_: int, number: int) -> int:
    """Return the seed of a case of a round by the rule that the module states."""
    return int.from_bytes(hashlib.sha256(b"textbook-camera %d %d" % (round_, number)).digest()[:8], "big")


def deal(rng: np.random.Generator, names: Sequence[str], sizes: Sequence[int]) -> Iterator[tuple[str, ...]]:
    """Yield hands of these sizes from shuffled decks of the names, no two of a hand in the same group of ``APART``."""
    deck: list[str] = []
    for size in sizes:
        hand: list[str] = []
        while len(hand) < size:
            fits = [
                name
                for name in deck
                if name not in hand and not any({name, other} <= group for group in APART for other in hand)
            ]
            if not fits:
                deck += [names[index] for index in rng.permutation(len(names))]
                continue
            hand.append(fits[0])
            deck.remove(fits[0])
        yield tuple(hand)


def draw_datasheet(rng: np.random.Generator, gray: bool) -> Datasheet:
    """Draw a sensor of 10 or 12 bits; half of the modulators show 16 levels, all of those that need to."""
    bits, full_well = int(rng.choice([10, 12])), float(rng.integers(80, 161) * 100)
    read_noise = float(np.round(rng.uniform(12.0, 25.0) / full_well * (2**bits - 1), 2))
    return Datasheet(bits, full_well, read_noise, bool(rng.random() < 0.5) or gray)


def cases(round_: int) -> list[Case]:
    """Return the 64 cases of a round."""
    dealer = np.random.default_rng(seed_of(round_, 0))
    groups = [group for group, (count, _) in GROUPS.items() for _ in range(count)]
    words = deal(dealer, list(WORDS), [GROUPS[group][1] for group in groups if group not in ("nothing", "outside")])
    others = deal(dealer, list(OUTSIDE), [1] * GROUPS["outside"][0])
    drawn = []
    for number, group in enumerate(groups, 1):
        names = () if group == "nothing" else next(others if group == "outside" else words)
        rng = np.random.default_rng(seed_of(round_, number))
        datasheet = draw_datasheet(rng, any(deviation(name).gray for name in names))
        hidden = {name: deviation(name).draw(rng, datasheet) for name in names}
        world = "laboratory" if (number + round_) % 2 else "clean"
        drawn.append(Case(world, hidden, datasheet, group, number, round_))
    return drawn


def deviation(name: str) -> Deviation:
    """Return the deviation of a name; raise KeyError for a name that is neither a word nor outside the vocabulary."""
    return WORDS[name] if name in WORDS else OUTSIDE[name]


def camera_of(case: Case, rng: np.random.Generator) -> Camera:
    """Build the camera of a case; ``rng`` draws the imperfections of its laboratory."""
    sheet = case.datasheet
    camera = Camera(
        full_scale_e=sheet.full_well_e, read_noise_dn=sheet.read_noise_dn, converter_bits=sheet.bit_depth,
        stage=any(deviation(name).stage_motion for name in case.hidden),
    )  # fmt: skip
    if case.world == "laboratory":
        fill = rng.uniform(0.88, 0.95)
        camera = replace(
            camera,
            fill_factor=fill,
            source=1.0 / fill,  # its power is set on a white target with all mirrors on
            stage=True,
            jitter=rng.uniform(0.002, 0.006),
            print_error=0.01,
            misplacement_um=rng.uniform(0.02, 0.06) * PIXEL_UM,
            cosine_law=True,
        )
    for name, values in case.hidden.items():
        camera = replace(camera, **deviation(name).build(values))
    return camera


def accepted(name: str, values: Values, world: str) -> set[str]:
    """Return the words that are the same thing as a hidden deviation, to these captures and by physics."""
    if name == "duty_cycle" or (name == "gain" and values["factor"] < 1.0):
        return {"gain", "duty_cycle"}  # less light in every capture, wherever it is lost
    # Both mix in a part of the pattern before; they differ in that part squared, below a printed target's error.
    if world == "laboratory" and (
        values.get("lag", 1.0) < 0.1 or (name == "sync_offset" and 0.0 < values["offset"] < 0.1)
    ):
        return {"mask_lag", "sync_offset"}
    return {name}


def truth_of(case: Case, camera: Camera, seed: int, size: int) -> dict[str, Any]:
    """Return the truth of a case: for every hidden deviation its names, stages, and parameters in the contract's units.

    ``accepted`` is null for what the contract has no word for. ``parameters`` are to be compared, each within
    ``tolerance`` (absolute, beside the statistical error), those in ``unsigned`` by magnitude. ``tolerated`` are names
    that hold a part of the truth. ``laboratory`` states the sizes of the imperfections, relative or in pixels.
    """
    hidden = []
    for name, values in case.hidden.items():
        entry, word = deviation(name), name in WORDS
        parameters = {key: value for key, value in values.items() if word and key not in entry.left_out}
        tolerance = entry.tolerance(values)
        if name == "mask_shift":  # before or after a roll or a magnification
            for other, (key, unit, ideal) in RELAY_MAGNITUDES.items():
                if other in case.hidden:
                    size_of_other = abs(case.hidden[other][key] - ideal) * unit
                    tolerance = {
                        axis: tolerance.get(axis, 0.0) + size_of_other * np.hypot(*values.values()) for axis in values
                    }
        tolerated = {*entry.tolerated, *({"illumination"} if name == "vignetting" and camera.cosine_law else ())}
        hidden.append(
            {
                "deviation": name,
                "accepted": sorted(accepted(name, values, case.world)) if word else None,
                "stages": [entry.stage, *entry.other_stages],
                "parameters": parameters,
                "tolerance": {key: float(value) for key, value in tolerance.items()},
                "unsigned": list(entry.unsigned),
                "tolerated": sorted(tolerated),
                "drawn": values,
            }
        )
    laboratory = {
        "exposure_jitter": camera.jitter,
        "smooth_target_error": camera.print_error,
        "target_error_per_patch": camera.print_error,
        "target_misplacement_pixels": camera.misplacement_um / PIXEL_UM,
        "mirror_gaps": 1.0 - camera.fill_factor,
    }
    return {
        "format": "textbook-camera-truth",
        "format_version": 1,
        "round": case.round,
        "case": case.number,
        "group": case.group,
        "world": case.world,
        "seed": seed,
        "size": size,
        "hidden": hidden,
        "laboratory": laboratory,
    }


def record(case: Case, seed: int, size: int = 64) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the contents of the captures file of a case (see ``recording.capture``) and its truth."""
    camera = camera_of(case, np.random.default_rng([seed, 1]))
    name = f"textbook camera, seed {seed}"
    return capture(camera, case.datasheet, seed, size, name), truth_of(case, camera, seed, size)
