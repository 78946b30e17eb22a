"""Fitted factors: the optima of every lobe, over any range; certification; what is refused."""

from __future__ import annotations

import functools

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import linprog
from selection import few

import brdfcheck
from brdfcheck.brdf import catalog
from brdfcheck.brdf.factors import Factor, Normalized, RationalFactor, exact_factor
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, Phong
from brdfcheck.fits.factor import OBJECTIVES, FactorFit, certify, fit_factor
from brdfcheck.fits.ladder import factor_ladder
from brdfcheck.fits.minimax import spread
from brdfcheck.fits.raw import RawAlbedo
from brdfcheck.output.records import fit_object
from brdfcheck.output.text import describe
from brdfcheck.quadrature.albedo import albedo
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.verdict import Verdict

# One entry for each lobe: the factors of entries are taken off.
LOBES = [
    "phong", "blinn-phong", *(f"{name}-{form}" for form in ("mirror", "half") for name in (
        "schlick", "kuijk-blake", "lyon-1", "lyon-2", "lyon-3", "binomial-power",
    )),
]  # fmt: skip

# Of the half form `test_the_published_optima` has two.
FAST = ("kuijk-blake-mirror",)


@functools.cache
def fitted(name: str, n: tuple[float, float] = (1, 1000)) -> FactorFit:
    """The minimax fit of an entry, made once for all tests that look at it."""
    return fit_factor(name, n)


@functools.cache
def optimum(name: str, low: float, high: float) -> tuple[float, float, float]:
    """A, B and the smallest albedo by one dense linear program on the closed form: no exchange, no quadrature."""
    n = spread(low, high, 30_000)
    brdf = catalog.entry(name).family.build(n=1.0)
    lobe = brdf.lobe if isinstance(brdf, Normalized) else brdf
    factor = exact_factor(lobe)
    raw = 1 / np.asarray(factor(n))
    column, ones = np.stack([n / high * raw, raw], axis=1), np.ones((n.size, 1))
    rows = np.block([[column, 0 * ones], [-column, ones]])
    result = linprog(
        [0, 0, -1],
        rows,
        np.r_[ones[:, 0], 0 * ones[:, 0]],
        bounds=(None, None),
        method="highs-ds",
        options={"primal_feasibility_tolerance": 1e-10},
    )
    x, y, smallest = result.x
    return y / x * high, high / x, smallest


@pytest.mark.parametrize("limits", few([(1.0, 1000.0), (1.0, 1e5), (3.0, 50.0)], ((1.0, 1000.0),)))
@pytest.mark.parametrize("name", few(LOBES, FAST))
def test_minimax_is_the_optimum_of_the_linear_program(name, limits):
    a, b, smallest = optimum(name, *limits)
    fit = fitted(name, limits)
    assert fit.smallest == pytest.approx(smallest, abs=2e-7)
    assert float(fit.factor.A) == pytest.approx(a, rel=5e-6, abs=5e-6)
    assert float(fit.factor.B) == pytest.approx(b, rel=5e-6)
    assert fit.peak <= 1 + 1e-12
    assert fit.verdict is Verdict.CONSERVES
    assert fit.report.cos_theta == pytest.approx(1) or fit.peak < 1 + 1e-12


def test_the_published_optima():
    """Binomial power half 7.2427, 26.170, 0.9064; Blinn-Phong 7.8025, 26.716, 0.9424."""
    for name, a, b, smallest in (("binomial-power-half", 7.2427, 26.170, 0.9064), ("blinn-phong", 7.8025, 26.716, 0.9424)):
        fit = fitted(name)
        assert float(fit.factor.A) == pytest.approx(a, abs=5e-5)
        assert float(fit.factor.B) == pytest.approx(b, abs=5e-4)
        assert fit.smallest == pytest.approx(smallest, abs=5e-5)
        assert fit.objective == "minimax"
        assert fit.n == (1, 1000)


@pytest.mark.parametrize("objective", few(OBJECTIVES, ("minimax",)))
def test_every_result_conserves_and_touches_the_line(objective):
    for target in ("schlick-half", BlinnPhong):
        fit = fit_factor(target, (1, 500), objective)
        assert fit.verdict is Verdict.CONSERVES
        assert fit.report.passed
        assert 1 - 1e-9 < fit.peak <= 1 + 1e-12
        # The place of the peak is where an independent call finds it.
        lobe = catalog.entry(target).family.build(n=fit.at["n"]) if isinstance(target, str) else target(fit.at["n"])
        raw = lobe.lobe if isinstance(lobe, Normalized) else lobe
        value = albedo(Normalized(raw, fit.factor), fit.at["cos_theta"])
        assert float(value.value) == pytest.approx(fit.peak, abs=1e-11)
        assert fit.history[-1].factor is fit.factor
        assert fit.history[-1].peak == fit.peak


@pytest.mark.slow
def test_smallest_is_the_continuous_minimum():
    fit = fit_factor("schlick-mirror")
    n = np.sort(np.concatenate([spread(1, 1000, 20_001), fit.smallest_n * (1 + np.linspace(-1e-3, 1e-3, 2001))]))
    table = brdfcheck.albedo_table(lambda n: Normalized(brdfcheck.Schlick(n), fit.factor), n, [1.0])
    assert fit.smallest == pytest.approx(float(np.min(table.value)), abs=1e-10)
    assert n[int(np.argmin(table.value))] == pytest.approx(fit.smallest_n, rel=1e-3)


def test_the_smallest_of_equals_is_at_the_smallest_exponent():
    """A minimax albedo is as small at both ends of the range: rounding must not choose between them."""
    fit = fitted("binomial-power-half")
    assert fit.smallest_n == 1
    ends = [float(albedo(Normalized(BinomialPower(n), fit.factor), 1.0).value) for n in (1.0, 1000.0)]
    assert ends == pytest.approx([fit.smallest] * 2, rel=1e-11)


@pytest.mark.parametrize("objective", few(["least-squares", "reciprocal"], ("least-squares",)))
def test_least_squares_against_the_normal_equations(objective):
    n = np.arange(1.0, 301.0)
    raw = 8 * np.pi * (2 ** (-n / 2) + n) / ((n + 2) * (n + 4))
    if objective == "least-squares":
        (x, y), *_ = np.linalg.lstsq(np.stack([n * raw, raw], axis=1), np.ones(n.size), rcond=None)
    else:
        (x, y), *_ = np.linalg.lstsq(np.stack([n, np.ones(n.size)], axis=1), 1 / raw, rcond=None)
    fit = fit_factor(BlinnPhong, (1, 300), objective, sampling="integers")
    assert float(fit.fitted.A) == pytest.approx(y / x, rel=1e-8)
    assert float(fit.fitted.B) == pytest.approx(1 / x, rel=1e-9)
    # Unconstrained least squares overshoots; B is enlarged by just that, and A stays.
    assert fit.history[0].peak > 1.001
    assert float(fit.factor.A) == pytest.approx(float(fit.fitted.A), rel=1e-12)
    assert float(fit.factor.B) == pytest.approx(float(fit.fitted.B) * fit.history[0].peak, rel=1e-9)


def test_the_seeds_constants_are_nearly_a_certified_least_squares_fit():
    """Least squares over the integers 1 to 1000, enlarged until it conserves: (5.992, 24.581); the seed has (6, 24.55)."""
    fit = fit_factor("binomial-power-raw", (1, 1000), "least-squares", sampling="integers")
    assert float(fit.factor.A) == pytest.approx(5.992, abs=5e-4)
    assert float(fit.factor.B) == pytest.approx(24.581, abs=5e-4)
    assert fit.history[0].peak == pytest.approx(1.03366, abs=5e-5)


def test_an_exact_factor_is_found_and_left_alone():
    for objective in OBJECTIVES:
        fit = fit_factor(Phong, (1, 1e5), objective)
        assert float(fit.factor.A) == pytest.approx(2, abs=1e-6)
        assert float(fit.factor.B) == pytest.approx(2 * np.pi, rel=1e-9)
        assert fit.smallest == pytest.approx(1, abs=1e-8)
        assert not fit.remark


def test_the_worst_angle_joins_the_program():
    """Divided by N.L the albedo is largest at 89 degrees: normal incidence alone would be wrong by a factor of 18.7."""
    fit = fit_factor("phong-classical")
    assert fit.verdict is Verdict.CONSERVES
    assert fit.at["cos_theta"] == pytest.approx(np.cos(np.radians(89)))
    assert float(fit.factor.B) == pytest.approx(2 * np.pi * 18.74, rel=1e-3)
    assert "89 degrees the lobe reflects 18.74 times" in fit.remark


def test_waste_is_said_and_explained():
    fit = fit_factor("schlick-mirror", (1, 1e5))
    assert fit.smallest == pytest.approx(0.4094, abs=5e-5)
    assert "even the best factor of this form reflects only 0.4094" in fit.remark
    # d(n E)/d ln n tends to 2 pi.
    assert "grows like 6.281 ln n" in fit.remark
    assert "stops getting narrower" in fit_factor("kuijk-blake-mirror", (1, 1e5)).remark
    assert not fit_factor("schlick-mirror", (1, 30)).remark


@pytest.mark.slow
def test_a_lobe_that_explodes_still_gets_a_conserving_factor():
    fit = fit_factor("binomial-power-unclamped")
    assert fit.verdict is Verdict.CONSERVES
    assert fit.smallest < 1e-20
    assert "90 degrees" in fit.remark


@pytest.mark.parametrize("high", few([1e10, 1e12], (1e12,)))
@pytest.mark.parametrize(
    "name", few(["phong", "blinn-phong", "lyon-1-mirror", "binomial-power-half"], ("phong", "lyon-1-mirror"))
)
def test_ranges_of_many_decades(name, high):
    """A line is level where n times the raw albedo is, however many decades the raw albedo spans."""
    _, _, smallest = optimum(name, 1.0, 1e5)
    fit = fit_factor(name, (1, high))
    assert fit.smallest == pytest.approx(smallest, abs=2e-4)  # what is left to lose beyond 1e5 is about 1/n
    assert float(fit.factor.A) < 10
    assert fit.verdict is Verdict.CONSERVES
    assert not fit.remark


@pytest.mark.parametrize("width", few([0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-3], (0.0, 1e-12)))
@pytest.mark.parametrize("name", few(["phong", "schlick-half", "binomial-power-half"], ("schlick-half",)))
def test_narrow_ranges(name, width):
    for low in (10.0, 1000.0, 1e5):
        fit = fit_factor(name, (low, low * (1 + width)))
        assert isinstance(fit.factor, Factor)
        assert fit.smallest == pytest.approx(1, abs=1e-8 + width**2)
        assert fit.peak - fit.peak_error <= 1
        assert fit.verdict is Verdict.CONSERVES


@pytest.mark.slow
def test_the_best_line_falls_where_the_raw_albedo_rises():
    """Independent of the program: A is tried on a fine grid, B follows from the largest albedo over all angles."""
    fit = fit_factor("binomial-power-unclamped", (100, 130))
    raw = RawAlbedo("binomial-power-unclamped", (100, 130))
    n = spread(100, 130, 1201)
    normal = raw(n)
    cosines = np.concatenate([np.zeros(1), np.linspace(1e-3, 1, 13) ** 2])
    ceiling = raw.at(np.repeat(n, cosines.size), np.tile(cosines, n.size)).reshape(n.size, -1).max(axis=1)
    zeros = 130 + np.geomspace(0.1, 100, 2001)
    lines = (zeros[:, None] - n) / np.max((zeros[:, None] - n) * ceiling, axis=1, keepdims=True)
    best = np.max(np.min(lines * normal, axis=1))
    assert float(fit.factor.B) < 0
    assert fit.smallest == pytest.approx(best, rel=2e-3)
    assert -float(fit.factor.A) == pytest.approx(zeros[np.argmax(np.min(lines * normal, axis=1))], abs=0.1)
    assert fit.report.passed
    assert describe(fit.factor, 6) == "(133.51 - n)/5.81463e+12"


def test_users_families():
    def glossy(n, ks):
        return Normalized(Phong(n), Factor(2.0, 2 * np.pi / ks))

    fit = fit_factor(Family("glossy", glossy, {"n": (1, 10), "ks": (0.5, 0.5)}), (1, 100))
    assert float(fit.factor.B) == pytest.approx(2 * np.pi, rel=1e-9)
    with pytest.raises(ValueError, match="hold ks at one value, not 0:1"):
        fit_factor(Family("glossy", glossy, {"n": (1, 10), "ks": (0, 1)}))


def by_numbers(n):
    """An exponent that JAX cannot trace, so that numpy evaluates the lobe."""
    return np.maximum(float(n), 5.0)


@pytest.mark.parametrize("exponent", [lambda n: n**2, lambda n: 40.0, pytest.param(by_numbers, marks=pytest.mark.slow)])
def test_the_factor_is_of_the_familys_exponent_and_not_the_lobes(exponent):
    """Of a squared exponent, a lobe that is held at one, and code that JAX cannot trace."""
    fit = fit_factor(lambda n: BlinnPhong(exponent(n)), (1, 30))
    n = np.geomspace(1, 30, 200)
    raw = np.array([albedo(BlinnPhong(exponent(one)), 1.0).value for one in n])
    largest = np.max(np.asarray(fit.factor(n)) * raw)
    assert largest == pytest.approx(1, abs=1e-3)
    assert float(fit.report.albedo) == pytest.approx(1, abs=1e-8)
    assert fit.verdict is Verdict.CONSERVES
    assert fit.proved is None


def test_the_factor_of_an_exponent_by_numbers_is_put_at_the_familys():
    raw, factor = RawAlbedo(lambda n: BlinnPhong(by_numbers(n)), (1, 30)), Factor(2.0, 10.0)
    assert not raw.own
    value = float(albedo(BlinnPhong(5.0), 1.0).value)
    assert raw(np.array([3.0])) == pytest.approx(value, rel=1e-9)
    scaled = PointwiseAlbedo(raw.with_factor(factor))(np.full((1, 1), 3.0), np.ones(1), np.zeros(1))[0]
    assert scaled == pytest.approx(float(factor(3.0)) * value, rel=1e-9)


def test_an_exponent_that_is_only_converted_is_the_lobes_own():
    assert RawAlbedo(lambda n: Phong(jnp.asarray(n, float)), (1, 100)).own
    assert RawAlbedo("binomial-power-half", (1, 100)).own
    assert not RawAlbedo(lambda n: Phong(n / 2), (1, 100)).own
    # Its exact factor would be that of another exponent.
    assert "closed form" not in [rung.form for rung in factor_ladder(lambda n: Phong(n / 2), (1, 10), measure=False)]


@pytest.mark.slow
def test_users_functions():
    def function(n):
        def f(wi, wo):
            cosine = np.maximum(wi[..., 2] * wo[..., 2] - wi[..., 0] * wo[..., 0] - wi[..., 1] * wo[..., 1], 0)
            return cosine**n

        return f

    slow = fit_factor(function, (1, 4))
    assert float(slow.factor.A) == pytest.approx(2, rel=1e-3)
    assert slow.verdict is Verdict.CONSERVES


def test_names_are_what_they_are_for_check(here):
    (here / "mine.py").write_text("from brdfcheck import Phong\n\ndef halved(n):\n    return Phong(n / 2)\n")
    fit = fit_factor("mine.py:halved", (1, 10))
    assert (fit.name, fit.verdict) == ("mine.py:halved", Verdict.CONSERVES)
    assert float(fit.factor.A) == pytest.approx(4, rel=1e-6)  # (n/2 + 2)/2pi
    assert float(fit_factor("Phong", (1, 10)).factor.B) == pytest.approx(2 * np.pi, rel=1e-6)
    with pytest.raises(KeyError, match="unknown BRDF 'phon'; did you mean phong"):
        fit_factor("phon")


def test_certify_enlarges_b_by_the_peak():
    raw = RawAlbedo(BinomialPower, (1, 1000))
    factor, report = certify(raw, Factor(6.0, 24.55))
    assert float(factor.A) == 6
    assert float(factor.B) == pytest.approx(24.5893, abs=5e-5)  # the smallest safe B for A = 6
    assert report.verdict is Verdict.CONSERVES
    kept, _ = certify(raw, Factor(6.0, 30.0))
    assert float(kept.B) == 30


def test_what_has_no_exponent_gets_one_constant():
    fit = fit_factor(brdfcheck.load(lambda wi, wo, k: k * wi[..., 2] * wo[..., 2], k=(0.75, 0.75)))
    assert float(fit.factor.B) == pytest.approx(0.75 * 2 * np.pi / 3, rel=1e-8)
    assert fit.report.passed
    assert fit.report.parameters["k"] == 0.75
    assert "a factor that grows" not in fit.remark
    lobe = fit_factor(brdfcheck.load(Phong(10.0)))  # its own exponent is none of the factor's
    assert float(lobe.factor.B) == pytest.approx(2 * np.pi / 12, rel=1e-9)
    assert lobe.report.albedo == pytest.approx(1, abs=1e-8)
    assert lobe.verdict is Verdict.CONSERVES


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("lambert",), "lambert has no exponent n to normalise over; it has reflectance"),
        (("cook-torrance",), "has no exponent n"),
        (("rough-dielectric-ggx",), "rough-dielectric-ggx transmits, and a factor is for what reflects"),
        (("phong", (10, 1)), "the range of n is empty: 10 > 1"),
        (("phong", (-1, 1)), "got -1:1"),
        (("phong", (1, np.inf)), "got 1:inf"),
        (("phong", (np.nan, 1)), "got nan:1"),
        (("phong", 5), "must be two numbers"),
        (("phong", (1, 10), "best"), "objective must be one of minimax, least-squares, reciprocal; got 'best'"),
    ],
)
def test_bad_arguments(arguments, message):
    with pytest.raises(ValueError, match=message.replace("(", r"\(")):
        fit_factor(*arguments)


def test_bad_samplings():
    with pytest.raises(ValueError, match="sampling must be one of"):
        fit_factor("phong", sampling="random")
    with pytest.raises(ValueError, match="samples must be a whole number, at least 2; got 1"):
        fit_factor("phong", objective="least-squares", samples=1)
    with pytest.raises(ValueError, match="fewer than two integers"):
        fit_factor("phong", (1.2, 1.8), "reciprocal", sampling="integers")
    with pytest.raises(KeyError, match="unknown BRDF"):
        fit_factor("blin-phong")
    with pytest.raises(TypeError):
        fit_factor(3.5)


def test_formulas_and_json():
    import json

    assert describe(Factor(6.0, 24.55)) == "(n + 6)/24.55"
    assert describe(Factor(-6.0, 24.55)) == "(n - 6)/24.55"
    assert describe(Factor(-6.0, -24.55)) == "(6 - n)/24.55"
    assert describe(RationalFactor([1.0, -2.0, 3.0], [1.0, 0.5])) == "(3 n^2 - 2 n + 1)/(0.5 n + 1)"
    fit = fit_factor("phong", (1, 10), "reciprocal")
    record = json.loads(json.dumps(fit_object(fit)))
    assert record["factor"]["form"] == "Factor"
    assert record["factor"]["A"] == pytest.approx(2)
    assert len(record["history"]) == len(fit.history)
