"""Which cases are tried: suites of effects, each over masks, bit depths and rounds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from sci_lightning.errors import BadInput
from sci_lightning.proving_ground.case import Case
from sci_lightning.virtual_camera import EFFECTS, OUTSIDE, VOCABULARY, Session
from sci_lightning.virtual_camera.stream import stream

SUITES = ("single", "weak", "pair", "triple", "nothing", "outside", "fewer")
NOTHING = 12
"""Cases a round in which nothing is hidden."""
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
    most: int | None = None,
    effects: Sequence[str] | None = None,
    size: Sequence[int] = (64, 64),
    frames: int = 8,
    masks: Sequence[str] = ("structural", "binary"),
    bit_depths: Sequence[int] = (8, 10, 12),
) -> list[Case]:
    """All cases, in an order that only the arguments decide.

    In every round each effect of the vocabulary is hidden once by itself (``single``, ``weak``, and ``fewer``: in the
    sets of captures that lack something, in turn), once in a pair and once in a triple, each effect outside it once
    (``outside``), and nothing twelve times. Masks and bit depths take turns.

    Args:
        suites: of :data:`SUITES`.
        seeds: rounds.
        most: cases of each suite and round at most; None: all of them.
        effects: names to which the suites are restricted; None: all.
        size: (H, W).
        frames: T.
        masks: ``structural`` and ``binary``, or one of them.
        bit_depths: of the converter.

    Raises:
        BadInput: an unknown suite or effect, no masks or bit depths, or a session that cannot be.
    """
    for what, given, known in (("suites", suites, SUITES), ("effects", effects or (), tuple(EFFECTS))):
        if unknown := [each for each in given if each not in known]:
            raise BadInput(f"{what}: no '{unknown[0]}'; choose of {', '.join(known)}")
    if not masks or not bit_depths:
        raise BadInput("masks and bit_depths must have at least one entry each")
    for what, number in (("seeds", seeds), ("cases", 1 if most is None else most)):
        if isinstance(number, bool) or not isinstance(number, int) or number < 1:
            raise BadInput(f"{what} must be a whole number of 1 or more, got {number!r}")
    cameras = [
        Session(size=(size[0], size[1]), frames=frames, mask=mask, bit_depth=bits)
        for bits, mask in product(bit_depths, masks)
    ]
    return [
        case
        for suite in suites
        for turn in range(seeds)
        for case in _round(suite, turn, cameras, None if effects is None else set(effects))[:most]
    ]


def _round(suite: str, turn: int, cameras: list[Session], allowed: set[str] | None) -> list[Case]:
    random = stream(turn, f"proving ground: {suite}")
    names = [name for name in (OUTSIDE if suite == "outside" else VOCABULARY) if allowed is None or name in allowed]
    if suite == "weak":
        names = [name for name in names if _has_magnitude(name)]
    lacking = [name for name in CAPTURES if name != "full"] if suite == "fewer" else ["full"]
    cases = []
    for number, hidden in enumerate(_sets(suite, names, random)):
        first = (number + turn) % len(cameras)
        ways = cameras[first:] + cameras[:first]
        captures = lacking[(number + turn) % len(lacking)]
        sessions = [_with(session, captures) for session in ways]
        suited = [session for session in sessions if all(EFFECTS[name].is_visible_in(session) for name in hidden)]
        if suited:
            cases.append(Case(suite, hidden, captures, suited[0], turn * NOTHING + number if not hidden else turn))
    return cases


def _sets(suite: str, names: list[str], random: np.random.Generator) -> list[tuple[str, ...]]:
    """What is hidden in each case: every name once, as far as they go round."""
    if suite == "nothing":
        return [()] * NOTHING
    many = {"pair": 2, "triple": 3}.get(suite, 1)
    mixed = [names[int(number)] for number in random.permutation(len(names))]
    chosen = [set(mixed[start : start + many]) for start in range(0, len(mixed) - many + 1, many)]
    return [tuple(name for name in EFFECTS if name in each) for each in chosen]


def _has_magnitude(name: str) -> bool:
    """Whether the effect can be made weak: an order, an orientation or a number of bits cannot."""
    return any(about.magnitude and not about.integer for about in EFFECTS[name].parameters().values())


def _with(session: Session, captures: str) -> Session:
    return replace(session, **CAPTURES[captures])  # type: ignore[arg-type]
