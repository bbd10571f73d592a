"""``python -m sci_lightning.evaluate``: test a trained decoder, or one that needs no training."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sci_lightning.cli import evaluation
from sci_lightning.cli.command import run
from sci_lightning.cli.composition import Composition
from sci_lightning.cli.settings import CommandSettings, Count, Kernels, Name, Precision
from sci_lightning.configuration.bounds import ExistingPath, Frames, Seed, Size
from sci_lightning.console import PlainConsole, styled


@dataclass(frozen=True)
class EvaluateSettings(CommandSettings):
    """Types and ranges of ``conf/evaluate.yaml``, which states the defaults and what they mean."""

    ckpt_path: ExistingPath | None
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
    done = evaluation.evaluate(composition, console)
    print_results(done.metrics, console)
    console.say(styled(done.folder), ": metrics.json" + (", pictures/" if done.pictures else ""))
    print_next(console, invocation("tables", paths={"runs": done.folder}))
    return done.metrics.mean["psnr"]


def main() -> None:
    """Run the command."""
    run("evaluate", evaluate)
