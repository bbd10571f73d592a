"""The pages of the documentation, the commands and the Python that they show, and how a test makes a command small."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from tests.conftest import ROOT

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
"""README.md and every page under docs/, whatever its folder."""

SMALL = ["size=[32,32]", "crop=[32,32]", "data.clips_per_epoch=2", "trainer.max_epochs=1", "trainer.accelerator=cpu"]
"""Overrides that make one training a matter of seconds; the stand-ins of ``conftest.py`` are of this size."""
SMALL_DECODER = {
    "e2e_cnn": ["decoder.channels=4", "decoder.blocks=1"],
    "pnp_ffdnet": ["decoder.denoiser.channels=4", "decoder.denoiser.layers=3", "decoder.iterations=[1]"],
    "res2former": ["decoder.dim=8", "decoder.depths=[1,1]", "decoder.groups=[1,1]"],
}
ONLY_COMPOSED = (
    "hydra/launcher=",  # tests/end_to_end/test_sweep.py runs sweeps with these launchers
    "experiment=table",  # likewise: every row of every table
    "experiment=short_cpu",  # half an hour of training; the same settings as other commands, only longer
    "experiment=denoiser_cpu",  # tests/end_to_end/test_iterative_decoders.py trains denoisers
    "decoder=all",  # tests/end_to_end/test_benchmark.py measures them
    "decoder=desci",
    "-m encoder=",  # tests/end_to_end/test_sweep.py
)
"""Commands with one of these words are composed with ``--cfg job`` and not run: other tests run the same code."""


def name(page: Path) -> str:
    """Return how a page is called in this repository: ``docs/how-to/sweep.md``."""
    return page.relative_to(ROOT).as_posix()


def blocks(page: Path, language: str) -> list[str]:
    """Return the code blocks of a page that are marked as ``language``, in order."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(), re.DOTALL | re.MULTILINE)


def commands(page: Path) -> list[str]:
    """Return the commands of a page without comments and line breaks, in order, each of them once."""
    lines = [line for block in blocks(page, "bash") for line in block.replace("\\\n", " ").splitlines()]
    return list(dict.fromkeys(stripped for line in lines if (stripped := line.split(" #")[0].strip())))


def commands_of(*folders: str) -> list[object]:
    """Return pytest parameters (page, command) of all pages in folders of docs/; README.md is its own folder name."""
    pages = [page for page in PAGES if name(page).removeprefix("docs/").split("/")[0] in folders]
    return [pytest.param(page, command, id=f"{name(page)}: {command}") for page in pages for command in commands(page)]


def reduced(arguments: list[str]) -> list[str]:
    """Return the overrides of ``python -m MODULE ...`` (module first) made small; of choices of a sweep the first."""
    module, *overrides = arguments
    line = " ".join(arguments)
    if any(words in line for words in ONLY_COMPOSED) and "--cfg" not in line:
        single = [_first_choice(override) for override in overrides if override not in ("-m", "--multirun")]
        return [module, *single, "--cfg", "job"]
    if {"--cfg", "--help"} & set(overrides):
        return arguments
    command = module.removeprefix("sci_lightning.")
    if command == "proving_ground":
        small = ["suites=[nothing]", "cases=1", "seeds=1", "size=[32,32]", "frames=4", "workers=1"]
        return [*arguments, *small] if "out=" in line else [*arguments, "--cfg", "job"]
    if command == "benchmark":
        return [*arguments, "size=16", "repeats=1", "product=64"]
    if command in ("evaluate", "reconstruct") and "decoder=" in line:
        return [*arguments, "size=[32,32]", "decoder.iterations=[2]"]
    if command == "virtual_camera":
        return [module, *(re.sub(r"^size=.*", "size=[32,32]", override) for override in overrides)]
    if command != "train" or "ckpt_path=" in line:
        return arguments
    decoder = re.search(r"\bdecoder=(\w+)", line)
    small = [*SMALL, *SMALL_DECODER[decoder[1] if decoder else "res2former"], "batch_size=1", "workers=0"]
    return [module, *map(_first_choice, overrides), *small]


def _first_choice(override: str) -> str:
    """Return ``a=1`` of the sweep's ``a=1,2,3``; lists in brackets are no choices."""
    return re.sub(r"=([^\[,{]+),[^\]]*$", r"=\1", override)


def split(command: str) -> list[str]:
    """Return the words of a command as the shell passes them, module first, for ``python -m`` and ``sci-lightning``."""
    program, *arguments = shlex.split(command)
    if program == "sci-lightning":
        return [f"sci_lightning.{arguments[0]}", *arguments[1:]] if arguments else ["sci_lightning"]
    assert (program, arguments[0]) == ("python", "-m"), f"no test knows how to run: {command}"
    return arguments[1:]
