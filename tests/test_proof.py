"""Certificates: what is proved is true, what is false is not proved, and both checkers tell them apart."""

from __future__ import annotations

import copy
import itertools
import json
import math
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shared import replaced

import brdfcheck
import verify_certificate
from brdfcheck.brdf import catalog
from brdfcheck.brdf.factors import Constant, Proportional, RationalFactor
from brdfcheck.messages import UsageError
from brdfcheck.proof import Certificate, NotProved, Rejected, certify, read, verify
from brdfcheck.proof.certificate import of_lobe
from brdfcheck.proof.cover import ABOVE, BELOW, Claim, LinearFactor, Piece, cover, peak, written
from brdfcheck.proof.lobes import Power, Profile, Quadratics, Rational, TruncatedPower
from brdfcheck.verdict import check_family

CONSERVING = (
    "lambert", "phong", "blinn-phong", "blinn-phong-fitted", "schlick-mirror", "schlick-half", "kuijk-blake-mirror",
    "kuijk-blake-half", "lyon-1-half", "lyon-2-half", "lyon-3-half", "lyon-1-mirror", "lyon-2-mirror", "lyon-3-mirror",
    "binomial-power-half", "binomial-power-mirror", "blinn-phong-6", "blinn-phong-linear", "phong-pdf",
)  # fmt: skip
VIOLATING = (
    "binomial-power-raw", "binomial-power-published", "binomial-power-unclamped", "blinn-phong-8", "blinn-phong-ndf",
    "schlick-phong-factor", "kuijk-blake-phong-factor",
)  # fmt: skip
PROFILES = [
    Power("half"), Rational("mirror"), Rational("half"), Quadratics("mirror"), Quadratics("half"), TruncatedPower("half", 16),
    TruncatedPower("mirror", 16), TruncatedPower("half", 2), TruncatedPower("half", 65536), TruncatedPower("mirror", 2**53),
]  # fmt: skip


def accepted(record: Any) -> bool:
    """What both checkers say of a certificate; they must agree."""
    try:
        verify(Certificate(record))
        inside = True
    except Rejected:
        inside = False
    try:
        verify_certificate.check(record)
        alone = True
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError):
        alone = False
    assert inside == alone, record
    return inside


@pytest.mark.parametrize("name", CONSERVING + VIOLATING)
def test_the_catalogue(name):
    certificate = certify(name)
    assert bool(certificate) == (name in CONSERVING)
    assert len(certificate.to_json()) < 10_000
    assert accepted(json.loads(certificate.to_json()))
    if name in CONSERVING[1:] and "cover" in certificate.record:
        # As closed forms in double precision have it, at the nodes and between them.
        build = catalog.entry(name).family.build
        nodes = [float(Fraction(node)) for node in certificate.record["cover"][0]["nodes"]]
        for n in [*nodes, *(0.5 * (a + b) for a, b in itertools.pairwise(nodes))]:
            brdf = build(n=n)
            assert float(brdf.scale() / brdf.lobe.exact_factor()(brdf.lobe.n)) <= 1 + 1e-14


def test_the_proposal_with_its_interval_of_violation():
    certificate = certify("binomial-power-published")
    point, pieces = certificate.record["point"], certificate.record["cover"]
    # 8 pi (n+6)/24.55 times the integral, by mpmath with 40 digits.
    truth = Fraction("1.001600521590062919876441350480932001")
    low, high = map(Fraction, point["albedo"])
    assert point["n"] == "17.85"
    assert low <= truth <= high <= low + Fraction(1, 10**29)
    assert [piece["albedo"] for piece in pieces] == [BELOW, ABOVE, BELOW]
    ends = [
        Fraction(pieces[0]["nodes"][-1]),
        *(Fraction(pieces[1]["nodes"][i]) for i in (0, -1)),
        Fraction(pieces[2]["nodes"][0]),
    ]
    assert ends[1] - ends[0] <= Fraction(2, 10**10)
    assert ends[3] - ends[2] <= Fraction(2, 10**10)
    assert (float(ends[1]), float(ends[2])) == pytest.approx((14.3030042605, 23.0560704010), abs=2e-10)


def test_albedos_are_those_of_the_package():
    lobes = {
        Power("half"): brdfcheck.BlinnPhong, Power("mirror"): brdfcheck.Phong,
        Rational("half"): lambda n: brdfcheck.Schlick(n, "half"), Rational("mirror"): brdfcheck.Schlick,
        Quadratics("half"): lambda n: brdfcheck.KuijkBlake(n, "half"), Quadratics("mirror"): brdfcheck.KuijkBlake,
        TruncatedPower("half", 16): brdfcheck.BinomialPower,
        TruncatedPower("mirror", 8): lambda n: brdfcheck.Lyon(n, 3, "mirror"),
        TruncatedPower("half", 6, False): lambda n: brdfcheck.BinomialPower(n, 6, clamped=False),
    }  # fmt: skip
    for profile, make in lobes.items():
        for n in ("0.25", "1", "3.5", "70"):
            known = 1 / float(make(float(n)).exact_factor()(float(n)))
            assert math.pi * float(_middle(profile.albedo(Fraction(n)))) == pytest.approx(known, rel=1e-12), (profile, n)
            assert math.pi * float(verify_certificate.raw(profile.record, Fraction(n)).mid) == pytest.approx(known, rel=1e-12)


def _middle(value: Any) -> Fraction:
    from brdfcheck.proof.intervals import lower, upper

    return (lower(value) + upper(value)) / 2


def test_unbounded_ranges():
    assert certify("blinn-phong-6", n=(0, math.inf)).statement == (
        "The directional albedo of (n + 6)/(8 pi) (N.H)^n is at most 1 for every n from 0 to inf at every angle of incidence."
    )
    for name in ("phong", "blinn-phong", "binomial-power-half", "lyon-3-mirror", "phong-pdf"):
        certificate = certify(name, n=(1, math.inf))
        assert certificate
        assert accepted(json.loads(certificate.to_json()))
    violation = certify("blinn-phong-8", n=(1, math.inf))
    assert not violation
    assert accepted(json.loads(violation.to_json()))
    with pytest.raises(NotProved, match="unbounded range"):
        certify("schlick-mirror", n=(1, math.inf))  # its tail holds more and more energy


@pytest.mark.parametrize("profile", PROFILES, ids=str)
def test_a_factor_too_large_by_1e_12_is_not_proved(profile):
    """The largest albedo is 1 + 1e-12 then; with 1e-9 to spare there is a proof."""
    low, high = Fraction(1), Fraction(1000)
    wide = Claim(profile, LinearFactor(Fraction(7), Fraction(1)))  # far above 1 everywhere
    n = peak(wide, [Piece(ABOVE, (*(Fraction(2) ** i for i in range(10)), Fraction(1000)))])
    worst = _middle(wide.albedo(n))
    for spare, holds in ((Fraction(1, 10**12), False), (-Fraction(1, 10**4), True)):
        factor = LinearFactor(Fraction(7), worst / (1 + spare))
        try:
            pieces = cover(Claim(profile, factor), low, high)
        except NotProved:
            assert not holds
            continue
        assert all(piece.side == BELOW for piece in pieces) == holds
        piece = Piece(BELOW, (low, *(Fraction(2) ** i for i in range(1, 10)), high))
        assert not accepted(json.loads(of_lobe(Claim(profile, factor), "n", (low, high), [piece]).to_json())) or holds


@pytest.mark.parametrize(
    "factor",
    [
        LinearFactor(Fraction(2), 2 / (1 + Fraction(1, 10**12)), 1),
        LinearFactor(Fraction(2) + Fraction(1, 10**12), Fraction(2), 1),
    ],
)
def test_phong_with_a_factor_too_large_by_1e_12(factor):
    pieces = cover(Claim(Power("mirror"), factor), Fraction(0), Fraction(100))
    assert {piece.side for piece in pieces} == {ABOVE}


def test_where_the_albedo_is_exactly_1():
    """In the mirror form (1 - n v/k)^k is the cosine power at n = k, so that Phong's factor makes the albedo 1 there."""
    certificate = certify(lambda n: brdfcheck.Normalized(brdfcheck.Lyon(n, 3, "mirror"), brdfcheck.PhongExact()), n=(1, 1000))
    assert "at most 1 for every n from 8 to 1000" in certificate.statement
    assert accepted(json.loads(certificate.to_json()))


def test_exact_factors():
    assert certify(brdfcheck.Normalized(brdfcheck.BlinnPhong(3), brdfcheck.BlinnPhongExact()))
    lobe = brdfcheck.Lyon(5, 2)
    assert certify(brdfcheck.Normalized(lobe, lobe.exact_factor()), n=(0, math.inf))
    with pytest.raises(UsageError, match="BlinnPhongExact is no factor that certify knows for this lobe"):
        certify(brdfcheck.Normalized(lobe, brdfcheck.BlinnPhongExact()), seconds=0)


def test_single_brdfs():
    assert certify(brdfcheck.Lambert(0.8)).record["range"] == {"reflectance": ["0.8", "0.8"]}
    assert not certify(brdfcheck.Lambert, reflectance=(0, 1.25))
    for lobe in (brdfcheck.Lambert(0.8), brdfcheck.Lambert([0.2, 0.3, 0.4])):
        assert accepted(json.loads(certify(lobe).to_json()))
    assert certify(brdfcheck.Normalized(brdfcheck.BlinnPhong(8.764), brdfcheck.Factor(6, 8 * np.pi)))
    assert not certify(brdfcheck.Lambert([0.2, 0.3, 1.4]))


def test_lobes_that_rise_with_their_angle_are_refused():
    def rising(n):
        return brdfcheck.Normalized(brdfcheck.BinomialPower(n, clamped=False), Constant(1e-30))

    with pytest.raises(NotProved, match="the theorem on normal incidence does not apply"):
        certify(rising, n=(1, 17))
    assert certify(rising, n=(1, 16))
    claim = Claim(TruncatedPower("half", 16, False), LinearFactor(Fraction(1, 10**30), constant=True))
    piece = Piece(BELOW, (Fraction(1), Fraction(17)))
    assert not accepted(json.loads(of_lobe(claim, "n", (Fraction(1), Fraction(17)), [piece]).to_json()))
    assert "every angle" not in certify("binomial-power-unclamped", n=(17, 1000)).statement


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda n: brdfcheck.Normalized(brdfcheck.BlinnPhong(2 * n), brdfcheck.Factor(6, 26)),
            "does not go into BlinnPhong as it",
        ),
        (lambda n: brdfcheck.Normalized(brdfcheck.BlinnPhong(n), brdfcheck.Factor(n, 26)), "something beside n depends on n"),
        (lambda n: brdfcheck.BlinnPhong(n if n < 3 else 3), "cannot be built from a symbol"),
        (lambda n: brdfcheck.Normalized(brdfcheck.BlinnPhong(n), RationalFactor([1, 2], [3])), "RationalFactor is no factor"),
        (lambda n: brdfcheck.Normalized(brdfcheck.BlinnPhong(n), brdfcheck.Factor(-60, -25)), "B must be > 0"),
    ],
)
def test_what_cannot_be_read_is_refused(make, message):
    with pytest.raises(UsageError, match=message):
        certify(make, seconds=0, n=(1, 50))


def test_constants_are_what_is_written():
    def lobe(n):
        return brdfcheck.Normalized(brdfcheck.BlinnPhong(n), brdfcheck.Factor(6, 8 * np.pi))

    assert certify(lobe, n=(1, 2)).record["factor"] == {"A": "6", "B": "8", "pi": 1}
    assert certify("binomial-power-half").record["factor"] == {"A": "7.2427", "B": "26.1702", "pi": 0}
    assert certify("blinn-phong", n=(0.1, 0.3)).record["range"] == {"n": ["0.1", "0.3"]}
    per_n = brdfcheck.Normalized(brdfcheck.Phong(4), Proportional(7.5))
    assert certify(per_n, n=(1, 9)).record["factor"] == {"A": "0", "B": "7.5", "pi": 0}


def leaves(value: Any, path: tuple = ()) -> Iterator[tuple[tuple, Any]]:
    """All numbers, words and truth values of a certificate but its versions, with their places."""
    if isinstance(value, dict | list):
        for key, part in value.items() if isinstance(value, dict) else enumerate(value):
            if key != "versions":
                yield from leaves(part, (*path, key))
    else:
        yield path, value


def mutated(value: Any) -> list[Any]:
    """Other values in place of one: some are odd, some would fill the memory."""
    odd = [None, "1e3", "1e999999999", "NaN", "\u0663", "9" * 5000, {}, [["1", "2"]]]
    if isinstance(value, bool):
        return [*odd, not value]
    if isinstance(value, int):
        return [*odd, value + 1, value - 1, 2 * value + 3, 10**30]
    try:
        number = Fraction(value)
    except ValueError:
        return [*odd, f"{value}.", "", value.replace("at most", "at least").replace("1", "2")]
    return (
        odd
        + [written(number + shift) for shift in (1, -1, Fraction(1, 10**3), -Fraction(1, 10**3), Fraction(1, 10**9))]
        + [written(-number - 1)]
    )


@pytest.mark.parametrize(
    "name",
    [
        pytest.param("lyon-1-half", marks=pytest.mark.slow),
        "phong",
        "blinn-phong",
        "schlick-mirror",
        "kuijk-blake-half",
        "blinn-phong-6",
        pytest.param("binomial-power-published", marks=pytest.mark.slow),
    ],
)
def test_every_single_change_that_matters_is_rejected(name):
    """Only other boxes may be as good a proof; a word, a constant, an end of the range or the point may not change."""
    record = json.loads(certify(name, n=(1, 40)).to_json())
    for path, value in leaves(record):
        inner = path[0] == "cover" and path[2] == "nodes" and 0 < path[3] < len(record["cover"][path[1]]["nodes"]) - 1
        if inner and path[3] > 2:
            continue
        for other in mutated(value):
            if other == value:
                continue
            if accepted(replaced(record, path, other)):
                free = inner or path[-1] == "onwards" or (path[0] == "range" and name in VIOLATING)  # not in what is stated
                assert free, (path, value, other)
    for path in {place[:depth] for place, _ in leaves(record) for depth in range(1, len(place) + 1)}:
        changed = copy.deepcopy(record)
        place = changed
        for key in path[:-1]:
            place = place[key]
        if isinstance(place, dict):  # a name less; lists may do with less
            del place[path[-1]]
            assert not accepted(changed), path
    for index in range(len(record.get("cover", []))):
        shorter = copy.deepcopy(record)
        shorter["cover"][index]["nodes"] = shorter["cover"][index]["nodes"][:-1]
        assert not accepted(shorter) or record["cover"][index]["onwards"]


def test_false_statements_in_good_order_are_rejected():
    """Statements made by the package's own writer from numbers that do not hold."""
    profile, factor = TruncatedPower("half", 16), LinearFactor(Fraction("7.2427"), Fraction("26.1702"))
    low, high = Fraction(1), Fraction(1000)
    (piece,) = cover(Claim(profile, factor), low, high)

    def good(
        profile: Profile, factor: LinearFactor, nodes: Any = piece.nodes, ends: Any = (low, high), onwards: Any = True
    ) -> bool:
        certificate = of_lobe(Claim(profile, factor), "n", ends, [Piece(BELOW, tuple(nodes), onwards)])
        return accepted(json.loads(certificate.to_json()))

    assert good(profile, factor)
    assert not good(profile, LinearFactor(factor.A, factor.B * Fraction(99999, 100000)))
    assert not good(profile, LinearFactor(factor.A + Fraction(1, 10**4), factor.B))
    assert not good(TruncatedPower("half", 18), factor)
    assert good(TruncatedPower("mirror", 16), factor)  # which reflects a quarter of it
    assert not good(TruncatedPower("mirror", 16), LinearFactor(factor.A, factor.B / 4))
    assert not good(profile, factor, ends=(Fraction(1, 2), high))
    assert not good(profile, factor, onwards=False)
    assert not good(profile, factor, nodes=piece.nodes[::2])
    assert not good(profile, factor, nodes=piece.nodes[:2])
    claim = Claim(profile, LinearFactor(Fraction(6), Fraction("24.55")))
    false = of_lobe(claim, "n", (low, high), [Piece(ABOVE, (Fraction(14), Fraction(15)))], Fraction("17.85"))
    assert not accepted(json.loads(false.to_json()))
    below = of_lobe(claim, "n", (low, high), [], Fraction(14))
    assert not accepted(json.loads(below.to_json()))


def test_the_checker_stands_alone(tmp_path):
    """Standard library only, under 150 lines, seconds, and a false certificate is one line on stderr."""
    path = Path(verify_certificate.__file__)
    assert len(path.read_text().splitlines()) < 150
    (tmp_path / "good.json").write_text(certify("binomial-power-published").to_json())
    (tmp_path / "bad.json").write_text(certify("binomial-power-half").to_json().replace("26.1702", "26.1699"))
    (tmp_path / "facets.json").write_text(certify("ggx").to_json())

    def run(name: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-I", "-S", str(path), str(tmp_path / name)],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )

    good, bad, facets = run("good.json"), run("bad.json"), run("facets.json")
    assert (good.returncode, good.stderr) == (0, "")
    assert good.stdout.startswith("proved: VIOLATES: The directional albedo of (n + 6)/24.55 max(0,")
    assert bad.returncode == 1
    assert len(bad.stderr.splitlines()) == 1
    assert bad.stderr.startswith("rejected: ")
    allowed = "only constant, kuijk-blake, power, schlick, truncated-power are checked here: try brdfcheck certify --verify"
    assert (facets.returncode, facets.stderr) == (1, f"rejected: ValueError: {allowed}\n")


def test_what_is_no_certificate_is_rejected():
    for text, message in (
        ("{", "not JSON"), ("[" * 100_000, "not JSON"), ("[]", "not a certificate"),
        ('{"schema": "other"}', "not a certificate"),
        ('{"schema": "brdfcheck-certificate", "schema_version": 2}', "schema version must be 1; got 2"),
        ('{"schema": "other", "schema": "brdfcheck-certificate"}', "a name is there twice"),
    ):  # fmt: skip
        with pytest.raises(Rejected, match=message):
            read(text)
    huge = json.loads(certify("phong").to_json().replace('"A": "2"', '"A": "2e999999999"'))
    with pytest.raises(Rejected, match="without exponents; got '2e999999999'"):
        verify(Certificate(huge))
    with pytest.raises(Rejected, match="damaged: KeyError"):
        verify(Certificate({"schema": "brdfcheck-certificate", "schema_version": 1}))


FACETS = ("cook-torrance", "beckmann-smith", "beckmann-smith-correlated", "ggx")
POINTS = {
    "cook-torrance-published": (lambda: brdfcheck.CookTorrance(0.05, convention="published"), 1.0),
    "cook-torrance-no-masking": (lambda: brdfcheck.CookTorrance(1.0, masking="none"), 0.02),
    "phong-classical": (lambda: brdfcheck.PerCosine(brdfcheck.Normalized(brdfcheck.Phong(2), brdfcheck.PhongExact())), 0.5),
}


@pytest.mark.parametrize("name", FACETS)
def test_facets_conserve_by_their_premises(name):
    certificate = certify(name)
    assert certificate
    assert certificate.record["theorems"] == ["masked projected areas"]
    record = json.loads(certificate.to_json())
    verify(Certificate(record))
    for key, wrong in (
        ("convention", "published"), ("masking", "none"), ("fresnel", "2"), ("distribution", "Phong"), ("weights", ["1.1"]),
        ("weights", ["-1"]), ("weights", ["0.5", "0.6"]),
    ):  # fmt: skip
        with pytest.raises(Rejected):
            verify(Certificate(replaced(record, ("lobe", key), wrong)))
    with pytest.raises(Rejected):
        verify(Certificate(replaced(record, ("range",), {"f0": ["0", "1.01"]})))
    with pytest.raises(ValueError, match="only constant, kuijk-blake, power, schlick, truncated-power are checked here"):
        verify_certificate.check(record)


def test_facets_over_several_parameters():
    certificate = certify(brdfcheck.GGX, alpha=(0.01, math.inf), f0=(0, 1))
    assert "every alpha from 0.01 to inf and every f0 from 0 to 1" in certificate.statement
    assert certify(brdfcheck.CookTorrance([0.2, 0.4], weights=[0.3, 0.7], f0=[0.9, 0.5, 0.2]))
    for facets, message in (
        (brdfcheck.CookTorrance([0.2, 0.4], weights=[0.3, 0.8]), "add up to more than 1"),
        (brdfcheck.GGX(0.4, masking="none"), "there is no masking"),
        (brdfcheck.CookTorrance(0.3, convention="published", masking="smith-separable"), "the convention is not"),
    ):
        with pytest.raises(NotProved, match=message):
            certify(facets)


def test_a_point_above_1_is_one_of_a_brdf_without_a_range():
    make, cosine = POINTS["phong-classical"]
    assert certify(make()).record["point"]["cos_theta"] == f"{cosine:g}"
    with pytest.raises(NotProved, match="n = 2, is out of range"):
        certify(brdfcheck.PerCosine(brdfcheck.Normalized(brdfcheck.Phong(3), brdfcheck.PhongExact())))


@pytest.mark.parametrize("name", POINTS)
def test_points_above_1_of_published_claims(name):
    certificate = certify(name)
    assert not certificate
    verify(Certificate(json.loads(certificate.to_json())))
    make, cosine = POINTS[name]
    least = float(certificate.record["point"]["albedo at least"])
    assert certificate.record["point"]["cos_theta"] == f"{cosine:g}"
    assert 1 < least <= float(brdfcheck.albedo(make(), cosine).value) + 1e-12
    changed = json.loads(certificate.to_json().replace(certificate.record["point"]["albedo at least"], str(least + 1)))
    with pytest.raises(Rejected):
        verify(Certificate(changed))


TRANSMITTING = ("lambert-transmission", "thin-sheet", "dielectric", "rough-dielectric-beckmann", "rough-dielectric-ggx")


def test_every_entry_of_the_catalogue_has_an_answer():
    assert {entry.name for entry in catalog.entries()} == {*CONSERVING, *VIOLATING, *FACETS, *POINTS, *TRANSMITTING}


@pytest.mark.parametrize("name", TRANSMITTING)
def test_what_transmits_conserves_by_theorem(name):
    certificate = certify(name)
    assert certificate
    assert certificate.statement.startswith("The energy R + T of a ")
    record = json.loads(certificate.to_json())
    verify(Certificate(record))
    for path, value in leaves(record):
        for other in [*mutated(value), value.replace("albedo", "through")] if isinstance(value, str) else mutated(value):
            if other != value:
                with pytest.raises(Rejected):
                    verify(Certificate(replaced(record, path, other)))
    with pytest.raises(ValueError, match="are checked here: try brdfcheck certify --verify"):
        verify_certificate.check(record)


def test_a_check_of_what_transmits_rests_on_the_proof():
    """Its energy is 1 within the error bar: whatever the tolerance, it conserves."""
    report = brdfcheck.check("lambert-transmission", tolerance=0.0, effort="quick")
    assert (report.verdict.name, report.basis) == ("CONSERVES", "proof")


def test_sheets_of_a_user():
    sheet = brdfcheck.LambertTransmission
    assert certify(sheet(0.4, 0.6))
    assert certify(lambda a: sheet(0.3 * a, 1 - 0.3 * a), a=(0, 1))
    refuted = certify(lambda a: sheet(a, 0.3), a=(0, 0.8))
    assert refuted.record["point"] == {"a": "0.8", "albedo": ["1.1", "1.1"]}
    verify(Certificate(json.loads(refuted.to_json())))
    cases: list[tuple[Any, Any, str | None]] = [
        (lambda a: sheet(a * a, 0.3), {"a": (0, 0.8)}, "the reflectance holds a power of a parameter"),
        (lambda a: sheet(a - 0.5, 0.3), {"a": (0.6, 0.8)}, None),
        (lambda a: sheet([a, 0.5], 0.3), {"a": (0, 0.5)}, "the reflectance must be one number"),
        (lambda eta: brdfcheck.RoughDielectric(0.3, 2 / eta), {"eta": (1.2, 1.5)}, "eta is no polynomial in its parameters"),
    ]
    for make, ranges, message in cases:
        if message is None:
            assert certify(make, seconds=0, **ranges)
        else:
            with pytest.raises(UsageError, match=message):
                certify(make, seconds=0, **ranges)


def test_a_check_rests_on_a_proof_where_there_is_one():
    """Whatever the tolerance: an albedo of 1 within its error bar is decided."""
    exact = brdfcheck.check("phong", tolerance=0.0, effort="quick")
    assert (exact.verdict.name, exact.basis, exact.tolerance) == ("CONSERVES", "proof", 0.0)
    assert exact.albedo + exact.error > 1
    assert "proof: at most 1 in exact arithmetic" in str(exact)
    for name in ("binomial-power-published", "binomial-power-unclamped"):
        published = brdfcheck.check(name, effort="quick")
        assert (published.verdict.name, published.basis) == ("VIOLATES", "proof")
        assert "proof: above 1 at one point in exact arithmetic" in str(published)

    def pushed(n):
        return brdfcheck.Normalized(brdfcheck.Phong(n), brdfcheck.Factor(2 + 1e-11, 2 * np.pi))

    # Above 1 by 5e-12: within the tolerance, so that it conserves by that, but not by a proof.
    slack = brdfcheck.check(pushed, n=(1, 9), effort="quick")
    assert (slack.verdict.name, slack.basis) == ("CONSERVES", "theorem")


def test_a_proof_says_nothing_about_a_line_below_1():
    family = replace(catalog.entry("blinn-phong-fitted").family, ranges={"n": (2.0, 2.0)})
    at = check_family(family)
    assert (at.basis, at.albedo < 0.999) == ("proof", True)
    below = check_family(family, tolerance=at.albedo - 1)
    assert (below.verdict.name, below.basis == "proof") == ("UNDECIDED", False)


def test_a_check_wastes_little_time_on_proofs():
    """Where a proof needs many boxes, a check does without."""
    claim = Claim(TruncatedPower("half", 16), LinearFactor(Fraction("7.24267604"), Fraction("26.17000504")))
    with pytest.raises(NotProved, match="no proof found"):
        cover(claim, Fraction(1), Fraction(1000), 5)
