r"""The largest albedo of a family over a box of parameters and angles: a continuous maximum, with an error bar.

A grid finds where to look; no direction and no parameter is assumed to be the worst. Around each local maximum of the
grid the albedo is sampled on Chebyshev points of a small box, and Newton's method on the derivatives of the
interpolating polynomial moves the box, which shrinks until it holds the maximum to rounding. The polynomial costs no
compilation and serves every engine alike, also functions that have no derivative.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.polynomial import chebyshev

from brdfcheck.pointwise import PointwiseAlbedo


@dataclass(frozen=True)
class Supremum:
    """Where the albedo of a family is largest.

    `value` +- `error` is the largest albedo, `parameters`, `cos_theta` and `azimuth` (radians) say where. `above` are the
    intervals of the single parameter in which some angle exceeds `threshold` (None where they were not looked for).
    """

    value: float
    error: float
    parameters: dict[str, float]
    cos_theta: float
    azimuth: float
    threshold: float
    above: tuple[tuple[float, float], ...] | None = field(default=None)


class _Axis:
    """One direction of the box, as a map from the unit interval. Lengths of ratio > 20 run geometrically."""

    def __init__(self, low: float, high: float, count: int, power: int = 1):
        self.low, self.high, self.power = low, high, power
        self.geometric = low > 0 and high / low > 20 and power == 1
        self.count = count if high > low else 1
        self.unit = np.linspace(0, 1, self.count) if self.count > 1 else np.zeros(1)

    def at(self, unit: np.ndarray) -> np.ndarray:
        if self.geometric:
            return np.clip(self.low * (self.high / self.low) ** unit, self.low, self.high)
        if self.power != 1:  # dense at the lower end
            low, high = self.low ** (1 / self.power), self.high ** (1 / self.power)
            inside = np.clip((low + (high - low) * unit) ** self.power, self.low, self.high)
            return np.where(unit >= 1, self.high, inside)  # the end itself, not its rounding
        return np.clip(self.low + (self.high - self.low) * unit, self.low, self.high)


class _Box:
    """The box of parameters, cosine and azimuth as a unit cube."""

    def __init__(self, albedo: PointwiseAlbedo, counts: tuple[int, int, int]):
        family = albedo.family
        self.albedo = albedo
        self.axes = [_Axis(low, high, counts[0]) for low, high in family.ranges.values()]
        self.axes.append(_Axis(*family.cos_theta, counts[1], power=2))
        # Opposite azimuths of incidence are different for a general BRDF: the whole turn.
        self.axes.append(_Axis(0.0, 2 * np.pi if albedo.anisotropic else 0.0, counts[2]))
        self.free = [i for i, axis in enumerate(self.axes) if axis.count > 1]

    def physical(self, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        columns = np.stack([axis.at(unit[:, i]) for i, axis in enumerate(self.axes)], axis=1)
        return columns[:, :-2], columns[:, -2], columns[:, -1]

    def __call__(self, unit: np.ndarray, rtol: float | None) -> tuple[np.ndarray, np.ndarray]:
        return self.albedo(*self.physical(unit), rtol=rtol)

    def grid(self) -> np.ndarray:
        return np.array(list(product(*(axis.unit for axis in self.axes))))

    def step(self) -> np.ndarray:
        return np.array([1 / max(axis.count - 1, 1) for axis in self.axes])


@dataclass(frozen=True)
class _Effort:
    """How finely to look: what an engine's evaluations cost decides."""

    counts: tuple[int, int, int]  # grid points a parameter, in cosine, in azimuth
    starts: int
    rounds: int
    points: int  # Chebyshev points an axis
    grid_rtol: float | None
    refine_rtol: float | None
    rtol: float | None


def _effort(albedo: PointwiseAlbedo) -> _Effort:
    # One accuracy for engines 1 and 2: a second one would be a second program to compile.
    size = min(len(albedo.names), 3)
    if albedo.engine == "zonal":
        counts = [(1, 65, 1), (41, 25, 1), (13, 17, 1), (7, 13, 1)][size]
        return _Effort(counts, 6, 8, [9, 6, 4, 3][size], None, None, None)
    if albedo.engine == "half-vector":
        counts = [(1, 33, 1), (13, 15, 1), (7, 9, 1), (4, 7, 1)][size]
        return _Effort(counts, 4, 6, [9, 4, 3, 3][size], None, None, None)
    counts = [(1, 17, 8), (9, 9, 4), (5, 7, 3), (3, 5, 3)][size]
    return _Effort(counts, 2, 4, 5 if size + albedo.anisotropic < 2 else 3, 1e-5, 1e-7, 1e-9)


def _local_maxima(values: np.ndarray, most: int) -> np.ndarray:
    """Flat indices of grid points that no neighbour exceeds, the largest first."""
    padded = np.pad(values, 1, constant_values=-np.inf)
    inner = tuple(slice(1, -1) for _ in values.shape)
    peak = np.ones(values.shape, bool)
    for axis in range(values.ndim):
        for shift in (-1, 1):
            peak &= values >= np.roll(padded, shift, axis)[inner]
    candidates = np.flatnonzero(peak)
    return candidates[np.argsort(values.ravel()[candidates])[::-1]][:most]


def _lobatto(count: int) -> np.ndarray:
    return -np.cos(np.pi * np.arange(count) / (count - 1))


def _climb(coefficients: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, float]:
    """The maximum of a tensor Chebyshev polynomial on [-1, 1]^d near `start`: projected Newton. (place, value)."""
    size, dimension = coefficients.shape[0], coefficients.ndim
    unit = np.eye(size)
    derivative = np.array([np.pad(chebyshev.chebder(row), (0, 1)) for row in unit])[:, :size]
    second = derivative @ derivative

    def basis(x: np.ndarray) -> np.ndarray:
        values = chebyshev.chebvander(x, size - 1)
        return np.stack([values, values @ derivative.T, values @ second.T])  # (order, d, size)

    def contract(rows: list[np.ndarray]) -> float:
        result = coefficients
        for row in rows:
            result = np.tensordot(row, result, axes=(0, 0))
        return float(result)

    x = start.copy()
    table = basis(x)
    best = contract(list(table[0]))
    for _ in range(12):
        gradient = np.array([contract([table[int(i == j), j] for j in range(dimension)]) for i in range(dimension)])
        hessian = np.array(
            [
                [contract([table[int(i == k) + int(j == k), k] for k in range(dimension)]) for j in range(dimension)]
                for i in range(dimension)
            ]
        )
        # Directions that press against the box are fixed; the rest takes a Newton step that is made to climb.
        free = ~(((x <= -1) & (gradient < 0)) | ((x >= 1) & (gradient > 0)))
        if not np.any(free) or np.all(np.abs(gradient[free]) <= 1e-15 * (1 + abs(best))):
            break
        eigenvalues, vectors = np.linalg.eigh(hessian[np.ix_(free, free)])
        curvature = np.maximum(np.abs(eigenvalues), 1e-14 * (1 + abs(best)))
        move = np.zeros(dimension)
        move[free] = vectors @ ((vectors.T @ gradient[free]) / curvature)
        for shrink in (1, 0.5, 0.25, 0.0625):
            trial = np.clip(x + shrink * move, -1, 1)
            trial_table = basis(trial)
            value = contract(list(trial_table[0]))
            if value > best:
                x, best, table = trial, value, trial_table
                break
        else:
            break
    return x, best


def _refine(box: _Box, starts: np.ndarray, rounds: int, points: int, rtol: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Follow local maxima from grid points. Returns (points in the unit cube, gaps): how much higher a maximum may be."""
    free = box.free
    dimension = len(free)
    if dimension == 0:
        return starts, np.zeros(len(starts))
    nodes = _lobatto(points)
    lattice = np.array(list(product(nodes, repeat=dimension)))
    inverse = np.linalg.inv(chebyshev.chebvander(nodes, points - 1))
    centers, gaps = starts.copy(), np.zeros(len(starts))
    half = np.tile(box.step()[free], (len(starts), 1))
    best = np.full(len(starts), -np.inf)
    active, settled = np.ones(len(starts), bool), np.zeros(len(starts), int)
    for _ in range(rounds):
        which = np.flatnonzero(active)
        # A maximum that stays clearly below another one cannot win any more.
        hopeless = best[which] + 10 * gaps[which] < np.max(best) - 1e-6 * abs(np.max(best))
        active[which[hopeless]] = False
        which = which[~hopeless]
        if which.size == 0:
            break
        low = np.clip(centers[which][:, free] - half[which], 0, 1)
        high = np.clip(centers[which][:, free] + half[which], 0, 1)
        local = low[:, None] + (high - low)[:, None] * (1 + lattice) / 2
        unit = np.repeat(centers[which][:, None], len(lattice), axis=1)
        unit[:, :, free] = local
        values, errors = box(unit.reshape(-1, unit.shape[-1]), rtol)
        values, errors = (part.reshape(len(which), len(lattice)) for part in (values, errors))
        for row, index in enumerate(which):
            sample = values[row]
            if not np.all(np.isfinite(sample)):
                active[index] = False
                continue
            top = int(np.argmax(sample))
            coefficients = sample.reshape((points,) * dimension)
            for _axis in range(dimension):
                coefficients = np.moveaxis(np.tensordot(inverse, coefficients, axes=(1, _axis)), 0, _axis)
            place, predicted = _climb(coefficients, lattice[top])
            if sample[top] >= best[index]:
                best[index] = sample[top]
                centers[index, free] = local[row, top]
            gaps[index] = max(predicted - best[index], 0.0)
            centers_new = low[row] + (high[row] - low[row]) * (1 + place) / 2
            wall = np.any(((place <= -1) & (centers_new > 0)) | ((place >= 1) & (centers_new < 1)))
            if predicted > sample[top]:
                centers[index, free] = centers_new
            half[index] *= 0.7 if wall else 0.15
            # What is left to gain is a small part of the error bar, twice in a row, as the box moved or shrank.
            settled[index] = settled[index] + 1 if gaps[index] <= 0.02 * errors[row, top] else 0
            active[index] = settled[index] < 2
    return centers, gaps


def supremum(
    albedo: PointwiseAlbedo, *, threshold: float = 1 + 1e-9, intervals: bool = True, rtol: float | None = None
) -> Supremum:
    """The largest albedo of the family behind `albedo` over its box of parameters, cosines and azimuths.

    `intervals`: for a family of one parameter whose albedo exceeds `threshold`, also find where it does. A value that is
    not finite is returned as such, at the first place where it occurs.
    """
    effort = _effort(albedo)
    rtol = rtol or effort.rtol
    parameters = len(albedo.names)
    counts = effort.counts
    box = _Box(albedo, counts)
    grid = box.grid()
    values, errors = box(grid, effort.grid_rtol)
    broken = np.isnan(values)
    if np.any(broken) or np.any(np.isinf(values)):
        index = int(np.flatnonzero(broken | np.isinf(values))[0])
        best, peak, error = grid[index], float(values[index]), float(errors[index])
    else:
        starts = grid[_local_maxima(values.reshape([axis.count for axis in box.axes]), effort.starts)]
        centers, gaps = _refine(box, starts, effort.rounds, effort.points, effort.refine_rtol)
        candidates = np.concatenate([centers, starts])
        finals, final_errors = box(candidates, rtol)
        index = int(np.argmax(np.where(np.isnan(finals), np.inf, finals)))
        best, peak = candidates[index], float(finals[index])
        gap = float(np.max(np.where(gaps + finals[: len(gaps)] > peak, gaps + finals[: len(gaps)] - peak, 0)))
        error = float(final_errors[index]) + gap
    where, cosines, azimuths = box.physical(best[None])
    above = None
    if intervals and albedo.fast and parameters == 1 and not np.isnan(peak):
        above = _above(box, best, threshold) if peak - error > threshold else ()
    names = {name: float(value) for name, value in zip(albedo.names, where[0], strict=True)}
    return Supremum(peak, error, names, float(cosines[0]), float(azimuths[0]), threshold, above)


def _ridge(box: _Box, unit: np.ndarray) -> np.ndarray:
    """The largest albedo over all cosines at given values of the first axis (unit), refined by shrinking sweeps."""
    fixed = box.axes[1].count == 1
    low, high = np.zeros(len(unit)), np.ones(len(unit))
    best = np.full(len(unit), -np.inf)
    for _ in range(1 if fixed else 4):
        cosines = low[:, None] + (high - low)[:, None] * np.linspace(0, 1, 1 if fixed else 13)
        points = np.zeros((*cosines.shape, len(box.axes)))
        points[..., 0], points[..., 1] = unit[:, None], cosines
        values, _ = box(points.reshape(-1, points.shape[-1]), None)
        values = np.where(np.isnan(values), np.inf, values).reshape(cosines.shape)
        top = np.argmax(values, axis=1)
        rows = np.arange(len(unit))
        best = np.maximum(best, values[rows, top])
        center, width = cosines[rows, top], (high - low) / 12
        low, high = np.clip(center - width, 0, 1), np.clip(center + width, 0, 1)
    return best


def _above(box: _Box, peak: np.ndarray, threshold: float) -> tuple[tuple[float, float], ...]:
    """The intervals of the first axis on which the largest albedo over all angles exceeds `threshold`."""
    unit = np.unique(np.append(np.linspace(0, 1, 49 if box.albedo.engine == "zonal" else 17), peak[0]))
    exceeds = _ridge(box, unit) > threshold
    exceeds[unit == peak[0]] = True
    crossings = np.flatnonzero(exceeds[1:] != exceeds[:-1])
    low, high = unit[crossings], unit[crossings + 1]
    for _ in range(9 if crossings.size else 0):
        trial = low[:, None] + (high - low)[:, None] * np.arange(1, 8) / 8
        inside = (_ridge(box, trial.ravel()) > threshold).reshape(trial.shape) == exceeds[crossings][:, None]
        steps = np.where(inside.all(axis=1), 7, np.argmin(inside, axis=1))
        width = (high - low) / 8
        low, high = low + steps * width, low + (steps + 1) * width
    edges = list((low + high) / 2)
    if exceeds[0]:
        edges.insert(0, 0.0)
    if exceeds[-1]:
        edges.append(1.0)
    values = box.axes[0].at(np.array(edges))
    return tuple((float(a), float(b)) for a, b in zip(values[::2], values[1::2], strict=True))
