"""Work-precision records: what is measured, against what, and the frontier."""

from __future__ import annotations

import json

import jax.numpy as jnp
import numpy as np
import pytest

from brdfcheck.lobes import Phong
from brdfcheck.peers import PEERS
from brdfcheck.plots import precision
from brdfcheck.quadrature import RULES
from brdfcheck.work_precision import Case, measure, measure_all, single

SMOOTH = Case("smooth", "Phong", Phong(10.0), 10.0, 0.7, 0.3666790309883656274900)


def test_a_measurement_holds_what_a_chart_needs():
    point = measure(RULES["gauss-product"](16), SMOOTH, repeats=2)
    assert point.evaluations == 512
    assert point.error == pytest.approx(abs(point.value / SMOOTH.reference - 1), rel=1e-9, abs=1e-16)
    assert np.isnan(point.claimed)
    assert point.warm_seconds > 0
    assert point.compile_seconds > point.warm_seconds  # the first call compiles
    assert (point.dtype, point.lobe, point.setting, point.status) == ("float64", "Phong", 16, "ok")
    assert point.versions["jax"]
    record = json.loads(json.dumps(point.to_json_object(), allow_nan=False))
    assert record["claimed"] == "NaN"
    assert "versions" not in record


def test_float32_beside_float64():
    narrow = single(SMOOTH)
    assert narrow.dtype == np.float32
    wide, rough = (measure(RULES["zonal"](24), case, repeats=1) for case in (SMOOTH, narrow))
    assert wide.error < 1e-13
    assert 1e-10 < rough.error < 1e-5
    assert rough.dtype == "float32"


def test_chance_is_the_middle_of_some_runs():
    point = measure(RULES["cosine-monte-carlo"](256), SMOOTH, repeats=1, runs=5)
    errors = []
    for seed in range(5):
        import jax

        value = RULES["cosine-monte-carlo"](256)(SMOOTH.brdf, jnp.asarray(0.7), key=jax.random.key(seed)).value
        errors.append(abs(float(value) / SMOOTH.reference - 1))
    assert point.error == pytest.approx(sorted(errors)[2], rel=1e-9)


def test_rules_that_do_not_take_a_case_are_left_out():
    points = measure_all([RULES["half-vector"], RULES["zonal"]], SMOOTH, settings=2)
    assert {point.rule for point in points} == {"zonal"}
    assert len(points) == 2


def test_a_ladder_ends_where_it_takes_too_long():
    points = measure_all([RULES["gauss-product"]], SMOOTH, most_seconds=0.0, settings=3)
    assert len(points) == 1


def test_scipy_is_a_peer_that_is_always_there():
    point = measure(PEERS["scipy-dblquad"](1e-6), SMOOTH, repeats=1)
    assert point.error < 1e-6


def test_the_reference_is_no_contender():
    """The number in the case comes from ball arithmetic: it has more digits than any rule here has bits."""
    assert pytest.approx(0.3666790309883656, abs=1e-16) == SMOOTH.reference


def test_the_frontier():
    points = [(1.0, 1e-2), (2.0, 1e-1), (3.0, 1e-5), (3.0, 1e-7), (4.0, float("nan")), (5.0, 1e-6)]
    assert precision.frontier(points) == [(1.0, 1e-2), (3.0, 1e-7)]


def test_every_rule_and_peer_has_a_colour():
    assert set(precision.RULES) >= {*RULES, *PEERS}
