"""A decoder tested as ``conf/evaluate.yaml`` says: what the command ``evaluate`` and ``sci.evaluate`` share."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sci_lightning.cli.composition import Composition, built, plain
from sci_lightning.console import PlainConsole

if TYPE_CHECKING:
    from torch.utils.data import DataLoader

    from sci_lightning.encoder import Encoder
    from sci_lightning.runs.checkpoint import Checkpoint
    from sci_lightning.runs.results import RunMetrics


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


def evaluate(composition: Composition, console: PlainConsole) -> Evaluation:
    """Test a decoder, and write ``metrics.json`` and pictures of the scenes into the folder ``out``.

    ``encoder=`` replaces the encoder of the training and ``decoder=`` takes the place of a checkpoint, see
    :mod:`sci_lightning.cli.encoder_and_decoder`.
    ``captures=`` tests on what a camera recorded of known scenes instead of recording the data's scenes.
    ``decoder.camera=`` is the encoder that the decoder takes the camera for, without it the encoder itself.

    Args:
        composition: of ``conf/evaluate.yaml``.
        console: says in which precision networks are computed, and how a large field is divided.
    """
    import torch

    from sci_lightning.cli.encoder_and_decoder import resolve_camera, resolve_checkpoint, resolve_encoder
    from sci_lightning.decoder.complexity import count_parameters
    from sci_lightning.decoder.layers import kernels
    from sci_lightning.decoder.tiling.tile_choice import TileChoice
    from sci_lightning.files.json_file import write_json
    from sci_lightning.runs.precision import describe_precision, device_of_accelerator, resolve_precision
    from sci_lightning.runs.results import with_effects
    from sci_lightning.training.callbacks import Progress, ScenePictures
    from sci_lightning.training.run import run_metrics
    from sci_lightning.training.scoring import build_metrics
    from sci_lightning.training.system import System

    cfg = composition.cfg
    out = Path(cfg.out)
    checkpoint = resolve_checkpoint("evaluate", composition)
    trained = checkpoint.config
    cfg.crop = trained["crop"] if cfg.crop is None else cfg.crop
    decoder = checkpoint.decoder()
    kernels.use(decoder, cfg.kernels)
    device = device_of_accelerator(cfg.trainer.get("accelerator", "auto"))
    networks = count_parameters(decoder) > 0
    cfg.trainer.precision = resolve_precision(cfg.trainer.get("precision"), device, networks)
    if networks:
        console.say(describe_precision(cfg.trainer.precision, device))
    encoder, test_encoder = resolve_encoder(composition, checkpoint)
    camera = resolve_camera(composition, checkpoint) or encoder
    loader, camera_name = _loader(composition, checkpoint, encoder, camera)
    names = {**trained["names"], "test_encoder": camera_name or test_encoder}

    metrics = build_metrics(plain(cfg.metrics) if cfg.get("metrics") else {}, cfg.size)
    progress = Progress()
    watch = None if decoder.global_steps else progress.show_tile
    choice = TileChoice(cfg.tile, say=console.print, watch=watch)
    system = System(encoder, decoder, camera=camera, metrics=metrics, tile=choice, seed=cfg.seed)
    tested_on = camera_name or with_effects(test_encoder, encoder.path.names)
    pictures = ScenePictures(out / "pictures", f"{names['decoder']}, tested on {tested_on}", cfg.pictures)
    trainer = built(cfg, "trainer", logger=False, enable_checkpointing=False, callbacks=[progress, pictures])
    place = torch.empty(1, device=trainer.strategy.root_device)
    with trainer.strategy.precision_plugin.test_step_context():  # what cannot be decoded is refused before it starts
        choice.tiling(decoder, place.expand(loader.batch_size or 1, *cfg.size), place.expand(cfg.frames, *cfg.size))
    trainer.test(system, loader, verbose=False)
    scores = run_metrics(system, names, {**trained, "evaluate": plain(cfg)})
    write_json(scores.as_json(), out / "metrics.json")
    return Evaluation(out, scores, tuple(pictures.written.values()))


def _loader(
    composition: Composition, checkpoint: Checkpoint, encoder: Encoder, camera: Encoder
) -> tuple[DataLoader[Any], str]:
    """Return the snapshots to test on, and what the captures call their camera; empty where they are simulated.

    Raises:
        BadInput: scenes or captures that do not fit the mask.
    """
    from torch.utils.data import DataLoader

    from sci_lightning.captures import read_captures
    from sci_lightning.cli.encoder_and_decoder import resized
    from sci_lightning.data.captured import CapturedSnapshots
    from sci_lightning.data.loader import scene_loader
    from sci_lightning.errors import BadInput, OtherSize

    cfg = composition.cfg
    if cfg.captures is not None:
        captures = read_captures(cfg.captures)
        cfg.data = None
        return DataLoader(CapturedSnapshots(captures, camera.mask(), camera.size)), captures.name
    if encoder.size != tuple(cfg.size):
        height, width = encoder.size
        advice = resized(composition, checkpoint, cfg.size)
        raise BadInput(f"size={list(cfg.size)}: the mask has {height} x {width} pixels; {advice}")
    try:
        return scene_loader(built(cfg, "data").scenes()), ""
    except OtherSize as error:
        raise BadInput(f"{error}; {resized(composition, checkpoint, error.size)}") from error
