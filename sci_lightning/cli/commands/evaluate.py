"""``python -m sci_lightning.evaluate``: test a trained decoder, or one that needs no training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from sci_lightning.cli.composition import Composition, built, plain
from sci_lightning.cli.settings import CommandSettings, Count, Kernels, Name, NamedOrPath, Precision
from sci_lightning.configuration.bounds import ExistingPath, Frames, Seed, Size
from sci_lightning.console import PlainConsole, styled

if TYPE_CHECKING:
    from torch.utils.data import DataLoader

    from sci_lightning.encoder import Encoder
    from sci_lightning.runs.checkpoint import Checkpoint
    from sci_lightning.training.evaluation import Evaluation


@dataclass(frozen=True)
class EvaluateSettings(CommandSettings):
    ckpt_path: ExistingPath | None
    weights: NamedOrPath | None
    captures: ExistingPath | None
    pictures: Count
    trusted: Sequence[Name]
    frames: Frames | None
    size: Size | None
    crop: Size | None
    seed: Seed | None
    tile: Any
    precision: Precision
    kernels: Kernels


def evaluate(composition: Composition) -> float:
    """Test, write ``metrics.json`` and pictures of the scenes, and print a table; returns the mean PSNR in dB.

    Args:
        composition: of ``conf/evaluate.yaml``.
    """
    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.runs.results import print_results

    console = PlainConsole()
    done = evaluation_of(composition, console)
    print_results(done.metrics, console)
    console.say(styled(done.folder), ": metrics.json" + (", pictures/" if done.pictures else ""))
    print_next(console, invocation("tables", paths={"runs": done.folder}))
    return done.metrics.mean["psnr"]


def evaluation_of(composition: Composition, console: PlainConsole) -> Evaluation:
    """Test the decoder that ``conf/evaluate.yaml`` asks for, with the encoder that it names.

    ``encoder=`` replaces the encoder of the training and ``decoder=`` takes the place of a checkpoint, see
    :mod:`sci_lightning.cli.encoder_and_decoder`. ``captures=`` tests on what a camera recorded of known scenes.
    """
    from sci_lightning.cli.encoder_and_decoder import resolve_camera, resolve_checkpoint, resolve_encoder
    from sci_lightning.runs.results import with_effects
    from sci_lightning.training.evaluation import evaluate

    cfg = composition.cfg
    checkpoint = resolve_checkpoint("evaluate", composition)
    cfg.crop = checkpoint.config["crop"] if cfg.crop is None else cfg.crop
    encoder, name = resolve_encoder(composition, checkpoint)
    camera = resolve_camera(composition, checkpoint) or encoder
    snapshots, recorded = _snapshots(composition, checkpoint, encoder, camera)
    names = {"test_encoder": recorded or name, "tested_on": recorded or with_effects(name, encoder.path.names)}
    return evaluate(checkpoint, encoder, camera, snapshots, plain(cfg), **names, say=console.print)


def _snapshots(
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
    source = built(cfg, "data")
    in_colour = encoder.sensor.pattern is not None
    if in_colour and not hasattr(source, "colour_scenes"):
        raise BadInput(
            f"encoder/sensor=bayer: data={composition.choice('data')} is gray; data=folder reads clips in colour"
        )
    try:
        return scene_loader(source.colour_scenes() if in_colour else source.scenes()), ""
    except OtherSize as error:
        raise BadInput(f"{error}; {resized(composition, checkpoint, error.size)}") from error
