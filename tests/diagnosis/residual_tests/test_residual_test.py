"""Holm's correction, and what a report gets."""

from __future__ import annotations

import json

import pytest

from sci_lightning.diagnosis.residual_tests.residual_test import corrected
from tests.diagnosis.small_diagnosis import with_p


def test_holm() -> None:
    result = [each.corrected for each in corrected([with_p(p) for p in (0.03, 0.01, 0.02, 0.9)])]
    assert result == pytest.approx([0.06, 0.04, 0.06, 0.9])


def test_significant_after_correction_only() -> None:
    alone, among = corrected([with_p(5e-4)]), corrected([with_p(5e-4), with_p(0.5), with_p(0.5)])
    assert alone[0].significant
    assert not among[0].significant
    assert json.loads(json.dumps(alone[0].describe()))["significant"]
