"""A trial recording of an encoder that a file configures: settings can be valid one by one and fail together."""

from __future__ import annotations

import torch

from sci_lightning.encoder.encoder import Encoder
from sci_lightning.errors import BadInput, MachineFailure


@torch.no_grad()
def check_recording(encoder: Encoder, where: str) -> None:
    """Record and linearise a dark scene; the state of the random generator does not change.

    Args:
        encoder: the encoder to try.
        where: the file that configures it, for the message.

    Raises:
        BadInput: the recording fails, for whatever reason a library gives.
    """
    with torch.random.fork_rng(devices=[]):
        try:
            mask = encoder.transmittance()
            dark = mask.new_zeros(()).expand(1, encoder.mask.frames, *encoder.size)
            encoder.linearise(encoder.record(dark, mask))
        except (BadInput, MachineFailure, OSError, MemoryError):
            raise
        except Exception as error:  # every library has exceptions of its own
            reason = " ".join(str(error).split())[:200] or type(error).__name__
            raise BadInput(f"{where}: cannot record with these settings ({reason})") from error
