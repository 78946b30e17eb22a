"""The albedo of a function beside a place, by the rules of the integrals there."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from brdfcheck.quadrature.boxes import Mesh
from brdfcheck.quadrature.limit import grazing_limit

if TYPE_CHECKING:
    from brdfcheck.quadrature.pointwise import PointwiseAlbedo


class Frozen:
    """The albedo beside a place, by the rules of the integrals there: a smooth function, and as accurate as they, for less.

    Called like a `PointwiseAlbedo`; `value` and `error` are those of the place itself. A cosine of 0 is the limit if the
    place is one, by the rules of all cosines that the limit there asked for.
    """

    def __init__(self, albedo: PointwiseAlbedo, parameters: np.ndarray, cos_theta: float, azimuth: float, rtol: float):
        assert albedo.evaluator is not None
        self._albedo, self._evaluator, self._rtol = albedo, albedo.evaluator, rtol
        self._meshes: dict[float, Mesh] = {}
        place = parameters[None], np.array([cos_theta]), np.array([azimuth])
        every, bars = albedo._adaptive(self._evaluator, *place, rtol, keep=self._meshes.__setitem__)
        value, error, _ = worst_channel(every, bars)
        self.value, self.error = float(value[0]), float(error[0])

    @property
    def size(self) -> int:
        """How many nodes the largest of its rules has."""
        return max(mesh.size for mesh in self._meshes.values())

    def gap(self) -> float:
        """The angle (radians) of the widest cone of directions in which its rule nearest to grazing has no node."""
        cosine = min(self._meshes)
        return self._meshes[cosine].gap(cosine, self._albedo.mirrored)

    def __call__(self, parameters: np.ndarray, cos_theta: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        points = parameters, cos_theta, azimuth
        if np.all(cos_theta == 0):
            found = [self._limit(*(part[i : i + 1] for part in points)) for i in range(len(cos_theta))]
            values, errors = (np.stack(part) for part in zip(*found, strict=True))
        else:
            values, errors = self._at(*points)
        return worst_channel(values, errors)[:2]

    def _limit(self, parameters: np.ndarray, _: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        def at(cosine: float) -> tuple[np.ndarray, np.ndarray]:
            value, error = self._at(parameters, np.array([cosine]), azimuth)
            return value[0], error[0]

        return grazing_limit(at)

    def _at(self, parameters: np.ndarray, cos_theta: np.ndarray, azimuth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        nearest = min(self._meshes, key=lambda mu: abs(np.log(mu) - np.log(cos_theta[0])))
        mesh = self._meshes[nearest]
        known = mesh.near(cos_theta) if len(self._meshes) == 1 else cos_theta == nearest
        parts = []
        if np.any(known):
            value, _ = self._albedo._graded(self._evaluator, parameters[known], cos_theta[known], azimuth[known], mesh)
            parts.append((known, value, np.abs(value) * _roundings(self._albedo.epsilon)))
        if not np.all(known):
            rest = parameters[~known], cos_theta[~known], azimuth[~known]
            parts.append((~known, *self._albedo._adaptive(self._evaluator, *rest, self._rtol)))
        values, errors = (np.zeros((len(known), *parts[0][1].shape[1:])) for _ in range(2))
        for which, value, error in parts:
            values[which], errors[which] = value, error
        return values, errors


def worst_channel(value: np.ndarray, error: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray | None]:
    """Value and error of the channel with the largest value at each point, and which one it is (None: there are none)."""
    if value.ndim == 1:
        return value, error, None
    worst = np.argmax(np.where(np.isnan(value), np.inf, value), axis=-1)
    pick = worst[:, None]
    return np.take_along_axis(value, pick, -1)[:, 0], np.take_along_axis(error, pick, -1)[:, 0], worst


def _roundings(epsilon: float) -> float:
    """The rounding of an albedo by a fixed rule, relative: in single precision that of the directions counts too."""
    return (16 if epsilon > 1e-10 else 4) * epsilon
