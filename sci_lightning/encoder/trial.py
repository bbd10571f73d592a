"""Does an encoder out of a file record at all? Settings can be right one by one and wrong together."""

from __future__ import annotations

import torch

from sci_lightning.encoder.encoder import Encoder
from sci_lightning.errors import BadInput, MachineFailure


@torch.no_grad()
def check_recording(encoder: Encoder, where: str) -> None:
    """Record a dark scene and undo what can be undone; the random generator is left as it was.

    Args:
        encoder: any.
        where: what configures it, for the message.

    Raises:
        BadInput: it cannot, for whatever reason a library gives.
    """
    with torch.random.fork_rng(devices=[]):
        try:
            mask = encoder.transmittance()
            dark = mask.new_zeros(()).expand(1, encoder.mask.frames, *encoder.mask.size)
            encoder.linearise(encoder.record(dark, mask))
        except (BadInput, MachineFailure, OSError, MemoryError):
            raise
        except Exception as error:  # every library has exceptions of its own
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise BadInput(f"{where}: cannot record with these settings ({reason})") from error
