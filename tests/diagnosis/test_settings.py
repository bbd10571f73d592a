"""Wrong values of the keys of ``diagnose`` end in one line that names the key; degenerate captures in a verdict."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from omegaconf import OmegaConf

from sci_lightning.captures import read_captures
from sci_lightning.cli.settings import check_command_settings
from sci_lightning.diagnosis.diagnosis import diagnose
from sci_lightning.diagnosis.model.observation import observe
from sci_lightning.diagnosis.report.report import describe
from sci_lightning.diagnosis.report.sentences import headline
from sci_lightning.diagnosis.search_settings import SearchSettings
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.errors import BadInput
from sci_lightning.virtual_camera import Session, VirtualCamera
from tests.files.formats import check


@pytest.mark.parametrize(
    ("key", "value"),
    [
        *(("search", {"max_effects": value}) for value in (-1, 1.5, "abc", True, [1])),
        *(("seed", value) for value in (-1, 2**63, 1e30, "abc")),
        *(("free_forms", value) for value in (7, "yes")),
        *(("candidates", value) for value in (5, ["a"], "a", {"a": 5}, {"a": ""})),
        *(("search", value) for value in (5, {"min_gain_nats": -1}, {"candidates_fitted": 0}, {"significance": 2.0})),
        *(("search", value) for value in ({"significance": True}, {"mistyped": 1}, {"rivals_fitted": 1.5})),
        *(("captures", value) for value in ("", ["a.h5"], {"a": 1}, True)),
    ],
)
def test_a_wrong_value_is_refused_by_its_key(key: str, value: Any) -> None:
    with pytest.raises(BadInput, match=key):
        check_command_settings(OmegaConf.create({key: value}), "diagnose")


def test_the_command_ends_with_one_line(tmp_path: Path, refused: Callable[..., str]) -> None:
    (tmp_path / "a.h5").touch()
    assert "search.max_effects=-1: expected a whole number" in refused(
        "diagnose", f"captures={tmp_path}/a.h5", "search.max_effects=-1", f"out={tmp_path}/out"
    )
    mistyped = refused("diagnose", f"captures={tmp_path}/a.h5", "search.max_efects=1")
    assert "search.max_efects: no such setting; did you mean search.max_effects?" in mistyped
    VirtualCamera(Session(size=(16, 16))).write(tmp_path / "a.h5", seed=3)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file.attrs["name"] = "[/red]\x1b[31m"
        file["scene"][...] = np.nan
    line = refused("diagnose", f"captures={tmp_path}/a.h5", f"out={tmp_path}/out")
    assert "[/red]\\x1b[31m: none of the" in line and "\x1b" not in line


@pytest.mark.parametrize(
    "degenerate",
    [
        "one pixel",
        "one row",
        "no light",
        pytest.param("all mirrors off", marks=pytest.mark.slow),
        pytest.param("constant", marks=pytest.mark.slow),
        "one slot",
        "one bit",
    ],
)
def test_degenerate_captures_get_a_verdict(degenerate: str, tmp_path: Path) -> None:
    session = Session(size=(16, 16), dark=1, flat=1, all_on=0, all_off=0, pattern=0, static=1, dynamic=1)
    VirtualCamera(session).write(tmp_path / "a.h5", seed=3)
    captures = read_captures(tmp_path / "a.h5")
    rows, columns = {"one pixel": (1, 1), "one row": (1, 16)}.get(degenerate, (16, 16))
    changed = {name: getattr(captures, name)[..., :rows, :columns] for name in ("patterns", "measurement", "scene")}
    if degenerate == "no light":
        changed["scene"] = 0 * changed["scene"]
    elif degenerate == "all mirrors off":
        changed["patterns"] = 0 * changed["patterns"]
    elif degenerate == "constant":
        changed["measurement"] = np.full_like(changed["measurement"], 7)
    elif degenerate == "one slot":
        changed |= {"sequence": captures.sequence[:, :1], "scene": changed["scene"][:, :1]}
    elif degenerate == "one bit":
        changed |= {"bit_depth": 1, "measurement": (changed["measurement"] > 60).astype(np.uint8)}
    few = {
        name: vocabulary()[name] for name in ("gain", "pattern_order", "bit_depth", "prnu", "shot_noise", "read_noise")
    }
    result = diagnose(replace(captures, **changed), few, settings=SearchSettings(max_effects=2))
    report = json.loads(json.dumps(describe(result)))
    check("report", report)
    assert report["verdict"] in ("consistent", "explained", "partly_explained", "unexplained")
    assert headline(result).endswith(".")


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"aperture": np.float32(1e38)}, "aperture times scene of capture"),
        ({"scene": np.float32(1e30)}, "aperture times scene of capture"),
        ({"scene": np.float32(255)}, "is it in DN or percent?"),
        ({"exposure": np.float32(1e38)}, "exposure of capture 0 is 1e+38, expected at most 1e+06"),
        ({"read_noise_dn": 1e30}, "attribute 'read_noise_dn' must be a number from 0 to 1000 DN"),
        ({"full_well_e": 1e-30}, "attribute 'full_well_e' must be a number from 1 to 1e"),
    ],
)
def test_what_no_camera_can_have_is_refused(changed: dict[str, Any], words: str, tmp_path: Path) -> None:
    VirtualCamera(Session(size=(16, 16), dark=1, flat=1)).write(tmp_path / "a.h5", seed=3)
    captures = read_captures(tmp_path / "a.h5")
    ((name, value),) = changed.items()
    whole = value if isinstance(value, float) else np.full_like(getattr(captures, name), value)
    with pytest.raises(BadInput, match=re.escape(words)):
        observe(replace(captures, **{name: whole}))
