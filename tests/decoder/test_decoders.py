"""The contract of every decoder in the configuration."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from sci_lightning.decoder import Decoder, Res2former
from sci_lightning.decoder.complexity import count_macs, count_parameters
from sci_lightning.errors import BadInput
from tests.conftest import members
from tests.decoder.small import SMALL

UNTRAINED = {"sci3d": 4, "elp_unfolding": 2}  # parameters that the published networks hold and do not use, of SMALL


@pytest.fixture
def small(make_decoder: Callable[..., Decoder]) -> Callable[..., Decoder]:
    """Builds a decoder of few channels; one that ``SMALL`` does not list is built as configured."""
    return lambda name, frames: make_decoder(name, frames, *SMALL.get(name, []))


@pytest.mark.parametrize("name", members("decoder"))
@pytest.mark.parametrize(
    ("frames", "height", "width"),
    [
        (5, 21, 18),
        pytest.param(8, 32, 32, marks=pytest.mark.slow),
        pytest.param(2, 16, 24, marks=pytest.mark.slow),
    ],
)
def test_contract(name: str, frames: int, height: int, width: int, small: Callable[..., Decoder]) -> None:
    decoder = small(name, frames)
    assert isinstance(decoder, Decoder)
    with torch.no_grad():
        for parameter in decoder.parameters():
            if not parameter.any():  # a gain or a layer that starts from 0 hides what stands before it
                parameter.normal_(std=0.1)
    mask = torch.rand(frames, height, width, requires_grad=True)
    measurement = torch.rand(2, height, width, requires_grad=True)
    video = decoder(measurement, mask)
    assert video.shape == (2, frames, height, width)
    assert torch.isfinite(video).all()
    assert torch.allclose(video[1:], decoder(measurement[1:], mask), atol=1e-5)  # snapshots do not mix
    assert count_parameters(decoder) == sum(p.numel() for p in decoder.parameters())
    macs = count_macs(decoder, frames, height, width)
    assert macs >= 0
    if not count_parameters(decoder):
        return  # nothing to learn, and no gradients that would learn a mask
    assert macs > 0
    video.square().mean().backward()
    trained = {key: value for key, value in decoder.named_parameters() if value.requires_grad}
    assert len(trained) == len(list(decoder.parameters())) - UNTRAINED.get(name, 0)
    for key, tensor in {"mask": mask, "measurement": measurement, **trained}.items():
        if (name, frames, key[:12]) == ("birnat", 2, "backrnn.h_h."):
            continue  # two frames are one step back: the state after it goes nowhere
        assert tensor.grad is not None and torch.isfinite(tensor.grad).all() and tensor.grad.abs().sum() > 0, key


@pytest.mark.parametrize("name", members("decoder"))
def test_two_frames_in_bfloat16_have_finite_gradients(name: str, small: Callable[..., Decoder]) -> None:
    """torch's own convolutions over more taps than frames leave NaN in some gradients on a CPU."""
    decoder = small(name, 2)
    if not count_parameters(decoder):
        return
    with torch.autocast("cpu", torch.bfloat16):
        video = decoder(torch.rand(2, 32, 32), torch.rand(2, 32, 32))
    video.float().square().mean().backward()
    for key, parameter in decoder.named_parameters():
        assert parameter.grad is None or torch.isfinite(parameter.grad).all(), key


@pytest.mark.parametrize("name", ["admm_net", "birnat", "elp_unfolding", "gap_net", "sci3d", "revsci"])
def test_the_last_stage_is_the_estimate(name: str, small: Callable[..., Decoder]) -> None:
    decoder, measurement, mask = small(name, 4), torch.rand(2, 13, 16), torch.rand(4, 13, 16)
    stages = decoder.stages(measurement, mask)
    assert all(stage.shape == (2, 4, 13, 16) for stage in stages)
    assert torch.equal(stages[-1], decoder(measurement, mask))


@pytest.mark.parametrize("name", members("decoder"))
def test_masks_that_never_open(name: str, small: Callable[..., Decoder]) -> None:
    assert torch.isfinite(small(name, 4)(torch.rand(1, 16, 16), torch.zeros(4, 16, 16))).all()


@pytest.mark.parametrize("name", ["gap_tv", "gap_net", "revsci"])
def test_shapes_that_do_not_fit(name: str, small: Callable[..., Decoder]) -> None:
    for measurement, mask in (((1, 16, 16), (4, 16, 17)), ((16, 16), (4, 16, 16)), ((1, 16, 16), (1, 4, 16, 16))):
        with pytest.raises(BadInput, match="same H and W"):
            small(name, 4)(torch.rand(measurement), torch.rand(mask))


@pytest.mark.parametrize("name", members("decoder"))
def test_other_numbers_of_frames(name: str, small: Callable[..., Decoder]) -> None:
    decoder = small(name, 4)
    if decoder.frames is None:
        assert decoder(torch.rand(1, 8, 8), torch.rand(5, 8, 8)).shape == (1, 5, 8, 8)
    else:
        with pytest.raises(BadInput, match="built for 4 frames, the mask has 5"):
            decoder(torch.rand(1, 8, 8), torch.rand(5, 8, 8))


def test_res2former_takes_any_number_of_frames() -> None:
    decoder = Res2former(16, (1, 1))
    for frames in (2, 8, 13):
        assert decoder(torch.rand(1, 8, 8), torch.rand(frames, 8, 8)).shape == (1, frames, 8, 8)
    with pytest.raises(BadInput, match="does not divide"):
        Res2former(10)


@pytest.mark.parametrize("name", ["gap_tv", "pnp_ffdnet"])
def test_what_is_left_out_of_the_count_has_no_products(
    name: str, small: Callable[..., Decoder], monkeypatch: pytest.MonkeyPatch
) -> None:
    decoder = small(name, 2)
    counted = count_macs(decoder, 2, 16, 16)
    monkeypatch.setattr(type(decoder), "counted", lambda self: self)
    assert counted == count_macs(decoder, 2, 16, 16)


class Wrong(Decoder):
    """Returns what ``result`` makes of the mask."""

    def __init__(self, result: Callable[[torch.Tensor], object]) -> None:
        super().__init__()
        self.result = result

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return self.result(mask)  # type: ignore[return-value]


@pytest.mark.parametrize(
    "result",
    [lambda mask: mask[None, :4], lambda mask: mask, lambda mask: mask[None, :, :9], lambda mask: None],
)
def test_a_decoder_of_somebody_else_that_returns_no_video(result: Callable[[torch.Tensor], object]) -> None:
    mask = torch.rand(8, 12, 10)
    with pytest.raises(BadInput, match=r"Wrong returned .*\(1, 8, 12, 10\)"):
        Wrong(result)(torch.rand(1, 12, 10), mask)
