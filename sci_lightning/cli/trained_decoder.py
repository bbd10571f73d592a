"""What a command decodes with: a trained decoder, or one that needs no training."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from omegaconf import DictConfig, OmegaConf
from torch import nn

from sci_lightning.cli.command import built, chosen, member, plain
from sci_lightning.configuration.build import build
from sci_lightning.decoder.complexity import count_parameters
from sci_lightning.errors import BadInput
from sci_lightning.runs.checkpoint import Checkpoint, read_checkpoint

UNTRAINED = {"frames": 8, "size": [256, 256], "seed": 0}
"""What ``frames``, ``size`` and ``seed`` are where no training tells."""


def chosen_checkpoint(command: str, cfg: DictConfig) -> Checkpoint:
    """The checkpoint ``ckpt_path=``, or one made on the spot of ``decoder=`` where that has no learned parameters.

    With both, the decoder is as ``decoder=`` says and filled from the checkpoint. Without a checkpoint the encoder is
    the one that ``encoder=`` names, else ``rbw_osr``.

    Args:
        command: whose configuration ``cfg`` is.
        cfg: of the command; without a checkpoint ``frames``, ``size`` and ``seed`` that are None are filled in.

    Raises:
        BadInput: neither, a checkpoint that cannot be read or does not fit, or a decoder that has to be trained first.
    """
    name, settings = chosen("decoder"), cfg.get("decoder")
    if cfg.ckpt_path is not None:
        checkpoint = read_checkpoint(cfg.ckpt_path, cfg.trusted)
        if settings is None:
            return checkpoint
        if "_target_" not in settings:
            trained = checkpoint.config["names"]["decoder"]
            raise BadInput(
                f"decoder.* beside ckpt_path= needs a decoder as well, built as it was trained: decoder={trained}"
            )
        checkpoint.fill("decoder", built(cfg, "decoder"), name)  # refused while both names are known
        names = {**checkpoint.config["names"], "decoder": name}
        return replace(checkpoint, config={**checkpoint.config, "decoder": plain(settings), "names": names})
    if settings is None:
        raise BadInput("give ckpt_path=RUN/checkpoints/last.ckpt, or a decoder that needs no training: decoder=gap_tv")
    for key, value in UNTRAINED.items():
        cfg[key] = value if cfg[key] is None else cfg[key]
    decoder = built(cfg, "decoder")
    if parameters := count_parameters(decoder):
        raise BadInput(f"decoder={name} has {parameters:,} parameters to learn: train it first, and give ckpt_path=")
    named = "_target_" in (cfg.get("encoder") or {})
    numbers = plain(OmegaConf.masked_copy(cfg, list(UNTRAINED)))  # of all of it data.root may be missing: captures=
    given = cfg.encoder if named else member(command, "encoder", "rbw_osr", *(f"{k}={v}" for k, v in numbers.items()))
    config = {
        "encoder": plain(given),
        "decoder": plain(settings),
        **numbers,
        "crop": numbers["size"],
        "names": {"encoder": chosen("encoder") if named else "rbw_osr", "decoder": name},
    }
    modules = nn.ModuleDict({"encoder": build(plain(given), "encoder"), "decoder": decoder})
    return Checkpoint(Path(f"decoder={name}"), config, modules.state_dict(), tuple(cfg.trusted))
