"""One case from its captures to its record."""

from __future__ import annotations

from typing import Any

import pytest

from sci_lightning.diagnosis.diagnosis import Diagnosis, diagnose
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.studies.proving_ground import trial
from sci_lightning.studies.proving_ground.case import Case
from sci_lightning.studies.proving_ground.outcome import Outcome
from sci_lightning.virtual_camera import Session
from tests.files.formats import check

NAMES = ("gain", "black_level", "shot_noise", "read_noise")


def test_a_case_and_its_record(monkeypatch: pytest.MonkeyPatch) -> None:
    diagnoses: list[Diagnosis] = []

    def diagnose_with_few(captures: Any, effects: Any) -> Diagnosis:
        few = {name: effects[name] for name in NAMES}
        diagnoses.append(diagnose(captures, few, settings=SearchSettings(verification_one_in=0)))  # 14 captures only
        return diagnoses[-1]

    monkeypatch.setattr(trial, "diagnose", diagnose_with_few)
    case = Case("single", ("gain",), "full", Session(size=(16, 16), frames=2, surround="dark"))
    record = {**case.describe(), **trial.run_trial(case)}
    check("proving_ground_case", record)
    assert record["case"] == "single-gain-structural-8bit-16x16-2slots-full-0" and record["digest"] == case.digest
    assert record["verdict"] == "explained" and record["true_names"] is None
    ((hidden,), (result,)) = record["hidden"], record["found"]
    assert hidden["log_likelihood_gain"] == pytest.approx(record["log_likelihood_gain"]) and hidden["name"] == "gain"
    value = result["parameters"]["factor"]
    assert abs(value["value"] - hidden["parameters"]["factor"]) < 5 * value["std"]
    assert record["gap"]["after"]["chi2"] < record["gap"]["before"]["chi2"]
    assert record["cpu_seconds"] > 0 and record["seconds"] > 0 and record["memory_mib"] > 50
    assert Outcome.model_validate(record).right

    (diagnosis,) = diagnoses
    other = {"name": "black_level", "parameters": {"offset": 0.02}, "in_vocabulary": True}
    compared = trial.compare_with_true_names(diagnosis, [other])
    assert compared and compared["nats"] < -30 and compared["chi2"] > record["gap"]["after"]["chi2"]
    assert trial.compare_with_true_names(diagnosis, [other | {"in_vocabulary": False}]) is None
    assert set(NAMES) < set(vocabulary())


def test_peak_memory_begins_anew() -> None:
    block = bytearray(64 * 2**20)
    with_block = trial.peak_memory()
    del block
    trial.reset_peak_memory()
    assert 10 < trial.peak_memory() <= with_block
