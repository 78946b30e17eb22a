r"""Best rational approximation of a surface on a square, and the proof that its denominator has no zero there.

The approximation P(u, v)/Q(u, v), with the powers $u^i v^j$ of $i + j \le$ a degree in each, minimises the largest error on
given points by the differential-correction algorithm (Barrodale, Powell & Roberts 1972): from the error D of an
approximation P'/Q' one linear program, min over P, Q of $\max (|f Q - P| - D Q) / Q'$ with $|q| \le 1$, gives a better one,
and the limit is the best of all approximations on these points. The linear programs go to SciPy's HiGHS.

Positivity: a polynomial lies within the hull of its Bernstein coefficients, so their smallest one is a lower bound; halving
the square makes it sharp. Knows nothing of lobes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import pascal

from brdfcheck.fits.minimax import linear_program

_ROUNDS = 16
_CONVERGED = 2e-3
# Q stays above this on the points, where its largest coefficient is 1: a pole keeps its distance.
_SMALLEST_DENOMINATOR = 0.01
_DIGITS = 9  # of a coefficient: what a float32 can hold
_SUBDIVISIONS = 8


@dataclass(frozen=True)
class Approximation:
    """A best approximation with its largest error on the points; `start` lets another one begin there."""

    surface: RationalSurface
    error: float
    start: tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class RationalSurface:
    """P(u, v)/Q(u, v) on [-1, 1]^2. `numerator[i, j]` belongs to u^i v^j; `denominator[0, 0]` is 1.

    The coefficients are decimals of nine digits, so that a program's text, its float32 and this object agree.
    """

    numerator: Float[np.ndarray, "i j"]
    denominator: Float[np.ndarray, "k l"]

    def __call__(self, u: Float[np.ndarray, "..."], v: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        """The value at `u` and `v`, same shape. Horner in v within Horner in u, as the exported programs do."""
        value = horner(self.numerator, u, v)
        return value if self.denominator.size == 1 else value / horner(self.denominator, u, v)

    @property
    def coefficients(self) -> int:
        """How many numbers a program holds; the constant 1 of the denominator is not counted."""
        return sum(len(row) for row in (*rows(self.numerator), *rows(self.denominator))) - 1

    @property
    def flops(self) -> int:
        """Additions, multiplications and divisions of one evaluation by Horner's rule."""
        both = [rows(part) for part in (self.numerator, self.denominator)]
        return sum(2 * (len(row) - 1) for part in both for row in part) + sum(2 * (len(part) - 1) for part in both) + 1


def rows(coefficients: Float[np.ndarray, "i j"]) -> list[list[float]]:
    """The coefficients of u^0, u^1, ... as polynomials in v, without the zeros of the triangle's other half."""
    total = max((i + j for i, j in zip(*np.nonzero(coefficients), strict=True)), default=0)
    deepest = max((i for i, row in enumerate(coefficients) if np.any(row)), default=0)
    widest = coefficients.shape[1]
    return [[float(value) for value in coefficients[i, : min(widest, total - i + 1)]] for i in range(deepest + 1)]


def horner(coefficients: Float[np.ndarray, "i j"], u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """The polynomial at `u` and `v`, in the order of operations of the exported programs."""

    def one(numbers: list[float]) -> np.ndarray:
        value = np.full(np.shape(v), numbers[-1])
        for number in numbers[-2::-1]:
            value = value * v + number
        return value

    parts = [one(row) for row in rows(coefficients)]
    value = parts[-1]
    for part in parts[-2::-1]:
        value = value * u + part
    return value


def powers(degree: int, varies: tuple[bool, bool] = (True, True)) -> list[tuple[int, int]]:
    """The exponents (i, j) of a polynomial of that total degree, in those of u and v that vary."""
    return [(i, j) for i in range(degree * varies[0] + 1) for j in range((degree - i) * varies[1] + 1)]


def best_surface(
    u: Float[np.ndarray, " points"],
    v: Float[np.ndarray, " points"],
    values: Float[np.ndarray, " points"],
    degree: tuple[int, int],
    *,
    start: Approximation | None = None,
) -> Approximation:
    """The best approximation of `values` on the points, of total degrees `degree` (P, Q). Deterministic.

    `start`: one of the same degrees on fewer of the points, which saves most of the work. Raises ValueError where there are
    fewer points than coefficients or a value is not finite.
    """
    varies = bool(np.any(u != u[0])), bool(np.any(v != v[0]))
    up, down = powers(degree[0], varies), powers(degree[1], varies)
    if len(values) < len(up) + len(down) - 1:
        raise ValueError(f"{len(up) + len(down) - 1} coefficients need at least as many points; got {len(values)}")
    if not np.all(np.isfinite(values)):
        raise ValueError(f"the values must be finite; got {values[~np.isfinite(values)][0]}")
    scale = float(np.max(np.abs(values))) or 1.0
    f = values / scale
    A, B = _chebyshev(u, v, up), _chebyshev(u, v, down)
    corner = np.linspace(-1, 1, 9)
    box = _chebyshev(np.repeat(corner, 9), np.tile(corner, 9), down)
    p = np.linalg.lstsq(A, f, rcond=None)[0]
    q = np.zeros(len(down))
    q[0] = 1.0
    below = np.concatenate([B, box])
    if start is not None and np.min(below @ start.start[1]) > _SMALLEST_DENOMINATOR / 2:
        p, q = start.start[0] / scale, start.start[1]
    error = math.inf
    for _ in range(_ROUNDS):
        Q = B @ q
        last, error = error, float(np.max(np.abs(A @ p / Q - f)))
        if error < 1e-13 or last - error < _CONVERGED * error:
            break
        found = _program(A, B, f, error, Q, below)
        if found is None:
            break
        better = A @ found[0] / (B @ found[1])
        if not np.max(np.abs(better - f)) < error:
            break
        p, q = found
    numerator, denominator = _monomials(p * scale, up), _monomials(q, down)
    surface = RationalSurface(_decimal(numerator / denominator[0, 0]), _decimal(denominator / denominator[0, 0]))
    return Approximation(surface, error * scale, (p * scale, q))


def _program(
    A: np.ndarray, B: np.ndarray, f: np.ndarray, error: float, Q: np.ndarray, below: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """One linear program of the differential correction: (p, q), or None where the solver gives up."""
    numerators, denominators = A.shape[1], B.shape[1]
    zero = np.zeros((len(below), numerators))
    constraints = np.concatenate([
        np.concatenate([-A, (f - error)[:, None] * B, -Q[:, None]], axis=1),
        np.concatenate([A, -(f + error)[:, None] * B, -Q[:, None]], axis=1),
        np.concatenate([zero, -below, np.zeros((len(below), 1))], axis=1),
    ])  # fmt: skip
    bounds = np.concatenate([np.zeros(2 * len(f)), np.full(len(below), -_SMALLEST_DENOMINATOR)])
    cost = np.zeros(numerators + denominators + 1)
    cost[-1] = 1
    limits = [(None, None)] * numerators + [(-1, 1)] * denominators + [(None, 0)]
    solution = linear_program(cost, constraints, bounds, limits)
    return None if solution is None else (solution[:numerators], solution[numerators:-1])


def _chebyshev(u: np.ndarray, v: np.ndarray, exponents: list[tuple[int, int]]) -> np.ndarray:
    """T_i(u) T_j(v), shape (points, exponents): well conditioned where powers are not."""
    degree = max(max(pair) for pair in exponents)
    along_u, along_v = (np.polynomial.chebyshev.chebvander(x, degree) for x in (u, v))
    return np.stack([along_u[:, i] * along_v[:, j] for i, j in exponents], axis=-1)


def _monomials(coefficients: np.ndarray, exponents: list[tuple[int, int]]) -> np.ndarray:
    shape = [1 + max(pair[axis] for pair in exponents) for axis in (0, 1)]
    table = np.zeros(shape)
    for (i, j), value in zip(exponents, coefficients, strict=True):
        table[i, j] = value
    left, right = (_chebyshev_to_powers(size) for size in shape)
    return left.T @ table @ right


def _chebyshev_to_powers(size: int) -> np.ndarray:
    """Row i: the coefficients of T_i."""
    return np.array([np.pad(np.polynomial.chebyshev.cheb2poly([0] * i + [1]), (0, size - 1 - i)) for i in range(size)])


def _decimal(values: np.ndarray) -> np.ndarray:
    return np.vectorize(rounded, otypes=[float])(values)


def rounded(value: float) -> float:
    """`value` as a decimal of nine digits."""
    return float(f"{value:.{_DIGITS}g}")


def lower_bound(coefficients: Float[np.ndarray, "i j"]) -> float:
    """A number that the polynomial is proven not to fall below on [-1, 1]^2; at most a little under its minimum.

    By the Bernstein coefficients of parts of the square, halved where the bound is not positive or far from the values.
    """
    size = [s - 1 for s in coefficients.shape]
    transform = [_powers_to_bernstein(degree) for degree in size]
    pending, bound = [((-1.0, 1.0), (-1.0, 1.0), 0)], math.inf
    while pending:
        (u0, u1), (v0, v1), depth = pending.pop()
        along_u, along_v = _restricted(size[0], u0, u1), _restricted(size[1], v0, v1)
        bernstein = transform[0] @ (along_u @ coefficients @ along_v.T) @ transform[1].T
        smallest = float(np.min(bernstein))
        attained = float(np.min(bernstein[[0, 0, -1, -1], [0, -1, 0, -1]]))  # the values at the corners
        if smallest >= min(0.9 * attained, bound) or depth == _SUBDIVISIONS:
            bound = min(bound, smallest - 1e-12 * float(np.sum(np.abs(coefficients))))
            continue
        u, v = (u0 + u1) / 2, (v0 + v1) / 2
        pending += [(a, b, depth + 1) for a in ((u0, u), (u, u1)) for b in ((v0, v), (v, v1))]
    return bound


def _restricted(degree: int, low: float, high: float) -> np.ndarray:
    """Coefficients on [0, 1] from those on the line: x = low + (high - low) t. Column j: the powers of t in x^j."""
    table = np.zeros((degree + 1, degree + 1))
    for j in range(degree + 1):
        for k in range(j + 1):
            table[k, j] = math.comb(j, k) * low ** (j - k) * (high - low) ** k
    return table


def _powers_to_bernstein(degree: int) -> np.ndarray:
    binomials = np.asarray(pascal(degree + 1, kind="lower"))
    return binomials / binomials[-1]
