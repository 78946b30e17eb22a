r"""The factor with E <= 1 everywhere that wastes least: a linear program over infinitely many constraints.

For a factor f = P/Q with polynomials P and Q, raw albedo e(n) at normal incidence and raw ceiling M over any angle,

    maximise t  subject to  f(n) e(n) >= t  and  f(n) M(n) <= 1  for all n.

With Q = 1 this is linear in the coefficients and t, so the optimum is global. With a denominator it is a generalised fractional
program: Dinkelbach's iteration solves it by a few linear programs (Crouzeix, Ferland & Schaible 1985). The continuum of n is
met by exchange (Remez): solve on finitely many exponents, find the extrema of f e between them, add these, solve again.

Knows nothing of lobes or quadrature: raw albedos come in as a callable. The linear programs go to SciPy's HiGHS.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

_EXCHANGES = 12
# An extremum that is refined starts on a grid this fine and shrinks by _ZOOM a round.
_ZOOM = 8
# Raw albedos that differ by more than this are beyond the linear program's accuracy.
_HOPELESS = 1e9


@dataclass(frozen=True)
class Ceiling:
    """Raw albedos M that the factor must keep at or below 1 at the exponents n (both (points,))."""

    n: np.ndarray
    albedo: np.ndarray


@dataclass(frozen=True)
class Rational:
    """Coefficients of P and Q from the lowest power on, and the smallest and largest f e on the range, with their places."""

    numerator: np.ndarray
    denominator: np.ndarray
    smallest: float
    smallest_n: float
    largest: float
    largest_n: float

    def __call__(self, n: np.ndarray) -> np.ndarray:
        return np.polyval(self.numerator[::-1], n) / np.polyval(self.denominator[::-1], n)


def spread(low: float, high: float, count: int) -> np.ndarray:
    """`count` exponents from low to high, even in log(1+n), the ends exact."""
    n = np.expm1(np.linspace(np.log1p(low), np.log1p(high), count if high > low else 1))
    n[0], n[-1] = low, high
    return np.clip(n, low, high)


def extrema(
    curve: Callable[[np.ndarray], np.ndarray], grid: np.ndarray, values: np.ndarray, rounds: int, most: int = 4
) -> tuple[np.ndarray, np.ndarray]:
    """Local maxima and minima (at most so many of each) of a curve known on a rising grid, refined by zooming: (n, value).

    Zooming needs no derivative, so a kink is found as well as a smooth extremum.
    """
    found_n, found_value = [], []
    for sign in (1, -1):
        signed = np.concatenate([[-np.inf], sign * values, [-np.inf]])
        peaks = np.flatnonzero((signed[1:-1] >= signed[:-2]) & (signed[1:-1] >= signed[2:]))
        peaks = peaks[np.argsort(-sign * values[peaks])][:most]
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
    Raises ValueError where no such factor exists.
    """
    lowest = degrees[2] if len(degrees) > 2 else 0
    n, albedo = grid, raw(grid)
    if not np.all(np.isfinite(albedo) & (albedo > 0)):
        wrong = np.flatnonzero(~(np.isfinite(albedo) & (albedo > 0)))[0]
        raise ValueError(f"the raw albedo must be finite and > 0 to be normalised; it is {albedo[wrong]:g} at n={n[wrong]:g}")
    above = Ceiling(np.zeros(0), np.zeros(0)) if ceiling is None else ceiling
    steps: list[Rational] = []
    for _ in range(_EXCHANGES):
        numerator, denominator = _solve(n, albedo, above, (lowest, degrees[0], degrees[1]))
        trial = Rational(numerator, denominator, 0, 0, 0, 0)
        order = np.argsort(n)
        normalised = (trial(n) * albedo)[order]
        place, value = extrema(lambda at, trial=trial: trial(at) * raw(at), n[order], normalised, rounds)
        low, high = int(np.argmin(value)), int(np.argmax(value))
        steps.append(Rational(numerator, denominator, value[low], place[low], value[high], place[high]))
        new = ~np.isin(place, n)
        n, albedo = np.concatenate([n, place[new]]), np.concatenate([albedo, (value / trial(place))[new]])
        if value[high] <= normalised.max() + 1e-12 and value[low] >= normalised.min() - 1e-12:
            break
    return steps[-1], steps


def _solve(n: np.ndarray, albedo: np.ndarray, above: Ceiling, powers: tuple[int, int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of P and Q that are best on finitely many exponents."""
    lowest, p, q = powers
    # Both polynomials are divided by (n + s)^q, so that Q is of order 1 and P e of the order of the albedo.
    scale = np.sqrt(1 + n.max()) if q else 1.0

    def basis(at: np.ndarray, first: int, last: int) -> np.ndarray:
        return at[:, None] ** np.arange(first, last + 1) / (at[:, None] + scale) ** q

    top = basis(n, lowest, p) * albedo[:, None]
    column = np.abs(top).max(axis=0)
    top = top / column
    roof_n = np.concatenate([n, above.n])
    roof_albedo = np.concatenate([albedo, above.albedo])
    roof = basis(roof_n, lowest, p) * roof_albedo[:, None] / column
    if roof_albedo.max() > _HOPELESS * roof_albedo.min():
        # Below the solver's tolerance nothing can be optimised: the constant that keeps the largest albedo at 1.
        return np.r_[1 / roof_albedo.max(), np.zeros(p)], np.r_[1.0, np.zeros(q)]
    if q == 0:  # linear: variables are the scaled coefficients of P, and t
        solution = _program(
            objective=np.r_[np.zeros(top.shape[1]), -1],
            rows=np.block([[-top, np.ones((len(n), 1))], [roof, np.zeros((len(roof), 1))]]),
            bounds=np.r_[np.zeros(len(n)), np.ones(len(roof))],
        )
        return np.r_[np.zeros(lowest), solution[:-1] / column], np.ones(1)
    # The best factor of lower degrees is where Dinkelbach's iteration starts; times (n + s) it has these degrees.
    numerator, denominator = (
        np.polymul(part[::-1], [1, scale])[::-1] for part in _solve(n, albedo, above, (lowest, p - 1, q - 1))
    )
    bottom, roof_bottom = basis(n, 0, q), basis(roof_n, 0, q)
    weight = bottom @ denominator
    t = np.min(basis(n, 0, p) @ numerator * albedo / weight)
    for _ in range(30):
        # With the denominators of the step before as weights it converges superlinearly.
        solution = _program(
            objective=np.r_[np.zeros(top.shape[1] + q + 1), -1],
            rows=np.block(
                [
                    [-top / weight[:, None], t * bottom / weight[:, None], np.ones((len(n), 1))],
                    [roof, -roof_bottom, np.zeros((len(roof), 1))],
                ]
            ),
            bounds=np.zeros(len(n) + len(roof)),
            limits=[(None, None)] * top.shape[1] + [(-1, 1)] * (q + 1) + [(None, None)],
        )
        upper, lower = top @ solution[: top.shape[1]], bottom @ solution[top.shape[1] : -1]
        if not np.all(lower > 1e-9 * lower.max()) or np.min(upper / lower) <= t + 1e-13:
            break
        t, weight = np.min(upper / lower), lower
        numerator, denominator = np.r_[np.zeros(lowest), solution[: top.shape[1]] / column], solution[top.shape[1] : -1]
    return numerator, denominator


def _program(
    objective: np.ndarray, rows: np.ndarray, bounds: np.ndarray, limits: list[tuple[float | None, float | None]] | None = None
) -> np.ndarray:
    result = linprog(
        objective,
        A_ub=rows,
        b_ub=bounds,
        bounds=limits or (None, None),
        method="highs-ds",
        options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    if result.x is None:
        raise ValueError(f"no factor of this form keeps the albedo at or below 1 ({result.message.strip()})")
    return result.x
