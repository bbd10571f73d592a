"""Networks that begin with the linear estimate add to it, have the same weights, and learn the mask through it."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from sci_lightning.decoder import E2ECNN, Decoder, Linear
from sci_lightning.errors import BadInput
from sci_lightning.operator import SnapshotOperator
from tests.conftest import members
from tests.decoder.published_facts import PUBLISHED
from tests.decoder.small import SMALL

NETWORKS = sorted(set(PUBLISHED) & set(members("decoder")))


@pytest.mark.parametrize("name", NETWORKS)
def test_every_network_adds_to_the_linear_estimate(name: str, make_decoder: Callable[..., Decoder]) -> None:
    published = make_decoder(name, 4, *SMALL[name])
    decoder = make_decoder(name, 4, *SMALL[name], "decoder.first_estimate=linear")
    mask = torch.rand(4, 16, 16, requires_grad=True)
    measurement = SnapshotOperator(mask.detach())(torch.rand(1, 4, 1, 1).expand(1, 4, 16, 16))
    with torch.no_grad():
        left = decoder(measurement, mask) - Linear(mixture=False)(measurement, mask)  # of data steps only
        assert left.square().mean() < 1e-3
        assert not torch.allclose(decoder(measurement, mask), published(measurement, mask), atol=1e-3)
    decoder.load_state_dict(published.state_dict())  # the weights have the same names and sizes
    decoder(measurement, mask).square().mean().backward()
    assert mask.grad is not None and torch.isfinite(mask.grad).all() and mask.grad.abs().sum() > 0
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        assert torch.isfinite(decoder(measurement, mask)).all()


def test_the_published_input_is_the_default() -> None:
    assert E2ECNN(4, channels=4, blocks=1).linear_estimator is None
    with pytest.raises(BadInput, match=r"first_estimate=best: .*published or linear"):
        E2ECNN(4, channels=4, blocks=1, first_estimate="best")  # type: ignore[arg-type]
