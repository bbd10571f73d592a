"""Maps are solved together as one dense system would be, and judged by what their names promise."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from sci_lightning.diagnosis.diagnosis import diagnose
from sci_lightning.diagnosis.model.fixed_pattern_map import CENTRING_INFORMATION_RATIO, FixedPatternMap
from sci_lightning.diagnosis.model.map_system import MapSystem
from sci_lightning.diagnosis.search.map_test import has_mean, map_p_value
from sci_lightning.diagnosis.vocabulary import vocabulary
from sci_lightning.virtual_camera import Session, VirtualCamera

N, H, W = 3, 4, 5
SHAPES = {"pixel": (H, W), "row": (H, 1), "column": (1, W)}


def fixed_pattern(kind: str, seed: int, shape: tuple[int, int] | None = None) -> FixedPatternMap:
    random = torch.Generator().manual_seed(seed)
    size = shape or SHAPES[kind]
    values = torch.randn(size, generator=random, dtype=torch.float64)
    jacobian = 0.5 + torch.rand(N, H, W, generator=random, dtype=torch.float64)
    ones, centred = torch.ones_like(values), kind == "row"
    return FixedPatternMap(kind, kind, values, jacobian, values * 0, ones, 0.7, 0.1, 0.0, 0.0, centred=centred)


@pytest.mark.parametrize(
    "kinds", [("row",), ("row", "column"), ("pixel", "pixel"), ("column", "pixel", "row"), ("row", "row", "column")]
)
def test_as_one_dense_system(kinds: tuple[str, ...]) -> None:
    weight = 0.5 + torch.rand(N, H, W, generator=torch.Generator().manual_seed(9), dtype=torch.float64)
    maps = []
    for seed, kind in enumerate(kinds):
        each = fixed_pattern(kind, seed)
        own = each.gather(each.jacobian.square() * weight)
        maps.append(replace(each, likelihood_information=own))
    system = MapSystem(maps, weight)
    columns = []  # derivative of the mean by every value of every map
    for each in system.maps:
        for index in range(each.values.numel()):
            one = torch.zeros(each.values.numel(), dtype=torch.float64)
            one[index] = 1
            columns.append((each.jacobian * one.view(each.values.shape)).flatten())
    design = torch.stack(columns)
    dense = design * weight.flatten() @ design.T + torch.eye(len(design)) / 0.7**2
    for each, part in zip(
        system.maps, torch.arange(len(design)).split([m.values.numel() for m in system.maps]), strict=True
    ):
        if each.centred:
            dense[part[:, None], part] += CENTRING_INFORMATION_RATIO * each.precision.mean()
    right = torch.randn(2, len(design), dtype=torch.float64, generator=torch.Generator().manual_seed(5))
    torch.testing.assert_close(system.solve(right), torch.linalg.solve(dense, right.T).T)


def test_columns_leave_to_a_black_level_what_all_pixels_share() -> None:
    hidden = {"black_level": {"offset": 0.03}, "column_noise": {"std": 0.004}}
    names = ("black_level", "column_noise", "row_noise", "gain", "shot_noise", "read_noise")
    captures = VirtualCamera(Session(size=(64, 64)), hidden).capture(3)
    result = diagnose(captures, {name: vocabulary()[name] for name in names})
    assert set(result.names) == set(hidden) and result.verdict == "explained"
    found = {effect.name: effect for effect in result.effects}
    assert abs(float(result.after.fit.hypothesis.maps["column_noise"].mean())) < 1e-6
    assert abs(float(found["black_level"].parameters["offset"].value) - 0.03) < 1e-3
    assert 0.002 < float(found["column_noise"].parameters["std"].value) < 0.006


def estimated(values: torch.Tensor) -> FixedPatternMap:
    weight = torch.full_like(values, 100.0)
    return FixedPatternMap("map", "pixel", values, values, values * 0, weight, float(values.std()), 0.1, 0.0, 0.0)


def test_white_maps_pass_and_others_do_not() -> None:
    random = torch.Generator().manual_seed(0)
    p_values = [map_p_value(estimated(torch.randn(48, 48, generator=random, dtype=torch.float64))) for _ in range(20)]
    assert min(p_values) > 1e-3
    white = torch.randn(48, 48, generator=random, dtype=torch.float64)
    smooth = torch.nn.functional.avg_pool2d(white[None], 5, 1, 2)[0]
    spots = white.clone()
    spots[10, 10:14] -= 12
    rows = white + torch.tensor([0.5, -0.5], dtype=torch.float64).repeat(24)[:, None]
    for unlike in (smooth, spots, rows):
        assert map_p_value(estimated(unlike)) < 1e-5


def test_in_a_laboratory_a_little_structure_is_no_contradiction() -> None:
    """What the targets' errors leave in a map; a map that is mostly structure is none of its effect there, either."""
    random = torch.Generator().manual_seed(3)
    white = torch.randn(48, 48, generator=random, dtype=torch.float64)
    wave = torch.sin(torch.arange(48, dtype=torch.float64) / 4)[:, None].expand(48, 48)
    little, much = estimated(white + 0.35 * wave), estimated(white + 2 * wave)
    assert map_p_value(little) < 1e-5 and map_p_value(little, in_laboratory=True) == 1.0
    assert map_p_value(much, in_laboratory=True) < 1e-5
    stuck = white.clone()
    stuck.flatten()[::60] = 12.0
    assert map_p_value(estimated(stuck), in_laboratory=True) < 1e-5


def test_columns_that_share_an_offset() -> None:
    """It is a black level, which has its own name; so many columns have a mean of an eighth of their deviation."""
    columns = torch.randn(1, 64, generator=torch.Generator().manual_seed(5), dtype=torch.float64)
    assert not has_mean(replace(estimated(columns), kind="column"))
    assert has_mean(replace(estimated(columns + 1.5), kind="column"))
    assert not has_mean(estimated(columns + 1.5)) and not has_mean(replace(estimated(columns[:, :8] + 9), kind="row"))


def test_a_trend_over_few_columns_is_none_of_chance() -> None:
    """So few columns may be left of a small field whose surround is unknown: light that leaks in fades smoothly."""
    random = torch.Generator().manual_seed(0)
    white = [torch.randn(1, 12, generator=random, dtype=torch.float64) for _ in range(20)]
    assert min(map_p_value(replace(estimated(values), kind="column")) for values in white) > 1e-3
    fading = torch.exp(-torch.linspace(1, 3, 12, dtype=torch.float64))[None] * 10 + 0.05 * white[0]
    assert map_p_value(replace(estimated(fading), kind="column")) < 1e-5


def test_information_of_which_rounding_leaves_less_than_nothing() -> None:
    """Two maps of columns that do the same, the whole of which a map of pixels can take over."""
    weight = torch.full((N, H, W), 1e12, dtype=torch.float64)
    pixel = replace(fixed_pattern("pixel", 0), std=1e6)
    same = replace(fixed_pattern("column", 1), jacobian=pixel.jacobian, std=1e6)
    maps = [replace(one, likelihood_information=one.gather(one.jacobian.square() * weight)) for one in (pixel, same)]
    system = MapSystem([*maps, maps[1]], weight)
    assert system.solve(torch.ones(1, H * W + 2 * W, dtype=torch.float64)).isfinite().all()
