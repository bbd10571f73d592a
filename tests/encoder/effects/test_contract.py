"""The contract of every effect in the configuration: found by listing conf/effect."""

from __future__ import annotations

from string import Formatter

import pytest
import torch

from sci_lightning.encoder.effects import Effect, Parameter, SensorEffect
from sci_lightning.encoder.effects.stage import STAGES
from sci_lightning.errors import BadInput
from tests.conftest import members
from tests.encoder.effects.conftest import T, build, configured, encoder, video

NAMES = members("effect")
NONLOCAL = {"optical_blur", "field_blur", "veiling_glare"}
"""Effects that bring light from beyond a window's border."""
SHOWN_BY = {"fill_factor": {"mask_shift": {"dx": 0.3, "dy": 0.2}}}
"""Effects that do nothing by themselves, and those beside which they show."""


def agrees(value: object) -> object:
    return pytest.approx(value) if isinstance(value, float) else value


def neutral(name: str) -> Effect:
    about = build(name).about
    return build(name, **{key: each.neutral for key, each in about.items() if each.neutral is not None})


def shown_by(name: str) -> list[Effect]:
    return [build(other, **values) for other, values in SHOWN_BY.get(name, {}).items()]


def bits(*effects: Effect) -> int:
    return 8 if any(effect.name == "bit_depth" for effect in effects) else 16


def recorded(*effects: Effect) -> torch.Tensor:
    torch.manual_seed(0)
    return encoder(*effects, bits=bits(*effects)).eval()(video())


@pytest.mark.parametrize("name", NAMES)
def test_facts(name: str) -> None:
    effect = build(name)
    assert effect.name == name == type(effect).__module__.rpartition(".")[2]
    assert isinstance(effect, STAGES[effect.stage]) and type(effect).__module__.split(".")[-2] == effect.stage
    assert list(STAGES).index(effect.stage) + 1 == min(effect.rank // 10, 5)
    assert type(effect).__doc__
    for about in effect.about.values():
        assert about.choices or (about.unit and about.low < about.high < float("inf") and about.step > 0)
        assert about.choices or about.starts
    assert any(about.neutral is not None for about in effect.about.values())
    assert effect.values == {key: agrees(configured(name)[key]) for key in effect.about}
    for start in effect.starts(T, (18, 18), 8):
        assert build(name, **start).values == {key: agrees(value) for key, value in start.items()}


@pytest.mark.parametrize("name", NAMES)
def test_a_report_says_in_words_what_it_does(name: str) -> None:
    effect = type(build(name))
    parameters = {field for _, field, _, _ in Formatter().parse(effect.sentence) if field}
    assert parameters == set(effect.about) - {"phase"}  # a phase tells people nothing
    assert effect.describe(dict.fromkeys(effect.about, "1.5")).count("1.5") == len(parameters)


def test_an_effect_without_a_sentence_lists_its_parameters() -> None:
    class Scratch(SensorEffect):
        name = "scratch"
        about = {"depth": Parameter("1", 0.0, 0, 1), "width": Parameter("pixel", 0.0, 0, 9)}

    assert Scratch.describe({"depth": "0.20 ± 0.01", "width": "3.0"}) == "scratch (depth 0.20 ± 0.01, width 3.0 pixel)"


@pytest.mark.parametrize("name", NAMES)
def test_acts_and_is_the_identity_when_neutral(name: str) -> None:
    if name == "bit_depth":
        assert (
            len(recorded(build(name)).unique()) <= 2 ** configured(name)["bits"] < len(recorded(neutral(name)).unique())
        )
        assert torch.equal(recorded(neutral(name)), encoder(bits=8)(video()))
        return
    beside = shown_by(name)
    ideal = encoder(*beside)(video())
    torch.manual_seed(0)
    assert (encoder(*beside, build(name))(video()) - ideal).abs().max() > 1 / 255
    torch.testing.assert_close(encoder(*beside, neutral(name))(video()), ideal, rtol=0, atol=1e-6)


@pytest.mark.parametrize("name", NAMES)
def test_what_it_refuses(name: str) -> None:
    with pytest.raises(BadInput, match=f"{name} has no parameter 'nothing'"):
        build(name, nothing=1)
    for key, about in build(name).about.items():
        for value in ("no", None, *(() if about.choices else (about.low - 1, about.high * 2 + 1, float("nan")))):
            with pytest.raises(BadInput, match=f"{name}.{key} must be"):
                build(name, **{key: value})


@pytest.mark.parametrize("at_neutral", [False, True])
@pytest.mark.parametrize("name", NAMES)
def test_gradients(name: str, at_neutral: bool) -> None:
    effect = (neutral if at_neutral else build)(name).requires_grad_(True)
    camera = encoder(*shown_by(name), effect, bits=bits(effect))
    scene = video().requires_grad_(True)
    measurement = camera(scene)
    (measurement.square().sum() + camera.linearise(measurement).square().sum()).backward()
    for tensor in (scene, camera.mask.pattern):
        assert tensor.grad is not None and torch.isfinite(tensor.grad).all() and tensor.grad.any()
    for parameter in effect.parameters():
        assert parameter.grad is None or torch.isfinite(parameter.grad).all()
    without = {"hot_pixels", "bit_depth", "pattern_order", "mask_orientation", "bit_planes"}  # a map, choices
    if not at_neutral and name not in without:
        assert all(parameter.grad is not None and parameter.grad.any() for parameter in effect.parameters())


@pytest.mark.slow
@pytest.mark.parametrize("first", NAMES)
def test_combines_with_every_other_in_any_order(first: str) -> None:
    for second in NAMES[NAMES.index(first) + 1 :]:
        one, other = build(first), build(second)
        measurement = recorded(one, other)
        assert torch.isfinite(measurement).all(), second
        assert 0 <= measurement.min() <= measurement.max() <= 1
        assert torch.equal(measurement, recorded(other, one)), second


def test_all_together() -> None:
    given = [build(name) for name in NAMES]
    assert torch.isfinite(recorded(*given)).all()
    assert torch.equal(recorded(*given), recorded(*given[::-1]))


@pytest.mark.parametrize("name", NAMES)
def test_window(name: str) -> None:
    """A window is recorded as the whole is, but where light crosses its border."""
    effect = build(name)
    camera = encoder(effect) if name != "bit_depth" else encoder(effect, bits=8)
    if effect.noise:
        effect.respond = lambda signal: signal  # type: ignore[method-assign]  # drawn anew for every size
    whole, mask = camera(video()), camera.transmittance()
    part = camera.record(video()[..., 4:16, 2:14], mask[:, 4:16, 2:14], origin=(4, 2))
    expected = whole[:, 4:16, 2:14]
    if name in ("optical_blur", "field_blur"):
        part, expected = part[:, 4:-4, 4:-4], expected[:, 4:-4, 4:-4]
    torch.testing.assert_close(part, expected, rtol=0, atol=0.05 if name == "veiling_glare" else 1e-6)
    if name not in NONLOCAL:
        linear = camera.linearise(whole)[:, 4:16, 2:14]
        torch.testing.assert_close(camera.linearise(part, origin=(4, 2)), linear, rtol=0, atol=1e-5)


def test_window_in_cells() -> None:
    camera = encoder(build("mask_shift"), build("optical_blur"))
    assert camera.path.cells > 1
    q, mask = camera.path.cells, camera.transmittance()
    assert mask.shape == (T, 18 * q, 18 * q) and camera.decoder_mask(mask).shape == (T, 18, 18)
    window = mask[:, 4 * q : 16 * q, 2 * q : 14 * q]
    part = camera.record(video()[..., 4:16, 2:14], window, origin=(4, 2))
    torch.testing.assert_close(part[:, 3:-3, 3:-3], camera(video())[:, 7:13, 5:11], rtol=0, atol=1e-5)
    shifted = encoder(build("mask_shift")).transmittance()
    torch.testing.assert_close(camera.decoder_mask(mask), shifted, rtol=0, atol=1e-6)
