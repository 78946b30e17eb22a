r"""A fixed rule over the hemisphere whose nodes move with the light: for scans, where thousands of incidences share a size.

The coordinates are those of `quadrature.adaptive`: t along the plane of incidence, b across it. Six corners, one on either
side of the mirror direction, the normal and the light, reach half way to the next of these (or to the horizon). Near its
seed a corner is two triangles with their apex at the seed, in the coordinates (r, r q) and (r q, r). r is a sinh of u, so a
lobe of any width above `scale` is a bump of length one in u; q is a sinh of v whose scale is the cosine of incidence, which
crowds the nodes where grazing light makes a needle of a lobe. Two rectangles fill up a corner: beside the triangles across
the plane, and beyond them along it. What is left lies at the horizon, on either side, with nodes that crowd there.

The number of nodes is the same for every incidence, and they move smoothly with it, so that a sum over them is a smooth
function of the angle wherever the BRDF is: what a climb needs.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from brdfcheck.numerics import gauss

# The longest side of the triangles (radians), and how far from b = 0 the nodes of the rectangles beyond are crowded.
_CORE = 0.4
_SPREAD = 0.2
# The thinnest needle, as a part of its length, for which nodes are crowded.
_THINNEST = 1e-2
# The corners: which way the elevation goes from the seed, on which side of the normal, and whether the horizon is next.
_RISE = np.array([-1.0, 1.0, -1.0, -1.0, 1.0, -1.0])[:, None]
_SIDE = np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0])[:, None]
_OUTER = np.array([True, False, False, False, False, True])
_AT_NORMAL = np.array([False, False, True, True, False, False])


@dataclass(frozen=True)
class GradedRule:
    """Nodes of a triangle along (`radial`) and around (`angular`) its apex; of rectangles along and across; the finest scale.

    `scale` is in radians: narrower lobes about a seed are not resolved.
    """

    radial: int
    angular: int
    along: int
    across: int
    scale: float

    @property
    def size(self) -> int:
        """How many nodes the rule has."""
        corner = 2 * self.radial * self.angular + 2 * self.along * self.across
        return 2 * (6 * corner + 2 * self.along * self.across)

    def __call__(self, cos_theta: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """wo for light at azimuth 0 and the cosines (m,) in (0, 1]: shape (m, 3, size); (N.wo) dwo, shape (m, size)."""
        mu = cos_theta[:, None, None]
        sine = np.sqrt((1 - mu) * (1 + mu))
        theta, elevation = np.arctan2(sine, mu), np.arctan2(mu, sine)
        reach = np.where(_OUTER[:, None], elevation / 2, theta / 2)
        height = np.where(_AT_NORMAL[:, None], np.pi / 2, elevation)
        pieces = [*self._triangles(reach, height, mu), *self._rectangles(reach, height), self._horizon(elevation)]
        wo, weight = np.empty((len(mu), 3, 2, self.size // 2)), np.empty((len(mu), 2, self.size // 2))
        start = 0
        for x, y, z, share in pieces:  # both sides of the plane of incidence
            part = slice(start, start := start + x.shape[1])
            wo[:, 0, :, part], wo[:, 2, :, part] = x[:, None], z[:, None]
            wo[:, 1, 0, part], wo[:, 1, 1, part] = y, -y
            weight[:, :, part] = share[:, None]
        return wo.reshape(len(mu), 3, -1), weight.reshape(len(mu), -1)

    def _triangles(self, reach: np.ndarray, height: np.ndarray, mu: np.ndarray) -> list[tuple[np.ndarray, ...]]:
        (u, du), (v, dv) = gauss(self.radial), gauss(self.angular)
        longest = np.arcsinh(np.minimum(reach, _CORE) / self.scale)
        grown = np.exp(longest * u)
        radius = self.scale * (grown - 1 / grown) / 2
        # A needle is about as thin as the light is low.
        thin = np.maximum(mu, _THINNEST)
        across, stretch = _sinh_from_zero(thin, v)
        density = (self.scale * (grown + 1 / grown) / 2 * longest * radius * du)[..., None] * (stretch * dv)[:, :, None]
        lag = radius[..., None] * across[:, :, None]
        lead = radius[..., None]
        height, rise, side = height[..., None], _RISE[..., None], _SIDE[..., None]
        return [_placed(height + rise * a, b, side, density) for a, b in ((lead, lag), (lag, lead))]

    def _rectangles(self, reach: np.ndarray, height: np.ndarray) -> list[tuple[np.ndarray, ...]]:
        (x, dx), (y, dy) = gauss(self.along), gauss(self.across)
        core = np.minimum(reach, _CORE)
        beside, stretch = _crowded(np.maximum(core, self.scale), core, y)
        beyond, stretch_beyond = _crowded(np.full_like(core, _SPREAD), np.zeros_like(core), y)
        height, rise, side = height[..., None], _RISE[..., None], _SIDE[..., None]
        near, far = (core * x)[..., None], (core + (reach - core) * x)[..., None]
        return [
            _placed(height + rise * near, beside[:, :, None], side, (core * dx)[..., None] * (stretch * dy)[:, :, None]),
            _placed(
                height + rise * far,
                beyond[:, :, None],
                side,
                ((reach - core) * dx)[..., None] * (stretch_beyond * dy)[:, :, None],
            ),
        ]

    def _horizon(self, elevation: np.ndarray) -> tuple[np.ndarray, ...]:
        (x, dx), (y, dy) = gauss(self.along), gauss(self.across)
        half = np.broadcast_to(elevation / 2, (len(elevation), 2, 1))
        across, stretch = _crowded(np.maximum(half, self.scale), np.zeros_like(half), y)
        density = (half * 2 * x * dx)[..., None] * (stretch * dy)[:, :, None]
        return _placed((half * x**2)[..., None], across[:, :, None], np.array([-1.0, 1.0])[:, None, None], density)


def _sinh_from_zero(scale: np.ndarray, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places from 0 to 1, spread evenly up to `scale` and geometrically from there; and their density."""
    length = np.arcsinh(1 / scale)
    grown = np.exp(length * unit)
    return scale * (grown - 1 / grown) / 2, scale * (grown + 1 / grown) / 2 * length


def _crowded(scale: np.ndarray, low: np.ndarray, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places from `low` to pi/2, spread evenly up to `scale` and geometrically from there; and their density."""
    start = np.arcsinh(low / scale)
    length = np.arcsinh(np.pi / 2 / scale) - start
    grown = np.exp(start + length * unit)
    return scale * (grown - 1 / grown) / 2, scale * (grown + 1 / grown) / 2 * length


def _placed(elevation: np.ndarray, across: np.ndarray, side: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, ...]:
    """x, y, z of the directions and (N.wo) dwo, each (m, nodes)."""
    cosine = np.cos(across)
    normal = cosine * np.sin(elevation)
    parts = (side * cosine * np.cos(elevation), np.sin(across), normal, density * cosine * normal)
    shape = np.broadcast_shapes(*(part.shape for part in parts))
    return tuple(np.broadcast_to(part, shape).reshape(shape[0], -1) for part in parts)
