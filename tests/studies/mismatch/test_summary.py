"""Tables of the records."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from sci_lightning.errors import BadInput
from sci_lightning.studies.mismatch.summary import blind_table, diagnosed_blind, finetuning_table, summary_table
from sci_lightning.studies.tables.documented import KINDS
from tests.files.formats import check

blind_mismatch, finetuning, mismatch = (KINDS[kind] for kind in ("blind_mismatch", "finetuning", "mismatch"))


def made(
    camera: str, decoder: str = "gap_tv", mismatch: Any = None, settings: Any = None, **psnr: float
) -> dict[str, Any]:
    """A record with the given mean PSNR by scenario."""
    values = {key: {"psnr": value, "ssim": 0.5} for key, value in psnr.items()}
    scenarios = {key: {"mean": scores, "scenes": {"a": scores}} for key, scores in values.items()}
    recovery = {}
    if {"mismatched", "known", "calibrated"} <= psnr.keys():
        recovery = {"calibrated": (psnr["calibrated"] - psnr["mismatched"]) / (psnr["known"] - psnr["mismatched"])}
    about = {"machine": "an abacus", "date": "2026-11-22", "commit": "0123abcd", "scale": "32 x 32", "seeds": "0"}
    required: dict[str, Any] = {"data": "six_scenes", "mask": "mask.mat", "size": [32, 32], "aperture": 0.125}
    required |= {"bit_depth": 12, "full_well_e": 1e4, "read_noise_dn": 5, "frames": 8, "seed": 0, "decoder": {}}
    return {
        "format": "sci-mismatch",
        "format_version": 1,
        "camera": camera,
        "decoder": decoder,
        "digest": "0" * 16,
        "provenance": about,
        "mismatch": mismatch or {"gain": {"factor": 1.05}},
        "scenarios": scenarios,
        **({"recovery": recovery} if recovery else {}),
        "seconds": 1.0,
        "sci_lightning": "0.1.0",
        "settings": {**required, **(settings or {})},
    }


RECORDS = [
    made("alone_gain", ideal=27.0, known=26.9),
    made("drawn_01", ideal=27.0, mismatched=10.0, known=20.0, calibrated=20.0),
    made("drawn_02", ideal=27.0, mismatched=12.0, known=22.0, calibrated=21.0),
    made("published", ideal=27.0, mismatched=16.0, known=26.0, calibrated=25.5),
]


def test_rows() -> None:
    heading, *rows = summary_table(RECORDS, published=True)
    assert heading == ["camera", "decoder", "I", "II", "III", "IV-calibrated", "recovery, calibrated"]
    assert rows == [
        ["published", "gap_tv", "27.00", "16.00", "26.00", "25.50", "95.0 %"],
        ["published by InverseNet, arXiv 2603.04538", "gap_tv", "26.75", "15.81", "26.01", "", ""],
        ["mean of 2 drawn", "gap_tv", "27.00", "11.00", "21.00", "20.50", "90.0 to 100.0 %"],
        ["gain alone (factor 1.05)", "gap_tv", "27.00", "", "26.90", "", ""],
    ]
    assert summary_table(RECORDS[:3])[1][0] == "mean of 2 drawn"
    fewer = [*RECORDS[:2], made("drawn_02", ideal=27.0, mismatched=12.0)]  # interrupted: no mean over one of two
    assert summary_table(fewer)[1] == [
        "mean of 2 drawn",
        "gap_tv",
        "27.00",
        "11.00",
        "",
        "",
        "100.0 to 100.0 % (1 of 2)",
    ]


def test_what_blind_diagnoses_are_worth(tmp_path: Path) -> None:
    def diagnosed(camera: str, named: list[str], **psnr: float) -> dict[str, Any]:
        there = {"gain": {"factor": 0.5}, "mask_blur": {"sigma": 1.5}, "black_level": {"offset": 0.01}}
        record = made(camera, mismatch=there, **psnr)
        for scores in record["scenarios"].values():
            scores["mean"] = {**scores["mean"], "psnr_up_to_gain": scores["mean"]["psnr"] + 2}
        effects = [{"name": name, "parameters": {}} for name in named]
        found = {"verdict": "explained", "captures": 8, "effects": effects, "seconds": 1.0, "cpu_seconds": 1.0}
        return {**record, "diagnosis": {"blind": found}}

    records = [
        diagnosed("drawn_01", ["mask_blur", "black_level"], mismatched=10.0, known=20.0, blind=19.0),
        diagnosed("drawn_02", ["mask_blur", "mask_contrast"], mismatched=12.0, known=22.0, blind=19.0),
        made("drawn_03", mismatched=12.0, known=22.0),
    ]
    heading, *rows = blind_table(diagnosed_blind(records))
    assert heading[1:6] == ["II", "III", "IV-blind", "III less IV-blind", "largest"]
    both = "mean of 2 drawn", "13.00", "23.00", "21.00", "2.00", "3.00", "black_level 1", "mask_contrast 1", "1"
    assert rows == [[*both]]
    for record in records:
        check("mismatch", record)
        (tmp_path / f"{record['camera']}.gap_tv.json").write_text(json.dumps(record))
    assert len(blind_mismatch(tmp_path, "").rows) == 1
    assert blind_mismatch(tmp_path / "absent", "").rows == []
    with pytest.raises(BadInput, match="this table has no parts"):
        blind_mismatch(tmp_path, "drawn")


def test_documented_table(tmp_path: Path) -> None:
    assert mismatch(tmp_path / "absent", "").rows == []
    for record in RECORDS:
        check("mismatch", record)
        (tmp_path / f"{record['camera']}.gap_tv.json").write_text(json.dumps(record))
    assert len(mismatch(tmp_path, "").rows) == 4
    assert mismatch(tmp_path, "").provenance.machine == "an abacus"
    with pytest.raises(BadInput, match="this table has no parts"):
        mismatch(tmp_path, "drawn")
    (tmp_path / "foreign.json").write_text("{}")
    with pytest.raises(BadInput, match=r"foreign\.json: .*not a record"):
        mismatch(tmp_path, "")


def test_what_fine_tuning_is_worth(tmp_path: Path) -> None:
    def trained(training: str, seed: int, **psnr: float) -> dict[str, Any]:
        settings = {"training": training, "training_seed": seed}
        return made("published", f"e2e_cnn-{training}-{seed}", settings=settings, **psnr)

    records = [
        made("published", "mean_measurement", ideal=20.0, calibrated=19.0),
        trained("ideal", 0, ideal=26.0, mismatched=15.0, calibrated=21.0),
        trained("ideal", 1, ideal=27.0, mismatched=16.0, calibrated=23.0),
        trained("finetuned", 0, calibrated=25.0),
    ]
    heading, *rows = finetuning_table(records)
    assert heading[1:3] == ["mean PSNR (dB)", "gain over the use as is (dB)"]
    assert [row[1:] for row in rows] == [
        ["26.50 ± 0.71", "", "0, 1"],
        ["15.50 ± 0.71", "", "0, 1"],
        ["22.00 ± 1.41", "+6.50", "0, 1"],
        ["25.00", "+10.00", "0"],
        ["20.00", "", ""],
        ["19.00", "", ""],
    ]
    assert finetuning(tmp_path / "absent", "").rows == []
    (tmp_path / "a.json").write_text(json.dumps(records[1]))
    assert len(finetuning(tmp_path, "").rows) == 3
    with pytest.raises(BadInput, match="this table has no parts"):
        finetuning(tmp_path, "seeds")
