"""The likelihood of snapshots of unknown scenes is that of a Gaussian, and blind to the brightness of the scenes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from sci_lightning.data.reader import find_clips
from sci_lightning.diagnosis.blind.blind_fit import clustered, errors_of
from sci_lightning.diagnosis.blind.candidate_comparison import compare
from sci_lightning.diagnosis.blind.likelihood import BRIGHTNESS, BlindLikelihood
from sci_lightning.diagnosis.blind.prior import CONTRASTS, ScenePrior
from sci_lightning.diagnosis.blind.sensor_response import SensorResponse
from sci_lightning.diagnosis.blind.snapshots import observe_snapshots
from sci_lightning.diagnosis.model.camera_model import CameraModel
from sci_lightning.diagnosis.model.hypothesis import Setting, datasheet_noise
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.encoder.effects import BlackLevel, ReadNoise, ResponseGamma
from sci_lightning.encoder.light_path import LightPath
from tests.diagnosis.blind.smooth_scenes import COUNT, FRAMES, SIZE, likelihood_of, snapshots
from tests.diagnosis.blind.validation import record


def test_a_block_is_gaussian() -> None:
    """With one component at one contrast, the likelihood of a block is that of the multivariate normal distribution."""
    likelihood, ideal = likelihood_of(snapshots())
    one = torch.zeros(len(CONTRASTS), len(likelihood.prior.weights) // len(CONTRASTS))
    one[2, 2] = 1
    nats = likelihood.evaluate(ideal, weights=one.flatten().double()).log_likelihood
    patterns = likelihood.model.observation.patterns.double()
    relative = patterns / patterns.sum(0)[4:-4, 4:-4].mean()
    signal = likelihood.model.observation.dn[1].double() / 255
    brightness = torch.stack([dn[4:-4, 4:-4].double().mean() / 255 for dn in likelihood.model.observation.dn])
    block = slice(8, 16), slice(16, 24)
    matrix = torch.cat([torch.diag(frame[block].flatten()) for frame in relative], 1)
    prior = likelihood.prior.factors()
    factors, rest = prior.factors[:, :, 2].double(), prior.rest[2].double()
    flat = factors.transpose(0, 1).reshape(64 * FRAMES, -1)
    covariance = CONTRASTS[2] * matrix @ (flat @ flat.T + torch.diag(rest.flatten())) @ matrix.T
    response = SensorResponse.of(likelihood.model.path(ideal), 255)
    noise = response.noise(matrix.sum(1) * brightness.mean()) / brightness.mean() ** 2
    even = matrix.sum(1)
    covariance += torch.diag(noise) + BRIGHTNESS * even[:, None] * even
    normal = torch.distributions.MultivariateNormal(even, covariance)
    expected = normal.log_prob(signal[block].flatten() / brightness[1]) - 64 * brightness[1].log()
    assert float(nats[4 + 2, 1]) == pytest.approx(float(expected), abs=1e-3)


def test_places_differ_in_contrast(shared_data: Path) -> None:
    """Snapshots of real clips behind a known camera are likelier if the prior knows several contrasts."""
    captures, _ = record(find_clips(shared_data / "val"), "none", side=48, seed=5)
    nats = []
    for contrasts in (CONTRASTS, (1.0,)):
        observation = observe_snapshots(captures)
        likelihood = BlindLikelihood(
            CameraModel(observation, vocabulary(), {}), ScenePrior(observation.frames, contrasts=contrasts)
        )
        assert float(likelihood.prior.weights.sum()) == pytest.approx(1)
        nats.append(float(likelihood.evaluate(datasheet_noise(observation)[0]).log_likelihood.nanmean()))
    assert nats[0] > nats[1] + 2


def test_brightness_cannot_be_told_and_says_nothing() -> None:
    likelihood, ideal = likelihood_of(snapshots())
    reference = likelihood.evaluate(ideal).log_likelihood
    other = likelihood.evaluate(ideal.with_effect("duty_cycle", {"fraction": 0.7})).log_likelihood
    assert torch.allclose(other, reference, atol=1e-6)
    wrong = likelihood.evaluate(ideal.with_effect("mask_orientation", {"operation": "flip_lr"})).log_likelihood
    assert float((reference - wrong).nansum()) > 100


@pytest.mark.parametrize(
    ("name", "parameter", "much"), [("black_level", "offset", 0.1), ("veiling_glare", "fraction", 0.2)]
)
def test_only_the_mask_tells_light_that_is_everywhere(name: str, parameter: str, much: float) -> None:
    """Even light has no image of the mask. Behind patterns whose sum is even nothing tells it from a brighter scene.

    What textures scenes have at which brightness is known only roughly, so that it must not tell either.
    """
    captures = snapshots(brightness=0.7)
    even = captures.patterns.copy()
    even[-1] = 2 - even[:-1].sum(0)  # as the slots of a structural mask
    differences = []
    for patterns in (captures.patterns, even):
        dn = captures.measurement
        if patterns is even:
            still = np.random.default_rng(1).uniform(0.4, 0.5, (COUNT, 1, SIZE // 4, SIZE // 4))
            scene = still.repeat(4, 2).repeat(4, 3)
            dn = np.floor(255 * 0.7 / 2 * (even * scene).sum(1) + 0.5).astype(np.uint8)
        likelihood, ideal = likelihood_of(replace(captures, patterns=patterns, measurement=dn))
        hypotheses = [ideal.with_effect(name, {parameter: value}) for value in (1e-6, much)]
        nats = [likelihood.evaluate(one).log_likelihood for one in hypotheses]
        differences.append(float((nats[0] - nats[1]).nansum()))
    assert differences[0] > 50
    assert abs(differences[1]) < 0.5


def test_nothing_is_known_better_than_by_a_right_prior() -> None:
    """Where snapshots say little their scores do not differ, which does not make them precise."""
    information = torch.tensor([[4.0, 1.0], [1.0, 2.0]]).double()
    much, nothing = 9 * information, torch.zeros(2, 2).double()
    assert torch.allclose(errors_of(information, much), 9 * information.inverse())
    assert torch.allclose(errors_of(information, nothing), information.inverse())


def test_blocks_at_the_edge_do_not_count() -> None:
    likelihood, ideal = likelihood_of(snapshots())
    counted = likelihood.evaluate(ideal.with_effect("mask_shift", {"dx": 1.2, "dy": 0.0})).log_likelihood.isfinite()
    assert not counted[::4].any() and counted[1::4].all()


@pytest.mark.parametrize("sigma", [0.0, 0.4, 1.4])
@pytest.mark.parametrize("optics", [{}, {"optical_blur": {"sigma": 0.5}}])
def test_a_block_does_not_depend_on_which_others_are_asked_for(optics: dict[str, Setting], sigma: float) -> None:
    """The image of a turned mask is computed where it is asked for; what a block is worth is the same everywhere."""
    likelihood, ideal = likelihood_of(snapshots())
    turned = {"mask_rotation": {"angle": 0.5}, "mask_blur": {"sigma": sigma}, "mask_shift": {"dx": 0.3, "dy": 0.1}}
    for name, setting in {**turned, **optics}.items():
        ideal = ideal.with_effect(name, setting)
    blocks = torch.zeros(16, dtype=torch.bool)
    blocks[[5, 10]] = True
    shares = likelihood.evaluate(ideal).weights
    whole = likelihood.evaluate(ideal, weights=shares).log_likelihood
    some = likelihood.evaluate(ideal, blocks, shares).log_likelihood
    assert whole[blocks].isfinite().any()
    assert torch.equal(whole[blocks].isfinite(), some[blocks].isfinite())
    assert torch.allclose(whole[blocks].nan_to_num(0.0), some[blocks].nan_to_num(0.0), rtol=1e-4)  # single precision


def test_light_is_never_negative() -> None:
    """The darkest pixels of these snapshots have no light; one pixel is a defect."""
    captures = snapshots(brightness=0.5)
    dn = captures.measurement + 20
    dn[-1, 0, 0] = 3
    likelihood, ideal = likelihood_of(replace(captures, measurement=dn))
    offsets = {20: 0.0, 21: 1.0, 26: 6.0}  # read noise is 1 DN, and rounding adds a little
    for level, expected in offsets.items():
        black = ideal.with_effect("black_level", {"offset": level / 255})
        assert likelihood.below_no_light(black) == pytest.approx(expected, abs=1.0)
    levels = [likelihood.below_no_light(ideal.with_effect("veiling_glare", {"fraction": part})) for part in (0, 0.5)]
    assert levels[0] < -10 and levels[1] > 4
    assert likelihood.below_no_light(ideal.with_effect("optical_blur", {"sigma": 2.0})) < -10


def test_the_response_is_inverted() -> None:
    light = torch.linspace(0.02, 0.9, 50).double()
    path = LightPath([ReadNoise(std=2.0), ResponseGamma(gamma=0.8), BlackLevel(offset=0.03)])
    response = SensorResponse.of(path, 255)
    inverse, log_slope = response.light(light**0.8 + 0.03)
    assert torch.allclose(inverse, light, atol=1e-4)
    assert torch.allclose(log_slope[5:].exp(), (0.8 * light**-0.2)[5:], rtol=0.02)
    assert torch.allclose(
        response.noise(light).sqrt()[5:] * log_slope[5:].exp() * 255, torch.tensor(2.02).double(), rtol=0.02
    )


def test_the_likelihood_of_a_response_is_smooth() -> None:
    """Errors follow from second differences of the likelihood, which must not depend on how far they reach."""
    likelihood, ideal = likelihood_of(snapshots())

    def nats(effect: str, parameter: str, value: float) -> torch.Tensor:
        return likelihood.evaluate(ideal.with_effect(effect, {parameter: value}), weights=weights).log_likelihood

    weights = likelihood.evaluate(ideal).weights
    for effect, parameter, value in (("black_level", "offset", 0.02), ("response_gamma", "gamma", 0.9)):
        middle, curvatures = nats(effect, parameter, value), []
        for step in (0.001, 0.002, 0.004):
            around = nats(effect, parameter, value + step) + nats(effect, parameter, value - step)
            curvatures.append(float((around - 2 * middle).nansum()) / step**2)
        assert max(curvatures) - min(curvatures) < 0.05 * abs(curvatures[-1]), (effect, curvatures)


def test_nats_are_calibrated_by_how_much_snapshots_agree() -> None:
    random = torch.Generator().manual_seed(0)
    noise = torch.randn(64, 8, generator=random, dtype=torch.float64)
    zero = torch.zeros(64, 8, dtype=torch.float64)
    sure = compare(0.5 + noise, zero, 8)
    assert sure.z > 5 and sure.agree == sure.snapshots == 8 and sure.p_value < 1e-3
    doubtful = compare(0.5 + noise + 3 * torch.randn(1, 8, generator=random, dtype=torch.float64), zero, 8)
    assert doubtful.calibrated < 0.2 * sure.calibrated and doubtful.p_value > 1e-3
    one = compare(0.5 + noise[:, :1], zero[:, :1], 8)
    assert one.snapshots == 1 and one.z < sure.z
    assert clustered(torch.stack([noise, noise]), 8).shape == (2, 2)


def test_components_that_explain_nothing_are_left_out() -> None:
    """What the likely components say of a block is next to all, and is the same when only they are computed."""
    likelihood, ideal = likelihood_of(snapshots())
    whole = likelihood.evaluate(ideal)
    assert 0 < int(whole.likely.sum()) < whole.likely.numel() / 2
    assert float((whole.log_likelihood - whole.by_likely).nan_to_num().abs().max()) < 0.05
    again = likelihood.evaluate(ideal, weights=whole.weights, likely=whole.likely)
    assert torch.equal(again.log_likelihood.nan_to_num(), whole.by_likely.nan_to_num())
