r"""Measurements that know their light scale, so that encoder and decoder cannot misunderstand each other.

A decoder wants :math:`\sum_t M_t \odot x_t`; a camera gives :math:`y = R(a \sum_t M_t \odot x_t)`, a fraction of full
scale, with an aperture a that is 2/T for binary masks. Nothing in the numbers tells the one from the other. What an
encoder returns therefore carries its aperture, and the masks that it gives out carry it too.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import torch

from sci_lightning.errors import BadInput, InputWarning

DIVIDED = {"split", "split_with_sizes", "chunk", "unbind", "tensor_split", "hsplit", "vsplit", "dsplit"}
"""Operations, by torch's name without underscores, that return several parts; ``for snapshot in ..`` is one of them."""

UNCHANGED = DIVIDED | {
    *("add", "sub", "clamp", "clip", "clamp_min", "clamp_max", "round", "floor", "clone", "detach", "contiguous", "to"),
    *("cpu", "cuda", "float", "double", "half", "bfloat16", "type", "getitem", "unsqueeze", "squeeze", "flip", "mean"),
    *("requires_grad", "stack", "cat", "index_select", "narrow", "iadd", "isub", "radd", "nan_to_num", "copy"),
}
"""Operations whose result is in the same units: light added is noise or a dark
level."""

REARRANGED = DIVIDED | {"getitem", "unsqueeze", "squeeze", "flip", "stack", "cat", "index_select", "narrow"}
"""Those after which pixels may be somewhere else."""

IN_PLACE = UNCHANGED - REARRANGED - {"mean"}
"""Those after which every pixel is where it was, so that the measurement still belongs to its mask."""

ANOTHER_MASK = 0.02
"""Part of a mask's norm by which its mark differs from that of another mask; rounding changes a thousandth."""


class Camera(Protocol):
    """What can undo the effects of its sensor and optics: an encoder."""

    @property
    def size(self) -> tuple[int, int]: ...

    def linearise(self, measurement: torch.Tensor) -> torch.Tensor: ...


class Measurement(torch.Tensor):
    r"""Snapshots ``(N, H, W)`` that a decoder cannot misread: a tensor with aperture and full scale.

    :math:`v = s\,R(a \sum_t M_t \odot x_t)`, with the values v, the full scale s and the aperture a. Slices, parts,
    copies and sums keep s, a product with a number k makes it k s. After any other operation the scale is unknown, and
    decoders refuse the tensor. ``torch.Tensor(y)`` and files forget everything: a plain tensor. Where every snapshot
    has a scale of its own, slices, parts and joined measurements keep those of their snapshots.

    Args:
        values: ``(N, H, W)``, a tensor or an array; floating, or integers (DN).
        aperture: a, the scale of the light before the sensor, > 0; 1 for a plain sum of mask times frame; ``(N,)``
            where each snapshot has its own.
        full_scale: s, the value that stands for a full sensor, > 0; for integers it must be stated.

    Raises:
        BadInput: integers without a full scale, or a scale that is not positive.

    Example:
        >>> import torch
        >>> import sci_lightning as sci
        >>> dn = torch.full((1, 16, 16), 1023, dtype=torch.int32)  # of a camera of 12 bits
        >>> mask = torch.ones(4, 16, 16)
        >>> measurement = sci.Measurement(dn, aperture=0.25, full_scale=4095)
        >>> decoder = sci.load_decoder("gap_tv", ["decoder.iterations=[2]"])
        >>> round(float(decoder(measurement, mask).mean()), 2)
        0.25
    """

    aperture: float | torch.Tensor
    full_scale: float | None
    """None: not known, after an operation that leaves it open."""
    camera: Camera | None
    """What undoes its sensor and optics; None where nothing is to be undone."""
    mask_mark: torch.Tensor | None = None
    """What :func:`mark_of` says of the mask behind which it was recorded; None: not known."""
    is_linear: bool
    """Whether sensor, optics and aperture have been undone: these are sums of mask times frame."""

    @staticmethod
    def __new__(
        cls, values: torch.Tensor | np.ndarray, aperture: float | torch.Tensor = 1.0, full_scale: float | None = None
    ) -> Measurement:
        plain = as_float_tensor(values)
        if not plain.is_floating_point():
            if full_scale is None:
                raise BadInput(
                    f"Measurement of {plain.dtype}: state the value of a full sensor, as in full_scale=255 for 8 bits"
                )
            plain = plain.float()
        full_scale = 1.0 if full_scale is None else full_scale
        if isinstance(aperture, torch.Tensor) and aperture.shape not in ((), plain.shape[:-2]):
            raise BadInput(
                f"Measurement: aperture of shape {tuple(aperture.shape)} for values {tuple(plain.shape)}: give one "
                "number, or one for each snapshot"
            )
        if not (torch.as_tensor(aperture > 0).all() and full_scale > 0):
            raise BadInput(f"Measurement: aperture={aperture} and full_scale={full_scale} must both be positive")
        return _measurement(plain.as_subclass(torch.Tensor), aperture, full_scale, None, False)

    @classmethod
    def recorded_by(
        cls,
        camera: Camera | None,
        values: torch.Tensor,
        aperture: float | torch.Tensor,
        mask: torch.Tensor | None = None,
    ) -> Measurement:
        """Return values ``(N, H, W)``, fractions of full scale, with the camera that undoes its own effects.

        Args:
            camera: see :attr:`camera`.
            values: of the measurement.
            aperture: of the camera, or ``(N,)`` of each snapshot.
            mask: ``(T, H, W)`` behind which it was recorded, which decoders then compare with theirs.
        """
        measurement = _measurement(values, aperture, 1.0, camera, False)
        measurement.mask_mark = None if mask is None or mask.is_meta else mark_of(mask)
        return measurement

    @classmethod
    def of_linear(cls, values: torch.Tensor) -> Measurement:
        """Return sums of mask times frame ``(N, H, W)``, of which everything has been undone."""
        return _measurement(values, 1.0, 1.0, None, True)

    def recorded(self) -> torch.Tensor:
        """Return the plain tensor ``(N, H, W)`` as the sensor gave it, a fraction of full scale.

        Raises:
            BadInput: its scale is unknown.
        """
        if self.full_scale is None:
            raise BadInput(
                "the light scale of this tensor is unknown: it was computed from a measurement by more than sums and "
                "products with numbers; state it, as in sci.Measurement(values.numpy(), aperture=.., full_scale=..)"
            )
        values = self.as_subclass(torch.Tensor)
        return values if self.full_scale == 1 else values / self.full_scale

    def linear(self) -> torch.Tensor:
        """Return the plain tensor ``(N, H, W)`` that decoders take: near the sum of mask times frame.

        Raises:
            BadInput: its scale is unknown, or it is a part of a field whose effects depend on the place.
        """
        recorded = self.recorded()
        if self.camera is not None:
            if recorded.shape[-2:] != self.camera.size:
                raise BadInput(
                    f"a part {tuple(recorded.shape[-2:])} of a field of {self.camera.size} pixels (H, W) does not tell "
                    "where it lies: encoder.normalised(part, origin=(row, column)) undoes its effects"
                )
            recorded = self.camera.linearise(recorded)
        if isinstance(self.aperture, torch.Tensor):
            return recorded / self.aperture[..., None, None].to(recorded)
        return recorded if self.aperture == 1 else recorded / self.aperture

    @classmethod
    def __torch_function__(
        cls, func: Callable[..., Any], types: Any, args: tuple[Any, ...] = (), kwargs: dict[str, Any] | None = None
    ) -> Any:
        with torch._C.DisableTorchFunctionSubclass():
            result = func(*args, **(kwargs or {}))
        if isinstance(result, (tuple, list)) and any(isinstance(part, torch.Tensor) for part in result):
            parts = [cls._scaled(func, args, kwargs or {}, part, number) for number, part in enumerate(result)]
            return type(result)(parts)
        return cls._scaled(func, args, kwargs or {}, result)

    @classmethod
    def _scaled(
        cls,
        func: Callable[..., Any],
        args: tuple[Any, ...],
        kwargs: dict[str, Any],
        result: Any,
        part: int | None = None,
    ) -> Any:
        """Return the result of an operation, or one of its parts, with its scale where that is known."""
        if not isinstance(result, torch.Tensor) or result.ndim not in (2, 3) or not result.is_floating_point():
            return result
        operands = args[0] if args and isinstance(args[0], (list, tuple)) else args[:2]
        known = [operand for operand in operands if isinstance(operand, Measurement)]
        if not known or func.__name__ == "as_subclass":
            return result
        first = known[0]
        aperture = _aperture_after(func, args, kwargs, known, result, part)
        scale = None if aperture is None else _scale_after(func.__name__.strip("_"), operands, known)
        kept = first.aperture if aperture is None else aperture
        measurement = _measurement(result, kept, scale, first.camera, first.is_linear)
        if scale is not None and func.__name__.strip("_") in (*IN_PLACE, "mul", "div", "truediv", "rmul"):
            measurement.mask_mark = first.mask_mark
        return measurement

    def __repr__(self, **_: Any) -> str:  # type: ignore[override]  # torch's argument is for its own use
        scale = "unknown scale" if self.full_scale is None else f"full scale {self.full_scale:g}"
        aperture = f"{self.aperture.tolist()}" if isinstance(self.aperture, torch.Tensor) else f"{self.aperture:g}"
        return f"Measurement({self.as_subclass(torch.Tensor)!r}, aperture {aperture}, {scale})"

    def __deepcopy__(self, memo: dict[int, Any]) -> Measurement:
        copied = self.as_subclass(torch.Tensor).__deepcopy__(memo)
        return _measurement(copied, self.aperture, self.full_scale, self.camera, self.is_linear)

    def __reduce_ex__(self, protocol: Any) -> Any:
        return self.as_subclass(torch.Tensor).__reduce_ex__(protocol)  # a plain tensor, which any program can load


def _measurement(
    values: torch.Tensor,
    aperture: float | torch.Tensor,
    full_scale: float | None,
    camera: Camera | None,
    is_linear: bool,
) -> Measurement:
    result = values.as_subclass(Measurement)
    result.aperture, result.full_scale, result.camera, result.is_linear = aperture, full_scale, camera, is_linear
    return result


def _aperture_after(
    func: Callable[..., Any],
    args: Any,
    kwargs: dict[str, Any],
    known: list[Measurement],
    result: torch.Tensor,
    part: int | None,
) -> float | torch.Tensor | None:
    """Return the aperture of an operation's result, None if its snapshots have none of their own that follows."""
    first = known[0]
    if not any(isinstance(one.aperture, torch.Tensor) for one in known):
        return first.aperture
    if func.__name__.strip("_") in REARRANGED:  # a map of the scales goes the way of the pixels
        given = args[0]
        maps = [_scale_map(one) for one in given] if isinstance(given, (list, tuple)) else _scale_map(given)
        scales = func(maps, *args[1:], **kwargs)
        scales = scales if part is None else scales[part]
        first_pixels = scales[..., :1, :1]
        return first_pixels[..., 0, 0] if scales.numel() and bool((scales == first_pixels).all()) else None
    if result.shape != first.shape:  # as a mean over snapshots of several scales
        return None
    other = [one.aperture for one in known[1:]]
    alike = all(torch.equal(torch.as_tensor(one), torch.as_tensor(first.aperture)) for one in other)
    return first.aperture if alike else None


def _scale_map(values: torch.Tensor) -> torch.Tensor:
    aperture = torch.as_tensor(getattr(values, "aperture", 1.0), device=values.device)
    return aperture[..., None, None].expand(values.shape)


def _scale_after(name: str, operands: Any, known: list[Measurement]) -> float | None:
    """Return the full scale of an operation's result, None if that does not follow."""
    first = known[0]
    scales = [one.full_scale for one in known]
    several = any(isinstance(one.aperture, torch.Tensor) for one in known)  # compared before, for each snapshot
    alike = all(one.is_linear == first.is_linear and (several or one.aperture == first.aperture) for one in known)
    if first.full_scale is None or None in scales or not alike:
        return None
    if name in ("stack", "cat"):
        return first.full_scale if len(known) == len(operands) and len(set(scales)) == 1 else None
    if name in ("add", "iadd", "radd") and len(known) == 2:
        return sum(scales)  # type: ignore[arg-type]
    if name in UNCHANGED and len(known) == 1:
        return first.full_scale
    if name in ("mul", "imul", "rmul", "div", "truediv", "true_divide", "itruediv", "idiv") and len(known) == 1:
        other = next((operand for operand in operands[:2] if operand is not first), None)
        if isinstance(other, (int, float)) or (
            isinstance(other, torch.Tensor) and other.ndim == 0 and not other.requires_grad
        ):
            factor = float(other) if "mul" in name else 1 / float(other) if operands[0] is first and other else 0.0
            return first.full_scale * factor if factor > 0 else None
    return None


def _is_another_mask(mask: torch.Tensor, mark: torch.Tensor | None) -> bool:
    if mark is None or mask.is_meta:
        return False
    return bool((mark_of(mask) - mark).abs().max() > ANOTHER_MASK * mask.detach().double().norm().cpu())


def mark_of(mask: torch.Tensor) -> torch.Tensor:
    """Return four numbers by which masks are told from each other: sums of their values with varying weights."""
    values = mask.detach().double().flatten()
    places = torch.arange(len(values), dtype=torch.float64, device=values.device)
    return torch.stack([values @ torch.cos(frequency * places) for frequency in (1.0, 1.7, 2.3, 2.9)]).cpu()


def as_float_tensor(values: torch.Tensor | np.ndarray) -> torch.Tensor:
    """Return values as a tensor; floating ones of an array in float32, which the networks compute in."""
    if isinstance(values, torch.Tensor):
        return values
    return torch.as_tensor(values.astype(np.float32) if values.dtype.kind == "f" else values)


def marked(mask: torch.Tensor, aperture: float | None, undone: bool) -> torch.Tensor:
    """Return a camera's mask, which remembers that plain measurements behind it are no sums of mask times frame.

    Args:
        mask: ``(T, H, W)``.
        aperture: of the camera; None where every snapshot has its own.
        undone: whether the camera has effects of optics or sensor to be undone.
    """
    if aperture == 1 and not undone:
        return mask
    mask = mask.view_as(mask)  # the mark is this tensor's alone, not that of the buffer that it may be
    text = "one for each snapshot" if aperture is None else f"{aperture:.3g}"
    mask.camera_aperture = text  # type: ignore[attr-defined]
    return mask


def linear_with_mask(measurement: torch.Tensor, mask: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return plain tensors: the measurement ``(N, H, W)`` as a decoder takes it, and the mask ``(T, H, W)`` unmarked.

    Args:
        measurement: a :class:`Measurement`, or a plain sum of mask times frame.
        mask: ``(T, H, W)``.

    Raises:
        BadInput: no tensors, the two in the place of each other, or a plain tensor beside the mask of a camera of
            another light scale: it does not say what it is.
    """
    if not isinstance(measurement, torch.Tensor) or not isinstance(mask, torch.Tensor):
        kinds = " and ".join(type(one).__name__ for one in (measurement, mask))
        raise BadInput(f"decoder called with {kinds}; it takes two tensors: decoder(y, encoder.transmittance())")
    if isinstance(mask, Measurement):
        raise BadInput("decoder called with the mask first; the measurement comes first: decoder(y, mask)")
    aperture = getattr(mask, "camera_aperture", None)
    if isinstance(measurement, Measurement):
        if _is_another_mask(mask, measurement.mask_mark):
            warnings.warn(
                "the mask is not the one behind which this measurement was recorded: another camera's, displaced, "
                "or changed since; give the encoder's own, encoder.transmittance(), unless you mean it",
                InputWarning,
                stacklevel=4,
            )
        measurement = measurement.linear()
    elif aperture is not None:
        raise BadInput(
            f"a plain tensor as measurement beside the mask of a camera of aperture {aperture} does not say what "
            "it is: give what the encoder returned; or encoder.normalised(y) of what it recorded, a fraction of full "
            "scale; or sci.Measurement(y) of a sum of mask times frame"
        )
    return measurement, mask if aperture is None else mask.view_as(mask)
