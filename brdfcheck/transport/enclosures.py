r"""Closed enclosures of diffuse patches: sphere, box, cylinder, any convex polyhedron, or a matrix of your own.

Convex, so that all walls see each other: there is no visibility here, and a polyhedron with a dent is refused. Where walls hide
each other, form factors from elsewhere come in by `enclosure`, which balances them and says how far they were off.

Whatever leaves a patch of a closed enclosure arrives: $\sum_k F_{jk} = 1$, and $A_j F_{jk} = A_k F_{kj}$. How far the form
factors were from both is kept in `balance`, before they are made to hold; an enclosure that leaks is refused.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.quadrature.rule import checked_count
from brdfcheck.transport.form_factors import (
    FormFactor,
    coaxial_disks,
    inside_sphere,
    parallel_rectangles,
    perpendicular_rectangles,
)

# What may be missing from a row sum before the enclosure counts as open.
_LEAK = 1e-3
_SWEEPS = 200


class Balance(eqx.Module):
    """How far form factors were from what a closed enclosure demands, before that was enforced.

    `reciprocity`: the largest |A_j F_jk - A_k F_kj| by the smaller of the areas; `row_sums`: the largest |1 - sum_k F_jk|;
    `change`: the largest sum over a row of what enforcing them changed.
    """

    reciprocity: Float[Array, ""]
    row_sums: Float[Array, ""]
    change: Float[Array, ""]

    def __repr__(self) -> str:
        parts = (f"{name}={float(getattr(self, name)):.2g}" for name in ("reciprocity", "row_sums", "change"))
        return f"Balance({', '.join(parts)})"


class AbstractEnclosure(eqx.Module):
    """`form_factors` and `areas` of the patches of a closed enclosure.

    `uncertainty` bounds the sum over a row of the form factors' errors; `balance`: what was enforced.
    """

    form_factors: Float[Array, "patches patches"]
    areas: Float[Array, " patches"]
    uncertainty: Float[Array, ""]
    balance: Balance

    @property
    def patches(self) -> int:
        """The number of patches."""
        return self.areas.size

    def mean(self, values: Any) -> Float[Array, ""]:
        """The mean over the area of values for each patch."""
        return jnp.sum(self.areas * values) / jnp.sum(self.areas)


@final
class Enclosure(AbstractEnclosure):
    """An enclosure that is known by its form factors alone; made by `enclosure`, `polyhedron` or `cylinder`."""


@final
class Sphere(AbstractEnclosure):
    """The inside of a sphere about the origin, in bands of equal height by sectors of equal azimuth; made by `sphere`.

    Patch band * sectors + sector; band 0 is at the pole +z. All patches have the same area.
    """

    radius: Float[Array, ""]
    bands: int = eqx.field(static=True)
    sectors: int = eqx.field(static=True)

    def point(self, patch: Array, u: Float[Array, "rays 2"]) -> tuple[Array, Array]:
        """Points evenly spread on patches and their normals (inwards), (rays, 3) each, from numbers in [0, 1)."""
        band, sector = ((patch // self.sectors).astype(u.dtype), (patch % self.sectors).astype(u.dtype))
        z = 1 - 2 * (band + u[:, 0]) / self.bands
        azimuth = 2 * np.pi * (sector + u[:, 1]) / self.sectors
        ring = jnp.sqrt(jnp.maximum((1 - z) * (1 + z), 0))
        outward = jnp.stack([ring * jnp.cos(azimuth), ring * jnp.sin(azimuth), z], axis=-1)
        return self.radius * outward, -outward

    def hit(self, point: Array, direction: Array) -> tuple[Array, Array, Array]:
        """Where rays from the wall meet it again: points, normals (inwards), patches."""
        reach = -2 * jnp.sum(point * direction, axis=-1, keepdims=True)
        outward = point + reach * direction
        outward = outward / jnp.linalg.norm(outward, axis=-1, keepdims=True)
        turn = jnp.arctan2(outward[:, 1], outward[:, 0]) / (2 * np.pi)
        band = _cell((1 - outward[:, 2]) / 2, self.bands)
        return self.radius * outward, -outward, band * self.sectors + _cell(turn - jnp.floor(turn), self.sectors)


@final
class Box(AbstractEnclosure):
    """The inside of a box from the origin to `size`, each wall a grid of equal patches; made by `box`.

    Walls in the order x = 0, x = a, y = 0, y = b, z = 0, z = c; in a wall the later axis runs fastest.
    """

    size: Float[Array, " 3"]
    cells: tuple[int, int, int] = eqx.field(static=True)

    def _first(self) -> np.ndarray:
        counts = [self.cells[p] * self.cells[q] for p, q in _IN_PLANE for _ in range(2)]
        return np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)

    def on_wall(self, wall: int, value: float) -> Float[Array, " patches"]:
        """`value` at the patches of one wall (0 to 5: x = 0, x = a, y = 0, ...), 0 elsewhere. ValueError for other walls."""
        if isinstance(wall, bool) or wall not in range(6):
            raise ValueError(f"wall must be a whole number from 0 to 5; got {wall!r}")
        first, values = self._first(), np.zeros(self.patches)
        values[first[wall] : first[wall + 1]] = value
        return jnp.asarray(values, self.areas.dtype)

    def point(self, patch: Array, u: Float[Array, "rays 2"]) -> tuple[Array, Array]:
        """Points evenly spread on patches and their normals (inwards), (rays, 3) each, from numbers in [0, 1)."""
        first, dtype = jnp.asarray(self._first()), self.size.dtype
        wall = jnp.searchsorted(first, patch, side="right") - 1
        p, q = jnp.asarray(_IN_PLANE, np.int32)[wall // 2].T
        within, across = patch - first[wall], jnp.asarray(self.cells, np.int32)[q]
        axes, step = np.arange(3, dtype=np.int32), self.size / jnp.asarray(self.cells, dtype)
        along = jnp.stack([within // across, within % across], axis=-1).astype(dtype) + u
        side = (wall % 2).astype(dtype)[:, None] * self.size
        place = jnp.where(axes == p[:, None], along[:, :1] * step, jnp.where(axes == q[:, None], along[:, 1:] * step, side))
        return place, self._normal(wall)

    def hit(self, point: Array, direction: Array) -> tuple[Array, Array, Array]:
        """Where rays from the wall meet another one: points, normals (inwards), patches."""
        forward = direction > 0
        moves = direction != 0
        reach = jnp.where(moves, (jnp.where(forward, self.size, 0) - point) / jnp.where(moves, direction, 1), jnp.inf)
        # A wall that is left has the reach 0, and its direction leads away from it.
        axis = jnp.argmin(jnp.where(moves, jnp.maximum(reach, 0), jnp.inf), axis=-1).astype(np.int32)
        ahead = jnp.take_along_axis(forward, axis[:, None], axis=-1)[:, 0]
        wall = 2 * axis + ahead.astype(np.int32)
        place = jnp.clip(point + jnp.min(jnp.maximum(reach, 0), axis=-1, keepdims=True) * direction, 0, self.size)
        on_axis = np.arange(3, dtype=np.int32) == axis[:, None]
        place = jnp.where(on_axis, jnp.where(forward, self.size, 0), place)
        p, q = jnp.asarray(_IN_PLANE, np.int32)[axis].T
        counts = jnp.asarray(self.cells, np.int32)
        cell = _cell(place / self.size, counts)
        index = jnp.take_along_axis(cell, p[:, None], 1)[:, 0] * counts[q] + jnp.take_along_axis(cell, q[:, None], 1)[:, 0]
        return place, self._normal(wall), jnp.asarray(self._first())[wall] + index

    def _normal(self, wall: Array) -> Array:
        sign = jnp.where(wall % 2 == 0, 1, -1).astype(self.size.dtype)
        return jnp.where(np.arange(3, dtype=np.int32) == (wall // 2)[:, None], sign[:, None], 0)


def _cell(share: Array, count: Any) -> Array:
    return jnp.clip((share * jnp.asarray(count, share.dtype)).astype(np.int32), 0, count - 1)


# --- making them ---


def enclosure(form_factors: Any, areas: Any) -> Enclosure:
    """An enclosure from form factors F_jk (of what leaves j, the fraction that reaches k) and areas, any unit.

    Reciprocity and the row sums are enforced, and how far they were off is in `balance`. Raises ValueError where numbers are
    negative or not finite, where the enclosure is open (a row sum misses 1 by more than 0.001, the leak is stated), or not
    reciprocal to 0.001.
    """
    return Enclosure(*closed(form_factors, areas, 0.0))


def sphere(bands: int = 16, sectors: int = 1, *, radius: float = 1.0, dtype: Any = None) -> Sphere:
    r"""The inside of a sphere of this radius, in `bands` of equal height by `sectors`: $F_{jk} = A_k/(4\pi r^2)$.

    `dtype`: of all numbers, by default the widest that JAX has. ValueError for counts or a radius that are not positive.
    """
    bands, sectors = checked_count(bands, "bands"), checked_count(sectors, "sectors")
    radius = _size(radius, "radius")
    count = bands * sectors
    if count < 2:
        raise ValueError("a sphere needs at least 2 patches; got 1")
    areas = np.full(count, 4 * np.pi * radius * radius / count)
    factors = inside_sphere(areas, radius)
    matrix, error = (np.broadcast_to(part, (count, count)) for part in factors)
    parts = closed(matrix, areas, error, dtype)
    return Sphere(*parts, jnp.asarray(radius, parts[0].dtype), bands, sectors)


_IN_PLANE = ((1, 2), (0, 2), (0, 1))


def box(size: Sequence[float] = (1.0, 1.0, 1.0), cells: int | Sequence[int] = 1, *, dtype: Any = None) -> Box:
    """The inside of a box with the edges `size`, its walls divided into `cells` along each axis (one number or three).

    All form factors by the closed forms of parallel and perpendicular rectangles; equal relative places are computed once.
    `dtype`: of all numbers, by default the widest that JAX has. Raises ValueError for sizes or counts that are not positive.
    """
    if np.shape(size) != (3,):
        raise ValueError(f"size must be three lengths; got {size!r}")
    edges = [_size(edge, "size") for edge in size]
    counts = [checked_count(count, "cells") for count in ([cells] * 3 if np.ndim(cells) == 0 else list(cells))]  # pyright: ignore
    if len(counts) != 3:
        raise ValueError(f"cells must be one number or three; got {cells!r}")
    steps = [edge / count for edge, count in zip(edges, counts, strict=True)]
    per_wall = [counts[p] * counts[q] for p, q in _IN_PLANE for _ in range(2)]
    first = np.concatenate([[0], np.cumsum(per_wall)])
    areas = np.repeat([steps[p] * steps[q] for p, q in _IN_PLANE for _ in range(2)], per_wall)
    matrix, error = np.zeros((first[-1], first[-1])), 0.0
    tables = {}
    for wall, other in itertools.product(range(6), repeat=2):
        axis, across = wall // 2, other // 2
        if wall == other:
            continue  # flat: it does not see itself
        key = (axis, across)
        if key not in tables:
            tables[key] = _opposite(axis, edges, steps, counts) if axis == across else _adjacent(axis, across, steps, counts)
            error = max(error, float(np.max(tables[key].error)))
        table = tables[key].value
        here, there = (
            dict(zip(plane, np.indices([counts[p] for p in plane]).reshape(2, *shape), strict=True))
            for plane, shape in ((_IN_PLANE[axis], (-1, 1)), (_IN_PLANE[across], (1, -1)))
        )
        if axis == across:
            p, q = _IN_PLANE[axis]
            block = table[abs(here[p] - there[p]), abs(here[q] - there[q])]
        else:
            common = 3 - axis - across
            # Counted from the edge where the two walls meet.
            off_here = here[across] if other % 2 == 0 else counts[across] - 1 - here[across]
            off_there = there[axis] if wall % 2 == 0 else counts[axis] - 1 - there[axis]
            block = table[off_here, off_there, abs(here[common] - there[common])]
        matrix[first[wall] : first[wall + 1], first[other] : first[other + 1]] = block
    parts = closed(matrix, areas, error, dtype)
    return Box(*parts, jnp.asarray(edges, parts[0].dtype), tuple(counts))  # pyright: ignore[reportArgumentType]


def _grid(count: int, step: float) -> np.ndarray:
    return step * np.stack([np.arange(count), np.arange(1, count + 1)], axis=-1)


def _opposite(axis: int, edges: Sequence[float], steps: Sequence[float], counts: Sequence[int]) -> FormFactor:
    """By the distances of two patches in the walls' plane, in patches."""
    p, q = _IN_PLANE[axis]
    x, y = _grid(counts[p], steps[p])[:, None], _grid(counts[q], steps[q])[None, :]
    return parallel_rectangles((0, steps[p]), (0, steps[q]), x, y, edges[axis])


def _adjacent(axis: int, across: int, steps: Sequence[float], counts: Sequence[int]) -> FormFactor:
    """By the distance of either patch from the common edge, and theirs along it, in patches."""
    common = 3 - axis - across
    x, z, y = (_grid(counts[p], steps[p]) for p in (across, axis, common))
    return perpendicular_rectangles(x[:, None, None], (0, steps[common]), z[None, :, None], y[None, None, :])


def cylinder(radius: float = 1.0, height: float = 1.0, *, rings: int = 1, bands: int = 1) -> Enclosure:
    """A can of a radius and height: the bottom in `rings` of equal width (from the axis outwards), the side in `bands`
    (upwards), the top in rings.

    All form factors follow from those of coaxial disks, by subtraction: what crosses a disk and not the next one lands
    between. Raises ValueError for sizes or counts that are not positive.
    """
    radius, height = _size(radius, "radius"), _size(height, "height")
    rings, bands = checked_count(rings, "rings"), checked_count(bands, "bands")
    r, z = np.linspace(0, radius, rings + 1), np.linspace(0, height, bands + 1)

    def flux(a: Any, b: Any, distance: Any) -> np.ndarray:
        """Area times form factor between coaxial disks; a disk at no distance takes what the smaller one sends."""
        a, b, distance = np.broadcast_arrays(np.asarray(a, float), np.asarray(b, float), np.abs(np.asarray(distance, float)))
        apart = np.where(distance > 0, distance, 1.0)
        safe = np.where(a > 0, a, 1.0)
        found = np.pi * safe * safe * coaxial_disks(safe, b, apart).value
        return np.where(a > 0, np.where(distance > 0, found, np.pi * np.minimum(a, b) ** 2), 0)

    # Of the bottom's disks (rings + 1 radii) to the top's, then rings by differences.
    ends = np.diff(np.diff(flux(r[:, None], r[None, :], height), axis=0), axis=1)
    # Of the bottom's disks through the full disks at the heights z; what is lost between two of them is on that band.
    through = flux(r[:, None], radius, z[None, :])
    to_side = np.diff(-np.diff(through, axis=1), axis=0)
    # Between the full disks at two heights; second differences give the bands to each other.
    between = flux(radius, radius, z[:, None] - z[None, :])
    side = -np.diff(np.diff(between, axis=0), axis=1)
    # What a band sends to itself does not cross the disks at its ends.
    side[np.diag_indices(bands)] += 2 * np.pi * radius * height / bands
    exchange = np.block(
        [
            [np.zeros((rings, rings)), to_side, ends],
            [to_side.T, side, to_side[:, ::-1].T],
            [ends.T, to_side[:, ::-1], np.zeros((rings, rings))],
        ]
    )
    ring_areas = np.pi * np.diff(r * r)
    areas = np.concatenate([ring_areas, np.full(bands, 2 * np.pi * radius * height / bands), ring_areas])
    error = 32 * np.finfo(float).eps * np.pi * radius * radius / areas[:, None] * np.ones_like(exchange)
    return Enclosure(*closed(np.maximum(exchange, 0) / areas[:, None], areas, error))


# --- what a closed enclosure demands ---


def closed(form_factors: Any, areas: Any, error: Any, dtype: Any = None) -> tuple[Array, Array, Array, Balance]:
    """(form factors, areas, uncertainty, balance) of an enclosure, with reciprocity and row sums enforced."""
    matrix, areas = np.asarray(form_factors, float), np.asarray(areas, float)
    if matrix.ndim != 2 or matrix.shape[0] != matrix.shape[1] or areas.shape != matrix.shape[:1]:
        raise ValueError(f"form factors must be (patches, patches) and areas (patches,); got {matrix.shape} and {areas.shape}")
    if not (np.all(np.isfinite(matrix)) and np.min(matrix) >= -1e-12):
        raise ValueError(f"form factors must be finite and >= 0; got {np.min(matrix):g}")
    if not (np.all(np.isfinite(areas)) and np.min(areas) > 0):
        raise ValueError(f"areas must be finite and > 0; got {np.min(areas):g}")
    sums = np.sum(matrix, axis=1)
    row_sums = float(np.max(np.abs(1 - sums)))
    _refuse_leaks(sums, areas)
    balanced = areas[:, None] * matrix
    difference = np.abs(balanced - balanced.T)
    worst = np.unravel_index(np.argmax(difference), difference.shape)
    reciprocity = float(np.max(difference / np.minimum(areas[:, None], areas[None, :])))
    if reciprocity > _LEAK:
        (j, k), both = worst, (balanced[worst], balanced.T[worst])
        raise ValueError(f"A_j F_jk must equal A_k F_kj; for the patches {j} and {k} they are {both[0]:.6g} and {both[1]:.6g}")
    np.add(balanced, balanced.T, out=difference)
    balanced = np.maximum(difference, 0, out=difference)
    balanced *= 0.5
    # Symmetric scaling D G D keeps what is 0 at 0 and everything positive (Sinkhorn & Knopp 1967).
    scale = np.ones_like(areas)
    for _ in range(_SWEEPS):
        reached = scale * (balanced @ scale)
        if np.max(np.abs(reached / areas - 1)) < 4 * np.finfo(float).eps:
            break
        scale = scale * np.sqrt(areas / reached)
    balanced *= (scale / areas)[:, None]
    balanced *= scale
    change = float(np.max(np.sum(np.abs(balanced - matrix), axis=1)))
    dtype = jnp.asarray(0.0).dtype if dtype is None else jnp.dtype(dtype)
    # Uniform errors come as one number, spread over the matrix without memory.
    spread = np.broadcast_to(error, matrix.shape)
    largest = float(error) * len(areas) if np.ndim(error) == 0 else float(np.max(np.sum(spread, axis=1)))
    rounded = jnp.asarray(balanced, dtype)
    uncertainty = jnp.asarray(min(largest + change, 1.0) + float(jnp.finfo(dtype).eps), dtype)
    balance = Balance(*(jnp.asarray(number, dtype) for number in (reciprocity, row_sums, change)))
    return rounded, jnp.asarray(areas, dtype), uncertainty, balance


def _refuse_leaks(sums: np.ndarray, areas: np.ndarray) -> None:
    worst = int(np.argmax(np.abs(1 - sums)))
    leak = 1 - float(sums[worst])
    if abs(leak) <= _LEAK:
        return
    if leak < 0:
        raise ValueError(f"patch {worst} sends out {1 - leak:.6g} times what leaves it: its form factors must add up to 1")
    total = float(np.sum(areas * (1 - sums)) / np.sum(areas))
    raise ValueError(
        f"the enclosure is open: of what leaves patch {worst}, {leak:.3g} escapes (row sum {sums[worst]:.6g}), of all light"
        f" {total:.3g}; add the missing wall"
    )


def _size(value: Any, name: str) -> float:
    number = float(value) if np.ndim(value) == 0 and np.issubdtype(np.asarray(value).dtype, np.number) else float("nan")
    if not (np.isfinite(number) and number > 0):
        raise ValueError(f"{name} must be finite and > 0; got {value!r}")
    return number
