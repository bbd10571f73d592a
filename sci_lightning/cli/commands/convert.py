"""``python -m sci_lightning.convert``: published weights into a checkpoint, or a checkpoint into safetensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from omegaconf import open_dict

from sci_lightning.cli.composition import Composition, built, compose, plain
from sci_lightning.cli.settings import CommandSettings
from sci_lightning.configuration.bounds import ExistingPath, Frames, Seed, Size
from sci_lightning.console import PlainConsole, styled
from sci_lightning.errors import BadInput


@dataclass(frozen=True)
class ConvertSettings(CommandSettings):
    checkpoint: ExistingPath
    frames: Frames | None
    size: Size | None
    seed: Seed


def convert(composition: Composition) -> None:
    """Write a file of weights that ``ckpt_path=`` of evaluate, reconstruct and train takes."""
    from sci_lightning.cli.next_command import invocation, print_next
    from sci_lightning.runs.checkpoint import load_file, read_checkpoint, write_weights

    cfg = composition.cfg
    path, console = Path(cfg.checkpoint), PlainConsole()
    content = load_file(path)
    ours = "config" in content
    if ours and "decoder" in cfg:
        raise BadInput(f"{path}: a checkpoint of sci_lightning knows its own network; leave decoder= out")
    if not ours and "decoder" not in cfg:
        raise BadInput(
            f"{path}: no checkpoint of sci_lightning; if a network's authors wrote it, name it: decoder=NAME"
        )
    if ours:
        checkpoint = read_checkpoint(path)
        config, state = checkpoint.config, checkpoint.state
    else:
        try:
            config, state = published(composition, content, console)
        except BadInput as error:
            raise BadInput(f"{path}: {error}") from error
    write_weights(cfg.out, config, state)
    names = config["names"]
    console.say(styled(cfg.out), f": {len(state)} tensors of decoder={names['decoder']} encoder={names['encoder']}")
    print_next(
        console,
        invocation("evaluate", "data=synthetic", paths={"ckpt_path": cfg.out}),
        invocation("reconstruct", "measurement=SNAPSHOT.tiff", paths={"ckpt_path": cfg.out}),
    )


def published(
    composition: Composition, content: Mapping[str, Any], console: PlainConsole
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return configuration and state of a checkpoint, made of what a network's authors saved.

    A mask in the file takes the place of the encoder's. ``frames``, ``size`` and ``encoder`` are set where absent.
    """
    from torch import nn

    from sci_lightning.encoder.mask import LearnedStructural, published_mask
    from sci_lightning.weights.published import load_published, unpack

    cfg = composition.cfg
    _, unpacked = unpack(content)
    shape = (8, 256, 256) if unpacked is None else unpacked.levels.shape
    cfg.frames = cfg.frames or (shape[0] if len(shape) == 3 else 8)
    cfg.size = cfg.size or list(shape[-2:])
    decoder = built(cfg, "decoder")
    load_published(decoder, content)

    mask = None if unpacked is None else published_mask(unpacked.levels, unpacked.real, cfg.frames, tuple(cfg.size))
    names = {group: composition.choice(group) for group in ("encoder", "decoder")}
    if "encoder" not in cfg:
        names["encoder"] = "rbw_osr" if mask is None else "lsw_sr" if mask().sum(0).eq(1).all() else "rbw_sr"
        origin = "no mask in the file, a random one takes its place" if mask is None else f"the file's mask, {mask}"
        console.print(f"encoder={names['encoder']}: {origin}")
        with open_dict(cfg):
            cfg.encoder = compose("convert", [f"encoder={names['encoder']}"]).cfg.encoder
    if mask is not None:
        target = f"{type(mask).__module__}.{type(mask).__name__}"
        own = {"bits": mask.bits} if isinstance(mask, LearnedStructural) else {"file": None}
        cfg.encoder.mask = {"_target_": target, "frames": mask.frames, "size": list(mask.size), **own}
    encoder = built(cfg, "encoder")
    if mask is not None:
        encoder.mask.load_state_dict(mask.state_dict())
    config = plain(cfg)
    kept = {key: config[key] for key in ("encoder", "decoder", "frames", "size", "seed")}
    state = nn.ModuleDict({"encoder": encoder, "decoder": decoder}).state_dict()
    return {**kept, "crop": config["size"], "names": names, "converted": Path(cfg.checkpoint).name}, state
