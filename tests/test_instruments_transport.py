"""What the studies of transport measure: points, growth, levels, refinement and radii, on the smallest cases."""

from __future__ import annotations

import json

import jax
import numpy as np
import pytest

from _instruments import transport as measure
from _instruments.transport import SOLVERS
from brdfcheck import Factor, Lambert, Normalized, Phong, transport
from brdfcheck.output import records

pytestmark = pytest.mark.slow  # an instrument of studies
KEY = jax.random.key(0)


def test_work_precision_of_every_solver():
    room = transport.box()
    exact = np.array([2.0, 1.5, 1.8, 1.6, 1.9, 1.7])
    emission = exact - 0.5 * (np.asarray(room.form_factors) @ exact)
    points = measure.work_precision(room, emission, 0.5, exact, key=KEY, settings=3, repeats=1)
    assert list(dict.fromkeys(point["method"] for point in points)) == list(SOLVERS)
    by = {name: [point for point in points if point["method"] == name] for name in SOLVERS}
    assert [len(own) for own in by.values()] == [1, 3, 3, 3, 3]
    for name in ("krylov", "progressive", "neumann"):
        assert by[name][0]["error"] >= by[name][-1]["error"]
        assert all(point["error"] <= point["claimed"] + 1e-15 for point in by[name])
    assert by["direct"][0]["error"] < 1e-14
    assert 0 < by["paths"][-1]["error"] < 5 * by["paths"][-1]["claimed"]
    assert by["paths"][-1]["cost"] > by["paths"][0]["cost"]
    assert all(point["seconds"] > 0 for point in points)


def test_growth_counts_patches_and_bytes():
    small, large = measure.growth([(1, 1, 1), (16, 16, 8)], size=(1.0, 1.0, 0.5), repeats=1)
    assert (small["patches"], large["patches"]) == (6, 1024)
    assert (small["matrix_bytes"], large["matrix_bytes"]) == (8 * 6**2, 8 * 1024**2)
    assert 2 * large["matrix_bytes"] < large["direct_bytes"] < 100 * 2**20
    # The process holds its libraries besides, and never less than before.
    assert large["process_bytes"] >= small["process_bytes"] > large["direct_bytes"]
    # Five seconds are allowed, on any machine these tests run on.
    assert large["form_factor_seconds"] + large["solver_seconds"]["direct"] < 5
    assert set(large["solver_seconds"]) == {"direct", "krylov", "progressive", "neumann"}
    assert large["form_factor_seconds"] > 0


def test_levels_are_strict_json():
    cube = transport.box()
    found = measure.levels(cube, cube.on_wall(4, 1.0), (0.7, 1.01), key=KEY, paths=4096)
    assert [level["method"] for level in found[:5]] == ["direct", "krylov", "progressive", "neumann", "paths"]
    assert [level["status"] for level in found] == [*["SOLVED"] * 5, "MEANINGLESS", "MEANINGLESS", *["DIVERGES"] * 3]
    assert found[0]["value"][4] == pytest.approx(1.28654972, abs=5e-9)
    assert found[5]["value"][4] == pytest.approx(-15.973378, abs=1e-6)
    text = json.dumps(records.plain(found), allow_nan=False)
    assert json.loads(text)[-1]["value"] == ["NaN"] * 6
    assert json.loads(text)[-1]["error"] == "Infinity"


def test_refinement_comes_to_the_light():
    steps, light = measure.refinement((1, 4), 0.7, key=KEY, paths=2**16)
    assert [step["patches"] for step in steps] == [6, 96]
    assert (steps[0]["glowing"], steps[0]["opposite"], steps[0]["sides"]) == pytest.approx(
        (1.28654972, 0.40926241, 0.40938030), abs=5e-9
    )
    for wall, error in zip(("glowing", "opposite", "sides"), light["errors"], strict=True):
        fine, coarse = steps[1][wall], steps[0][wall]
        assert abs(light[wall] - fine) < 4 * error + abs(fine - coarse)


def test_radii_and_where_they_cross_one():
    found = measure.radii(Lambert, (0.5, 0.8), nodes=8, azimuths=8)
    assert found["radii"] == pytest.approx((0.5, 0.8))
    assert found["largest"] == pytest.approx((0.5, 0.8))
    assert found["crossings"] == []

    def too_bright(n):
        return Normalized(Phong(n), Factor(4, 2 * np.pi))

    found = measure.radii(too_bright, (1.0, 3.0, 30.0), nodes=48, azimuths=96)
    assert len(found["crossings"]) == 1
    (crossing,) = found["crossings"]
    radius = transport.angular_operator(too_bright(crossing), nodes=48, azimuths=96).spectral_radius()
    assert radius.value == pytest.approx(1, abs=1e-4)
