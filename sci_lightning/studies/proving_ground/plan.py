"""Which cases are run: suites of hidden effects, each over masks, bit depths and repetitions."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.studies.proving_ground.case import DATASHEETS, Case
from sci_lightning.virtual_camera import DRAWN, EFFECTS, LATER, OUTSIDE, Session
from sci_lightning.virtual_camera.hidden_effects import GAINS
from sci_lightning.virtual_camera.random_numbers import stream

SUITES = ("single", "weak", "pair", "triple", "nothing", "outside", "fewer", "later", "faint")
CASES_OF_NOTHING = 12
"""Number of cases in every repetition in which nothing is hidden."""
CAPTURES: dict[str, dict[str, int]] = {
    "full": {},
    "no_dark": {"dark": 0},
    "no_pattern": {"pattern": 0},
    "moving": {"dark": 0, "flat": 0, "all_on": 0, "all_off": 0, "pattern": 0, "static": 0, "dynamic": 12},
}
"""Sets of captures by name: what differs from a full session."""


def plan(
    suites: Sequence[str] = SUITES,
    seeds: int = 1,
    *,
    first_round: int = 0,
    cases: int | None = None,
    effects: Sequence[str] | None = None,
    size: Sequence[int] = (64, 64),
    slots: Sequence[int] = (8,),
    masks: Sequence[str] = ("structural", "binary"),
    bit_depths: Sequence[int] = (8, 10, 12),
    datasheets: Sequence[str] = ("stated",),
    formulations: Sequence[str] = ("overlap",),
) -> list[Case]:
    """Return all cases, in an order that depends on nothing but the arguments.

    In every repetition, each effect of the vocabulary is hidden once alone (``single``, ``weak``, ``faint``, and
    ``fewer``, which leaves out one of several sorts of captures in turn), once in a pair and once in a triple. Effects
    that the vocabulary got later are hidden once alone in a suite of their own (``later``), so that the others' cases
    stay what they were. Each effect outside the vocabulary is hidden once (``outside``), and twelve times nothing is.
    Masks and bit depths take turns. With several numbers of slots, datasheets or formulations, the cameras of all
    combinations do, in a random order.

    Args:
        suites: some of ``SUITES``.
        seeds: number of repetitions, each with other random numbers.
        first_round: number of the first repetition, from 0.
        cases: largest number of cases of each suite and repetition; None for all.
        effects: names to which the suites are restricted; None for all.
        size: (H, W) in pixels.
        slots: T, slots of a capture.
        masks: ``structural``, ``binary`` or both.
        bit_depths: bits of the converter.
        datasheets: what the files say of the noise: ``stated``, ``silent``, ``double`` or ``half``.
        formulations: of the virtual camera: ``overlap``, ``rays`` or both.

    Raises:
        BadInput: an unknown suite, effect or datasheet, an empty list, or an impossible session.
    """
    for key, names, known in (
        ("suites", suites, SUITES),
        ("effects", effects or (), tuple(EFFECTS)),
        ("datasheets", datasheets, tuple(DATASHEETS)),
    ):
        if unknown := [name for name in names if name not in known]:
            raise BadInput(f"{key}: no '{unknown[0]}'; choose of {', '.join(known)}")
    lists = {"slots": slots, "masks": masks, "bit_depths": bit_depths}
    lists |= {"datasheets": datasheets, "formulations": formulations, "suites": suites}
    lists |= {} if effects is None else {"effects": effects}
    if empty := [key for key, entries in lists.items() if not entries]:
        raise BadInput(f"{empty[0]} must have at least one entry")
    for key, number, least in (
        ("seeds", seeds, 1),
        ("cases", 1 if cases is None else cases, 1),
        ("first_round", first_round, 0),
    ):
        if isinstance(number, bool) or not isinstance(number, int) or number < least:
            raise BadInput(f"{key} must be a whole number of {least} or more, got {number!r}")
    cameras = [
        Session(
            size=(size[0], size[1]),
            frames=count,
            mask=mask,
            bit_depth=bits,
            formulation=formulation,
            **DATASHEETS[datasheet],
        )
        for count, datasheet, formulation, bits, mask in product(slots, datasheets, formulations, bit_depths, masks)
    ]
    several = len(slots) * len(datasheets) * len(formulations) > 1
    allowed = set(EFFECTS if effects is None else effects)
    return [
        case
        for suite in suites
        for repetition in range(first_round, first_round + seeds)
        for case in _cases_of_repetition(suite, repetition, cameras, several, allowed)[:cases]
    ]


def in_turns(cases: Sequence[Case]) -> list[Case]:
    """Return the cases in an order in which a run that is stopped has tried about the same share of every suite."""
    sizes, seen = Counter(case.suite for case in cases), Counter[str]()
    shares = []
    for case in cases:
        seen[case.suite] += 1
        shares.append(seen[case.suite] / sizes[case.suite])
    return [cases[index] for index in sorted(range(len(cases)), key=shares.__getitem__)]


def _cases_of_repetition(
    suite: str, repetition: int, cameras: list[Session], several: bool, allowed: set[str]
) -> list[Case]:
    if several:  # the first ones would otherwise all have the same number of slots
        order = stream(0, f"proving ground: cameras of {suite}").permutation(len(cameras))
        cameras = [cameras[number] for number in order]
    random = stream(repetition, f"proving ground: {suite}")
    names = [name for name in {"outside": OUTSIDE, "later": LATER}.get(suite, DRAWN) if name in allowed]
    if suite in GAINS:
        names = [name for name in names if _has_magnitude(name)]
    capture_sets = [name for name in CAPTURES if name != "full"] if suite == "fewer" else ["full"]
    cases = []
    hidden_sets = _hidden_sets(suite, names, random)
    for number, hidden in enumerate(hidden_sets):
        first = (number + repetition * (len(hidden_sets) if several else 1)) % len(cameras)
        captures = capture_sets[(number + repetition) % len(capture_sets)]
        sessions = (
            replace(camera, **CAPTURES[captures])  # type: ignore[arg-type]
            for camera in cameras[first:] + cameras[:first]
        )
        suited = [session for session in sessions if all(EFFECTS[name].is_visible_in(session) for name in hidden)]
        if suited:
            draw = repetition if hidden else repetition * CASES_OF_NOTHING + number
            cases.append(Case(suite, hidden, captures, suited[0], draw))
    return cases


def _hidden_sets(suite: str, names: list[str], random: np.random.Generator) -> list[tuple[str, ...]]:
    """Return the effects that each case hides: every name once, except those that are left over from full sets."""
    if suite == "nothing":
        return [()] * CASES_OF_NOTHING
    together = {"pair": 2, "triple": 3}.get(suite, 1)
    mixed = [names[int(number)] for number in random.permutation(len(names))]
    chosen = [set(mixed[start : start + together]) for start in range(0, len(mixed) - together + 1, together)]
    return [tuple(name for name in EFFECTS if name in members) for members in chosen]


def _has_magnitude(name: str) -> bool:
    """Return whether the effect can be made weak; an order, an orientation or a number of bits cannot."""
    return any(parameter.magnitude and not parameter.integer for parameter in EFFECTS[name].parameters().values())
