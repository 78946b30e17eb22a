"""BRDFs as users write them, the brute force that the study holds against `check`, and what the study tells apart."""

from __future__ import annotations

import json
import math
from types import SimpleNamespace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import integrate
from shared import ROOT, direction

import brdfcheck
from _instruments import user_checks, user_families, user_scan
from brdfcheck import studies

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("as_users_have_it")]  # an instrument of studies
STUDY = studies.find()["user_brdfs"]

FAMILIES = user_families.FAMILIES


def pairs() -> tuple[np.ndarray, np.ndarray]:
    """Random, mirror, near-mirror, retro, normal and grazing pairs of directions."""
    random = np.random.default_rng(3)
    cosine, azimuth = random.uniform(0.01, 1, (2, 60)), random.uniform(0, 2 * np.pi, (2, 60))
    grazing = 10 ** random.uniform(-5, -2, 60)
    wi = direction(cosine[0], azimuth[0])
    mirror, near = direction(cosine[0], azimuth[0] + np.pi), direction(cosine[0] ** 1.01, azimuth[0] + np.pi + 0.01)
    low, other = direction(grazing, azimuth[0]), direction(grazing[::-1], azimuth[1])
    right = (direction(cosine[1], azimuth[1]), mirror, near, wi, np.tile([0.0, 0.0, 1.0], (60, 1)), low, low, low)
    left = (wi, wi, wi, wi, wi, wi, other, np.tile([0.0, 0.0, 1.0], (60, 1)))
    return np.concatenate(left), np.concatenate(right)


def members(subject: Any) -> list[dict[str, float]]:
    """The corners of a family's box and three places within it."""
    places = np.array(np.meshgrid(*subject.ranges.values())).reshape(len(subject.ranges), -1).T
    low, high = places.min(axis=0), places.max(axis=0)
    places = [*places, *(low + (high - low) * np.random.default_rng(4).random((3, len(low))))]
    return [dict(zip(subject.ranges, map(float, place), strict=True)) for place in places]


@pytest.mark.parametrize("name", FAMILIES)
def test_reciprocal_not_negative_and_finite(name):
    subject = FAMILIES[name]
    wi, wo = pairs()
    evaluate = lambda values, wi, wo: subject.build(**values)(wi, wo)  # noqa: E731
    if not subject.numpy:
        evaluate = jax.jit(evaluate)
    for member in members(subject):
        there, back = (np.asarray(evaluate(member, *both)) for both in ((wi, wo), (wo, wi)))
        assert there.shape[:1] == (len(wi),)
        assert np.all(np.isfinite(there)), member
        assert np.all(there >= 0), member
        assert np.all(np.abs(there - back) <= 1e-9 * there + 1e-12 * there.max()), member


@pytest.mark.parametrize("name", FAMILIES)
def test_isotropic_where_it_is_scanned_so(name):
    subject = FAMILIES[name]
    f = subject.build(**members(subject)[-1])
    wi, wo, turn = direction(0.6, 0.3), direction(0.5, 3.2), np.array([[0.8, -0.6, 0], [0.6, 0.8, 0], [0, 0, 1]])
    first, turned, flipped = np.asarray(f(wi, wo)), np.asarray(f(turn @ wi, turn @ wo)), np.asarray(f(wi, direction(0.5, -2.6)))
    same = np.allclose(first, turned, rtol=1e-9) and np.allclose(first, flipped, rtol=1e-9)
    assert same is not subject.anisotropic


# --- the formulas, against what is known of them ---


def test_eon_keeps_all_energy_of_white():
    rule = user_scan.Rule(FAMILIES["eon"])
    for sigma, cosine in ((0.3, 0.2), (1.0, 0.7), (1.0, 0.01)):
        assert rule.at({"rho": 1.0, "sigma": sigma}, cosine, 0.0)[0] == pytest.approx(1, abs=1e-12)
    assert rule.at({"rho": 0.4, "sigma": 0.0}, 0.5, 0.0)[0] == pytest.approx(0.4 + 1e-7 * 0.16, abs=1e-15)  # its guard


def test_albedos_in_closed_form():
    # Minnaert: A cos^(k-1).
    value, error = user_scan.Rule(FAMILIES["minnaert"]).at({"albedo": 0.5, "k": 0.6}, 0.3, 0.0)
    assert abs(value - 0.5 * 0.3**-0.4) <= max(error, 1e-13)
    # Oren-Nayar at grazing: a + b/2.
    s2 = 0.2**2
    value = user_scan.Rule(FAMILIES["oren_nayar_numpy"]).at({"sigma": 0.2}, 0.0, 0.0)[0]
    assert value == pytest.approx(1 - 0.5 * s2 / (s2 + 0.33) + 0.225 * s2 / (s2 + 0.09), abs=1e-8)


def test_hapke_without_surge_and_phase_function_scatters_isotropically():
    def many(x):
        return (1 + 2 * x) / (1 + 2 * x * math.sqrt(0.1))

    value, error = user_scan.Rule(FAMILIES["hapke"]).at({"w": 0.9, "g": 0.0, "h": 0.1, "b0": 0.0}, 0.7, 0.0)
    expected = 0.45 * many(0.7) * integrate.quad(lambda x: many(x) * x / (0.7 + x), 0, 1, epsabs=1e-13)[0]
    assert abs(value - expected) <= error + 1e-12


def test_the_film_without_thickness_is_the_metal():
    cosine, metal = np.linspace(0.05, 1, 9), 2.2 + 3.0j
    q = np.sqrt(metal**2 - 1 + cosine**2)
    s, p = np.abs((cosine - q) / (cosine + q)) ** 2, np.abs((metal**2 * cosine - q) / (metal**2 * cosine + q)) ** 2
    airy = user_families._airy
    np.testing.assert_allclose(airy(jnp.asarray(cosine), 0.0, 1.6, 550.0), (s + p) / 2, rtol=1e-12)
    # Half a wave in the film changes nothing at normal incidence, a quarter does.
    half, quarter = airy(1.0, 550 / 1.6 / 2, 1.6, 550.0), airy(1.0, 550 / 1.6 / 4, 1.6, 550.0)
    assert half == pytest.approx(s[-1], rel=1e-12)
    assert quarter < s[-1] - 0.1


def test_f82_is_the_tint_at_its_angle():
    """At cos 1/7 the Fresnel factor is Schlick's times the tint."""
    wi, wo = direction(1 / 7, 0.0), direction(1 / 7, np.pi)  # the half vector is the normal
    tinted, plain = (float(FAMILIES["f82_metal"].build(0.6, tint, 0.3)(wi, wo)) for tint in (0.3, 1.0))
    assert tinted / plain == pytest.approx(0.3, rel=1e-12)


def test_the_matte_part_of_kelemen_gives_back_what_the_coat_leaves():
    """With coat (smooth, its albedo exact): a + rd (1 - a), so the matte part alone is rd (1 - a)."""
    with_matte, without = (
        user_scan.Rule(FAMILIES["kelemen"]).at({"m": 0.3, "rd": rd, "f0": 0.1}, 0.4, 0.0)[0] for rd in (0.7, 0)
    )
    assert with_matte - without == pytest.approx(0.7 * (1 - 0.1 - 0.9 * 0.6**5), rel=1e-9)


# --- brute force ---


def test_a_needle_that_reflects_all_light_is_decided():
    """At grazing incidence it is 1 for all parameters and azimuths: climbs by the rule of one place saw 1e-4 more beside it."""
    ward = FAMILIES["ward_bounded"]
    report = brdfcheck.check(ward.build, **ward.ranges)
    assert (report.verdict.name, report.settled) == ("CONSERVES", True)
    assert abs(report.albedo - 1) <= report.error < 1e-9


@pytest.mark.parametrize("name", ["disney", "ashikhmin_shirley", "ward_bounded", "hapke", "eon", "thin_film", "measured"])
def test_the_rule_is_as_good_as_it_says(name):
    subject = FAMILIES[name]
    member = members(subject)[-1]
    value, error = user_scan.Rule(subject).at(member, 0.4, 0.9)
    other = brdfcheck.albedo(subject.build(**member), 0.4, azimuth=0.9, rtol=1e-7)
    assert abs(value - float(np.max(other.value))) <= error + float(np.max(other.error))
    assert error < 1e-4 * value


@pytest.mark.parametrize("pole", ["mirror", "light", "normal"])
@pytest.mark.parametrize("whole", [False, True])
def test_directions_cover_the_hemisphere(pole, whole):
    for cosine in (1.0, 0.6, 1e-9):
        wi, wo, weight = user_scan.directions(np, cosine, 0.7, user_scan.MEDIUM, pole=pole, whole=whole)
        np.testing.assert_allclose(wi, direction(cosine, 0.7), atol=1e-15)
        np.testing.assert_allclose(np.linalg.norm(wo, axis=-1), 1, rtol=1e-13)
        assert np.all(wo[:, 2] > 0)
        assert np.sum(weight) == pytest.approx(np.pi, rel=1e-5)
        assert np.sum(weight * wo[:, 2] ** 2) == pytest.approx(np.pi / 2, rel=1e-4)
        along = wo[:, 0] * np.cos(0.7) + wo[:, 1] * np.sin(0.7)
        assert np.sum(weight * along) == pytest.approx(0, abs=2e-3)
        assert np.sum(weight * along**2) == pytest.approx(np.pi / 4, rel=1e-3)


def bump(place, height):
    """Lambert times a bump at one parameter and one cosine."""

    def f(wi, wo):
        def g(c):
            return jnp.exp(-(((c - 0.37) / 0.05) ** 2))

        return (0.5 + 0.25 * height * jnp.exp(-(((place - 0.712) / 0.1) ** 2)) * (g(wi[..., 2]) + 1)) / jnp.pi + 0 * wo[..., 0]

    return f


def test_a_scan_finds_the_largest_albedo_within_and_at_corners():
    subject = user_families.Subject(bump, {"place": (0.0, 1.0), "height": (0.0, 1.0)})
    found = user_scan.scan(user_scan.Rule(subject), 1024)
    assert found["value"] == pytest.approx(1, abs=1e-5)
    assert found["parameters"] == {"place": pytest.approx(0.712, abs=1e-3), "height": 1}
    assert found["cos_theta"] == pytest.approx(0.37, abs=1e-3)
    assert not found["unbounded"]
    assert found["evaluations"] > 1024 * user_scan.COARSE[0] * user_scan.COARSE[1]


@pytest.mark.parametrize("name", FAMILIES)
def test_albedos_are_finite_down_to_grazing_incidence(name):
    """Where both directions are almost opposite: no cancellation, no 0/0."""
    subject = FAMILIES[name]
    rule = user_scan.Rule(subject)
    rows = np.array([list(member.values()) for member in members(subject)])
    for cosine in (user_scan.LEAST, 1e-7, 1e-5):
        values = rule(rows, np.full(len(rows), cosine), np.full(len(rows), 2.69), user_scan.MEDIUM)
        assert np.all(np.isfinite(values))
        assert np.all(values >= 0)
        if name in ("ashikhmin_shirley", "ward_bounded", "f82_metal", "thin_film", "eon"):
            assert np.all(values <= 1 + 1e-3)  # of this rule


def test_a_scan_tells_what_grows_without_bound():
    assert user_scan.scan(user_scan.Rule(FAMILIES["minnaert"]), 256, rounds=2)["unbounded"]


# --- answers against brute force ---


def answer(verdict="CONSERVES", albedo=0.9, error=1e-9) -> dict[str, Any]:
    return {"verdict": verdict, "albedo": albedo, "error": error, "parameters": {}, "cos_theta": 0.5, "azimuth": 0.0}


def found(value: float, unbounded=False) -> dict[str, Any]:
    return {"value": value, "error": 1e-6, "parameters": {}, "cos_theta": 0.25, "unbounded": unbounded, "nonfinite": 0}


def flags(given: dict[str, Any], seen: dict[str, Any], there: float) -> list[str]:
    return user_checks.faults(given, seen, SimpleNamespace(at=lambda *place: (there, 1e-7)))


def test_what_excludes_each_other_is_told():
    assert flags(answer(), found(0.9), 0.9) == []
    assert flags(answer(), found(0.85), 0.9) == []  # brute force may miss
    assert flags(answer(), found(0.9000005), 0.9) == []  # within the error of its rule
    assert flags(answer(), found(0.91), 0.9) == ["a larger albedo was seen: 0.91 at cos 0.25, {}"]
    assert flags(answer("VIOLATES", 1.2), found(0.95), 0.9) == ["such an albedo was not seen: 0.9 at the place of 1.2"]
    assert flags(answer(), found(1.1), 0.9)[1:] == ["CONSERVES, but an albedo above 1 was seen"]
    assert flags(answer("VIOLATES", 7.0), found(30.0, unbounded=True), 7.0) == []
    (text,) = flags(answer(), found(30.0, unbounded=True), 0.9)
    assert text.endswith("grows without bound towards grazing incidence")
    assert flags(answer("UNDECIDED", math.nan, math.nan), found(0.9), 0.9) == ["the albedo is not a number"]


# --- the study ---


def test_a_check_is_a_process_of_the_package_that_was_given(monkeypatch):
    monkeypatch.setattr(user_checks, "_LONG", 60)  # on a busy machine, too
    told = user_checks.check("oren_nayar_numpy", ROOT, kept=True)
    assert told["verdict"] == "VIOLATES"
    assert told["albedo"] == pytest.approx(1.0151787783, abs=1e-9)
    assert told["parameters"] == {"sigma": pytest.approx(0.19853, abs=1e-4)}
    assert min(told["seconds"], told["kept_seconds"]) > 0.1
    assert {"points", "basis", "climbs", "settled", "width", "evaluations", "findings"} <= set(told)


@pytest.fixture(scope="module")
def record():
    """The small study with canned answers: an older version that takes three times as long and errs on Oren-Nayar."""
    module = studies.load(STUDY)
    place = {"parameters": {"albedo": 1.0, "k": 0.5, "sigma": 0.1985}, "cos_theta": 1e-9, "azimuth": 0.0}

    def check(name, folder, *, kept=False):
        old = folder != ROOT
        albedo = 31623.0 if name == "minnaert" else 0.9984 if old else 1.01517878
        told = {"verdict": "CONSERVES" if albedo < 1 else "VIOLATES", "albedo": albedo, "error": 1e-8, "evaluations": 10**7}
        return {"seconds": 6.0 if old else 2.0, "kept_seconds": 1.5 if kept else None, "findings": [], **told, **place}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(user_checks, "check", check)
        patch.setattr(studies, "load", lambda study: module)
        return json.loads(studies.to_json(studies.record_of(STUDY, "small", [ROOT / "tests" / ".."])))


def test_now_and_before(record, tmp_path):
    minnaert, paint = record["results"]
    assert (minnaert["ratio"], paint["ratio"], record["summary"]["median_ratio"]) == (3, 3, 3)
    assert minnaert["scan"]["unbounded"]
    assert paint["scan"]["value"] == pytest.approx(1.0151787783, abs=1e-7)
    assert minnaert["flags"] == {"now": [], "before": []}
    assert paint["flags"]["now"] == []
    assert paint["flags"]["both"] == ["VIOLATES now, CONSERVES before"]
    assert [text.partition(":")[0] for text in paint["flags"]["before"]] == [
        "a larger albedo was seen", "CONSERVES, but an albedo above 1 was seen"
    ]  # fmt: skip
    assert record["summary"]["flagged"] == []
    assert record["summary"]["flagged_before"] == record["summary"]["contradict"] == ["oren_nayar_numpy"]
    page = (studies.write_report(STUDY, record, tmp_path) / "summary.md").read_text()
    assert "median ratio 3.00" in page
    assert "| VIOLATES | 1.0151788 ± 1e-08 | CONSERVES | 0.9984 ± 1e-08 | 1.0151788 ±" in page
    figure = (tmp_path / "user_brdfs" / "figure.svg").read_text()
    assert f"before ({record['settings']['baseline']})" in figure
    assert "3 times the speed" in figure
    assert "now, programs kept" in figure
