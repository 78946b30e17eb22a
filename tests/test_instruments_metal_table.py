"""The job that others do too: a table of Beckmann metal, timed and compared in one run."""

from __future__ import annotations

import functools

import numpy as np
import pytest
from problems import facet_tables

from _instruments import timing
from _instruments.peers import metal_table
from brdfcheck import albedo_table
from brdfcheck.brdf.microfacet import CookTorrance

pytestmark = pytest.mark.slow  # an instrument of studies
MIDDLES = (np.arange(32) + 0.5) / 32
METAL = functools.partial(CookTorrance, masking="smith-separable")


def test_the_reference_is_right():
    """The Gauss rule over slopes against strips of slopes (tests/references), and against half the order."""
    rows = facet_tables()["beckmann", "smith-separable", 1.0]
    oblique = rows[rows.cos_theta < 1]
    assert len(oblique) >= 40
    for row in oblique:
        value = metal_table.slope_table(np.array([row.m]), np.array([row.cos_theta]))[0, 0]
        assert abs(value - row.albedo) <= 2e-13 + row.error
    few = MIDDLES[::6]
    fine = metal_table.slope_table(few, few)
    assert np.max(np.abs(fine - metal_table.slope_table(few, few, 36))) <= 1e-11
    assert np.max(np.abs(fine - metal_table.slope_table(few, few, 6))) > 1e-11  # the order counts


@pytest.mark.parametrize(("rtol", "most"), [(1e-4, 1e-6), (1e-6, 7e-10), (1e-10, 1e-11)])
def test_beckmann_table_against_the_reference(rtol, most):
    few = MIDDLES[::3]
    table = albedo_table(METAL, few, few, rtol=rtol)
    error = np.abs(np.asarray(table.value) - metal_table.slope_table(few, few))
    assert np.max(error) <= most
    assert np.all(error <= np.asarray(table.error) + 2e-13)


def test_a_missing_numba_is_named(monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda package: None)
    assert metal_table.missing() == "numba is not installed: pip install 'brdfcheck[peers]'"


@pytest.mark.peers
def test_beckmann_table_against_scipy():
    pytest.importorskip("numba")
    exact = metal_table.slope_table(MIDDLES, MIDDLES)
    job = {rtol: lambda rtol=rtol: np.asarray(albedo_table(METAL, MIDDLES, MIDDLES, rtol=rtol).value) for rtol in (1e-6, 1e-10)}
    error = {rtol: np.max(np.abs(job[rtol]() - exact)) for rtol in job}
    seconds = {rtol: timing.fastest(job[rtol], 5) for rtol in job}
    table, peer_seconds = metal_table.scipy_table(MIDDLES, MIDDLES, 2)
    theirs = np.max(np.abs(table - exact))
    print(f"ours {seconds} s, errors {error}; scipy + numba {peer_seconds:.2f} s, error {theirs:.1e}")
    assert theirs <= 1e-9  # what it was asked for
    assert error[1e-6] <= 7e-10
    assert error[1e-10] <= theirs / 10
    # A thirtieth and less on an idle machine at a tenth of the error, an eightieth at that of the digits asked for.
    assert seconds[1e-6] <= peer_seconds / 20
    assert seconds[1e-10] <= peer_seconds / 10
