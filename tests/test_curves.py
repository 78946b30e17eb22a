"""The numbers behind figures: against values known from elsewhere, and against the verdict's own."""

from __future__ import annotations

import copy
import functools
import json
import math

import jax.numpy as jnp
import numpy as np
import pytest
from selection import few
from shared import strict_json

import brdfcheck
from brdfcheck import BinomialPower, Factor, Family, Normalized, Phong, plots
from brdfcheck.brdf.blame import Finding
from brdfcheck.messages import UsageError
from brdfcheck.output import curve_files, curves


def test_the_raw_lobe_crosses_the_line_at_18_588():
    curve = curves.albedo_vs_n("binomial-power-raw", samples=9, cos_theta=(1, 1))
    ((low, high),) = curve["above"]
    assert (low, round(high, 3)) == (1, 18.588)
    assert curve["x"][0] == 1
    assert curve["x"][-1] == 1000
    assert any(abs(x - high) < 1e-9 for x in curve["x"])  # the end is a point of the curve
    values = dict(zip(curve["x"], curve["albedo"], strict=True))
    assert values[1] == pytest.approx(2.8777, abs=5e-5)
    assert values[1000] == pytest.approx(0.02355, abs=5e-6)


@pytest.mark.parametrize("name", few(["phong-classical", "cook-torrance", "binomial-power-half"], ("phong-classical",)))
def test_the_largest_over_the_angles_is_no_grid_value(name):
    """Against the continuous maximum of `check` at one value of the parameter."""
    ((parameter, _),) = brdfcheck.brdf.catalog.entry(name).family.ranges.items()
    curve = curves.albedo_vs_n(name, samples=3, **{parameter: (0.3, 0.9) if parameter == "m" else (3.0, 30.0)})
    x, value = curve["x"][1], curve["albedo"][1]
    report = brdfcheck.check(name, **{parameter: (x, x)})
    assert value == pytest.approx(report.albedo, abs=1e-6)
    assert curve["worst_cos_theta"][1] == pytest.approx(report.cos_theta, abs=1e-2)


def test_over_angles_the_ends_are_where_the_albedo_is_1():
    curve = curves.albedo_vs_angle("phong-classical", samples=33, n=10.0)
    ((low, high),) = curve["above"]
    assert low == pytest.approx(math.cos(math.radians(89)))  # the edge of its range
    family = brdfcheck.brdf.catalog.entry("phong-classical").family
    value = float(brdfcheck.albedo(family.build(n=10.0), high).value)
    assert value == pytest.approx(1, abs=2e-9)
    assert curves.albedo_vs_angle("phong", samples=9, n=10.0)["above"] == []
    raw = curves.albedo_vs_angle("binomial-power-raw", samples=9, n=1.0)
    assert raw["above"] == [[0, 1]]


def test_factors_against_the_largest_conserving_one():
    exact = curves.factor("blinn-phong", samples=5, n=(1, 100))
    np.testing.assert_allclose(exact["factor"], exact["exact"], rtol=1e-10)
    wide = curves.factor("blinn-phong-8", samples=5)
    np.testing.assert_allclose(wide["factor"], (np.array(wide["x"]) + 8) / (8 * np.pi), rtol=1e-10)
    ratio = np.array(wide["factor"]) / np.array(wide["exact"])
    np.testing.assert_allclose(ratio, wide["albedo"], rtol=1e-10)
    assert np.max(ratio) == pytest.approx(1.0752, abs=5e-5)
    with pytest.raises(ValueError, match="ggx has no factor"):
        curves.factor("ggx")


def test_a_fit_as_a_curve():
    result = {"name": "blinn-phong", "objective": "minimax", "n": [1, 100], "factor": {"form": "Factor", "A": 8.0, "B": 25.13}}
    curve = curves.fitted("factor", "blinn-phong", result, samples=5)
    assert curve["name"] == "blinn-phong, minimax"
    np.testing.assert_allclose(curve["factor"], (np.array(curve["x"]) + 8) / 25.13, rtol=1e-10)
    assert curve["verdict"] == "VIOLATES"
    with pytest.raises(ValueError, match="unknown form of factor 'Odd'"):
        curves.fitted("factor", "phong", {**result, "factor": {"form": "Odd"}})


@pytest.mark.slow
def test_a_function_has_intervals_too():
    """f = c/pi with c = n/10 exceeds 1 for n > 10; the engine is the adaptive one."""
    curve = curves.albedo_vs_n(lambda n: lambda wi, wo: n / 10 / jnp.pi + 0 * wo[..., 2], samples=3, n=(1, 30))
    ((low, high),) = curve["above"]
    assert curve["engine"].startswith("adaptive")
    assert (low, high) == (pytest.approx(10, abs=1e-3), 30)


def test_held_parameters_and_intervals():
    def build(n, k):
        return Normalized(BinomialPower(n), Factor(6, k))

    curve = curves.albedo_vs_n(Family("planted", build, {"n": (1, 1000), "k": (24.55, 24.55)}), samples=21)
    ((low, high),) = curve["above"]
    assert (low, high) == (pytest.approx(14.3030, abs=1e-3), pytest.approx(23.0561, abs=1e-3))
    assert curve["held"] == {"k": 24.55}


@pytest.mark.parametrize("kind", few(curves.KINDS, ("albedo-vs-angle", "heatmap")))
def test_curves_are_strict_json(kind):
    options = {"n": 10.0} if kind == "albedo-vs-angle" else {"n": (1, 100)}
    curve = curves.KINDS[kind]("binomial-power-unclamped", samples=5, **options)
    assert curve["kind"] == kind
    assert strict_json(json.dumps(curve, allow_nan=False)) == curve


def test_what_cannot_be_a_curve():
    with pytest.raises(ValueError, match="n, k run over ranges; hold all but one"):
        curves.albedo_vs_n(lambda n, k: Phong(n), n=(1, 2), k=(1, 2))
    with pytest.raises(ValueError, match="no parameter to run over"):
        curves.albedo_vs_n(Phong(2.0))
    with pytest.raises(ValueError, match="n runs over 1:1000; a curve over angles needs one value"):
        curves.albedo_vs_angle("binomial-power-half")
    with pytest.raises(ValueError, match="needs a range of n"):
        curves.heatmap("phong", n=(3, 3))
    with pytest.raises(ValueError, match="needs a range of cos theta"):
        curves.heatmap("phong", cos_theta=(1, 1))
    with pytest.raises(KeyError, match="unknown BRDF"):
        curves.albedo_vs_n("fong")
    with pytest.raises(Finding, match="boom"):
        curves.albedo_vs_angle(lambda wi, wo: (_ for _ in ()).throw(RuntimeError("boom")))


def test_round_values():
    assert curves.round_values(1, 1000) == [1, 10, 100, 1000]
    assert curves.round_values(0.01, 1e5) == [0.01, 1, 100, 1000, 1e5]
    assert curves.round_values(0.05, 1) == [0.05, 0.1, 0.2, 0.5, 1]
    assert curves.round_values(0, 1) == [0, 0.25, 0.5, 0.75, 1]
    assert curves.round_values(7, 7) == [7]


# --- files ---


def grid(**options):
    n, mu = np.geomspace(1, 1000, 31), np.linspace(0, 1, 11)
    values = np.asarray(brdfcheck.albedo_table("binomial-power-raw", n, mu).value)
    return n, mu, values


def test_grids_become_curves():
    n, mu, values = grid()
    (top,) = curve_files.from_grid("albedo-vs-n", "raw", "n", n, mu, values)
    ((low, high),) = top["above"]
    assert low == 1
    assert high == pytest.approx(18.588, rel=0.02)  # between samples
    (one,) = curve_files.from_grid("albedo-vs-angle", "raw", "n", n, mu, values, wanted=[10])
    assert one["at"]["n"] == pytest.approx(10)
    assert one["x"][-1] == 1
    assert len(curve_files.from_grid("albedo-vs-angle", "raw", "n", n, mu, values)) == 5
    assert curve_files.from_grid("heatmap", "raw", "n", n[:1], mu, values[:1]) == []
    assert curve_files.from_grid("factor", "raw", "n", n, mu, values) == []


def store(path, **options):
    import xarray

    n, mu, values = grid()
    data = xarray.DataArray(values, dims=("n", "cos_theta"), coords={"n": n, "cos_theta": mu}, name="albedo")
    if options.get("lobes"):
        data = xarray.concat([data, data * 0.1], "brdf").assign_coords(brdf=["raw", "tenth"])
    if options.get("missing"):
        data = data.where(data.n < 5)
    if options.get("hole"):
        data = xarray.concat([data, data], "azimuth").assign_coords(azimuth=[0.0, 1.0])
        data[1, 1, 2] = np.nan
    data.to_dataset(name=options.get("name", "albedo")).to_zarr(path, consolidated=False, zarr_format=3)
    return str(path)


@pytest.mark.filterwarnings("ignore")
def test_stores_of_sweeps(tmp_path):
    plain = store(tmp_path / "one.zarr")
    (curve,) = curve_files.from_store(plain, "albedo-vs-n")
    assert curve["name"] == "one"
    assert curve["largest"]["at"]["n"] == 1
    (curve,) = curve_files.from_store(plain, "albedo-vs-n", n=(20, 1000))
    assert curve["above"] == []
    raw, tenth = curve_files.from_store(store(tmp_path / "two.zarr", lobes=True), "heatmap")
    assert (raw["name"], tenth["name"]) == ("raw", "tenth")
    assert tenth["above"] == []
    (part,) = curve_files.from_store(store(tmp_path / "part.zarr", missing=True), "albedo-vs-n")
    assert part["albedo"][-1] == part["worst_cos_theta"][-1] == "NaN"
    # Not a number at one of the azimuths: the largest of all is not known there.
    (hole,) = curve_files.from_store(store(tmp_path / "hole.zarr", hole=True), "heatmap")
    assert [row.count("NaN") for row in hole["albedo"][:3]] == [0, 1, 0]
    for arguments, words in (
        ((plain, "factor"), "a sweep holds albedos"),
        ((str(tmp_path), "heatmap"), "holds no Zarr store"),
        ((store(tmp_path / "odd.zarr", name="colour"), "heatmap"), "no variable albedo"),
    ):
        with pytest.raises(UsageError, match=words):
            curve_files.from_store(*arguments)
    with pytest.raises(UsageError, match="no n within 2000:3000"):
        curve_files.from_store(plain, "heatmap", n=(2000, 3000))


@pytest.mark.filterwarnings("ignore")
def test_a_damaged_chunk_matters_where_it_is_read(tmp_path):
    """A store may be larger than the memory: only what is asked for is read."""
    import xarray

    n, mu, values = grid()
    data = xarray.DataArray(values, dims=("n", "cos_theta"), coords={"n": n, "cos_theta": mu}).to_dataset(name="albedo")
    data.to_zarr(tmp_path / "s", consolidated=False, zarr_format=3, encoding={"albedo": {"chunks": (1, 11)}})
    (tmp_path / "s/albedo/c/30/0").write_bytes(b"damaged")
    (curve,) = curve_files.from_store(str(tmp_path / "s"), "albedo-vs-n", n=(1, 100))
    np.testing.assert_allclose(curve["albedo"], values[:21].max(axis=1), rtol=1e-11)
    with pytest.raises(UsageError, match=r"s: cannot read the store: \w+: "):
        curve_files.from_store(str(tmp_path / "s"), "albedo-vs-n")


@pytest.mark.filterwarnings("ignore")
def test_stores_over_other_parameters(tmp_path):
    """The longest dimension of numbers takes the place of n and is called by its name; the others make curves."""
    import xarray

    alpha, f0, mu = np.linspace(0.1, 1, 6), np.array([0.04, 0.5]), np.linspace(0, 1, 5)
    values = 1.2 - alpha[:, None, None] * f0[:, None] * mu
    data = xarray.DataArray(values, dims=("alpha", "f0", "cos_theta"), coords={"alpha": alpha, "f0": f0, "cos_theta": mu})
    data.to_dataset(name="albedo").to_zarr(tmp_path / "a.zarr", consolidated=False, zarr_format=3)
    path = str(tmp_path / "a.zarr")
    for kind in ("heatmap", "albedo-vs-n", "albedo-vs-angle"):
        curves_found = curve_files.from_store(path, kind)
        assert {curve["label"] for curve in curves_found} == {"f0=0.04", "f0=0.5"}
        assert curves_found[0]["largest"]["at"] == {"alpha": pytest.approx(0.1)}
    low, high = curve_files.from_store(path, "heatmap")
    assert (low["parameter"], low["x"]) == ("alpha", pytest.approx(alpha))
    assert np.array(high["albedo"]) == pytest.approx(values[:, 1])
    assert "roughness α" in [axes.get_xlabel() for axes in plots.figure("heatmap", [low]).axes]
    with pytest.raises(UsageError, match="--n is for sweeps over n; this one is over alpha"):
        curve_files.from_store(path, "heatmap", n=(1, 10))
    data[0, 0].drop_vars(["alpha", "f0"]).to_dataset(name="albedo").to_zarr(
        tmp_path / "b.zarr", consolidated=False, zarr_format=3
    )
    with pytest.raises(UsageError, match="needs the dimension cos_theta and one of numbers, as n; it has cos_theta"):
        curve_files.from_store(str(tmp_path / "b.zarr"), "heatmap")


@functools.cache
def small():
    return curves.albedo_vs_n("phong", samples=3, n=(1, 10))


def record(tmp_path, **changes):
    curve = copy.deepcopy(small())
    path = tmp_path / "record.json"
    text = {"schema": "brdfcheck-results", "schema_version": 1, "command": "plot", "results": [curve], **changes}
    path.write_text(json.dumps(text))
    return str(path), curve


def test_records(tmp_path):
    path, curve = record(tmp_path)
    ((read,), fits) = curve_files.read(path, "albedo-vs-n")
    assert read["albedo"] == curve["albedo"]
    assert fits == []


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"schema": "other"}, "not a record of brdfcheck"),
        ({"results": 3}, "not a record of brdfcheck"),
        ({"schema_version": 99}, "newer brdfcheck"),
        ({"results": [], "command": "check"}, "the record of brdfcheck check holds no curves"),
        ({"results": [{"kind": "albedo-vs-n", "name": "x"}]}, "the curve x has no 'parameter'"),
    ],
)
def test_records_that_are_none(tmp_path, changes, words):
    path, _ = record(tmp_path, **changes)
    with pytest.raises(UsageError, match=words):
        curve_files.read(path, "albedo-vs-n")


@pytest.mark.parametrize(
    "damage",
    [{"albedo": [1]}, {"x": [3, 2, 1]}, {"x": []}, {"albedo": ["a", 1, 1]}, {"above": [[1]]}, {"range": ["x", 1]}],
)
def test_damaged_curves(tmp_path, damage):
    path, curve = record(tmp_path)
    path, _ = record(tmp_path, results=[{**curve, "x": curve["x"][:3], "albedo": curve["albedo"][:3], **damage}])
    with pytest.raises(UsageError, match="the curve phong is damaged"):
        curve_files.read(path, "albedo-vs-n")


def test_a_record_of_another_kind(tmp_path):
    heat = curves.heatmap("phong", samples=4, n=(1, 10))
    path, _ = record(tmp_path, results=[heat])
    (top,), _ = curve_files.read(path, "albedo-vs-n")
    assert top["kind"] == "albedo-vs-n"
    with pytest.raises(UsageError, match="holds no curve for factor; it holds heatmap"):
        curve_files.read(path, "factor")


def test_where_an_albedo_has_no_bound_it_exceeds_1():
    # Its error is without bound too: their difference is not a number, and the interval ended before.
    x, value, error = np.array([0.0, 0.5, 1.0]), np.array([np.inf, 3.0, 0.5]), np.array([np.inf, 0.0, 0.0])
    ((low, high),) = curves._intervals(x, value, error, lambda at: (3.0 - 5.0 * (at - 0.5), at), 1e-9)
    assert low == 0
    assert high == pytest.approx(0.9, abs=1e-6)


@pytest.mark.parametrize("axis", [0.0, np.pi / 4, 1.1])
def test_a_curve_is_the_largest_over_the_azimuth(axis):
    def turned(wi, wo, k):
        azimuth = jnp.arctan2(wi[..., 1], wi[..., 0])
        return (0.8 + k * jnp.cos(2 * (azimuth - axis - wi[..., 2])) * (1 - wi[..., 2] ** 2)) / np.pi

    curve = curves.albedo_vs_angle(turned, k=0.3)
    mu = np.asarray(curve["x"])
    np.testing.assert_allclose(curve["albedo"], 0.8 + 0.3 * (1 - mu**2), atol=1e-4)
    ((low, high),) = curve["above"]
    assert (low, high) == (0, pytest.approx((1 / 3) ** 0.5, abs=1e-3))
