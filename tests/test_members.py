"""Batches of members of a family: what is put together is what JAX's own vmap makes of the factory."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from brdfcheck.brdf import catalog
from brdfcheck.brdf.factors import AbstractFactor, Constant, Factor, Normalized
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.lobes import BlinnPhong, Lambert, Phong
from brdfcheck.brdf.microfacet import GGX
from brdfcheck.quadrature.members import Members, OtherKind
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.verdict import Verdict, check
from brdfcheck.verdict.supremum import NORMAL_IS_WORST

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


# --- factories that need numbers ---


def checked(n: float, factor: Any = None) -> Normalized:
    """What refuses values in Python, which JAX cannot trace."""
    if n < 0:
        raise ValueError("n must be positive")
    return Normalized(Phong(n), Factor(2.0, 2 * np.pi) if factor is None else factor)


def two_kinds(n: float) -> Normalized:
    return Normalized((BlinnPhong if n > 50 else Phong)(n), Factor(2.0, 2 * np.pi))


def narrow_kind(n: float) -> Any:
    return Lambert(1.5) if 50 < n < 50.05 else checked(n)


def test_members_of_a_factory_that_needs_numbers_are_built_one_by_one() -> None:
    members = Members(Family("x", checked, {"n": (1.0, 100.0)}))
    found = members(POINTS[[2, 0, 2], :1])
    assert not members.traced
    assert np.array_equal(found.lobe.n, [11, 3, 11])
    assert members.kind is not None
    assert jax.tree.structure(found) == jax.tree.structure(members.kind)


def test_a_factory_that_needs_numbers_is_checked_by_the_engine_of_its_lobe() -> None:
    report = check(checked, n=(1, 100))
    assert (report.engine, report.verdict, report.theorem) == ("zonal", Verdict.CONSERVES, NORMAL_IS_WORST)
    assert report.albedo == pytest.approx(1, abs=1e-12)
    assert report.error < 1e-12


def test_no_theorem_about_numbers_is_taken_from_a_member_for_others() -> None:
    """A Python factory may hold other numbers elsewhere: no single one of its members tells that none is above 1."""

    def build(alpha: float) -> GGX:
        return GGX(float(alpha))

    assert check(build, alpha=(0.1, 1)).basis == "search"
    assert check(lambda alpha: GGX(alpha), alpha=(0.1, 1)).basis != "search"


def test_a_jump_in_a_factory_that_needs_numbers_is_found() -> None:
    report = check(lambda n: checked(n, Factor(2.1 if 50 < n < 50.3 else 2.0, 2 * np.pi)), n=(1, 100))
    assert report.verdict is Verdict.VIOLATES
    assert report.albedo - report.error <= 52.1 / 52 <= report.albedo + report.error
    assert report.above == ((pytest.approx(50, abs=1e-4), pytest.approx(50.3, abs=1e-4)),)


def test_a_factory_that_raises_somewhere_is_a_finding() -> None:
    def build(n: float) -> Normalized:
        return checked(-1 if 50 < n < 50.3 else n)

    report = check(build, n=(1, 100))
    assert report.verdict is Verdict.UNDECIDED
    assert "ValueError: n must be positive" in report.findings[0]
    assert "build(n=50." in report.findings[0]


def test_a_factory_of_two_kinds_is_a_function() -> None:
    members = Members(Family("x", two_kinds, {"n": (1.0, 100.0)}))
    assert members.kind is None


def test_members_of_another_kind_that_are_met_late_are_told() -> None:
    members = Members(Family("x", narrow_kind, {"n": (1.0, 100.0)}))
    assert members.kind is not None
    with pytest.raises(OtherKind, match=r"narrow_kind\(n=50.02\) is of another kind than what is built elsewhere: Lambert"):
        members(np.array([[3.0], [50.02]]))


@pytest.mark.slow
def test_a_search_that_meets_another_kind_late_begins_again_as_of_functions() -> None:
    report = check(narrow_kind, n=(49.7, 51), cos_theta=(0.5, 0.5), effort="quick", rtol=1e-5)
    assert report.engine.startswith("adaptive")
    assert report.verdict is Verdict.VIOLATES
    assert report.albedo == pytest.approx(1.5, abs=1e-4)


def test_an_albedo_that_meets_another_kind_late_goes_on_as_one_of_functions() -> None:
    albedo = PointwiseAlbedo(Family("x", narrow_kind, {"n": (1.0, 100.0)}))
    assert albedo.fast
    value, _ = albedo(np.array([[3.0], [50.02]]), np.ones(2), np.zeros(2))
    np.testing.assert_allclose(value, [1, 1.5], rtol=1e-7)
    assert not albedo.fast


def test_a_kink_in_a_factory_that_needs_numbers_costs_no_digits() -> None:
    report = check(lambda n: Normalized(Phong(max(float(n), 5.0)), Constant((n + 13.6) / 60)), n=(1, 30))
    exact = (5 + 13.6) / 60 * 2 * np.pi / 7  # at the kink
    assert report.albedo == pytest.approx(exact, rel=1e-10)
    assert report.error < 1e-10
    assert report.parameters["n"] == pytest.approx(5, abs=1e-6)
    assert report.theorem == NORMAL_IS_WORST
