"""Where tensors are computed with, and what that is called in results."""

from __future__ import annotations

import torch

from sci_lightning.errors import BadInput


def resolve_device(name: str) -> torch.device:
    """The device that ``device=`` names: cpu, cuda, cuda:1, ..; auto is the GPU where there is one.

    Raises:
        BadInput: no such device here.
    """
    auto = "cuda" if torch.cuda.is_available() else "cpu"
    try:
        device = torch.device(auto if name == "auto" else name)
        torch.empty(0, device=device)
    except (RuntimeError, AssertionError) as error:  # the latter from a torch without CUDA
        raise BadInput(f"device={name}: there is none on this machine; choose auto, cpu, cuda, cuda:1, ..") from error
    return device


def is_processor(name: str) -> bool:
    """Return whether a name of :func:`device_name` is that of a processor, not of a GPU."""
    return name.startswith("cpu")


def device_name(device: torch.device) -> str:
    """Such as ``NVIDIA A40`` or ``cpu (2 threads)``."""
    if device.type == "cuda":
        return torch.cuda.get_device_name(device)
    return f"{device.type} ({torch.get_num_threads()} threads)"
