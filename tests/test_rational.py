"""Rational approximation of surfaces: exact where it can be, best where it cannot, and no poles."""

from __future__ import annotations

import numpy as np
import pytest

from brdfcheck.fits.rational import RationalSurface, best_surface, lower_bound, rows

AXIS = -np.cos(np.pi * np.arange(21) / 20)
U, V = (axis.ravel() for axis in np.meshgrid(AXIS, AXIS, indexing="ij"))


def test_a_rational_function_is_found_again():
    values = (1 + 0.5 * U - 0.25 * U * V + V**2 + U**2) / (2 + 0.5 * U + 0.25 * V)
    best = best_surface(U, V, values, (2, 1))
    surface, error = best.surface, best.error
    assert error <= 1e-9
    u, v = np.random.default_rng(3).uniform(-1, 1, (2, 200))
    expected = (1 + 0.5 * u - 0.25 * u * v + v**2 + u**2) / (2 + 0.5 * u + 0.25 * v)
    assert np.max(np.abs(surface(u, v) - expected)) <= 1e-8  # nine digits of the coefficients
    assert surface.denominator[0, 0] == 1
    assert surface.coefficients == 6 + 2
    assert surface.flops == (2 * (2 + 1) + 2 * 2) + (2 * 1 + 2 * 1) + 1


def test_the_best_polynomial_has_the_classical_error():
    # The best approximation of x^5 by degree 4 errs by 2^-4, of |x| by degree 2 by 1/8, at equal heights.
    v = np.linspace(-1, 1, 2001)
    best = best_surface(0 * v, v, v**5, (4, 0))
    assert best.error == pytest.approx(2**-4, rel=1e-4)
    assert best_surface(0 * v, v, np.abs(v), (2, 0)).error == pytest.approx(1 / 8, rel=1e-4)
    assert best.surface.denominator.size == 1


def test_the_best_rational_function_has_the_known_error():
    # Best (2, 2) rational approximation of |x| on [-1, 1] (Varga, Ruttan & Carpenter 1993): E_2 = 0.0436890...
    v = np.unique(np.concatenate([np.linspace(-1, 1, 801), np.linspace(-0.1, 0.1, 801)]))
    best = best_surface(0 * v, v, np.abs(v), (2, 2))
    assert best.error == pytest.approx(0.0436890, rel=2e-3)
    assert lower_bound(best.surface.denominator) > 0


def test_what_varies_in_no_direction_or_is_zero():
    best = best_surface(U, V, 0 * U, (2, 1))
    assert best.error == 0
    assert np.all(best.surface(U, V) == 0)
    assert rows(best.surface.numerator)


def test_a_start_changes_the_way_and_not_the_end():
    values = np.exp(U + 0.5 * V) / (1.5 + U * V)
    few = (np.arange(len(U)) % 3) == 0
    coarse = best_surface(U[few], V[few], values[few], (3, 2))
    warm, cold = best_surface(U, V, values, (3, 2), start=coarse), best_surface(U, V, values, (3, 2))
    assert coarse.error <= warm.error
    assert warm.error == pytest.approx(cold.error, rel=0.01)
    assert np.max(np.abs(warm.surface(U, V) - values)) == pytest.approx(warm.error, rel=1e-3)


def test_lower_bound():
    random = np.random.default_rng(5)
    for _ in range(30):
        coefficients = random.normal(size=(4, 4))
        coefficients[0, 0] += 8
        smallest = np.min(
            RationalSurface(coefficients, np.ones((1, 1)))(*np.meshgrid(np.linspace(-1, 1, 201), np.linspace(-1, 1, 201)))
        )
        bound = lower_bound(coefficients)
        assert bound <= smallest
        if smallest > 0.5:
            assert bound >= 0.75 * smallest
    assert lower_bound(np.array([[0.0], [0.0], [1.0]])) <= 0  # u^2 has a zero
    assert lower_bound(np.array([[1.0]])) == pytest.approx(1)


def test_bad_input():
    with pytest.raises(ValueError, match="finite; got nan"):
        best_surface(U, V, np.where(U > 0.9, np.nan, U), (1, 0))
    with pytest.raises(ValueError, match="15 coefficients need at least as many points; got 3"):
        best_surface(np.array([0.0, 0.5, 1]), V[:3], U[:3], (3, 2))
