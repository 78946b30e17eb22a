"""A ladder of factor forms, from the cheapest to the tightest: what each costs and how much energy it loses.

constant, n/B, (n+A)/B, rational of degrees (2,1) and (3,2), closed form. All but the closed form are the minimax factors of
their form, so no other factor of the form loses less. The cost is that of the factor alone, counted in operations of its traced
program and measured inside one fused program over many exponents.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.factors import AbstractFactor, exact_factor
from brdfcheck.cores import on_one_core
from brdfcheck.fits.factor import fit_form
from brdfcheck.fits.minimax import spread
from brdfcheck.fits.raw import RawAlbedo
from brdfcheck.operations import operations as counted
from brdfcheck.runtime import double_precision
from brdfcheck.verdict import Report, Verdict, check_family

FORMS: tuple[tuple[str, tuple[int, ...]], ...] = (
    ("constant", (0, 0)),
    ("n/B", (1, 0, 1)),
    ("(n+A)/B", (1, 0)),
    ("rational 2/1", (2, 1)),
    ("rational 3/2", (3, 2)),
)
CLOSED_FORM = "closed form"

_EXPONENTS = 1_000_000
_REPEATS = 7


@dataclass(frozen=True)
class Rung:
    """One form of factor for one lobe.

    `constants`: how many numbers it holds. `operations`: arithmetic operations and elementary functions an evaluation takes.
    `nanoseconds`: measured for one evaluation in a fused program (NaN where it was not measured). `smallest`: the smallest
    albedo at normal incidence, at `smallest_n`; `lost` = 1 - smallest, the largest share of light lost there.
    """

    form: str
    factor: AbstractFactor
    constants: int
    operations: int
    nanoseconds: float
    smallest: float
    smallest_n: float
    peak: float
    verdict: Verdict

    @property
    def lost(self) -> float:
        """The largest share of the light that is lost at normal incidence; never below 0."""
        return max(1 - self.smallest, 0.0)


def factor_ladder(family: Any, n: tuple[float, float] = (1, 1000), *, measure: bool = True) -> tuple[Rung, ...]:
    """The rungs for a lobe on a range of exponents, cheapest form first; lobes without a closed form have one rung less.

    `family`, `n` and errors as for `fit_factor`. `measure`: time the factors too (about 0.1 s each).
    """
    with double_precision():
        raw = RawAlbedo(family, n)

        def rung(form: str, factor: AbstractFactor, smallest: float, smallest_n: float, report: Report) -> Rung:
            constants = sum(int(np.size(leaf)) for leaf in jax.tree.leaves(eqx.filter(factor, eqx.is_array)))
            nanoseconds = cost(factor, n) if measure else math.nan
            counted = operations(factor)
            return Rung(form, factor, constants, counted, nanoseconds, smallest, smallest_n, report.albedo, report.verdict)

        fits = [(form, fit_form(raw, degrees)) for form, degrees in FORMS]  # pyright: ignore[reportArgumentType]
        rungs = [rung(form, fit.factor, fit.smallest, fit.smallest_n, fit.report) for form, fit in fits]
        exact = exact_factor(raw.lobe) if raw.own else None
        if exact is not None:
            rungs.append(rung(CLOSED_FORM, exact, *raw.lowest(exact), check_family(raw.with_factor(exact))))
        return tuple(rungs)


def operations(factor: AbstractFactor) -> int:
    """Arithmetic operations and elementary functions in one evaluation of a factor, each counted once.

    Counted in the traced program with the constants folded in, as a shader compiler would.
    """
    numbers = jax.tree.map(lambda leaf: np.asarray(leaf).item() if np.ndim(leaf) == 0 else leaf, factor)
    return counted(lambda n: numbers(n)).total()


def cost(factor: Callable[[Any], Any], n: tuple[float, float] = (1, 1000)) -> float:
    """Nanoseconds for one evaluation of a factor in a fused float64 program on one core, over a million exponents: the fastest
    of 7 runs.

    The program sums what it evaluates, so that only arithmetic is timed and not the writing of results; reading the exponents
    is part of it.
    """
    exponents = jnp.asarray(spread(float(n[0]), float(n[1]) if n[1] > n[0] else float(n[0]) + 1, _EXPONENTS))
    program = eqx.filter_jit(lambda factor, n: jnp.sum(factor(n)))
    program(factor, exponents).block_until_ready()
    best = math.inf
    with on_one_core():
        for _ in range(_REPEATS):
            began = time.perf_counter()
            program(factor, exponents).block_until_ready()
            best = min(best, time.perf_counter() - began)
    return best / _EXPONENTS * 1e9
