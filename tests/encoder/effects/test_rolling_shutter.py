"""Row r opens delay * r / (H - 1) slots late; patterns go on, the last frame is held."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder.effects import RollingShutter
from tests.encoder.effects.conftest import seen


def test_rows() -> None:
    told, frame = torch.tensor([0.0, 0.125, 0.25, 0.375]), torch.tensor([0.1, 0.2, 0.3, 0.4])
    spread = [each[:, None, None].expand(4, 4, 2) for each in (told, frame)]
    result = seen(RollingShutter(delay=1.5), *spread)[:, 0]
    assert float(result[0]) == pytest.approx(float((told * frame).sum()))  # the first row is on time
    # half a slot late: half of slot 0 is missed, half of pattern 0 comes again before the last frame
    assert float(result[1]) == pytest.approx(float((told * frame).sum()))
    # 1.5 slots late: half of slot 1, slots 2 and 3, pattern 0 and half of pattern 1 before the last frame
    late = 0.5 * told[1] * frame[1] + told[2] * frame[2] + told[3] * frame[3] + frame[3] * (told[0] + 0.5 * told[1])
    assert float(result[3]) == pytest.approx(float(late))
