"""``python -m tests.weights.ship CHECKPOINT FILE [any]``: the weights of a training as those that come along.

Only what builds encoder and decoder anew is kept of the configuration, and the decoder in float16. With ``any``, the
decoder is one for any mask, and a snapshot's mask has to be given.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch

from sci_lightning.runs.checkpoint import read_checkpoint, write_weights
from sci_lightning.weights import ANY_MASK

KEPT = ("encoder", "decoder", "frames", "size", "crop", "seed", "names")


def ship(path: Path, config: Mapping[str, Any], state: Mapping[str, torch.Tensor], any_mask: bool) -> None:
    """Write weights with the keys of a run's configuration that build encoder and decoder anew."""
    kept = {key: config[key] for key in KEPT}
    names = config["names"]
    kept["names"] = {"encoder": ANY_MASK if any_mask else names["encoder"], "decoder": names["decoder"]}
    small = {key: value.half() if key.startswith("decoder.") else value for key, value in state.items()}
    write_weights(path, kept, small)


if __name__ == "__main__":
    trained = read_checkpoint(sys.argv[1])
    ship(Path(sys.argv[2]), trained.config, trained.state, sys.argv[3:] == ["any"])
