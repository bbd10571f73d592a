"""Every effect against the virtual camera, which shares no code with it: to 0.05 DN of 8 bits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from sci_lightning.encoder.effects import MapEffect
from sci_lightning.virtual_camera import choose_effects
from sci_lightning.virtual_camera.hardware.camera import Camera
from sci_lightning.virtual_camera.hardware.vocabulary import VOCABULARY
from tests.conftest import members
from tests.encoder.effects.conftest import H, T, W, build, encoder, video
from tests.virtual_camera.conftest import SMALL, one_capture

TURNED = {
    "mask_rotation": {"angle": 0.4},
    "mask_distortion": {"k": -0.006},
    "mask_keystone": {"tilt_x": 0.004, "tilt_y": -0.006},
}
"""At 1 degree, taking the footprints of a turned pixel's quarters as upright makes less than 0.1 DN."""
SESSION = replace(SMALL, size=(H, W), frames=T, surround="dark")


HIDDEN = [name for name in members("effect") if name in VOCABULARY]
"""Effects that the virtual camera can hide; a new effect need not be one of them."""


@pytest.mark.parametrize("name", HIDDEN)
def test_mean(name: str) -> None:
    effect = build(name, **TURNED.get(name, {}))
    camera = Camera(SESSION, choose_effects({name: effect.values}, SESSION, 0), 0)
    if isinstance(effect, MapEffect):
        fixed_map = camera.fixed_maps[name] - (name in ("prnu", "illumination"))  # the camera's are 1 + std * map
        effect.map = torch.from_numpy(fixed_map / (1 if name == "hot_pixels" else effect.values["std"])).float()
    if effect.noise:
        effect.respond = lambda signal: signal  # type: ignore[method-assign]  # the mean is what is compared
    ours = encoder(effect, bits=8 if name == "bit_depth" else None)
    taken = one_capture(ours.mask().detach().numpy(), video(1)[0].numpy())
    expected = camera.signal(camera.irradiance(taken), taken)
    if name == "bit_depth":
        expected = camera.convert(expected) / 255
    with torch.no_grad():
        result = ours(video(1)).numpy()
    np.testing.assert_allclose(result * 255, expected * 255, rtol=0, atol=0.05)
