"""Nodes and weights of Gauss and Legendre, to the last bit of float64; and arrays with a row for each of the same things."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Self

import numpy as np


class Columns:
    """What dataclasses share whose fields are arrays with a row for each of the same things."""

    def __iter__(self) -> Iterator[np.ndarray]:
        return iter(vars(self).values())

    def taken(self, which: np.ndarray | slice) -> Self:
        """Some of the rows."""
        return type(self)(*(column[which] for column in self))

    def joined(self, *others: Self) -> Self:
        """These rows, then those of the others."""
        return type(self)(*(np.concatenate(parts) for parts in zip(self, *others, strict=True)))


@functools.cache
def gauss(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights on [0, 1], float64, of shape (count,). Shared: not to be written to.

    By Newton's method in the machine's longest numbers: numpy's weights are off by 3e-13 for 34 nodes, and a lobe of power 64
    rests on the outermost few.
    """
    x = np.polynomial.legendre.leggauss(count)[0].astype(np.longdouble)
    slope = np.ones_like(x)
    for _ in range(2):
        before, value = np.ones_like(x), x
        for degree in range(2, count + 1):
            before, value = value, ((2 * degree - 1) * x * value - (degree - 1) * before) / degree
        slope = count * (x * value - before) / (x * x - 1)
        x = x - value / slope
    nodes, weights = ((x + 1) / 2).astype(float), (1 / ((1 - x * x) * slope**2)).astype(float)
    nodes.flags.writeable = weights.flags.writeable = False
    return nodes, weights


def averaging(count: int, panels: int = 1) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights of an average over the hemisphere, of 2 f(mu) mu over mu from 0 to 1, by Gauss nodes in each panel.

    They are in the cube root of mu, which resolves the layer at grazing incidence.
    """
    nodes, weights = gauss(count)
    x = ((np.arange(panels)[:, None] + nodes) / panels).ravel()
    return x**3, 6 * x**5 * np.tile(weights, panels) / panels


def unit_vectors(cosine: np.ndarray | float, azimuth: np.ndarray | float = 0.0, axis: int = -1) -> np.ndarray:
    """Directions at polar angles with these cosines and at azimuths (radians); their components lie along `axis`."""
    sine = np.sqrt((1 - cosine) * (1 + cosine))
    return np.stack(np.broadcast_arrays(sine * np.cos(azimuth), sine * np.sin(azimuth), cosine), axis=axis)


def sine_cosine(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sine and cosine of angles in [-pi/2, pi/2], by the tangent of their half: to 5e-16 of the sine, and of 1.

    numpy computes tangents of many numbers at once, and neither sines nor cosines: together they take four times as long.
    """
    half = np.tan(angle / 2)
    square = half * half
    share = 1 / (1 + square)
    return 2 * half * share, (1 - square) * share
