"""The protocol: record with a camera, decode as each scenario believes, score scene by scene."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from sci_lightning.decoder.decoder import Decoder
from sci_lightning.encoder import Encoder
from sci_lightning.metrics.frame_metric import SceneScores
from sci_lightning.metrics.psnr import PSNR
from sci_lightning.metrics.ssim import SSIM
from sci_lightning.pipeline import Pipeline
from sci_lightning.runs.provenance import installed_version
from sci_lightning.studies.mismatch.beliefs import diagnosed_camera, ideal_camera, true_camera
from sci_lightning.studies.mismatch.bench import Bench
from sci_lightning.studies.mismatch.cameras import MismatchedCamera
from sci_lightning.studies.mismatch.scenarios import SCENARIOS, Scenario, recovery

Scores = dict[str, Any]
"""``{"mean": {"psnr": dB, "ssim": .., "psnr_up_to_gain": dB}, "scenes": {"kobe": {..}, ..}}``."""


def _ignore(message: str) -> None:
    pass


@dataclass(eq=False)
class Protocol:
    """Runs cameras and decoders on one bench; what does not depend on the camera is computed once.

    Attributes:
        bench: the scenes and the datasheet.
        folder: where diagnoses are kept, in ``cameras/``.
        snapshots: how many snapshots a blind diagnosis sees at most.
        device: on which is decoded.
        on_progress: called with a one-line message after every step, to be replaced by the next one.
        on_result: called with a line that says what a scenario reached.
    """

    bench: Bench
    folder: Path
    snapshots: int
    device: torch.device = field(default_factory=lambda: torch.device("cpu"))
    on_progress: Callable[[str], None] = _ignore
    on_result: Callable[[str], None] = _ignore
    _ideal: dict[tuple[str, str], Scores] = field(default_factory=dict)

    def __getstate__(self) -> dict[str, Any]:
        """Return what travels to another process, which reports to nobody."""
        return {**self.__dict__, "on_progress": _ignore, "on_result": _ignore}

    def run(
        self,
        camera: MismatchedCamera,
        decoder: Decoder,
        name: str,
        scenarios: Sequence[str],
        earlier: Mapping[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Return the results of one camera and one decoder: what a record holds of them.

        Args:
            camera: that records.
            decoder: in evaluation mode.
            name: of the decoder; results of the ideal camera are remembered by it.
            scenarios: names in :data:`~sci_lightning.studies.mismatch.scenarios.SCENARIOS`.
            earlier: the record of an earlier run of the same, whose scenarios are not computed again.
        """
        start = time.perf_counter()
        results: dict[str, Scores] = dict((earlier or {}).get("scenarios", {}))
        diagnoses: dict[str, Any] = dict((earlier or {}).get("diagnosis", {}))
        recorded: dict[bool, np.ndarray] = {}
        for key in [key for key in SCENARIOS if key in scenarios and key not in results]:
            scenario = SCENARIOS[key]
            say = f"{camera.name}, {name}, {scenario.title}"
            if not scenario.mismatched:
                if (name, key) not in self._ideal:
                    self.on_progress(f"{say}: recording")
                    measurement = self.bench.record({}, noise=scenario.noise)
                    self._ideal[name, key] = self._decode(measurement, ideal_camera(self.bench), decoder, say)
                results[key] = self._ideal[name, key]
                self.on_result(f"{say}: {results[key]['mean']['psnr']:.2f} dB")
                continue
            if True not in recorded:
                self.on_progress(f"{say}: recording")
                recorded[True] = self.bench.record(camera.mismatch)
            believed, diagnosis = self._belief(scenario, camera, recorded[True], say)
            if diagnosis:
                diagnoses[scenario.belief] = diagnosis
            results[key] = self._decode(recorded[True], believed, decoder, say)
            self.on_result(f"{say}: {results[key]['mean']['psnr']:.2f} dB")
        ordered = {key: results[key] for key in SCENARIOS if key in results}
        content: dict[str, Any] = {"mismatch": {name: dict(values) for name, values in camera.mismatch.items()}}
        content["scenarios"] = ordered
        if parts := recovery({key: scores["mean"]["psnr"] for key, scores in ordered.items()}):
            content["recovery"] = parts
        if diagnoses:
            content["diagnosis"] = diagnoses
        seconds = time.perf_counter() - start + (earlier or {}).get("seconds", 0.0)
        return {**content, "seconds": seconds, "sci_lightning": installed_version()}

    def _belief(
        self, scenario: Scenario, camera: MismatchedCamera, measurement: np.ndarray, say: str
    ) -> tuple[Encoder, dict[str, Any]]:
        """Return the encoder that the decoder believes in, and what is recorded of its diagnosis, if there was one."""
        if scenario.belief == "ideal":
            return ideal_camera(self.bench), {}
        if scenario.belief == "true":
            return true_camera(self.bench, camera.mismatch), {}
        self.on_progress(f"{say}: diagnosis")
        kept = self.folder / "cameras"

        def on_progress(line: str) -> None:
            self.on_progress(f"{say}: {line}")

        return diagnosed_camera(self.bench, camera, scenario.belief, measurement, self.snapshots, kept, on_progress)

    @torch.no_grad()
    def _decode(self, measurement: np.ndarray, believed: Encoder, decoder: Decoder, say: str) -> Scores:
        """Decode raw DN (N, H, W) as the believed camera has it, and return the scores."""
        bench, pipeline = self.bench, Pipeline(believed, decoder)
        mask = pipeline.decoder_mask().to(self.device)
        light = torch.from_numpy(measurement.astype(np.float32)) / bench.full_scale
        pairs: list[tuple[int, torch.Tensor, torch.Tensor]] = []
        for scene, video in enumerate(bench.videos):
            for truth in video:
                self.on_progress(f"{say}: {bench.names[scene]}")
                linear = pipeline.linearise(light[len(pairs) : len(pairs) + 1], bench.aperture).to(self.device)
                pairs.append((scene, decoder(linear, mask)[0].float().cpu(), truth))
        scores = SceneScores(bench.names, {"psnr": PSNR(), "ssim": SSIM()})
        scores_up_to_gain = SceneScores(bench.names, {"psnr_up_to_gain": PSNR()})
        factor = common_factor([(estimate, truth) for _, estimate, truth in pairs])
        for scene, estimate, truth in pairs:
            scores.update(scene, estimate, truth)
            scores_up_to_gain.update(scene, factor * estimate, truth)
        (scenes, mean), (more, more_mean) = scores.compute(), scores_up_to_gain.compute()
        return {"mean": mean | more_mean, "scenes": {name: values | more[name] for name, values in scenes.items()}}


def common_factor(pairs: Sequence[tuple[torch.Tensor, torch.Tensor]]) -> float:
    """Return the one factor by which all estimates come closest to the truth, by least squares.

    A decoder that does not know the gain of its camera returns scenes that are darker or brighter by one factor, and
    snapshots of unknown scenes cannot tell that gain. What is left beyond this factor is an error of the diagnosis.

    Args:
        pairs: estimates and truths, videos of any shape.
    """
    product = sum(float((estimate.double() * truth.double()).sum()) for estimate, truth in pairs)
    power = sum(float(estimate.double().square().sum()) for estimate, _ in pairs)
    return product / power if power > 0 else 1.0
