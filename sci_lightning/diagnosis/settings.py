"""The keys of the command ``diagnose``, each of the right type and in its range."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from sci_lightning.errors import BadInput

LARGEST_SEED = 2**63 - 1
"""The largest that a random generator of PyTorch takes."""


@dataclass(frozen=True)
class Settings:
    """What ``conf/diagnose.yaml`` and the command line say.

    Attributes:
        captures: path of a captures file.
        seed: of the randomised residuals, 0 to 2**63 - 1.
        most: effects to be found at most, 0 or more.
        empirical: whether what has no name goes into ``encoder.yaml`` in free form.
        candidates: dotted paths of effects of the user's own, by their names.
    """

    captures: str
    seed: int = 0
    most: int = 6
    empirical: bool = False
    candidates: Mapping[str, str] = field(default_factory=dict)

    @staticmethod
    def read(values: Mapping[str, Any]) -> Settings:
        """Check the values of a configuration.

        Args:
            values: by key; keys of no interest here are passed over, missing ones take their defaults.

        Raises:
            BadInput: a value of another type or out of range; names the key, the value and what would be right.
        """
        captures, candidates = values.get("captures"), values.get("candidates", {})
        if not isinstance(captures, (str, int, float)) or isinstance(captures, bool) or not str(captures).strip():
            raise BadInput(f"captures must be the path of a captures file (.h5), got {captures!r}")
        pairs: list[tuple[Any, Any]] = [(None, candidates)]
        if isinstance(candidates, Mapping):
            pairs = list(candidates.items())
        for name, path in pairs:
            if not isinstance(name, str) or not isinstance(path, str):
                given = f"candidates={path!r}" if name is None else f"candidates.{name}={path!r}"
                raise BadInput(f"{given}: expected names of effects with dotted paths, {{mine: my_module.Mine}}")
        empirical = values.get("empirical", False)
        if not isinstance(empirical, bool):
            raise BadInput(f"empirical must be true or false, got {empirical!r}")
        return Settings(
            captures=str(captures),
            seed=whole_number("seed", values.get("seed", 0), LARGEST_SEED),
            most=whole_number("most", values.get("most", 6)),
            empirical=empirical,
            candidates=dict(pairs),
        )


def whole_number(key: str, value: Any, largest: int | None = None) -> int:
    """Return the value if it is a whole number from 0 to ``largest``.

    Raises:
        BadInput: it is something else; names the key.
    """
    if isinstance(value, bool) or not isinstance(value, int) or value < 0 or (largest is not None and value > largest):
        upper = "or more" if largest is None else f"to {largest}"
        raise BadInput(f"{key} must be a whole number, 0 {upper}, got {value!r}")
    return value
