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


def costs(paper: Mapping[str, Mapping[str, Any]]) -> dict[str, Cost]:
    """The cost of each decoder that the paper lists, of weights without data; inside a running command only.

    Args:
        paper: ``decoders`` of ``paper_figures.yaml``.
    """
    return {name: _cost(name, figures) for name, figures in paper.items()}


def _cost(name: str, figures: Mapping[str, Any]) -> Cost:
    import torch

    from sci_lightning.configuration.build import build
    from sci_lightning.decoder.complexity import count_parameters
    from sci_lightning.decoder.paper_count import count_as_paper

    if not (CONF / "decoder" / f"{name}.yaml").is_file():
        return Cost(figures)
    with torch.device("meta"):
        decoder = build(plain(member("train", "decoder", name, "frames=8")), f"decoder={name}")
    return Cost(figures, count_parameters(decoder), count_as_paper(decoder, 8, 256, 256, figures["macs_rules"]))
