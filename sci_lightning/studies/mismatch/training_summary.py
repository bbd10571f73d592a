"""What fine-tuning is worth, as a table of texts: four ways to use what a diagnosis found, over the seeds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import fmean, stdev
from typing import Any

Record = Mapping[str, Any]

ROWS = (
    ("camera and decoder ideal (I)", "ideal", "ideal"),
    ("decoder trained on the ideal camera, used as is (II)", "ideal", "mismatched"),
    ("the same, given the corrected mask (IV-calibrated)", "ideal", "calibrated"),
    ("fine-tuned behind the corrected camera", "finetuned", "calibrated"),
    ("trained from the start behind the corrected camera", "anew", "calibrated"),
)
"""Title of a row, the training of its decoder, and the scenario."""

BASELINES = (("mean measurement, ideal camera", "ideal"), ("mean measurement, corrected camera", "calibrated"))
"""Title and scenario of the baselines."""


def finetuning_table(records: Sequence[Record]) -> list[list[str]]:
    """Return heading and rows: mean PSNR over the seeds, their standard deviation, and the gain over the use as is.

    Args:
        records: of ``python -m sci_lightning.mismatch.finetuning``. A row without any record is left out; gains compare
            the seeds that both rows have.
    """
    as_is = _psnr(records, "ideal", "mismatched")
    rows = []
    for title, training, scenario in ROWS:
        values = _psnr(records, training, scenario)
        if not values:
            continue
        gains = [values[seed] - as_is[seed] for seed in values.keys() & as_is.keys()]
        spread = f" ± {stdev(values.values()):.2f}" if len(values) > 1 else ""
        gain = (
            f"{fmean(gains):+.2f}" if gains and scenario != "mismatched" and training + scenario != "idealideal" else ""
        )
        rows.append([title, f"{fmean(values.values()):.2f}{spread}", gain, ", ".join(map(str, sorted(values)))])
    for title, scenario in BASELINES:
        for record in records:
            if record["decoder"] == "mean_measurement" and scenario in record["scenarios"]:
                rows.append([title, f"{record['scenarios'][scenario]['mean']['psnr']:.2f}", "", ""])
    return [["decoder", "mean PSNR (dB)", "gain over the use as is (dB)", "seeds"], *rows]


def _psnr(records: Sequence[Record], training: str, scenario: str) -> dict[int, float]:
    """Return the mean PSNR in dB by seed."""
    return {
        int(record["settings"]["training_seed"]): float(record["scenarios"][scenario]["mean"]["psnr"])
        for record in records
        if record["settings"].get("training") == training and scenario in record["scenarios"]
    }
