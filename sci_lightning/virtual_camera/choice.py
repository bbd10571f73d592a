"""Which effects to hide: told exactly, by name, or left to the seed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera.evidence import weak
from sci_lightning.virtual_camera.hardware.effect import Effect
from sci_lightning.virtual_camera.hardware.vocabulary import EFFECTS, OUTSIDE, VOCABULARY
from sci_lightning.virtual_camera.session import Session
from sci_lightning.virtual_camera.stream import stream

LOTS = {"random": VOCABULARY, "outside": OUTSIDE}


def choose(wish: Any, session: Session, seed: int, *, number: int = 1, magnitude: str = "clear") -> dict[str, Effect]:
    """The effects that are wished for, with all their parameters.

    Args:
        wish: any of
            - None, ``none``, [] or {}: nothing;
            - ``random``: ``number`` effects of the vocabulary; ``outside``: of those outside it;
            - a name, or a list of names: parameters by the seed;
            - {name: {parameter: value}} or [{"name": name, parameter: value}]: parameters as told, those not told at
              their neutral value; without any, by the seed.
        session: what they will be hidden in; random ones are those that can show in it.
        seed: of every choice.
        number: how many, for ``random`` and ``outside``.
        magnitude: of what the seed draws: ``clear``, or ``weak`` (30 to 100 nats; see :mod:`.evidence`).

    Raises:
        BadInput: an unknown effect, parameter or magnitude, or a value out of range.
    """
    if magnitude not in ("clear", "weak"):
        raise BadInput(f"magnitude must be clear or weak, got {magnitude!r}")
    chosen: dict[str, Effect] = {}
    for name, values in _named(wish, session, seed, number):
        if name not in EFFECTS:
            raise BadInput(f"no effect '{name}'; choose random, outside, none or of {', '.join(EFFECTS)}")
        if name in chosen:
            raise BadInput(f"effect {name} is named twice")
        if values:
            chosen[name] = EFFECTS[name].read(values, session)
            continue
        drawn = EFFECTS[name].draw(stream(seed, f"draw {name}"), session)
        chosen[name] = weak(drawn, session, seed) if magnitude == "weak" else drawn
    return chosen


def _named(wish: Any, session: Session, seed: int, number: int) -> list[tuple[str, Mapping[str, Any]]]:
    """Names with the parameters told for them."""
    if wish is None or wish == "none":
        return []
    if isinstance(wish, str) and wish in LOTS:
        lot = [name for name, effect in LOTS[wish].items() if effect.suits(session)]
        if isinstance(number, bool) or not isinstance(number, int) or not 1 <= number <= len(lot):
            raise BadInput(f"number of {wish} effects must be a whole number from 1 to {len(lot)}, got {number!r}")
        return [(str(name), {}) for name in stream(seed, "effects").choice(lot, number, replace=False)]
    if isinstance(wish, str):
        return [(wish, {})]
    if isinstance(wish, Mapping):
        return [(str(name), _parameters(str(name), values)) for name, values in wish.items()]
    if isinstance(wish, Sequence):
        return [_item(item) for item in wish]
    raise BadInput(f"effects must be random, outside, none, names, or names with parameters; got {wish!r}")


def _item(item: Any) -> tuple[str, Mapping[str, Any]]:
    if isinstance(item, str):
        return item, {}
    if isinstance(item, Mapping) and "name" in item:
        return str(item["name"]), {key: value for key, value in item.items() if key != "name"}
    raise BadInput(f"an entry of effects is a name or {{name: NAME, parameter: value, ..}}, got {item!r}")


def _parameters(name: str, values: Any) -> Mapping[str, Any]:
    if values is None or isinstance(values, Mapping):
        return values or {}
    raise BadInput(f"effects.{name} must be parameters, as in effects.{name}.parameter=value; got {values!r}")
