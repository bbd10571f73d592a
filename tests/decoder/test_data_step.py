"""The data step: where it goes with which weight."""

from __future__ import annotations

import torch

from sci_lightning.decoder.layers.data_step import data_step, snapshot
from sci_lightning.decoder.layers.initial_estimate import mask_total


def test_projection_explains_the_measurement() -> None:
    video, mask, measurement = torch.rand(2, 5, 8, 9), torch.rand(5, 8, 9), torch.rand(2, 8, 9)
    reached = data_step(video, measurement, mask, mask_total(mask, squared=True))
    torch.testing.assert_close(snapshot(reached, mask), measurement)
    short = data_step(video, measurement, mask, mask_total(mask))  # the sum of M is too large a weight for gray masks
    assert (snapshot(short, mask) - measurement).abs().max() > 0.01
    binary = (mask < 0.5).float()
    same = (data_step(video, measurement, binary, mask_total(binary, squared)) for squared in (False, True))
    assert torch.equal(*same)


def test_with_gamma_it_is_the_minimum() -> None:
    video, mask, measurement = (torch.rand(shape, dtype=torch.double) for shape in ((1, 4, 6, 6), (4, 6, 6), (1, 6, 6)))
    gamma = 0.3
    reached = data_step(video, measurement, mask, mask_total(mask, squared=True) + gamma).requires_grad_()
    cost = (measurement - snapshot(reached, mask)).square().sum() + gamma * (reached - video).square().sum()
    cost.backward()
    assert reached.grad is not None and reached.grad.abs().max() < 1e-12
