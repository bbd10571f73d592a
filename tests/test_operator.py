"""The snapshot operator: its formula, its adjoint, and the steps that follow from them."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.operator import SnapshotOperator

FRAMES, HEIGHT, WIDTH = 6, 5, 7


@pytest.fixture(params=["binary", "gray"])
def mask(request: pytest.FixtureRequest) -> torch.Tensor:
    """A mask that leaves one pixel dark in every slot."""
    numbers = torch.rand(FRAMES, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(1))
    mask = (numbers < 0.5).float() if request.param == "binary" else numbers
    mask[:, 2, 3] = 0
    return mask


@pytest.fixture
def video() -> torch.Tensor:
    return torch.rand(2, FRAMES, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(2))


@pytest.mark.parametrize("slot_by_slot", [False, True])
def test_sum_of_mask_times_frame(mask: torch.Tensor, video: torch.Tensor, slot_by_slot: bool) -> None:
    expected = torch.zeros(2, HEIGHT, WIDTH)
    for slot in range(FRAMES):
        expected += mask[slot] * video[:, slot]
    assert torch.allclose(SnapshotOperator(mask, slot_by_slot=slot_by_slot)(video), expected, atol=1e-6)


def test_adjoint(mask: torch.Tensor, video: torch.Tensor) -> None:
    operator, measurement = SnapshotOperator(mask.double()), torch.rand(2, HEIGHT, WIDTH).double()
    forward = (operator(video.double()) * measurement).sum()
    assert torch.isclose(forward, (video.double() * operator.adjoint(measurement)).sum())


def test_projection_explains_the_measurement(mask: torch.Tensor, video: torch.Tensor) -> None:
    operator = SnapshotOperator(mask)
    measurement = operator(video)
    start = torch.rand(video.shape)
    projected = operator.project(start, measurement)
    assert torch.allclose(operator(projected), measurement, atol=1e-5)
    assert torch.allclose(operator.project(projected, measurement), projected, atol=1e-5)
    assert torch.equal(projected[..., 2, 3], start[..., 2, 3])  # no slot opens there
    least = operator.pseudo_inverse(measurement)
    assert torch.allclose(least, operator.project(torch.zeros_like(video), measurement), atol=1e-6)
    assert float(least.norm()) <= float(projected.norm())


def test_data_step_minimises_its_objective(mask: torch.Tensor, video: torch.Tensor) -> None:
    operator, gamma = SnapshotOperator(mask.double()), 0.3
    measurement, start = torch.rand(2, HEIGHT, WIDTH).double(), video.double()
    power = mask.double().square().sum(0)
    step = operator.data_step(start, measurement, power + gamma).requires_grad_()
    ((measurement - operator(step)).square().sum() + gamma * (step - start).square().sum()).backward()
    assert step.grad is not None and float(step.grad.abs().max()) < 1e-9


def test_scenes_at_rest_and_without_structure(mask: torch.Tensor, video: torch.Tensor) -> None:
    operator, frame, levels = SnapshotOperator(mask), video[:, 0], torch.rand(FRAMES)
    still = frame[:, None].expand(-1, FRAMES, -1, -1)
    assert torch.allclose(operator.static_scene(frame), operator(still), atol=1e-6)
    even = levels[None, :, None, None].expand(1, -1, HEIGHT, WIDTH)
    assert torch.allclose(operator.uniform_scene(levels), operator(even)[0], atol=1e-6)
    opened = mask.sum(0) > 0
    assert torch.allclose(operator.mean_video(operator(still))[..., opened], still[..., opened], atol=1e-6)


def test_cells(video: torch.Tensor) -> None:
    fine = torch.rand(FRAMES, 3 * HEIGHT, 3 * WIDTH)
    operator = SnapshotOperator(fine, cells=3)
    image = operator(video)
    assert image.shape == (2, 3 * HEIGHT, 3 * WIDTH)
    pixels = torch.nn.functional.avg_pool2d(image, 3)
    assert torch.allclose(pixels, operator.in_pixels()(video), atol=1e-6)
    assert torch.allclose(operator.static_scene(video[:, 0]), operator.total() * operator.on_cells(video[:, 0]))
