"""One case: captures by the virtual camera, their diagnosis, and what became of it."""

from __future__ import annotations

import json
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from sci_lightning.captures import read_captures
from sci_lightning.diagnosis.diagnosis import Diagnosis, diagnose
from sci_lightning.diagnosis.fit.fit import Fitter
from sci_lightning.diagnosis.fit.gap import held_out_gap
from sci_lightning.diagnosis.report.report import describe
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.proving_ground.case import Case
from sci_lightning.proving_ground.memory import forget_peak, peak_mib
from sci_lightning.virtual_camera import capture_session, write_captures


def attempt(case: Case) -> dict[str, Any]:
    """Make the captures, diagnose them, and put the report beside the truth; fit for JSON.

    The diagnosis sees a captures file and nothing else. Time and memory are of the diagnosis and its report, captures
    read beforehand.
    """
    with TemporaryDirectory() as folder:
        path = Path(folder) / "captures.h5"
        hidden = capture_session(case.session, list(case.effects), case.seed, magnitude=case.magnitude)
        truth = json.loads(write_captures(path, hidden).read_text())
        captures = read_captures(path)
    forget_peak()
    start, worked = time.perf_counter(), time.process_time()
    found = diagnose(captures, vocabulary())
    report = describe(found)
    return {
        **case.describe(),
        "hidden": truth["effects"],
        "log_likelihood_gain": truth["log_likelihood_gain"],
        "verdict": report["verdict"],
        "found": report["effects"],
        "unnamed": report["unnamed"],
        "gap": report["gap"],
        "seconds": time.perf_counter() - start,
        "cpu_seconds": time.process_time() - worked,
        "memory_mib": peak_mib(),
        "true_names": true_names(found, truth["effects"]),
    }


def true_names(found: Diagnosis, hidden: list[dict[str, Any]]) -> dict[str, float] | None:
    """Where the names found are not those hidden: how a fit of the true ones, begun at the truth, compares.

    ``nats`` is how much likelier it makes the captures than what was found; ``chi2`` as in the gap. Positive nats mean
    that the search missed something better, negative ones that the captures are explained better by other names.
    None where the names are right, or where the vocabulary lacks one.
    """
    named = {each["name"]: each["parameters"] for each in hidden}
    if set(named) == set(found.names) or not all(each["in_vocabulary"] for each in hidden):
        return None
    hypothesis = found.before.fit.hypothesis
    for name, parameters in named.items():
        hypothesis = hypothesis.having(name, parameters)
    fitter = Fitter(found.model, found.split, found.settings)
    true = fitter.fit(hypothesis, iterations=30)
    return {"nats": true.total - found.after.fit.total, "chi2": held_out_gap(fitter, true, found.seed).chi2}
