"""Batches of members of a family: what is put together is what JAX's own vmap makes of the factory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from brdfcheck.brdf import catalog
from brdfcheck.brdf.factors import AbstractFactor, Factor, Normalized
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.lobes import Phong
from brdfcheck.brdf.microfacet import GGX
from brdfcheck.quadrature.members import Members
from brdfcheck.verdict import Verdict, check

POINTS = np.array([[3.0, 0.25], [7.0, 0.5], [11.0, 0.75]])


class Shifted(AbstractFactor):
    """A factor whose number is whatever it is given."""

    shift: Any

    def __call__(self, n: Any) -> Any:
        return (n + self.shift) / (2 * np.pi)


def same(family: Family, parameters: np.ndarray) -> None:
    names = tuple(family.ranges)
    columns = {name: parameters[:, i] for i, name in enumerate(names)}
    wanted = jax.vmap(lambda values: family.build(**values))(columns)
    found = Members(family)(parameters)
    assert jax.tree.structure(found) == jax.tree.structure(wanted)
    for one, other in zip(jax.tree.leaves(found), jax.tree.leaves(wanted), strict=True):
        assert one.dtype == np.asarray(other).dtype
        assert np.array_equal(one, other)


@pytest.mark.parametrize(
    "build",
    [
        lambda n, a: Normalized(Phong(n), Factor(a, 2.0)),
        lambda n, a: Normalized(Phong(a), Factor(a, n)),
        lambda n, a: Normalized(Phong(n), Shifted(0)),
        lambda n, a: Normalized(Phong(n), Shifted(2)),
        lambda n, a: Normalized(Phong(n), Shifted(jnp.array([0.1, 0.2, 0.3]))),
        lambda n, a: Normalized(Phong(n), Shifted(np.arange(3))),
        lambda n, a: Normalized(Phong(n), Shifted(True)),
        lambda n, a: Normalized(Phong(n), Factor(n * a, 2.0)),
    ],
    ids=["pass", "twice", "zero", "whole", "vector", "whole vector", "truth", "computed"],
)
@pytest.mark.parametrize("order", [("n", "a"), ("a", "n")])
def test_a_batch_is_that_of_vmap(build: Callable[..., Any], order: tuple[str, str]) -> None:
    same(Family("x", build, dict.fromkeys(order, (0.0, 12.0))), POINTS)


@pytest.mark.parametrize("name", ["phong", "lyon-1-half", "cook-torrance", "thin-sheet", "lambert-transmission"])
def test_a_batch_of_the_catalogue(name: str) -> None:
    family = catalog.entry(name).family
    same(family, np.linspace(0.1, 0.9, 3 * len(family.ranges)).reshape(3, -1))


def test_without_parameters_what_is_computed_is_computed_once() -> None:
    found = Members(Family("x", lambda: GGX(jnp.asarray(0.5) ** 2)))(np.zeros((4, 0)))
    assert np.array_equal(found.alpha, np.full(4, 0.25))


def test_constants_are_in_the_precision_of_the_time() -> None:
    members = Members(Family("x", lambda n: Normalized(Phong(n), Factor(0.1, 2.0)), {"n": (1.0, 12.0)}))
    for double, kind in ((False, np.float32), (True, np.float64)):
        with jax.enable_x64(double):
            assert members(POINTS[:, :1]).factor.A.dtype == kind
            assert members(POINTS[:, :1]).lobe.n.dtype == np.float64


@pytest.mark.parametrize("shift", [0, 2, True])
def test_a_whole_number_in_a_factor_is_no_parameter(shift: int) -> None:
    report = check(lambda n: Normalized(Phong(n), Shifted(shift)), n=(1, 100))
    largest = max((n + shift) / (n + 2) for n in (1, 100))
    assert report.albedo == pytest.approx(largest, abs=1e-9)
    assert report.verdict is (Verdict.CONSERVES if shift <= 2 else Verdict.VIOLATES)
