"""``python -m sci_lightning.evaluate``: test a trained decoder, or one that needs no training."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition, built, plain
from sci_lightning.cli.console import PlainConsole, styled


def evaluate(composition: Composition) -> float:
    """Test, write ``metrics.json`` and pictures of the scenes, and print a table; returns the mean PSNR in dB.

    ``encoder=`` replaces the encoder of the training and ``decoder=`` takes the place of a checkpoint, see
    :mod:`sci_lightning.cli.encoder_and_decoder`.
    ``captures=`` tests on what a camera recorded of known scenes instead of recording the data's scenes.
    ``decoder.camera=`` is the encoder that the decoder takes the camera for, without it the encoder itself.

    Args:
        composition: of ``conf/evaluate.yaml``.
    """
    import torch
    from torch.utils.data import DataLoader

    from sci_lightning.captures import read_captures
    from sci_lightning.cli.encoder_and_decoder import resized, resolve_camera, resolve_checkpoint, resolve_encoder
    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.data.captured import CapturedSnapshots
    from sci_lightning.data.loader import scene_loader
    from sci_lightning.decoder import kernels
    from sci_lightning.decoder.complexity import count_parameters
    from sci_lightning.decoder.iterative import Iterative
    from sci_lightning.errors import BadInput, OtherSize
    from sci_lightning.imaging.tile_choice import TileChoice
    from sci_lightning.runs.precision import describe_precision, device_of_accelerator, resolve_precision
    from sci_lightning.runs.results import print_results, run_metrics, with_effects, write_json
    from sci_lightning.training.callbacks import Progress, ScenePictures
    from sci_lightning.training.metrics import build_metrics
    from sci_lightning.training.system import System

    cfg = composition.cfg
    kernels.use(cfg.kernels)
    out = Path(cfg.out)
    checkpoint = resolve_checkpoint("evaluate", composition)
    trained = checkpoint.config
    cfg.crop = trained["crop"] if cfg.crop is None else cfg.crop
    decoder = checkpoint.decoder()
    device = device_of_accelerator(cfg.trainer.get("accelerator", "auto"))
    networks = count_parameters(decoder) > 0
    cfg.trainer.precision = resolve_precision(cfg.trainer.get("precision"), device, networks)
    if networks:
        PlainConsole().say(describe_precision(cfg.trainer.precision, device))
    encoder, test_encoder = resolve_encoder(composition, checkpoint)
    camera = resolve_camera(composition, checkpoint) or encoder
    loader: DataLoader[Any]
    if cfg.captures is None and encoder.size != tuple(cfg.size):
        height, width = encoder.size
        advice = resized(composition, checkpoint, cfg.size)
        raise BadInput(f"size={list(cfg.size)}: the mask has {height} x {width} pixels; {advice}")
    if cfg.captures is None:
        try:
            loader = scene_loader(built(cfg, "data").scenes())
        except OtherSize as error:
            raise BadInput(f"{error}; {resized(composition, checkpoint, error.size)}") from error
    else:
        captures = read_captures(cfg.captures)
        loader, test_encoder = DataLoader(CapturedSnapshots(captures, camera.mask(), camera.size)), captures.name
        cfg.data = None
    names = {**trained["names"], "test_encoder": test_encoder}

    metrics = build_metrics(plain(cfg.metrics) if cfg.get("metrics") else {}, cfg.size)
    console, progress = PlainConsole(), Progress()
    watch = None if isinstance(decoder, Iterative) else progress.show_tile
    choice = TileChoice(cfg.tile, say=console.print, watch=watch)
    system = System(encoder, decoder, camera=camera, metrics=metrics, tile=choice, seed=cfg.seed)
    tested_on = test_encoder if cfg.captures else with_effects(test_encoder, encoder.path.names)
    pictures = ScenePictures(out / "pictures", f"{names['decoder']}, tested on {tested_on}", cfg.pictures)
    trainer = built(cfg, "trainer", logger=False, enable_checkpointing=False, callbacks=[progress, pictures])
    place = torch.empty(1, device=trainer.strategy.root_device)
    with trainer.strategy.precision_plugin.test_step_context():  # what cannot be decoded is refused before it starts
        choice.tiling(decoder, place.expand(loader.batch_size or 1, *cfg.size), place.expand(cfg.frames, *cfg.size))
    trainer.test(system, loader, verbose=False)
    scores = run_metrics(system, names, {**trained, "evaluate": plain(cfg)})
    write_json(scores.to_json(), out / "metrics.json")
    print_results(scores, console)
    console.say(styled(out), ": metrics.json" + (", pictures/" if pictures.written else ""))
    decodes = {"ckpt_path": cfg.ckpt_path} if cfg.ckpt_path else {}
    own = composition.trusted() if decodes else [*composition.own_folders(), f"decoder={names['decoder']}"]
    print_next(
        console,
        invocation("tables", paths={"runs": out}),
        invocation("reconstruct", *own, "measurement=SNAPSHOT.tiff", paths=decodes),
    )
    return scores.mean["psnr"]


if __name__ == "__main__":
    run("evaluate", evaluate)
