"""Measured files, written from BRDFs that are known and read back: values, albedos within their bars, verdicts, commands."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import equinox as eqx
import numpy as np
import pytest
from measured import ggx, ggx_albedo, lambert, merl_bytes, merl_directions, rgl_arrays, rgl_bytes, tensor_file, write
from selection import few
from shared import Run, direction

from brdfcheck import check, load
from brdfcheck.brdf.tables import AbstractTable
from brdfcheck.cli import ExitCode
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.quadrature.samples import TIMES, bars
from brdfcheck.verdict import Report, Verdict

LIGHTS = np.radians([0, 10, 20, 30, 40, 50, 60, 70, 80, 88])
COARSE = np.radians([0, 25, 50, 75, 88])
STEEP = (0.8, 0.8)


@pytest.fixture(autouse=True)
def few_angles(monkeypatch: pytest.MonkeyPatch) -> None:
    """The look-ups are compared at fewer angles than otherwise."""
    monkeypatch.setattr("brdfcheck.verdict.measured._COSINES", (9, 3))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("measured")


@pytest.fixture(scope="module")
def paint(folder: Path) -> str:
    """A MERL file of GGX, alpha 0.1, green."""
    return write(folder, "paint.binary", merl_bytes(ggx(0.1), (0.3, 1, 0.5)))


@pytest.fixture(scope="module")
def satin(folder: Path) -> str:
    """An RGL file of GGX, alpha 0.3, blue."""
    return write(folder, "satin.bsdf", rgl_bytes(0.3, LIGHTS, colours=(0.25, 0.5, 1.0)))


@pytest.fixture(scope="module")
def needle(folder: Path) -> str:
    """A MERL file of GGX, alpha 0.03."""
    return write(folder, "needle.binary", merl_bytes(ggx(0.03)))


def table_of(path: str) -> AbstractTable:
    return load(path).build()


@eqx.filter_jit
def values(table: AbstractTable, wi: np.ndarray, wo: np.ndarray) -> Any:
    """What a table has for pairs of directions: tables of one kind are one program."""
    return table(wi, wo)


def turned(directions: np.ndarray, angle: float) -> np.ndarray:
    """Turned about the normal."""
    x, y, z = directions.T
    return np.stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y, z], axis=-1)


def pairs(count: int, steepest: float = 0.2) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(4)
    wi, wo = direction(random.uniform(steepest, 1, (2, count)), random.uniform(0, 2 * np.pi, (2, count)))
    return wi, wo


# --- values ---


def test_a_merl_table_has_its_samples_in_the_middle_of_their_bins(paint: str) -> None:
    wi, wo = (part[::7, ::6, ::11].reshape(-1, 3) for part in merl_directions())
    lit = np.minimum(wi[:, 2], wo[:, 2]) > 0
    wi, wo = turned(wi[lit], 2.3), turned(wo[lit], 2.3)
    exact = ggx(0.1)(wi, wo)[:, None] * [0.3, 1, 0.5]
    table = table_of(paint)
    for reading in (table, table.by_nearest()):
        np.testing.assert_allclose(values(reading, wi, wo), exact, rtol=1e-9)
        np.testing.assert_allclose(values(reading, wo, wi), exact, rtol=1e-9)  # the same half a turn away
    # Half a bin off, linear look-up is half way between two samples, and the nearest sample is one of them.
    wi, wo = pairs(500)
    linear, nearest = (values(reading, wi, wo)[:, 1] for reading in (table, table.by_nearest()))
    exact = ggx(0.1)(wi, wo)
    assert 4 * np.median(np.abs(linear / exact - 1)) < np.median(np.abs(nearest / exact - 1)) < 0.1


@pytest.mark.slow
def test_nothing_is_reflected_from_below(paint: str, satin: str) -> None:
    wi, wo = pairs(8)
    for path in (paint, satin):
        table = table_of(path)
        assert np.all(np.asarray(values(table, wi, wo)) > 0)
        assert not np.any(np.asarray(values(table, wi, wo * [1, 1, -1])))
        assert not np.any(np.asarray(values(table, wi * [1, 1, -1], wo)))
        special = np.array([[0, 0, 1.0], [1, 0, 0], [1, 0, 0]]), np.array([[0, 0, 1.0], [-1, 0, 0], [0, 0, 1]])
        assert np.all(np.isfinite(np.asarray(values(table, *special))))


@pytest.mark.parametrize(
    "options",
    [
        pytest.param({}, id="isotropic"),
        pytest.param({"jacobian": False}, id="values", marks=pytest.mark.slow),
        pytest.param({"phi_i": np.linspace(-np.pi, np.pi, 25)}, id="anisotropic", marks=pytest.mark.slow),
        pytest.param({"phi_i": np.linspace(0, np.pi / 2, 7)}, id="a quarter", marks=pytest.mark.slow),
    ],
)
def test_an_rgl_table_has_the_values_of_its_brdf(options: dict[str, Any], folder: Path) -> None:
    sizes = {"size": 16, "finer": 32} if "phi_i" in options else {}
    path = write(folder, "values.bsdf", rgl_bytes(0.4, LIGHTS, **sizes, **options))
    wi, wo = pairs(1000)
    exact, table = ggx(0.4)(wi, wo), table_of(path)
    off, rough = (np.abs(np.asarray(values(reading, wi, wo))[:, 0] / exact - 1) for reading in (table, table.by_nearest()))
    assert np.median(off) < 0.012
    assert np.median(rough) > 2 * np.median(off)


def test_an_rgl_table_is_exact_at_its_samples_whatever_lies_between(folder: Path) -> None:
    """A density far from that of the facets moves the samples, not the values at them."""
    arrays = rgl_arrays(0.5, COARSE, size=9, finer=17)
    random = np.random.default_rng(1)
    arrays["vndf"] = random.uniform(0.2, 1, arrays["vndf"].shape).astype(np.float32)
    arrays["ndf"] = np.ones_like(arrays["ndf"])
    arrays["sigma"] = np.full_like(arrays["sigma"], 0.25)
    s, t = np.linspace(0, 1, 9), np.linspace(0, 1, 9)[:, None]
    arrays["rgb"] = np.broadcast_to((1 + s + 2 * t)[None, None, None], arrays["rgb"].shape).astype(np.float32)
    table = table_of(write(folder, "density.bsdf", tensor_file(arrays)))
    tilt = float(COARSE[2])
    wi = np.array([np.sin(tilt), 0, np.cos(tilt)])
    half, turn = random.uniform(0, 0.3, 200), random.uniform(-3.1, 3.1, 200)
    normal = np.stack([np.sin(half) * np.cos(turn), np.sin(half) * np.sin(turn), np.cos(half)], axis=-1)
    wo = 2 * (normal @ wi)[:, None] * normal - wi
    # The density summed on a fine grid: the share of rows below y, and of the row at y before x.
    x, y = np.sqrt(half * 2 / np.pi), (turn + np.pi) / (2 * np.pi)
    density = arrays["vndf"][0, 2].astype(float)
    fine = np.linspace(0, 1, 16 * 250 + 1)
    rows = np.array([np.interp(fine, np.linspace(0, 1, 17), density[:, k]) for k in range(17)]).T
    totals = np.trapezoid(rows, dx=1 / 16, axis=1)
    below = np.concatenate([[0], np.cumsum((totals[1:] + totals[:-1]) / 2)])
    before = []
    for place, height in zip(x, y, strict=True):
        row = np.interp(
            fine, np.linspace(0, 1, 17), [np.interp(height, np.linspace(0, 1, 17), density[:, k]) for k in range(17)]
        )
        sums = np.concatenate([[0], np.cumsum((row[1:] + row[:-1]) / 2)])
        before.append(np.interp(place, fine, sums) / sums[-1])
    expected = (1 + np.array(before) + 2 * np.interp(y, fine, below / below[-1])) / wo[:, 2]
    np.testing.assert_allclose(np.asarray(values(table, np.broadcast_to(wi, wo.shape), wo))[:, 1], expected, rtol=2e-6)


# --- albedos ---


@pytest.mark.parametrize("alpha", few([0.03, 0.3], (0.03,)))
def test_the_albedo_of_a_merl_table_agrees_with_the_known_one_within_its_bar(alpha: float, folder: Path, needle: str) -> None:
    path = needle if alpha == 0.03 else write(folder, "known.binary", merl_bytes(ggx(alpha)))
    _agrees(load(path), alpha, np.array([1, 0.8, 0.5, 0.2]), loosest=0.02)


def test_the_albedo_of_an_rgl_table_agrees_with_the_known_one_within_its_bar(satin: str) -> None:
    _agrees(load(satin), 0.3, np.array([1, 0.8, 0.5]), loosest=0.08)


def _agrees(family: Any, alpha: float, mu: np.ndarray, loosest: float) -> None:
    albedo, still = PointwiseAlbedo(family), np.zeros(len(mu))
    value, error = albedo(np.zeros((len(mu), 0)), mu, still)
    bar = error + bars(albedo, mu, still).max(axis=1)
    known = np.array([ggx_albedo(alpha, cosine) for cosine in mu])
    assert np.all(np.abs(value - known) <= bar)
    assert np.all(bar < loosest)
    # The plain difference of the two look-ups would not do: linear look-up is off by twice that much.
    if alpha == 0.03:
        assert np.all(np.abs(value - known) > 1.3 * (bar - error) / TIMES)


def test_channels_are_kept(paint: str) -> None:
    # A table is one wherever it came from.
    report = check(load(paint).build(), cos_theta=STEEP, effort="quick")
    assert report.doubt is not None
    assert (report.channel, report.channels) == (1, 3)
    red = PointwiseAlbedo(load(paint)).channels(np.zeros((1, 0)), np.array([0.8]), np.zeros(1))[0][0]
    np.testing.assert_allclose(red / red[1], [0.3, 1, 0.5], rtol=1e-6)


@pytest.mark.slow
def test_of_many_wavelengths_the_brightest_are_searched_and_named(folder: Path) -> None:
    colours = tuple(0.4 + 0.5 * np.sin(np.linspace(0, np.pi, 21)))
    path = write(folder, "spectra.bsdf", rgl_bytes(0.5, COARSE, size=12, finer=24, colours=colours))
    assert np.asarray(values(table_of(path), *pairs(3))).shape == (3, 21)
    report = check(path, cos_theta=STEEP, effort="quick")
    assert (report.channel, report.channels) == (10, 21)
    assert report.doubt is not None
    assert report.doubt.channel == "550 nm"
    assert any("of 21 channels the 8" in note for note in report.notes)


# --- verdicts ---


def verdict(path: str, **options: Any) -> Report:
    return check(path, effort="quick", **options)


def test_a_table_of_a_conserving_brdf_is_undecided_where_it_is_above_1(needle: str) -> None:
    """GGX of alpha 0.03 reflects 0.9991 at normal incidence; its table 1.0042 and 1.0016 by the two look-ups."""
    report = verdict(needle, cos_theta=(1, 1))
    assert report.albedo == pytest.approx(1.0042, abs=2e-4)
    assert report.doubt is not None
    assert report.doubt.linear > report.doubt.nearest == pytest.approx(1.0016, abs=2e-4)
    assert report.verdict is Verdict.UNDECIDED
    assert report.albedo - report.error < ggx_albedo(0.03, 1.0)


@pytest.mark.parametrize(
    ("reflectance", "expected"), [pytest.param(0.7, Verdict.CONSERVES, marks=pytest.mark.slow), (1.1, Verdict.VIOLATES)]
)
def test_a_smooth_table_has_a_verdict(reflectance: float, expected: Verdict, folder: Path) -> None:
    report = verdict(write(folder, "matt.binary", merl_bytes(lambert(reflectance))), cos_theta=(0.4, 1))
    assert report.verdict is expected
    assert abs(report.albedo - reflectance) <= report.error < 0.01
    assert report.doubt is not None
    assert report.doubt.reach >= report.albedo + report.error
    assert not report.findings


def hidden(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    return np.minimum(wi[..., 2], wo[..., 2]) < 0.5


def test_no_data_count_as_nothing_and_are_told(folder: Path) -> None:
    path = write(folder, "holes.binary", merl_bytes(lambert(0.8), no_data=hidden))
    report = verdict(path, cos_theta=STEEP)
    assert report.albedo == pytest.approx(0.8 * 0.75, abs=0.01)  # what is reflected to less than 60 degrees
    assert report.verdict is Verdict.CONSERVES
    assert report.doubt is not None
    assert report.doubt.filled == pytest.approx(0.8, abs=0.03)
    assert 0 < report.doubt.missing < report.doubt.samples
    (finding,) = report.findings
    assert f"no data: {report.doubt.missing} of the {report.doubt.samples}" in finding
    assert "lower bound" in finding
    assert "more than 6" in finding  # degrees
    assert not report.passed


@pytest.mark.slow
def test_what_might_be_there_can_only_be_too_much_for_one_that_conserves(folder: Path) -> None:
    bright = write(folder, "bright.binary", merl_bytes(lambert(1.2), no_data=hidden))
    report = verdict(bright, cos_theta=STEEP)
    assert report.doubt is not None
    assert report.albedo + report.error < 1 < report.doubt.filled
    assert report.verdict is Verdict.UNDECIDED
    glare = write(folder, "glare.binary", merl_bytes(lambert(2.0), no_data=hidden))
    assert verdict(glare, cos_theta=STEEP).verdict is Verdict.VIOLATES


@pytest.mark.slow
def test_other_angles_have_a_say(folder: Path) -> None:
    """Where the look-ups differ much at another angle than the worst one, that is what the verdict has to bear."""
    edge = 0.6

    def f(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:  # a checkerboard of bins for tilted light
        tilted = np.minimum(wi[..., 2], wo[..., 2]) < edge
        board = np.indices(wi.shape[:-1]).sum(axis=0) % 2
        return np.where(tilted, 6 * board, 0.9) / np.pi * np.where(tilted, 0.3, 1)

    path = write(folder, "board.binary", merl_bytes(f))
    report = verdict(path, cos_theta=(0.3, 1))
    assert report.doubt is not None
    assert report.doubt.reach > report.albedo + report.error
    assert (report.verdict is Verdict.CONSERVES) == (report.doubt.reach <= 1 + report.tolerance and report.settled)


# --- commands ---


def test_the_record_has_what_the_bar_is_made_of(satin: str, run: Run) -> None:
    code, out, _ = run("check", satin, "--cos-theta", "0.6:1", "--effort", "quick", "--json", "-")
    (result,) = json.loads(out)["results"]
    doubt = result["doubt"]
    assert (code == ExitCode.PASSED) == result["passed"]
    assert result["verdict"] == "CONSERVES"
    bar = TIMES * abs(doubt["linear"] - doubt["nearest"]) + doubt["quadrature"]
    assert bar <= result["error"] * (1 + 1e-9)
    assert doubt["layout"].startswith("RGL: 10 directions of light")
    assert doubt["filled"] is None
    assert any("by nearest look-up" in note for note in result["notes"])


@pytest.mark.slow
def test_the_errors_of_a_sweep_hold_the_bar(here: Path, run: Run) -> None:
    write(here, "matt.bsdf", rgl_bytes(0.6, COARSE, size=10, finer=16, colours=(0.5, 0.6, 0.7)))
    (here / "sweep.toml").write_text('brdf = "matt.bsdf"\n[axes]\ncos_theta = { linspace = [0.4, 1, 3] }\n')
    code, _, err = run("sweep", "sweep.toml", "--out", "matt.zarr")
    assert code == ExitCode.PASSED, err
    import xarray

    store = xarray.open_zarr(here / "matt.zarr")
    albedo = PointwiseAlbedo(load("matt.bsdf"))
    mu = store.cos_theta.values
    value, _error = albedo.channels(np.zeros((3, 0)), mu, np.zeros(3))
    np.testing.assert_allclose(store.albedo.values, value, atol=2e-5)
    assert np.all(store.error.values >= bars(albedo, mu, np.zeros(3)) * (1 - 1e-9))


@pytest.mark.slow
def test_a_fit_is_one_constant(here: Path, run: Run) -> None:
    write(here, "much.bsdf", rgl_bytes(0.6, COARSE, size=10, finer=16, colours=(1, 2, 3)))
    code, out, err = run("fit", "much.bsdf", "--export", "csv", "much.csv", "--json", "fit.json")
    assert code == ExitCode.PASSED, (out, err)
    (result,) = json.loads((here / "fit.json").read_text())["results"]
    assert result["factor"]["A"] == 0
    assert result["factor"]["B"] > 2
    assert result["report"]["verdict"] == "CONSERVES"
    assert result["report"]["doubt"]["reach"] == pytest.approx(1, abs=1e-6)
    rows = np.loadtxt(here / "much.csv", delimiter=",", ndmin=2)
    assert rows.shape == (1, 65)
    assert np.all(rows[0, 1:] <= 1)
    code, _, err = run("fit", "much.bsdf", "--over", "n=2")
    assert code == ExitCode.USAGE_ERROR
    assert "--n" in err


def test_python_takes_it_by_its_name(satin: str) -> None:
    family = load(satin, cos_theta=(0.5, 1))
    assert (family.name, dict(family.ranges), family.cos_theta) == (satin, {}, (0.5, 1))
    with pytest.raises(ValueError, match=r"has no parameter 'n'; its parameters: none"):
        load(satin, n=(1, 2))
    with pytest.raises(ValueError, match="a measured file holds one BRDF"):
        load(f"{satin}:red")
    with pytest.raises(ValueError, match="are for shader files"):
        load(satin, defines={"A": "1"})
