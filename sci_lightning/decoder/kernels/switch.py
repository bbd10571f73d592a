"""The switch between the faster kernels and the plain formulas of the layers."""

from __future__ import annotations

from types import TracebackType

from sci_lightning.errors import BadInput

KERNELS = ("auto", "plain")
"""``auto`` takes the fastest way for every shape and device, ``plain`` computes the formulas as they are written."""

_in_use = "auto"


class use:
    """Choose how decoders are computed in this process, until the next choice or the end of a ``with`` block.

    Args:
        kernels: ``auto`` or ``plain``.

    Raises:
        BadInput: another name.

    Example:
        >>> import torch
        >>> from sci_lightning.decoder import RevSCI, kernels
        >>> decoder, measurement, mask = RevSCI(blocks=1, channels=8), torch.rand(1, 8, 8), torch.rand(4, 8, 8)
        >>> with kernels.use("plain"):
        ...     reference = decoder(measurement, mask)
        >>> torch.allclose(decoder(measurement, mask), reference, atol=1e-5)
        True
    """

    def __init__(self, kernels: str) -> None:
        global _in_use
        if kernels not in KERNELS:
            raise BadInput(f"kernels={kernels}: choose {' or '.join(KERNELS)}")
        self.before = _in_use
        _in_use = kernels

    def __enter__(self) -> use:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        global _in_use
        _in_use = self.before


def are_plain() -> bool:
    """Return whether layers have to compute their formulas as they are written."""
    return _in_use == "plain"
