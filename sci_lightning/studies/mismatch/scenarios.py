"""The scenarios of the protocol: which camera records, and which camera the decoder believes in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch

from sci_lightning.decoder.decoder import Decoder

LEAST_LOSS = 0.05
"""Decibels between II and III below which there is nothing to win back, and no recovery is stated."""


@dataclass(frozen=True)
class Scenario:
    """One scenario.

    Attributes:
        title: as tables call it.
        mismatched: whether the mismatched camera records; else the ideal one.
        noise: whether there is shot noise and read noise.
        belief: the camera that the decoder believes in: ``ideal``, ``true``, ``calibrated`` or ``blind``.
    """

    title: str
    mismatched: bool
    noise: bool
    belief: str


SCENARIOS: Mapping[str, Scenario] = {
    "ideal": Scenario("I", mismatched=False, noise=False, belief="ideal"),
    "ideal_noisy": Scenario("I with noise", mismatched=False, noise=True, belief="ideal"),
    "mismatched": Scenario("II", mismatched=True, noise=True, belief="ideal"),
    "known": Scenario("III", mismatched=True, noise=True, belief="true"),
    "calibrated": Scenario("IV-calibrated", mismatched=True, noise=True, belief="calibrated"),
    "blind": Scenario("IV-blind", mismatched=True, noise=True, belief="blind"),
}
"""Scenarios by name, in the order in which they are run and shown."""


def recovery(psnr: Mapping[str, float]) -> dict[str, float]:
    """Return (IV - II) / (III - II), the part of the loss that a diagnosis wins back, by the kind of diagnosis.

    Args:
        psnr: mean PSNR in dB by scenario. What is missing is left out; so is all of it where III is not
            :data:`LEAST_LOSS` above II.
    """
    if not {"mismatched", "known"} <= psnr.keys():
        return {}
    lost = psnr["known"] - psnr["mismatched"]
    if lost < LEAST_LOSS:
        return {}
    return {kind: (psnr[kind] - psnr["mismatched"]) / lost for kind in ("calibrated", "blind") if kind in psnr}


class MeanMeasurement(Decoder):
    """Every frame of the estimate is the measurement over the sum of the masks."""

    def decode(self, measurement: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        return self.operator(mask).mean_video(measurement)
