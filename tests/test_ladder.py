"""The ladder of factor forms: each rung dearer and tighter, every one conserving, costs that can be counted by hand."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from brdfcheck.brdf.factors import BlinnPhongExact, Constant, Factor, Normalized, Proportional, RationalFactor
from brdfcheck.brdf.lobes import KuijkBlake, Phong
from brdfcheck.fits.ladder import CLOSED_FORM, FORMS, cost, factor_ladder, operations
from brdfcheck.quadrature.albedo import albedo
from brdfcheck.verdict import Verdict


# `test_new_lobe` has one every time.
@pytest.mark.slow
@pytest.mark.parametrize("name", ["binomial-power-half", "schlick-mirror", "lyon-1-half"])
def test_rungs_rise_in_cost_and_fall_in_loss(name):
    rungs = factor_ladder(name, measure=False)
    assert [rung.form for rung in rungs] == [*(form for form, _ in FORMS), CLOSED_FORM]
    assert all(rung.verdict is Verdict.CONSERVES for rung in rungs)
    assert np.all(np.diff([rung.operations for rung in rungs]) > 0)
    # n/B may lose more than a constant: it is another one-constant form, not a richer one.
    losses = [rung.lost for rung in rungs]
    assert max(losses[:2]) > losses[2] > losses[3] > losses[4] > 1e-6
    assert losses[5] < 1e-12


@pytest.mark.slow
def test_a_rungs_loss_is_what_the_albedo_shows():
    for rung in factor_ladder(KuijkBlake, (1, 50), measure=False):
        n = rung.smallest_n
        value = float(albedo(Normalized(KuijkBlake(n), rung.factor), 1.0).value)
        assert value == pytest.approx(rung.smallest, abs=1e-11)
        assert rung.lost == pytest.approx(1 - value, abs=1e-11)


def test_phong_needs_two_constants():
    rungs = {rung.form: rung for rung in factor_ladder(Phong, measure=False)}
    assert rungs["(n+A)/B"].lost < 1e-9
    assert rungs["n/B"].lost == pytest.approx(2 / 3, abs=1e-2)


def test_operations_are_counted_as_by_hand():
    assert operations(Constant(0.3)) == 0
    assert operations(Proportional(3.0)) == 1
    assert operations(Factor(6.0, 24.55)) == 2
    assert operations(RationalFactor([1.0, 2.0, 3.0], [1.0, 4.0])) == 4 + 2 + 1
    assert operations(BlinnPhongExact()) == 9  # two sums, product, exp2 of a quotient of a sign, sum, product, quotient


@pytest.mark.slow
def test_cost_is_measured():
    cheap, dear = cost(lambda n: n), cost(lambda n: jnp.sin(n) + jnp.cos(2 * n) + jnp.arctan2(n, 3.0))
    assert 0 < cheap < dear < 1000
    rungs = factor_ladder(Phong, (1, 10))
    assert all(rung.nanoseconds > 0 for rung in rungs)
