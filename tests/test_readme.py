"""Every command that README.md shows is run, at a reduced size and with real files in place of its capitals.

They run in the README's order: what one writes with ``out=`` a later one may read.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.io import savemat
from skimage.io import imsave

from sci_lightning.captures import pack_captures
from sci_lightning.decoder import Res2former
from tests.cli.test_encoder_file import encoder_file
from tests.conftest import ROOT
from tests.decoder.test_published import as_published
from tests.end_to_end.test_train import TINY
from tests.test_configs import clips

README = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"```bash\n(.*?)```", README, re.DOTALL)
COMMANDS = [line.split(" #")[0].strip() for block in BLOCKS for line in block.replace("\\\n", " ").splitlines() if line]
SIZE = ["size=[64,64]", "crop=[64,64]", "data.clips_per_epoch=2", "trainer.max_epochs=1", "trainer.accelerator=cpu"]
DECODER = {
    "e2e_cnn": ["decoder.channels=4", "decoder.blocks=1"],
    "pnp_ffdnet": ["decoder.denoiser.channels=4", "decoder.denoiser.layers=3", "decoder.iterations=[1]"],
    "res2former": ["decoder.dim=8", "decoder.depths=[1,1]", "decoder.groups=[1,1]"],
}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder that holds what the README's capitals stand for."""
    place = tmp_path_factory.mktemp("readme")
    clips(place / "CLIPS", "folder")
    clips(place / "VALIDATION", "folder")
    clips(place / "SCENES", "sixscenes")
    savemat(place / "MASK.mat", {"mask": np.full((64, 64, 8), 1 / 8)})
    imsave(place / "SNAPSHOT.tiff", (torch.rand(64, 64) * 255).byte().numpy(), check_contrast=False)
    (place / "LAB").mkdir()
    np.save(place / "LAB" / "masks.npy", np.full((8, 64, 64), 1 / 8))
    imsave(place / "LAB" / "grey.tif", np.full((64, 64), 100, np.uint8), check_contrast=False)
    recipe = "{bit_depth: 8, patterns: masks.npy, captures: [{measurement: grey.tif, scene: 0.4}]}"
    (place / "LAB" / "captures.yaml").write_text(recipe)
    pack_captures(place / "LAB", place / "CAPTURES.h5")
    encoder_file(place / "CAMERA", 64)
    state = {f"decoder.{key}": value for key, value in as_published(Res2former()).items()}
    torch.save({"state_dict": {"encoder.weight": torch.full((8, 16, 16), 1 / 8), **state}}, place / "PUBLISHED.pth")
    run([sys.executable, "-m", "sci_lightning.train", *TINY, *SIZE, *DECODER["e2e_cnn"], "out=RUN"], place)
    return place


def run(arguments: list[str], folder: Path) -> str:
    environment = {**os.environ, "XDG_CACHE_HOME": str(folder / "cache"), "MPLBACKEND": "agg"}
    done = subprocess.run(arguments, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, f"{shlex.join(arguments)}\n{done.stdout}\n{done.stderr}"
    return done.stdout


def test_there_are_commands() -> None:
    assert {"make train", "make test"} <= set(COMMANDS)
    assert len(COMMANDS) > 8


@pytest.mark.parametrize("command", dict.fromkeys(COMMANDS))
def test_command(command: str, place: Path) -> None:
    program, *arguments = shlex.split(command)
    if program == "make":
        assert run(["make", "--dry-run", "--always-make", "-C", str(ROOT), *arguments], place)
    elif program == "tensorboard":
        (place / "outputs").mkdir(exist_ok=True)
        run([sys.executable, "-m", "tensorboard.main", "--inspect", *arguments], place)
    else:
        assert (program, arguments[0]) == ("python", "-m"), f"no test knows how to run: {command}"
        for launcher in re.findall("hydra/launcher=([a-z]+)", command):
            pytest.importorskip(
                f"hydra_plugins.hydra_{launcher}_launcher", reason="pip install sci-lightning[launchers]"
            )
        run([sys.executable, *reduced(arguments)], place)


def reduced(arguments: list[str]) -> list[str]:
    """A command of the README made small by overrides; of a sweep, the first value of each choice."""
    if arguments[1] == "sci_lightning.proving_ground":
        return [*arguments, "suites=[nothing]", "cases=1", "seeds=1", "size=[32,32]", "frames=4", "workers=1"]
    if arguments[1] == "sci_lightning.benchmark":
        every = ["only=[e2e_cnn]"] if "decoder=all" in arguments else []
        return [*arguments, "size=16", "repeats=1", "product=64", *every]
    if arguments[1] in ("sci_lightning.evaluate", "sci_lightning.reconstruct") and "decoder=" in " ".join(arguments):
        return [*arguments, "size=[64,64]", "decoder.iterations=[2]"]
    if arguments[1] != "sci_lightning.train":
        return [re.sub(r"^size=.*", "size=[64,64]", each) for each in arguments]
    if any(each.startswith("experiment=table") for each in arguments):
        kept = [each for each in arguments if not each.startswith(("scale=", "seed="))]
        kept += ["encoder=lsw_sr", "encoder.mask.bits=1,2"] if "experiment=table5" in arguments else []
        return [*kept, "scale=smoke", "decoder=e2e_cnn", "trainer.accelerator=cpu", "data.scenes_count=1"]
    arguments = [re.sub(r"=([^\[,]+),[^\]]*$", r"=\1", each) for each in arguments]
    decoder = next((each.split("=")[1] for each in arguments if each.startswith("decoder=")), "res2former")
    extra = [*SIZE, *DECODER[decoder], "batch_size=1", "workers=0"]
    if any(each.startswith("ckpt_path=") for each in arguments):
        return arguments
    return [*arguments, *extra]


def test_python_examples(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The README's Python runs as it stands, line after line."""
    monkeypatch.chdir(place)
    examples = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    names: dict[str, object] = {"torch": torch, "video": torch.rand(1, 8, 256, 256)}
    for example in examples:
        exec(example, names)
    decoder = names["Mine"](8)  # type: ignore[operator]
    assert decoder(torch.rand(2, 16, 16), torch.rand(8, 16, 16)).shape == (2, 8, 16, 16)


def test_pictures_are_there() -> None:
    for path in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (ROOT / path).stat().st_size > 1000
