"""A trial: the virtual camera takes a case's captures, they are diagnosed, and the result is put beside the truth."""

from __future__ import annotations

import datetime
import json
import resource
import time
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import torch

from sci_lightning.captures import read_captures
from sci_lightning.diagnosis.diagnosis import Diagnosis, diagnose
from sci_lightning.diagnosis.fit.fit import Fitter
from sci_lightning.diagnosis.fit.gap import held_out_gap
from sci_lightning.diagnosis.report.report import describe
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.runs.provenance import commit, machine_name
from sci_lightning.studies.proving_ground.case import Case
from sci_lightning.virtual_camera import VirtualCamera

STATUS, RESET = Path("/proc/self/status"), Path("/proc/self/clear_refs")
"""Where Linux states the peak of the resident memory, and where it is told to begin anew."""


def run_trial(case: Case) -> dict[str, Any]:
    """Take the captures, diagnose them, and return what the record of the case says beside the case itself.

    The diagnosis sees a captures file and nothing else. Time and memory are those of the diagnosis and its report; the
    captures have been read before.
    """
    case_start = time.process_time()
    with TemporaryDirectory() as folder:
        path = Path(folder) / "captures.h5"
        camera = VirtualCamera(case.session, case.effects, magnitude=case.magnitude)
        truth = json.loads(camera.write(path, case.seed).read_text())
        captures = read_captures(path)
    reset_peak_memory()
    start, cpu_start = time.perf_counter(), time.process_time()
    diagnosis = diagnose(captures, vocabulary())
    report = describe(diagnosis)
    seconds, cpu_seconds, memory = time.perf_counter() - start, time.process_time() - cpu_start, peak_memory()
    true_names = compare_with_true_names(diagnosis, truth["effects"])
    return {
        "hidden": truth["effects"],
        "also_true": truth.get("also_true", []),
        "log_likelihood_gain": truth["log_likelihood_gain"],
        "verdict": report["verdict"],
        "found": report["laboratory"] + report["effects"],
        "not_named": report["not_named"],
        "unnamed": report["unnamed"],
        "bad_captures": [bad["capture"] for bad in report.get("bad_captures", [])],
        "gap": report["gap"],
        "verification": report["verification"],
        "seconds": seconds,
        "cpu_seconds": cpu_seconds,
        "memory_mib": memory,
        "true_names": true_names,
        "total_cpu_seconds": time.process_time() - case_start,
        "provenance": {
            "machine": machine_name(torch.get_num_threads()),
            "date": datetime.datetime.now(datetime.timezone.utc).date().isoformat(),
            "commit": commit(),
        },
    }


def compare_with_true_names(diagnosis: Diagnosis, hidden: list[dict[str, Any]]) -> dict[str, float] | None:
    """Fit the hidden effects, beginning at the truth, and compare the fit with what the diagnosis named.

    Returns:
        ``nats``, how much likelier the true names make the captures than the diagnosis does: if positive, the search
        has missed something better; if negative, other names explain the captures better. ``chi2`` on held-out pixels.
        None where the names are right, or where a hidden effect is not in the vocabulary.
    """
    true_values = {effect["name"]: effect["parameters"] for effect in hidden}
    if set(true_values) == set(diagnosis.names) or not all(effect["in_vocabulary"] for effect in hidden):
        return None
    hypothesis = diagnosis.before.fit.hypothesis
    for name, parameters in true_values.items():
        hypothesis = hypothesis.with_effect(name, parameters)
    fitter = Fitter(diagnosis.model, diagnosis.split, diagnosis.settings)
    true = fitter.fit(hypothesis, iterations=30)
    chi2 = held_out_gap(true, diagnosis.seed).chi2
    return {"nats": true.log_likelihood - diagnosis.after.fit.log_likelihood, "chi2": chi2}


def reset_peak_memory() -> None:
    """Begin a new measurement of the peak; outside Linux, the peak remains that of the whole process."""
    try:
        RESET.write_text("5")
    except OSError:
        return


def peak_memory() -> float:
    """Return the largest resident memory of this process since the last reset, MiB."""
    try:
        (line,) = (line for line in STATUS.read_text().splitlines() if line.startswith("VmHWM:"))
        return int(line.split()[1]) / 1024
    except (OSError, ValueError):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
