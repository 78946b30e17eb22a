r"""Form factors: rectangles along the axes, coaxial disks, the inside of a sphere, in closed form.

$F_{jk}$ is the fraction of what leaves the diffuse surface j that reaches k. All of this runs in numpy's float64. The closed
forms of rectangles are differences of sixteen values of one antiderivative and lose as many digits as the patches are small
and far apart, which the error of each result bounds.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

_EPSILON = float(np.finfo(float).eps)
# Rounding of one corner by the sum of its parts' sizes: two differences, a root, a quotient, an arc tangent, two products.
_ROUNDING = 6


class FormFactor(NamedTuple):
    """A form factor and a bound on its error, both of the shape of the arguments without their last axis."""

    value: np.ndarray
    error: np.ndarray


def parallel_rectangles(x: Any, y: Any, other_x: Any, other_y: Any, distance: Any) -> FormFactor:
    r"""From a rectangle in a plane to one in a parallel plane, sides along the same axes, anywhere in their planes.

    `x`, `y`, `other_x`, `other_y`: intervals of shape (..., 2), rising; `distance` > 0 of shape (...). Any one unit of length.
    With $u = x - x'$, $v = y - y'$ the kernel $z^2/(\pi r^4)$ is $\partial_u^2\partial_v^2$ of
    $\frac{1}{2\pi}[v s \arctan(v/s) + u t \arctan(u/t) - \frac{z^2}{2}\ln(u^2+v^2+z^2)]$, $s^2 = u^2+z^2$, $t^2 = v^2+z^2$
    (Ehlert & Smith 1993; Howell's catalogue C-13). ValueError for intervals that do not rise or a distance <= 0.
    """
    x, y, other_x, other_y = _intervals(x=x, y=y, other_x=other_x, other_y=other_y)
    z = _positive(distance, "distance")

    def term(x: np.ndarray, y: np.ndarray, other_x: np.ndarray, other_y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u, v = x - other_x, y - other_y
        s, t = np.hypot(u, z), np.hypot(v, z)
        # z^2 ln z, the same in all corners, is left out: it cancels, and its rounding would not.
        logarithm = 0.5 * z * z * np.log1p((u * u + v * v) / (z * z))
        parts = np.stack(np.broadcast_arrays(v * s * np.arctan(v / s), u * t * np.arctan(u / t), -logarithm)) / (2 * np.pi)
        return np.sum(parts, axis=0), np.sum(np.abs(parts), axis=0)

    return _alternating(term, x, y, other_x, other_y)


def perpendicular_rectangles(x: Any, y: Any, z: Any, other_y: Any) -> FormFactor:
    r"""From the rectangle x times y in the plane z = 0 to the rectangle other_y times z in the plane x = 0.

    Intervals of shape (..., 2), rising; x and z are distances from the line where the planes meet, >= 0, so the rectangles
    may share an edge. With $v = y - y'$, $s^2 = x^2+z^2$ the kernel $xz/(\pi r^4)$ is $\partial_x\partial_z\partial_v^2$ of
    $-\frac{1}{4\pi}[\frac12(v^2-s^2)\ln(s^2+v^2) + 2sv\arctan(v/s)]$ (Howell's catalogue C-15; derived by integrating three
    times by hand). ValueError for intervals that do not rise or a negative distance.
    """
    x, y, z, other_y = _intervals(x=x, y=y, z=z, other_y=other_y)
    for name, ends in (("x", x), ("z", z)):
        if np.any(ends < 0):
            raise ValueError(f"{name} is a distance from the line where the planes meet, >= 0; got {np.min(ends):g}")

    def term(x: np.ndarray, y: np.ndarray, z: np.ndarray, other_y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        v, square, s = y - other_y, x * x + z * z, np.hypot(x, z)
        total = square + v * v
        logarithm = np.log(np.where(total > 0, total, 1))
        # The rounding of the logarithm's argument does not go away where the logarithm does.
        first, second = 0.5 * (v * v - square), 2 * s * v * np.arctan2(v, s)
        size = 0.5 * (v * v + square) * (np.abs(logarithm) + 1) + np.abs(second)
        # Two integrals over x and z, two over v = y - y', where the second one counts backwards.
        return (first * logarithm + second) / (4 * np.pi), size / (4 * np.pi)

    return _alternating(term, x, y, z, other_y)


def coaxial_disks(radius: Any, other_radius: Any, distance: Any) -> FormFactor:
    r"""From a disk of `radius` to a parallel one of `other_radius` on the same axis, shapes broadcast.

    Radii >= 0, `distance` > 0, in one unit of length.

    $F = \frac12[X - \sqrt{X^2 - 4(r_2/r_1)^2}]$, $X = 1 + (d^2 + r_2^2)/r_1^2$ (Howell's catalogue C-41), written as
    $2 r_2^2/(Y + \sqrt{(Y - 2 r_1 r_2)(Y + 2 r_1 r_2)})$ with $Y = r_1^2 + r_2^2 + d^2$, which does not cancel.
    ValueError for other arguments.
    """
    first, second = (_positive(r, name, zero=True) for r, name in ((radius, "radius"), (other_radius, "other_radius")))
    d = _positive(distance, "distance")
    y = first * first + second * second + d * d
    root = np.sqrt(((first - second) ** 2 + d * d) * ((first + second) ** 2 + d * d))
    value = 2 * second * second / (y + root)
    return FormFactor(value, 8 * _EPSILON * value)


def inside_sphere(area: Any, radius: Any) -> FormFactor:
    r"""From anywhere inside a sphere to a patch of it: $A/(4\pi r^2)$, whatever the place (shapes broadcast).

    ValueError for areas or radii that are not positive and finite.
    """
    area, radius = _positive(area, "area"), _positive(radius, "radius")
    value = area / (4 * np.pi * radius * radius)
    return FormFactor(value, 4 * _EPSILON * value)


def _alternating(term: Callable[..., tuple[np.ndarray, np.ndarray]], *sides: np.ndarray) -> FormFactor:
    """The closed form: `term`, value and size of a corner, at the ends of the four sides, over the area of the first two."""
    area = (sides[0][..., 1] - sides[0][..., 0]) * (sides[1][..., 1] - sides[1][..., 0])
    total, size = np.asarray(0.0), np.asarray(0.0)
    for corner in itertools.product(range(2), repeat=4):
        value, parts = term(*(side[..., end] for side, end in zip(sides, corner, strict=True)))
        total, size = total + (-1) ** sum(corner) * value, size + parts
    return FormFactor(*np.broadcast_arrays(total / area, _ROUNDING * _EPSILON * size / area))


def _intervals(**ends: Any) -> Iterator[Float[np.ndarray, "... 2"]]:
    for name, value in ends.items():
        array = np.asarray(value, float)
        pairs = array.ndim > 0 and array.shape[-1] == 2
        if not pairs or not np.all(np.isfinite(array)) or not np.all(array[..., 1] > array[..., 0]):
            raise ValueError(f"{name} must be two finite rising numbers (..., 2); got {array.tolist()}")
        yield array


def _positive(value: Any, name: str, zero: bool = False) -> np.ndarray:
    values = np.asarray(value, float)
    right = np.isfinite(values) & ((values >= 0) if zero else (values > 0))
    if not np.all(right):
        raise ValueError(f"{name} must be finite and {'>= 0' if zero else '> 0'}; got {values[~right].flat[0]:g}")
    return values
