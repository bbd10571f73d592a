"""Which effects are hidden: given exactly, given by name, or drawn from the seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TypeAlias

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.evidence import make_weak
from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.hardware.parameter import Value
from sci_lightning.virtual_camera.hardware.vocabulary import EFFECTS, OUTSIDE, VOCABULARY
from sci_lightning.virtual_camera.session import Session
from sci_lightning.virtual_camera.stream import stream

Parameters: TypeAlias = Mapping[str, Value]
EffectRequest: TypeAlias = str | Sequence[str | Parameters] | Mapping[str, Parameters | None] | None
"""What can be asked for, see :func:`choose_effects`."""

RANDOM_GROUPS = {"random": VOCABULARY, "outside": OUTSIDE}


def choose_effects(
    request: EffectRequest, session: Session, seed: int, *, number: int = 1, magnitude: str = "clear"
) -> dict[str, Effect]:
    """Return the requested effects with all their parameters, by name.

    Args:
        request: one of

            - None, ``none``, ``[]`` or ``{}``: no effect;
            - ``random``: ``number`` effects of the vocabulary; ``outside``: of those outside it;
            - a name or a list of names: their parameters are drawn from the seed;
            - ``{name: {parameter: value}}`` or ``[{"name": name, parameter: value}]``: the given parameters, the others
              at their neutral values; an effect without any parameter is drawn from the seed.
        session: the captures in which they are hidden; random effects are those that are visible in them.
        seed: of every random choice.
        number: how many effects, for ``random`` and ``outside``.
        magnitude: how strong the drawn effects are: ``clear``, or ``weak`` (30 to 100 nats, see :mod:`.evidence`).

    Raises:
        BadInput: an unknown effect, parameter or magnitude, or a value out of range.
    """
    if magnitude not in ("clear", "weak"):
        raise BadInput(f"magnitude must be clear or weak, got {magnitude!r}")
    effects: dict[str, Effect] = {}
    for name, values in _requested(request, session, seed, number):
        if name not in EFFECTS:
            raise BadInput(f"no effect '{name}'; choose random, outside, none or of {', '.join(EFFECTS)}")
        if name in effects:
            raise BadInput(f"effect {name} is named twice")
        if values:
            effects[name] = EFFECTS[name].from_values(values, session)
        else:
            drawn = EFFECTS[name].draw(stream(seed, f"draw {name}"), session)
            drawn.check(session)
            effects[name] = make_weak(drawn, session, seed) if magnitude == "weak" else drawn
    return effects


def _requested(request: object, session: Session, seed: int, number: int) -> list[tuple[str, Mapping[str, object]]]:
    """Return the names of the requested effects with the parameters that are given for them."""
    if request is None or request == "none":
        return []
    if isinstance(request, str) and request in RANDOM_GROUPS:
        group = [name for name, effect in RANDOM_GROUPS[request].items() if effect.is_visible_in(session)]
        if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= len(group):
            raise BadInput(f"number of {request} effects must be a whole number from 1 to {len(group)}, got {number!r}")
        return [(str(name), {}) for name in stream(seed, "effects").choice(group, number, replace=False)]
    if isinstance(request, str):
        return [(request, {})]
    if isinstance(request, Mapping):
        return [(str(name), _parameters(str(name), values)) for name, values in request.items()]
    if isinstance(request, Sequence):
        return [_entry(entry) for entry in request]
    raise BadInput(f"effects must be random, outside, none, names, or names with parameters; got {request!r}")


def _entry(entry: object) -> tuple[str, Mapping[str, object]]:
    """Return the name and the parameters of one entry of a list."""
    if isinstance(entry, str):
        return entry, {}
    if isinstance(entry, Mapping) and "name" in entry:
        return str(entry["name"]), {str(key): value for key, value in entry.items() if key != "name"}
    raise BadInput(f"an entry of effects is a name or {{name: NAME, parameter: value, ..}}, got {entry!r}")


def _parameters(name: str, values: object) -> Mapping[str, object]:
    """Return the parameters that are given for an effect, none for None."""
    if values is None:
        return {}
    if isinstance(values, Mapping):
        return values
    raise BadInput(f"effects.{name} must be parameters, as in effects.{name}.parameter=value; got {values!r}")
