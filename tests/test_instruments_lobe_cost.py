"""Costs, errors of the stand-ins for the power, and float32 beside float64: against counts by hand, formulas and facts."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
import pytest

from _instruments import lobe_error, single
from brdfcheck.brdf.catalog import entry
from brdfcheck.brdf.lobes import Phong
from brdfcheck.operations import operations

pytestmark = pytest.mark.slow  # an instrument of studies
FORMS = {form.name: form for form in lobe_error.FORMS}


def test_operations_by_primitive():
    assert operations(lambda c: c**16) == {"mul": 4}
    assert operations(lambda c: c**-3) == {"mul": 2, "div": 1}
    assert operations(lambda c: jnp.exp(2.0 * jnp.log(c))) == {"log": 1, "mul": 1, "exp": 1}
    assert operations(lambda c: jnp.where(c < 0.5, 1.0, c)) == {"lt": 1}
    assert not operations(lambda c: c)


def test_flops_of_the_forms_are_those_of_their_formulas():
    found = {name: lobe_error.flops(form, 100) for name, form in FORMS.items()}
    assert found["power"] == {"arithmetic": 1, "divisions": 0, "functions": 2}
    assert found["schlick"] == {"arithmetic": 2, "divisions": 1, "functions": 0}
    assert found["kuijk-blake"]["functions"] == 1
    for w in range(1, 7):  # subtract, multiply, subtract, max, w squarings
        assert found[f"lyon-{w}"] == {"arithmetic": 4 + w, "divisions": 0, "functions": 0}
    for doublings in range(2, 7):  # multiply, add, max, squarings
        assert found[f"binomial-{2**doublings}"] == {"arithmetic": 3 + doublings, "divisions": 0, "functions": 0}
    assert [lobe_error.flops(FORMS["power-fixed"], n)["arithmetic"] for n in (10, 100, 1000)] == [4, 8, 14]


@pytest.mark.parametrize("name", FORMS)
@pytest.mark.parametrize("n", [10, 100, 1000])
def test_a_form_is_its_lobe(name, n):
    form = FORMS[name]
    angle = np.linspace(0, 1.57, 500)
    found = form.bound(n)(jnp.cos(angle))
    lobe = form.lobe(float(n), "mirror").profile(jnp.asarray(2 * np.sin(angle / 2) ** 2))
    slack = 2e-3 if "poly" in name else 1e-12 * n
    np.testing.assert_allclose(found, lobe, rtol=0, atol=slack)
    assert form.kernel(n).function(jnp.cos(angle), *form.kernel(n).constants) == pytest.approx(np.asarray(found), abs=1e-15)


def test_errors_are_what_the_facts_say():
    found = {(name, n): lobe_error.errors(FORMS[name], n, 9001) for name in FORMS for n in (10, 100, 1000)}
    assert found["schlick", 1000]["max"] == pytest.approx(0.20, abs=0.005)
    assert found["kuijk-blake", 100]["max"] == pytest.approx(0.036, abs=5e-4)
    assert found["kuijk-blake", 1000]["max"] == pytest.approx(0.39, abs=5e-3)
    # At c^n = 1/2 Schlick's lobe of a large n is 1/(1 + ln 2).
    assert found["schlick", 1000]["centre"] == pytest.approx(2 / (1 + np.log(2)) - 1, rel=0.01)
    for n in (10, 100, 1000):
        assert found["power", n]["max"] < 1e-12
        assert found["power", n]["codes"] == 0
        assert found["power", n]["reach"] == 1
        assert found["lyon-4", n]["max"] == pytest.approx(found["binomial-16", n]["max"], rel=1e-9)
    for each in found.values():
        assert each["max"] >= max(each["falloff"], each["mean"])
        assert abs(each["codes"] - 255 * each["max"]) <= 1


def test_energies_are_what_the_facts_say():
    assert lobe_error.energies(FORMS["schlick"], (10, 100, 1000))["mirror"] == pytest.approx([1.64, 3.29, 5.44], abs=5e-3)
    assert lobe_error.energies(FORMS["kuijk-blake"], (1000,))["mirror"] == pytest.approx([3.91], abs=5e-3)
    for values in lobe_error.energies(FORMS["power"], (10, 1000)).values():
        assert values == pytest.approx([1, 1], abs=1e-12)


# --- float32 beside float64 ---


def test_lobes_that_differ_by_their_factor_are_one():
    names = single.distinct()
    assert {"phong", "blinn-phong", "schlick-half", "ggx", "cook-torrance", "binomial-power-unclamped"} <= set(names)
    assert not {"phong-pdf", "binomial-power-raw", "cook-torrance-published"} & set(names)


def test_both_precisions_have_the_same_numbers():
    narrow, wide = single.both(entry("phong").family.build(n=0.1))
    assert (narrow.n.dtype, wide.n.dtype) == (jnp.float32, jnp.float64)
    assert float(narrow.n) == float(wide.n) != 0.1


@pytest.mark.parametrize(("name", "value", "limit"), [("phong", 1e7, 2e-6), ("lyon-1-mirror", 1e3, 1e-5), ("ggx", 0.1, 2e-6)])
def test_errors_of_single_precision(name, value, limit):
    family = entry(name).family
    pair = single.both(family.build(**{next(iter(family.ranges)): value}))
    assert 1e-9 < single.profile_error(*pair) < limit
    found = single.albedo_errors(*pair, (0, 60, 89))
    assert all(error <= bar < 1e-4 for error, bar in zip(found["error"], found["bar"], strict=True))
    wrong = Phong(jnp.float32(40.0)), Phong(41.0)  # what is off shows
    assert single.profile_error(*wrong) > 0.01
    assert min(single.albedo_errors(*wrong, (0, 60))["error"]) > 0.01


def test_naive_forms_lose_what_the_facts_say():
    found = single.naive_forms((100.0, 1e3, 1e4, 1e7), 9001)
    assert found["flushed"][:3] == pytest.approx([65.3, 23.6, 7.6], abs=0.05)
    for name in ("pow", "exp-log"):
        assert found["power"][name][2:] == pytest.approx([1e4 * 2**-25, 1e7 * 2**-25], rel=0.2)
    assert found["power"]["sum"][3] > 0.2
    assert max(*found["power"]["power"], *found["power"]["binomial"]) < 2e-6
    assert found["acos"][0] == 1  # acos(cos 1e-5) = 0
    assert max(found["asin"]) < 3e-7
