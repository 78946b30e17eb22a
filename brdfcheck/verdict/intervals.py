"""Where a family of one parameter violates: the intervals on which the largest albedo over all angles exceeds a threshold."""

from __future__ import annotations

import numpy as np

from brdfcheck.quadrature.pointwise import GRAZING, PointwiseAlbedo
from brdfcheck.verdict.box import Box
from brdfcheck.verdict.scan import Points

# Into how many steps the axis is divided at first, and at how many angles and azimuths each is looked at, in how many sweeps.
_STEPS = 64
_ANGLES = 17
_TURNS = 8
_SWEEPS = 4
# Rounds in which the step that holds an end becomes an eighth. (The quick rules of functions are off by more than the last
# of these tell.)
_ROUNDS, _ROUNDS_OF_FUNCTIONS = 9, 6
# In which steps an end is looked for from where the quick rules see it, and how accurately it is said where the albedo there,
# known to the third of these, is off by the last.
_NEAR, _WIDTH, _RTOL, _OFF = 0.01, 1e-6, 1e-7, 1e-5


def intervals_above(
    albedo: PointwiseAlbedo, box: Box, peak: np.ndarray, points: Points, threshold: float
) -> tuple[tuple[float, float], ...]:
    """The intervals of the first axis of `box` on which some angle exceeds `threshold`.

    `peak`: a place where it does; `points` have been scanned.
    """
    grid = np.linspace(0, 1, _STEPS + 1)
    exceeds = _ridge(albedo, box, grid, peak[None])[0] > threshold
    peaks = _between(albedo, box, points, exceeds, peak, threshold)
    if len(peaks) > 1:  # at whose angles more may exceed it
        exceeds = _ridge(albedo, box, grid, peaks)[0] > threshold
    unit, first = np.unique(np.concatenate([peaks[:, 0], grid]), return_index=True)
    exceeds = np.concatenate([np.ones(len(peaks), bool), exceeds])[first]
    crossings = np.flatnonzero(exceeds[1:] != exceeds[:-1])
    low, high = unit[crossings], unit[crossings + 1]
    for _ in range((_ROUNDS if albedo.fast else _ROUNDS_OF_FUNCTIONS) if crossings.size else 0):
        trial = low[:, None] + (high - low)[:, None] * np.arange(1, 8) / 8
        inside = (_ridge(albedo, box, trial.ravel(), peaks)[0] > threshold).reshape(trial.shape) == exceeds[crossings][:, None]
        steps = np.where(inside.all(axis=1), 7, np.argmin(inside, axis=1))
        width = (high - low) / 8
        low, high = low + steps * width, low + (steps + 1) * width
    outwards = np.where(exceeds[crossings], 1, -1)
    found = _accurate(albedo, box, (low + high) / 2, outwards, peaks, threshold)
    edges = _joined(np.concatenate([np.zeros(int(exceeds[0])), found, np.ones(int(exceeds[-1]))]))
    places = np.tile(peak, (len(edges), 1))
    places[:, 0] = edges
    values = box.physical(places)[0][:, list(box.ranges).index(box.swept[0])]
    return tuple((float(a), float(b)) for a, b in zip(values[::2], values[1::2], strict=True))


def _between(
    albedo: PointwiseAlbedo, box: Box, points: Points, exceeds: np.ndarray, peak: np.ndarray, threshold: float
) -> np.ndarray:
    """The peak, and one scanned point above the threshold in each step of the axis at both ends of which nothing exceeds it."""
    step = np.minimum((points.places[:, 0] * _STEPS).astype(int), _STEPS - 1)
    alone = ~exceeds[step] & ~exceeds[step + 1] & (points.values - points.errors > threshold)
    alone &= step != min(int(peak[0] * _STEPS), _STEPS - 1)
    high = np.flatnonzero(alone)
    high = high[np.argsort(-points.values[high])]
    places = points.places[high[np.unique(step[high], return_index=True)[1]]]
    if len(places):  # by a rule that is sure
        parameters, mu, azimuth = box.physical(places)
        value, error = albedo(parameters, np.maximum(mu, GRAZING), azimuth, rtol=_RTOL)
        places = places[value - error > threshold]
    return np.concatenate([peak[None], places])


def _nearest(peaks: np.ndarray, unit: np.ndarray) -> np.ndarray:
    """The angles of the nearest of some peaks at values of the first axis."""
    return peaks[np.argmin(np.abs(unit[:, None] - peaks[:, 0]), axis=1), 1:]


def _joined(edges: np.ndarray) -> list[float]:
    """The ends of intervals (low, high, low, high, ...) with those that overlap made one."""
    joined: list[float] = []
    for low, high in sorted(zip(edges[::2], edges[1::2], strict=True)):
        if joined and low <= joined[-1]:
            joined[-1] = max(joined[-1], high)
        else:
            joined += [low, max(low, high)]
    return joined


def _accurate(
    albedo: PointwiseAlbedo, box: Box, edges: np.ndarray, outwards: np.ndarray, peaks: np.ndarray, threshold: float
) -> np.ndarray:
    """The ends by albedos with error bars, at the angles that are the worst there, where the quick rules were off.

    These are off by what a jump of the BRDF makes of them, and blind to spots between their nodes: an end is looked for from
    where they see one, in steps that double, as far as the range goes. `outwards`: on which side of each the interval is not.
    """
    if albedo.fast or not edges.size:
        return edges
    from scipy.optimize import brentq  # a fifth of a second, which is for those who need it

    angles = _ridge(albedo, box, edges, peaks)[1]
    found = edges.copy()
    for index, (edge, angle, outward) in enumerate(zip(edges, angles, outwards, strict=True)):
        worst = np.unique([angle, _nearest(peaks, np.array([edge]))[0]], axis=0)

        def excess(unit: float, worst: np.ndarray = worst) -> float:
            parameters, mu, azimuth = box.physical(np.insert(worst, 0, unit, axis=1))
            return float(np.max(albedo(parameters, np.maximum(mu, GRAZING), azimuth, rtol=_RTOL)[0])) - threshold

        here = excess(edge)
        if abs(here) <= _OFF:
            continue
        way = outward if here > 0 else -outward
        before, beyond, there, step = edge, edge, here, _NEAR
        while here * there > 0 and 0 < beyond < 1:
            before, beyond, step = beyond, min(max(beyond + way * step, 0.0), 1.0), 2 * step
            there = excess(beyond)
        if here * there < 0:
            found[index] = brentq(excess, before, beyond, xtol=_WIDTH)
        elif here > 0:  # to the end of the range
            found[index] = beyond
    return found


def _ridge(albedo: PointwiseAlbedo, box: Box, unit: np.ndarray, peaks: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The largest albedo over all angles at given values of the first axis, refined by shrinking sweeps, and the angles."""
    rows = np.arange(len(unit))
    centre = known = _nearest(peaks, unit)
    axes = box.dimension - 1
    counts = [_ANGLES if box.names[1 + axis] == "angle" else _TURNS for axis in range(axes)]
    width = np.ones(axes)
    for sweep in range(_SWEEPS if axes else 1):
        grids = [np.linspace(0, 1, count) if sweep == 0 else np.linspace(-1, 1, count) for count in counts]
        mesh = np.stack([grid.ravel() for grid in np.meshgrid(*grids, indexing="ij")], axis=-1) if axes else np.zeros((1, 0))
        angles = mesh[None] if sweep == 0 else centre[:, None] + width * mesh[None]
        places = np.concatenate(
            [
                np.broadcast_to(unit[:, None, None], (len(unit), len(mesh), 1)),
                np.broadcast_to(angles, (len(unit), len(mesh), axes)),
            ],
            axis=2,
        )
        places = np.concatenate([places, np.insert(known, 0, unit, axis=1)[:, None]], axis=1)
        places = box.kept(places.reshape(-1, box.dimension))
        values = _estimated(albedo, box, places, 0).reshape(len(unit), -1)
        centre = places.reshape(len(unit), -1, box.dimension)[rows, np.argmax(values, axis=1), 1:]
        width = np.array([1 / (count - 1) for count in counts]) if sweep == 0 else width * 0.3
    # Quick rules find the angle; what is compared in the end is told by the finest, there and at the angle of the peak.
    finest = [
        _estimated(albedo, box, np.concatenate([unit[:, None], angles], axis=1), albedo.levels - 1)
        for angles in (centre, known)
    ]
    best = np.argmax(finest, axis=0)
    return np.max(finest, axis=0), np.where(best[:, None] == 0, centre, known)


def _estimated(albedo: PointwiseAlbedo, box: Box, places: np.ndarray, level: int) -> np.ndarray:
    with np.errstate(all="ignore"):
        values, _ = albedo.estimate(*box.physical(places), level)
    return np.where(np.isnan(values), np.inf, values)
