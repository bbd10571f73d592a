"""The report of a blind diagnosis is JSON that others can read."""

from __future__ import annotations

import json

import numpy as np

from sci_lightning.diagnosis.report.blind_report import _gap


def test_a_snapshot_without_any_block_that_counts_has_no_number() -> None:
    gap = _gap(np.array([[-64.0, np.nan], [-128.0, np.nan]]))
    assert gap["nll_by_capture"] == [1.5, None]
    json.dumps(gap, allow_nan=False)
