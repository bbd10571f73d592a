"""The engine of the studies: independent cases, each of which leaves one file, wherever it runs.

A study plans cases (:class:`~.records.Case`), says what one case computes, and sums up the records. The engine runs the
cases that have no record yet and that no other process has claimed::

    records = Records(out / "cases", Outcome)
    for ended in run_cases(run_trial, records.missing(cases), records, workers=2):
        ...

What has ended stands in the folder of the records and nowhere else. So whatever ends a run, the same command goes on;
several processes, on one machine or on many, may work on one folder; and folders are merged by copying.
"""

from sci_lightning.studies.engine.records import Case, CaseRecord, FailedCase, Records, digest_of
from sci_lightning.studies.engine.run_cases import run_cases

__all__ = ["Case", "CaseRecord", "FailedCase", "Records", "digest_of", "run_cases"]
