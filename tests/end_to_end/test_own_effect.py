"""An effect of the user's own, in a file outside the package, is found in captures and trained with."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from sci_lightning.captures import Captures, read_captures, write_captures
from sci_lightning.diagnosis.target_effects import TARGET_EFFECTS
from sci_lightning.encoder.effects import Effect
from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import Session, VirtualCamera
from tests.conftest import members
from tests.training.small_training import TINY

Run = Callable[..., str]
SLOPE = 0.137
MODULE = '''
from sci_lightning.encoder.effects import OpticsEffect, Parameter


class Slope(OpticsEffect):
    """One side is brighter than the other."""

    name, rank = "slope", 45
    about = {"slope": Parameter("1", 0.0, -0.5, 0.5, step=0.01, starts=(-0.1, 0.1))}

    def form(self, signal):
        return signal.with_mean(signal.mean * self.profile(signal))

    def undo(self, signal):
        return signal.with_mean(signal.mean / self.profile(signal))

    def profile(self, signal):
        _, x = signal.coordinates()
        return 1 + self.slope * x / (signal.field[1] / 2)
'''
MEMBER = "# @package encoder.effects.left_to_right\n_target_: own_effect.Slope\nslope: 0.1\n"


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """``lab.h5``: an ideal session, recorded anew by a camera whose left is darker than its right, and the module."""
    session = Session(size=(32, 32), frames=4)
    VirtualCamera(session).write(tmp_path / "ideal.h5", seed=4)
    ideal = read_captures(tmp_path / "ideal.h5")
    x = (np.arange(32) - 15.5) / 16
    light = ideal.aperture[:, None, None] * (ideal.patterns[ideal.sequence] * ideal.scene).sum(1) * (1 + SLOPE * x)
    random = np.random.default_rng(0)
    signal = random.poisson(light * session.full_well_e) / session.full_well_e * 255
    recorded = np.rint(signal + random.normal(0, session.read_noise_dn, light.shape)).clip(0, 255).astype(np.uint8)
    write_captures(tmp_path / "lab.h5", replace(ideal, measurement=recorded))
    (tmp_path / "own_effect.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    sys.modules.pop("own_effect", None)


@pytest.mark.slow
def test_found_and_trained_with(lab: Path, ran: Run) -> None:
    ran("diagnose", "captures=lab.h5", "out=found", "+candidates.slope=own_effect.Slope")
    report = json.loads((lab / "found" / "report.json").read_text())
    assert report["verdict"] == "explained"
    (effect,) = report["effects"]
    assert (effect["name"], effect["stage"]) == ("slope", "optics")
    slope = effect["parameters"]["slope"]
    assert abs(slope["value"] - SLOPE) < 4 * slope["std"] < 0.01
    assert report["gap"]["before"]["chi2"] > 2 > 1.05 > report["gap"]["after"]["chi2"]

    encoder = yaml.safe_load((lab / "found" / "encoder.yaml").read_text())
    assert encoder["effects"]["slope"]["_target_"] == "own_effect.Slope"
    small = ["frames=4", "trainer.max_epochs=1", "data.scenes_count=1", "callbacks.pictures=null", "logger=none"]
    ran("train", *TINY, *small, "encoder=found/encoder.yaml", "trusted=[own_effect]", "out=run")
    trained = json.loads((lab / "run" / "metrics.json").read_text())["config"]
    assert trained["encoder"]["effects"]["slope"]["slope"] == slope["value"]


def test_a_member_of_the_group_is_a_candidate(lab: Path, ran: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    (lab / "my_conf" / "effect").mkdir(parents=True)
    (lab / "my_conf" / "effect" / "left_to_right.yaml").write_text(MEMBER)
    seen: dict[str, type[Effect]] = {}

    def look(captures: Captures, vocabulary: dict[str, type[Effect]], *_: object) -> None:
        seen.update(vocabulary)
        raise BadInput("seen")

    monkeypatch.setattr("sci_lightning.diagnosis.diagnosis.diagnose", look)
    with pytest.raises(SystemExit):
        ran("diagnose", "captures=lab.h5", f"hydra.searchpath=[file://{lab}/my_conf]")
    assert seen["slope"].__module__ == "own_effect"
    assert set(seen) == {*members("effect"), *TARGET_EFFECTS, "slope"}


def test_not_in_the_vocabulary(lab: Path, refused: Run) -> None:
    captures = "captures=lab.h5"
    line = refused("diagnose", captures, "+candidates.slope=own_effect.Nothing")
    assert "candidates.slope: no class 'own_effect.Nothing'" in line
    assert "is no sci_lightning.encoder" in refused("diagnose", captures, "+candidates.slope=own_effect.Parameter")
    assert "calls itself 'slope'" in refused("diagnose", captures, "+candidates.tilt=own_effect.Slope")
