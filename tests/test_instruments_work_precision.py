"""Work-precision records: what is measured, against what, and the frontier."""

from __future__ import annotations

import json
import time
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from _instruments import charts
from _instruments.peers import PEERS, AbstractPeer
from _instruments.work_precision import Case, measure, measure_all
from brdfcheck.brdf.lobes import Phong
from brdfcheck.output import records
from brdfcheck.quadrature import RULES
from brdfcheck.quadrature.rule import Raw

pytestmark = pytest.mark.slow  # an instrument of studies
SMOOTH = Case("smooth", "Phong", Phong(10.0), 10.0, 0.7, 0.3666790309883656274900)


def test_a_measurement_holds_what_a_chart_needs():
    point = measure(RULES["gauss-product"](16), SMOOTH, repeats=2)
    assert point["evaluations"] == 512
    assert point["error"] == pytest.approx(abs(point["value"] / SMOOTH.reference - 1), rel=1e-9, abs=1e-16)
    assert np.isnan(point["claimed"])
    assert 0 < point["batched_seconds"] < point["warm_seconds"]  # without the cost of a call
    assert point["compile_seconds"] > point["warm_seconds"]  # the first call compiles
    assert (point["dtype"], point["lobe"], point["setting"], point["status"]) == ("float64", "Phong", 16, "ok")
    record = json.loads(json.dumps(records.plain(point), allow_nan=False))
    assert record["claimed"] == "NaN"


def test_chance_is_the_middle_of_some_runs():
    point = measure(RULES["cosine-monte-carlo"](256), SMOOTH, repeats=1)
    errors = []
    for seed in range(5):
        import jax

        value = RULES["cosine-monte-carlo"](256)(SMOOTH.brdf, jnp.asarray(0.7), key=jax.random.key(seed)).value
        errors.append(abs(float(value) / SMOOTH.reference - 1))
    assert point["error"] == pytest.approx(sorted(errors)[2], rel=1e-9)


class Compiling(AbstractPeer):
    """A peer that takes long the first time that it is called."""

    seconds: float = eqx.field(static=True)
    name: ClassVar[str] = "compiling"
    family: ClassVar[str] = "peers"
    package: ClassVar[str] = "numpy"
    ladder: ClassVar[tuple[Any, ...]] = (0.3, 0.31)
    needs: ClassVar[str] = "anything"
    random: ClassVar[bool] = False
    on_host: ClassVar[bool] = True
    compiles: ClassVar[bool] = True
    called: ClassVar[list[float]] = []

    @classmethod
    def missing(cls) -> str | None:
        return None

    def applies(self, core, cos_theta):
        return True

    def integrate(self, core, mu, key):
        if self.seconds not in self.called:
            self.called.append(self.seconds)
            time.sleep(self.seconds)
        return Raw(SMOOTH.reference, 0.0, 1)


def test_what_a_peer_compiles_is_not_its_warm_time():
    points = measure_all([Compiling], SMOOTH, most_seconds=0.02)
    assert [point["setting"] for point in points] == [0.3, 0.31]  # a ladder does not end where something is compiled
    for point in points:
        assert point["warm_seconds"] < 0.15
        assert point["compile_seconds"] > 0.15


class Slow(Compiling):
    """One that takes its time always and says so."""

    compiles: ClassVar[bool] = False

    def integrate(self, core, mu, key):
        self.called.append(self.seconds)
        time.sleep(self.seconds)
        return Raw(SMOOTH.reference, 0.0, 1)


@pytest.mark.parametrize(("budget", "times"), [(0.01, 1), (1.0, 2)])
def test_a_slow_peer_that_compiles_nothing_is_run_once(monkeypatch, budget, times):
    monkeypatch.setattr(Slow, "called", [])
    point = measure(Slow(0.2), SMOOTH, budget=budget)
    assert len(Slow.called) == times
    assert 0.2 <= point["warm_seconds"] < 1
    assert point["compile_seconds"] < 0.15


def test_rules_that_do_not_take_a_case_are_left_out():
    points = measure_all([RULES["half-vector"], RULES["zonal"]], SMOOTH, settings=2)
    assert {point["rule"] for point in points} == {"zonal"}
    assert len(points) == 2


def test_the_frontier():
    points = [(1.0, 1e-2), (2.0, 1e-1), (3.0, 1e-5), (3.0, 1e-7), (4.0, float("nan")), (5.0, 1e-6)]
    assert charts.frontier(points) == [(1.0, 1e-2), (3.0, 1e-7)]
    # No digit is no place on it, and which error below the rounding is smallest is luck.
    lucky = [(0.5, 1.0), (1.0, 1e-2), (2.0, 3e-16), (3.0, 1e-17)]
    assert charts.frontier(lucky, 1e-15, 0.5) == [(1.0, 1e-2), (2.0, 1e-15)]


def test_every_rule_and_peer_has_a_colour():
    assert set(charts.RULES) == {*RULES, *PEERS}
    assert len(set(charts.RULES.values())) == len(charts.RULES)  # no two look alike


def test_labels_are_moved_apart():
    """Far ones stay; a bunch spreads about its middle, and a bunch that grows into its neighbour takes it in."""
    places = charts.apart([1.0, 10.0, 10.5, 11.0, 1000.0], 1.5)
    assert places[0] == pytest.approx(1)
    assert places[-1] == pytest.approx(1000)
    assert np.all(np.diff(np.log(places)) >= np.log(1.5) * (1 - 1e-12))
    assert np.prod(places[1:4]) == pytest.approx(10 * 10.5 * 11)
    found = charts.label_places([(1.0, 2.0, "a"), (3.0, 2.1, "a"), (5.0, 2.0, "b")], {"a": max}, 1.2)
    assert [x for x, _ in found] == [3.0, 3.0, 5.0]
    assert found[1][1] / found[0][1] == pytest.approx(1.2)
