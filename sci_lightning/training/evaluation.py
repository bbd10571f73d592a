"""A decoder tested on snapshots: what the command ``evaluate`` and ``sci.evaluate`` share."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from lightning.pytorch.utilities.exceptions import SIGTERMException
from torch.utils.data import DataLoader

from sci_lightning.configuration.build import build
from sci_lightning.decoder.complexity import count_parameters
from sci_lightning.decoder.layers import kernels
from sci_lightning.decoder.tiling.tile_choice import TileChoice
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.sensor.bayer import demosaicing, sub_lattices
from sci_lightning.files.json_file import write_json
from sci_lightning.metrics.colour import in_colour
from sci_lightning.runs.checkpoint import Checkpoint
from sci_lightning.runs.precision import describe_precision, device_of_accelerator, resolve_precision
from sci_lightning.runs.results import RunMetrics
from sci_lightning.training.callbacks import Progress, ScenePictures
from sci_lightning.training.run import run_metrics
from sci_lightning.training.scored_pipeline import ScoredPipeline
from sci_lightning.training.scoring import build_metrics


@dataclass(frozen=True)
class Evaluation:
    """What a test of a decoder left behind.

    Attributes:
        folder: with ``metrics.json`` and ``pictures/``.
        metrics: PSNR in dB, SSIM and the like, by scene and their means.
        pictures: of the first snapshot of every scene: measurement, frames, reconstruction, error.
    """

    folder: Path
    metrics: RunMetrics
    pictures: tuple[Path, ...]


def evaluate(
    checkpoint: Checkpoint,
    encoder: Encoder,
    camera: Encoder,
    snapshots: DataLoader[Any],
    settings: Mapping[str, Any],
    *,
    test_encoder: str,
    tested_on: str,
    say: Callable[[str], None] = print,
) -> Evaluation:
    """Test a decoder, and write ``metrics.json`` and pictures of the scenes into the folder ``out``.

    Args:
        checkpoint: has the decoder, and what is known of its training.
        encoder: records the scenes.
        camera: the encoder that the decoder takes the camera for.
        snapshots: batches of scenes (N, T, H, W), or of what a camera recorded of known scenes.
        settings: ``conf/evaluate.yaml``, composed, resolved and plain.
        test_encoder: what ``metrics.json`` calls the camera.
        tested_on: what pictures call it.
        say: called with lines that say in which precision networks are computed, and how a large field is divided.

    Raises:
        BadInput: a field that cannot be decoded in the memory that is free.
        KeyboardInterrupt: asked to end, by Ctrl-C or SIGTERM.
    """
    out, size = Path(settings["out"]), settings["size"]
    decoder = checkpoint.decoder()
    kernels.use(decoder, settings["kernels"])
    device = device_of_accelerator(settings["trainer"].get("accelerator", "auto"))
    networks = count_parameters(decoder) > 0
    precision = resolve_precision(settings["trainer"].get("precision"), device, networks)
    settings = {**settings, "trainer": {**settings["trainer"], "precision": precision}}
    if networks:
        say(describe_precision(precision, device))
    names = {**checkpoint.config["names"], "test_encoder": test_encoder}

    progress = Progress()
    watch = None if decoder.global_steps else progress.show_tile
    choice = TileChoice(settings["tile"], say=say, watch=watch)
    metrics = build_metrics(settings.get("metrics") or {}, size)
    in_mosaic = encoder.sensor.pattern is not None
    if in_mosaic:
        demosaicing()  # refused before anything is decoded
        metrics = in_colour(metrics)
    tested = ScoredPipeline(encoder, decoder, camera=camera, metrics=metrics, tile=choice, seed=settings["seed"])
    pictures = ScenePictures(out / "pictures", f"{names['decoder']}, tested on {tested_on}", settings["pictures"])
    callbacks = [progress, pictures]
    trainer = build(settings["trainer"], "trainer", logger=False, enable_checkpointing=False, callbacks=callbacks)
    number = torch.empty(1, device=trainer.strategy.root_device)
    with trainer.strategy.precision_plugin.test_step_context():  # what cannot be decoded is refused before it starts
        snapshot, mask = (number.expand(count, *size) for count in (snapshots.batch_size or 1, settings["frames"]))
        if in_mosaic:
            snapshot, mask = sub_lattices(snapshot)[0], sub_lattices(mask)[0]
        choice.tiling(decoder, snapshot, mask)
    try:
        trainer.test(tested, snapshots, verbose=False)
    except SIGTERMException as stop:  # an exit without a status, which would read as success
        raise KeyboardInterrupt from stop
    scores = run_metrics(tested, names, {**checkpoint.config, "evaluate": settings})
    write_json(scores.as_json(), out / "metrics.json")
    return Evaluation(out, scores, tuple(pictures.written.values()))
