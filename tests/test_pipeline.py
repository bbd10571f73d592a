"""Encoder, decoder and camera model as one plain module."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.decoder import E2ECNN
from sci_lightning.encoder import Encoder
from sci_lightning.encoder.effects import Gain, MaskShift, OpticalBlur
from sci_lightning.encoder.mask import RandomBinary
from sci_lightning.encoder.sensor import Ideal
from sci_lightning.pipeline import Pipeline
from sci_lightning.training.system import System


@pytest.fixture
def encoder() -> Encoder:
    effects = [MaskShift(dx=0.4), OpticalBlur(sigma=0.5), Gain(factor=0.8)]
    return Encoder(RandomBinary(4, (16, 16), seed=1), Ideal(), 0.5, effects)


@pytest.fixture
def decoder() -> E2ECNN:
    return E2ECNN(frames=4, channels=4, blocks=1).eval()


@torch.no_grad()
def test_is_what_a_notebook_would_write(encoder: Encoder, decoder: E2ECNN) -> None:
    video = torch.rand(2, 4, 16, 16)
    linear = encoder.linearise(encoder(video)) / 0.5
    expected = decoder(linear, encoder.decoder_mask(encoder.transmittance()))
    assert torch.equal(Pipeline(encoder, decoder)(video), expected)
    assert torch.equal(System(encoder, decoder)(video), expected)


@torch.no_grad()
def test_a_window_of_the_field(encoder: Encoder, decoder: E2ECNN) -> None:
    pipeline, video, q = Pipeline(encoder, decoder), torch.rand(1, 4, 8, 8), encoder.path.cells
    assert q > 1
    window = encoder.transmittance()[:, 3 * q : 11 * q, 5 * q : 13 * q]
    assert pipeline(video, window, (3, 5)).shape == video.shape


@torch.no_grad()
def test_the_decoder_believes_in_the_camera(encoder: Encoder, decoder: E2ECNN) -> None:
    camera, video = Encoder(RandomBinary(4, (16, 16), seed=1), Ideal(), 0.5), torch.rand(2, 4, 16, 16)
    pipeline = Pipeline(encoder, decoder, camera)
    assert torch.equal(pipeline.decoder_mask(), camera.mask())
    assert torch.equal(pipeline(video), decoder(encoder(video).recorded() / 0.5, camera.mask()))
    each = torch.tensor([0.5, 0.25])
    recorded = encoder(video).recorded()
    halved = pipeline.linearise(recorded, each).linear()
    assert torch.equal(halved[0], recorded[0] / 0.5) and torch.equal(halved[1], recorded[1] / 0.25)


def test_checkpoints_hold_every_parameter_once(encoder: Encoder, decoder: E2ECNN) -> None:
    system = System(encoder, decoder)
    system(torch.rand(1, 4, 16, 16))
    assert {key.split(".")[0] for key in system.state_dict()} == {"encoder", "decoder"}
