r"""Albedos of truncated powers at many ends from one function of one variable for each cosine.

A truncated power is $(1 - x/X)^k$ up to its end X and 0 beyond, with x the versine or the angle of a lobe. Its albedo
$H(X) = \int_0^{\min(X, e)} (1 - x/X)^k\, W(x)\, dx$ depends on the cosine through W alone (the azimuth integral of `zonal`),
so that for one cosine all ends, that is all exponents, share one function H. In the notation of `polar` it has three pieces:

* X below the horizon kink: W is a polynomial in the versine, a sum of two sines in the angle, times functions of the cosine;
  H is a power series in X times the same functions: two multiplications a cell;
* X between the kink and the end e of the horizon: H is analytic in u = log(t + sqrt(t^2 + t_d^2)), t = tan(f/4), where
  t = i t_d is the angle 0, the only singularity nearby. A Chebyshev series in u of H/exp(m u), with m the power with which
  H sets in, keeps the relative accuracy;
* X beyond e: in y = e/X it is the Bernstein polynomial of degree k whose coefficients are the moments of (1 - x/e)^j.

Values at the Chebyshev points are sums of positive terms: moments about 0, or a spectral integration, would lose all digits
at small ends. The error estimate repeats them with panels of twice the length.
"""

from __future__ import annotations

from math import factorial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.brdf.base import Form
from brdfcheck.geometry import safe_root
from brdfcheck.numerics import gauss
from brdfcheck.quadrature.polar import EDGE_SHARE, graded_gauss, grazing_safe, half_elevation

Measure = Literal["versine", "angle"]

# The power of t with which the integral sets in past the kink.
_ONSET = {"mirror": 3, "half": 4}
# exp(-42) = 6e-19: further down, what an 8th power draws to its foot is still below the rounding.
_LEAD = 42.0
_SERIES = 16
# Of the Chebyshev sum by its recurrence, and of nodes next to the far end; in units of the machine epsilon.
_ROUNDING = 2
_FAR_ROUNDING = 128
_TINY = 1e-300
# Below this cosine the far end is seen in the angle from 90 degrees, smoothed over `_SMOOTH`, above it in f.
_STEEP = 3e-3
_SMOOTH = 0.02
# The square of the ratio of ends below which the shorter one, whose integral falls with its fourth power, adds nothing.
_SHORT = 1e-8
_MARGIN = 0.01


class MomentOrder(NamedTuple):
    """Chebyshev intervals (even), and Gauss nodes: inside the full circles, before the first point, in an interval."""

    intervals: int
    circle: int
    lead: int
    gap: int


class Ends(NamedTuple):
    """What a truncated power's end needs of every cosine; arrays of one shape, (ends,)."""

    reciprocal: Array
    versine: Array  # of the full angle x of `polar`, clipped to its range
    first: Array  # the albedo if all circles were full: the part times cos (mirror) or cos^2 (half)
    second: Array  # and the part times sin^2 (half)


def _circle_series(form: Form, measure: Measure, power: int) -> tuple[np.ndarray, np.ndarray]:
    """H below the kink as power series in X without its first factor X; falling powers, as for `polyval`."""
    if measure == "versine":
        parts = (
            [[2 * np.pi, -2 * np.pi], [0.0]]
            if form == "mirror"
            else [[8 * np.pi * c for c in (1, -5, 6, -2)], [8 * np.pi * c for c in (0, 2, -3, 1)]]
        )
    else:
        parts = [[0.0] * (2 * _SERIES) for _ in range(2)]
        for i in range(_SERIES):
            j = 2 * i + 1
            sign = np.pi * (-1) ** i / factorial(j)
            parts[0][j] = sign * 2**j if form == "mirror" else sign * 2 * 4**j
            parts[1][j] = 0.0 if form == "mirror" else sign * (2 * 2**j - 4**j)

    def integrated(part: list[float]) -> np.ndarray:
        beta = [factorial(j) * factorial(power) / factorial(j + power + 1) for j in range(len(part))]
        return np.array([c * b for c, b in zip(part, beta, strict=True)][::-1])

    return integrated(parts[0]), integrated(parts[1])


def _horner(coefficients: np.ndarray, x: Array) -> Array:
    total = jnp.zeros_like(x)
    for value in coefficients:
        total = total * x + float(value)
    return total


def prepare(form: Form, measure: Measure, power: int, reciprocal: Float[Array, " ends"]) -> Ends:
    """Everything about ends 1/`reciprocal` (0 for no end at all) that does not depend on the cosine."""
    limit = (1.0 if form == "mirror" else 1 - np.sqrt(0.5)) if measure == "versine" else np.pi / (2 if form == "mirror" else 4)
    largest = 1.0 if measure == "versine" else np.pi / 2
    end = 1 / jnp.maximum(reciprocal, 1 / largest)
    versine = end if measure == "versine" else 2 * jnp.sin(end / 2) ** 2
    if form == "half":  # x is twice the lobe's angle
        versine = 2 * versine * (2 - versine)
    inside = jnp.minimum(end, limit)  # kinks lie below: the series need not hold further out
    first, second = (inside * _horner(series, inside) for series in _circle_series(form, measure, power))
    return Ends(reciprocal, versine, first, second)


class _Geometry(NamedTuple):
    """One cosine: scalars."""

    mu: Array
    sine: Array
    sine_squared: Array  # has a derivative at normal incidence, where the sine has none
    versine: Array  # of the elevation d
    layer: Array  # t_d: the angle 0 is t = i t_d, as seen from either end of the cut circles
    kink: Array  # d and the end of the horizon in the lobe's measure
    end: Array


def _geometry(form: Form, measure: Measure, cos_theta: Array) -> _Geometry:
    mu, sine = grazing_safe(cos_theta)
    half_d = half_elevation(mu, sine)
    # At normal incidence the kink does not move: what its moving adds is in `EDGE_SHARE`.
    versine = jnp.where(sine > 0, mu * half_d, 1)
    # The angle x = 0 is f = i artanh(mu).
    layer = half_d / (1 + safe_root(1 - half_d * half_d))
    d = 2 * jnp.arctan(half_d)
    if form == "mirror":
        end = jnp.ones_like(mu) if measure == "versine" else jnp.full_like(mu, np.pi / 2)
        kink = versine if measure == "versine" else d
    elif measure == "versine":
        kink, end = versine / 2 / (1 + jnp.sqrt(1 - versine / 2)), 1 - jnp.sqrt(versine / 2)
    else:
        kink, end = d / 2, np.pi / 2 - d / 2
    return _Geometry(mu, sine, (1 - mu) * (1 + mu), versine, layer, kink, end)


def _quarter(at: _Geometry, above: Array) -> Array:
    """tan(f/4) where the versine is that of d plus `above`, in [0, 2 sine]."""
    total = safe_root(2 * at.sine - above) + safe_root(2 * at.sine)
    # Not over a maximum: at normal incidence, where both parts are 0, the derivative would be 0 times infinity.
    return safe_root(above) / jnp.where(total > 0, total, 1)


class _Map(NamedTuple):
    """u = log(odd t + sqrt(t^2 + layer^2) + shift): odd is 1, or 0 where the root alone is the better variable."""

    odd: Array
    layer: Array
    shift: Array

    def rise(self, t: Array) -> Array:
        """exp(u)."""
        return self.odd * t + jnp.sqrt(t * t + self.layer * self.layer) + self.shift

    def back(self, u: Array) -> Array:
        """t from u."""
        rise = jnp.exp(u) - self.shift
        odd = (rise - self.layer * self.layer / jnp.maximum(rise, _TINY)) / 2
        return jnp.where(self.odd > 0, jnp.maximum(odd, 0), safe_root((rise - self.layer) * (rise + self.layer)))


def _samples(form: Form, measure: Measure, at: _Geometry, t: Array, right: bool) -> tuple[Array, Array]:
    """Past the kink, at t = tan(f/4), or tan((pi-f)/4): x in the lobe's measure and the density of the albedo in t."""
    reciprocal = 1 / (1 + t * t)
    half_sin, half_cos = 2 * t * reciprocal, (1 - t) * (1 + t) * reciprocal
    if right:
        half_sin, half_cos = half_cos, half_sin
    sin_f, cos_f = 2 * half_sin * half_cos, (half_cos - half_sin) * (half_cos + half_sin)
    versine = at.versine + 2 * at.sine * half_sin**2
    coversine = at.versine + 2 * at.sine * half_cos**2
    azimuth, horizon, cos = jnp.arctan2(sin_f, -at.mu * cos_f), at.sine * sin_f, at.sine * cos_f
    sin_squared, cos_squared = versine / 2, coversine / 2
    if form == "mirror":
        kernel = azimuth * at.mu * cos + horizon
    else:
        kernel = azimuth * (at.mu * at.mu * cos + at.sine * at.sine * sin_squared)
        kernel = kernel + at.mu * horizon * (2 + 3 * cos) / (4 * cos_squared)
    density = 8 * kernel * horizon * reciprocal
    if measure == "angle":
        x = jnp.arctan2(safe_root(versine), safe_root(coversine))
        return (2 * x if form == "mirror" else x), density
    return (versine if form == "mirror" else sin_squared / (1 + jnp.sqrt(cos_squared))), density


def _circles(form: Form, measure: Measure, at: _Geometry, count: int) -> tuple[Array, Array]:
    """Nodes and weights inside the full circles."""
    nodes, weights = (jnp.asarray(table, at.mu.dtype) for table in gauss(count))
    x = at.kink * nodes
    v = x if measure == "versine" else 2 * jnp.sin(x / 2) ** 2
    c = 1 - v
    if form == "mirror":
        density = 2 * np.pi * at.mu * c
    else:
        density = 8 * np.pi * c * (at.mu**2 * (2 * c * c - 1) + at.sine_squared * v * (2 - v))
    return x, at.kink * weights * (density if measure == "versine" else density * jnp.sin(x))


def _lobatto(count: int) -> np.ndarray:
    return -np.cos(np.pi * np.arange(count + 1) / count)


def _to_coefficients(count: int) -> np.ndarray:
    """The matrix from values at the rising Lobatto points to Chebyshev coefficients."""
    j = np.arange(count + 1)
    matrix = 2 / count * (-1.0) ** j[:, None] * np.cos(np.pi * np.outer(j, j) / count)
    matrix[:, [0, -1]] /= 2
    matrix[[0, -1]] /= 2
    return matrix


class _Panel(NamedTuple):
    """Past the kink, seen from one end: u and its range."""

    low: Array
    high: Array
    map: _Map

    def points(self, count: int) -> Array:
        """The values of u at the Lobatto points."""
        return (self.high + self.low) / 2 + (self.high - self.low) / 2 * jnp.asarray(_lobatto(count), self.low.dtype)


def _values(
    form: Form, measure: Measure, power: int, at: _Geometry, panels: list[_Panel], order: MomentOrder
) -> tuple[list[Array], Array]:
    """H at each panel's Lobatto points, and the moments of (1 - x/e)^j."""
    dtype = at.mu.dtype
    resolved = _Map(jnp.ones_like(at.mu), at.layer, jnp.zeros_like(at.mu))
    gap, gap_weights = (jnp.asarray(table, dtype) for table in gauss(order.gap))
    lead, lead_weights = (jnp.asarray(table, dtype) for table in graded_gauss(order.lead, 1, 2))
    parts, values = [_circles(form, measure, at, order.circle)], []
    for right, panel in enumerate(panels):
        t = panel.map.back(panel.points(order.intervals))
        ends, _ = _samples(form, measure, at, t, bool(right))
        u = jax.lax.optimization_barrier(jnp.log(resolved.rise(t)))  # the nodes always resolve the layer
        start, stop = (u[0], u[1]) if right else (jnp.log(at.layer), u[0])
        start = jnp.maximum(start, stop - _LEAD / _ONSET[form])
        low, length = u[right:-1], jnp.diff(u[right:])
        for nodes, steps in (
            (start + (stop - start) * lead, (stop - start) * lead_weights),
            ((low + length * gap[:, None]).ravel(), (length * gap_weights[:, None]).ravel()),
        ):
            t = resolved.back(nodes)
            x, density = _samples(form, measure, at, t, bool(right))
            slope = jnp.sqrt(t * t + at.layer * at.layer)  # dt/du
            # Without the barriers the compiler joins the parts and evaluates every node several times.
            parts.append(jax.lax.optimization_barrier((x, density * slope * steps)))
        inverse = jax.lax.optimization_barrier(1 / ends)[:, None]
        values.append(sum(jnp.maximum(1 - x * inverse, 0) ** power @ weight for x, weight in parts))
    moments = []
    for j in range(power + 1):
        shares = (jnp.maximum(1 - x / at.end, 0) for x, _ in parts)
        moments.append(sum(y**j @ part[1] for y, part in zip(shares, parts, strict=True)))
    # 0; its derivative at normal incidence is that of the circles past the horizon.
    moments[0] = moments[0] + jnp.where(at.sine == 0, EDGE_SHARE[form] * at.sine_squared, 0)
    return values, jnp.stack(moments)


def _chebyshev_sum(coefficients: list[Array], x: Array) -> Array:
    """sum c_j T_j(x): even and odd terms as two independent recurrences in T_2."""
    twice = 4 * x * x - 2

    def chain(part: list[Array]) -> tuple[Array, Array, Array]:
        one = two = jnp.zeros_like(x)
        for value in part[:0:-1]:
            one, two = twice * one - two + value, one
        return one, two, part[0]

    one, two, first = chain(coefficients[::2])
    even = first + 0.5 * twice * one - two
    one, two, first = chain(coefficients[1::2])
    return even + x * (first + twice * one - two - one)


def truncated_powers(
    form: Form, measure: Measure, power: int, ends: Ends, cos_theta: Float[Array, ""], orders: tuple[MomentOrder, MomentOrder]
) -> tuple[Float[Array, " ends"], Float[Array, ""], Float[Array, " ends"]]:
    """H at all ends for one cosine, and its error but for a few roundings: at most relative * H + absolute.

    The two parts are for the caller to put together outside of the loop over cosines: the compiler joins every use of H with
    the sum that makes it, and would do that sum a second time.
    """
    at = _geometry(form, measure, cos_theta)
    fine, coarse = orders
    above = jax.lax.optimization_barrier(ends.versine - at.versine)
    # A little wider than the ends: formed a second time a difference may be rounded differently, and ends near the kink notice.
    most = (1 + _MARGIN) * jnp.max(above)
    least = (1 - _MARGIN) * jnp.maximum(jnp.min(above), _SHORT * (most + at.versine) - at.versine)
    one, zero = jnp.ones_like(at.mu), jnp.zeros_like(at.mu)
    # f = pi/2 parts the two ends of the cut circles; the mirror form stops there.
    limits, maps = [(jnp.clip(least, 0, at.sine), jnp.clip(most, 0, at.sine))], [_Map(one, at.layer, zero)]
    if form == "half":
        # Up to f = pi/2 even where no end lies there: the integrals of the further ends pass through.
        limits.append(((1 - _MARGIN) * jnp.clip(2 * at.sine - most, 0, at.sine), at.sine))
        steep = at.mu < _STEEP
        maps.append(_Map(jnp.where(steep, zero, one), at.layer, jnp.where(steep, _SMOOTH, zero)))
    panels = [
        _Panel(jnp.log(map.rise(_quarter(at, low))), jnp.log(map.rise(_quarter(at, high))), map)
        for (low, high), map in zip(limits, maps, strict=True)
    ]
    values, moments = _values(form, measure, power, at, panels, fine)
    checks, coarse_moments = _values(form, measure, power, at, panels, coarse)
    rounding = _ROUNDING * float(jnp.finfo(at.mu.dtype).eps)
    skip = fine.intervals // coarse.intervals
    matrix = jnp.asarray(_to_coefficients(fine.intervals), at.mu.dtype)
    error, tails, series = jnp.max(jnp.abs(moments - coarse_moments) / moments), [], []
    grown = _ONSET[form] - (2 if measure == "angle" else 0)
    for right, (panel, value, check) in enumerate(zip(panels, values, checks, strict=True)):
        scaled = value if right else value * jnp.exp(-grown * panel.points(fine.intervals))
        series.append(matrix @ scaled)
        size = jnp.abs(series[-1])
        tails.append(2 * jnp.sum(size[-3:]) + rounding * jnp.sum(size * jnp.arange(1, size.size + 1, dtype=size.dtype)))
        error = jnp.maximum(error, jnp.max(jnp.abs(value[::skip] - check) / check))

    distance, panel, coefficients = above, panels[0], list(series[0])
    right = above > at.sine
    if form == "half":
        distance = jnp.where(right, 2 * at.sine - above, above)
        panel = jax.tree.map(lambda ours, theirs: jnp.where(right, theirs, ours), *panels)
        # A product instead of a choice, which would cost as much as the sum itself.
        theirs = jax.lax.optimization_barrier(right.astype(above.dtype))
        coefficients = [own + step * theirs for own, step in zip(series[0], series[1] - series[0], strict=True)]
    rise = panel.map.rise(_quarter(at, jnp.clip(distance, 0, at.sine)))
    middle, half = (panel.high + panel.low) / 2, (panel.high - panel.low) / 2
    place = jnp.clip((jnp.log(rise) - middle) / jnp.maximum(half, _TINY), -1, 1)
    scale = rise**grown
    if form == "half":
        scale = jnp.where(right, 1, scale)
    place, scale = jax.lax.optimization_barrier((place, scale))
    cut = jax.lax.optimization_barrier(_chebyshev_sum(coefficients, place))
    cut = cut * scale
    doubt = jnp.where(right, tails[1], tails[0]) * scale if form == "half" else tails[0] * scale
    full = ends.first * at.mu if form == "mirror" else ends.first * at.mu**2 + ends.second * at.sine_squared
    y = jnp.minimum(at.end * ends.reciprocal, 1)
    beyond, raised = jnp.full_like(y, moments[0]), jnp.ones_like(y)
    for j in range(1, power + 1):
        raised = raised * y
        beyond = beyond * (1 - y) + (factorial(power) // factorial(j) // factorial(power - j)) * moments[j] * raised
    outside, inside = at.end * ends.reciprocal < 1, above <= 0
    result = jax.lax.optimization_barrier(jnp.where(outside, beyond, jnp.where(inside, full, cut)))
    error = 4 * error + _FAR_ROUNDING * float(jnp.finfo(at.mu.dtype).eps)
    return result, error, jnp.where(outside | inside, 0, doubt)
