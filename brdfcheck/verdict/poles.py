"""Poles inside the box: places towards which an albedo grows without bound."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from brdfcheck.quadrature.limit import LAST_DECADES, extrapolated
from brdfcheck.verdict.box import cosine_at
from brdfcheck.verdict.surface import Surface

SUSPICIOUS = 30.0
"""Values above this are examined for a pole."""
# How much higher the surroundings are the nearer, and how often in fourteen decades; what is as large as this is infinite.
_HIGHER, _OFTEN, _ENDLESS = 1.2, 6, 1e15
# Distances from a pole at which it is looked at by the rule of a verdict, and the accuracy.
_DISTANCES, _ASKED = (1e-2, 1e-4, 1e-6), 1e-3
# What is nearer to grazing than this (in the coordinate of the angle) is grazing, and where to look instead.
_GRAZING, _BESIDE = 1e-3, 0.05


def pole(surface: Surface, place: np.ndarray, value: float, level: int, check: Callable[[], None]) -> np.ndarray | None:
    """The place of a pole near `place`, where the albedo is `value` by the rule of a level; None where there is none.

    A pole is higher the nearer one comes, over decades. `check` is called once a decade.
    """
    random = np.random.default_rng(4)
    dimension, angle = surface.box.dimension, surface.angle
    # What grows towards grazing has a limit of its own: what else grows there does so in other light, too.
    grazes = angle is not None and _grazing(surface, place)
    if grazes:
        place = place.copy()
        place[angle] = 0
        # Limits of functions are looked at by themselves.
        if surface.fast and _endless(surface, place):
            return place
        place[angle] = _BESIDE
        value = float(surface.estimate(level, place[None])[0][0])
    tops, around = [], []
    for exponent in range(1, 15):
        offsets = random.uniform(-1, 1, (48 + 16 * dimension, dimension))
        offsets[: 4 * dimension] = np.concatenate([np.eye(dimension) * s for s in (1, -1, 0.5, -0.5)])
        if grazes:
            offsets[:, angle] = 0
        places = surface.box.kept(place + 10.0**-exponent * offsets)
        found, _ = surface.estimate(level, places)
        top = int(np.argmax(found))
        if found[top] > value:
            place, value = places[top], float(found[top])
        tops.append(value)
        around.append(float(np.median(found)))
        check()
    rising = np.array(around[1:]) > _HIGHER * np.abs(np.array(around[:-1]))
    nearer = np.array(tops[1:]) > _HIGHER * np.array(tops[:-1])
    # No end to it where the surroundings are smaller than the distance to the pole.
    if np.count_nonzero(rising) + np.count_nonzero(nearer) < _OFTEN:
        return None
    found = np.all(nearer[-3:]) or np.all(rising[-5:-2]) or value > _ENDLESS
    return place if found and not _grazing(surface, place) and _grows(surface, place) else None


def _endless(surface: Surface, place: np.ndarray) -> bool:
    """Whether the albedo of a lobe grows without bound towards a place at grazing incidence; what holds it is its engine."""
    (parameters, mu, azimuth), count = surface.box.physical(place[None]), len(LAST_DECADES)
    if mu[0] > 0:
        return False
    value, error = surface.albedo(np.repeat(parameters, count, axis=0), LAST_DECADES, np.repeat(azimuth, count))
    return bool(np.isposinf(extrapolated(value, error)[0]))


def _grows(surface: Surface, place: np.ndarray) -> bool:
    """Whether it is the integral that grows towards a place: infinite or none, or higher the nearer one comes.

    A quick rule also grows where one of its nodes nears an integrable singularity of the BRDF.
    """
    random = np.random.default_rng(5)
    offsets = random.uniform(-1, 1, (len(_DISTANCES), surface.box.dimension))
    offsets /= np.max(np.abs(offsets), axis=1, keepdims=True)
    places = surface.box.kept(place + np.array(_DISTANCES)[:, None] * offsets)
    value, error = surface.produce(places, _ASKED)
    if not np.all(np.isfinite(value)):
        return True
    size = np.abs(value)  # on one side of a pole it may be negative
    return bool(np.all(size[1:] - error[1:] > _HIGHER * (size[:-1] + error[:-1])))


def _grazing(surface: Surface, place: np.ndarray) -> bool:
    return bool(surface.box.physical(place[None])[1][0] <= cosine_at(np.array(_GRAZING)))
