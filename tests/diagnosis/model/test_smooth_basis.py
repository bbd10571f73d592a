"""Smooth maps: few coordinates, with diagonal information and an even prior."""

from __future__ import annotations

import pytest
import torch

from sci_lightning.diagnosis.model.smooth_basis import MAX_DEGREE, MAX_HALF_PERIODS, SmoothBasis, beyond, polynomials


def test_polynomials_are_orthonormal() -> None:
    functions = polynomials(40)
    torch.testing.assert_close(functions @ functions.T / 40, torch.eye(MAX_DEGREE + 1, dtype=torch.float64))
    torch.testing.assert_close(functions[0], torch.ones(40, dtype=torch.float64))
    assert (functions[1].diff() > 0).all()
    assert [len(polynomials(count)) for count in (1, 2, 3)] == [1, 2, 3]


def test_which_waves_are_smooth() -> None:
    place = (torch.arange(80, dtype=torch.float64) + 0.5) / 80
    for periods, least, most in ((4, 0, 0.001), (MAX_HALF_PERIODS, 0.05, 0.15), (MAX_HALF_PERIODS + 1, 0.5, 1)):
        wave = torch.cos(torch.pi * periods * place)
        rest = wave - (polynomials(80) @ wave / 80) @ polynomials(80)
        assert least < rest.square().mean() / wave.square().mean() < most


@pytest.mark.parametrize("size", [(24, 40), (16, 16), (3, 5), (1, 9), (1, 1)])
def test_coordinates(size: tuple[int, int]) -> None:
    random = torch.Generator().manual_seed(0)
    information = torch.rand(size, generator=random, dtype=torch.float64) + 0.1
    basis = SmoothBasis.of(information, 2.0)
    count = len(basis.functions)
    coordinates = torch.randn(count, generator=random, dtype=torch.float64)
    torch.testing.assert_close(basis.coordinates(basis.spread(coordinates)), coordinates)
    gram = basis.gram(information)
    torch.testing.assert_close(gram, torch.diag(gram.diagonal()), rtol=0, atol=1e-9)
    torch.testing.assert_close(basis.squares(information), gram.diagonal())
    assert float(basis.variance(torch.ones(count, dtype=torch.float64)).mean()) == pytest.approx(1.0 if count else 0.0)
    assert abs(float(basis.spread(coordinates).mean())) < 1e-9


def test_a_slope_is_smooth_and_stripes_are_not() -> None:
    basis = SmoothBasis.of(torch.ones(48, 48), 1.0)
    x = torch.linspace(-1, 1, 48)[None].expand(48, 48).double()
    for smooth in (x, x**2 - (x**2).mean(), x * x.T):
        torch.testing.assert_close(basis.spread(basis.coordinates(smooth)), smooth, rtol=0, atol=2e-3)
    stripes = torch.cos(torch.pi * 12.0 * (torch.arange(48) + 0.5) / 48)[None].expand(48, 48).double()
    assert basis.spread(basis.coordinates(stripes)).square().mean() < 0.2 * stripes.square().mean()
    assert (beyond(48, 48) @ stripes.flatten() / 48**2).square().sum() > 0.9 * stripes.square().mean()
