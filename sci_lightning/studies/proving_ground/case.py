"""A case of the proving ground: which effects are hidden in which camera, and which captures it takes."""

from __future__ import annotations

import shlex
import zlib
from dataclasses import asdict, dataclass, fields
from typing import Any

from sci_lightning.runs.provenance import installed_version
from sci_lightning.studies.engine.records import digest_of
from sci_lightning.virtual_camera import Session
from sci_lightning.virtual_camera.hidden_effects import GAINS

_STATED: dict[str, Any] = {"datasheet": True, "datasheet_factor": 1.0}
DATASHEETS: dict[str, dict[str, Any]] = {
    "stated": {},
    "silent": {"datasheet": False},
    "double": {"datasheet_factor": 2.0},
    "half": {"datasheet_factor": 0.5},
}
"""What a captures file says of the noise: the truth, nothing, or figures that are wrong by a factor of 2."""
LATER: dict[str, Any] = {"datasheet_factor": 1.0, "formulation": "overlap"}
"""Settings of a session that did not exist when the first digests were written, with what they were then."""


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
        camera += "" if self.datasheet == "stated" else f"-{self.datasheet}"
        camera += "" if self.session.formulation == "overlap" else f"-{self.session.formulation}"
        return f"{self.suite}-{'+'.join(self.effects) or 'none'}-{camera}-{self.captures}-{self.repetition}"

    @property
    def seed(self) -> int:
        """Seed of the virtual camera's patterns, scenes, parameters and noise; another one for every case."""
        return zlib.crc32(self.name.encode())

    @property
    def datasheet(self) -> str:
        """What the captures file says of the camera's noise: one of the words of ``DATASHEETS``."""
        stated = {"datasheet": self.session.datasheet, "datasheet_factor": self.session.datasheet_factor}
        return next(word for word, settings in DATASHEETS.items() if stated == _STATED | settings)

    @property
    def magnitude(self) -> str:
        """How strong the hidden effects are: ``clear``, ``weak`` or ``faint``."""
        return self.suite if self.suite in GAINS else "clear"

    @property
    def digest(self) -> str:
        """Digest of all settings: a record with another digest is of another case, even if the names agree."""
        settings = asdict(self)
        settings["turn"] = settings.pop("repetition")  # the name it had when the first digests were written
        for name, default in LATER.items():
            if settings["session"][name] == default:
                del settings["session"][name]
        return digest_of(settings)

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
            "datasheet": self.datasheet,
            "formulation": self.session.formulation,
            "captures": self.captures,
            "told": list(self.effects),
            "seed": self.seed,
            "command": self.command,
            "sci_lightning": installed_version(),
        }


def _override_value(value: object) -> str:
    """Return a value as Hydra's overrides spell it."""
    return f"[{','.join(map(str, value))}]" if isinstance(value, tuple) else str(value)
