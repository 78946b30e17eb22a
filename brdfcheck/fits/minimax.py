r"""The factor with E <= 1 everywhere that wastes least: a linear program over infinitely many constraints.

For a factor f = P/Q with polynomials P and Q, raw albedo e(n) at normal incidence and raw ceiling M over any angle,

    maximise t  subject to  f(n) e(n) >= t  and  f(n) M(n) <= 1  for all n.

With Q = 1 this is linear in the coefficients and t, so the optimum is global. With a denominator it is a generalised fractional
program: Dinkelbach's iteration solves it by a few linear programs (Crouzeix, Ferland & Schaible 1985). The continuum of n is
met by exchange (Remez): solve on finitely many exponents, find the extrema of f e between them, add these, solve again.

Knows nothing of lobes or quadrature: raw albedos come in as a callable. The linear programs go to SciPy's HiGHS.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from scipy.optimize import linprog

_EXCHANGES = 12
# An extremum that is refined starts on a grid this fine and shrinks by _ZOOM a round.
_ZOOM = 8
# Extrema of each kind that are looked at.
_MOST = 4
# A form that loses less than this is not made richer: what a further coefficient would win is lost to rounding.
_NOTHING = 1e-9
# How near to the range the zero of a line may lie, in parts of its end: nearer, nothing is left of n + A but rounding.
_NEAREST_ZERO = 1e-8


@dataclass(frozen=True)
class Ceiling:
    """Raw albedos M that the factor must keep at or below 1 at the exponents n (both (points,))."""

    n: np.ndarray
    albedo: np.ndarray


@dataclass(frozen=True)
class Rational:
    """Coefficients of P and Q from the lowest power on, and the smallest and largest f e on the range."""

    numerator: np.ndarray
    denominator: np.ndarray
    smallest: float
    largest: float

    def __call__(self, n: np.ndarray) -> np.ndarray:
        return np.polyval(self.numerator[::-1], n) / np.polyval(self.denominator[::-1], n)


def spread(low: float, high: float, count: int) -> np.ndarray:
    """`count` exponents from low to high, even in log(1+n), the ends exact."""
    n = np.expm1(np.linspace(np.log1p(low), np.log1p(high), count if high > low else 1))
    n[0], n[-1] = low, high
    return np.clip(n, low, high)


def extrema(
    curve: Callable[[np.ndarray], np.ndarray], grid: np.ndarray, values: np.ndarray, rounds: int
) -> tuple[np.ndarray, np.ndarray]:
    """Local maxima and minima (at most four of each) of a curve known on a rising grid, refined by zooming: (n, value).

    Zooming needs no derivative, so a kink is found as well as a smooth extremum.
    """
    found_n, found_value = [], []
    for sign in (1, -1):
        signed = np.concatenate([[-np.inf], sign * values, [-np.inf]])
        peaks = np.flatnonzero((signed[1:-1] >= signed[:-2]) & (signed[1:-1] >= signed[2:]))
        peaks = peaks[np.argsort(-sign * values[peaks])][:_MOST]
        low, high = grid[np.maximum(peaks - 1, 0)], grid[np.minimum(peaks + 1, len(grid) - 1)]
        best_n, best = grid[peaks], sign * values[peaks]
        for _ in range(rounds):
            trial = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, 2 * _ZOOM + 1)
            sample = sign * curve(trial.ravel()).reshape(trial.shape)
            top = np.argmax(sample, axis=1)
            rows = np.arange(len(peaks))
            better = sample[rows, top] > best
            best, best_n = np.where(better, sample[rows, top], best), np.where(better, trial[rows, top], best_n)
            low, high = trial[rows, np.maximum(top - 1, 0)], trial[rows, np.minimum(top + 1, 2 * _ZOOM)]
        found_n.append(best_n)
        found_value.append(sign * best)
    return np.concatenate(found_n), np.concatenate(found_value)


def best_rational(
    raw: Callable[[np.ndarray], np.ndarray],
    grid: np.ndarray,
    degrees: tuple[int, int] | tuple[int, int, int],
    ceiling: Ceiling | None = None,
    *,
    rounds: int = 8,
) -> tuple[Rational, list[Rational]]:
    """The best factor P/Q of degrees (p, q), and the steps that led there.

    `raw`: exponents (points,) -> raw albedo at normal incidence, > 0. `grid`: rising exponents to begin with, from one end
    of the range to the other. `ceiling`: further raw albedos that must stay at or below 1. (p, q, r): P starts at the power r.
    Raises ValueError where a raw albedo is not finite and > 0.
    """
    p, q, lowest = (*degrees, 0)[:3]
    n, albedo = grid, raw(grid)
    if not np.all(np.isfinite(albedo) & (albedo > 0)):
        wrong = np.flatnonzero(~(np.isfinite(albedo) & (albedo > 0)))[0]
        raise ValueError(f"the raw albedo must be finite and > 0 to be normalised; it is {albedo[wrong]:g} at n={n[wrong]:g}")
    basis = _Basis(float(grid[0]), float(grid[-1]))
    above = Ceiling(np.zeros(0), np.zeros(0)) if ceiling is None else ceiling
    steps: list[Rational] = []
    for _ in range(_EXCHANGES):
        found = _solve(basis, n, albedo, above, p, q, lowest)
        numerator, denominator = basis.powers(found[0], p + 1, lowest), basis.powers(found[1], q + 1)
        trial = Rational(numerator, denominator, 0, 0)
        order = np.argsort(n)
        normalised = (trial(n) * albedo)[order]
        place, value = extrema(lambda at, trial=trial: trial(at) * raw(at), n[order], normalised, rounds)
        low, high = int(np.argmin(value)), int(np.argmax(value))
        steps.append(Rational(numerator, denominator, value[low], value[high]))
        new = ~np.isin(place, n)
        n, albedo = np.concatenate([n, place[new]]), np.concatenate([albedo, (value / trial(place))[new]])
        if value[high] <= normalised.max() + 1e-12 and value[low] >= normalised.min() * (1 - 1e-12):
            break
    return steps[-1], steps


@dataclass(frozen=True)
class _Basis:
    r"""Polynomials on [low, high] as sums of $u^i v^{d-i}$, where u = c (n - low)/(high - low), v = (high - n)/(high - low).

    They are positive between the ends and never nearly alike, however narrow the range. c = sqrt((1 + high)/(1 + low)) puts
    the place where u = v at the geometric mean, so that a range of many decades is resolved at both ends.
    """

    low: float
    high: float

    def parts(self, n: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        width = self.high - self.low
        return np.sqrt((1 + self.high) / (1 + self.low)) * (n - self.low) / width, (self.high - n) / width

    def __call__(self, n: np.ndarray, degree: int, over: int, lowest: int = 0) -> np.ndarray:
        """n^lowest u^i v^(degree - lowest - i) / (u + v)^over: shape (points, degree - lowest + 1)."""
        u, v = self.parts(n)
        powers = np.arange(degree - lowest + 1)
        terms = u[:, None] ** powers * v[:, None] ** powers[::-1]
        return terms * (n**lowest / (u + v) ** over)[:, None]

    def powers(self, coefficients: np.ndarray, count: int, lowest: int = 0) -> np.ndarray:
        """Coefficients of 1, n, n^2, ... from those of this basis, filled up with zeros to `count`."""
        # In powers of n - low first: coefficients there are differences of like numbers; only the last step adds large ones.
        width = self.high - self.low
        u, v = Polynomial([0, np.sqrt((1 + self.high) / (1 + self.low)) / width]), Polynomial([1, -1 / width])
        last = len(coefficients) - 1
        terms = (math.prod([u] * i + [v] * (last - i), start=Polynomial([part])) for i, part in enumerate(coefficients))
        total, x = Polynomial([0.0]), Polynomial([-self.low, 1.0])
        for part in sum(terms, Polynomial([0.0])).coef[::-1]:
            total = total * x + part
        found = np.zeros(count)
        found[lowest : lowest + len(total)] = total.coef
        return found


def _solve(
    basis: _Basis, n: np.ndarray, albedo: np.ndarray, above: Ceiling, p: int, q: int, lowest: int
) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of P and Q in `basis` that are best on finitely many exponents; fewer where fewer lose nothing."""
    roof_n = np.concatenate([n, above.n])
    # Both polynomials are divided by (u + v)^q, so that Q is of order 1. Each column of P alone just keeps the roof at 1:
    # the program's numbers are of order 1 whatever the albedo spans.
    top, roof = basis(n, p, q, lowest), basis(roof_n, p, q, lowest)
    roof = roof * np.concatenate([albedo, above.albedo])[:, None]
    column = roof.max(axis=0)
    top, roof = top * albedo[:, None] / column, roof / column
    if q == 0:  # linear: variables are the scaled coefficients of P, and t
        # The sum of all columns has a smallest albedo between t and a small multiple of it: the unit of t.
        level = top.sum(axis=1)
        unit = level.min()
        if unit == 0:  # a factor n/B at n = 0
            return np.ones(top.shape[1]) / (top.shape[1] * column), np.ones(1)
        rows = np.block([[-top / unit, np.ones((len(n), 1))], [roof, np.zeros((len(roof), 1))]])
        rows[: len(n)] *= (unit / level)[:, None]
        # Between the ends of the range a line is positive where its two coefficients are.
        limits = (0, 1) if top.shape[1] <= 2 else (None, None)
        apart = _apart(basis, column) if (lowest, p) == (0, 1) else np.zeros((0, rows.shape[1]))
        solution = linear_program(
            objective=np.r_[np.zeros(top.shape[1]), -1],
            rows=np.concatenate([rows, apart]),
            bounds=np.r_[np.zeros(len(n)), np.ones(len(roof)), np.zeros(len(apart))],
            limits=[limits] * top.shape[1] + [(0, None)],
        )
        if solution is None:
            raise ValueError(
                f"the linear program for the factor was not solved (raw albedo {albedo.min():g} to {albedo.max():g})"
            )
        return solution[:-1] / column, np.ones(1)
    # The best factor of lower degrees is where Dinkelbach's iteration starts; times (u + v) it has these degrees.
    lower = _solve(basis, n, albedo, above, p - 1, q - 1, lowest)
    numerator, denominator = (np.convolve(part, [1, 1]) for part in lower)
    if len(numerator) <= p - lowest or len(denominator) <= q:
        return lower  # which was good enough for the degree below
    bottom, roof_bottom = basis(n, q, q), basis(roof_n, q, q)
    weight = bottom @ denominator
    reached = top @ (numerator * column) / weight
    t = reached.min()
    if t > 1 - _NOTHING:
        return lower
    scale = (t / reached / weight)[:, None]
    for _ in range(30):
        # With the denominators of the step before as weights it converges superlinearly.
        solution = linear_program(
            objective=np.r_[np.zeros(top.shape[1] + q + 1), -1],
            rows=np.block(
                [
                    [-top / t * scale, bottom * scale, weight[:, None] * scale],
                    [roof, -roof_bottom, np.zeros((len(roof), 1))],
                ]
            ),
            bounds=np.zeros(len(n) + len(roof)),
            limits=[(None, None)] * top.shape[1] + [(-1, 1)] * (q + 1) + [(None, None)],
        )
        if solution is None:
            break
        upper, lower = top @ solution[: top.shape[1]], bottom @ solution[top.shape[1] : -1]
        if not np.all(lower > 1e-9 * lower.max()) or np.min(upper / lower) <= t * (1 + 1e-13):
            break
        reached, weight = upper / lower, lower
        t = reached.min()
        scale = (t / reached / weight)[:, None]
        numerator, denominator = solution[: top.shape[1]] / column, solution[top.shape[1] : -1]
    return numerator, denominator


def _apart(basis: _Basis, column: np.ndarray) -> np.ndarray:
    """Rows that keep the zero of a line a little away from the range: |slope| end <= value / _NEAREST_ZERO at both ends."""
    ends = np.array([basis.low, basis.high])
    values = basis(ends, 1, 0) / column
    slope = (values[1] - values[0]) / (basis.high - basis.low)
    rows = np.array([slope, -slope]) * ends[:, None] * _NEAREST_ZERO - values
    return np.pad(rows / np.abs(rows).max(axis=1, keepdims=True), ((0, 0), (0, 1)))


def linear_program(objective: np.ndarray, rows: np.ndarray, bounds: np.ndarray, limits: list[Any]) -> np.ndarray | None:
    """The x with the least objective . x where rows @ x <= bounds, each within its `limits`; None where the solver gives up."""
    exact = {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10}
    return linprog(objective, A_ub=rows, b_ub=bounds, bounds=limits, method="highs-ds", options=exact).x
