"""What a search in snapshots of unknown scenes considers."""

from __future__ import annotations

from sci_lightning.diagnosis.blind.undetermined import determined_effects
from tests.diagnosis.blind.smooth_scenes import likelihood_of, snapshots


def test_what_every_camera_has_is_no_name() -> None:
    likelihood, _ = likelihood_of(snapshots())
    considered = determined_effects(likelihood.model)
    assert "mask_shift" in considered
    assert not [name for name, effect in considered.items() if effect.imperfection or effect.noise]
    assert likelihood.model.vocabulary["fill_factor"].imperfection
