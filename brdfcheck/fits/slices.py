"""The albedo of a family of any number of parameters on slices through one place: for pictures that are looked through.

A slice is a grid of one parameter (the rows) and the angle of incidence. The other parameters stand still in a slice; each has
a few values, and there is a slice for every combination of these or, where that would be too many, for those that move one
parameter away from the place. The place itself is a node of every axis, so that the largest albedo is in the table.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np
from jaxtyping import Float

from brdfcheck.brdf.family import Family
from brdfcheck.fits.grids import spaced
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.runtime import double_precision

AZIMUTH = "azimuth"
"""The name of the axis of azimuths, in degrees, that an anisotropic BRDF has besides those of its parameters."""
# Rows and angles of a slice where there is room, and at least.
_FINE, _COARSE = (48, 64), (12, 16)
# How many values the parameters have that stand still in a slice: the first number for which all combinations fit.
_VALUES = (7, 5, 4, 3)
_ALONE = (5, 3)
# Values of azimuth, over a full turn.
_TURNS = 9
# Points that a function is asked for: of one that JAX runs, of any other, of one that takes one pair of directions.
_MOST = (16_000, 6_000, 800)
# The accuracy that is asked of lobes, and at how many points a fixed rule is held against the next finer one.
_RTOL = 1e-6
_COMPARED = 48
_MOST_CHANNELS = 4


@dataclass(frozen=True)
class Axis:
    """Rising values of a parameter; `position` from 0 to 1 is where each lies along its axis, `at` the index of the place."""

    name: str
    values: Float[np.ndarray, " count"]
    position: Float[np.ndarray, " count"]
    at: int


@dataclass(frozen=True)
class Slices:
    """Albedos on slices: `tables` by the indices of `others`, each of shape (channels, rows, angles), never clamped.

    `angles` in degrees; `rows` is None where no parameter runs (tables then have one row). `errors`: how far the values of a
    table may be off, as a part of 1 or of the value if that is larger, as far as a comparison with a finer rule tells (for
    lobes the quadrature's own bar). The slice of the place itself is the most accurate one.
    """

    angles: Axis
    rows: Axis | None
    others: tuple[Axis, ...]
    tables: Mapping[tuple[int, ...], Float[np.ndarray, "channels rows angles"]]
    errors: Mapping[tuple[int, ...], float]


def slices(
    family: Family, place: Mapping[str, float], cos_theta: float = 1.0, azimuth: float = 0.0, *, cells: int = 56_000
) -> Slices:
    """Slices of a family through `place` (parameters), of at most about `cells` numbers. The rows run over the first parameter.

    `cos_theta`, `azimuth` (radians): the incidence there. Raises Finding where a user's BRDF fails, and what it raises itself.
    """
    with double_precision():
        albedo = PointwiseAlbedo(family)
        swept = [name for name in albedo.swept if name not in family.switches]
        swept += [name for name in albedo.swept if name in family.switches]
        names = [*swept, AZIMUTH] if albedo.anisotropic else swept
        inside = {name: float(np.clip(place.get(name, low), low, high)) for name, (low, high) in family.ranges.items()}
        inside[AZIMUTH] = math.degrees(azimuth) % 360
        shape, values, crossed = _layout(len(names), _room(albedo, cells // _channels(albedo, inside)))
        axes = [
            _axis(family, name, shape[0] if index == 0 else values, inside[name], turns=shape[0] if index == 0 else _TURNS)
            for index, name in enumerate(names)
        ]
        steepest, flattest = (math.degrees(math.acos(bound)) for bound in family.cos_theta[::-1])
        angles = _with_node("angle", np.linspace(steepest, flattest, shape[1]), math.degrees(math.acos(min(cos_theta, 1.0))))
        rows, others = (axes[0], tuple(axes[1:])) if axes else (None, ())
        keys = _keys(others, crossed=crossed)
        tables, errors = {}, {}
        for key in keys:
            held = inside | {axis.name: float(axis.values[index]) for axis, index in zip(others, key, strict=True)}
            coarse = albedo.one_by_one or any(index != axis.at for axis, index in zip(others, key, strict=True))
            tables[key], errors[key] = _table(albedo, held, rows, angles, coarse=coarse)
        return Slices(angles, rows, others, tables, errors)


def _channels(albedo: PointwiseAlbedo, place: Mapping[str, float]) -> int:
    """How many channels are worth a table of their own: one where there are too many to tell apart."""
    row = np.array([[place[name] for name in albedo.names]])
    value, _ = albedo.estimated_channels(row, np.ones(1), np.zeros(1), 0)
    count = 1 if value.ndim == 1 else value.shape[-1]
    return count if count <= _MOST_CHANNELS else 1


def _room(albedo: PointwiseAlbedo, points: int) -> int:
    """How many points there may be: no more than `points`, nor than a function takes some seconds for."""
    if albedo.fast:
        return points
    return min(points, _MOST[2 if albedo.one_by_one else 1 if albedo.slow else 0])


def _layout(axes: int, points: int) -> tuple[tuple[int, int], int, bool]:
    """Rows and angles of a slice, values of the other axes, and whether all combinations of these have a slice."""
    full = (_FINE[0] if axes else 1) * _FINE[1]
    others = max(axes - 1, 0)
    for values in _VALUES:
        if values**others * full <= points:
            return ((_FINE[0] if axes else 1), _FINE[1]), values, True
    values = next((values for values in _ALONE if (1 + others * (values - 1)) * full <= points), _ALONE[-1])
    scale = math.sqrt(min(1.0, points / ((1 + others * (values - 1)) * full)))
    rows, angles = (max(least, round(most * scale)) for most, least in zip(_FINE, _COARSE, strict=True))
    return (rows if axes else 1, angles), values, False


def _axis(family: Family, name: str, count: int, at: float, *, turns: int) -> Axis:
    if name == AZIMUTH:
        return _with_node(name, np.linspace(0.0, 360.0, turns), at)
    low, high = family.ranges[name]
    if name in family.switches:
        return Axis(name, np.array([low, high]), np.array([0.0, 1.0]), int(at == high))
    position = np.linspace(0.0, 1.0, count)
    return _with_node(name, spaced(low, high, position)[0], at)


def _with_node(name: str, values: np.ndarray, at: float) -> Axis:
    """The axis through evenly placed `values`, of which the one nearest to `at` is moved there; the ends stay."""
    position = np.linspace(0.0, 1.0, len(values))
    place = float(np.interp(at, values, position))
    index = round(place * (len(values) - 1))
    if 0 < index < len(values) - 1:
        values, position = values.copy(), position.copy()
        values[index], position[index] = at, place
    return Axis(name, values, position, index)


def _keys(others: tuple[Axis, ...], *, crossed: bool) -> list[tuple[int, ...]]:
    if crossed:
        return list(product(*(range(len(axis.values)) for axis in others)))
    middle = tuple(axis.at for axis in others)
    moved = [(*middle[:i], k, *middle[i + 1 :]) for i, axis in enumerate(others) for k in range(len(axis.values))]
    return list(dict.fromkeys([middle, *moved]))


def _table(
    albedo: PointwiseAlbedo, held: Mapping[str, float], rows: Axis | None, angles: Axis, *, coarse: bool
) -> tuple[np.ndarray, float]:
    """One slice, and how far its values may be off."""
    nodes = np.zeros(1) if rows is None else rows.values
    count = len(nodes) * len(angles.values)
    columns = {name: np.full(count, value) for name, value in held.items()}
    if rows is not None:
        columns[rows.name] = np.repeat(nodes, len(angles.values))
    parameters = np.stack([columns[name] for name in albedo.names], axis=1) if albedo.names else np.zeros((count, 0))
    mu = np.tile(np.clip(np.cos(np.radians(angles.values)), *albedo.family.cos_theta), len(nodes))
    azimuth = np.radians(columns[AZIMUTH])
    if albedo.fast:
        value, bars = albedo.channels(parameters, mu, azimuth, rtol=_RTOL)
        error = float(np.nanmax(bars / np.maximum(1, np.abs(value)), initial=0.0))
    else:
        level = 0 if coarse else 1
        value, bars = albedo.estimated_channels(parameters, mu, azimuth, level)
        some = np.unique(np.linspace(0, count - 1, min(count, _COMPARED)).astype(int))
        finer, _ = albedo.estimated_channels(parameters[some], mu[some], azimuth[some], level + 1)
        error = float(np.nanmax(np.abs(finer - value[some]) / np.maximum(1, np.abs(finer)), initial=0.0))
    value = value if value.ndim == 2 else value[:, None]
    if value.shape[1] > _MOST_CHANNELS:
        value = np.max(value, axis=1, keepdims=True)
    return value.T.reshape(-1, len(nodes), len(angles.values)), error
