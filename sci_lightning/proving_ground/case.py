"""A case of the proving ground: which effects are hidden in which camera, and which captures it takes."""

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
    """One set of captures that is to be diagnosed.

    Attributes:
        suite: the suite that the case belongs to, see :mod:`.plan`.
        effects: names of the hidden effects; their parameters follow from the seed.
        captures: name of the set of captures, for people; the session defines it exactly.
        session: the camera's datasheet and the captures that it takes.
        repetition: number of the case among those that agree in everything else; each draws other random numbers.
    """

    suite: str
    effects: tuple[str, ...]
    captures: str
    session: Session
    repetition: int = 0

    @property
    def name(self) -> str:
        """Everything that distinguishes the case from others in one word that a file may be called by."""
        height, width = self.session.size
        camera = f"{self.session.mask}-{self.session.bit_depth}bit-{height}x{width}-{self.session.frames}slots"
        return f"{self.suite}-{'+'.join(self.effects) or 'none'}-{camera}-{self.captures}-{self.repetition}"

    @property
    def seed(self) -> int:
        """Seed of the virtual camera's patterns, scenes, parameters and noise; another one for every case."""
        return zlib.crc32(self.name.encode())

    @property
    def magnitude(self) -> str:
        """How strong the hidden effects are: ``clear`` or ``weak``."""
        return "weak" if self.suite == "weak" else "clear"

    @property
    def digest(self) -> str:
        """Digest of all settings: a record with another digest is of another case, even if the names agree."""
        settings = asdict(self)
        settings["turn"] = settings.pop("repetition")  # the name it had when the first digests were written
        return hashlib.sha256(json.dumps(settings, sort_keys=True).encode()).hexdigest()[:16]

    @property
    def command(self) -> str:
        """The command that makes the same captures."""
        default = Session()
        settings = {field.name: getattr(self.session, field.name) for field in fields(Session)}
        changed = {name: value for name, value in settings.items() if value != getattr(default, name)}
        overrides = {"effects": self.effects or "none", "seed": self.seed, "magnitude": self.magnitude, **changed}
        arguments = [f"{name}={_override_value(value)}" for name, value in overrides.items()]
        return shlex.join(["python", "-m", "sci_lightning.virtual_camera", "out=captures.h5", *arguments])

    def describe(self) -> dict[str, Any]:
        """Return what every record says about its case, whether the trial succeeds or not, as plain data for JSON."""
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


def _override_value(value: object) -> str:
    """Return a value as Hydra's overrides spell it."""
    return f"[{','.join(map(str, value))}]" if isinstance(value, tuple) else str(value)
