"""From a target to a verdict: what is accepted, what is judged, what is found."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from selection import few

import brdfcheck
from brdfcheck import cli
from brdfcheck.brdf.factors import BlinnPhongExact, Factor, Normalized, PhongExact
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, Lambert, Lyon, Phong, Schlick
from brdfcheck.brdf.microfacet import GGX, CookTorrance
from brdfcheck.brdf.subject import as_family
from brdfcheck.verdict import TOLERANCE, Report, Verdict, check, check_family, judge
from brdfcheck.verdict.checks import CHECKS, Evidence
from brdfcheck.verdict.parts import Check

CONSERVES, VIOLATES, UNDECIDED = Verdict.CONSERVES, Verdict.VIOLATES, Verdict.UNDECIDED


@pytest.mark.parametrize(
    ("value", "error", "expected", "known"),
    [
        (0.5, 0.1, CONSERVES, {}),
        (1.0, 0.0, CONSERVES, {}),
        (1 + 5e-10, 4e-10, CONSERVES, {}),
        (1.0, 2e-9, UNDECIDED, {}),
        (0.999, 0.01, UNDECIDED, {}),
        (1.001, 0.01, UNDECIDED, {}),
        (1 + 3e-9, 1e-9, VIOLATES, {}),
        (1 + 3e-9, 2.5e-9, UNDECIDED, {}),
        (1.001, 1e-12, VIOLATES, {}),
        (4.0, 1.0, VIOLATES, {}),
        (4.0, np.inf, UNDECIDED, {}),
        (0.5, np.inf, UNDECIDED, {}),
        (np.inf, 0.0, VIOLATES, {}),
        (np.inf, np.inf, VIOLATES, {}),
        (np.inf, np.nan, VIOLATES, {}),
        (np.nan, 0.0, UNDECIDED, {}),
        (np.nan, np.nan, UNDECIDED, {}),
        (0.5, np.nan, UNDECIDED, {}),
        (2.0, np.nan, UNDECIDED, {}),
        (-1.0, 0.0, CONSERVES, {}),
        (0.5, 0.1, UNDECIDED, {"settled": False}),
        (1.001, 1e-12, VIOLATES, {"settled": False}),
        (1.1, 0.3, VIOLATES, {"least": 1.05}),  # some place is known to be above, another one may be higher
        (1.1, 0.3, UNDECIDED, {"least": 0.9}),
        (0.5, 0.1, CONSERVES, {"least": 0.45}),
        (np.inf, np.inf, VIOLATES, {"least": np.inf}),
        (0.9, np.inf, UNDECIDED, {"least": 0.9}),
        (1.005, 1e-9, CONSERVES, {"tolerance": 0.01}),
        (1.005, 1e-9, VIOLATES, {"tolerance": 0.001}),
        (1.005, 1e-9, UNDECIDED, {"tolerance": 0.005}),
        (1.0, 1e-15, UNDECIDED, {"tolerance": 0.0}),
        (1 + TOLERANCE, 1e-15, UNDECIDED, {}),
    ],
)
def test_judge(value: float, error: float, expected: Verdict, known: dict[str, Any]) -> None:
    assert judge(value, error, **known) is expected


# --- targets ---


def test_every_kind_of_target() -> None:
    phong = {"n": (1.0, 10.0)}

    def factory(n):
        return Normalized(Phong(n), PhongExact())

    targets = [
        ("phong", phong),
        (Family("mine", factory, phong), {}),
        (factory, phong),
        (Normalized(Phong(3.0), PhongExact()), {}),
    ]
    for target, ranges in targets:
        report = check(target, **ranges)
        assert report.verdict is CONSERVES
        assert report.albedo == pytest.approx(1, abs=1e-12)
        assert report.cos_theta == 1
        assert report.engine == "zonal"
        assert report.passed
    raw = check(Phong, n=(1, 1000))
    assert raw.verdict is VIOLATES
    assert (raw.name, raw.albedo, raw.parameters) == ("Phong", pytest.approx(2 * np.pi / 3), {"n": 1.0})
    assert raw.above == ((1.0, pytest.approx(2 * np.pi - 2, abs=1e-6)),)
    assert not raw.passed


def test_the_parameters_of_one_brdf_can_run_over_a_range() -> None:
    exact = check(Normalized(Phong(3.0), PhongExact()), n=(1.0, 10.0))
    assert exact.verdict is CONSERVES
    assert exact.albedo == pytest.approx(1, abs=1e-12)
    raw = check(Phong(3.0), n=(2.0, 10.0))
    assert (raw.albedo, raw.parameters) == (pytest.approx(np.pi / 2), {"n": 2.0})


def test_usual_ranges_of_a_class() -> None:
    for target, expected in (
        (BlinnPhong, {"n": (1.0, 1000.0)}),
        (BinomialPower, {"n": (1.0, 1000.0)}),
        (GGX, {"alpha": (0.05, 1.0)}),
        (CookTorrance, {"m": (0.05, 1.0)}),
    ):
        family = as_family(target, {}, None)
        assert dict(family.ranges) == expected
        assert family.cos_theta == (0.0, 1.0)


def test_ranges_of_a_family_can_be_narrowed() -> None:
    family = as_family("phong", {"n": (2.0, 3.0)}, (0.5, 0.6))
    assert (family.name, family.ranges, family.cos_theta) == ("phong", {"n": (2.0, 3.0)}, (0.5, 0.6))
    kept = as_family("phong-classical", {}, None)
    assert kept.cos_theta[0] == pytest.approx(np.cos(np.radians(89)))
    report = check("binomial-power-published", n=(30.0, 1000.0), cos_theta=(0.5, 1.0))
    assert report.verdict is CONSERVES
    assert report.ranges == {"n": (30.0, 1000.0)}


@pytest.mark.parametrize(
    ("target", "options", "error", "message"),
    [
        ("phong", {"n": (1.0, np.nan)}, ValueError, "must be finite"),
        ("phong", {"n": 3.0}, ValueError, "must be two numbers"),
        ("phong", {"cos_theta": (-0.1, 1.0)}, ValueError, "cos_theta must run within 0:1"),
        ("phong", {"cos_theta": (0.0, 1.1)}, ValueError, "cos_theta must run within 0:1"),
        ("phong", {"cos_theta": (0.9, 0.1)}, ValueError, "cos_theta is empty"),
        ("phong", {"tolerance": -1e-9}, ValueError, "tolerance"),
        ("phong", {"tolerance": 1.0}, ValueError, "tolerance"),
        ("phong", {"tolerance": np.nan}, ValueError, "tolerance"),
        ("phong", {"tolerance": "1e-9"}, ValueError, "tolerance"),
        ("phong", {"rtol": 2.0}, ValueError, "rtol"),
        ("phong", {"effort": "best"}, ValueError, "effort must be one of quick, normal, thorough; got 'best'"),
        ("phong", {"effort": None}, ValueError, "effort must be one of"),
        (Phong, {"n": (-1.0, 2.0)}, ValueError, "n must be finite and >= 0"),
        (3.0, {}, TypeError, "must be callable"),
        (None, {}, TypeError, "got NoneType"),
    ],
)
def test_bad_requests_are_refused(target, options, error, message) -> None:
    with pytest.raises(error, match=message):
        check(target, **options)


# --- verdicts ---


@pytest.mark.parametrize(
    "build",
    [
        lambda n: Normalized(Phong(n), Factor(2, 2 * np.pi / 1.01)),
        lambda n: Normalized(BinomialPower(n), Factor(7.2427, 26.1702 / 1.01)),
        lambda n: Normalized(Lyon(n, 2), Factor(6.0133, 22.9294 / 1.01)),
        lambda n: Normalized(Schlick(n), Factor(15.531, 34.623 / 1.01)),
    ],
)
def test_a_factor_one_percent_too_large_is_caught(build) -> None:
    report = check(build, n=(1, 1000), intervals=False)
    assert report.verdict is VIOLATES
    assert report.albedo == pytest.approx(1.01, abs=1e-4)
    assert report.above is None


def test_no_false_verdict_within_a_millionth_of_the_line() -> None:
    # Exact factors times 1 + d: the largest albedo is 1 + d whatever the range.
    random = np.random.default_rng(5)
    seen = set()
    for case in range(24):
        excess = float(random.choice([-1, 1]) * 10 ** random.uniform(-12, -6))
        low = float(10 ** random.uniform(-1, 2))
        if case % 2:
            exact = float(BlinnPhongExact()(jnp.asarray(low)))
            single = Normalized(BlinnPhong(low), Factor(exact * (1 + excess) - low, 1.0))
            family = Family("blinn-phong", lambda single=single: single)
        else:
            family = Family(
                "phong",
                lambda n, d=excess: Normalized(Phong(n), Factor(2, 2 * np.pi / (1 + d))),
                {"n": (low, 50 * low)},
            )
        report = check_family(family, intervals=False)
        if excess > 1.001e-9:
            assert report.verdict is VIOLATES, (case, excess, report)
        elif excess < 0.999e-9:
            assert report.verdict is CONSERVES, (case, excess, report)
        seen.add(report.verdict)
        assert abs(report.albedo - 1 - excess) <= report.error + 2e-15
    assert seen >= {CONSERVES, VIOLATES}


def test_on_the_line_nothing_is_decided() -> None:
    report = check(Normalized(Phong(10.0), Factor(2, 2 * np.pi / (1 + TOLERANCE))))
    assert report.verdict is UNDECIDED
    assert not report.passed
    assert check(Normalized(Phong(10.0), Factor(2, 2 * np.pi / (1 + TOLERANCE))), tolerance=1e-6).verdict is CONSERVES


def test_tolerance_is_in_the_report_and_in_the_intervals() -> None:
    loose = check("binomial-power-published", tolerance=0.002)
    assert (loose.verdict, loose.tolerance, loose.above) == (CONSERVES, 0.002, ())
    middle = check("binomial-power-published", tolerance=0.001)
    strict = check("binomial-power-published")
    assert middle.verdict is strict.verdict is VIOLATES
    assert middle.above is not None
    assert strict.above is not None
    assert strict.above[0][0] < middle.above[0][0] < 17.85 < middle.above[0][1] < strict.above[0][1]
    assert middle.albedo == strict.albedo


@pytest.mark.parametrize("function", few([False, True], (False,)))
def test_an_albedo_that_is_not_a_number_somewhere_never_conserves(function: bool) -> None:
    """Not at a corner of the range, nor in its middle."""

    def factory(n):
        lobe = Normalized(Phong(jnp.where((n > 300) & (n < 500), jnp.nan, n)), Factor(2, 2 * np.pi / 0.9))
        return (lambda wi, wo: lobe(wi, wo)) if function else lobe

    report = check(factory, n=(1.0, 1000.0))
    assert report.verdict is UNDECIDED
    assert not report


@pytest.mark.parametrize("cosines", few([(1, 1), (0.5, 0.5), (0, 0), (0, 1)], ((0.5, 0.5), (0, 1))))
@pytest.mark.parametrize("function", [False, True])
def test_single_angles_and_whole_numbers(cosines: tuple[float, float], function: bool) -> None:
    lobe = Normalized(Phong(3.0), PhongExact())
    report = check((lambda wi, wo: lobe(wi, wo)) if function else lobe, cos_theta=cosines, effort="quick")
    angle = max(cosines[1], 1e-9)
    expected = float(brdfcheck.albedo(lobe, angle).value)
    assert report.verdict is CONSERVES
    assert report.albedo == pytest.approx(expected, abs=1e-7)
    assert report.cos_theta == pytest.approx(cosines[1], abs=1e-6)
    held = check(Phong, n=(3, 3), cos_theta=cosines, effort="quick")
    assert held.albedo == pytest.approx(expected * 2 * np.pi / 5, abs=1e-7)


def test_a_report_in_words() -> None:
    report = check("binomial-power-published")
    first, second = str(report).splitlines()
    assert first.startswith("binomial-power-published: VIOLATES: albedo 1.0016005217 +- ")
    assert " at n=17.8512 angle=0 deg; exceeds 1 for n=14.303..23.0561 (tolerance 1e-9)" in first
    assert re.search("^  proof: above 1 at one point in exact arithmetic .* points for the largest", second)
    searched = dataclasses.replace(report, basis="search")
    assert re.search(r"^  search.*points.*, could miss .* % of n", str(searched).splitlines()[1])
    words = dataclasses.replace(searched, findings=("not\nreciprocal",), notes=("one", "two"), settled=False)
    lines = str(words).splitlines()
    assert lines[0].endswith("; not reciprocal")
    assert ", not settled, " in lines[1]
    assert lines[2:] == ["  note: one", "  note: two"]
    assert str(report).isascii()
    broken = check(raises)
    words = r"raises: UNDECIDED: albedo unknown \(tolerance 1e-9\); raises raised RuntimeError: boom \(.*test_verdict.py:\d+\)"
    assert re.fullmatch(words, str(broken).splitlines()[0])
    assert str(broken).splitlines()[1] == "  nothing could be evaluated"


def test_the_channel_that_decides_is_named() -> None:
    report = check(Lambert(jnp.asarray([0.1, 0.9, 1.2])))
    assert (report.channel, report.channels) == (2, 3)
    assert "channel=blue" in str(report)


def test_assert_conserves() -> None:
    report = brdfcheck.assert_conserves("phong", n=(1, 10), effort="quick")
    assert isinstance(report, Report)
    assert report.effort == "quick"
    with pytest.raises(AssertionError, match=r"binomial-power-published: VIOLATES: albedo 1\.00160.* at n=17\.851"):
        brdfcheck.assert_conserves("binomial-power-published")
    with pytest.raises(AssertionError, match=r"raised RuntimeError: boom"):
        brdfcheck.assert_conserves(raises)
    with pytest.raises(AssertionError, match=r"not reciprocal.*CONSERVES"):
        brdfcheck.assert_conserves(lambda wi, wo: 0.2 * wi[..., 2] + 0 * wo[..., 2], effort="quick")
    with pytest.raises(ValueError, match="tolerance"):
        brdfcheck.assert_conserves("phong", tolerance=2.0)
    with pytest.raises(KeyError):
        brdfcheck.assert_conserves("fong")


# --- functions of users ---


def raises(wi, wo):
    raise RuntimeError("boom")


# --- one door ---


def test_python_and_the_command_line_take_the_same_things(tmp_path, capsys) -> None:
    file = tmp_path / "mine.py"
    file.write_text(
        "def glossy(wi, wo, n=5, ks=1):\n    return 0.05 * ks * n + 0 * wi[..., 2]\n\n\n"
        "def needs(wi, wo, n):\n    return 0 * wi[..., 2]\n\n\n"
        "def picky(n):\n    if n > 5:\n        raise RuntimeError('too large')\n    return glossy\n"
    )
    module: dict[str, Any] = {}
    exec(file.read_text(), module)
    spec, one_angle = f"{file}:glossy", {"effort": "quick", "cos_theta": (0.5, 0.5)}
    for target in (module["glossy"], brdfcheck.load(spec, n=(1, 4))):
        report = check(target, n=(1, 3), **one_angle)
        assert report.albedo == pytest.approx(0.15 * np.pi, abs=1e-9)
        assert report.ranges == {"n": (1, 3)}
    held = check(spec, n=(1, 3), ks=(2, 2), **one_angle)
    assert held.parameters == {"n": pytest.approx(3), "ks": 2}
    assert held.ranges == {"n": (1, 3), "ks": (2, 2)}
    for name, ranges, options, words in (
        ("needs", {}, [], "the parameter n must be given a range"),
        ("glossy", {"m": (0, 1)}, ["--over", "m=0:1"], "has no parameter 'm'; its parameters: n, ks"),
        ("absent", {}, [], "has no object 'absent'"),
    ):
        with pytest.raises(ValueError, match=words) as python:
            check(f"{file}:{name}", **ranges)
        assert cli.run(["check", f"{file}:{name}", *options]) == 4
        assert str(python.value) in capsys.readouterr().err
        if name in module:
            with pytest.raises(ValueError, match=words) as same:
                check(module[name], **ranges)
            assert str(same.value).removeprefix(name) == str(python.value).removeprefix(f"{file}:{name}")
    broken = check(f"{file}:picky", n=(1, 10), effort="quick")
    (found,) = broken.findings
    assert re.fullmatch(r"picky\(n=10\) raised RuntimeError: too large \(.*:\d+\)", found)
    assert check(module["picky"], n=(1, 10), effort="quick").findings[0].startswith(found.rpartition(" (")[0])
    with pytest.raises(ValueError, match=r"the range of n must be two numbers \(LO, HI\); got 3"):
        check(module["glossy"], n=3)


# --- what a report says ---


@pytest.mark.slow
def test_the_end_of_an_interval_of_a_brdf_with_a_jump() -> None:
    def cap(a):
        return lambda wi, wo: 1.2 / np.pi * (wo[..., 2] > a) + 0 * wi[..., 2]

    report = check(cap, a=(0, 1), effort="quick")
    assert report.above == ((0.0, pytest.approx(np.sqrt(1 / 6), abs=1e-4)),)  # the albedo is 1.2 (1 - a^2)


def test_parameters_may_have_the_names_of_angles() -> None:
    def family(angle, cell):
        return lambda wi, wo: (0.1 + 0.1 * angle + 0.1 * cell) / np.pi + 0 * wi[..., 2]

    report = check(family, angle=(0, 1), cell=(0, 1), effort="quick")
    assert set(report.width) == {"parameter angle", "parameter cell", "angle", "view", "cell"}
    assert re.search(
        r"% of the parameter angle, .* % of the parameter cell, .* deg of the angle, .* deg of the view or .* % of all",
        str(report),
    )


def test_what_decided_is_told_where_the_bar_contains_1() -> None:
    report = Report("f", VIOLATES, {}, albedo=1.001, error=0.0036, least=1.00087, cos_theta=1.0)
    assert "albedo 1.0010 +- 0.0036, at least 1.00087" in str(report)
    for clear in (dataclasses.replace(report, error=1e-5), dataclasses.replace(report, verdict=UNDECIDED, least=0.9)):
        assert "at least" not in str(clear)


@pytest.mark.parametrize(
    ("function", "finding"),
    [
        (lambda k: lambda wi, wo: sum(0.01 * wo[..., 2] for _ in range(k)), "passed as floats: use int"),
        (lambda k: k / np.pi, "returned a number or an array, which is not a function"),
        (lambda k: lambda wi, wo: [[0.1], [0.2, 0.3]], "asarray makes one of a list|expected"),
        (lambda k: lambda wi, wo: wo[5] if wi[..., 2] > 0 else 0, "index the last axis"),
    ],
)
def test_findings_say_what_to_do(function, finding) -> None:
    (found,) = check(function, k=(1, 5)).findings
    assert re.search(finding, found), found
    assert "Tracer" not in found


def test_a_new_check_is_a_row_and_is_shown_everywhere(monkeypatch, tmp_path, capsys) -> None:
    def bright(evidence: Evidence) -> Check:
        value = float(evidence.albedo(np.zeros((1, 0)), np.ones(1), np.zeros(1))[0][0])
        return Check("bright", value, value > 0.9, f"dark: {value:.2g} at normal incidence")

    monkeypatch.setitem(CHECKS, "bright", bright)
    file = tmp_path / "mine.py"
    file.write_text("def grey(wi, wo):\n    return 0.1 + 0 * wi[..., 2] * wo[..., 2]\n")
    outputs = [str(tmp_path / name) for name in ("out.json", "out.xml")]
    words = ["--effort", "quick", "--cos-theta", "0.5", "--json", outputs[0], "--junitxml", outputs[1]]
    assert cli.run(["check", f"{file}:grey", *words]) == 1
    written = capsys.readouterr()
    shown = [written.out + written.err, *(Path(name).read_text() for name in outputs)]
    assert all("dark: 0.31 at normal incidence" in text for text in shown)
    (result,) = json.loads(shown[1])["results"]
    *others, row = result["checks"]
    assert [(one["name"], one["passed"]) for one in others] == [("reciprocal", True), ("positive", True), ("finite", True)]
    assert result["findings"] == ["dark: 0.31 at normal incidence"]
    assert row == {"name": "bright", "value": pytest.approx(np.pi / 10), "passed": False, "words": result["findings"][0]}
