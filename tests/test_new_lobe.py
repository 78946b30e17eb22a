"""A lobe from outside of the package, a class and a row of the catalogue, goes wherever the lobes of the package go."""

from __future__ import annotations

from pathlib import Path
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
import xarray

import brdfcheck
from brdfcheck import albedo, albedo_table, catalog, cli, fit_factor
from brdfcheck.brdf.base import AbstractZonalLobe, as_parameter
from brdfcheck.brdf.factors import AbstractFactor, Normalized
from brdfcheck.cli import ExitCode
from brdfcheck.fits.ladder import CLOSED_FORM, FORMS, factor_ladder
from brdfcheck.scene.materials import NotConserving, Surface, Term
from brdfcheck.scene.white_furnace import furnace_excess
from brdfcheck.verdict import Verdict


@final
class BellExact(AbstractFactor):
    """n^2 / (2 pi (n - 1 + exp(-n)))."""

    def __call__(self, n):
        n = jnp.asarray(n)
        return n**2 / (2 * np.pi * (n - 1 + jnp.exp(-n)))


@final
class Bell(AbstractZonalLobe):
    """exp(-n (1 - R.V))."""

    n: object
    form: str = eqx.field(static=True)

    def __init__(self, n):
        self.n, self.form = as_parameter(n), "mirror"

    def profile(self, versine):
        return jnp.exp(-self.n * versine)

    def width(self):
        return 1 / jnp.sqrt(self.n + 0.05)

    def breaks(self):
        return jnp.minimum(40 / jnp.maximum(self.n, 1), 1)[None]

    def smoothness(self):
        return np.inf

    @property
    def monotone(self):
        return True

    def exact_factor(self):
        return BellExact()


def entry(name: str, scale: float = 1.0) -> catalog.Entry:
    family = brdfcheck.Family(name, lambda n: Normalized(Bell(n), Scaled(scale)), {"n": (1.0, 100.0)})
    return catalog.Entry(family, "exp(-n (1 - R.V))", "nobody")


class Scaled(AbstractFactor):
    """The exact factor times a number."""

    scale: float = eqx.field(static=True)

    def __call__(self, n):
        return self.scale * BellExact()(n)


@pytest.fixture(autouse=True)
def bell(monkeypatch: pytest.MonkeyPatch) -> None:
    """The lobe as "bell", and as "bell-bright" one per cent too bright; forgotten after the test."""
    monkeypatch.setattr(catalog, "_CATALOG", {one.name: one for one in catalog.entries()})
    catalog.register(entry("bell"))
    catalog.register(entry("bell-bright", 1.01))


def test_a_name_is_registered_once() -> None:
    assert catalog.names()[-2:] == ("bell", "bell-bright")
    with pytest.raises(ValueError, match="there is a BRDF 'phong' already"):
        catalog.register(entry("phong"))


def test_check_table_and_fit() -> None:
    good, bright = (brdfcheck.check(name, effort="quick") for name in ("bell", "bell-bright"))
    assert (good.verdict, bright.verdict) == (Verdict.CONSERVES, Verdict.VIOLATES)
    assert (good.engine, good.basis) == ("zonal", "theorem")
    assert bright.albedo == pytest.approx(1.01, abs=1e-9)
    n, mu = np.array([1.0, 7.0, 80.0]), np.array([1.0, 0.4])
    table = albedo_table("bell", n, mu)
    np.testing.assert_allclose(table.value[:, 0], 1, rtol=1e-12)
    np.testing.assert_allclose(table.value[1], albedo(Normalized(Bell(7.0), BellExact()), mu).value, rtol=1e-12)
    fit = fit_factor("bell")
    assert fit.verdict is Verdict.CONSERVES
    assert 0.8 < fit.smallest < 1
    # Each form is dearer and loses less than the one before; the last one, the lobe's own, nothing.
    *rungs, closed = factor_ladder("bell", measure=False)
    assert [rung.form for rung in (*rungs, closed)] == [*(form for form, _ in FORMS), CLOSED_FORM]
    assert all(rung.verdict is Verdict.CONSERVES for rung in (*rungs, closed))
    assert np.all(np.diff([rung.operations for rung in rungs]) > 0)
    assert np.all(np.diff([rung.lost for rung in rungs]) < 0)
    assert rungs[-1].lost > 1e-6
    assert closed.lost < 1e-12


def test_sweep_plot_and_render(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    Path("c.toml").write_text('brdf = "bell"\n[axes]\nn = [1, 20]\ncos_theta = [0.3, 1.0]\n')
    Path("s.toml").write_text(
        'size = 16\n[material]\nkind = "surface"\nterms = [{ brdf = "bell", tint = 0.5, n = 20 }]\n'
        '[[lights]]\nkind = "distant"\ndirection = [0, 0, 1]\n'
    )
    for words in (
        ("check", "bell", "--effort", "quick"),
        ("sweep", "c.toml", "--out", "s.zarr"),
        ("plot", "albedo-vs-n", "bell", "--samples", "5", "-o", "a.svg"),
        ("render", "s.toml", "-o", "a.png"),
    ):
        assert cli.run(words) == ExitCode.PASSED, capsys.readouterr().err
    swept = xarray.open_zarr("s.zarr", chunks=None).albedo
    np.testing.assert_allclose(swept.sel(cos_theta=1.0), 1, rtol=1e-12)
    assert "bell" in Path("a.svg").read_text()
    Path("s.toml").write_text(Path("s.toml").read_text().replace('"bell"', '"bell-bright"'))
    assert cli.run(("render", "s.toml", "-o", "b.png")) == ExitCode.USAGE_ERROR
    assert "bell-bright is not validated (VIOLATES: albedo 1.01" in capsys.readouterr().err


def test_sphere_and_white_furnace() -> None:
    with pytest.raises(NotConserving, match="bell-bright"):
        Surface(Term("bell-bright", n=20.0))
    excess, covered = furnace_excess("bell", {"n": 20.0}, 9)
    assert excess[4, 4] == pytest.approx(0, abs=1e-4)
    assert covered[4, 4] == 1
    assert furnace_excess("bell-bright", {"n": 20.0}, 9)[0].max() == pytest.approx(0.01, abs=1e-4)
