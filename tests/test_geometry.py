"""Angles between directions, against exact rational arithmetic on the very numbers that are passed in."""

from __future__ import annotations

from decimal import Decimal, localcontext

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import shared

from brdfcheck.geometry import above_horizon, direction, half_cosine, half_versine, mirror_direction, mirror_versine


def random_directions(count: int, seed: int) -> np.ndarray:
    """Unit vectors of the upper hemisphere, a third of them within 1e-4 of the horizon or of the normal."""
    random = np.random.default_rng(seed)
    cosine = random.uniform(0, 1, count)
    cosine[::3] = 10 ** random.uniform(-9, -4, cosine[::3].size)
    cosine[1::6] = 1 - 10 ** random.uniform(-12, -4, cosine[1::6].size)
    return shared.direction(cosine, random.uniform(0, 2 * np.pi, count))


def near_mirror(wi: np.ndarray, seed: int) -> np.ndarray:
    """The mirror directions, moved by 1e-9 to 1e-2."""
    random = np.random.default_rng(seed)
    moved = wi * [-1, -1, 1] + 10 ** random.uniform(-9, -2, (len(wi), 1)) * random.normal(size=wi.shape)
    moved[:, 2] = np.abs(moved[:, 2])
    return moved / np.linalg.norm(moved, axis=-1, keepdims=True)


def exact(wi: np.ndarray, wo: np.ndarray) -> tuple[float, float, float]:
    """(|R - V|^2 / 2, 1 - N.H, |L + V| / 2) with 80 digits."""
    with localcontext() as context:
        context.prec = 80
        a, b = ([Decimal(float(x)) for x in w] for w in (wi, wo))
        mirror = ((-a[0] - b[0]) ** 2 + (-a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2) / 2
        h = [x + y for x, y in zip(a, b, strict=True)]
        length = sum(x * x for x in h).sqrt()
        return float(mirror), float(1 - h[2] / length), float(length / 2)


@pytest.mark.parametrize("kind", ["anywhere", "near the mirror direction"])
def test_versines_keep_all_digits(kind):
    wi = random_directions(120, 1)
    wo = random_directions(120, 2) if kind == "anywhere" else near_mirror(wi, 3)
    expected = np.array([exact(a, b) for a, b in zip(wi, wo, strict=True)])
    np.testing.assert_allclose(mirror_versine(wi, wo), expected[:, 0], rtol=1e-14)
    np.testing.assert_allclose(half_versine(wi, wo), expected[:, 1], rtol=1e-14)
    np.testing.assert_allclose(half_cosine(wi, wo), expected[:, 2], rtol=1e-14)


@pytest.mark.parametrize("angle", [1e-9, 1e-7, 1e-4, 0.1, 1.0, 1.5])
def test_small_angles_from_the_normal(angle):
    # arccos(1 - 5e-19) is 0; the versine of the half-vector's angle, angle / 2, is not.
    wi = np.array([0.0, 0.0, 1.0])
    wo = np.array([np.sin(angle), 0.0, np.cos(angle)])
    assert float(mirror_versine(wi, wo)) == pytest.approx(2 * np.sin(angle / 2) ** 2, rel=1e-14)
    assert float(half_versine(wi, wo)) == pytest.approx(2 * np.sin(angle / 4) ** 2, rel=1e-14)
    assert float(half_cosine(wi, wo)) == pytest.approx(np.cos(angle / 2), rel=1e-14)
    if angle >= 0.1:
        assert np.arccos(1 - float(mirror_versine(wi, wo))) == pytest.approx(angle, rel=1e-12)


def test_float32_keeps_small_angles():
    wi = jnp.asarray([0.0, 0.0, 1.0], jnp.float32)
    wo = jnp.asarray([1e-4, 0.0, 1.0], jnp.float32)
    assert mirror_versine(wi, wo).dtype == half_versine(wi, wo).dtype == jnp.float32
    assert float(mirror_versine(wi, wo)) == pytest.approx(5e-9, rel=1e-6)
    assert float(half_versine(wi, wo)) == pytest.approx(1.25e-9, rel=1e-6)


@pytest.mark.parametrize("cosine", [0.0, 1e-300, 1e-17])
def test_opposite_directions_along_the_surface(cosine):
    wi, wo = np.array([1.0, 0.0, cosine]), np.array([-1.0, 0.0, cosine])
    assert half_versine(wi, wo) == 0
    assert half_cosine(wi, wo) == pytest.approx(cosine, abs=1e-15)
    gradients = jax.grad(lambda a, b: half_versine(a, b) + half_cosine(a, b) + mirror_versine(a, b), (0, 1))(wi, wo)
    assert np.all(np.isfinite(gradients))


def test_ranges_and_symmetry():
    wi, wo = random_directions(600, 4), random_directions(600, 5)
    for function, top in ((mirror_versine, 2), (half_versine, 1), (half_cosine, 1)):
        value = np.asarray(function(wi, wo))
        assert np.all((value >= 0) & (value <= top + 1e-15))
        np.testing.assert_allclose(function(wo, wi), value, rtol=1e-15)


def test_mirror_direction_is_twice_the_projection_minus_the_light():
    wi = random_directions(50, 6)
    normal = np.array([0.0, 0.0, 1.0])
    np.testing.assert_allclose(mirror_direction(jnp.asarray(wi)), 2 * wi[:, 2:] * normal - wi, atol=1e-16)
    assert mirror_direction(jnp.ones(3, jnp.float32)).dtype == jnp.float32


def test_direction():
    cosine, azimuth = np.array([1.0, 0.5, 0.0]), np.array([[0.3], [2.0]])
    found = np.asarray(direction(cosine, azimuth))
    assert found.shape == (2, 3, 3)
    np.testing.assert_allclose(np.linalg.norm(found, axis=-1), 1, rtol=1e-15)
    np.testing.assert_array_equal(found[..., 2], np.broadcast_to(cosine, (2, 3)))
    np.testing.assert_allclose(np.arctan2(found[1, 1:, 1], found[1, 1:, 0]), 2.0, rtol=1e-14)
    np.testing.assert_allclose(direction(0.5), [np.sqrt(0.75), 0, 0.5], rtol=1e-15)
    # sqrt((1 - c)(1 + c)) rather than sqrt(1 - c^2): the sine of a small angle keeps its digits.
    versine = 2.0**-50
    assert direction(1 - versine)[0] == pytest.approx(np.sqrt(2 * versine - versine**2), rel=1e-14)
    # A cosine a rounding above 1 is the normal, not NaN.
    np.testing.assert_array_equal(direction(1 + 1e-15)[:2], 0)


@pytest.mark.parametrize(("up", "down"), [(1.0, 1.0), (0.0, 0.3), (0.5, -1e-12), (-0.2, 0.4), (-0.1, -0.1)])
def test_horizon(up, down):
    wi, wo = np.array([[0.6, 0.0, up]]), np.array([[0.0, 0.6, down]])
    assert above_horizon(wi, wo).shape == (1,)
    assert bool(above_horizon(wi, wo)[0]) == (up >= 0 and down >= 0)
