"""The results of the protocol as tables of texts: a row for every decoder and group of cameras."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from statistics import fmean, stdev
from typing import Any

from sci_lightning.diagnosis.blind.undetermined import UNDETERMINED
from sci_lightning.studies.mismatch.cameras import GROUPS
from sci_lightning.studies.mismatch.scenarios import SCENARIOS

Record = Mapping[str, Any]

SOURCE = "InverseNet, arXiv 2603.04538"
"""Of figures that others published for this protocol, shown beside ours and never mixed with them."""

MEANS: Mapping[str, Mapping[str, float]] = {
    "gap_tv": {"ideal": 26.75, "mismatched": 15.81, "known": 26.01},
    "pnp_ffdnet": {"ideal": 29.28, "mismatched": 11.43, "known": 25.39},
    "elp_unfolding": {"ideal": 34.09, "mismatched": 15.47, "known": 29.40},
    "efficientsci": {"ideal": 35.39, "mismatched": 14.81, "known": 27.38},
}
"""Mean PSNR in dB of the six scenes, by decoder and scenario."""


def summary_table(records: Sequence[Record], *, published: bool = False) -> list[list[str]]:
    """Return heading and rows: the published camera, the mean of the drawn ones, and every effect alone.

    Args:
        records: of one run of the protocol.
        published: whether a row with others' published figures follows that of the published camera.
    """
    scenarios = [key for key in SCENARIOS if any(key in record["scenarios"] for record in records)]
    kinds = [kind for kind in ("calibrated", "blind") if any(kind in record.get("recovery", {}) for record in records)]
    heading = [
        "camera",
        "decoder",
        *(SCENARIOS[key].title for key in scenarios),
        *(f"recovery, {kind}" for kind in kinds),
    ]
    rows = []
    for camera in _in_order({record["camera"] for record in records if not record["camera"].startswith("drawn_")}):
        for record in [record for record in records if record["camera"] == camera]:
            rows.append([_camera(record), record["decoder"], *_figures(record, scenarios), *_parts(record, kinds)])
            theirs = MEANS.get(record["decoder"])
            if published and camera == "published" and theirs:
                figures = [f"{theirs[key]:.2f}" if key in theirs else "" for key in scenarios]
                rows.append([f"published by {SOURCE}", record["decoder"], *figures, *("" for _ in kinds)])
        if camera == "published":
            rows += _drawn(records, scenarios, kinds)
    if not any(record["camera"] == "published" for record in records):
        rows = _drawn(records, scenarios, kinds) + rows
    return [heading, *rows]


def _drawn(records: Sequence[Record], scenarios: Sequence[str], kinds: Sequence[str]) -> list[list[str]]:
    """Return a row for every decoder: means over the drawn cameras, and the range of what was won back."""
    rows = []
    drawn = [record for record in records if record["camera"].startswith("drawn_")]
    for decoder in dict.fromkeys(record["decoder"] for record in drawn):
        mine = [record for record in drawn if record["decoder"] == decoder]
        cells = []
        for key in scenarios:  # a mean over fewer cameras would not compare with its neighbours
            values = [record["scenarios"][key]["mean"]["psnr"] for record in mine if key in record["scenarios"]]
            cells.append(f"{sum(values) / len(values):.2f}" if len(values) == len(mine) else "")
        for kind in kinds:
            parts = [record["recovery"][kind] for record in mine if kind in record.get("recovery", {})]
            count = f" ({len(parts)} of {len(mine)})" if len(parts) < len(mine) else ""
            cells.append(f"{100 * min(parts):.1f} to {100 * max(parts):.1f} %{count}" if parts else "")
        rows.append([f"mean of {len(mine)} drawn", decoder, *cells])
    return rows


def _in_order(cameras: set[str]) -> list[str]:
    """Return names of cameras, group by group."""
    return sorted(cameras, key=lambda name: (GROUPS.index(name.partition("_")[0]), name))


def _camera(record: Record) -> str:
    """Return what a camera is called: of one with a single effect, the effect with its parameters."""
    if not record["camera"].startswith("alone_"):
        return str(record["camera"])
    ((name, parameters),) = record["mismatch"].items()
    return f"{name} alone ({', '.join(f'{key} {value:g}' for key, value in parameters.items())})"


def _figures(record: Record, scenarios: Sequence[str]) -> list[str]:
    present = record["scenarios"]
    return [f"{present[key]['mean']['psnr']:.2f}" if key in present else "" for key in scenarios]


def _parts(record: Record, kinds: Sequence[str]) -> list[str]:
    parts = record.get("recovery", {})
    return [f"{100 * parts[kind]:.1f} %" if kind in parts else "" for kind in kinds]


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


BLIND_SCENARIOS = ("mismatched", "known", "blind")
"""Scenarios that are compared with a blind diagnosis."""
BLIND_HEADING = [
    "PSNR up to gain (dB)",
    "II",
    "III",
    "IV-blind",
    "III less IV-blind",
    "largest",
    "missed",
    "wrong",
    "processor seconds of a diagnosis",
]


def diagnosed_blind(records: Sequence[Record]) -> list[Record]:
    """Return the records with a blind diagnosis; those from before the score up to gain are left out."""
    return [record for record in records if all(_is_complete(record, key) for key in BLIND_SCENARIOS)]


def blind_table(records: Sequence[Record]) -> list[list[str]]:
    """Return heading and rows: the published camera, then the mean over the drawn ones.

    Args:
        records: that :func:`diagnosed_blind` chose, of one decoder.
    """
    drawn = [record for record in records if record["camera"].startswith("drawn_")]
    published = [record for record in records if record["camera"] == "published"]
    groups = {"published": published, f"mean of {len(drawn)} drawn": drawn}
    return [BLIND_HEADING, *(_blind_row(title, group) for title, group in groups.items() if group)]


def _blind_row(title: str, records: Sequence[Record]) -> list[str]:
    scores = [[record["scenarios"][key]["mean"]["psnr_up_to_gain"] for key in BLIND_SCENARIOS] for record in records]
    means = [sum(column) / len(column) for column in zip(*scores, strict=True)]
    lost = [known - blind for _, known, blind in scores]
    missed: list[str] = []
    wrong: list[str] = []
    for record in records:
        named = [effect["name"] for effect in record["diagnosis"]["blind"]["effects"]]
        there = [name for name in record["mismatch"] if name not in UNDETERMINED]  # which no snapshots tell
        missed += [name for name in there if name not in named]
        wrong += [name for name in named if name not in there]
    seconds = sorted(round(record["diagnosis"]["blind"]["cpu_seconds"]) for record in records)
    figures = [f"{value:.2f}" for value in (*means, sum(lost) / len(lost), max(lost))]
    times = " to ".join(str(value) for value in dict.fromkeys((seconds[0], seconds[-1])))
    return [title, *figures, _counted(missed), _counted(wrong), times]


def _counted(names: Iterable[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in Counter(names).most_common())


def _is_complete(record: Record, scenario: str) -> bool:
    return "psnr_up_to_gain" in record["scenarios"].get(scenario, {}).get("mean", {})
