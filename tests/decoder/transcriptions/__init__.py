"""The published networks written down as plainly as possible, to compare ours with: functions of their state dicts.

Every file computes what a network's authors published, with torch's own layers in torch's default layout and attention
as softmax(Q K^T) V, on weights under the authors' names. They stand for the published code where it is timed; they are
not that code. ``kernels=plain`` is something else: our own networks without the faster kernels.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import torch

from sci_lightning.decoder import Decoder
from sci_lightning.weights.published import authors_keys
from tests.decoder.transcriptions.birnat import birnat
from tests.decoder.transcriptions.e2e_cnn import e2e_cnn
from tests.decoder.transcriptions.efficientsci import efficientsci
from tests.decoder.transcriptions.elp_unfolding import elp_unfolding
from tests.decoder.transcriptions.metasci import metasci
from tests.decoder.transcriptions.res2former import res2former
from tests.decoder.transcriptions.revsci import revsci
from tests.decoder.transcriptions.sci3d import sci3d
from tests.decoder.transcriptions.stformer import stformer
from tests.decoder.transcriptions.unet_stages import admm_net, gap_net

Published = Callable[[dict[str, torch.Tensor], torch.Tensor, torch.Tensor], list[torch.Tensor]]

TRANSCRIPTIONS: Mapping[str, Published] = {
    "e2e_cnn": e2e_cnn,
    "metasci": metasci,
    "gap_net": partial(gap_net, squared=False),
    "admm_net": partial(admm_net, squared=False),
    "birnat": birnat,
    "res2former": res2former,
    "res2former_l": res2former,
    "efficientsci": efficientsci,
    "revsci": revsci,
    "stformer": stformer,
    "sci3d": sci3d,
    "elp_unfolding": partial(elp_unfolding, squared=False),
}
"""The transcription of a network by the network's name in the configuration; it returns the videos of all stages."""


def as_published(decoder: Decoder) -> dict[str, torch.Tensor]:
    """Return the decoder's state under its authors' keys, the same tensors."""
    return {authors_keys(decoder, key)[0]: value for key, value in decoder.state_dict().items()}


def random_state(decoder: Decoder) -> dict[str, torch.Tensor]:
    """A state as its authors save it, of values that keep activations near 1."""
    return {key: 0.1 * torch.randn_like(value) for key, value in as_published(decoder).items()}
