"""A sphere shaded at a grid of points instead of in each pixel, and looked up between them.

What a point of a sphere looks like depends on its normal alone. Seen from the pole opposite to the eye (stereographic
projection) the side that the eye sees is a disc, smooth up to its edge, while in the picture normals turn ever faster towards
the outline: few points hold the disc, however many pixels the picture has.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from brdfcheck.geometry import frame_about
from brdfcheck.scene.cameras import AbstractCamera, Orthographic
from brdfcheck.scene.vectors import Vector, dot, polar, unit


def kept(table: Float[Array, "3 rows ..."]) -> Float[Array, "3 rows+1 ..."]:
    """A table with a row more, which nobody looks up: what is written into something larger is computed once.

    XLA would compute it anew for each number that is looked up (20 lamps: 58 ms instead of 0.6), barrier or not.
    """
    larger = jnp.zeros((3, table.shape[1] + 1, *table.shape[2:]), table.dtype)
    return jax.lax.dynamic_update_slice(larger, table, (0,) * table.ndim)


class Grid(NamedTuple):
    """`count` x `count` points of the sphere, in the square around the disc of what the camera sees."""

    camera: AbstractCamera
    center: Float[Array, " 3"]
    radius: Float[Array, ""]
    count: int

    @staticmethod
    def of(numbers: Mapping[str, Any], count: int) -> Grid:
        """Of the sphere in a scene's numbers."""
        return Grid(numbers["camera"], numbers["center"], numbers["radius"], count)

    def places(self) -> tuple[Vector, Vector, Vector]:
        """Points, normals and views of the grid, fields (count, count)."""
        (right, up, back), edge = self._disc()
        x = jnp.linspace(-1, 1, self.count, dtype=edge.dtype) * edge
        square = x * x + (x * x)[:, None]
        normal = right * (2 * x) + up * (2 * x[:, None]) + back * (1 - square)
        normal = normal * (1 / (1 + square))
        point = Vector(*self.center) + normal * self.radius
        return point, normal, back if isinstance(self.camera, Orthographic) else unit(Vector(*self.camera.eye) - point)

    def between(self, colours: Float[Array, "3 count count"], normal: Vector) -> Float[Array, "3 ..."]:
        """The colours at these normals: linear between four points of the grid in each direction."""
        (right, up, back), edge = self._disc()
        colours = kept(colours)
        # A pixel that misses the sphere has some normal, and any colour.
        scale = (self.count - 1) / 2
        share = scale / (edge * jnp.maximum(1 + dot(back, normal), 1))
        column, across = self._cell(dot(right, normal) * share + scale)
        row, along = self._cell(dot(up, normal) * share + scale)
        above, below = (
            colours[:, line, column] * (1 - across) + colours[:, line, column + 1] * across for line in (row, row + 1)
        )
        return above * (1 - along) + below * along

    def _cell(self, place: Array) -> tuple[Array, Array]:
        """Which two lines of the grid a place is between, the number of the first, and how far from it."""
        first = jnp.clip(place.astype(jnp.int32), 0, self.count - 2)
        return first, jnp.clip(place - first.astype(place.dtype), 0, 1)

    def _disc(self) -> tuple[tuple[Vector, Vector, Vector], Array]:
        """Axes of space, the last towards the eye, and the radius of the disc: 1 for half of the sphere."""
        if isinstance(self.camera, Orthographic):
            back, edge = Vector(*self.camera.frame(self.center.dtype)[1][2]), jnp.ones_like(self.radius)
        else:
            distance, back = polar(Vector(*self.camera.eye) - Vector(*self.center))
            edge = jnp.sqrt((distance - self.radius) / (distance + self.radius))
        right, up = (Vector(*axis) for axis in frame_about(*back))
        return (right, up, back), edge
