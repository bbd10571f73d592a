"""The pages of the documentation, the commands and the Python that they show, and how a test makes a command small."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import ROOT, members

PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
"""README.md and every page under docs/, whatever its folder."""

SMALL = [
    *("size=[32,32]", "crop=[32,32]", "batch_size=1", "workers=0", "data.clips_per_epoch=2"),
    *("trainer.max_epochs=1", "trainer.accelerator=cpu", "metrics.qscore=null", "callbacks.pictures=null"),
]
"""Overrides that make one training a matter of seconds; the stand-ins of ``conftest.py`` are of this size."""
SMALL_DECODER = {
    "mine": [],
    "e2e_cnn": ["decoder.channels=4", "decoder.blocks=1"],
    "pnp_ffdnet": ["decoder.denoiser.channels=4", "decoder.denoiser.layers=3", "decoder.iterations=[1]"],
    "res2former": ["decoder.dim=8", "decoder.depths=[1,1]", "decoder.groups=[1,1]"],
}
FEW_CAPTURES = ["dark=2", "flat=2", "all_on=1", "all_off=1", "static=2", "dynamic=2"]
ONLY_COMPOSED = (
    "hydra/launcher=",  # tests/end_to_end/test_sweep.py runs sweeps with these launchers
    "experiment=table",  # likewise: every row of every table
    "-m encoder=",  # likewise
    "-m effect=",  # likewise
    "experiment=speedrun",  # the same settings as other commands, only half an hour longer
    "experiment=denoiser_cpu",  # tests/end_to_end/test_iterative_decoders.py trains denoisers
    "dry_run=true",  # tests/training/test_training_plan.py
    "decoder=all",  # tests/end_to_end/test_benchmark.py measures them
    "free_forms=true",  # tests/end_to_end/test_diagnose.py
    "captures=SESSION.h5",  # likewise: a diagnosis of three effects
    "mask_step=",  # tests/captures/test_snapshots.py
    "out=IDEAL encoder.effects",  # the same training as the command before it on the page, with effects removed
    "captures register",  # tests/captures/registration and tests/captures/test_command.py run it
    "ckpt_path=IDEAL",  # the same test as the command before it on the page
    "sci_lightning.mismatch",  # tests/studies/mismatch runs the protocol
    "experiment=finetune",  # likewise
    "tables runs=RUN",  # the same tables as those of the README's command
    "benchmark decoder=res2former size=",  # tests/end_to_end/test_benchmark.py measures decoders
    "benchmark decoder=e2e_cnn",  # likewise
)
"""Commands with one of these words are composed with ``--cfg job`` and not run: other tests run the same code."""
ONLY_IMPORTED = ("tests.studies.benchmark.convolutions", "tests.studies.mask_ranking")
"""Measurements, which tests of the same name run on small data."""


OWN_FILE = re.compile(r"`([\w/]+\.(?:py|yaml))`:\n\n```(?:python|yaml)\n(.*?)```", re.DOTALL)
"""A file that a page tells its reader to write: its path, and what it holds."""


def own_files(folder: Path) -> None:
    """Write the files that the pages tell their readers to write, all into one folder."""
    for page in PAGES:
        for path, content in OWN_FILE.findall(page.read_text()):
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(content)


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


def commands_of(wanted: Callable[[str], bool]) -> list[object]:
    """Return pytest parameters, the commands of all pages with a wanted name; none that an earlier page shows, too.

    A command that writes a folder for the next one on its page, with ``out=``, is run for every page.
    """
    parameters, seen = [], set()
    for page in PAGES:
        for command in commands(page):
            if wanted(name(page)) and (command not in seen or "out=" in command):
                parameters.append(pytest.param(command, id=f"{name(page)}: {command}"))
            seen.add(command)
    return parameters


def reduced(arguments: list[str]) -> list[str]:
    """Return the overrides of ``python -m MODULE ...`` (module first) made small; of choices of a sweep the first."""
    module, *overrides = arguments
    line = " ".join(arguments)
    if any(words in line for words in ONLY_COMPOSED) and "--cfg" not in line:
        single = [_first_choice(override) for override in overrides if override != "-m"]
        return [module, *single, "--cfg", "job"]
    if {"--cfg", "--help"} & set(overrides):
        return arguments
    overrides = [re.sub(r"^size=.*", "size=[32,32]", _first_choice(override)) for override in overrides]
    match module.removeprefix("sci_lightning."):
        case "proving_ground" if "run=false" not in line:
            small = ["suites=[nothing]", "cases=1", "seeds=1", "size=[32,32]", "slots=[4]", "workers=1"]
            return [module, *overrides, *(small if "out=" in line else ["--cfg", "job"])]
        case "demo":
            return [module, *overrides, "snapshots=1", "decoder=linear"]
        case "design_mask":
            return [module, *overrides, "steps=2", "tile=[4,4]", "size=[32,32]"]
        case "benchmark":
            return [module, *overrides, "size=16", "repeats=1", "product=64"]
        case "evaluate" | "reconstruct":
            algorithm = ["size=[32,32]"] if "decoder=" in line else []
            algorithm += ["decoder.iterations=[2]"] if algorithm and "decoder=linear" not in line else []
            quick = ["metrics.qscore=null", "pictures=1"] if "evaluate" in module and "qscore" not in line else []
            return [module, *overrides, *algorithm, *quick]
        case "diagnose" if overrides != ["captures=CAPTURES.h5"]:  # the README's; tests/diagnosis/blind has all effects
            left_out = set(members("effect")) - {"mask_contrast", "mask_shift", "read_noise", "shot_noise"}
            known = [] if "SNAPSHOT" in line else ["budget=3"]  # of unknown scenes there is no budget
            return [module, *overrides, f"leave_out=[{','.join(sorted(left_out))}]", *known]
        case "virtual_camera":
            return [module, *overrides, "size=[32,32]", *FEW_CAPTURES]
        case "train" if "ckpt_path=" not in line:
            decoder = re.search(r"\bdecoder=(\w+)", line)
            default = "e2e_cnn" if "experiment=quickstart" in line else "res2former"
            network = SMALL_DECODER[decoder[1] if decoder else default]
            return [module, *overrides, *SMALL, *network, *([] if "data=" in line else ["data.scenes_count=1"])]
    return [module, *overrides]


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
