"""What is hidden in simulated captures: the content of ``<captures>.truth.json``, format ``sci-captures-truth`` 1."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
from pydantic import model_validator

from sci_lightning.files.diagnosis_report import Value
from sci_lightning.files.json_file import JsonFile, JsonObject, says
from sci_lightning.virtual_camera.session import Session


class MapSummary(JsonObject):
    """Statistics of a fixed-pattern map."""

    shape: tuple[int, ...] = says("(H, W), or one value for each row or column")
    mean: float
    std: float
    min: float
    max: float
    nonzero: int

    @classmethod
    def of_map(cls, values: np.ndarray) -> MapSummary:
        """Return the statistics of a map."""
        return cls(
            shape=values.shape,
            mean=float(values.mean()),
            std=float(values.std()),
            min=float(values.min()),
            max=float(values.max()),
            nonzero=int(np.count_nonzero(values)),
        )


class HiddenEffect(JsonObject):
    """One effect that is hidden in the captures."""

    name: str
    stage: str = says("where it acts: capture, scene, modulator, relay, exposure, optics or sensor")
    in_vocabulary: bool = says("whether a diagnosis has a name for it")
    parameters: dict[str, Value] = says("true values by name")
    units: dict[str, str] = says("of every parameter; 1 for a ratio")
    map: MapSummary | None = says("of the camera's own map, where the effect has one", default=None)
    log_likelihood_gain: float | None = says("nats by knowing it when all others are known", default=None)

    @model_validator(mode="after")
    def _has_units(self) -> HiddenEffect:
        if self.units.keys() != self.parameters.keys():
            raise ValueError("units: expected one for every parameter")
        return self


class Noise(JsonObject):
    """The camera's true noise, which a hidden effect may have changed from the datasheet's."""

    full_well_e: float = says("electrons at full scale")
    read_noise_dn: float = says("standard deviation of the read noise, DN")


class Truth(JsonFile):
    """Everything that is hidden in simulated captures."""

    format: Literal["sci-captures-truth"] = "sci-captures-truth"
    format_version: Literal[1] = 1
    effects: tuple[HiddenEffect, ...] = says("in the order in which light meets them")
    noise: Noise
    log_likelihood_gain: float = says("nats that the captures gain by knowing all effects and their maps")
    seed: int = says("of patterns, scenes, maps and noise", ge=0)
    session: Session = says("how the captures were taken")
    also_true: tuple[str, ...] = says("names that are right though nothing of the kind was hidden", default=())
    captures: str = says("the captures file beside it", default="")

    def as_json(self) -> dict[str, Any]:
        """Return the content of the file; what is empty is absent."""
        content = super().as_json()
        return {key: value for key, value in content.items() if value or key not in ("also_true", "captures")}
