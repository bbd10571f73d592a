"""Signal that ends before the converter does."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from sci_lightning.captures import read_captures
from sci_lightning.diagnosis.diagnosis import diagnose
from sci_lightning.diagnosis.model.likelihood import ClippedSignal
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.virtual_camera import Session, VirtualCamera


@pytest.mark.parametrize(
    ("mean", "deviation", "read"), [(3700.0, 39.0, 0.8), (3753.0, 39.0, 0.8), (3800.0, 39.0, 0.8), (3650.0, 39.0, 5.0)]
)
def test_standardised_signal_is_standard_normal(mean: float, deviation: float, read: float) -> None:
    random, count, level = torch.Generator().manual_seed(0), 200_000, 3753.0
    light = mean + deviation * torch.randn(count, 1, 1, generator=random)
    signal = light.clamp(max=level) + read * torch.randn(count, 1, 1, generator=random)
    both = (deviation**2 + read**2) ** 0.5
    full = torch.ones(count, 1, 1)
    clipped = ClippedSignal(mean * full, both * full, torch.tensor(level), torch.tensor(read))
    result = clipped.standardise(signal, torch.zeros(count, 1, 1)).double()
    assert abs(result.mean()) < 0.01 and abs(result.std() - 1) < 0.01 and abs((result**4).mean() - 3) < 0.06


def test_far_from_the_level_nothing_changes() -> None:
    signal, given = torch.tensor([100.0, 900.0])[:, None, None], torch.tensor([1.0, -1.0])[:, None, None]
    mean = torch.tensor([101.0, 2000.0])[:, None, None]
    clipped = ClippedSignal(mean, 5 * torch.ones(2, 1, 1), torch.tensor(900.0), torch.tensor(0.8))
    assert torch.equal(clipped.standardise(signal, given), given)


@pytest.mark.slow
def test_wells_that_are_full_at_the_level_of_a_flat_field(tmp_path: Path) -> None:
    """Shot noise of 39 DN, of which one side is lost, beside a readout noise of 0.8 DN: nothing else is to be seen."""
    session = Session(size=(32, 32), bit_depth=12, pattern=0)
    VirtualCamera(session, {"saturation": {"level": 0.9164}}).write(tmp_path / "a.h5", seed=3)
    result = diagnose(read_captures(tmp_path / "a.h5"), vocabulary())
    assert result.names == ("saturation",) and result.verdict == "explained"
    assert abs(float(result.after.fit.hypothesis.effects["saturation"]["level"]) - 0.9164) < 2e-4
