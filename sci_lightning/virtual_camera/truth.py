"""What is hidden in simulated captures: the content of ``<captures>.truth.json``, format ``sci-captures-truth`` 1."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from sci_lightning.virtual_camera.hardware.parameter import Value
from sci_lightning.virtual_camera.session import Session

FORMAT, FORMAT_VERSION = "sci-captures-truth", 1


@dataclass(frozen=True)
class MapSummary:
    """Statistics of a fixed-pattern map."""

    shape: tuple[int, ...]
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


@dataclass(frozen=True)
class HiddenEffect:
    """One effect that is hidden in the captures.

    Attributes:
        name: of the effect.
        stage: where it acts on the light.
        in_vocabulary: whether a diagnosis has a name for it.
        parameters: the true value of every parameter.
        units: the unit of every parameter.
        map: statistics of the camera's own map, None for an effect without one.
        log_likelihood_gain: nats that the captures gain by knowing this effect when all others are known; None where a
            file does not state it.
    """

    name: str
    stage: str
    in_vocabulary: bool
    parameters: Mapping[str, Value]
    units: Mapping[str, str]
    map: MapSummary | None = None
    log_likelihood_gain: float | None = None


@dataclass(frozen=True)
class Noise:
    """The camera's true noise: electrons at full scale, and standard deviation of the read noise in DN."""

    full_well_e: float
    read_noise_dn: float


@dataclass(frozen=True)
class Truth:
    """Everything that is hidden in simulated captures.

    Attributes:
        effects: in the order in which light meets them.
        noise: the camera's true noise, which a hidden effect may have changed from the datasheet's.
        log_likelihood_gain: nats that the captures gain by knowing all effects and their maps.
        seed: of patterns, scenes, maps and noise.
        session: how the captures were taken.
        also_true: names that a diagnosis may rightly give though nothing of the kind was hidden, see
            :attr:`.Session.also_true`.
    """

    effects: tuple[HiddenEffect, ...]
    noise: Noise
    log_likelihood_gain: float
    seed: int
    session: Session
    also_true: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Return the content of the truth file."""
        effects = [
            {key: value for key, value in asdict(effect).items() if value is not None} for effect in self.effects
        ]
        content = {"format": FORMAT, "format_version": FORMAT_VERSION, **asdict(self), "effects": effects}
        return content if self.also_true else {key: value for key, value in content.items() if key != "also_true"}
