"""Sweeps on one machine: values, the store, and that nothing is lost, whatever happens to it."""

from __future__ import annotations

import ast
import errno
import itertools
import json
import os
import re
import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
import pytest
import xarray
from projects import SWEEP
from selection import few
from shared import ROOT, contents, process, python, shown_by

import brdfcheck
from brdfcheck import cli
from brdfcheck.messages import SweepError, UsageError
from brdfcheck.quadrature.registry import RULES
from brdfcheck.sweep import Plan, layout, parse, run_sweep, runner, store
from brdfcheck.sweep.compute import Computer
from brdfcheck.sweep.store import Store

SMALL = {
    "brdf": "phong",
    "axes": {"n": {"geomspace": [1, 100, 5]}, "cos_theta": {"linspace": [0.1, 1, 7]}},
    "chunks": {"cos_theta": 3},
}


def sweep(document: dict, out: Path, folder: Path | None = None, **options: object) -> xarray.Dataset:
    return run_sweep(parse(document, folder=folder), out, **options)  # pyright: ignore[reportArgumentType]


@pytest.fixture(autouse=True, scope="module")
def one_computer():
    """Programs compiled once for all sweeps of a plan."""
    made: dict[str, Computer] = {}
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(runner, "Computer", lambda plan: made.setdefault(json.dumps(plan.document()), Computer(plan)))
        yield


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The store of SMALL."""
    folder = tmp_path_factory.mktemp("whole") / "s"
    sweep(SMALL, folder)
    return folder


@pytest.fixture
def out(whole, tmp_path):
    """A copy of it."""
    shutil.copytree(whole, tmp_path / "s")
    return tmp_path / "s"


@pytest.fixture
def config(tmp_path):
    """Writes a configuration, SWEEP by default, with replacements."""

    def write(*replacements: tuple[str, str], text: str = SWEEP) -> Path:
        for old, new in replacements:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "c.toml").write_text(text)
        return tmp_path / "c.toml"

    return write


# --- values ---


@pytest.mark.parametrize(
    ("document", "tolerance"),
    [
        ({"brdf": "binomial-power-half", "axes": {"n": {"geomspace": [0.3, 1000, 70]}, "cos_theta": [0.0, 0.3, 1.0]}}, 1e-11),
        pytest.param(
            {"brdf": "phong", "rule": "zonal", "axes": {"cos_theta": {"linspace": [0.1, 1, 7]}, "n": [1, 10, 300]}},
            1e-11,
            marks=pytest.mark.slow,
        ),
        pytest.param(
            {"brdf": "lambert", "axes": {"reflectance": [0.0, 0.5, 1.0], "cos_theta": [0.5, 1.0]}},
            1e-12,
            marks=pytest.mark.slow,
        ),
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
    cells = [{name: int(random.integers(size)) for name, size in data.albedo.sizes.items()} for _ in range(4)]
    values = [[float(data.isel(cell)[name]) for name in (parameter, "cos_theta")] for cell in cells]
    for cell, (value, mu) in zip(map(data.isel, cells), values, strict=True):
        expected = brdfcheck.albedo(family.build(**{parameter: value}), mu)
        assert abs(float(cell.albedo) - float(expected.value)) <= float(cell.error) + float(expected.error)
        assert float(cell.error) < tolerance
        assert int(cell.evaluations) > 0


@pytest.mark.slow
def test_precision_and_k_are_axes(tmp_path):
    document = {
        "brdf": "BinomialPower",
        "rule": "zonal",
        "precision": ["float32", "float64"],
        "axes": {"n": [3.0, 400.0], "k": [4, 16], "cos_theta": [0.2, 1.0]},
    }
    data = sweep(document, tmp_path / "s")
    assert data.albedo.dims == ("precision", "n", "k", "cos_theta")
    for n, k in itertools.product([3.0, 400.0], [4, 16]):
        expected = brdfcheck.albedo(brdfcheck.BinomialPower(n, k), np.array([0.2, 1.0])).value
        np.testing.assert_allclose(data.albedo.sel(precision="float64", n=n, k=k), expected, rtol=1e-12)
    difference = abs(data.albedo.sel(precision="float32") - data.albedo.sel(precision="float64"))
    assert bool((difference <= data.error.sel(precision="float32") * 1.01).all())
    assert float(difference.max()) > 1e-9, "float32 must have been computed in float32"


@pytest.mark.slow
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
    both = sweep({"brdf": "phong", "rtol": [1e-3, 1e-12], "axes": {"n": 30.0, "cos_theta": [0.7]}}, tmp_path / "r")
    assert both.evaluations.sel(rtol=1e-3).item() < both.evaluations.sel(rtol=1e-12).item()


@pytest.mark.slow
def test_a_rule_is_the_registered_one_with_its_setting_or_its_usual_one(tmp_path):
    rules = ["zonal", "zonal:12", "zonal:4", "adaptive", "adaptive:1e-8"]
    data = sweep({"brdf": "phong", "rule": rules, "axes": {"n": [20.0], "cos_theta": [0.4, 0.9]}}, tmp_path / "s")
    for one, other in (("zonal", "zonal:12"), ("adaptive", "adaptive:1e-8")):
        for part in (data.albedo, data.error, data.evaluations):
            np.testing.assert_array_equal(part.sel(rule=one), part.sel(rule=other))
    expected = RULES["zonal"](4)(brdfcheck.brdf.catalog.entry("phong").family.build(n=20.0), np.array([0.4, 0.9]))
    np.testing.assert_array_equal(data.evaluations.sel(rule="zonal:4")[0], expected.evaluations)
    np.testing.assert_allclose(data.albedo.sel(rule="zonal:4")[0], expected.value, rtol=1e-13)


def test_no_rule_or_engine_is_known_by_its_name():
    """What a cell is computed by follows from objects: a name in the source would be compared with something."""
    for path in (ROOT / "brdfcheck" / "sweep").glob("*.py"):
        texts = {node.value for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.Constant)}
        aliases = {"zonal"} if path.name == "config.py" else set()
        assert not texts & ({*RULES, "table"} - aliases), path.name


@pytest.mark.slow
def test_every_rule_of_the_package_is_a_value_of_the_axis(tmp_path):
    chance = next(name for name, rule in RULES.items() if rule.random)
    rules = ["default", "gauss-product:32", "lobe-warped-gauss", "adaptive:1e-5", "closed-form", chance]
    document = {"brdf": "phong", "rule": rules, "axes": {"n": [3.0, 20.0], "cos_theta": [0.5, 1.0]}, "seed": 7}
    data = sweep(document, tmp_path / "s")
    difference = abs(data.albedo - data.albedo.sel(rule="default"))
    assert bool((difference <= 5 * (data.error + data.error.sel(rule="default"))).all())
    assert float(difference.sel(rule=chance).max()) > 1e-9
    # Chance depends on the seed and the cell, not on how the sweep is cut.
    cut = sweep({**document, "rule": chance, "chunks": {"n": 1}}, tmp_path / "c")
    np.testing.assert_array_equal(cut.albedo, sweep({**document, "rule": chance}, tmp_path / "w").albedo)
    other = sweep({**document, "rule": chance, "seed": 8}, tmp_path / "o")
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

def styled(wi, wo, n, style="plain", bright=False):
    return {"plain": 0.1, "fancy": 0.2}[style] * (1 + bright) * wo[..., 2] ** n

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

def nan_above(wi, wo, n, limit):
    return jnp.where(n > limit, jnp.nan, 0.25 / jnp.pi) + 0 * wo[..., 2]

def no_grazing(wi, wo):
    value = jnp.where(wi[..., 2] < 0.3, jnp.nan, 0.25 / jnp.pi) + 0 * wo[..., 2]
    return jnp.stack([value, value], axis=-1)
"""


@pytest.fixture
def mine(tmp_path):
    (tmp_path / "helper.py").write_text("import math\ndef factor(n):\n    return (n + 2) / (2 * math.pi)\n")
    (tmp_path / "mine.py").write_text(USER)
    return tmp_path


def test_users_functions(mine):
    axes = {"n": [1.0, 20.0], "ks": [0.5, 1.0], "cos_theta": [0.5, 1.0]}
    data = sweep({"brdf": "mine.py:glossy", "axes": axes}, mine / "s", mine)
    exact = brdfcheck.albedo_table("phong", [1.0, 20.0], [0.5, 1.0]).value
    np.testing.assert_allclose(data.albedo.sel(ks=1.0), exact, rtol=1e-7)
    np.testing.assert_allclose(data.albedo.sel(ks=0.5), exact / 2, rtol=1e-7)
    tinted = sweep({"brdf": "mine.py:tinted", "axes": {"k_red": [0.1, 0.2, 0.3], "cos_theta": 1}}, mine / "t", mine)
    assert tinted.albedo.dims == ("k_red", "channel")
    np.testing.assert_allclose(tinted.albedo.sel(channel=1), np.pi / 2, rtol=1e-7)
    np.testing.assert_allclose(tinted.albedo.sel(channel=0), 2 * np.pi / 3 * tinted.k_red, rtol=1e-7)
    words = {"style": ["plain", "fancy"], "bright": [True, False], "n": 1, "cos_theta": 0.5}
    styled = sweep({"brdf": "mine.py:styled", "axes": words}, mine / "w", mine).albedo
    np.testing.assert_allclose(styled, 2 * np.pi / 3 * np.array([[0.2, 0.1], [0.4, 0.2]]), rtol=1e-7)
    plain = {"brdf": "mine.py:numpy_only", "axes": {"cos_theta": [0.6]}}
    np.testing.assert_allclose(sweep(plain, mine / "p", mine).albedo, 0.25, rtol=1e-7)
    assert float(sweep({**plain, "precision": "float32"}, mine / "f", mine).error[0]) > 1e-8
    nothing = sweep({"brdf": "mine.py:nowhere", "axes": {"cos_theta": [0.6]}}, mine / "n", mine)
    assert np.isnan(nothing.albedo[0])
    assert np.isinf(nothing.error[0])


def test_every_rule_sees_the_azimuth(mine):
    document = {"brdf": "mine.py:brushed", "rule": ["default", "gauss-product:16"]}
    turned = sweep({**document, "axes": {"azimuth": [0.0, 1.0], "cos_theta": [0.6]}}, mine / "b", mine)
    for rule in document["rule"]:
        np.testing.assert_allclose(turned.albedo.sel(rule=rule)[:, 0], 1 + 0.4 * np.cos([0.0, 1.0]), rtol=1e-7)
    assert turned.azimuth.units == "rad"


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


def test_the_store_says_what_is_in_it(whole):
    data = xarray.open_zarr(whole)  # lazily, by default
    for name, variable in data.variables.items():
        assert variable.attrs["units"], name
        assert variable.attrs["long_name"], name
    assert data.seconds.dims == ("n_chunk", "cos_theta_chunk")
    assert data.seconds.units == "s"
    assert float(data.seconds.min()) > 0
    assert data.albedo.notnull().all()
    assert str(data.brdf.values) == "phong"
    assert json.loads(data.settings)["axes"]["n"] == {"geomspace": [1.0, 100.0, 5]}
    versions = json.loads(data.versions)
    assert versions["brdfcheck"] == brdfcheck.__version__
    assert {"jax", "numpy", "zarr"} <= set(versions)
    assert data.source_commit == "unknown" or len(data.source_commit.removesuffix("-dirty")) == 40
    assert "never clamped" in data.convention


def test_one_cell_in_an_empty_folder_and_what_was_left_of_it(tmp_path):
    (tmp_path / "s").mkdir()
    for _ in range(2):
        data = sweep({"brdf": "phong", "axes": {"n": 10, "cos_theta": 1.0}}, tmp_path / "s")
        (tmp_path / "s/albedo" / f"c.{'0f' * 16}.partial").write_bytes((tmp_path / "s/albedo/c").read_bytes()[:5])
        (tmp_path / "s/checksum/c/0").unlink()
    sweep({"brdf": "phong", "axes": {"n": 10, "cos_theta": 1.0}}, tmp_path / "s")
    assert sorted(os.listdir(tmp_path / "s/albedo")) == ["c", "zarr.json"]
    np.testing.assert_allclose(float(data.albedo), 1, rtol=1e-12)
    assert data.albedo.dims == ()
    assert float(data.n) == 10


def test_a_complete_store_is_left_alone(out):
    before = contents(out)
    summary = runner.fill(Plan(parse(SMALL)), out)
    assert (summary.computed, summary.found) == (0, 3)
    assert contents(out) == before


OTHERS = {
    "axes.n: the store has {\"geomspace\": [1.0, 100.0, 5]}, here it is {\"geomspace\": [1.0, 100.0, 6]}":
        {"axes": {**SMALL["axes"], "n": {"geomspace": [1, 100, 6]}}},
    "dimensions: the store has": {"axes": {"cos_theta": SMALL["axes"]["cos_theta"], "n": SMALL["axes"]["n"]}},
    "brdf: the store has phong, here it is blinn-phong": {"brdf": "blinn-phong"},
    "precision: the store has float64, here it is float32": {"precision": "float32"},
    "rtol: the store has none, here it is 1e-06": {"rtol": 1e-6},
    "chunks.cos_theta: the store has 3, here it is 2": {"chunks": {"cos_theta": 2}},
}  # fmt: skip


def test_another_configuration_or_other_software_is_refused_with_the_difference(out, monkeypatch):
    before = contents(out)
    for message, change in OTHERS.items():
        with pytest.raises(UsageError, match=f"made by another configuration: .*{re.escape(message)}"):
            sweep({**SMALL, **change}, out)
    facts = layout.facts()
    other = {**facts, "versions": {**facts["versions"], "jax": "0.0.1"}}
    monkeypatch.setattr(layout, "facts", lambda: other)
    with pytest.raises(UsageError, match=r"begun by other software .*versions.jax: the store has .*, here it is 0\.0\.1"):
        sweep(SMALL, out)
    assert contents(out) == before


def test_two_runs_at_a_time_are_refused(tmp_path):
    with Store(tmp_path / "s", Plan(parse(SMALL))), pytest.raises(UsageError, match="another process is writing"):
        sweep(SMALL, tmp_path / "s")
    sweep(SMALL, tmp_path / "s")


@pytest.mark.parametrize("kind", ["file", "zarr", "below a file", "nowhere"])
def test_places_where_no_store_can_be(kind, tmp_path):
    out = tmp_path / "s"
    if kind == "zarr":
        xarray.Dataset({"x": ("t", [1.0])}).to_zarr(out, consolidated=False)
    elif kind == "nowhere":
        out = Path("/proc/nowhere/s")
    else:
        out.write_text("")
        out = out if kind == "file" else out / "s"
    before = contents(tmp_path)
    with pytest.raises(UsageError, match="--out: "):
        sweep(SMALL, out)
    assert contents(tmp_path) == before


def test_a_large_file_of_the_users_is_not_read(tmp_path):
    (tmp_path / "s").mkdir()
    (tmp_path / "s" / "film.mkv").touch()
    os.truncate(tmp_path / "s" / "film.mkv", 10**13)  # of nothing
    with pytest.raises(UsageError, match="is not empty and holds no sweep"):
        sweep(SMALL, tmp_path / "s")


def test_links_in_a_store_are_followed_but_what_they_lead_to_is_not_written(out, tmp_path):
    (out / "n/c/0").rename(tmp_path / "elsewhere")
    (out / "n/c/0").symlink_to(tmp_path / "elsewhere")
    sweep(SMALL, out)
    (tmp_path / "elsewhere").write_bytes(b"damaged")
    sweep(SMALL, out, repair=True)
    assert (tmp_path / "elsewhere").read_bytes() == b"damaged"


def test_a_folder_in_a_missing_folder_is_not_made(config, tmp_path, capsys):
    for dry in ([], ["--dry-run"]):
        code = cli.run(["sweep", str(config()), "--out", str(tmp_path / "deep" / "er" / "s"), *dry])
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
    "temporary names": {".zarr.json.partial": "a", f"zarr.{'0' * 32}.partial": "b", ".brdfcheck-trial": "c"},
    "our temporary name": {".brdfcheck-1-1.tmp": "not what a sweep begins with"},
    "our temporary name in a folder of ours": {"n/.brdfcheck-1-1.tmp": "{"},
    "metadata that are none": {"zarr.json": "my notes on Zarr"},
    "metadata of nothing": {"zarr.json": "", "albedo/figure1.txt": "my thesis"},
    "a folder of that name": {"zarr.json/notes.txt": "my notes on Zarr"},
    "an empty folder": {"albedo": None},
}  # fmt: skip


def put(folder: Path, name: str, text: str | None) -> None:
    if text is None:
        (folder / name).mkdir(parents=True)
    else:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text(text)


@pytest.mark.parametrize("files", THESIS.values(), ids=THESIS)
def test_a_folder_with_files_of_the_users_is_refused_as_it_is(files, config, tmp_path, capsys):
    file, out = config(("240", "4")), tmp_path / "results"
    for name, text in files.items():
        put(out, name, text)
    before = contents(out)
    for how in ([], ["--repair"], ["--dry-run"]):
        code = cli.run(["sweep", str(file), "--out", str(out), *how])
        assert contents(out) == before
        assert code == cli.ExitCode.USAGE_ERROR
        complaint = capsys.readouterr().err.splitlines()[-1]
        assert complaint == f"brdfcheck: --out: {out} is not empty and holds no sweep: give another folder"


class _Killed(BaseException):
    """What a process does not survive."""


def killed_at(count: int, monkeypatch: pytest.MonkeyPatch, run: Callable[[], object]) -> None:
    """Run until the file number `count` is written, and stop in the middle of it: its beginning is there by another name."""
    metadata, chunk = store.records.write_atomically, Store._put
    left = count

    def dies(path: Path, data: bytes, name: str) -> None:
        nonlocal left
        left -= 1
        if left < 0:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.with_name(name).write_bytes(data[: len(data) // 2])
            raise _Killed

    def write(path: Path, data: bytes) -> None:
        dies(path, data, ".brdfcheck-1-1.tmp")
        metadata(path, data)

    def put(self: Store, name: str, chunk_: object, *rest: object) -> int:
        path = self._path(name, chunk_)  # pyright: ignore
        there = path.read_bytes() if path.exists() else None
        crc = chunk(self, name, chunk_, *rest)  # pyright: ignore
        data = path.read_bytes()
        if left == 0:
            path.unlink() if there is None else path.write_bytes(there)
        dies(path, data if name != "seconds" else data * 2, f"{path.name}.{'0f' * 16}.partial")
        return crc

    with monkeypatch.context() as patched:
        patched.setattr(store.records, "write_atomically", write)
        patched.setattr(Store, "_put", put)
        with pytest.raises(_Killed):
            run()


@pytest.fixture
def unfinished(tmp_path, monkeypatch):
    """A store whose creation was interrupted in the middle of its eighth file."""
    killed_at(7, monkeypatch, lambda: sweep(SMALL, tmp_path / "s"))
    return tmp_path / "s"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("notes.txt", "mine"),
        ("rule/figure1.txt", "mine"),
        ("albedo/c/0/1", "mine"),
        ("n/.brdfcheck-2-2.tmp", "mine"),
        (f"n/c/0.{'0' * 32}.partial", "mine"),
        ("rule/zarr.json", "mine"),
        ("rule/zarr.json", ""),
        ("zarr.json.unfinished", "mine"),
        ("photos", None),
        ("seconds", "a link"),
    ],
)
def test_an_unfinished_store_with_files_of_the_users_is_refused_as_it_is(name, text, unfinished, tmp_path):
    (tmp_path / "elsewhere").mkdir()
    if text == "a link":
        (unfinished / name).symlink_to(tmp_path / "elsewhere")
    else:
        put(unfinished, name, text)
    before = contents(tmp_path)
    for attempt in (
        lambda: sweep(SMALL, unfinished),
        lambda: sweep(SMALL, unfinished, repair=True),
        lambda: runner.estimate(Plan(parse(SMALL)), unfinished),
    ):
        with pytest.raises(UsageError, match="is not empty and holds no sweep: give another folder"):
            attempt()
        assert contents(tmp_path) == before


def test_an_unfinished_store_belongs_to_its_configuration_and_commit(unfinished, monkeypatch):
    before = contents(unfinished)
    with pytest.raises(UsageError, match=r"made by another configuration: brdf: the store has phong, here it is blinn-phong"):
        sweep({**SMALL, "brdf": "blinn-phong"}, unfinished)
    assert contents(unfinished) == before
    first = json.loads((unfinished / "zarr.json").read_text())["attributes"]["source_commit"]
    monkeypatch.setattr(layout, "source_commit", lambda: "another commit")
    assert sweep(SMALL, unfinished).source_commit == first


def test_files_of_the_users_in_a_store_stay(out):
    """Also where they have the very names that files have while they are written."""
    (out / "checksum/c/0/1/0").unlink()
    name = f"{'0f' * 16}.partial"
    mine = {
        ".film.mkv.partial": b"half a download", "albedo/.figure1.partial": b"my thesis", ".brdfcheck-trial": b"mine",
        f"albedo/c/0/1.{name}": b"mine", f"seconds/c/0/1.{name}": b"my notes", f"checksum/c/0/1/0.{name}": b"mine",
        "n/c/.brdfcheck-1-1.tmp": b"mine", "notes.txt": b"mine",
    }  # fmt: skip
    for name, data in mine.items():
        (out / name).write_bytes(data)
    before = contents(out, seconds=False)
    sweep(SMALL, out)
    after = contents(out)
    assert mine.items() <= after.items()
    assert set(contents(out, seconds=False)) == {*before, "checksum/c/0/1/0"} - {"checksum/c/0/1"}
    (out / "n/c/0").write_bytes(b"damaged")
    (out / "albedo/c/0/1").write_bytes(b"damaged")
    sweep(SMALL, out, repair=True)
    assert {**contents(out), "seconds/c/0/1": b""} == {**after, "seconds/c/0/1": b""}


# --- damage ---

DAMAGE = {
    "truncated": lambda data: data[:-5],
    "flipped": lambda data: bytes([data[0] ^ 1]) + data[1:],
    "empty": lambda data: b"",
    "deleted": lambda data: None,
}


def damage(path: Path, how: str) -> None:
    data = DAMAGE[how](path.read_bytes())
    path.unlink()
    if data is not None:
        path.write_bytes(data)


KEYS = ("albedo/c/0/1", "error/c/0/0", "evaluations/c/0/2", "n/c/0", "albedo/zarr.json", "zarr.json", "checksum/c/0/1/0")


@pytest.mark.parametrize("key", few(KEYS, ("albedo/c/0/1", "n/c/0", "zarr.json", "checksum/c/0/1/0")))
def test_damage_is_named_and_mended(key, out):
    before = contents(out)
    for how in DAMAGE:
        if key.startswith("checksum") and how in ("flipped", "deleted"):  # as if the results were damaged, or not computed
            continue
        damage(out / key, how)
        damaged = contents(out)
        with pytest.raises(SweepError) as error:
            sweep(SMALL, out)
        assert f"{out / key} is {'missing' if how == 'deleted' else 'damaged'}; run again with --repair" in str(error.value)
        assert contents(out) == damaged, "nothing is touched"
        data = sweep(SMALL, out, repair=True)
        mended = contents(out)
        if "/c/0/" in key:  # computed again
            mended = {name: data for name, data in mended.items() if not name.startswith("seconds/c")}
            assert mended == {name: data for name, data in before.items() if not name.startswith("seconds/c")}
        elif key == "zarr.json":  # all of it follows from the configuration but the commit
            assert data.source_commit == "unknown"
            assert {**mended, key: b""} == {**before, key: b""}
            sweep(SMALL, out)
            (out / key).write_bytes(before[key])
        else:
            assert mended == before


def test_damaged_root_metadata_are_not_made_up(out):
    """What else describes the store must be what the configuration gives, or it may be another's."""
    (out / "zarr.json").write_bytes(b"{")
    other = {**SMALL, "axes": {**SMALL["axes"], "n": {"geomspace": [1, 101, 5]}}}
    before = contents(out)
    with pytest.raises(SweepError, match=r"zarr\.json is lost, and n/c.* is not that of this configuration; put it back"):
        sweep(other, out, repair=True)
    (out / "albedo" / "zarr.json").unlink()
    with pytest.raises(SweepError, match=r"is lost, and albedo/zarr\.json is not that of this configuration"):
        sweep(SMALL, out, repair=True)
    assert contents(out) == {name: data for name, data in before.items() if name != "albedo/zarr.json"}


def test_a_damaged_time_is_named_and_mended(out):
    """It has no checksum: a measurement."""
    before = contents(out, seconds=False)
    for data in (b"", b"xx", b"xxxxxxxxx", np.float64(np.nan).tobytes(), np.float64(-1).tobytes()):
        (out / "seconds/c/0/1").write_bytes(data)
        with pytest.raises(SweepError, match="seconds/c/0/1 is damaged; run again with --repair"):
            sweep(SMALL, out)
        assert float(sweep(SMALL, out, repair=True).seconds.min()) > 0
        assert contents(out, seconds=False) == before


# --- interrupted ---


def test_killed_at_every_single_write(whole, tmp_path, monkeypatch):
    plan, expected = Plan(parse(SMALL)), contents(whole, seconds=False)
    count = len(contents(whole))
    for last in range(count):
        out = tmp_path / str(last)
        killed_at(last, monkeypatch, lambda out=out: runner.fill(plan, out))
        if last % 2:  # and once more, at the next one
            killed_at(0, monkeypatch, lambda out=out: runner.fill(plan, out))
        runner.fill(plan, out)
        assert {**contents(out, seconds=False)} == expected, f"killed at write {last} of {count}"


@pytest.mark.slow
def test_processes_that_are_interrupted_and_killed(config, tmp_path, capsys):
    file, whole, out = config(), tmp_path / "whole", tmp_path / "s"
    for number, count in ((signal.SIGINT, 3), (signal.SIGKILL, 60)):
        running = process("-m", "brdfcheck", "sweep", file, "--out", out)
        while running.poll() is None and len(list(out.glob("checksum/c/0/*/0"))) < count:
            time.sleep(0.002)
        running.send_signal(number)
        _, stderr = running.communicate(timeout=200)
        there = len(list(out.glob("checksum/c/0/*/0")))
        assert count <= there < 240
        if number == signal.SIGINT:
            assert running.returncode == cli.ExitCode.INTERRUPTED, stderr
            assert stderr.splitlines()[-2:] == [
                "the chunks computed so far are kept: the same command goes on from here",
                "brdfcheck: interrupted",
            ]
        else:
            assert running.returncode == -signal.SIGKILL
    assert cli.run(["sweep", str(file), "--dry-run", "--out", str(out)]) == 0
    assert f"{there} of 240 chunks are in" in capsys.readouterr().out
    assert cli.run(["sweep", str(file), "--out", str(out)]) == 0
    assert f"{there} were there" in capsys.readouterr().out
    assert cli.run(["sweep", str(file), "--out", str(whole)]) == 0
    assert contents(out, seconds=False) == contents(whole, seconds=False)
    assert set(contents(out)) == set(contents(whole))


# --- the disk ---


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EDQUOT])
@pytest.mark.parametrize("room", [3, 37])
def test_a_full_disk_loses_nothing(code, room, config, tmp_path, monkeypatch, capsys):
    file, out, files = config(("240", "12")), tmp_path / "s", 0

    def full(source: Path, target: Path, replace: Callable = os.replace) -> None:
        nonlocal files
        files += 1
        if files > room:
            raise OSError(code, os.strerror(code), str(target))
        replace(source, target)

    with monkeypatch.context() as patched:
        patched.setattr(os, "replace", full)
        patched.setattr(Path, "replace", lambda self, target: full(self, target))
        assert cli.run(["sweep", str(file), "--out", str(out)]) == cli.ExitCode.INTERNAL_ERROR
    complaint = capsys.readouterr().err.splitlines()[-1]
    assert complaint.startswith("brdfcheck: the disk is full: cannot write ")
    assert complaint.endswith("make room and run again to continue")
    before = {name: data for name, data in contents(out).items() if data is not None}
    assert len(before) == room
    assert cli.run(["sweep", str(file), "--out", str(out)]) == 0
    assert cli.run(["sweep", str(file), "--out", str(tmp_path / "whole")]) == 0
    kept = {name: data for name, data in before.items() if not name.startswith("seconds/c")}
    assert kept.items() <= contents(out).items()
    assert contents(out, seconds=False) == contents(tmp_path / "whole", seconds=False)


# --- devices and memory ---


@pytest.mark.slow
def test_two_devices_and_a_terminal(config, tmp_path):
    """The bytes are those of one device; a terminal gets a bar with rate and time left."""
    pty = pytest.importorskip("pty")
    file = config(('"phong"', '"phong"\nrule = ["default", "zonal"]'), ("240", "43"), ("cos_theta = 1\n", "cos_theta = 4\n"))
    ours, theirs = pty.openpty()
    command = ("-m", "brdfcheck", "sweep", file, "--out", tmp_path / "two")
    two = {"JAX_PLATFORMS": "cpu", "XLA_FLAGS": "--xla_force_host_platform_device_count=2", "TERM": "xterm", "COLUMNS": "140"}
    running = process(*command, environment=two, stdout=subprocess.DEVNULL, stderr=theirs)
    os.close(theirs)
    shown = shown_by(ours)
    assert running.wait(60) == 0
    for words in (b"sweeping", b"cells/s", b"/22 chunks", b"left"):
        assert words in shown
    runner.fill(Plan(brdfcheck.sweep.read_config(file)), tmp_path / "one")
    assert contents(tmp_path / "one", seconds=False) == contents(tmp_path / "two", seconds=False)


def test_the_mesh_is_all_local_devices():
    computer = Computer(Plan(parse(SMALL)))
    assert computer.width == jax.local_device_count()
    assert list(computer.mesh.devices.ravel()) == jax.local_devices()


@pytest.mark.slow
def test_memory_is_bounded_by_the_chunk(tmp_path):
    """A sweep of 32 times as many chunks of the same size has the same peak, but for a few MB."""
    code = """
import resource, sys
from brdfcheck.sweep import Plan, parse, fill
for columns in (20, 640):
    axes = {"n": {"geomspace": [1, 1000, 5000]}, "cos_theta": {"linspace": [0.1, 1, columns]}}
    fill(Plan(parse({"brdf": "phong", "axes": axes, "chunks": {"cos_theta": 20}})), f"{sys.argv[1]}/{columns}")
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""
    _, stdout, stderr = python("-c", code, tmp_path)
    small, large = (int(line) / 1024 for line in stdout.split()) if stdout else pytest.fail(stderr)
    # All results of the larger one would be 77 MB.
    assert large - small < 40, (small, large)
    shutil.rmtree(tmp_path / "640")


# --- the command ---


def test_a_dry_run_creates_nothing(config, tmp_path, capsys):
    assert cli.run(["sweep", str(config()), "--dry-run", "--out", str(tmp_path / "s")]) == 0
    text = capsys.readouterr().out
    for words in (
        "n 60 x cos_theta 240",
        "cells     14400 in 240 chunks of 60 x 1",
        "size      346 kB",
        "memory    ",
        "estimate  ",
    ):
        assert words in text
    assert os.listdir(tmp_path) == ["c.toml"]
    facets = config(('"phong"', '"cook-torrance"'), ("n = {", "m = {"), ("[1, 1000", "[0.1, 1"))
    assert cli.run(["sweep", str(facets), "--dry-run"]) == 0


def test_a_dry_run_of_a_huge_sweep_is_quick(config, tmp_path, capsys):
    """1e13 cells in some 1e9 chunks: counted along the axes, not one by one."""
    file = config(
        ('"phong"', '"phong"\nrule = "zonal"'), ("60", "3000000"), ("240", "3333333"), ("cos_theta = 1\n", "n = 50\n")
    )
    began = time.monotonic()
    assert cli.run(["sweep", str(file), "--dry-run", "--out", str(tmp_path / "s")]) == 0
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
        assert sum(plan.cells_of(places) for _, places in plan.pieces()) == plan.cells
        expected = sorted((chunk for chunk in chunks if chunk.index not in there), key=plan.compiled)
        assert list(plan.missing(there)) == expected
        for wave in plan.waves(plan.missing(there), 3):
            assert len({plan.compiled(chunk) for chunk in wave}) == 1


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
def test_words_that_cannot_be_done(arguments, message, config, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    config()
    assert cli.run(["sweep", *arguments]) == cli.ExitCode.USAGE_ERROR
    (complaint,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("brdfcheck: ")]
    assert message in complaint
    assert os.listdir(tmp_path) == ["c.toml"]


def test_the_last_line_says_how_it_went(config, tmp_path, capsys):
    assert cli.run(["sweep", str(config(("240", "4"))), "--out", str(tmp_path / "s")]) == 0
    captured = capsys.readouterr()
    for words in ("complete; 4 of 4 chunks computed in ", "cells/s"):
        assert words in captured.out
    for words in ("4 of 4 chunks, ", "left"):
        assert words in captured.err


AXES = "[axes]\nn = [1, 2, 3, 4, 5]\ncos_theta = [0.2, 0.5, 1.0]\nlimit = LIMIT\n[chunks]\nn = 2\ncos_theta = 3\n"


@pytest.mark.parametrize(
    ("limit", "code", "line"),
    [
        (0, cli.ExitCode.FAILED, "all 15 albedos are not a number; 3 of 3 chunks computed in "),
        (4, cli.ExitCode.PASSED, "3 of 15 albedos are not a number"),
        (5, cli.ExitCode.PASSED, "complete; 3 of 3 chunks computed in "),
    ],
)
def test_albedos_that_are_not_a_number_are_said(limit, code, line, config, mine, capsys):
    """At the first run and where they are there already; a chunk that hangs over the end has no more of them."""
    file = config(("LIMIT", str(limit)), text=f'brdf = "mine.py:nan_above"\n{AXES}')
    for again in (False, True):
        assert cli.run(["sweep", str(file), "--out", str(mine / "s")]) == code
        lines = capsys.readouterr().out.splitlines()
        expected = line.replace("3 of 3 chunks", "0 of 3 chunks") if again else line
        assert any(text.startswith(f"{mine / 's'}: {expected}") for text in lines), lines
        assert any("complete" in text for text in lines) == (code == 0)
        assert any("not a number" in text for text in lines) == ("not a number" in line)


def test_albedos_of_one_cell_and_of_channels_are_counted(config, mine, capsys):
    file = config(text='brdf = "mine.py:nan_above"\n[axes]\nn = 2\nlimit = 1\ncos_theta = 1\n')
    assert cli.run(["sweep", str(file), "--out", str(mine / "s")]) == cli.ExitCode.FAILED
    assert "s: the only albedo is not a number; 1 of 1 chunks computed" in capsys.readouterr().out
    file = config(text='brdf = "mine.py:no_grazing"\n[axes]\ncos_theta = [0.2, 0.5, 1.0]\n[chunks]\ncos_theta = 2\n')
    for _ in range(2):
        assert cli.run(["sweep", str(file), "--out", str(mine / "t")]) == 0
        assert "t: 2 of 6 albedos are not a number" in capsys.readouterr().out


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
    assert computing <= set(layout._COMPUTING)
