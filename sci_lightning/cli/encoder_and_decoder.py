"""What evaluate and reconstruct work with: a decoder, the encoder in front of it, and the camera it assumes."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from omegaconf import DictConfig, OmegaConf
from torch import nn

from sci_lightning.cli.composition import Composition, built, compose, group_members, plain
from sci_lightning.configuration.build import build
from sci_lightning.decoder.complexity import count_parameters
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.encoder import check_recording
from sci_lightning.errors import BadInput
from sci_lightning.plain_text import with_article
from sci_lightning.runs.checkpoint import Checkpoint, read_checkpoint
from sci_lightning.weights import ANY_MASK, shipped, weights_file

MASK_SHAPE = ("tile", "bits", "repeat")
"""Settings of a mask on which the shape of what was trained depends."""
UNTRAINED = {"frames": 8, "size": [256, 256], "seed": 0}
"""What ``frames``, ``size`` and ``seed`` are where no training tells."""


def resolve_checkpoint(command: str, composition: Composition) -> Checkpoint:
    """Return the checkpoint of ``ckpt_path=`` or ``weights=``, or one made of ``decoder=``, which has nothing to learn.

    With both, the decoder is as ``decoder=`` says and filled from the checkpoint. Weights that come along are those of
    the decoder of their name. Without a checkpoint the encoder is the one that ``encoder=`` names, else ``rbw_osr``.

    Args:
        command: whose configuration it is.
        composition: without a checkpoint, ``frames``, ``size`` and ``seed`` that are None are filled in.

    Raises:
        BadInput: neither, a checkpoint that cannot be read or does not fit, or a decoder that has to be trained first.
    """
    cfg, name = composition.cfg, composition.choice("decoder")
    settings = cfg.get("decoder")
    if (path := _checkpoint_path(cfg, name)) is not None:
        checkpoint = read_checkpoint(path, cfg.trusted)
        if settings is None:
            return checkpoint
        if "_target_" not in settings:
            trained = checkpoint.config["names"]["decoder"]
            raise BadInput(
                f"decoder.* beside ckpt_path= needs a decoder as well, built as it was trained: decoder={trained}"
            )
        asked = cfg.copy()
        asked.frames = asked.frames or checkpoint.config.get("frames")
        checkpoint.fill("decoder", built(asked, "decoder"), name)  # refused while both names are known
        names = {**checkpoint.config["names"], "decoder": name}
        return replace(checkpoint, config={**checkpoint.config, "decoder": plain(settings), "names": names})
    if settings is None:
        raise BadInput("give ckpt_path=RUN/checkpoints/last.ckpt, or a decoder that needs no training: decoder=gap_tv")
    return _untrained(command, composition)


def _checkpoint_path(cfg: DictConfig, decoder: str) -> Path | None:
    """Return the checkpoint that is asked for by its path, by a name or by that of its decoder; None for none."""
    if (named := cfg.get("weights")) is not None:
        if cfg.ckpt_path is not None:
            raise BadInput(f"weights={named} and ckpt_path={cfg.ckpt_path}: give one of them")
        return weights_file(named)
    if cfg.ckpt_path is not None:
        return Path(cfg.ckpt_path)
    return weights_file(decoder) if decoder in shipped() else None


def _untrained(command: str, composition: Composition) -> Checkpoint:
    """Return a checkpoint of the decoder ``decoder=``, which has nothing to learn, and of the encoder ``encoder=``."""
    cfg, name = composition.cfg, composition.choice("decoder")
    for key, value in UNTRAINED.items():
        cfg[key] = value if cfg[key] is None else cfg[key]
    decoder = built(cfg, "decoder")
    if parameters := count_parameters(decoder):
        raise BadInput(f"decoder={name} has {parameters:,} parameters to learn: train it first, and give ckpt_path=")
    named = "_target_" in (cfg.get("encoder") or {})
    numbers = plain(OmegaConf.masked_copy(cfg, list(UNTRAINED)))  # of all of it data.root may be missing: captures=
    if named:
        encoder = plain(cfg.encoder)
    else:
        words = [f"{key}={value}".replace(" ", "") for key, value in numbers.items()]
        encoder = plain(compose(command, ["encoder=rbw_osr", *words]).cfg.encoder)
    config = {
        "encoder": encoder,
        "decoder": plain(cfg.decoder),
        **numbers,
        "crop": numbers["size"],
        "names": {"encoder": composition.choice("encoder") if named else "rbw_osr", "decoder": name},
    }
    modules = nn.ModuleDict({"encoder": build(encoder, "encoder"), "decoder": decoder})
    return Checkpoint(Path(f"decoder={name}"), config, modules.state_dict(), tuple(cfg.trusted))


def resolve_encoder(composition: Composition, checkpoint: Checkpoint) -> tuple[Encoder, str]:
    """Return the encoder of the training, or the one that ``encoder=`` names, and its name.

    A mask of the same kind keeps the trained values unless it is read from a file, so that ``encoder=rbw_sr`` after
    training on ``rbw_osr`` changes the sensor and nothing else.

    Args:
        composition: ``frames``, ``size`` and ``seed`` that are None are taken from the training.
        checkpoint: of the training.

    Raises:
        BadInput: what is named is not an encoder, or does not fit.
    """
    cfg, trained = composition.cfg, checkpoint.config
    for key in ("frames", "size", "seed"):
        cfg[key] = trained[key] if cfg[key] is None else cfg[key]
    if cfg.get("encoder") is None:
        return checkpoint.encoder(), trained["names"]["encoder"]
    if "_target_" not in cfg.encoder:
        raise BadInput(
            f"effects and encoder.* settings need an encoder that is named: encoder={trained['names']['encoder']}"
        )
    name = composition.choice("encoder")
    return _built_encoder(cfg.encoder, f"encoder={name}", checkpoint), name


def resolve_camera(composition: Composition, checkpoint: Checkpoint) -> Encoder | None:
    """Return the encoder that ``decoder.camera=`` names: the decoder gets its effective mask, its effects are undone.

    Args:
        composition: as :func:`resolve_encoder` left it.
        checkpoint: of the training.

    Returns:
        None where it names none: the encoder itself.

    Raises:
        BadInput: what is named is not an encoder, or does not fit.
    """
    cfg = composition.cfg
    if cfg.get("camera") is None:
        return None
    return _built_encoder(cfg.camera, f"decoder.camera={composition.choice('encoder@camera')}", checkpoint)


def resized(composition: Composition, checkpoint: Checkpoint, size: Sequence[int]) -> str:
    """Say which overrides test a checkpoint on scenes of another size (height, width), ready to paste.

    An encoder that the user names with a mask of another kind takes any size. The trained mask is repeated if it can be
    tiled; in the place of another one comes a random one.
    """
    config = checkpoint.config
    name, mask, (height, width) = config["names"]["encoder"], config["encoder"].get("mask") or {}, size
    words = [f"size=[{height},{width}]"]
    given = (composition.cfg.get("encoder") or {}).get("mask") or {}
    if given.get("_target_") not in (None, mask.get("_target_")) and given.get("file") is None:
        return f"add '{words[0]}'"
    if "tile" not in mask or name not in group_members("encoder"):
        return f"to test with a random mask add '{words[0]}' encoder=rbw_sr"
    tile = mask["tile"] or config["size"]
    words += [f"encoder={name}", f"encoder.mask.tile=[{tile[0]},{tile[1]}]"]
    words += [f"encoder.mask.bits={mask['bits']}"] if "bits" in mask else []
    words += [f"encoder.mask.repeat={mask['repeat']}"] if mask.get("repeat", 1) != 1 else []
    return f"to test with the trained mask, repeated, add {shlex.join(words)}"


def _built_encoder(settings: DictConfig, named: str, checkpoint: Checkpoint) -> Encoder:
    encoder = build(plain(settings), named)
    if not isinstance(encoder, Encoder):
        raise BadInput(f"{named}: its _target_ is {with_article(type(encoder).__name__)}, not an Encoder")
    mask, trained = settings.mask, checkpoint.config["encoder"].get("mask")
    alike = isinstance(trained, Mapping) and mask._target_ == trained.get("_target_")
    alike = alike and checkpoint.config["names"]["encoder"] != ANY_MASK
    if alike and mask.get("file") is None:
        own = {key: trained.get(key) for key in MASK_SHAPE if mask.get(key) != trained.get(key)}
        try:
            checkpoint.fill("encoder.mask", encoder.mask)
        except BadInput as error:
            words = shlex.join(
                f"encoder.mask.{key}={'null' if value is None else value}".replace(", ", ",")
                for key, value in own.items()
            )
            raise BadInput(f"{error}: {words}" if own else str(error)) from error
    check_recording(encoder, named)
    return encoder
