"""The contract of every free-form deviation: nothing at 0, something elsewhere, gradients throughout."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.encoder import Encoder, free_form
from sci_lightning.encoder.effects import Effect, MapEffect
from sci_lightning.encoder.free_form import FreeForm, Ghost, MaskField, PatternMixing
from sci_lightning.encoder.light_path import LightPath
from sci_lightning.encoder.mask import RandomStructural
from sci_lightning.encoder.sensor import Ideal
from sci_lightning.encoder.signal import Signal
from sci_lightning.errors import BadInput

N, T, SIZE = 5, 4, (18, 16)
NAMES = [name for name in free_form.__all__ if name != "FreeForm"]


def build(name: str, value: float) -> Effect:
    member = getattr(free_form, name)
    if issubclass(member, MapEffect):
        return member(size=SIZE, std=value)
    chosen = member.of(member.numbers(N, T))
    return chosen(**dict.fromkeys(chosen.about, value))


def seen(path: LightPath) -> torch.Tensor:
    random = torch.Generator().manual_seed(0)
    video, patterns = torch.rand(N, T, *SIZE, generator=random), torch.rand(T, *SIZE, generator=random)
    light = (video * path.transmittance(patterns)).sum(1) / T
    ones, position = torch.ones(N, 1, 1), torch.arange(N)
    before = torch.cat((torch.zeros_like(light[:1]), light[:-1]))
    signal = Signal(light, torch.zeros(()), ones, 1 / 255, (0, 0), SIZE, position=position, recorded_before=before)
    return path.respond(path.form(signal)).mean


@pytest.mark.parametrize("name", NAMES)
def test_contract(name: str) -> None:
    ideal = seen(LightPath())
    torch.testing.assert_close(seen(LightPath([build(name, 0.0)])), ideal, rtol=1e-5, atol=2e-5)
    effect = build(name, 0.02)
    for parameter in effect.parameters():
        parameter.requires_grad_()
    changed = seen(LightPath([effect]))
    assert (changed - ideal).abs().max() > 1e-4
    changed.square().mean().backward()
    for parameter in effect.parameters():
        assert parameter.grad is not None and torch.isfinite(parameter.grad)
    assert effect.stage in ("modulator", "relay", "exposure", "optics", "sensor") and effect.where


def test_some_numbers_only() -> None:
    few = PatternMixing.of(T * T)(c1=0.5, c6=0.25)
    assert list(few.values) == ["c1", "c6"]
    torch.testing.assert_close(few.coefficients.nonzero()[:, 0], torch.tensor([1, 6]))


def test_by_name_as_an_encoder_file_has_it() -> None:
    mask = RandomStructural(4, T, SIZE, seed=0)
    mixed = Encoder(mask, Ideal(), effects=[PatternMixing(count=T * T, c1=1.0, c0=-1.0, c4=1.0, c5=-1.0)])
    shown, told = mixed.transmittance(), mask()
    torch.testing.assert_close(shown, told[[1, 0, 2, 3]])


def test_a_mask_field_of_one_displacement_is_a_shift() -> None:
    patterns = torch.rand(1, 12, 12)
    fine = patterns.repeat_interleave(2, 1).repeat_interleave(2, 2)
    torch.testing.assert_close(
        MaskField(count=20, c10=1.0).show(fine, cells=2)[:, :, 2:-2],
        MaskField(count=20, c10=2.0).show(fine)[:, :, 2:-2],
    )
    moved = MaskField(count=20, c10=1.0).show(patterns)
    torch.testing.assert_close(moved[..., 1:], patterns[..., :-1], rtol=1e-4, atol=1e-4)


def test_a_ghost_lies_where_it_says() -> None:
    light = torch.zeros(1, *SIZE)
    light[0, 8, 8] = 1.0
    signal = Signal(light, torch.zeros(()), torch.ones(1, 1, 1), 1 / 255, (0, 0), SIZE)
    ghost = Ghost(count=3, c0=0.1, c1=3.0, c2=-2.0).form(signal).mean
    assert ghost[0, 6, 11] == pytest.approx(0.1) and ghost[0, 8, 8] == pytest.approx(0.9)


def test_a_ghost_is_looked_for_where_the_residuals_repeat_the_image() -> None:
    light = torch.rand(2, *SIZE, generator=torch.Generator().manual_seed(1)) - 0.5
    residual = light.roll((-3, 4), (-2, -1))
    first = Ghost.proposals(light, residual, torch.ones_like(light))[0]
    assert {(round(float(start["c1"])), round(float(start["c2"]))) for start in first} == {(4, -3)}
    assert Ghost.scaled(first[0], 2.0) == {**first[0], "c0": 0.04} and Ghost.scaled(first[0], 1e3)["c0"] == 0.5
    assert not PatternMixing.proposals(light, residual, light)  # linear in its numbers


def test_numbers_that_do_not_exist() -> None:
    with pytest.raises(BadInput, match="numbers c0 to c2, not 'c3'"):
        Ghost(count=3, c3=0.1)
    assert not issubclass(FreeForm, MapEffect)
