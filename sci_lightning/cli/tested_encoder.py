"""The encoder that a trained decoder is tested or used with, and the camera that it takes it for."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from omegaconf import DictConfig

from sci_lightning.cli.command import chosen, plain
from sci_lightning.configuration.build import build
from sci_lightning.configuration.conf_folder import CONF
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.trial import check_recording
from sci_lightning.errors import BadInput
from sci_lightning.files.plain_text import with_article
from sci_lightning.runs.checkpoint import Checkpoint


def chosen_encoder(cfg: DictConfig, checkpoint: Checkpoint) -> tuple[Encoder, str]:
    """The encoder of the training, or the one that ``encoder=`` names, and its name.

    A mask of the same kind keeps the trained values unless it is read from a file, so that ``encoder=rbw_sr`` after
    training on ``rbw_osr`` changes the sensor and nothing else.

    Args:
        cfg: of the command; ``frames``, ``size`` and ``seed`` that are None are taken from the training.
        checkpoint: of the training.

    Raises:
        BadInput: what is named is not an encoder, or does not fit.
    """
    trained = checkpoint.config
    for key in ("frames", "size", "seed"):
        cfg[key] = trained[key] if cfg[key] is None else cfg[key]
    if cfg.get("encoder") is None:
        return checkpoint.encoder(), trained["names"]["encoder"]
    if "_target_" not in cfg.encoder:
        raise BadInput(
            f"effects and encoder.* settings need an encoder that is named: encoder={trained['names']['encoder']}"
        )
    return _built(cfg.encoder, f"encoder={chosen('encoder')}", checkpoint), chosen("encoder")


def chosen_camera(cfg: DictConfig, checkpoint: Checkpoint) -> Encoder | None:
    """The encoder that ``decoder.camera=`` names, whose effective mask the decoder gets and whose effects are undone.

    Args:
        cfg: as :func:`chosen_encoder` left it.
        checkpoint: of the training.

    Returns:
        None where it names none: the encoder itself.

    Raises:
        BadInput: what is named is not an encoder, or does not fit.
    """
    if cfg.get("camera") is None:
        return None
    return _built(cfg.camera, f"decoder.camera={chosen('encoder@camera')}", checkpoint)


def resized(checkpoint: Checkpoint, size: Sequence[int]) -> str:
    """Say which overrides test a checkpoint on scenes of another size (height, width), ready to paste.

    A mask that can be tiled is repeated; in the place of another one comes a random one.
    """
    config = checkpoint.config
    name, mask, (height, width) = config["names"]["encoder"], config["encoder"].get("mask") or {}, size
    words = [f"size=[{height},{width}]"]
    if "tile" not in mask or not (CONF / "encoder" / f"{name}.yaml").is_file():
        return f"to test with a random mask add {words[0]} encoder=rbw_sr"
    tile = mask["tile"] or config["size"]
    words += [f"encoder={name}", f"encoder.mask.tile=[{tile[0]},{tile[1]}]"]
    words += [f"encoder.mask.bits={mask['bits']}"] if "bits" in mask else []
    return f"to test with the trained mask, repeated, add {' '.join(words)}"


def _built(settings: DictConfig, named: str, checkpoint: Checkpoint) -> Encoder:
    encoder = build(plain(settings), named)
    if not isinstance(encoder, Encoder):
        raise BadInput(f"{named}: its _target_ is {with_article(type(encoder).__name__)}, not an Encoder")
    mask, trained = settings.mask, checkpoint.config["encoder"].get("mask")
    alike = isinstance(trained, Mapping) and mask._target_ == trained.get("_target_")
    if alike and mask.get("file") is None:
        checkpoint.fill("encoder.mask", encoder.mask)
    check_recording(encoder, named)
    return encoder
