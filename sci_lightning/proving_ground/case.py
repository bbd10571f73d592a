"""A case: what is hidden in which camera."""

from __future__ import annotations

import hashlib
import json
import shlex
import zlib
from dataclasses import asdict, dataclass, fields
from typing import Any

from sci_lightning import __version__
from sci_lightning.virtual_camera import Session


@dataclass(frozen=True)
class Case:
    """One set of captures to be diagnosed.

    Attributes:
        suite: what it belongs to, see :mod:`.plan`.
        effects: names of what is hidden; their parameters come from the seed.
        captures: which set of captures, for people; the session says it exactly.
        session: the camera's datasheet and the captures.
        turn: the round in which it is tried; another round, another draw.
    """

    suite: str
    effects: tuple[str, ...]
    captures: str
    session: Session
    turn: int = 0

    @property
    def name(self) -> str:
        """All that tells it from other cases, fit for a file name."""
        height, width = self.session.size
        camera = f"{self.session.mask}-{self.session.bit_depth}bit-{height}x{width}-{self.session.frames}slots"
        return f"{self.suite}-{'+'.join(self.effects) or 'none'}-{camera}-{self.captures}-{self.turn}"

    @property
    def seed(self) -> int:
        """Of the virtual camera: patterns, scenes, parameters, noise. No two cases share it."""
        return zlib.crc32(self.name.encode())

    @property
    def magnitude(self) -> str:
        """``clear`` or ``weak``."""
        return "weak" if self.suite == "weak" else "clear"

    @property
    def digest(self) -> str:
        """Of all settings: a record with another one is of another case, whatever its name."""
        return hashlib.sha256(json.dumps(asdict(self), sort_keys=True).encode()).hexdigest()[:16]

    @property
    def command(self) -> str:
        """What makes the captures again."""
        ideal = Session()
        given = {each.name: getattr(self.session, each.name) for each in fields(Session)}
        changed = {name: value for name, value in given.items() if value != getattr(ideal, name)}
        words = {"effects": self.effects or "none", "seed": self.seed, "magnitude": self.magnitude, **changed}
        arguments = [f"{name}={_plain(value)}" for name, value in words.items()]
        return shlex.join(["python", "-m", "sci_lightning.virtual_camera", "out=captures.h5", *arguments])

    def describe(self) -> dict[str, Any]:
        """What a record says of its case, whether it went well or not; fit for JSON."""
        return {
            "format": "sci-proving-ground-case",
            "format_version": 1,
            "case": self.name,
            "digest": self.digest,
            "suite": self.suite,
            "mask": self.session.mask,
            "bit_depth": self.session.bit_depth,
            "size": list(self.session.size),
            "frames": self.session.frames,
            "captures": self.captures,
            "told": list(self.effects),
            "seed": self.seed,
            "command": self.command,
            "sci_lightning": __version__,
        }


def _plain(value: object) -> str:
    return f"[{','.join(map(str, value))}]" if isinstance(value, tuple) else str(value)
