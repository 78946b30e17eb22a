"""No false verdict: `check` on families whose suprema are known by derivation (`adversarial.py`).

What is asserted of every family: never CONSERVES above the line, never VIOLATES below it, the truth within the error bar. What
is asserted of all together: few are UNDECIDED that are clear.
"""

from __future__ import annotations

import gc
from typing import Any

import adversarial
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from adversarial import Case
from selection import few

from brdfcheck.brdf.family import Family
from brdfcheck.verdict import TOLERANCE, Report, Verdict, check_family

_LINE = 1 + TOLERANCE


def checked(case: Case) -> Report:
    build = case.build if case.ranges else lambda: case.build
    return check_family(Family(case.name, build, case.ranges), intervals=False)


def fault(case: Case, report: Report) -> str | None:
    """What is wrong with a report, in words."""
    if report.verdict is Verdict.CONSERVES and case.truth > _LINE + case.accuracy:
        return f"false CONSERVES: {report.albedo} +- {report.error}, truth {case.truth}"
    if report.verdict is Verdict.VIOLATES and case.truth < _LINE - case.accuracy:
        return f"false VIOLATES: {report.albedo} +- {report.error}, truth {case.truth}"
    off = 0.0 if report.albedo == case.truth else abs(report.albedo - case.truth)
    if not off <= report.error + case.accuracy:
        return f"short bar: {report.albedo} +- {report.error}, truth {case.truth}, {off / max(report.error, 1e-300):.2g} bars"
    if case.reciprocal and any("reciprocal" in finding for finding in report.findings):
        return f"called not reciprocal: {report.findings}"
    return None


def unclear(case: Case, report: Report) -> bool:
    """True where a clear case is left undecided."""
    clear = not np.isfinite(case.truth) or abs(case.truth - 1) > 1e-6 + case.accuracy
    return report.verdict is Verdict.UNDECIDED and clear and not case.jumps


# The seed and the number of a draw: one of each kind, which is drawn when its test runs. The first seed runs every time, but
# for kinds that take long and have a like among the others: a cone, a lobe of the catalogue, a narrow parameter, a ridge, a
# pole.
DEAR = ("spot", "moving bump", "disc", "wedge", "retro lobe", "off-specular lobe", "two narrow parameters", "curved ridge")
DEAR += ("narrow angle and parameter", "near pole", "many parameters", "grazing limit")
# The first draws of these kinds are of numpy, which takes three times as long: another one runs every time.
SEEDS = {"reciprocal cone": 2, "kink": 3}
DRAWS = [
    pytest.param(
        (seed, number),
        id=f"{kind}-{seed}",
        marks=[pytest.mark.slow] if seed != SEEDS.get(kind, 1) or kind in DEAR else [],
    )
    for seed in range(1, 5)
    for number, kind in enumerate(adversarial.kinds())
]
# Draws in which a fault was seen once: seed and number.
FOUND = [(31, 129), (31, 134), (31, 135), (31, 164), (31, 181), (31, 250), (31, 271), (301, 42)]


@pytest.mark.parametrize("key", DRAWS)
def test_no_false_verdict(key: tuple[int, int]) -> None:
    case = adversarial.drawn(*key)
    report = checked(case)
    assert fault(case, report) is None, report
    assert not unclear(case, report), report


@pytest.mark.parametrize("key", few(FOUND, FOUND[1:2] + FOUND[6:]))
def test_faults_found_once_stay_away(key: tuple[int, int]) -> None:
    drawn = adversarial.drawn(*key)
    assert fault(drawn, checked(drawn)) is None


# Of the kinds of which numpy and JAX are compared, those that the other tests do not wait for.
TWINS = ("narrow angle",)


@pytest.mark.parametrize("kind", few(adversarial.plain_kinds(), TWINS))
def test_numpy_and_jax_agree(kind: str) -> None:
    pair = adversarial.twins(kind, 2)
    with_numpy, with_jax = (checked(case) for case in pair)
    assert [fault(*told) for told in zip(pair, (with_numpy, with_jax), strict=True)] == [None, None]
    assert with_numpy.verdict is with_jax.verdict
    assert with_numpy.engine == "adaptive (numpy)"
    assert with_jax.engine == "adaptive"
    if np.isfinite(with_jax.albedo):
        assert with_numpy.albedo == pytest.approx(with_jax.albedo, abs=with_numpy.error + with_jax.error)


def albedo_in_a_window(seed: int) -> tuple[Any, float]:
    """A family whose albedo is that of its factor, at most 0.999 but on a hundredth of the range, and the largest there.

    In that window it is mostly lower than elsewhere, and the highest about one angle only.
    """
    random = np.random.default_rng([77, seed])
    p0, low, b = random.uniform(0.02, 0.98), random.uniform(0.2, 0.97), random.uniform()
    width, excess, bend = 10 ** random.uniform(-2, -0.5), 10 ** random.uniform(-3, -1), random.uniform(0, 0.5)
    angle, soft = random.choice([0.0, 1.0, random.uniform()], p=[0.15, 0.25, 0.6]), random.uniform() < 0.3

    def family(p: Any) -> Any:
        def f(wi: Any, wo: Any) -> Any:
            t = 2 / jnp.pi * jnp.arccos(jnp.clip(wi[..., 2], -1, 1))
            inside = low + (1 + excess - low) * jnp.exp(-(((t - angle) / width) ** 2))
            outside = 0.999 - bend * (t - b) ** 2
            weight = jnp.exp(-(((p - p0) / 0.005) ** 2)) if soft else jnp.where(abs(p - p0) < 0.005, 1.0, 0.0)
            return (outside + (inside - outside) * weight) / jnp.pi + 0 * wo[..., 2]

        return f

    return family, 1 + excess


@pytest.mark.parametrize("seed", few(range(40), (1, 3)))
def test_another_albedo_in_a_narrow_range_is_found(seed: int) -> None:
    family, truth = albedo_in_a_window(seed)
    report = check_family(Family("window", family, {"p": (0.0, 1.0)}), intervals=False)
    assert report.verdict is Verdict.VIOLATES
    assert abs(report.albedo - truth) <= report.error + 1e-12


def unresolved_ring(wi: Any, wo: Any) -> Any:
    width = 0.049
    return jnp.exp(-((wo[..., 2] ** 2 - 0.46) ** 2) / (2 * width**2)) / (np.pi * width * np.sqrt(2 * np.pi)) + 0 * wi[..., 2]


def reciprocal_ripple(wi: Any, wo: Any) -> Any:
    return (1 + 0.5 * jnp.cos(16 * jnp.pi * (wo[..., 2] ** 2 - wi[..., 2] ** 2))) / jnp.pi


def plain_ground(wi: Any, wo: Any) -> Any:
    """Brightest at an oblique angle."""
    return (1 - 0.05 * (wi[..., 2] - 0.64) ** 2) / jnp.pi + 0 * wo[..., 2]


@pytest.mark.parametrize(
    ("ground", "p0", "half", "n"),
    [
        (unresolved_ring, 0.344, 0.005, 16.0),
        pytest.param(plain_ground, 0.3589, 0.005, 30.0, marks=pytest.mark.slow),
        pytest.param(unresolved_ring, 0.169, 0.1, 16.0, marks=pytest.mark.slow),
        pytest.param(reciprocal_ripple, 0.344, 0.005, 16.0, marks=pytest.mark.slow),
        pytest.param(reciprocal_ripple, 0.456, 0.1, 16.0, marks=pytest.mark.slow),
    ],
)
def test_a_lobe_in_a_narrow_range_is_found_whatever_is_beside_it(ground: Any, p0: float, half: float, n: float) -> None:
    """The quick rules do not resolve ring and ripple, whose albedo is 0.999; the lobe's is above 1 near the normal only."""

    def family(p: Any) -> Any:
        def f(wi: Any, wo: Any) -> Any:
            c = wi[..., 2] * wo[..., 2] - wi[..., 0] * wo[..., 0] - wi[..., 1] * wo[..., 1]
            lobe = 1.003 * (n + 2) / (2 * jnp.pi) * jnp.maximum(c, 0) ** n
            return jnp.where(abs(p - p0) < half, lobe, 0.999 * ground(wi, wo))

        return f

    report = check_family(Family("window", family, {"p": (0.0, 1.0)}), intervals=False)
    assert report.verdict is Verdict.VIOLATES
    assert abs(report.albedo - 1.003) <= report.error


@pytest.mark.bench
@pytest.mark.parametrize("seed", range(100, 200))
def test_no_false_verdict_among_thousands(seed: int) -> None:
    """2,900 families; ``pytest -m bench -n 2`` takes some hours."""
    cases = adversarial.cases(len(adversarial.kinds()), seed)
    reports = []
    for case in cases:
        reports.append(checked(case))
        jax.clear_caches()
        gc.collect()
    assert [(case.name, wrong) for case, report in zip(cases, reports, strict=True) if (wrong := fault(case, report))] == []
    assert sum(unclear(case, report) for case, report in zip(cases, reports, strict=True)) <= 0.02 * len(cases) + 1
