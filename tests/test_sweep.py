"""Sweeps on one machine: values, the store, and that nothing is lost, whatever happens to it."""

from __future__ import annotations

import ast
import contextlib
import errno
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import jax
import numpy as np
import pytest
import xarray

import brdfcheck
from brdfcheck import cli
from brdfcheck.messages import UsageError
from brdfcheck.sweep import Plan, SweepError, parse, run_sweep, runner, store
from brdfcheck.sweep.compute import Computer
from brdfcheck.sweep.store import Store

ROOT = Path(__file__).parent.parent


def toml(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def contents(folder: Path, *, seconds: bool = False) -> dict[str, bytes]:
    """Every file of a store; the measurements only where they are asked for."""
    files = {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}
    return {name: data for name, data in files.items() if seconds or not name.startswith("seconds/c")}


def differing(one: Path, other: Path) -> list[str]:
    """The files in which two stores differ, measurements left out."""
    left, right = contents(one), contents(other)
    return [name for name in sorted({*left, *right}) if left.get(name) != right.get(name)]


def sweep(document: dict, out: Path, folder: Path | None = None, **options: object) -> xarray.Dataset:
    return run_sweep(parse(document, folder=folder), out, **options)  # pyright: ignore[reportArgumentType]


def process(*arguments: object, devices: int = 1) -> subprocess.Popen[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "JAX_PLATFORMS": "cpu"}
    if devices > 1:
        environment["XLA_FLAGS"] = f"--xla_force_host_platform_device_count={devices}"
    command = [sys.executable, "-m", "brdfcheck", "sweep", *map(str, arguments)]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finished(running: subprocess.Popen[str]) -> tuple[int, str, str]:
    """Exit code, stdout and stderr of a process."""
    stdout, stderr = running.communicate(timeout=200)
    return running.returncode, stdout, stderr


# --- values ---


@pytest.mark.parametrize(
    ("document", "tolerance"),
    [
        ({"brdf": "binomial-power-half", "axes": {"n": {"geomspace": [0.3, 1000, 70]}, "cos_theta": [0.0, 0.3, 1.0]}}, 1e-11),
        ({"brdf": "phong", "rule": "zonal", "axes": {"cos_theta": {"linspace": [0.1, 1, 7]}, "n": [1, 10, 300]}}, 1e-11),
        ({"brdf": "lambert", "axes": {"reflectance": [0.0, 0.5, 1.0], "cos_theta": [0.5, 1.0]}}, 1e-12),
        ({"brdf": "cook-torrance", "axes": {"m": [0.3, 0.6], "cos_theta": [0.4, 0.9]}}, 1e-8),
        ({"brdf": "phong", "rule": "adaptive", "axes": {"n": [20.0], "cos_theta": [0.7]}}, 1e-7),
    ],
    ids=["table", "zonal", "lambert", "half-vector", "adaptive"],
)
def test_values_are_those_of_albedo(document, tolerance, tmp_path):
    data = sweep(document, tmp_path / "s")
    assert set(data.albedo.dims) == set(document["axes"])
    family = brdfcheck.brdf.catalog.entry(document["brdf"]).family
    (parameter,) = family.ranges
    random = np.random.default_rng(1)
    for _ in range(6):
        cell = data.isel({name: int(random.integers(size)) for name, size in data.albedo.sizes.items()})
        brdf = family.build(**{parameter: float(cell[parameter])})
        expected = brdfcheck.albedo(brdf, float(cell.cos_theta))
        assert abs(float(cell.albedo) - float(expected.value)) <= float(cell.error) + float(expected.error)
        assert float(cell.error) < tolerance
        assert int(cell.evaluations) > 0


def test_precision_and_k_are_axes(tmp_path):
    document = {
        "brdf": "BinomialPower",
        "rule": "zonal",
        "precision": ["float32", "float64"],
        "axes": {"n": [3.0, 30.0, 400.0], "k": [4, 16], "cos_theta": [0.2, 1.0]},
    }
    data = sweep(document, tmp_path / "s")
    assert data.albedo.dims == ("precision", "n", "k", "cos_theta")
    for n, k, mu in itertools.product([3.0, 30.0, 400.0], [4, 16], [0.2, 1.0]):
        expected = float(brdfcheck.albedo(brdfcheck.BinomialPower(n, k), mu).value)
        np.testing.assert_allclose(data.albedo.sel(precision="float64", n=n, k=k, cos_theta=mu), expected, rtol=1e-12)
    difference = abs(data.albedo.sel(precision="float32") - data.albedo.sel(precision="float64"))
    assert bool((difference <= data.error.sel(precision="float32") * 1.01).all())
    assert float(difference.max()) > 1e-9, "float32 must have been computed in float32"


def test_brdf_rule_and_rtol_are_axes(tmp_path):
    document = {
        "brdf": ["binomial-power-half", "BinomialPower"],
        "rule": ["default", "zonal"],
        "axes": {"n": [3.0, 30.0], "k": 4, "cos_theta": [0.2, 1.0]},
    }
    data = sweep(document, tmp_path / "s")
    assert data.albedo.dims == ("brdf", "rule", "n", "cos_theta")
    np.testing.assert_allclose(data.albedo.sel(rule="default"), data.albedo.sel(rule="zonal"), rtol=1e-12)
    # A catalogue entry keeps its factor whatever k is.
    factors = data.albedo.sel(brdf="binomial-power-half") / data.albedo.sel(brdf="BinomialPower")
    np.testing.assert_allclose(factors.sel(n=30.0), (30 + 7.2427) / 26.1702, rtol=1e-12)
    axes = {"n": [30.0], "cos_theta": [0.7]}
    both = sweep({"brdf": "phong", "rule": "zonal", "rtol": [1e-3, 1e-12], "axes": axes}, tmp_path / "r")
    assert both.evaluations.sel(rtol=1e-3).item() < both.evaluations.sel(rtol=1e-12).item()


def test_every_rule_of_the_package_is_a_value_of_the_axis(tmp_path):
    rules = ["default", "gauss-product:32", "uniform", "lobe-warped-gauss", "adaptive:1e-5", "zonal", "closed-form"]
    from brdfcheck.quadrature.registry import RULES

    rules = [rule for rule in rules if rule == "default" or rule.partition(":")[0] in RULES]
    rules.append(next(name for name, rule in RULES.items() if rule.random))
    document = {"brdf": "phong", "rule": rules, "axes": {"n": [3.0, 20.0], "cos_theta": [0.5, 1.0]}, "seed": 7}
    data = sweep(document, tmp_path / "s")
    difference = abs(data.albedo - data.albedo.sel(rule="default"))
    assert bool((difference <= 5 * (data.error + data.error.sel(rule="default"))).all())
    chance = data.albedo.sel(rule=rules[-1])
    assert float(abs(chance - data.albedo.sel(rule="default")).max()) > 1e-9
    # Chance depends on the seed and the cell, not on how the sweep is cut.
    cut = sweep({**document, "rule": rules[-1], "chunks": {"n": 1}}, tmp_path / "c")
    np.testing.assert_array_equal(cut.albedo, sweep({**document, "rule": rules[-1]}, tmp_path / "w").albedo)
    other = sweep({**document, "rule": rules[-1], "seed": 8}, tmp_path / "o")
    assert float(abs(other.albedo - cut.albedo).min()) > 0


USER = """
import helper
import jax.numpy as jnp
import numpy as np

def glossy(n, ks=1.0):
    def f(wi, wo):
        mirror = wi * jnp.array([-1.0, -1.0, 1.0])
        return ks * helper.factor(n) * jnp.maximum(jnp.sum(mirror * wo, axis=-1), 0) ** n
    return f

def tinted(wi, wo, k_red):
    return jnp.stack([k_red * wo[..., 2], 0.5 * jnp.ones_like(wo[..., 2])], axis=-1)

def numpy_only(wi, wo):
    return np.full(len(np.asarray(wo)), 0.25 / np.pi)

def brushed(wi, wo):
    return (1 + 0.5 * wi[..., 0]) / np.pi

def fails_above_ten(n):
    def f(wi, wo):
        if n > 10:
            raise ValueError("too sharp")
        return np.asarray(wo)[..., 2] ** float(n)
    return f

def nowhere(wi, wo):
    return jnp.full(wo.shape[:-1], jnp.nan)
"""


@pytest.fixture
def mine(tmp_path):
    (tmp_path / "helper.py").write_text("import math\ndef factor(n):\n    return (n + 2) / (2 * math.pi)\n")
    (tmp_path / "mine.py").write_text(USER)
    return tmp_path


def test_users_functions(mine):
    axes = {"n": [1.0, 20.0], "ks": [0.5, 1.0], "cos_theta": [0.5, 1.0]}
    data = sweep({"brdf": "mine.py:glossy", "axes": axes}, mine / "s", mine)
    exact = np.array([brdfcheck.albedo_table("phong", [1.0, 20.0], [0.5, 1.0]).value])
    np.testing.assert_allclose(data.albedo.sel(ks=1.0), exact[0], rtol=1e-7)
    np.testing.assert_allclose(data.albedo.sel(ks=0.5), exact[0] / 2, rtol=1e-7)
    tinted = sweep({"brdf": "mine.py:tinted", "axes": {"k_red": [0.1, 0.2, 0.3], "cos_theta": 1}}, mine / "t", mine)
    assert tinted.albedo.dims == ("k_red", "channel")
    np.testing.assert_allclose(tinted.albedo.sel(channel=1), np.pi / 2, rtol=1e-7)
    np.testing.assert_allclose(tinted.albedo.sel(channel=0), 2 * np.pi / 3 * tinted.k_red, rtol=1e-7)
    turned = sweep({"brdf": "mine.py:brushed", "axes": {"azimuth": [0.0, 1.0], "cos_theta": [0.6]}}, mine / "b", mine)
    np.testing.assert_allclose(turned.albedo[:, 0], 1 + 0.4 * np.cos([0.0, 1.0]), rtol=1e-7)
    assert turned.azimuth.units == "rad"
    plain = sweep({"brdf": "mine.py:numpy_only", "axes": {"cos_theta": [0.6]}}, mine / "p", mine)
    np.testing.assert_allclose(plain.albedo, 0.25, rtol=1e-7)
    rough = sweep({"brdf": "mine.py:numpy_only", "precision": "float32", "axes": {"cos_theta": [0.6]}}, mine / "f", mine)
    assert float(rough.error[0]) > 1e-8
    nothing = sweep({"brdf": "mine.py:nowhere", "axes": {"cos_theta": [0.6]}}, mine / "n", mine)
    assert np.isnan(nothing.albedo[0])
    assert np.isinf(nothing.error[0])


def test_a_users_brdf_that_fails_in_the_middle_keeps_what_was_computed(mine):
    document = {"brdf": "mine.py:fails_above_ten", "axes": {"n": [1.0, 2.0, 12.0], "cos_theta": [1.0]}, "chunks": {"n": 1}}
    with pytest.raises(UsageError, match=r"mine.py:fails_above_ten at n=12, cos_theta=1: .*too sharp"):
        sweep(document, mine / "s", mine)
    data = xarray.open_zarr(mine / "s", chunks=None)
    np.testing.assert_allclose(data.albedo[:, 0], [2 * np.pi / 3, np.pi / 2, np.nan], rtol=1e-7)


def test_a_changed_file_of_the_users_is_another_sweep(mine):
    document = {"brdf": "mine.py:numpy_only", "axes": {"cos_theta": [0.6]}}
    sweep(document, mine / "s", mine)
    (mine / "mine.py").write_text(USER.replace("0.25", "0.125"))
    with pytest.raises(UsageError, match=r"files.mine\.py\.mine\.py: the store has "):
        sweep(document, mine / "s", mine)


# --- the store ---

SMALL = {
    "brdf": "phong",
    "axes": {"n": {"geomspace": [1, 100, 5]}, "cos_theta": {"linspace": [0.1, 1, 7]}},
    "chunks": {"cos_theta": 3},
}


def test_the_store_says_what_is_in_it(tmp_path):
    data = sweep({**SMALL, "precision": "float64"}, tmp_path / "s")
    for name, variable in data.variables.items():
        assert variable.attrs["units"], name
        assert variable.attrs["long_name"], name
    assert data.seconds.dims == ("n_chunk", "cos_theta_chunk")
    assert data.seconds.units == "s"
    assert float(data.seconds.min()) > 0
    assert data.albedo.attrs["units"] == "1"
    assert str(data.brdf.values) == "phong"
    assert json.loads(data.settings)["axes"]["n"] == {"geomspace": [1.0, 100.0, 5]}
    versions = json.loads(data.versions)
    assert versions["brdfcheck"] == brdfcheck.__version__
    assert {"jax", "numpy", "zarr"} <= set(versions)
    assert data.source_commit == "unknown" or len(data.source_commit.removesuffix("-dirty")) == 40
    assert "never clamped" in data.convention
    # As the issue has it: lazily, by default.
    np.testing.assert_array_equal(xarray.open_zarr(tmp_path / "s").albedo, data.albedo)


def test_one_cell(tmp_path):
    data = sweep({"brdf": "phong", "axes": {"n": 10, "cos_theta": 1.0}}, tmp_path / "s")
    np.testing.assert_allclose(float(data.albedo), 1, rtol=1e-12)
    assert data.albedo.dims == ()
    assert float(data.n) == 10
    before = contents(tmp_path / "s", seconds=True)
    sweep({"brdf": "phong", "axes": {"n": 10, "cos_theta": 1.0}}, tmp_path / "s")
    assert contents(tmp_path / "s", seconds=True) == before


def test_a_complete_store_is_left_alone(tmp_path):
    sweep(SMALL, tmp_path / "s")
    before = contents(tmp_path / "s", seconds=True)
    summary = runner.fill(Plan(parse(SMALL)), tmp_path / "s")
    assert (summary.computed, summary.found) == (0, 3)
    assert contents(tmp_path / "s", seconds=True) == before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"axes": {**SMALL["axes"], "n": {"geomspace": [1, 100, 6]}}},
         "axes.n: the store has geomspace [1.0, 100.0, 5], here it is geomspace [1.0, 100.0, 6]"),
        ({"axes": {"cos_theta": SMALL["axes"]["cos_theta"], "n": SMALL["axes"]["n"]}}, "dimensions: the store has"),
        ({"brdf": "blinn-phong"}, "brdf: the store has phong, here it is blinn-phong"),
        ({"precision": "float32"}, "precision: the store has float64, here it is float32"),
        ({"rtol": 1e-6}, "rtol: the store has none, here it is 1e-06"),
        ({"chunks": {"cos_theta": 2}}, "chunks.cos_theta: the store has 3, here it is 2"),
    ],
)  # fmt: skip
def test_another_configuration_is_refused_with_the_difference(change, message, tmp_path):
    sweep(SMALL, tmp_path / "s")
    before = contents(tmp_path / "s", seconds=True)
    with pytest.raises(UsageError) as error:
        sweep({**SMALL, **change}, tmp_path / "s")
    assert message in str(error.value)
    assert contents(tmp_path / "s", seconds=True) == before


def test_other_software_is_refused_with_the_difference(tmp_path, monkeypatch):
    sweep(SMALL, tmp_path / "s")
    monkeypatch.setattr(store.provenance, "versions", lambda: {**json.loads(data_versions), "jax": "0.0.1"})
    data_versions = xarray.open_zarr(tmp_path / "s", chunks=None).versions
    with pytest.raises(UsageError, match=r"begun by other software .*versions.jax: the store has .*, here it is 0\.0\.1"):
        sweep(SMALL, tmp_path / "s")


def test_two_runs_at_a_time_are_refused(tmp_path):
    with Store(tmp_path / "s", Plan(parse(SMALL))), pytest.raises(UsageError, match="another process is writing"):
        sweep(SMALL, tmp_path / "s")
    sweep(SMALL, tmp_path / "s")


@pytest.mark.parametrize("kind", ["file", "full", "zarr", "below a file", "nowhere"])
def test_places_where_no_store_can_be(kind, tmp_path):
    out = tmp_path / "s"
    if kind == "file":
        out.write_text("")
    elif kind == "full":
        out.mkdir()
        (out / "thesis.txt").write_text("years")
    elif kind == "zarr":
        xarray.Dataset({"x": ("t", [1.0])}).to_zarr(out, consolidated=False)
    elif kind == "below a file":
        out.write_text("")
        out = out / "s"
    else:
        out = Path("/proc/nowhere/s")
    before = contents(tmp_path, seconds=True)
    with pytest.raises(UsageError, match="--out: "):
        sweep(SMALL, out)
    assert contents(tmp_path, seconds=True) == before


def test_an_empty_folder_will_do(tmp_path):
    (tmp_path / "s").mkdir()
    assert sweep(SMALL, tmp_path / "s").albedo.notnull().all()


def test_a_folder_in_a_missing_folder_is_not_made(tmp_path, capsys):
    config = toml(tmp_path / "c.toml", KILLED)
    for dry in ([], ["--dry-run"]):
        code = cli.run(["sweep", str(config), "--out", str(tmp_path / "deep" / "er" / "s"), *dry])
        assert code == cli.ExitCode.USAGE_ERROR
        complaint = capsys.readouterr().err.splitlines()[-1]
        assert complaint.endswith(f"er/s': the folder {tmp_path / 'deep' / 'er'} does not exist")
    assert os.listdir(tmp_path) == ["c.toml"]


# --- what is not ours ---

THESIS = {
    "names of a store": {
        "albedo/figure1.txt": "my thesis", "error/notes.txt": "my notes", "film.mkv.partial": "half a download",
    },
    "all arrays of a store": {
        f"{name}/c/0": "mine" for name in ("albedo", "error", "evaluations", "seconds", "checksum")
    },
    "an array that looks like ours": {"checksum/zarr.json": '{"checksum": "CRC-32"}', "zarr.json.txt": ""},
    "temporary names": {".zarr.json.partial": "a", ".zarr.json.unfinished.partial": "b", ".brdfcheck-trial": "c"},
    "the first temporary name": {".zarr.json.unfinished.partial": "not what a sweep begins with"},
    "the name of an unfinished store": {"zarr.json.unfinished": "not JSON"},
    "metadata that is none": {"zarr.json": "my notes on Zarr"},
    "metadata of nothing": {"zarr.json": "", "albedo/figure1.txt": "my thesis"},
    "a folder of that name": {"zarr.json/notes.txt": "my notes on Zarr"},
    "an empty folder": {"albedo": None},
}  # fmt: skip


def everything(folder: Path) -> dict[str, bytes | None]:
    """All files with their contents, and all folders."""
    return {str(path.relative_to(folder)): path.read_bytes() if path.is_file() else None for path in folder.rglob("*")}


@pytest.mark.parametrize("how", [[], ["--repair"], ["--dry-run"]], ids=["run", "repair", "dry run"])
@pytest.mark.parametrize("files", THESIS.values(), ids=THESIS)
def test_a_folder_with_files_of_the_users_is_refused_as_it_is(files, how, tmp_path, capsys):
    config, out = toml(tmp_path / "c.toml", KILLED.replace("240", "4")), tmp_path / "results"
    for name, text in files.items():
        if text is None:
            (out / name).mkdir(parents=True)
            continue
        (out / name).parent.mkdir(parents=True, exist_ok=True)
        (out / name).write_text(text)
    before = everything(out)
    code = cli.run(["sweep", str(config), "--out", str(out), *how])
    assert everything(out) == before
    assert code == cli.ExitCode.USAGE_ERROR
    complaint = capsys.readouterr().err.splitlines()[-1]
    assert complaint == f"brdfcheck: --out: {out} is not empty and holds no sweep: give another folder"


@pytest.fixture
def unfinished(tmp_path, monkeypatch):
    """A store whose creation was interrupted in the middle of its eighth file."""
    write, left = store._write, 7

    def dies(path: Path, data: bytes) -> None:
        nonlocal left
        if left == 0:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.with_name(f".{path.name}.partial").write_bytes(data[: len(data) // 2])
            raise _Killed
        left -= 1
        write(path, data)

    with monkeypatch.context() as patched:
        patched.setattr(store, "_write", dies)
        with pytest.raises(_Killed):
            sweep(SMALL, tmp_path / "s")
    assert (tmp_path / "s" / "n" / ".zarr.json.partial").exists()
    return tmp_path / "s"


@pytest.mark.parametrize("repair", [False, True])
@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("notes.txt", "mine"),
        ("rule/figure1.txt", "mine"),
        ("albedo/figure1.txt", "mine"),
        ("albedo/c/0/1", "mine"),
        ("n/.zarr.json.partial", "mine"),
        ("n/c/.0.partial", "mine"),
        ("rule/.zarr.json.partial", "{"),
        ("rule/zarr.json", "mine"),
        ("rule/zarr.json", ""),
        (".zarr.json.partial", "mine"),
        ("zarr.json.unfinished", "mine"),
        ("photos", None),
    ],
)
def test_an_unfinished_store_with_files_of_the_users_is_refused_as_it_is(name, text, repair, unfinished):
    if text is None:
        (unfinished / name).mkdir()
    else:
        (unfinished / name).parent.mkdir(parents=True, exist_ok=True)
        (unfinished / name).write_text(text)
    before = everything(unfinished)
    for attempt in (
        lambda: sweep(SMALL, unfinished, repair=repair),
        lambda: runner.estimate(Plan(parse(SMALL)), unfinished),
    ):
        with pytest.raises(UsageError, match="is not empty and holds no sweep: give another folder"):
            attempt()
        assert everything(unfinished) == before


def test_an_unfinished_store_does_not_reach_through_links(unfinished, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    (unfinished / "albedo").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(UsageError, match="is not empty and holds no sweep"):
        sweep(SMALL, unfinished)
    assert os.listdir(tmp_path / "elsewhere") == []


def test_an_unfinished_store_of_another_configuration_is_refused_with_the_difference(unfinished):
    before = everything(unfinished)
    with pytest.raises(UsageError, match=r"made by another configuration: brdf: the store has phong, here it is blinn-phong"):
        sweep({**SMALL, "brdf": "blinn-phong"}, unfinished)
    assert everything(unfinished) == before


def test_an_unfinished_store_keeps_the_commit_of_its_first_run(unfinished, monkeypatch):
    first = json.loads((unfinished / "zarr.json.unfinished").read_text())["attributes"]["source_commit"]
    monkeypatch.setattr(store.provenance, "source_commit", lambda: "another commit")
    assert sweep(SMALL, unfinished).source_commit == first


def test_killed_between_the_last_file_and_its_name(tmp_path, monkeypatch):
    sweep(SMALL, tmp_path / "whole")
    replace = os.replace

    def dies(source: Path, target: Path) -> None:
        if target == tmp_path / "s" / "zarr.json":
            raise _Killed
        replace(source, target)

    with monkeypatch.context() as patched:
        patched.setattr(store.os, "replace", dies)
        with pytest.raises(_Killed):
            sweep(SMALL, tmp_path / "s")
    assert not (tmp_path / "s" / "zarr.json").exists()
    sweep(SMALL, tmp_path / "s")
    assert contents(tmp_path / "s") == contents(tmp_path / "whole")


@pytest.mark.parametrize("share", [0, 0.01, 0.3, 1])
def test_killed_in_the_first_file_of_any_sweep(share, tmp_path):
    """Nothing is there yet but the beginning of what all sweeps begin with."""
    sweep(SMALL, tmp_path / "whole")
    sweep({**SMALL, "brdf": "blinn-phong"}, tmp_path / "other")
    data = (tmp_path / "other" / "zarr.json").read_bytes()
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / ".zarr.json.unfinished.partial").write_bytes(data[: int(share * len(data))])
    sweep(SMALL, tmp_path / "s")
    assert contents(tmp_path / "s") == contents(tmp_path / "whole")


def test_files_of_the_users_in_a_store_stay(tmp_path):
    """Also where they have the very names that files have while they are written."""
    out = tmp_path / "s"
    sweep(SMALL, out)
    (out / "checksum/c/0/1/0").unlink()
    mine = {
        ".film.mkv.partial": b"half a download", "albedo/.figure1.partial": b"my thesis", ".brdfcheck-trial": b"mine",
        "albedo/c/0/.1.partial": b"mine", "seconds/c/0/.1.partial": b"my notes", "checksum/c/0/1/.0.partial": b"mine",
        "n/c/.0.partial": b"mine", "notes.txt": b"mine",
    }  # fmt: skip
    for name, data in mine.items():
        (out / name).write_bytes(data)
    before = contents(out)
    sweep(SMALL, out)
    after = contents(out, seconds=True)
    assert mine.items() <= after.items()
    assert set(after) - {name for name in after if name.startswith("seconds/c")} == {*before, "checksum/c/0/1/0"}
    (out / "n/c/0").write_bytes(b"damaged")
    (out / "albedo/c/0/1").write_bytes(b"damaged")
    sweep(SMALL, out, repair=True)
    mended = contents(out, seconds=True)
    assert set(mended) == set(after)
    assert {name: data for name, data in mended.items() if not name.startswith("seconds/c/0/")} == {
        name: data for name, data in after.items() if not name.startswith("seconds/c/0/")
    }
    assert mine.items() <= mended.items()


def test_what_a_killed_process_leaves_of_a_chunk_is_gone_at_the_end(tmp_path):
    out = tmp_path / "s"
    sweep(SMALL, out)
    before = set(contents(out, seconds=True))
    (out / "checksum/c/0/1/0").unlink()
    (out / "albedo/c/0/.1.partial").write_bytes((out / "albedo/c/0/1").read_bytes()[:50])
    (out / "error/c/0/.1.partial").write_bytes(b"")
    (out / "evaluations/c/0/.1.partial").write_bytes((out / "evaluations/c/0/1").read_bytes())
    (out / "seconds/c/0/.1.partial").write_bytes(np.float64(0.0123).tobytes())
    sweep(SMALL, out)
    assert set(contents(out, seconds=True)) == before


DAMAGE = {
    "truncated": lambda path: path.write_bytes(path.read_bytes()[:-5]),
    "flipped": lambda path: path.write_bytes(bytes([path.read_bytes()[0] ^ 1]) + path.read_bytes()[1:]),
    "deleted": lambda path: path.unlink(),
    "empty": lambda path: path.write_bytes(b""),
}


@pytest.mark.parametrize("how", DAMAGE)
@pytest.mark.parametrize("key", ["albedo/c/0/1", "error/c/0/0", "evaluations/c/0/2", "n/c/0", "albedo/zarr.json"])
def test_damage_is_named_and_mended(key, how, tmp_path):
    out = tmp_path / "s"
    sweep(SMALL, out)
    before = contents(out)
    DAMAGE[how](out / key)
    after = contents(out, seconds=True)
    with pytest.raises(SweepError) as error:
        sweep(SMALL, out)
    assert str(out / key) in str(error.value)
    assert "--repair" in str(error.value)
    assert contents(out, seconds=True) == after, "nothing is touched"
    sweep(SMALL, out, repair=True)
    assert contents(out) == before


@pytest.mark.parametrize("how", DAMAGE)
def test_damaged_root_metadata_is_named_and_mended(how, tmp_path):
    """All of it follows from the configuration but the commit; chunks are kept, times and all."""
    out = tmp_path / "s"
    sweep(SMALL, out)
    before = contents(out, seconds=True)
    attributes = json.loads(before["zarr.json"])["attributes"]
    DAMAGE[how](out / "zarr.json")
    after = contents(out, seconds=True)
    with pytest.raises(
        SweepError, match=r"the store is damaged: .*zarr\.json (is missing|is damaged); run again with --repair"
    ):
        sweep(SMALL, out)
    assert contents(out, seconds=True) == after
    data = sweep(SMALL, out, repair=True)
    assert data.attrs == {**attributes, "source_commit": "unknown"}
    mended = contents(out, seconds=True)
    assert {**mended, "zarr.json": b""} == {**before, "zarr.json": b""}
    sweep(SMALL, out)


def test_damaged_root_metadata_is_not_made_up(tmp_path):
    """What else describes the store must be what the configuration gives, or it may be another's."""
    out = tmp_path / "s"
    sweep(SMALL, out)
    (out / "zarr.json").write_bytes(b"{")
    other = {**SMALL, "axes": {**SMALL["axes"], "n": {"geomspace": [1, 101, 5]}}}
    after = contents(out, seconds=True)
    with pytest.raises(SweepError, match=r"zarr\.json is lost, and n/c.* is not that of this configuration; put it back"):
        sweep(other, out, repair=True)
    DAMAGE["deleted"](out / "albedo" / "zarr.json")
    with pytest.raises(SweepError, match=r"is lost, and albedo/zarr\.json is not that of this configuration"):
        sweep(SMALL, out, repair=True)
    assert {**contents(out, seconds=True), "albedo/zarr.json": b""} == {**after, "albedo/zarr.json": b""}


@pytest.mark.parametrize("data", [b"", b"xx", b"xxxxxxxxx", np.float64(np.nan).tobytes(), np.float64(-1).tobytes()])
def test_a_damaged_time_is_named_and_mended(data, tmp_path):
    out = tmp_path / "s"
    sweep(SMALL, out)
    before = contents(out)
    (out / "seconds/c/0/1").write_bytes(data)
    with pytest.raises(SweepError, match="seconds/c/0/1 is damaged; run again with --repair"):
        sweep(SMALL, out)
    assert float(sweep(SMALL, out, repair=True).seconds.min()) > 0
    assert contents(out) == before


def test_a_damaged_checksum_is_named_and_mended(tmp_path):
    out = tmp_path / "s"
    sweep(SMALL, out)
    before = contents(out)
    (out / "checksum/c/0/1/0").write_bytes(b"123")
    with pytest.raises(SweepError, match="checksum/c/0/1/0 is damaged"):
        sweep(SMALL, out)
    sweep(SMALL, out, repair=True)
    assert contents(out) == before


# --- interrupted ---


class _Killed(BaseException):
    """What a process does not survive."""


@pytest.fixture
def one_computer(monkeypatch):
    """Programs compiled once for all sweeps of a plan within a test."""
    made: dict[str, Computer] = {}

    def make(plan: Plan) -> Computer:
        return made.setdefault(json.dumps(plan.document()), Computer(plan))

    monkeypatch.setattr(runner, "Computer", make)


def test_killed_at_every_single_write(tmp_path, monkeypatch, one_computer):
    plan = Plan(parse(SMALL))
    runner.fill(plan, tmp_path / "whole")
    whole = contents(tmp_path / "whole")
    write = store._write
    count = len(contents(tmp_path / "whole", seconds=True))
    for last in range(count):
        left = last

        def dies(path: Path, data: bytes) -> None:
            nonlocal left
            if left == 0:  # in the middle of a file
                path.parent.mkdir(parents=True, exist_ok=True)
                path.with_name(f".{path.name}.partial").write_bytes(data[: len(data) // 2])
                raise _Killed
            left -= 1
            write(path, data)

        out = tmp_path / str(last)
        monkeypatch.setattr(store, "_write", dies)
        with pytest.raises(_Killed):
            runner.fill(plan, out)
        monkeypatch.setattr(store, "_write", write)
        runner.fill(plan, out)
        assert contents(out) == whole, f"killed at write {last} of {count}"


KILLED = """
brdf = "phong"
[axes]
n = { geomspace = [1, 1000, 60] }
cos_theta = { linspace = [0.05, 1, 240] }
[chunks]
cos_theta = 1
"""


def test_killed_for_good_at_many_moments(tmp_path):
    config = toml(tmp_path / "c.toml", KILLED)
    whole, out = tmp_path / "whole", tmp_path / "s"
    reference = process(config, "--out", whole)
    random = np.random.default_rng(3)
    # One store, killed again and again: while it is created, and at more and more chunks.
    for target in (0, 1, 40, 130):
        running = process(config, "--out", out)
        while running.poll() is None:
            if out.exists() and len(list(out.glob("checksum/c/0/*/0"))) >= target:
                time.sleep(random.uniform(0, 0.004))
                break
        running.send_signal(signal.SIGKILL)
        assert finished(running)[0] == -signal.SIGKILL
        assert len(list(out.glob("checksum/c/0/*/0"))) < 240
    code, stdout, stderr = finished(process(config, "--out", out))
    assert code == 0, stderr
    assert "were there" in stdout
    assert finished(reference)[0] == 0
    assert differing(out, whole) == []
    assert set(contents(out, seconds=True)) == set(contents(whole, seconds=True))


def test_ctrl_c_keeps_what_is_there(tmp_path):
    config, out = toml(tmp_path / "c.toml", KILLED), tmp_path / "s"
    running = process(config, "--out", out)
    while running.poll() is None and len(list(out.glob("checksum/c/0/*/0"))) < 3:
        time.sleep(0.002)
    running.send_signal(signal.SIGINT)
    code, _, stderr = finished(running)
    assert code == cli.ExitCode.INTERRUPTED, stderr
    assert stderr.splitlines()[-2:] == [
        "the chunks computed so far are kept: the same command goes on from here",
        "brdfcheck: interrupted",
    ]
    there = len(list(out.glob("checksum/c/0/*/0")))
    assert 3 <= there < 240
    code, stdout, stderr = finished(process(config, "--dry-run", "--out", out))
    assert code == 0, stderr
    assert f"{there} of 240 chunks are in" in stdout


# --- the disk ---


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
@pytest.mark.parametrize("room", [3, 30])
def test_a_full_disk_loses_nothing(code, room, tmp_path, monkeypatch, one_computer, capsys):
    config = tmp_path / "c.toml"
    toml(config, KILLED.replace("240", "12"))
    opened, files = open, 0

    def full(path: object, mode: str = "r", *args: object, **options: object) -> object:
        nonlocal files
        files += "w" in mode
        if "w" in mode and files > room:
            opened(path, mode).close()  # pyright: ignore  # the name is there, the bytes are not
            raise OSError(code, os.strerror(code), str(path))
        return opened(path, mode, *args, **options)  # pyright: ignore

    monkeypatch.setattr(store, "open", full, raising=False)
    assert cli.run(["sweep", str(config), "--out", str(tmp_path / "s")]) == cli.ExitCode.INTERNAL_ERROR
    complaint = capsys.readouterr().err.splitlines()[-1]
    assert complaint.startswith("brdfcheck: the disk is full: cannot write ")
    assert complaint.endswith("make room and run again to continue")
    before = contents(tmp_path / "s", seconds=True)
    assert not [name for name in before if name.endswith(".partial")]
    monkeypatch.undo()
    assert cli.run(["sweep", str(config), "--out", str(tmp_path / "s")]) == 0
    assert cli.run(["sweep", str(config), "--out", str(tmp_path / "whole")]) == 0
    if "zarr.json.unfinished" in before:  # what makes a folder a store gets its name last
        before["zarr.json"] = before.pop("zarr.json.unfinished")
    assert before.items() <= contents(tmp_path / "s", seconds=True).items()
    assert differing(tmp_path / "s", tmp_path / "whole") == []


@pytest.fixture
def small_disk(tmp_path):
    """A file system of 1 MB."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = shutil.which("mount") and subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)], capture_output=True, check=False
    )
    if not mounted or mounted.returncode:
        pytest.skip("mounting a file system is not permitted here")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


@pytest.mark.parametrize("name", ["", "s"], ids=["the disk itself", "a folder on it"])
def test_a_real_full_disk(name, small_disk, tmp_path, capsys):
    config = tmp_path / "c.toml"
    toml(config, KILLED.replace("60", "9000").replace("240", "12"))
    out = small_disk / name
    assert cli.run(["sweep", str(config), "--out", str(out)]) == cli.ExitCode.INTERNAL_ERROR
    assert "the disk is full" in capsys.readouterr().err.splitlines()[-1]
    with Store(out, Plan(brdfcheck.sweep.read_config(config))) as there:
        assert len(there.done) >= 3
    assert subprocess.run(["mount", "-o", "remount,size=64m", str(small_disk)], check=False).returncode == 0
    assert cli.run(["sweep", str(config), "--out", str(out)]) == 0
    assert xarray.open_zarr(out, chunks=None).albedo.notnull().all()


# --- devices and memory ---


def test_two_devices_give_the_bytes_of_one(tmp_path):
    text = KILLED.replace("240", "11").replace("cos_theta = 1\n", "cos_theta = 4\n")
    config = toml(tmp_path / "c.toml", text.replace('"phong"', '"phong"\nrule = ["default", "zonal"]'))
    runs = [process(config, "--out", tmp_path / f"on-{devices}", devices=devices) for devices in (1, 2)]
    for running in runs:
        code, _, stderr = finished(running)
        assert code == 0, stderr
    assert differing(tmp_path / "on-1", tmp_path / "on-2") == []


def test_the_mesh_is_all_local_devices():
    plan = Plan(parse(SMALL))
    assert Computer(plan).width == jax.local_device_count()
    assert list(Computer(plan).mesh.devices.ravel()) == jax.local_devices()


def test_memory_is_bounded_by_the_chunk(tmp_path):
    """A sweep of 32 times as many chunks of the same size has the same peak, but for a few MB."""
    code = """
import resource, sys
from brdfcheck.sweep import Plan, parse, fill
columns = int(sys.argv[1])
axes = {"n": {"geomspace": [1, 1000, 5000]}, "cos_theta": {"linspace": [0.1, 1, columns]}}
fill(Plan(parse({"brdf": "phong", "axes": axes, "chunks": {"cos_theta": 20}})), sys.argv[2])
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    runs = {
        columns: subprocess.Popen(
            [sys.executable, "-c", code, str(columns), str(tmp_path / str(columns))],
            env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        )
        for columns in (20, 640)
    }  # fmt: skip
    peaks = {}
    for columns, running in runs.items():
        status, stdout, stderr = finished(running)
        assert status == 0, stderr
        peaks[columns] = int(stdout.splitlines()[-1]) / 1024
    # All results of the larger one would be 77 MB.
    assert peaks[640] - peaks[20] < 40, peaks
    shutil.rmtree(tmp_path / "640")


# --- the command ---


def test_a_dry_run_creates_nothing(tmp_path, capsys):
    config = toml(tmp_path / "c.toml", KILLED)
    assert cli.run(["sweep", str(config), "--dry-run", "--out", str(tmp_path / "s")]) == 0
    text = capsys.readouterr().out
    assert "n 60 x cos_theta 240" in text
    assert "cells     14400 in 240 chunks of 60 x 1" in text
    assert "size      346 kB" in text
    assert "memory    " in text
    assert "estimate  " in text
    assert os.listdir(tmp_path) == ["c.toml"]
    assert cli.run(["sweep", str(config), "--dry-run"]) == 0
    toml(config, KILLED.replace('"phong"', '"cook-torrance"').replace("n = {", "m = {").replace("[1, 1000", "[0.1, 1"))
    assert cli.run(["sweep", str(config), "--dry-run"]) == 0


def test_a_dry_run_of_a_huge_sweep_is_quick(tmp_path, capsys):
    """1e13 cells in some 1e9 chunks: counted along the axes, not one by one."""
    text = 'brdf = "phong"\nrule = "zonal"\n[axes]\nn = { geomspace = [1, 1000, 3000000] }\n'
    config = toml(tmp_path / "c.toml", text + "cos_theta = { linspace = [0.05, 1, 3333333] }\n[chunks]\nn = 50\n")
    began = time.monotonic()
    assert cli.run(["sweep", str(config), "--dry-run", "--out", str(tmp_path / "s")]) == 0
    assert time.monotonic() - began < 30
    assert "cells     9999999000000 in " in capsys.readouterr().out


@pytest.mark.parametrize("there", [(), (0, 3, 7)])
def test_programs_and_chunks_are_counted_as_they_are_run(there):
    """In closed form the same as chunk by chunk, also where chunks hang over the end or belong to one program each."""
    for document in (
        {"brdf": "phong", "axes": {"n": {"geomspace": [1, 100, 50]}, "cos_theta": {"linspace": [0, 1, 7]}}, "chunks": {"n": 8}},
        {"brdf": ["phong", "blinn-phong"], "rule": "zonal", "precision": ["float32", "float64"],
         "axes": {"cos_theta": {"linspace": [0, 1, 5]}, "n": [1.0, 2.5]}, "chunks": {"cos_theta": 2}},
        {"brdf": "phong", "axes": {"n": 3, "cos_theta": 1}},
    ):  # fmt: skip
        plan = Plan(parse(document))
        chunks = [plan.chunk(index) for index in range(plan.chunks)]
        assert sum(plan.cells_of(places) for _, places in plan.programs()) == plan.cells
        expected = sorted((chunk for chunk in chunks if chunk.index not in there), key=plan.program)
        assert list(plan.missing(there)) == expected
        for wave in plan.waves(plan.missing(there), 3):
            assert len({plan.program(chunk) for chunk in wave}) == 1


def test_a_dry_run_knows_what_is_there(tmp_path, capsys):
    config, out = toml(tmp_path / "c.toml", KILLED.replace("240", "4")), tmp_path / "s"
    plan = Plan(brdfcheck.sweep.read_config(config))
    with Store(out, plan) as there:
        there.write(Computer(plan)([plan.chunk(2)])[0])
    before = contents(out, seconds=True)
    assert cli.run(["sweep", str(config), "--dry-run", "--out", str(out)]) == 0
    assert "1 of 4 chunks are in" in capsys.readouterr().out
    assert contents(out, seconds=True) == before


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["c.toml"], "--out: say where the store shall be"),
        (["c.toml", "--out", " "], "--out: the name is empty"),
        (["nothing.toml", "--out", "s"], "there is no file 'nothing.toml'"),
        (["--out", "s"], "Missing argument 'CONFIG.toml'"),
        (["c.toml", "--out", "c.toml"], "is a file; a store is a folder"),
        (["c.toml", "--out", "bad\0name"], "cannot write"),
        (["c.toml", "--out", "s" * 300], "cannot write"),
    ],
)
def test_words_that_cannot_be_done(arguments, message, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    toml(tmp_path / "c.toml", KILLED)
    assert cli.run(["sweep", *arguments]) == cli.ExitCode.USAGE_ERROR
    (complaint,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("brdfcheck: ")]
    assert message in complaint
    assert os.listdir(tmp_path) == ["c.toml"]


def test_the_last_line_says_how_it_went(tmp_path, capsys):
    config, out = toml(tmp_path / "c.toml", KILLED.replace("240", "4")), tmp_path / "s"
    assert cli.run(["sweep", str(config), "--out", str(out)]) == 0
    captured = capsys.readouterr()
    assert "complete; 4 of 4 chunks computed in " in captured.out
    assert "cells/s" in captured.out
    assert "4 of 4 chunks, " in captured.err
    assert "left" in captured.err


HALF = """
import jax.numpy as jnp

def fails_above(wi, wo, n, limit):
    return jnp.where(n > limit, jnp.nan, 0.25 / jnp.pi) + 0 * wo[..., 2]

def no_grazing(wi, wo):
    value = jnp.where(wi[..., 2] < 0.3, jnp.nan, 0.25 / jnp.pi) + 0 * wo[..., 2]
    return jnp.stack([value, value], axis=-1)
"""


@pytest.mark.parametrize(
    ("limit", "code", "line"),
    [
        (0, cli.ExitCode.FAILED, "all 15 albedos are not a number; 3 of 3 chunks computed in "),
        (2, cli.ExitCode.PASSED, "9 of 15 albedos are not a number"),
        (4, cli.ExitCode.PASSED, "3 of 15 albedos are not a number"),
        (5, cli.ExitCode.PASSED, "complete; 3 of 3 chunks computed in "),
    ],
)
def test_albedos_that_are_not_a_number_are_said(limit, code, line, tmp_path, capsys):
    """At the first run and where they are there already; a chunk that hangs over the end has no more of them."""
    (tmp_path / "mine.py").write_text(HALF)
    axes = f"[axes]\nn = [1, 2, 3, 4, 5]\ncos_theta = [0.2, 0.5, 1.0]\nlimit = {limit}\n[chunks]\nn = 2\ncos_theta = 3\n"
    config, out = toml(tmp_path / "c.toml", f'brdf = "mine.py:fails_above"\n{axes}'), tmp_path / "s"
    for again in (False, True):
        assert cli.run(["sweep", str(config), "--out", str(out)]) == code
        lines = capsys.readouterr().out.splitlines()
        expected = line.replace("3 of 3 chunks", "0 of 3 chunks") if again else line
        assert any(text.startswith(f"{out}: {expected}") for text in lines), lines
        assert any("complete" in text for text in lines) == (code == 0)
        assert any("not a number" in text for text in lines) == ("not a number" in line)


def test_albedos_of_a_single_cell_that_is_no_number(tmp_path, capsys):
    (tmp_path / "mine.py").write_text(HALF)
    config = toml(tmp_path / "c.toml", 'brdf = "mine.py:fails_above"\n[axes]\nn = 2\nlimit = 1\ncos_theta = 1\n')
    assert cli.run(["sweep", str(config), "--out", str(tmp_path / "s")]) == cli.ExitCode.FAILED
    assert "s: the only albedo is not a number; 1 of 1 chunks computed" in capsys.readouterr().out


def test_albedos_of_channels_are_counted_one_by_one(tmp_path, capsys):
    (tmp_path / "mine.py").write_text(HALF)
    text = 'brdf = "mine.py:no_grazing"\n[axes]\ncos_theta = [0.2, 0.5, 1.0]\n[chunks]\ncos_theta = 2\n'
    config = toml(tmp_path / "c.toml", text)
    for _ in range(2):
        assert cli.run(["sweep", str(config), "--out", str(tmp_path / "s")]) == 0
        assert "s: 2 of 6 albedos are not a number" in capsys.readouterr().out


def test_a_terminal_gets_a_bar_with_rate_and_time_left(tmp_path):
    pty = pytest.importorskip("pty")
    config = toml(tmp_path / "c.toml", KILLED)
    ours, theirs = pty.openpty()
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "TERM": "xterm", "COLUMNS": "140"}
    command = [sys.executable, "-m", "brdfcheck", "sweep", str(config), "--out", str(tmp_path / "t")]
    running = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=theirs)
    os.close(theirs)
    shown = b""
    with contextlib.suppress(OSError):  # what a terminal says when the other side closes
        while part := os.read(ours, 65536):
            shown += part
    assert running.wait(60) == 0
    os.close(ours)
    assert b"sweeping" in shown
    assert b"cells/s" in shown
    assert b"/240 chunks" in shown
    assert b"left" in shown


def test_the_digest_covers_what_computes():
    """Every module that computing a chunk imports is part of the digest that a continuation compares."""
    package = ROOT / "brdfcheck"
    reached, waiting = set(), ["sweep.compute", "sweep.plan", "sweep.store"]
    while waiting:
        name = waiting.pop()
        path = package / (name.replace(".", "/") + ".py")
        if name in reached or not path.exists():
            continue
        reached.add(name)
        if name == "output.records":  # files, not numbers; what it imports for types alone does not count
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("brdfcheck"):
                inner = (node.module or "").removeprefix("brdfcheck").lstrip(".")
                waiting += [inner, *(f"{inner}.{alias.name}".lstrip(".") for alias in node.names)]
    computing = {name.split(".")[0] for name in reached} - {"output", "__init__"}
    assert computing <= set(store.provenance._COMPUTING)
