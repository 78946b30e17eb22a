"""The stability matrix: the production rule holds everywhere, naive rules fail where they are known to."""

from __future__ import annotations

from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from brdfcheck import stability
from brdfcheck.lobes import BinomialPower, Phong, Schlick
from brdfcheck.microfacet import CookTorrance
from brdfcheck.quadrature import RULES
from brdfcheck.stability import Outcome

REFERENCES = stability.read_references(Path(__file__).parent.parent / "studies" / "stability.csv")
ANGLES = np.radians([0.0, 1e-4, 45.0, 75.0, 85.0, 89.0, 89.99])


def test_the_matrix_is_the_whole_one():
    assert set(REFERENCES) == set(stability.LOBES)
    for name, reference in REFERENCES.items():
        assert reference.albedo.shape == ((7, 8) if name in stability.MICROFACETS else (12, 8))
        assert np.all(reference.radius <= 4e-5 * np.abs(reference.albedo))  # GGX at the limit of grazing; else 1e-9 or less


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize("lobe", stability.LOBES)
def test_the_production_rule_holds_everywhere(lobe, dtype):
    reference = REFERENCES[lobe]
    result = stability.run(stability.production, lobe, reference.parameters, reference.cosines, dtype)
    found = stability.outcomes(result, reference, dtype)
    places = [
        (reference.parameters[i], reference.cosines[j], result.value[i, j], reference.albedo[i, j], Outcome(found[i, j]).name)
        for i, j in zip(*np.nonzero(found), strict=True)
    ]
    assert not places
    assert not np.any(np.isnan(result.value))


@pytest.mark.parametrize("lobe", stability.LOBES)
def test_eager_is_jitted(lobe):
    reference = REFERENCES[lobe]
    few, cosines = reference.parameters[[0, 4]], reference.cosines[[0, 2, 7]]
    eager = stability.run(stability.production, lobe, few, cosines, np.float64, jit=False)
    jitted = stability.run(stability.production, lobe, few, cosines, np.float64)
    np.testing.assert_allclose(eager.value, jitted.value, rtol=1e-12)


@pytest.mark.parametrize("lobe", [name for name in stability.LOBES if "unclamped" not in name])
def test_derivatives_are_finite_and_right(lobe):
    """dE/dn and dE/dtheta of the production rule against central differences over the whole matrix."""
    reference = REFERENCES[lobe]
    smooth = lobe not in ("kb", "kb_half", "lyon1", "lyon1_mirror")
    tolerance = 1e-5 if smooth else 1e-3  # a kink within the step of a difference spoils the difference
    parameters = reference.parameters[::2]
    cosines = np.cos(ANGLES)
    for gradients in (
        stability.gradient_in_parameter(lobe, parameters, cosines),
        stability.gradient_in_angle(lobe, parameters, ANGLES[2:6]),
    ):
        assert np.all(np.isfinite(gradients.automatic))
        assert np.nanmax(gradients.deviation) < tolerance


def test_no_false_verdicts():
    found = stability.false_verdicts(60)
    assert found["false"] == 0
    assert found["undecided"] == 0


# --- naive methods fail where they are known to: one that suddenly passes means that its test is broken ---


def outcomes_of(rule, lobe, dtype=np.float64):
    reference = REFERENCES[lobe]
    result = stability.run(stability.of_rule(rule), lobe, reference.parameters, reference.cosines, dtype)
    return result, stability.outcomes(result, reference, dtype)


def test_a_product_rule_breaks_on_needles():
    result, found = outcomes_of(RULES["gauss-product"](32), "phong")
    column = 2  # 45 degrees
    rows = {n: i for i, n in enumerate(REFERENCES["phong"].parameters)}
    loss = 1 - result.value[:, column] / REFERENCES["phong"].albedo[:, column]
    assert loss[rows[1e3]] == pytest.approx(0.022, abs=0.002)
    assert loss[rows[1e5]] == pytest.approx(1, abs=1e-6)
    assert found[rows[1e5], column] == Outcome.BREAKS
    assert found[rows[8.0], column] == Outcome.HOLDS


@pytest.mark.parametrize(("rule", "setting"), [("cosine-monte-carlo", 4096), ("midpoint-product", 32), ("sobol", 4096)])
def test_rules_that_know_nothing_of_the_lobe_fail_on_needles(rule, setting):
    _, found = outcomes_of(RULES[rule](setting), "blinn")
    rows = REFERENCES["blinn"].parameters
    assert np.all(found[rows >= 1e5] >= Outcome.LOSES_DIGITS)
    assert np.any(found[rows >= 1e5] == Outcome.BREAKS)


def test_fixed_warped_gauss_is_not_enough_for_schlicks_tail():
    _, found = outcomes_of(RULES["lobe-warped-gauss"](64), "schlick")
    assert np.count_nonzero(found) > found.size / 2


def test_subnormals_are_flushed():
    """float32 c^n is 0 beyond 65.3, 23.6, 7.6 degrees for n = 100, 1000, 10^4."""
    for n, angle in ((100.0, 65.3), (1e3, 23.6), (1e4, 7.6)):
        lobe = Phong(jnp.asarray(n, jnp.float32))
        versine = jnp.asarray(2 * np.sin(np.radians([angle - 0.4, angle + 0.4]) / 2) ** 2, jnp.float32)
        inside, outside = np.asarray(jax.jit(lambda lobe, versine: lobe.profile(versine))(lobe, versine))
        assert inside > 0
        assert outside == 0


def test_the_cosine_first_loses_the_binomial_power():
    n, k = np.float32(1e7), np.float32(16)
    angle = np.float32(2e-4)
    naive = (1 + n / k * (np.cos(angle) - 1)) ** k
    exact = (1 - 1e7 / 16 * 2 * np.sin(float(angle) / 2) ** 2) ** 16
    versine = jnp.asarray(2 * np.sin(angle / 2) ** 2, jnp.float32)
    ours = float(BinomialPower(jnp.asarray(n)).profile(versine))
    assert abs(float(naive) / exact - 1) > 0.05
    assert ours == pytest.approx(exact, rel=1e-5)


def test_acos_near_one():
    assert jnp.arccos(jnp.cos(jnp.asarray(1e-4, jnp.float32))) == 0
    assert np.isnan(jnp.arccos(jnp.asarray(1 + 1.2e-7, jnp.float32)))
    assert jax.grad(jnp.arccos)(jnp.asarray(1.0)) == -np.inf


def test_a_negative_base():
    assert np.isnan(jnp.asarray(-0.5) ** 15.5)
    clamped, rebound = (BinomialPower(100.0, clamped=part).profile(jnp.asarray(0.5)) for part in (True, False))
    assert clamped == 0
    assert rebound > 1


def test_beckmann_where_its_formula_breaks():
    """exp(-tan^2)/cos^4 at 90 degrees, G/((N.L)(N.V)) at grazing: NaN in the printed form, finite here, gradient included."""

    def printed(c):
        return jnp.exp(-(1 - c * c) / (c * c) / 0.04) / (0.04 * c**4)

    assert np.isnan(printed(jnp.asarray(0.0)))
    assert np.isnan(jax.grad(printed)(jnp.asarray(0.0)))
    assert np.isinf(1 / jnp.asarray(1e-20, jnp.float32) ** 2)  # the height of D at m = 1e-20
    for angle in (89.99, 90.0):
        wi = jnp.array([jnp.sin(jnp.radians(angle)), 0.0, jnp.cos(jnp.radians(angle)) if angle < 90 else 0.0])
        value, slope = jax.value_and_grad(lambda m, wi=wi: CookTorrance(m)(wi, wi * jnp.array([-1.0, -1.0, 1.0])))(0.2)
        assert np.isfinite(value)
        assert np.isfinite(slope)


def test_schlick_keeps_its_pole_at_bay():
    reference = REFERENCES["schlick"]
    value = [float(stability.production(Schlick(n), jnp.asarray([0.7]))[1][0]) for n in reference.parameters]
    assert np.all(np.isfinite(value))


def test_references_with_holes_are_refused(tmp_path):
    path = tmp_path / "holes.csv"
    path.write_text("lobe,n,cos_theta,albedo,radius\nphong,1.0,1.0,1.0,0\nphong,2.0,0.5,1.0,0\n")
    with pytest.raises(ValueError, match=r"phong has no albedo at n=1, cos_theta=0\.5"):
        stability.read_references(path)


def test_outcomes_are_told_apart():
    reference = stability.Reference("phong", np.ones(1), np.ones(5), np.ones((1, 5)), np.zeros((1, 5)))
    value = np.array([[1.0, 1 + 1e-6, 1 + 1e-6, np.nan, 2.0]])
    claimed = np.array([[1e-12, np.inf, 1e-9, 1e-9, 5.0]])
    found = stability.outcomes(stability.Result(value, claimed), reference, np.float64)
    assert [Outcome(cell).name for cell in found[0]] == ["HOLDS", "LOSES_DIGITS", "LIES", "BREAKS", "BREAKS"]
