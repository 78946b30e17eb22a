"""The catalogue: what must conserve conserves, and each published claim comes out as it must."""

from __future__ import annotations

import functools
import inspect
from types import ModuleType

import numpy as np
import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from problems import LOBES, facet_lobe, facet_tables, zonal_tables
from selection import few

from brdfcheck.brdf import catalog, lobes, microfacet
from brdfcheck.brdf.base import FORMS, AbstractBRDF, AbstractMicrofacetLobe, AbstractZonalLobe
from brdfcheck.brdf.family import Family
from brdfcheck.quadrature.albedo import albedo
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.verdict import Report, Verdict, check

VALIDATED = [entry.name for entry in catalog.entries() if entry.validated]
PUBLISHED = [entry.name for entry in catalog.entries() if not entry.validated]


@functools.cache
def report_of(name: str) -> Report:
    """Every entry, checked once."""
    return check(name)


# --- the gate ---


# One of each engine and basis; `brdfcheck check` goes through all.
FAST = ("lambert", "phong", "blinn-phong", "lyon-2-half", "binomial-power-half", "ggx")


@pytest.mark.parametrize("name", few(VALIDATED, FAST))
def test_validated_entries_conserve_and_have_no_defect(name: str) -> None:
    report = report_of(name)
    assert report.verdict is Verdict.CONSERVES
    assert report.findings == ()
    transmits = catalog.entry(name).family.surface is not None
    assert all(transmits and note.startswith("light from above: R = ") for note in report.notes)
    assert len(report.notes) == transmits
    assert report.passed
    assert report.side.passed
    # Of the whole range of angles, not of the worst place alone; of a boundary, which a theorem decides, it reaches up to 1.
    assert report.error <= 4e-10 or (transmits and report.albedo + report.error <= 1)
    assert report.above in ((), None)
    # The largest albedo of a good factor is near 1: a factor that is merely small would pass as well.
    assert report.albedo > 0.9999
    for parameter, (low, high) in report.ranges.items():
        assert low <= report.parameters[parameter] <= high


# name: verdict, peak, its parameter, its angle in degrees, intervals above 1 (to the digits that are known)
CLAIMS: dict[str, tuple[Verdict, object, object, object, tuple]] = {
    "binomial-power-raw": (
        Verdict.VIOLATES, pytest.approx(2.8777046827, abs=1e-9), 1.0, 0.0, ((1.0, pytest.approx(18.588159660, abs=1e-6)),),
    ),
    "binomial-power-published": (
        Verdict.VIOLATES, pytest.approx(1.0016005217, abs=1e-10), pytest.approx(17.8511976, abs=1e-4), 0.0,
        (pytest.approx((14.303004, 23.056070), abs=1e-5),),
    ),
    "binomial-power-unclamped": (
        Verdict.VIOLATES, pytest.approx(6.7194865e28, rel=1e-6), 1000.0, pytest.approx(90, abs=0.1),
        (pytest.approx((14.303004, 23.056070), abs=1e-5), pytest.approx((36.27819, 1000.0), abs=1e-5)),
    ),
    "blinn-phong-6": (Verdict.CONSERVES, pytest.approx(0.99999205, abs=1e-8), 1000.0, 0.0, ()),
    "blinn-phong-8": (
        Verdict.VIOLATES, pytest.approx(1.0752011615, abs=1e-10), pytest.approx(8.7637414, abs=1e-4), 0.0, ((1.0, 1000.0),),
    ),
    "blinn-phong-ndf": (Verdict.VIOLATES, pytest.approx(4 * 1000 / 1004, rel=1e-12), 1000.0, 0.0, ((1.0, 1000.0),)),
    "blinn-phong-linear": (
        Verdict.CONSERVES, pytest.approx((39.7436 + 0.0856832) * 8 * np.pi * 1000 / 1002 / 1004, rel=1e-12), 1000.0, 0.0, (),
    ),
    "phong-pdf": (Verdict.CONSERVES, pytest.approx(1001 / 1002, rel=1e-12), 1000.0, 0.0, ()),
    "phong-classical": (
        Verdict.VIOLATES, pytest.approx(18.7, abs=0.05), 1.0, pytest.approx(89, abs=1e-9), ((1.0, 1000.0),),
    ),
    "schlick-phong-factor": (
        Verdict.VIOLATES, pytest.approx(5.44, abs=5e-3), 1000.0, 0.0, (pytest.approx((1.0, 1000.0), abs=1e-6),),
    ),
    "kuijk-blake-phong-factor": (
        Verdict.VIOLATES, pytest.approx(3.91, abs=5e-3), 1000.0, 0.0,
        (pytest.approx((1.0, 1.151), abs=1e-3), pytest.approx((4.2155, 15.487), abs=1e-3),
         pytest.approx((77.757, 1000.0), abs=1e-3)),
    ),
    "cook-torrance-published": (
        # Four times a lobe that reflects everything: at grazing for every m, and on a plateau at small m. Any place will do.
        Verdict.VIOLATES, pytest.approx(4, abs=1e-7), pytest.approx(0.525, abs=0.475),
        pytest.approx(45, abs=45), ((0.05, 1.0),),
    ),
    "cook-torrance-no-masking": (
        Verdict.VIOLATES, pytest.approx(16.66, abs=0.01), 1.0, pytest.approx(89, abs=1e-9), ((0.05, 1.0),),
    ),
}  # fmt: skip


# `audit` goes through all.
LONG_CLAIMS = ("cook-torrance-published", "binomial-power-raw", "binomial-power-unclamped", "schlick-phong-factor", "phong-pdf")
LONG_CLAIMS += ("kuijk-blake-phong-factor",)


@pytest.mark.parametrize("name", few(PUBLISHED, set(PUBLISHED).difference(LONG_CLAIMS)))
def test_claims_come_out_as_they_must(name: str) -> None:
    report = report_of(name)
    verdict, peak, place, angle, above = CLAIMS[name]
    assert report.verdict is verdict
    assert report.albedo == peak
    assert list(report.parameters.values()) == [place]
    assert report.angle == angle
    # The albedo at the place that is named is the one that is named.
    there = albedo(catalog.entry(name).family.build(**report.parameters), report.cos_theta)
    assert float(there.value) == pytest.approx(report.albedo, rel=1e-8)
    assert len(report.above) == len(above)
    for interval, expected in zip(report.above, above, strict=True):
        assert interval == expected
    if name == "phong-classical":
        assert "not reciprocal" in report.findings[0]
    else:
        assert report.findings == ()


# --- the list itself ---


def test_names_are_unique_and_entries_are_told_in_full() -> None:
    built = catalog._entries()
    assert len({entry.name for entry in built}) == len(built) == len(catalog.entries())
    assert catalog.names() == tuple(entry.name for entry in catalog.entries())
    validated = [entry.validated for entry in catalog.entries()]
    assert validated == sorted(validated, reverse=True)
    for entry in catalog.entries():
        assert entry.formula
        assert entry.source
        assert entry.family.ranges
        assert entry.validated == (entry.claim == "")
        assert entry.name == entry.name.lower()
        assert entry.formula.isascii()


def test_the_factor_in_the_formula_is_the_one_that_is_used() -> None:
    seen = 0
    for entry in catalog.entries():
        brdf = entry.family.build(**{name: high for name, (_, high) in entry.family.ranges.items()})
        factor = getattr(brdf, "factor", None)
        if hasattr(factor, "B") and entry.formula.startswith("(n+") and "pi" not in entry.formula.split(" ")[0]:
            assert entry.formula.startswith(f"(n+{float(factor.A):g})/"), entry.name
            if "pi" not in entry.formula:
                assert f"/{float(factor.B):g} " in entry.formula, entry.name
                seen += 1
    assert seen >= 13


@pytest.mark.parametrize(
    ("name", "near"),
    [
        ("fong", "phong"),
        ("blin-phong", "blinn-phong"),
        ("GGX", "mean ggx"),
        ("qqqq", "brdfcheck list"),
        ("cook", "cook-torrance"),
    ],
)
def test_unknown_names_are_answered_with_near_ones(name: str, near: str) -> None:
    with pytest.raises(KeyError, match=near) as caught:
        catalog.entry(name)
    assert repr(name) in caught.value.args[0]


def test_exponent_family() -> None:
    assert catalog.exponent_family("phong")(3.0).lobe.n == 3
    assert catalog.exponent_family("ggx")(0.25).alpha == 0.25
    with pytest.raises(KeyError, match="phong"):
        catalog.exponent_family("fong")
    wide = catalog.Entry(Family("wide", lambda a, b: None, {"a": (0, 1), "b": (0, 1)}), "", "")
    empty = catalog.Entry(Family("none", lambda: None), "", "")
    known = catalog._CATALOG
    try:
        known["wide"], known["none"] = wide, empty
        with pytest.raises(ValueError, match="wide has 2 parameters; a table needs exactly one"):
            catalog.exponent_family("wide")
        with pytest.raises(ValueError, match="none has 0 parameters"):
            catalog.exponent_family("none")
    finally:
        del known["wide"], known["none"]


# --- adding a lobe: nothing may be forgotten ---


def final_classes(module: ModuleType, kind: type) -> set[type]:
    return {
        value
        for value in vars(module).values()
        if inspect.isclass(value)
        and issubclass(value, kind)
        and value.__module__ == module.__name__
        and getattr(value, "__final__", False)
    }


def shape_of(lobe: AbstractBRDF) -> tuple[type, object, object]:
    """What tells the variants of a class apart that need values of their own."""
    return type(lobe), getattr(lobe, "form", None), getattr(lobe, "clamped", None)


def variants(kind: type) -> set[tuple[type, object, object]]:
    arguments = inspect.signature(kind).parameters
    forms = FORMS if "form" in arguments else (None,)
    clamps = (True, False) if "clamped" in arguments else (None,)
    chosen = [
        {key: value for key, value in (("form", form), ("clamped", clamped)) if value is not None}
        for form in forms
        for clamped in clamps
    ]
    return {shape_of(kind(1.0, **options)) for options in chosen}


def without_catalogue_row(classes: set[type]) -> set[type]:
    rows = set()
    for entry in catalog.entries():
        middle = {name: (low + high) / 2 for name, (low, high) in entry.family.ranges.items()}
        rows.add(type(entry.family.build(**middle).core))
    return classes - rows


def without_independent_value(classes: set[type]) -> set:
    known = {shape_of(build(1.0)) for build in LOBES.values()}
    return set().union(*(variants(kind) for kind in classes)) - known


def test_every_lobe_has_a_row_and_independent_values() -> None:
    zonal = final_classes(lobes, AbstractZonalLobe)
    facets = final_classes(microfacet, AbstractMicrofacetLobe)
    assert {kind.__name__ for kind in zonal} >= {"Lambert", "Phong", "BlinnPhong", "Schlick", "KuijkBlake", "Lyon"}
    assert {kind.__name__ for kind in facets} >= {"CookTorrance", "GGX"}
    assert not without_catalogue_row(zonal | facets)
    assert not without_independent_value(zonal - {lobes.Lambert})  # Lambert's albedo is its reflectance
    assert set(zonal_tables()) == set(LOBES)
    assert facets <= {type(facet_lobe(*key)(0.5)) for key in facet_tables()}


# --- wherever one looks ---

POINTWISE = {
    name: PointwiseAlbedo(catalog.entry(name).family)
    for name in VALIDATED
    if name not in ("lambert",) and "lyon" not in name and PointwiseAlbedo(catalog.entry(name).family).engine == "zonal"
}


@settings(phases=[Phase.explicit, Phase.generate])
@given(st.lists(st.tuples(st.floats(0, 1), st.floats(0, 1)), min_size=1, max_size=200))
def test_no_point_of_a_validated_family_exceeds_one(points: list[tuple[float, float]]) -> None:
    share, mu = np.array(points).T
    for name, evaluate in POINTWISE.items():
        ((low, high),) = evaluate.family.ranges.values()
        value, error = evaluate(np.clip(low * (high / low) ** share, low, high)[:, None], mu, np.zeros_like(mu))
        assert np.all(value - error <= 1 + 1e-9), name
        assert np.all(value >= 0), name
