"""Design, train and trust a video snapshot compressive imaging camera.

Everything that a notebook needs is an attribute of this package, loaded when it is first used:

>>> import torch
>>> import sci_lightning as sci
>>> mask = sci.masks.RandomBinary(frames=8, size=(32, 32), seed=0)
>>> encoder = sci.Encoder(mask, sci.sensors.ClipQuantise(bit_depth=8))
>>> video = torch.rand(1, 8, 32, 32)  # (N, T, H, W); 1.0 fills the sensor's range when fully transmitted
>>> measurement = encoder(video)  # (N, H, W), in [0, 1] of full scale
>>> decoder = sci.load_decoder("gap_tv", ["decoder.iterations=[4]"])
>>> estimate = decoder(measurement, encoder.transmittance())
>>> tuple(estimate.shape)
(1, 8, 32, 32)

The modules behind it are ordinary ones and may be imported directly as well; the commands are
``python -m sci_lightning``.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:  # what type checkers and editors see; at run time PUBLIC_NAMES says where a name is found
    from sci_lightning import data, metrics
    from sci_lightning import decoder as decoders
    from sci_lightning.captures import read_captures
    from sci_lightning.captures.pack import pack_captures
    from sci_lightning.cli.notebook import command, design_mask, evaluate, load_decoder, tables, train
    from sci_lightning.data.video import load_video
    from sci_lightning.diagnosis import Diagnosis, SearchSettings, diagnose
    from sci_lightning.encoder import Encoder, effects
    from sci_lightning.encoder import mask as masks
    from sci_lightning.encoder import sensor as sensors
    from sci_lightning.errors import BadInput
    from sci_lightning.figures.figure import plot
    from sci_lightning.measurement import Measurement
    from sci_lightning.metrics import HDRVDP2
    from sci_lightning.operator import SnapshotOperator
    from sci_lightning.pipeline import Pipeline
    from sci_lightning.runs.checkpoint import Checkpoint
    from sci_lightning.runs.checkpoint import read_checkpoint as load_checkpoint
    from sci_lightning.runs.reconstruction import Reconstruction, reconstruct
    from sci_lightning.training.run import Run
    from sci_lightning.virtual_camera import Session, VirtualCamera
    from sci_lightning.weights import load_weights

    __version__: str

PUBLIC_NAMES = {
    "BadInput": "errors:BadInput",
    "Checkpoint": "runs.checkpoint:Checkpoint",
    "Diagnosis": "diagnosis:Diagnosis",
    "Encoder": "encoder:Encoder",
    "HDRVDP2": "metrics:HDRVDP2",
    "Measurement": "measurement:Measurement",
    "Pipeline": "pipeline:Pipeline",
    "Reconstruction": "runs.reconstruction:Reconstruction",
    "Run": "training.run:Run",
    "Session": "virtual_camera:Session",
    "SearchSettings": "diagnosis:SearchSettings",
    "SnapshotOperator": "operator:SnapshotOperator",
    "VirtualCamera": "virtual_camera:VirtualCamera",
    "command": "cli.notebook:command",
    "data": "data",
    "decoders": "decoder",
    "design_mask": "cli.notebook:design_mask",
    "diagnose": "diagnosis:diagnose",
    "effects": "encoder.effects",
    "evaluate": "cli.notebook:evaluate",
    "load_checkpoint": "runs.checkpoint:read_checkpoint",
    "load_decoder": "cli.notebook:load_decoder",
    "load_video": "data.video:load_video",
    "load_weights": "weights:load_weights",
    "masks": "encoder.mask",
    "metrics": "metrics",
    "pack_captures": "captures.pack:pack_captures",
    "plot": "figures.figure:plot",
    "read_captures": "captures:read_captures",
    "reconstruct": "runs.reconstruction:reconstruct",
    "sensors": "encoder.sensor",
    "tables": "cli.notebook:tables",
    "train": "cli.notebook:train",
}
"""Where each public name is found: a module of this package, and after the colon a member of it."""

__all__ = [
    "HDRVDP2",
    "BadInput",
    "Checkpoint",
    "Diagnosis",
    "Encoder",
    "Measurement",
    "Pipeline",
    "Reconstruction",
    "Run",
    "SearchSettings",
    "Session",
    "SnapshotOperator",
    "VirtualCamera",
    "__version__",
    "command",
    "data",
    "decoders",
    "design_mask",
    "diagnose",
    "effects",
    "evaluate",
    "load_checkpoint",
    "load_decoder",
    "load_video",
    "load_weights",
    "masks",
    "metrics",
    "pack_captures",
    "plot",
    "read_captures",
    "reconstruct",
    "sensors",
    "tables",
    "train",
]


if not TYPE_CHECKING:  # a type checker would take every name for one that exists

    def __getattr__(name: str) -> Any:
        """Load a public name when it is first used (PEP 562), so that importing the package loads no torch."""
        if name == "__version__":
            return import_module(f"{__name__}.runs.provenance").installed_version()
        if name not in PUBLIC_NAMES:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        module, _, member = PUBLIC_NAMES[name].partition(":")
        value = import_module(f"{__name__}.{module}")
        value = getattr(value, member) if member else value
        globals()[name] = value
        return value

    def __dir__() -> list[str]:
        """List the public names, loaded or not."""
        return sorted({*globals(), *__all__})
