"""Verdicts of `check` where they are hard, next to the line: a false one calls a conserving BRDF violating or the reverse."""

from __future__ import annotations

import multiprocessing
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import equinox as eqx
import numpy as np

from _instruments import Unheard
from _instruments.stability.references import LOBES, MICROFACETS, Reference
from brdfcheck.brdf.factors import AbstractFactor, Normalized, exact_factor
from brdfcheck.brdf.family import Family
from brdfcheck.cores import available_cores, bind_thread
from brdfcheck.runtime import double_precision, is_double, use_compilation_cache, use_x64
from brdfcheck.verdict import TOLERANCE, Verdict, check_family, judge

# Lobes with an exact factor whose albedo is largest at normal incidence (the references say so).
_EXACT = tuple(name for name in LOBES if name not in MICROFACETS and "unclamped" not in name and name != "schlick_half")
# Random factors that are judged by one search.
_FACTORS = 10


def false_verdicts(count: int, seed: int = 1) -> dict[str, int]:
    """Verdicts of `check` on `count` random factors within 1e-6 of the exact one: random lobes, random exponent ranges.

    Such a factor, the exact one times 1 + e, conserves if and only if e <= the tolerance, whatever the range: these lobes are
    worst at normal incidence. UNDECIDED is counted apart and is not false, where |e - tolerance| is within the error bar.
    `_FACTORS` of them share a lobe, a range and a search, of the first: with any of them the albedo is the same number at
    every exponent, so that a search with another has nothing else to find.
    """
    random = np.random.default_rng(seed)
    factors = {name: exact_factor(LOBES[name](1.0)) for name in _EXACT}
    found = Counter({"verdicts": 0, "false": 0, "undecided": 0})
    while found["verdicts"] < count:
        few = min(_FACTORS, count - found["verdicts"])
        excesses = random.choice([-1, 1], few) * 10 ** random.uniform(-12, -6, few)
        low = float(10 ** random.uniform(0, 3))
        high = float(low * 10 ** random.uniform(0, 2))
        lobe = _EXACT[int(random.integers(len(_EXACT)))]
        build, factor = LOBES[lobe], _Excess(factors[lobe], 1 + float(excesses[0]))
        family = Family("random factor", lambda n, b=build, factor=factor: Normalized(b(n), factor), {"n": (low, high)})
        report = check_family(family, intervals=bool(random.random() < 0.1))
        for excess in excesses:
            times = (1 + excess) / (1 + excesses[0])
            value, error, least = (times * part for part in (report.albedo, report.error, report.least))
            judged = judge(value, error, least=least, settled=report.settled)
            verdict = report.verdict if times == 1 else judged
            wanted = Verdict.VIOLATES if excess > TOLERANCE else Verdict.CONSERVES
            found["verdicts"] += 1
            found["undecided"] += verdict is Verdict.UNDECIDED
            found["false"] += verdict not in (wanted, Verdict.UNDECIDED)
    return dict(found)


def matrix_verdicts(reference: Reference, seed: int = 1) -> dict[str, int]:
    """Verdicts of `check` in every cell of a reference, one angle each: on the line at 1, and on one close to the albedo.

    The second line is off by a random relative 1e-12 to 1e-6, above or below; where that is less than the radius of the
    reference, any verdict will do. It is left out in single precision, whose error bars are wider. One search is judged on
    both lines, except of facets: at 1, and not below it, a theorem holds for them, which their search makes use of.
    {"verdicts", "false", "undecided"}, in the precision of the caller.
    """
    random = np.random.default_rng(seed)
    found = Counter({"verdicts": 0, "false": 0, "undecided": 0})
    name, build = "m" if reference.lobe in MICROFACETS else "n", LOBES[reference.lobe]
    for (i, j), exact in np.ndenumerate(reference.albedo):
        parameter, mu = float(reference.parameters[i]), float(reference.cosines[j])
        family = Family("cell", lambda **values: build(*values.values()), {name: (parameter, parameter)}, (mu, mu))
        near = exact * (1 + float(random.choice([-1, 1]) * 10 ** random.uniform(-12, -6))) - 1
        report = check_family(family, intervals=False)
        verdicts = {TOLERANCE: report.verdict}
        if is_double() and reference.lobe in MICROFACETS:
            verdicts[near] = check_family(family, tolerance=near, intervals=False).verdict
        elif is_double():
            verdicts[near] = judge(report.albedo, report.error, near, least=report.least, settled=report.settled)
        for tolerance, verdict in verdicts.items():
            wanted = Verdict.VIOLATES if exact > 1 + tolerance else Verdict.CONSERVES
            known = abs(exact - 1 - tolerance) > reference.radius[i, j] + 4e-16 * exact
            found["verdicts"] += 1
            found["undecided"] += verdict is Verdict.UNDECIDED
            found["false"] += bool(known and verdict not in (wanted, Verdict.UNDECIDED))
    return dict(found)


def all_verdicts(references: Sequence[Reference], factors: int, processes: int = 2) -> dict[str, dict[str, int]]:
    """`matrix_verdicts` of all references in both precisions, and `false_verdicts` of so many factors, in float64.

    {"factors", "matrix, float64", "matrix, float32"}: what they count, summed. `processes`: started for this and ended with
    it; with 1 the caller's own does it all.
    """
    at_once = 125
    counts = [min(at_once, factors - start) for start in range(0, factors, at_once)]
    tasks: list[tuple[str, Any, int]] = [("factors", count, seed) for seed, count in enumerate(counts, 1)]
    tasks += [(f"matrix, {kind}", one, seed) for kind in ("float64", "float32") for seed, one in enumerate(references, 1)]
    found = {kind: Counter[str]() for kind, *_ in tasks}
    if processes == 1:
        results = list(map(_counts, tasks))
    else:
        start = multiprocessing.get_context("spawn")
        cores, mine = start.SimpleQueue(), available_cores()
        for place in range(processes):
            cores.put(mine[place % len(mine)])
        with ProcessPoolExecutor(processes, mp_context=start, initializer=_begin, initargs=(cores,)) as pool:
            with Unheard():
                counted = pool.map(_counts, tasks)
            results = list(counted)
    for (kind, *_), result in zip(tasks, results, strict=True):
        found[kind].update(result)
    return {kind: dict(counter) for kind, counter in found.items()}


def _begin(cores: Any) -> None:
    """A core for each process: XLA then starts one thread, and processes do not wait for each other's."""
    bind_thread(cores.get())
    use_x64()
    use_compilation_cache()


def _counts(task: tuple[str, Any, int]) -> dict[str, int]:
    kind, what, seed = task
    if kind == "factors":
        return false_verdicts(what, seed)
    with double_precision(kind.endswith("float64")):
        return matrix_verdicts(what, seed)


class _Excess(AbstractFactor):
    """A factor times a number near 1."""

    factor: Any
    times: Any

    def __call__(self, n: Any) -> Any:
        return self.times * _compiled(self.factor, n)


@eqx.filter_jit
def _compiled(factor: AbstractFactor, n: Any) -> Any:
    """A factor as one program for all who check it: exact ones are dozens of operations."""
    return factor(n)
