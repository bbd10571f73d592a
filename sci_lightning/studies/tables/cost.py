"""Parameters and multiply-accumulates of the full networks, counted as the paper counts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Cost:
    """What a decoder costs at 256 x 256, T = 8.

    Attributes:
        paper: the paper's figures, ``parameters_M``, ``macs_G`` and ``seconds``.
        parameters, macs: ours, None of a decoder that is not in ``conf/decoder``.
    """

    paper: Mapping[str, float]
    parameters: int | None = None
    macs: int | None = None


def costs(paper: Mapping[str, Mapping[str, Any]], decoders: Mapping[str, Mapping[str, Any]]) -> dict[str, Cost]:
    """Count the parameters and operations of each decoder that the paper lists; no memory is taken for its weights.

    Args:
        paper: ``decoders`` of ``paper_figures.yaml``.
        decoders: ours by name: plain configurations for T = 8.
    """
    return {name: _cost(name, figures, decoders.get(name)) for name, figures in paper.items()}


def _cost(name: str, figures: Mapping[str, Any], config: Mapping[str, Any] | None) -> Cost:
    import torch

    from sci_lightning.configuration.build import build
    from sci_lightning.decoder.complexity import count_as_paper, count_parameters

    if config is None:
        return Cost(figures)
    with torch.device("meta"):
        decoder = build(config, f"decoder={name}")
    return Cost(figures, count_parameters(decoder), count_as_paper(decoder, 8, 256, 256, figures["macs_rules"]))
