"""The report of a diagnosis, of any origin, as it is compared with what was hidden."""

from __future__ import annotations

from pathlib import Path

from sci_lightning.errors import BadInput
from sci_lightning.files.diagnosis_report import BlindGap, DiagnosisReport
from sci_lightning.files.json_file import read_json
from sci_lightning.virtual_camera.comparison import Estimate, Report, ReportedEffect


def read_report(path: str | Path) -> Report:
    """Read the ``report.json`` of a diagnosis.

    Raises:
        BadInput: no such file, something else than a report, or one of a blind diagnosis, which has no chi2.
    """
    report = read_json(path, DiagnosisReport)
    before, after = report.gap.before, report.gap.after
    if isinstance(before, BlindGap) or isinstance(after, BlindGap):
        raise BadInput(f"{path}: of a blind diagnosis, expected one of calibration captures, with gap.before.chi2")
    effects = (
        ReportedEffect(
            effect.name,
            {name: Estimate(value.value, float(value.std), value.unit) for name, value in effect.parameters.items()},
            tuple(effect.alternatives),
        )
        for effect in [*report.laboratory, *report.effects]
    )
    return Report(tuple(effects), tuple(part.stage for part in report.unnamed), before.chi2, after.chi2)
