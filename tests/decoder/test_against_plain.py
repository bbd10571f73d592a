"""Networks that are computed differently from how they are published, against plain transcriptions of those."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest
import torch
from torch import Tensor

from sci_lightning.decoder import (
    BIRNAT,
    E2ECNN,
    SCI3D,
    ADMMNet,
    Decoder,
    EfficientSCI,
    ELPUnfolding,
    GAPNet,
    MetaSCI,
    Res2former,
    RevSCI,
    STFormer,
)
from tests.decoder.transcriptions import as_published
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

Plain = Callable[[dict[str, Tensor], Tensor, Tensor], list[Tensor]]

NETWORKS: dict[str, tuple[Callable[[int], Decoder], Plain]] = {
    "e2e_cnn": (lambda frames: E2ECNN(frames, 6), e2e_cnn),
    "metasci": (lambda frames: MetaSCI(frames, 16, 2), metasci),
    "res2former": (lambda frames: Res2former(8, (1, 2)), res2former),
    "res2former, published width": (lambda frames: Res2former(96, (1, 1)), res2former),
    "birnat": (lambda frames: BIRNAT(frames, 16, 6), birnat),
    "revsci": (lambda frames: RevSCI(3, 16), revsci),
    "revsci, published width": (lambda frames: RevSCI(1), revsci),
    "sci3d": (lambda frames: SCI3D(3, (4, 6, 8), 3), sci3d),
    "efficientsci": (lambda frames: EfficientSCI(16, 2), efficientsci),
    "efficientsci, published width": (lambda frames: EfficientSCI(64, 1), efficientsci),
    "stformer": (lambda frames: STFormer(frames, 8, 2), stformer),
    "stformer, published width": (lambda frames: STFormer(frames, 64, 1), stformer),
    "elp_unfolding": (
        lambda frames: ELPUnfolding(frames, 16, 3, 5),
        lambda state, y, mask: elp_unfolding(state, y, mask, squared=True),
    ),
    "elp_unfolding, sum of M": (
        lambda frames: ELPUnfolding(frames, 16, 3, 5, squared=False),
        lambda state, y, mask: elp_unfolding(state, y, mask, squared=False),
    ),
    **{
        f"{name}, sum of M{' squared' if squared else ''}": (
            lambda frames, kind=kind, squared=squared: kind(frames, 3, channels=(4, 6, 8), squared=squared),
            partial(plain, squared=squared),
        )
        for name, kind, plain in (("gap_net", GAPNet, gap_net), ("admm_net", ADMMNet, admm_net))
        for squared in (False, True)
    },
}


def structural(frames: int, height: int, width: int) -> Tensor:
    """Gray levels of sixteenths that sum to 1 over time."""
    steps = torch.randint(frames, (16, height, width))
    return torch.stack([(steps == t).float().mean(0) for t in range(frames)])


@pytest.mark.parametrize("kind", ["binary", "structural"])
@pytest.mark.parametrize("name", NETWORKS)
@torch.no_grad()
def test_every_stage_is_the_same(name: str, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    # several blocks, of which the last is smaller
    monkeypatch.setattr("sci_lightning.decoder.birnat.POSITION_WEIGHTS", 700)
    frames, height, width = 5, 12, 20
    build, plain = NETWORKS[name]
    decoder = build(frames)
    for parameter in decoder.parameters():
        # penalties stay positive, gains leave their 0, and sums over many inputs do not grow with their number
        one = parameter.numel() == 1
        parameter += 0.3 * torch.rand(1) if one else 0.5 * torch.randn_like(parameter) / parameter[0].numel() ** 0.5
    if kind == "binary":
        mask = (torch.rand(frames, height, width) < 0.5).float()
        mask[:, 2, 3] = 0  # a pixel that never opens
    else:
        mask = structural(frames, height, width)
    measurement = (mask * torch.rand(2, frames, height, width)).sum(1)
    expected = plain(as_published(decoder), measurement, mask)
    for result, stage in zip(decoder.stages(measurement, mask), expected, strict=True):
        torch.testing.assert_close(result, stage, rtol=0, atol=1e-5 * float(stage.abs().max()))
