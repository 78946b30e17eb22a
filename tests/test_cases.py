"""What is easily judged wrongly: verdict, albedo, place, findings, messages and exit codes, each with its right value."""

from __future__ import annotations

import math
import os
import re
import sys
import textwrap
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import case_brdfs as cases
import jax.numpy as jnp
import matplotlib.pyplot as plt
import numpy as np
import pytest
from projects import SCENE
from selection import few
from shared import ROOT, Run, python

from brdfcheck.brdf.factors import Factor, Normalized
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.lobes import BinomialPower
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.verdict import Report, Verdict, check

pytestmark = pytest.mark.usefixtures("as_users_have_it")
CONSERVES, VIOLATES, UNDECIDED = Verdict.CONSERVES, Verdict.VIOLATES, Verdict.UNDECIDED
GROWS = math.inf


@dataclass(frozen=True)
class Case:
    """What `check` must say of `target` over `ranges`.

    `albedo` is known to +- `accuracy`, and the error bar must hold it; GROWS: without bound, None: not looked at. `error`: the
    largest error bar that is still useful. `place`: parameters, "cos" and "azimuth" (degrees), with their accuracies. `found`:
    expressions that must occur in findings, a finding each; any other finding is wrong. `channel`: which one, of how many.
    `part`: "slow" or "bench" where it does not run every time.
    """

    name: str
    target: Any
    verdict: Verdict | tuple[Verdict, ...]
    albedo: float | None
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    accuracy: float = 1e-9
    error: float = 1e-6
    place: dict[str, tuple[float, float]] = field(default_factory=dict)
    found: tuple[str, ...] = ()
    text: str = ""
    anisotropic: bool = False
    above: tuple[float, float] | None = None
    channel: tuple[int | None, int] = (None, 1)
    effort: str = "normal"
    part: str = ""


N = {"n": (1.0, 1000.0)}
AT_THE_PEAK = {"n": (17.8512, 2e-3), "cos": (1.0, 1e-6)}
OF_THE_PEAK: dict[str, Any] = {"albedo": 1.0016005217, "place": AT_THE_PEAK, "above": (14.303, 23.056)}
OF_THE_COAT: dict[str, Any] = {"target": cases.coated, "verdict": VIOLATES, "albedo": 1.0010243492}
AT_ITS_EDGE = {"coat_roughness": (0.2990, 1e-4), "cos": (0.60473, 1e-4)}
SINC = 2 * (2 - math.cos(math.sqrt(2)) - math.sqrt(2) * math.sin(math.sqrt(2)))
S2 = (0.33 - 0.09 * math.sqrt(0.165 / 0.02025)) / (math.sqrt(0.165 / 0.02025) - 1)
OREN_NAYAR = 1 - 0.5 * S2 / (S2 + 0.33) + 0.225 * S2 / (S2 + 0.09)
NAN = r"\bNaN\b|not a number|not finite"
A_PLACE = r"wi=\(.*\), wo=\("
BATCH = "one by one"

SOUND_IN_EXACT_ARITHMETIC = [
    Case(
        "ashikhmin-shirley, one",
        lambda wi, wo: cases.ashikhmin_shirley(100.0, 1000.0, 1.0)(wi, wo),
        CONSERVES,
        0.9785117893212102,
        error=1e-5,
        place={"cos": (1.0, 1e-3)},
        anisotropic=True,
        part="bench",
    ),
    Case(
        "ashikhmin-shirley",
        cases.ashikhmin_shirley,
        CONSERVES,
        0.9785117893212102,
        {"nu": (100.0, 100.0), "nv": (10.0, 1000.0), "rs": (1.0, 1.0)},
        error=1e-5,
        place={"nv": (1000.0, 1e-6), "cos": (1.0, 1e-3)},
        anisotropic=True,
        part="bench",
    ),
    Case("ashikhmin's blend", cases.ashikhmin_blend, CONSERVES, 0.9650759236866653, place={"cos": (1.0, 1e-6)}),
    Case(
        "ggx in float32",
        cases.ggx_in_single_precision,
        VIOLATES,
        1.0146,
        {"roughness": (0.05, 1.0)},
        accuracy=1e-3,
        error=0.01,
        place={"roughness": (0.05, 1e-3)},
        part="bench",
    ),
    Case("numpy, writes over wo", cases.numpy_overwrites_wo, CONSERVES, 0.6, place={"cos": (1.0, 1e-6)}),
    Case("numpy, writes over wi", cases.numpy_overwrites_wi, CONSERVES, 0.6, place={"cos": (1.0, 1e-6)}),
]

NARROW = [
    Case(
        "oren-nayar paint",
        cases.oren_nayar_paint,
        VIOLATES,
        0.9875 * OREN_NAYAR,
        {"roughness": (0.0, 1.0)},
        place={"roughness": (math.sqrt(S2) / math.pi, 1e-4), "cos": (0.0, 1e-3)},
    ),
    Case(
        "clear coat, held",
        **OF_THE_COAT,
        ranges={"clearcoat": (1.0, 1.0), "coat_roughness": (0.05, 1.0), "roughness": (0.05, 0.05)},
        place=AT_ITS_EDGE,
    ),
    Case(
        "clear coat, narrowed",
        **OF_THE_COAT,
        ranges={"clearcoat": (1.0, 1.0), "coat_roughness": (0.2, 0.4), "roughness": (0.05, 0.05)},
        place=AT_ITS_EDGE,
        part="bench",
    ),
    Case(
        "clear coat",
        **OF_THE_COAT,
        ranges={"clearcoat": (0.0, 1.0), "coat_roughness": (0.05, 1.0), "roughness": (0.05, 1.0)},
        place={"clearcoat": (1, 1e-4), "roughness": (0.05, 1e-4), **AT_ITS_EDGE},
        part="bench",
    ),
    Case(
        "bump",
        cases.bump_at_ten_degrees,
        VIOLATES,
        1.1464505965,
        place={"cos": (math.cos(math.radians(10.177246783)), 1e-5)},
        found=("not reciprocal.*" + A_PLACE,),
    ),
    Case("ring", cases.ring, VIOLATES, 1.208459922230372, place={"cos": (0.7955, 1e-4)}),
    Case(
        "band",
        cases.band_of_twelve_degrees,
        VIOLATES,
        1.3029720327568846,
        error=1e-4,
        place={"cos": (math.cos(math.radians(14.0076)), 1e-3)},
        part="bench",
    ),
]

HELD = [
    Case("one parameter", cases.sixteenth, VIOLATES, ranges=N, **OF_THE_PEAK),
    Case(
        "three that take away",
        cases.sixteenth_dull,
        VIOLATES,
        1.0016005217,
        {**N, "ks": (0.0, 1.0), "f90": (0.0, 1.0), "dull": (0.0, 1.0)},
        place={**AT_THE_PEAK, "ks": (1, 1e-6), "f90": (0, 1e-6), "dull": (0, 1e-6)},
        part="slow",
    ),
    Case(
        "brushed",
        cases.brushed,
        VIOLATES,
        10.0,
        {"weight": (0.0, 1.0), "f0": (0.0, 1.0), "ax": (0.01, 1.0), "ay": (0.01, 1.0)},
        accuracy=1e-7,
        place={"weight": (1, 1e-6), "f0": (1, 1e-6), "cos": (0, 1e-6)},  # of ax and ay either is 1, the other 0.01
        anisotropic=True,
        part="bench",
    ),
    Case(
        "tinted metal",
        cases.tinted_metal,
        (CONSERVES, UNDECIDED),  # the largest albedo is 1 itself
        1.0,
        {"specular_weight": (0.0, 1.0), "f0": (0.0, 1.0), "tint": (0.0, 1.0), "alpha": (0.05, 1.0)},
        found=("negative: the smallest value seen is -.*specular_weight=.*" + A_PLACE,),
        part="bench",
    ),
    Case(
        "tinted metal in the dark",
        cases.tinted_metal_in_the_dark,
        (CONSERVES, UNDECIDED),
        1.0,
        {"f0": (0.0, 1.0), "tint": (0.0, 1.0), "alpha": (0.05, 1.0)},
        found=("negative: the smallest value seen is -.*f0=.*" + A_PLACE,),
        part="bench",
    ),
    Case(
        "dark tinted metal, one",
        lambda wi, wo: cases.tinted_metal(1.0, 0.0, 0.0, 0.05)(wi, wo),
        (CONSERVES, UNDECIDED),
        None,
        found=("negative: the smallest value seen is -.*" + A_PLACE,),
    ),
    Case(
        "rough gloss",
        cases.rough_gloss,
        VIOLATES,
        52.90213219035276,
        {"kd": (0.0, 1.0), "ks": (0.0, 1.0), "u": (0.01, 1.0), "v": (0.01, 1.0)},
        accuracy=1e-6,
        error=1e-4,
        place={"ks": (1, 1e-6), "u": (0.01, 1e-6), "v": (0.01, 1e-6), "cos": (0, 1e-6)},
        anisotropic=True,
        part="bench",
    ),
]

AT_THE_HORIZON = {"cos": (0.0, 1e-6)}


def root_at_the_horizon(name: str, limit: float, power: float, **more: Any) -> Case:
    return Case(name, cases.grazing_root(limit, power), VIOLATES, limit, place=AT_THE_HORIZON, **more)


def growing(name: str, target: Any, ranges: dict[str, tuple[float, float]], **more: Any) -> Case:
    return Case(name, target, VIOLATES, GROWS, ranges, place=AT_THE_HORIZON, text="grows without bound", **more)


GRAZING = [
    root_at_the_horizon("fourth root", 1.0028724373, 0.25, part="slow"),
    root_at_the_horizon("tenth power", 1.0017317971, 0.1, accuracy=1e-7, error=1e-4),
    root_at_the_horizon("square root", 1.00001, 0.5, part="slow"),
    root_at_the_horizon("steep tenth power", 1.1, 0.1, accuracy=1e-7, error=1e-2, part="bench"),
    growing("power", cases.grazing_power, {}),
    # Above the line by 4e-9: the error bar must be smaller, or the verdict cannot be understood.
    Case("ggx", cases.grazing_ggx, VIOLATES, 1.000000005, {"scale": (1.000000005,) * 2}, error=4.5e-9, place=AT_THE_HORIZON),
    Case("lommel-seeliger", cases.lommel_seeliger, VIOLATES, 1 + 1e-8, error=9e-9, place=AT_THE_HORIZON, part="slow"),
    Case("logarithm", cases.grazing_logarithm, VIOLATES, 1.004, {"s": (0.5, 1.0)}, accuracy=1e-6, error=3e-3, part="slow"),
    Case("inverse square", cases.inverse_square_cosines, VIOLATES, GROWS, text="grows without bound|infinite", part="slow"),
    growing("ward", cases.ward, {"ax": (0.1, 0.1), "ay": (0.1, 0.6)}, anisotropic=True, part="bench"),
    growing("ward, held", cases.ward, {"ax": (0.1, 0.1), "ay": (0.6, 0.6)}, anisotropic=True),
    Case(
        "pole",
        cases.compensated,
        VIOLATES,
        GROWS,
        {"pr": (0.0, 1.0), "f0": (0.0, 1.0)},
        found=("not reciprocal.*" + A_PLACE, "negative.*" + A_PLACE),
        text="grows without bound|infinite",
    ),
]

BATCHES = [
    Case("norm", cases.norm_of_the_batch, VIOLATES, 560.02734375 / 528, found=(f"{BATCH}.*axis=-1",)),
    Case("norm, meant", cases.norm_of_each, VIOLATES, 560.02734375 / 528, part="slow"),
    Case("norm, numpy", cases.in_numpy(cases.norm_of_the_batch), (UNDECIDED, VIOLATES), None, found=(f"{BATCH}.*axis=-1",)),
    Case(
        "largest",
        cases.largest_of_the_batch,
        (UNDECIDED, VIOLATES),
        None,
        found=(f"{BATCH}.*(maximum|largest)", NAN),
        part="slow",
    ),
    Case(
        "largest, numpy", cases.numpy_largest_of_the_batch, (UNDECIDED, VIOLATES), None, found=(f"{BATCH}.*(maximum|largest)",)
    ),
    Case("running mean", cases.running_mean, (UNDECIDED, CONSERVES), None, found=(f"{BATCH}|order",), part="slow"),
    Case("running mean, numpy", cases.in_numpy(cases.running_mean), (UNDECIDED, CONSERVES), None, found=(f"{BATCH}|order",)),
    Case(
        "number",
        cases.divided_by_their_number,
        CONSERVES,
        0.9,
        found=(f"{BATCH}.*(number of directions|len|mean)",),
        part="slow",
    ),
    Case(
        "number, numpy",
        cases.in_numpy(cases.divided_by_their_number),
        (UNDECIDED, CONSERVES),
        None,
        found=(f"{BATCH}.*(number of directions|len|mean)",),
    ),
    Case("random, numpy", cases.numpy_random, UNDECIDED, None, found=("random|state",)),
    Case("random while traced", cases.random_while_traced, (UNDECIDED, CONSERVES), None, found=("random",)),
    Case("counting, numpy", cases.numpy_counting(), UNDECIDED, None, found=("state",)),
    Case("all pairs", cases.outer_product, UNDECIDED, None, found=(r"channels.*sum\(wi \* wo, axis=-1\)",)),
]

NOT_FINITE = [
    Case("nan", cases.nan_everywhere, UNDECIDED, math.nan, found=("NaN",)),
    Case("nan, numpy", cases.in_numpy(cases.nan_everywhere), UNDECIDED, math.nan, found=("NaN",)),
    Case(
        "0/0 at the mirror",
        lambda wi, wo: cases.zero_by_zero_at_the_mirror(0.9)(wi, wo),
        CONSERVES,
        0.9 * SINC,
        place={"cos": (1.0, 1e-6)},
        found=(f"{NAN}.*{A_PLACE}",),
    ),
    Case(
        "0/0 at the mirror, a family",
        cases.zero_by_zero_at_the_mirror,
        VIOLATES,
        1.2 * SINC,
        {"scale": (0.1, 1.2)},
        place={"cos": (1.0, 1e-6), "scale": (1.2, 1e-6)},
        found=(f"{NAN}.*scale=.*{A_PLACE}",),
    ),
    Case(
        "0/0 at the normal",
        cases.zero_by_zero_at_the_normal,
        CONSERVES,
        0.5,
        found=(rf"{NAN}.*wi=\(0, 0, 1\), wo=\(",),
        part="slow",
    ),
    Case("infinite at the mirror", cases.infinite_at_the_mirror, CONSERVES, 0.4, found=(f"[Ii]nf.*{A_PLACE}",), part="slow"),
    Case("glows but for the mirror", cases.glows_but_for_the_mirror, VIOLATES, 1.3, found=(f"{NAN}.*{A_PLACE}",), part="slow"),
    Case("negative", cases.negative_throughout, UNDECIDED, -0.1 * math.pi, found=(r"negative.*-0\.1 / sr.*" + A_PLACE,)),
]

SIZES = [
    Case("to 1e308", cases.fades_in, CONSERVES, 0.9, {"n": (1.0, 1e308)}),
    Case("both signs to 1e308", cases.hill, VIOLATES, 1.05, {"x": (-1e308, 1e308)}, place={"x": (1.3e307, 1e305)}, part="slow"),
    Case("down to 1e-308", cases.tiny, CONSERVES, 0.7, {"a": (1e-308, 1e-300)}, part="slow"),
    Case(
        "an exponent to 1e308",
        lambda n: Normalized(BinomialPower(n), Factor(6.0, 24.55)),
        VIOLATES,
        ranges={"n": (1.0, 1e308)},
        part="slow",
        **OF_THE_PEAK,
    ),
]

SIGNATURES = [
    Case("three arguments", cases.three_arguments, CONSERVES, 0.9, {"n": (1.0, 50.0)}),
    Case("three arguments, held", cases.three_arguments, CONSERVES, 0.054, {"n": (3.0, 3.0)}, place={"n": (3.0, 0.0)}),
    Case("three arguments, bad", cases.three_arguments_bad, VIOLATES, 1.02, {"n": (1.0, 50.0)}, above=(50 / 1.02, 50.0)),
    Case("a default", cases.three_arguments_default, CONSERVES, 0.09),
    Case("a default over a range", cases.three_arguments_default, CONSERVES, 0.9, {"n": (1.0, 50.0)}, part="slow"),
    Case("on the line", cases.normalised_phong, (CONSERVES, UNDECIDED), 1.0, {"n": (1.0, 200.0)}, error=1e-8, part="slow"),
]

RESULTS = [
    Case("one number, numpy", cases.numpy_one_number, CONSERVES, 0.2 * math.pi),
    Case("one number", cases.one_number, CONSERVES, 0.2 * math.pi, part="slow"),
    Case("a list", cases.numpy_list, CONSERVES, 0.2 * math.pi, part="bench"),
    Case("time differences", cases.numpy_values(0, "timedelta64[s]"), UNDECIDED, math.nan, found=("timedelta64.*not numbers",)),
    Case("dates", cases.numpy_values(0, "datetime64[s]"), UNDECIDED, math.nan, found=("datetime64.*not numbers",)),
    Case("complex, numpy", cases.numpy_values(0.2 + 0j), UNDECIDED, math.nan, found=("complex",)),
    Case("complex", cases.complex_traced, UNDECIDED, math.nan, found=("complex",)),
    Case("objects", cases.numpy_values(0.2, object), UNDECIDED, math.nan, found=("object",)),
    Case("words", cases.numpy_values("0.2"), UNDECIDED, math.nan, found=("not numbers",)),
    Case("nothing", cases.returns_nothing, UNDECIDED, math.nan, found=("returned (None|NoneType|nothing)",)),
]

CHANNELS = [
    Case("green", cases.glows(0.3, 1.2, 0.6), VIOLATES, 1.2, text="channel=green", channel=(1, 3)),
    Case("blue", cases.blue_glows, VIOLATES, ranges=N, text="channel=blue", channel=(2, 3), part="slow", **OF_THE_PEAK),
    Case(
        "red, numpy", cases.in_numpy(cases.glows(1.1, 0.2, 0.2)), VIOLATES, 1.1, text="channel=red", channel=(0, 3), part="slow"
    ),
    Case("the fourth", cases.glows(0.3, 0.2, 0.6, 1.25), VIOLATES, 1.25, text="channel=3", channel=(3, 4), part="slow"),
]

# Where the search is not what is tested, it need not look long, nor at more than one angle.
ONE_ANGLE = {"cos_theta": (1.0, 1.0)}
ALL = [
    *NARROW,
    *HELD,
    *(replace(case, effort="quick") for case in (*SOUND_IN_EXACT_ARITHMETIC, *GRAZING, *SIZES)),
    *(replace(case, effort="quick") for case in (*BATCHES, *NOT_FINITE)),
    *(replace(case, effort="quick", ranges=case.ranges | ONE_ANGLE) for case in (*SIGNATURES, *RESULTS, *CHANNELS)),
]


def measured(report: Report, name: str) -> float:
    return report.cos_theta if name == "cos" else report.parameters[name]


def right_albedo(case: Case, report: Report) -> bool:
    if case.albedo is None:
        return True
    if not math.isfinite(case.albedo):
        return str(report.albedo) == str(case.albedo)
    return abs(report.albedo - case.albedo) <= report.error + case.accuracy and report.error <= case.error


@pytest.mark.parametrize(
    "case",
    [
        pytest.param(case, id=case.name.replace(" ", "-"), marks=[getattr(pytest.mark, case.part)] if case.part else [])
        for case in ALL
    ],
)
def test_case(case: Case) -> None:
    report = check(case.target, effort=case.effort, intervals=case.above is not None, **case.ranges)
    text = str(report)
    assert report.verdict in (case.verdict if isinstance(case.verdict, tuple) else (case.verdict,)), text
    assert right_albedo(case, report), text
    for name, (value, accuracy) in case.place.items():
        assert abs(measured(report, name) - value) <= accuracy, text
    assert report.anisotropic is case.anisotropic, text
    for expression in case.found:
        assert any(re.search(expression, finding) for finding in report.findings), (expression, text)
    for finding in report.findings:
        assert any(re.search(expression, finding) for expression in case.found), text
        assert "smallest value seen is nan" not in finding
    assert len(report.findings) == len(case.found), text
    assert (report.channel, report.channels) == (case.channel if report.points else (None, 1)), text
    assert re.search(case.text, text), text
    if case.above is not None:
        assert report.above == (pytest.approx(case.above, abs=1e-3),), text
    assert report.passed is bool(report) is (report.verdict is CONSERVES and not case.found), text


# --- what a table cannot say ---


@pytest.mark.parametrize("roughness", [0.05, 0.3, 1.0])
def test_rounding_is_no_anisotropy(roughness: float) -> None:
    assert not PointwiseAlbedo(Family("ggx", lambda: cases.ggx_in_single_precision(roughness))).anisotropic


@pytest.mark.parametrize("width", few([20.0, 1.0], (1.0,)))
def test_a_sector_of_azimuths_is_seen_in_single_precision(width: float) -> None:
    """Most pairs of directions say nothing of it, and all of them round."""

    def f(wi: Any, wo: Any) -> Any:
        away = jnp.arctan2(wi[..., 1], wi[..., 0]) - 1.0
        inside = jnp.exp(-((away / jnp.radians(width / 2)) ** 2))
        return ((0.95 + 0.25 * inside) / jnp.pi + 0 * wo[..., 2]).astype(jnp.float32)

    report = check(f, effort="quick")
    assert report.anisotropic
    assert report.verdict is VIOLATES
    assert report.albedo == pytest.approx(1.2, abs=1e-5)
    assert report.azimuth == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("change", few([5e-8, 4e-9], (4e-9,)))
def test_a_change_with_the_azimuth_above_the_tolerance_is_seen(change: float) -> None:
    def f(wi: Any, wo: Any) -> Any:
        turned = jnp.cos(2 * (jnp.arctan2(wi[..., 1], wi[..., 0]) - 1.2))
        return (1 + change * turned) / jnp.pi + 0 * wo[..., 2]

    report = check(f, effort="quick")
    assert report.verdict is VIOLATES
    assert abs(report.albedo - 1 - change) <= report.error


def test_the_axes_of_a_brushed_surface_need_not_be_those_of_the_box() -> None:
    ranges = {"weight": (0.0, 1.0), "f0": (0.0, 1.0), "ax": (0.01, 1.0), "ay": (0.01, 1.0)}
    assert PointwiseAlbedo(Family("brushed", cases.brushed, ranges)).anisotropic
    held = {**ranges, "ax": (0.1, 0.1), "ay": (0.1, 0.1)}
    assert not PointwiseAlbedo(Family("brushed", cases.brushed, held)).anisotropic


def test_a_held_parameter_costs_nothing() -> None:
    free = check(cases.sixteenth, **N, **ONE_ANGLE, effort="quick")
    held = check(cases.sixteenth_ks, **N, ks=(1.0, 1.0), **ONE_ANGLE, effort="quick")
    for name in ("verdict", "albedo", "error", "cos_theta", "above", "evaluations", "points", "climbs", "width", "basis"):
        assert getattr(held, name) == getattr(free, name), name
    assert held.parameters == {**free.parameters, "ks": 1.0}
    assert held.ranges == {**free.ranges, "ks": (1.0, 1.0)}


def test_arguments_need_not_be_called_wi_and_wo() -> None:
    report = check(lambda light, view, n: cases.three_arguments(light, view, n), n=(1, 50), **ONE_ANGLE, effort="quick")
    assert report.albedo == pytest.approx(0.9, abs=1e-8), str(report)
    with pytest.raises(ValueError, match=r"\bm\b.*\bn\b"):
        check(cases.three_arguments, m=(1, 50))
    with pytest.raises(ValueError, match=r"\bn\b"):
        check(cases.three_arguments)


MEMORY = """
    import resource, sys
    import case_brdfs
    import brdfcheck
    resource.setrlimit(resource.RLIMIT_AS, (12 << 30, 12 << 30))  # so that a fault ends this process and no other
    brdfcheck.use_x64()
    report = brdfcheck.check(getattr(case_brdfs, sys.argv[1]), effort=sys.argv[2])
    print(report)
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024)
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="measures memory as Linux does")
@pytest.mark.parametrize(
    ("name", "effort", "said"),
    [
        ("outer_product", "normal", "UNDECIDED.*channels follows the number of directions"),
        pytest.param(
            "numpy_outer_product", "normal", "UNDECIDED.*channels follows the number of directions", marks=pytest.mark.slow
        ),
        pytest.param("numpy_pairs_within", "quick", "CONSERVES: albedo 0.628318", marks=pytest.mark.bench),
    ],
)
def test_all_pairs_take_little_memory(name: str, effort: str, said: str) -> None:
    paths = {"PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "tests")))}
    code, out, err = python("-c", textwrap.dedent(MEMORY), name, effort, environment=paths)
    assert code == 0, err
    assert re.search(said, out), out
    assert int(out.split()[-1]) < 2 << 30


def test_an_integrable_singularity_is_no_pole() -> None:
    report = check(cases.singular_line, effort="quick")
    assert report.verdict is not VIOLATES, str(report)
    assert report.unbounded is None
    assert abs(report.albedo - 0.839058) <= report.error
    assert any("not finite" in finding for finding in report.findings)


# --- the command line ---


ROOM = """
[room]
reflectance = 0.7
emission = 1.5
"""


def test_a_scene_of_a_budget_can_be_rendered(run: Run, here: Path) -> None:
    sums = []
    for tables in ("", ROOM):
        (here / "scene.toml").write_text(SCENE + tables)
        run.passed("render", "scene.toml", "-o", "scene.png")
        sums.append(float(np.sum(plt.imread("scene.png"))))
    assert sums[1] > 1.2 * sums[0] > 0  # the room adds light
