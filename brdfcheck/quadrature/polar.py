r"""Nodes in the polar angle for lobes about an axis, with the azimuth reduced to its half range.

Let x be the angle from the mirror direction (mirror form) or twice the angle between N and H (half form). For light at
the elevation d = pi/2 - theta, the circle of directions at x lies above the horizon for azimuths in [-p, p]:

* x <= d: the whole circle, p = pi;
* x >= d: p = atan2(sin f, -sin d cos f), where cos x = cos d cos f.

The angle f is the spherical one that takes the square root out of p: with it sin^2 x - sin^2 d = (cos d sin f)^2 and
sin x dx = cos d sin f df, so everything is analytic in f. What is left is a layer of width d at f = 0 (and at f = pi in
the half form) near grazing, whose strength falls like the cube of its width; a graded node density deals with it.

Each panel is mapped by tan(x/4) = width/4 sinh(u), which follows a lobe from its centre to an algebraic tail, and the
panel's unit interval by an incomplete beta function, which crowds nodes at both ends as a polynomial of the end distance.

Angles enter as versines v = 1 - cos and as quarter tangents tan(x/4), and everything between is algebra: one exp and one
atan2 a node. With D = v(x) - v(d) and S = 1 + cos x - v(d), tan(f/4) = sqrt(D) / (sqrt(S) + sqrt(2 cos d)).
"""

from __future__ import annotations

import functools
from math import comb
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.brdf.base import Form
from brdfcheck.geometry import safe_root
from brdfcheck.numerics import gauss

# Smaller cosines than this count as this one, so that none is 0. Its square is normal in float32.
_SMALLEST_COSINE = 1e-18

# What light that is tilted by a small theta sees of the profile next to the horizon: the albedo is that of the full circles up
# to 90 degrees from the mirror direction (45 degrees between N and H) and sin^2(theta) times this share of the profile there.
# The circles past the kink at d = 90 degrees - theta give int 2 sin(f) (p cos(f) + sin(f)) df with p = pi - f, the full ones
# that they replace int 2 pi sin(f) cos(f) df up to f = 90 degrees; the difference is pi/4 up to 90 degrees (mirror form) and
# pi/2 up to 180 (half form).
EDGE_SHARE: dict[Form, float] = {"mirror": np.pi / 4, "half": np.pi / 2}


class Order(NamedTuple):
    """How many nodes a panel gets, inside the full circles and past the horizon kink, and how they crowd at its ends."""

    circle: int
    cut: int
    circle_grading: tuple[int, int] = (1, 3)
    cut_grading: tuple[int, int] = (3, 4)


class PolarNodes(NamedTuple):
    """Nodes for the integral of (function of x) sin(x) dx, all of shape (nodes,)."""

    cos: Array
    versine: Array  # 1 - cos x
    coversine: Array  # 1 + cos x
    azimuth: Array  # p: the azimuth runs over [-p, p]
    horizon: Array  # cos(d) sin(f): 0 inside the full circles
    weight: Array


@functools.cache
def graded_gauss(count: int, start: int, end: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes under the map I_x(start, end): they crowd at the ends like powers `start` and `end`."""
    x, w = gauss(count)
    total = start + end - 1
    mapped = sum(comb(total, j) * x**j * (1 - x) ** (total - j) for j in range(start, total + 1))
    density = total * comb(total - 1, start - 1) * x ** (start - 1) * (1 - x) ** (end - 1)
    return np.asarray(mapped), w * density


def _joined(tables: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    return np.concatenate([nodes for nodes, _ in tables]), np.concatenate([weights for _, weights in tables])


class _Panel(NamedTuple):
    """Nodes between two angles: sin and cos of half the angle, and the weights of d(angle)."""

    half_sin: Array
    half_cos: Array
    weight: Array


def _arcsinh(y: Array) -> Array:
    square = y * y
    return jnp.log1p(y + square / (1 + jnp.sqrt(1 + square)))


def _panels(quarter: Array, width: Array, table: tuple[np.ndarray, np.ndarray]) -> _Panel:
    """Panels between neighbouring quarter tangents, of shape (panels, nodes); `width` is a quarter tangent too."""
    nodes, weights = (jnp.asarray(column, quarter.dtype) for column in table)
    u = _arcsinh(quarter / width)
    low, length = u[:-1, None], (u[1:] - u[:-1])[:, None]
    grown = jnp.exp(low + length * nodes) / 2
    shrunk = 0.25 / grown
    # As a difference of exponentials t loses digits near 0; but there the versine is a square, and only its absolute
    # accuracy counts.
    t = width * (grown - shrunk)
    reciprocal = 1 / (1 + t * t)
    return _Panel(
        2 * t * reciprocal,
        (1 - t) * (1 + t) * reciprocal,
        4 * width * length * reciprocal * (grown + shrunk) * weights,
    )


def grazing_safe(cos_theta: Float[Array, ""]) -> tuple[Array, Array]:
    """(cos theta kept off 0, sin theta).

    At normal incidence the derivative of sin theta, which is infinite, is taken as 0: what depends on its square has to take
    the square from the cosine, and what ends at an angle that depends on it has to say how much that matters (`EDGE_SHARE`).
    """
    # Not a maximum: the derivative at 0 is to survive. Nothing is added to other cosines: without masking the albedo of facets
    # goes like 1/cos, and would show it.
    off_zero = _SMALLEST_COSINE + (cos_theta - jax.lax.stop_gradient(cos_theta))
    mu = jnp.where(cos_theta < _SMALLEST_COSINE, off_zero, cos_theta)
    return mu, safe_root((1 - mu) * (1 + mu))


def _half_elevation(mu: Array, sine: Array) -> Array:
    """tan(d/2) of the elevation d; at normal incidence 1 with the derivative 0, as for the sine."""
    tilted = sine > 0
    return jnp.where(tilted, mu / (1 + jnp.where(tilted, sine, 1)), 1)


def polar_nodes(
    form: Form, cos_theta: Float[Array, ""], breaks: Float[Array, " breaks"], width: Array, orders: tuple[Order, ...]
) -> tuple[PolarNodes, np.ndarray]:
    """Nodes of one or more rules for a lobe whose formula changes at `breaks`.

    The breaks are rising versines of the lobe's angle, the last one is its support. `width` is the angle (radians) over
    which the lobe changes near its centre. The rules are independent; their nodes come in one array because one long
    array compiles and runs faster than two. The second result has shape (nodes,): the rule each node belongs to.
    """
    mu, sine = grazing_safe(cos_theta)
    half_d = _half_elevation(mu, sine)
    quarter_d = half_d / (1 + jnp.sqrt(1 + half_d * half_d))
    versine_d = mu * half_d
    v = jnp.concatenate([jnp.zeros_like(breaks[:1]), jnp.minimum(breaks, 1)])
    root = safe_root(v / (2 - v))
    if form == "mirror":
        width, quarter = width / 4, root / (1 + jnp.sqrt(1 + root * root))
        versine_x, coversine_x = v, 2 - v
    else:  # x = 2 gamma
        width, quarter = width / 2, root
        versine_x, coversine_x = 2 * v * (2 - v), 2 * (1 - v) ** 2
    quarter_f = safe_root(jnp.clip(versine_x - versine_d, 0, 2 * sine)) / jnp.maximum(
        safe_root(coversine_x - versine_d) + safe_root(2 * sine), _SMALLEST_COSINE
    )

    circle = _panels(
        jnp.minimum(quarter, quarter_d), width, _joined([graded_gauss(order.circle, *order.circle_grading) for order in orders])
    )
    versine = 2 * circle.half_sin**2
    full = PolarNodes(
        1 - versine,
        versine,
        2 - versine,
        jnp.full_like(versine, np.pi),
        jnp.zeros_like(versine),
        2 * circle.half_sin * circle.half_cos * circle.weight,
    )
    # Past the kink nothing is narrower than the elevation, unless the lobe itself is.
    cut = _panels(
        quarter_f,
        jnp.maximum(width, quarter_d),
        _joined([graded_gauss(order.cut, *order.cut_grading) for order in orders]),
    )
    sin_f = 2 * cut.half_sin * cut.half_cos
    cos_f = (cut.half_cos - cut.half_sin) * (cut.half_cos + cut.half_sin)
    horizon = sine * sin_f
    partial = PolarNodes(
        sine * cos_f,
        versine_d + 2 * sine * cut.half_sin**2,
        versine_d + 2 * sine * cut.half_cos**2,
        jnp.arctan2(sin_f, -mu * cos_f),
        horizon,
        horizon * cut.weight,
    )
    nodes = PolarNodes(*(jnp.concatenate([a.ravel(), b.ravel()]) for a, b in zip(full, partial, strict=True)))
    owner = [np.repeat(np.arange(len(orders)), [order[part] for order in orders]) for part in (0, 1)]
    return nodes, np.concatenate([np.tile(part, breaks.size) for part in owner])
