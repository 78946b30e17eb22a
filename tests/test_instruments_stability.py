"""The stability matrix: the production rule holds everywhere, naive rules fail where they are known to."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from selection import few

from _instruments.stability import outcomes, references, verdicts
from _instruments.stability.outcomes import Outcome
from brdfcheck.brdf.factors import AbstractFactor, Normalized, exact_factor
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.lobes import BinomialPower, Phong
from brdfcheck.brdf.microfacet import GGX, CookTorrance
from brdfcheck.quadrature import RULES
from brdfcheck.quadrature.albedo import albedo
from brdfcheck.verdict import Verdict, check_family

REFERENCES = references.read_references()


def test_the_matrix_is_the_whole_one():
    assert set(REFERENCES) == set(references.LOBES)
    for name, reference in REFERENCES.items():
        assert reference.albedo.shape == ((7, 8) if name in references.MICROFACETS else (12, 8))
        assert np.all(reference.radius <= 1e-10 * np.abs(reference.albedo))
        assert np.all(np.isfinite([reference.slope(by, np.float64) for by in ("n", "theta")]))


def test_facets_reflect_everything_at_the_horizon():
    """In the limit of grazing incidence the albedo is 1 for V-cavities and correlated masking, whatever the distribution."""
    for name in ("cook-torrance", "beckmann-smith-correlated", "ggx"):
        assert np.all(REFERENCES[name].albedo[:, -1] == 1)
    assert np.all(REFERENCES["beckmann-smith"].albedo[:, -1] < 0.97)


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("lobe", references.LOBES)
def test_the_production_rule_holds_everywhere(lobe, dtype):
    reference = REFERENCES[lobe]
    result = outcomes.run(outcomes.production, lobe, reference.parameters, reference.cosines, dtype)
    found = outcomes.outcomes(result, reference, dtype)
    places = [
        (reference.parameters[i], reference.cosines[j], result.value[i, j], reference.albedo[i, j], Outcome(found[i, j]).name)
        for i, j in zip(*np.nonzero(found), strict=True)
    ]
    assert not places
    assert not np.any(np.isnan(result.value))


# Of the larger of the derivative and E. The references are good to 1e-12, of microfacets to 1e-5; GGX loses most at 90 degrees.
SLOPES = {"float64": 1e-9, "float32": 1e-4}
FACET_SLOPES = {"float64": 1e-4, "float32": 2e-3}  # in float32 that of m = 0.001 at 90 degrees is one a little before


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("lobe", references.LOBES)
def test_derivatives_are_finite_and_right(lobe, dtype):
    """dE/dn and dE/dtheta of the production rule over the whole matrix, against ball arithmetic and slope-space integrals."""
    allowed = (FACET_SLOPES if lobe in references.MICROFACETS else SLOPES)[dtype.__name__] * (10 if lobe == "ggx" else 1)
    if "unclamped" in lobe and dtype is np.float32:
        allowed = 0.03  # the rebound multiplies rounding by its power
    for gradients in outcomes.gradients_of(REFERENCES[lobe], dtype=dtype).values():
        asked = outcomes.gradient_outcomes(gradients, dtype) != outcomes.NOT_ASKED
        assert np.all(asked) or "unclamped" in lobe or dtype is np.float32
        assert np.count_nonzero(asked) > 0.7 * asked.size
        assert np.all(np.isfinite(gradients.automatic[asked]))
        assert np.max(gradients.deviation[asked]) < allowed


def test_derivatives_that_are_off_are_told():
    reference = REFERENCES["phong"]
    exact = reference.slope("theta", np.float64)
    size = np.maximum(np.abs(exact), reference.albedo)
    told = {1e-4: Outcome.HOLDS, 1e-2: Outcome.LOSES_DIGITS, 0.6: Outcome.BREAKS, np.nan: Outcome.BREAKS}
    for part, expected in told.items():
        found = outcomes.gradient_outcomes(outcomes.Gradients(exact + part * size, exact, reference.albedo))
        assert np.all(found == expected)


@pytest.mark.slow
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_derivatives_of_the_closed_form_hold(dtype):
    """Also where powers of n overflow single precision: n = 10^7."""
    slopes = outcomes.gradients_of(REFERENCES["phong"], outcomes.of_rule(RULES["closed-form"](64)), dtype)
    for gradients in slopes.values():
        assert np.all(outcomes.gradient_outcomes(gradients, dtype) == Outcome.HOLDS)


@pytest.mark.slow
def test_no_false_verdicts():
    found = verdicts.false_verdicts(60)
    assert found["false"] == 0
    assert found["undecided"] == 0


@pytest.mark.parametrize("lobe", few(references.LOBES, ("phong",)))
def test_no_false_verdicts_in_the_matrix(lobe):
    found = verdicts.matrix_verdicts(REFERENCES[lobe])
    assert found["verdicts"] == 2 * REFERENCES[lobe].albedo.size
    assert found["false"] == 0
    assert found["undecided"] < 0.3 * found["verdicts"]


def test_wrong_references_make_false_verdicts():
    phong = REFERENCES["phong"]
    wrong = dataclasses.replace(phong, albedo=phong.albedo * (1 + 1e-5))
    assert verdicts.matrix_verdicts(wrong)["false"] > 0.3 * phong.albedo.size


class Unknown(AbstractFactor):
    """Phong's exact factor under a name of which nothing can be proved."""

    def __call__(self, n):
        return exact_factor(Phong(1.0))(n)  # pyright: ignore[reportOptionalCall]


@pytest.mark.parametrize("factor", [Unknown(), exact_factor(Phong(1.0))])
def test_in_float32_a_factor_near_the_exact_one_is_undecided_where_nothing_is_proved(factor):
    with jax.enable_x64(False):
        report = check_family(Family("exact", lambda n: Normalized(Phong(n), factor), {"n": (10.0, 20.0)}))
    proved = not isinstance(factor, Unknown)
    assert report.verdict is (Verdict.CONSERVES if proved else Verdict.UNDECIDED)
    assert (report.basis == "proof") is proved
    assert report.error > 1e-6


@pytest.mark.slow
def test_in_float32_no_verdict_is_false():
    with jax.enable_x64(False):
        found = verdicts.false_verdicts(40)
    assert found["false"] == 0
    assert found["undecided"] > 30


# --- naive methods fail where they are known to: one that suddenly passes means that its test is broken ---


def outcomes_of(rule, lobe, dtype=np.float64):
    reference = REFERENCES[lobe]
    result = outcomes.run(outcomes.of_rule(rule), lobe, reference.parameters, reference.cosines, dtype)
    return result, outcomes.outcomes(result, reference, dtype)


def test_a_product_rule_breaks_on_needles():
    result, found = outcomes_of(RULES["gauss-product"](32), "phong")
    column = 2  # 45 degrees
    rows = {n: i for i, n in enumerate(REFERENCES["phong"].parameters)}
    loss = 1 - result.value[:, column] / REFERENCES["phong"].albedo[:, column]
    assert loss[rows[1e3]] == pytest.approx(0.022, abs=0.002)
    assert loss[rows[1e5]] == pytest.approx(1, abs=1e-6)
    assert found[rows[1e5], column] == Outcome.BREAKS
    assert found[rows[8.0], column] == Outcome.HOLDS


@pytest.mark.slow
@pytest.mark.parametrize(("rule", "setting"), [("cosine-monte-carlo", 4096), ("midpoint-product", 32), ("sobol", 4096)])
def test_rules_that_know_nothing_of_the_lobe_fail_on_needles(rule, setting):
    _, found = outcomes_of(RULES[rule](setting), "blinn")
    rows = REFERENCES["blinn"].parameters
    assert np.all(found[rows >= 1e5] >= Outcome.LOSES_DIGITS)
    assert np.any(found[rows >= 1e5] == Outcome.BREAKS)


@pytest.mark.slow
@pytest.mark.parametrize("build", [CookTorrance, lambda m: CookTorrance(m, masking="smith-separable"), GGX])
def test_slopes_near_nothing_in_float32(build):
    """Right within the bar where the distribution's peak is a float32; of unknown error, not silently NaN, where it is not."""
    cosines = jnp.asarray([1.0, 0.5, 0.01], jnp.float32)
    for m in (1e-6, 1e-10, 1e-15):
        found = albedo(jax.tree.map(lambda leaf: leaf.astype(jnp.float32), build(m)), cosines)
        assert np.all(np.isfinite(found.error))
        assert np.all(np.abs(found.value - 1) <= found.error)
    found = albedo(jax.tree.map(lambda leaf: leaf.astype(jnp.float32), build(1e-20)), cosines)
    assert np.all(np.isposinf(found.error))


@pytest.mark.slow
def test_overflow_is_inf_of_unknown_error():
    lobe = jax.tree.map(lambda leaf: leaf.astype(jnp.float32), BinomialPower(1e5, clamped=False))
    for answer in (albedo(lobe, jnp.float32(0.5)), RULES["zonal"](6)(lobe, jnp.float32(0.5))):
        assert np.isposinf(answer.value)
        assert np.isposinf(answer.error)


def outcomes_at(exact, value, claimed, dtype):
    shape = (1, len(value))
    reference = references.Reference("phong", np.ones(1), np.ones(len(value)), np.full(shape, exact), np.zeros(shape), {})
    found = outcomes.outcomes(outcomes.Result(np.array([value]), np.array([claimed]), np.ones(shape, bool)), reference, dtype)
    return [Outcome(cell).name for cell in found[0]]


def test_outcomes_are_told_apart():
    value = [1.0, 1 + 1e-6, 1 + 1e-6, np.nan, 2.0]
    found = outcomes_at(1.0, value, [1e-12, np.inf, 1e-9, 1e-9, 5.0], np.float64)
    assert found == ["HOLDS", "LOSES_DIGITS", "LIES", "BREAKS", "BREAKS"]


def test_what_a_float32_cannot_hold_is_no_excuse():
    inf, nan = np.inf, np.nan
    found = outcomes_at(1e39, [inf, inf, 5.0, nan, -inf], [inf, 1e-9, 1e-9, inf, inf], np.float32)
    assert found == ["HOLDS", "BREAKS", "BREAKS", "BREAKS", "BREAKS"]
    found = outcomes_at(1e-39, [0.0, nan, 1.0, inf], [0.0, nan, inf, inf], np.float32)
    assert found == ["HOLDS", "BREAKS", "BREAKS", "BREAKS"]
