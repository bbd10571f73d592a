"""Which part of a large field is looked at."""

from __future__ import annotations

import torch

from sci_lightning.diagnosis.blind.snapshots import textured_window


def test_the_window_has_the_texture() -> None:
    image = torch.zeros(1, 96, 96)
    image[0, 50:80, 8:40] = torch.rand(30, 32, generator=torch.Generator().manual_seed(0))
    rows, columns = textured_window(image, 32)
    assert abs(rows.start - 49) <= 6 and abs(columns.start - 8) <= 6 and rows.stop - rows.start == 32
    assert textured_window(image, 200) == (slice(0, 96), slice(0, 96))
