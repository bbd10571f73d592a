from __future__ import annotations

from collections.abc import Callable

import pytest
from hydra.utils import instantiate
from omegaconf import DictConfig

from sci_lightning.decoder import Decoder


@pytest.fixture
def make_decoder(configuration: Callable[..., DictConfig]) -> Callable[..., Decoder]:
    """Builds the decoder of ``conf/decoder`` with this name, for T = frames, with overrides."""

    def make(name: str, frames: int, *overrides: str) -> Decoder:
        cfg = configuration("train", f"decoder={name}", f"frames={frames}", *overrides)
        return instantiate(cfg.decoder, _convert_="all")

    return make
