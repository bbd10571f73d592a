"""A composed ``conf/mismatch.yaml`` as objects: the bench, the cameras, and what records say of the settings."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from sci_lightning.configuration.build import build
from sci_lightning.decoder import Decoder
from sci_lightning.errors import BadInput
from sci_lightning.runs.checkpoint import read_checkpoint
from sci_lightning.runs.device import device_name, resolve_device
from sci_lightning.runs.provenance import commit, joined, machine_name, provenance_now
from sci_lightning.studies.engine import Records
from sci_lightning.studies.mismatch.beliefs import encoder_effects
from sci_lightning.studies.mismatch.bench import Bench, prepare_bench
from sci_lightning.studies.mismatch.cameras import MismatchedCamera, plan_cameras
from sci_lightning.studies.mismatch.protocol import Protocol
from sci_lightning.studies.mismatch.records import MismatchCase, MismatchRecord

DATASHEET = ("bit_depth", "full_well_e", "read_noise_dn")
"""Settings of the camera that its datasheet states."""


@dataclass(eq=False)
class PreparedStudy:
    """Everything that a run of the protocol needs besides decoders.

    Attributes:
        bench: scenes, mask and datasheet.
        cameras: in the order in which they are run.
        scenarios: names of the scenarios.
        settings: what records say of the settings, and what their digests depend on.
        protocol: that decodes and scores.
        command: the command line that is recorded.
    """

    bench: Bench
    cameras: list[MismatchedCamera]
    scenarios: list[str]
    settings: dict[str, Any]
    protocol: Protocol
    command: str

    def case(
        self,
        camera: MismatchedCamera,
        decoder: str,
        described: Mapping[str, Any],
        scenarios: Sequence[str] | None = None,
    ) -> MismatchCase:
        """Return the case of a camera and a decoder.

        Args:
            camera: that records.
            decoder: its name.
            described: what identifies the decoder, its configuration and its weights.
            scenarios: names; None for those of the command.
        """
        wanted = tuple(self.scenarios if scenarios is None else scenarios)
        return MismatchCase(camera, decoder, wanted, self.bench.digest, {**self.settings, **described})


@dataclass(eq=False)
class Score:
    """What a case of the protocol computes, see :data:`~sci_lightning.studies.engine.this_machine.Work`.

    Attributes:
        study: with the bench.
        decoders: in evaluation mode, by their names.
        records: among them an earlier one of the case, whose scenarios are not computed again.
    """

    study: PreparedStudy
    decoders: Mapping[str, Decoder]
    records: Records[MismatchRecord]

    def __call__(self, case: MismatchCase) -> dict[str, Any]:
        study, device = self.study, self.study.protocol.device
        present = self.records.find(case)
        earlier = None if present is None else present.as_json()
        decoder = self.decoders[case.decoder].to(device)
        results = study.protocol.run(case.camera, decoder, case.decoder, case.scenarios, earlier)
        words = machine_name(1) if device.type == "cpu" and torch.get_num_threads() == 1 else device_name(device)
        height, width = study.bench.session.size
        scale = f"{height} x {width}, {sum(map(len, study.bench.videos))} snapshots of {', '.join(study.bench.names)}"
        made = provenance_now(words, scale, [study.bench.seed], study.command)
        if present is not None:  # some scenarios are taken from it
            made = joined([present.provenance, made])
        return {"provenance": made.as_json(), **results}


def prepare(settings: Mapping[str, Any], data: str, folder: str | Path, command: str) -> PreparedStudy:
    """Return what a run needs; the coding patterns are written to ``folder``, where diagnoses are kept as well.

    Args:
        settings: ``conf/mismatch.yaml``, composed, resolved and plain.
        data: what records call the source of the scenes.
        folder: of the run.
        command: the command line that is recorded.

    Raises:
        BadInput: settings that do not go together, see :func:`.plan_cameras` and :func:`.prepare_bench`.
    """
    commit()  # records state the code that began, not what the checkout holds when they are written
    folder, mask, seed = Path(folder), settings["mask"], settings["seed"]
    device = resolve_device(settings["device"])
    cameras = plan_cameras(settings["cameras"], settings["mismatch"], settings["ranges"], settings["drawn"], seed)
    datasheet = {key: settings[key] for key in DATASHEET}
    bench = prepare_bench(
        build(settings["data"], "data").scenes(),
        folder,
        mask=mask,
        middle=settings["middle"],
        datasheet=datasheet,
        calibration=settings["calibration"],
        aperture=settings["aperture"],
        seed=seed,
    )
    for camera in cameras:  # what cannot be recorded or believed is refused before anything is written
        bench.effects(camera.mismatch)
        if "known" in settings["scenarios"]:
            encoder_effects(camera.mismatch)
    bench.write_patterns()
    kept: dict[str, Any] = {
        "data": data,
        "mask": "random binary" if mask is None else Path(mask).name,
        "size": list(bench.session.size),
        "aperture": bench.aperture,
        **datasheet,
        **{key: settings[key] for key in ("frames", "seed", "calibration", "snapshots")},
    }
    protocol = Protocol(bench, folder, settings["snapshots"], device)
    return PreparedStudy(bench, cameras, list(settings["scenarios"]), kept, protocol, command)


def trained_decoder(
    path: str | Path, name: str, trusted: tuple[str, ...] = (), configured: Mapping[str, Any] | None = None
) -> tuple[Decoder, dict[str, Any]]:
    """Return the decoder of a checkpoint, and what identifies it.

    Args:
        path: of the checkpoint.
        name: that the decoder must have.
        configured: the decoder's plain configuration, which is then filled from the checkpoint; None: as it was
            trained.
        trusted: packages beside this one whose modules the checkpoint may name.

    Raises:
        BadInput: the checkpoint cannot be read, or is of another decoder.
    """
    path = Path(path)
    checkpoint = read_checkpoint(path, trusted)
    if (trained := checkpoint.config["names"]["decoder"]) != name:
        raise BadInput(f"weights.{name}={path}: a checkpoint of decoder={trained}; give one of decoder={name}")
    digest = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    if configured is None:
        return checkpoint.decoder(), {"decoder": checkpoint.config["decoder"], "weights": digest}
    decoder: Decoder = build(configured, "decoder")
    checkpoint.fill("decoder", decoder, name)
    return decoder.eval(), {"decoder": configured, "weights": digest}
