"""What has no name gets none; what cannot be told apart is said to be so; little is taken for little."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from sci_lightning.captures import Captures, read_captures
from sci_lightning.diagnosis.diagnosis import Diagnosis, diagnose
from sci_lightning.diagnosis.model.hypothesis import Hypothesis
from sci_lightning.diagnosis.report.corrected_camera import write_encoder
from sci_lightning.diagnosis.report.report import describe
from sci_lightning.diagnosis.search.alternatives import Separation, further_captures
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.virtual_camera import Session, VirtualCamera


def captured(folder: Path, hidden: dict[str, Any], **session: Any) -> Captures:
    VirtualCamera(Session(size=(32, 32), **session), hidden).write(folder / "a.h5", seed=3)
    return read_captures(folder / "a.h5")


def diagnosed(folder: Path, hidden: dict[str, Any], free_forms: bool = False, **session: Any) -> Diagnosis:
    return diagnose(captured(folder, hidden, **session), vocabulary(), free_forms=free_forms)


@pytest.mark.parametrize(
    ("hidden", "surround", "stage"),
    [
        pytest.param({"short_slot": {"loss": 0.3, "slot": 2}}, "dark", "exposure", marks=pytest.mark.slow),
        pytest.param(
            {"sensor_dust": {"depth": 0.5, "radius": 2.5, "count": 4}}, "goes_on", "sensor", marks=pytest.mark.slow
        ),
        # an unknown surround leaves too little of so small a field to see the shape of a leak
        ({"light_leak": {"strength": 0.08, "reach": 0.25, "edge": "left"}}, "dark", "optics"),
    ],
)
def test_what_has_no_name(hidden: dict[str, Any], surround: str, stage: str, tmp_path: Path) -> None:
    result = diagnosed(tmp_path, hidden, surround=surround)
    assert result.verdict == "unexplained" and result.names == ()
    assert result.unnamed[0].stage == stage and result.unnamed[0].p_value < 1e-6


@pytest.mark.slow
def test_free_form_when_asked(tmp_path: Path) -> None:
    result = diagnosed(tmp_path, {"short_slot": {"loss": 0.3, "slot": 2}}, free_forms=True, surround="dark")
    assert result.verdict == "unexplained" and result.unnamed[0].stage == "exposure"
    assert result.after.gap.chi2 < 1.05 < result.before.gap.chi2
    write_encoder(result, tmp_path)
    assert "SlotWeights" in (tmp_path / "encoder.yaml").read_text()


def test_alternatives(tmp_path: Path) -> None:
    """Behind masks that sum to 1 an even scene cannot tell light that leaks through the mask from a larger gain."""
    only_flat = {"dark": 0, "all_on": 0, "all_off": 0, "pattern": 0, "static": 0, "dynamic": 0, "flat": 8}
    (effect,) = describe(diagnosed(tmp_path, {"gain": {"factor": 1.06}}, **only_flat))["effects"]
    assert {effect["name"], *effect["alternatives"]} >= {"gain", "mask_contrast"}
    assert re.match(r"To tell \w+ from \w+, record one capture of ", effect["tell_apart"])
    assert effect["tell_apart"].endswith("15 are needed).")


def test_what_is_to_be_recorded_tells(tmp_path: Path) -> None:
    """A weak delay and a weak lag are the same to first order; with the captures that are asked for they are not."""
    few = {name: vocabulary()[name] for name in ("sync_offset", "mask_lag", "shot_noise", "read_noise")}
    captures = captured(tmp_path, {"mask_lag": {"lag": 0.015}})
    result = diagnose(captures, few)
    (effect,) = describe(result)["effects"]
    assert {effect["name"], *effect["alternatives"]} == {"mask_lag", "sync_offset"}
    more = recorded(result, effect["tell_apart"], result.before.fit.hypothesis.with_effect("mask_lag", {"lag": 0.015}))
    (effect,) = describe(diagnose(joined(captures, more), few))["effects"]
    assert (effect["name"], effect["alternatives"], effect["tell_apart"]) == ("mask_lag", [], "")


def recorded(result: Diagnosis, advice: str, truth: Hypothesis) -> Captures:
    """What somebody records who follows the advice, with a camera of which the truth is known."""
    amount = re.search(r"record (?:(\d+) captures|one capture) of", advice)
    assert amount
    random, parts = torch.Generator().manual_seed(1), []
    for kind, seen in further_captures(result.observation).items():
        if re.search(f" of {re.escape(kind)}(, and as many| \\(about| \\(more)", advice):
            told = result.model.of_captures(seen).predict(truth)
            for _ in range(int(amount[1] or 1)):
                noisy = told.mean + told.deviation * torch.randn(told.mean.shape, generator=random)
                parts.append((seen, noisy.round().clamp(0, seen.full_scale)))
    assert parts
    shape = (result.observation.frames, *result.observation.size)
    return Captures(
        patterns=parts[0][0].patterns.numpy(),
        sequence=torch.cat([seen.sequences for seen, _ in parts]).numpy(),
        measurement=torch.cat([dn for _, dn in parts]).numpy().astype(np.uint8),
        scene=torch.stack([seen.scene[0].expand(shape) for seen, _ in parts]).float().numpy(),
        aperture=torch.cat([seen.aperture.flatten() for seen, _ in parts]).numpy(),
        exposure=torch.cat([seen.exposure.flatten() for seen, _ in parts]).numpy(),
        kind=("unknown",) * len(parts),
        bit_depth=8,
    )


def joined(one: Captures, other: Captures) -> Captures:
    """Two files of one camera as one."""
    names = ("sequence", "measurement", "scene", "aperture", "exposure")
    both = {name: np.concatenate((getattr(one, name), getattr(other, name))) for name in names}
    return replace(one, kind=one.kind + other.kind, **both)


def test_further_captures_tell_what_no_other_value_of_the_rival_makes_up_for() -> None:
    """A rival that can be moved onto the truth is told only by what the captures at hand say against that."""
    one, nothing = torch.tensor([[1.0]], dtype=torch.float64), torch.zeros(1, 1, dtype=torch.float64)
    apart = Separation(4.0, 2 * one[0], one, nothing)
    assert apart.nats(10) == pytest.approx(0.0)
    held = Separation(4.0, 2 * one[0], one, 100 * one)
    assert held.nats(1) == pytest.approx(0.5 * (4 - 4 / 101))
    assert held.captures(15.0, most=50) == next(n for n in range(1, 50) if held.nats(n) >= 15)
    assert (held + held).apart == 8.0
    assert apart.captures(15.0, most=50) is None


@pytest.mark.slow
def test_one_capture(tmp_path: Path) -> None:
    captures = captured(tmp_path, {"gain": {"factor": 0.8}})
    (first,) = np.flatnonzero([kind == "static" for kind in captures.inferred_kind])[:1]
    result = diagnose(captures.take([int(first)]), vocabulary())
    split = describe(result)["split"]
    assert split["held_out_captures"] == [] and "one capture" in split["note"]
    result.save(tmp_path / "out")
    assert {"report.json", "report.html", "encoder.yaml", *result.plot()} <= {
        path.name for path in (tmp_path / "out").iterdir()
    }


@pytest.mark.parametrize(
    "names",
    [
        ("mask_contrast", "mask_blur", "gain", "shot_noise", "read_noise"),
        pytest.param(tuple(vocabulary()), marks=pytest.mark.slow),
    ],
    ids=["few", "all"],
)
def test_order_does_not_matter(names: tuple[str, ...], tmp_path: Path) -> None:
    captures = captured(tmp_path, {"mask_contrast": {"leak": 0.05}})
    backwards = captures.take(list(range(len(captures.measurement)))[::-1])
    effects = {name: vocabulary()[name] for name in names}
    one, other = (diagnose(taken, effects) for taken in (captures, backwards))
    assert one.names == other.names == ("mask_contrast",)
    leaks = [float(each.after.fit.hypothesis.effects["mask_contrast"]["leak"]) for each in (one, other)]
    assert leaks[0] == pytest.approx(leaks[1], abs=1e-5)
