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

from brdfcheck.numerics import gauss, sine_cosine

# The longest side of the triangles (radians), and how far from b = 0 the nodes of the rectangles beyond are crowded.
_CORE = 0.4
_SPREAD = 0.2
# The thinnest needle, as a part of its length, for which nodes are crowded.
_THINNEST = 1e-2
# The corners on the light's side of the normal: down from the light, up from it, down from the normal. Those on the other side
# are their mirror images.
_RISE = np.array([-1.0, 1.0, -1.0])[:, None]


@dataclass(frozen=True)
class GradedRule:
    """Nodes of a triangle along (`radial`) and around (`angular`) its apex; of rectangles along and across; the finest scale.

    `scale` is in radians: narrower lobes about a seed are not resolved. `half`: only the nodes on one side of the plane of
    incidence, each for two; of a whole rule they are the first half.
    """

    radial: int
    angular: int
    along: int
    across: int
    scale: float
    half: bool = False

    @property
    def size(self) -> int:
        """How many nodes the rule has."""
        return (2 if self.half else 4) * self._quarter

    @property
    def _quarter(self) -> int:
        return 3 * 2 * (self.radial * self.angular + self.along * self.across) + self.along * self.across

    def fill(self, cos_theta: np.ndarray, wo: np.ndarray, weight: np.ndarray) -> None:
        """Write the nodes for light at azimuth 0 and the cosines (m,) in (0, 1].

        wo, shape (3, m, size), gets the directions, and weight, shape (m, size), gets (N.wo) dwo.
        """
        count, corner = len(cos_theta), self._quarter - self.along * self.across
        mu = cos_theta[:, None]
        sine = np.sqrt((1 - mu) * (1 + mu))
        elevation = np.arctan2(mu, sine)
        reach = np.empty((count, 3, 1))  # half way to the next seed
        reach[:, 0], reach[:, 1:] = elevation / 2, np.arctan2(sine, mu)[:, None] / 2
        # The angle of each node along the plane of incidence (from its seed), that across it, and the density of nodes.
        table = np.empty((3, count, self._quarter))
        corners = table[..., :corner].reshape(3, count, 3, -1)
        triangles = 2 * self.radial * self.angular
        self._triangles(corners[..., :triangles], reach, mu[..., None])
        self._rectangles(corners[..., triangles:], reach)
        self._horizon(table[..., corner:], elevation[..., None])
        offset, away, density = table
        up, flat = sine_cosine(offset)
        y, cosine = sine_cosine(away)
        # From offsets to elevations: the seeds' are theta's own and a right angle.
        height, width = np.ones((count, 3, 1)), np.zeros((count, 3, 1))
        height[:, :2], width[:, :2] = mu[..., None], sine[..., None]
        turned, straight = (part[:, :corner].reshape(count, 3, -1) for part in (up, flat))
        turned *= _RISE
        turned[:], straight[:] = height * straight + width * turned, width * straight - height * turned
        x, z = flat * cosine, up * cosine
        # The four quarters are images of each other in the plane of incidence and in the one across it.
        images, shares = wo.reshape(3, count, -1, self._quarter), weight.reshape(count, -1, self._quarter)
        images[0, :, ::2] = x[:, None]
        images[1, :, :2] = y[:, None]
        images[2] = z[:, None]
        np.negative(x[:, None], out=images[0, :, 1::2])
        np.negative(y[:, None], out=images[1, :, 2:])
        shares[:] = ((2 if self.half else 1) * density * cosine * z)[:, None]

    def _triangles(self, corners: np.ndarray, reach: np.ndarray, mu: np.ndarray) -> None:
        (u, du), (v, dv) = gauss(self.radial), gauss(self.angular)
        grown, length = _crowded(self.scale, 0.0, np.minimum(reach, _CORE), u)
        # A needle is about as thin as the light is low.
        across, stretch = _crowded(np.maximum(mu, _THINNEST), 0.0, 1.0, v)
        offset, away, density = corners.reshape(*corners.shape[:-1], 2, self.radial, self.angular)
        lag = grown[..., None] * across[:, :, None]
        offset[:, :, 0], offset[:, :, 1] = grown[..., None], lag
        away[:, :, 0], away[:, :, 1] = lag, grown[..., None]
        density[:] = ((length * grown * du)[..., None] * (stretch * dv)[:, :, None])[:, :, None]

    def _rectangles(self, corners: np.ndarray, reach: np.ndarray) -> None:
        (x, dx), (y, dy) = gauss(self.along), gauss(self.across)
        offset, away, density = corners.reshape(*corners.shape[:-1], 2, self.along, self.across)
        core = np.minimum(reach, _CORE)
        rest = reach - core
        beside, stretch = _crowded(np.maximum(core, self.scale), core, np.pi / 2, y)
        beyond, stretch_beyond = _crowded(_SPREAD, 0.0, np.pi / 2, y)
        offset[:, :, 0], offset[:, :, 1] = (core * x)[..., None], (core + rest * x)[..., None]
        away[:, :, 0], away[:, :, 1] = beside[:, :, None], beyond
        np.multiply((core * dx)[..., None], (stretch * dy)[:, :, None], out=density[:, :, 0])
        np.multiply((rest * dx)[..., None], stretch_beyond * dy, out=density[:, :, 1])

    def _horizon(self, nodes: np.ndarray, elevation: np.ndarray) -> None:
        (x, dx), (y, dy) = gauss(self.along), gauss(self.across)
        offset, away, density = nodes.reshape(*nodes.shape[:-1], self.along, self.across)
        half = elevation / 2
        across, stretch = _crowded(np.maximum(half, self.scale), 0.0, np.pi / 2, y)
        offset[:], away[:] = half * (x * x)[:, None], across
        np.multiply(half * (2 * x * dx)[:, None], stretch * dy, out=density)


def _crowded(
    scale: np.ndarray | float, low: np.ndarray | float, high: np.ndarray | float, unit: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Places from `low` to `high`, spread evenly up to `scale` and geometrically from there; and their density."""
    start = np.arcsinh(low / scale)
    length = np.arcsinh(high / scale) - start
    grown = np.exp(start + length * unit)
    shrunk = 1 / grown
    half = scale / 2
    return half * (grown - shrunk), half * length * (grown + shrunk)
