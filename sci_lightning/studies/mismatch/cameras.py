"""The cameras of the protocol: the published one, its effects one by one, and cameras drawn from the ranges."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import EFFECTS
from sci_lightning.virtual_camera.hardware.effect import Value
from sci_lightning.virtual_camera.random_numbers import stream

Mismatch = Mapping[str, Mapping[str, Value]]
"""Values of the parameters by effect: what a camera has and its model has not."""

GROUPS = ("published", "drawn", "alone")
"""Groups of cameras, in the order in which they are run."""


@dataclass(frozen=True)
class MismatchedCamera:
    """One camera of the protocol.

    Attributes:
        name: ``published``, ``drawn_01`` or ``alone_mask_blur``.
        mismatch: the effects that it has.
    """

    name: str
    mismatch: Mismatch

    @property
    def group(self) -> str:
        """The group that it belongs to, one of :data:`GROUPS`."""
        return self.name.partition("_")[0]


def plan_cameras(
    groups: Sequence[str],
    mismatch: Mapping[str, Mapping[str, Value] | None],
    ranges: Mapping[str, Mapping[str, Sequence[float]] | None],
    drawn: int,
    seed: int,
) -> list[MismatchedCamera]:
    """Return the cameras in the order in which they are run.

    Args:
        groups: some of :data:`GROUPS`: ``published`` has every effect of ``mismatch``; ``alone`` are cameras that have
            one of these effects each; ``drawn`` are cameras whose parameters are drawn from ``ranges``.
        mismatch: values of the parameters by effect of the virtual camera; None leaves an effect out.
        ranges: [low, high] of the parameters by effect; a parameter is uniformly distributed between them.
        drawn: number of cameras that are drawn; the first ones do not depend on it.
        seed: of the draws.

    Raises:
        BadInput: an unknown group, effect or parameter, a range that is none, or no cameras at all.
    """
    if unknown := [group for group in groups if group not in GROUPS]:
        raise BadInput(f"cameras: no '{unknown[0]}'; choose of {', '.join(GROUPS)}")
    present = {name: dict(values) for name, values in mismatch.items() if values is not None}
    spans = {name: dict(values) for name, values in ranges.items() if values is not None}
    for key, effects in (("mismatch", present), ("ranges", spans)):
        for name, values in effects.items():
            _check_names(key, name, values)
    for name, parameters in spans.items():
        for parameter, span in parameters.items():
            _check_range(f"ranges.{name}.{parameter}", span)
    cameras = []
    if "published" in groups:
        cameras.append(MismatchedCamera("published", present))
    if "drawn" in groups:
        cameras += [_draw(number, spans, seed) for number in range(1, drawn + 1)]
    if "alone" in groups:
        cameras += [MismatchedCamera(f"alone_{name}", {name: values}) for name, values in present.items()]
    if not cameras:
        raise BadInput("no cameras: name some of them, 'cameras=[published,drawn,alone]', and drawn=1 or more")
    return cameras


def _draw(number: int, ranges: Mapping[str, Mapping[str, Sequence[float]]], seed: int) -> MismatchedCamera:
    random = stream(seed, f"mismatched camera {number}")
    mismatch = {
        name: {parameter: float(random.uniform(span[0], span[1])) for parameter, span in parameters.items()}
        for name, parameters in ranges.items()
    }
    return MismatchedCamera(f"drawn_{number:02d}", mismatch)


def _check_names(key: str, name: str, values: Mapping[str, object]) -> None:
    if name not in EFFECTS:
        raise BadInput(f"{key}: the virtual camera has no effect '{name}'; choose of {', '.join(EFFECTS)}")
    known = EFFECTS[name].parameters()
    if unknown := [parameter for parameter in values if parameter not in known]:
        raise BadInput(f"{key}.{name}: no parameter '{unknown[0]}'; it has {', '.join(known)}")
    if not values:
        raise BadInput(f"{key}.{name}: no parameters; give {', '.join(known)}, or null to leave the effect out")


def _check_range(where: str, span: object) -> None:
    numbers = list(span) if isinstance(span, (list, tuple)) else []
    right = len(numbers) == 2 and all(isinstance(n, (int, float)) and not isinstance(n, bool) for n in numbers)
    if not right or not numbers[0] <= numbers[1]:
        raise BadInput(f"{where}={span}: expected [low,high], two numbers of which the first is not the larger one")
