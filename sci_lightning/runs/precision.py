"""In which precision networks are computed: ``precision=`` of the commands, and what a device multiplies natively."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import Any

import torch

from sci_lightning.errors import BadInput

SHORT = {"32": "32-true", "bf16": "bf16-mixed", "16": "16-mixed"}
"""Names of ``precision=``, and Lightning's names for the same."""

DTYPES = {"32-true": None, "bf16-mixed": torch.bfloat16, "16-mixed": torch.float16}
"""The type that ``torch.autocast`` computes networks in; None for no autocast."""

NATIVE_CPU = ("amx_bf16", "avx512_bf16", "bf16")
"""Capabilities of x86 (the first two) and ARM processors that multiply bfloat16."""


def resolve_precision(name: Any, device: torch.device, networks: bool = True) -> str:
    """Return Lightning's name of the precision that ``precision=`` stands for on a device.

    Args:
        name: ``auto`` (bfloat16 where the device multiplies it natively, else float32), ``32``, ``bf16``, ``16``, or
            one of Lightning's names, which are taken even where a device has to emulate them.
        device: on which networks are computed.
        networks: whether there is a network at all; everything else is computed in float32.

    Raises:
        BadInput: a precision that the device lacks.
    """
    name = "32-true" if name is None else str(name)
    if name == "auto":
        return "bf16-mixed" if networks and multiplies_bfloat16(device) else "32-true"
    if name == "bf16" and not multiplies_bfloat16(device):
        raise BadInput(
            f"precision=bf16: this {_kind(device)} does not multiply bfloat16, which would make it slower; choose "
            "precision=32, or auto"
        )
    if name in ("16", "16-mixed") and device.type == "cpu":
        raise BadInput(
            f"precision={name}: processors do not compute networks in float16; choose precision=bf16, 32 or auto"
        )
    return SHORT.get(name, name)


def multiplies_bfloat16(device: torch.device) -> bool:
    """Return whether a device multiplies bfloat16 natively, which is several times as fast as float32."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    if device.type != "cpu":
        return False
    if hasattr(torch.cpu, "get_capabilities"):
        capabilities = torch.cpu.get_capabilities()
        return any(capabilities.get(name, False) for name in NATIVE_CPU)
    return torch.cpu._is_avx512_bf16_supported() or torch.cpu._is_amx_tile_supported()


def describe_precision(precision: str, device: torch.device) -> str:
    """Return one line for the user: the precision of networks on a device, and what chooses another one."""
    kind = _kind(device)
    if precision == "bf16-mixed" and multiplies_bfloat16(device):
        return f"precision: networks in bfloat16, which this {kind} multiplies natively; precision=32 for float32"
    if precision == "32-true" and not multiplies_bfloat16(device):
        return f"precision: float32; this {kind} does not multiply bfloat16"
    return f"precision: {'float32' if precision == '32-true' else precision}"


def mixed_precision(precision: str, device: torch.device) -> AbstractContextManager[Any]:
    """Return a context in which networks are computed in a precision, given by Lightning's name; others are float32."""
    dtype = DTYPES.get(precision)
    return nullcontext() if dtype is None else torch.autocast(device.type, dtype)


def device_of_accelerator(accelerator: str) -> torch.device:
    """Return the kind of device that Lightning's ``trainer.accelerator`` chooses here: that of a GPU, or the CPU.

    Raises:
        BadInput: it asks for a device that this machine does not have.
    """
    if accelerator in ("auto", "gpu", "cuda") and torch.cuda.is_available():
        return torch.device("cuda")
    if accelerator in ("auto", "gpu", "mps") and torch.backends.mps.is_available():
        return torch.device("mps")
    if accelerator in ("gpu", "cuda", "mps"):
        raise BadInput(f"trainer.accelerator={accelerator}: there is none on this machine; choose auto or cpu")
    return torch.device("cpu")


def _kind(device: torch.device) -> str:
    return "processor" if device.type == "cpu" else "GPU"
