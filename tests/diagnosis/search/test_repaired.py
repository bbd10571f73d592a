"""Cases of the proving ground in which a diagnosis was once wrong, and why."""

from __future__ import annotations

import pytest

from sci_lightning.diagnosis.diagnosis import diagnose
from sci_lightning.virtual_camera import Session, VirtualCamera

SIZE = (64, 64)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effects", "session", "seed"),
    [
        pytest.param(
            ("scene_shift",), Session(size=SIZE, frames=16, bit_depth=11, mask="binary"), 560412843, id="negative light"
        ),
        pytest.param(
            ("mask_orientation",), Session(size=SIZE, frames=4, bit_depth=12), 529809000, id="a blur promised more"
        ),
        pytest.param(
            ("illumination",),
            Session(size=SIZE, frames=4, bit_depth=9),
            1915465077,
            id="slopes at the edges of a smooth map",
        ),
        pytest.param(
            ("mask_distortion", "read_noise"), Session(size=SIZE, bit_depth=9), 2808321267, id="a footprint that leans"
        ),
        pytest.param(
            ("rolling_shutter", "gain"),
            Session(size=SIZE, frames=4, bit_depth=12, mask="binary", datasheet_factor=2.0),
            994678407,
            id="a plainer effect in exchange",
        ),
        pytest.param(
            ("scene_rotation", "scene_shift", "response_gamma"),
            Session(size=SIZE, frames=4, mask="binary"),
            309580546,
            id="a right name that alone predicts worse",
        ),
        pytest.param(
            ("shot_noise", "black_level", "column_noise"),
            Session(size=SIZE, frames=16, bit_depth=10, mask="binary"),
            2483632698,
            id="columns that share a black level",
        ),
    ],
)
def test_exactly_what_is_hidden_is_named(effects: tuple[str, ...], session: Session, seed: int) -> None:
    simulation = VirtualCamera(session, effects, magnitude="clear").simulate(seed)
    result = diagnose(simulation.captures())
    noise = {"shot_noise", "read_noise"} if session.datasheet_factor != 1 else set()  # the datasheet is wrong
    assert set(result.names) - (noise - set(effects)) == set(effects) and result.verdict == "explained"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "session", "seed", "datasheet"),
    [
        ("mask_keystone", Session(size=SIZE, bit_depth=9), 1268607181, True),
        ("scene_scale", Session(size=SIZE, bit_depth=12, mask="binary", datasheet_factor=2.0), 2619485472, False),
        ("mask_shift", Session(size=SIZE, bit_depth=11), 841742160, True),
    ],
)
def test_what_is_smaller_than_its_formula_is_exact_has_no_name(
    effect: str, session: Session, seed: int, datasheet: bool
) -> None:
    """A displacement of 0.0003 pixel gains 31 nats, and has no evidence: nobody's formula is that exact."""
    result = diagnose(VirtualCamera(session, (effect,), magnitude="weak").simulate(seed).captures())
    assert set(result.names) == (set() if datasheet else {"shot_noise", "read_noise"}) and not result.unnamed
    assert result.verdict == ("consistent" if datasheet else "explained")


@pytest.mark.slow
@pytest.mark.xfail(strict=True, reason="clusters disagree about a step of one DN: unexplained")
def test_a_level_one_dn_below_full_scale_is_named() -> None:
    session = Session(size=SIZE, frames=4, bit_depth=12, mask="binary", datasheet=False)
    result = diagnose(VirtualCamera(session, ("saturation",), magnitude="weak").simulate(1643175495).captures())
    assert "saturation" in result.names and result.verdict == "explained"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("effect", "session", "seed", "stage"),
    [
        pytest.param(
            "image_lag",
            Session(size=SIZE, bit_depth=11, datasheet_factor=2.0),
            1725002458,
            "sensor",
            id="what precedes a capture was kept for verification",
        ),
        pytest.param(
            "mask_drift",
            Session(size=SIZE, bit_depth=12, datasheet=False),
            1014977920,
            "relay",
            id="a name that is withdrawn leaves a place",
            marks=pytest.mark.xfail(strict=True, reason="the stage is right, and phased_reset is named"),
        ),
    ],
)
def test_what_has_no_name_has_a_stage(effect: str, session: Session, seed: int, stage: str) -> None:
    result = diagnose(VirtualCamera(session, (effect,), magnitude="clear").simulate(seed).captures())
    strongest = max(result.unnamed, key=lambda deviation: deviation.nats)
    assert not result.names and result.verdict == "unexplained" and strongest.stage == stage
