"""The encoder as a physics object of deepinv, whose solvers then reconstruct its snapshots."""

from __future__ import annotations

from typing import Any

import torch

from sci_lightning.errors import BadInput
from sci_lightning.operator import SnapshotOperator


def deepinv_physics(transmittance: torch.Tensor, aperture: float) -> Any:
    """Return y = a * sum over t of M_t x_t as deepinv's ``LinearPhysics``, with A, A_adjoint, A_dagger in closed form.

    For deepinv the T frames are channels, and the snapshot is a single channel: x ``(N, T, H, W)``, y ``(N, 1, H, W)``.

    Args:
        transmittance: M, ``(T, H, W)``, in whole pixels.
        aperture: a.

    Raises:
        BadInput: deepinv is not installed, or the torchvision that it imports does not fit the installed torch.
    """
    try:
        from deepinv.physics import LinearPhysics
    except ImportError as error:
        needed = f"encoder.as_deepinv() needs deepinv, and the torchvision that it imports ({error})"
        raise BadInput(f"{needed}: pip install 'sci-lightning[deepinv]'") from error
    except RuntimeError as error:  # torchvision without the compiled operators that it describes
        raise BadInput(
            f"deepinv cannot be imported: {error}; install the torchvision that fits torch {torch.__version__}"
        ) from error

    class Snapshot(LinearPhysics):  # defined here, because its base class may not be installed
        def __init__(self) -> None:
            super().__init__(img_size=tuple(transmittance.shape))
            self.register_buffer("mask", aperture * transmittance)

        @property
        def operator(self) -> SnapshotOperator:
            return SnapshotOperator(self.mask)

        def A(self, x: torch.Tensor, **_: Any) -> torch.Tensor:
            return self.operator(x)[:, None]

        def A_adjoint(self, y: torch.Tensor, **_: Any) -> torch.Tensor:
            return self.operator.adjoint(y[:, 0])

        def A_dagger(self, y: torch.Tensor, **_: Any) -> torch.Tensor:
            """Return the video of least norm that explains y; 0 where no slot opens."""
            return self.operator.pseudo_inverse(y[:, 0])

    return Snapshot()
