"""Effects in the order of the light: their keys in checkpoints, those of earlier versions, and what is refused."""

from __future__ import annotations

import subprocess
import sys

import pytest
import torch

from sci_lightning.encoder import Encoder, effects
from sci_lightning.encoder.effects import (
    Effect,
    Gain,
    MaskDistortion,
    MaskRotation,
    MaskShift,
    OpticsEffect,
    Parameter,
    Prnu,
    ReadNoise,
    RelayEffect,
    ShotNoise,
)
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.mask import RandomBinary
from sci_lightning.encoder.sensor import ClipQuantise
from sci_lightning.errors import BadInput
from tests.conftest import ROOT

SIZE = (8, 8)


def path() -> LightPath:
    return LightPath([Prnu(size=SIZE, std=0.1), MaskShift(dx=0.4), Gain(factor=0.8)])


def test_parameters_are_named_by_effect() -> None:
    keys = ["effects.gain.factor", "effects.mask_shift.dx", "effects.mask_shift.dy", "effects.prnu.map"]
    assert sorted(path().state_dict()) == [*keys, "effects.prnu.std"]
    assert path().names == ["mask_shift", "gain", "prnu"]


def test_noise_is_stated_once() -> None:
    mask = RandomBinary(4, SIZE)
    with pytest.raises(BadInput, match=r"encoder\.sensor\.read_noise=1\.5 .* 2"):
        Encoder(mask, ClipQuantise(read_noise=1.5), effects=[ReadNoise(std=2.0)])
    with pytest.raises(BadInput, match=r"twice.*encoder\.sensor\.full_well=9000"):
        Encoder(mask, ClipQuantise(full_well=9000.0), effects=[ShotNoise(full_well=1e4)])
    Encoder(mask, ClipQuantise(read_noise=1.5), effects=[ReadNoise(std=0.0), ShotNoise(full_well=1e4)])


def test_what_is_no_effect_of_a_stage() -> None:
    class Alone(Effect):
        name = "alone"
        rank = 45
        about = {"part": Parameter("1", 0.0, 0, 1)}

    class Values(OpticsEffect):
        name = "values"
        rank = 45
        about = {"part": Parameter("1", 0.0, 0, 1)}

    with pytest.raises(BadInput, match=r"Alone .* OpticsEffect"):
        LightPath([Alone()])
    with pytest.raises(BadInput, match="'values': this name cannot be used"):
        LightPath([Values()])
    with pytest.raises(BadInput, match="OpticsEffect is a base class of effects"):
        OpticsEffect()


def test_a_new_effect_is_found_by_its_file() -> None:
    """The package lists what lies in its folders, and loads an effect when it is used."""
    files = {file.stem for file in (ROOT / "sci_lightning" / "encoder" / "effects").glob("*/[a-z]*.py")}
    assert {module.rpartition(".")[2] for module in effects.FILES.values()} == files
    assert all(getattr(effects, name).name == module.rpartition(".")[2] for name, module in effects.FILES.items())
    assert set(effects.FILES) < set(effects.__all__) == set(dir(effects))
    program = (
        "import sys, sci_lightning.encoder.effects as e; e.Gain; print(*(m for m in sys.modules if '.effects.' in m))"
    )
    loaded = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout
    assert "sensor.gain" in loaded and "sensor.prnu" not in loaded
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        _ = effects.Nothing


@pytest.mark.parametrize("effect", [MaskDistortion(k=-0.05), MaskRotation(angle=1.7)], ids=["distorted", "turned"])
def test_a_footprint_that_leans_on_the_mirrors(effect: RelayEffect) -> None:
    """The image is that of pixels in many parts, to a thousandth of a pattern's contrast."""
    patterns = (torch.rand(4, 40, 56) < 0.5).float()
    geometry = LightPath([effect]).geometry
    exact = torch.nn.functional.avg_pool2d(geometry.image(patterns, 16), 16)
    assert (geometry.image(patterns) - exact).square().mean().sqrt() < 1e-3
