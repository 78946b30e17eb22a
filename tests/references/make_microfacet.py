r"""Reference albedos of microfacet lobes: ``python tests/references/make_microfacet.py > microfacet.csv``.

Columns: distribution, masking, fresnel, f0, m, cos_theta, albedo, error. `m` is Beckmann's m or the alpha of GGX; with
fresnel "none" F = 1, with "dielectric" F is the exact unpolarised one of the real index (1+sqrt f0)/(1-sqrt f0). The
error is absolute: twice the larger change against two coarser rules, and at least 1e-14. It takes about eight minutes.

Method. f = F D G / (4 (N.L)(N.V)). With H proportional to (x, y, 1), the light at (sin t, 0, cos t) and T = tan t, the
Jacobians cancel and the albedo is an integral over slopes,

    E = int int F G P22(x, y) (1 + x T) dx dy   over the disk 1 + 2 x T - x^2 - y^2 > 0 (the viewer above the horizon),

P22 = exp(-r^2/m^2)/(pi m^2) (Beckmann) or alpha^2/(pi (alpha^2 + r^2)^2) (GGX), r^2 = x^2 + y^2, and
N.V = cos t (2 (1 + x T)/(1 + r^2) - 1). Everything is a function of x and y in closed form: no angles, no acos.

Masking. Smith (Walter et al. 2007, Heitz 2014): exact Lambda = (erf(a) - 1)/2 + exp(-a^2)/(2 a sqrt pi) with
a = cot(angle)/m for Beckmann, (-1 + sqrt(1 + alpha^2 tan^2))/2 for GGX; separable G = G1 G1, correlated
G = 1/(1 + Lambda + Lambda). V-cavities (Cook & Torrance 1982): G = min(1, 2 (N.H)(N.V)/(V.H), 2 (N.H)(N.L)/(V.H))
= min(1, 4/(1+r^2) - 2/(1+xT), 2/(1+xT)). The first two meet on y^2 = 4(1+xT)/(3+xT) - 1 - x^2, the last two on the
circle y^2 = xT - x^2, all three at x = 1/T.

Strips: x outside, y inside. In y the panels run from 0 over multiples of the lobe's width and the kink to the horizon;
in x over such multiples, 1/T, and wherever one of the curves above meets y = 0 (x = tan((t - pi/2 + k pi)/3), 0, T and
the ends of the disk), with layers where these curves cross the lobe. The map sin^2(pi u/2) of each panel removes the
square roots at its ends; then follows Gauss-Legendre. `--check` sums instead over outgoing directions, with the
formula of f as it stands, and compares with values printed elsewhere.
"""

from __future__ import annotations

import functools
import math
import sys

import numpy as np
from scipy.special import erf

SIZES = (0.01, 1 / 64, 0.05, 0.1, 0.2, 0.4, 0.484375, 0.7, 0.984375, 1.0)
COSINES = (1 / 64, 0.05, 0.2, 0.5, 0.8, 1.0)
MASKINGS = ("v-cavities", "smith-separable", "smith-correlated")


@functools.cache
def rule(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre on [0, 1] under the map sin^2(pi u / 2)."""
    x, w = np.polynomial.legendre.leggauss(order)
    u = (1 + x) / 2
    return np.sin(np.pi * u / 2) ** 2, w / 2 * np.pi / 2 * np.sin(np.pi * u)


def composite(edges: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights on every panel between rising `edges` (last axis)."""
    x, w = rule(order)
    length = np.diff(edges)[..., None]
    nodes = edges[..., :-1, None] + length * x
    return nodes.reshape(*edges.shape[:-1], -1), (length * w).reshape(*edges.shape[:-1], -1)


def density(distribution: str, m: float, r2: np.ndarray) -> np.ndarray:
    if distribution == "beckmann":
        return np.exp(-r2 / m**2) / (np.pi * m**2)
    return m**2 / (np.pi * (m**2 + r2) ** 2)


def smith_lambda(distribution: str, m: float, mu: np.ndarray, sine_squared: np.ndarray) -> np.ndarray:
    """Smith's Lambda; mu > 0."""
    tangent = np.sqrt(np.maximum(sine_squared, 1e-300)) / mu
    if distribution == "ggx":
        # (-1 + sqrt(1 + q)) / 2 without the cancellation.
        q = (m * tangent) ** 2
        return q / (2 * (1 + np.sqrt(1 + q)))
    a = 1 / (m * tangent)
    with np.errstate(under="ignore"):
        return (erf(a) - 1) / 2 + np.exp(-(np.minimum(a, 40) ** 2)) / (2 * a * math.sqrt(math.pi))


def fresnel_factor(f0: float, c: np.ndarray) -> np.ndarray | float:
    """Unpolarised Fresnel reflectance; f0 = 1 is F = 1."""
    if f0 == 1:
        return 1.0
    eta = (1 + math.sqrt(f0)) / (1 - math.sqrt(f0))
    g = np.sqrt(eta**2 + c**2 - 1)
    return 0.5 * ((g - c) / (g + c)) ** 2 * (1 + ((c * (g + c) - 1) / (c * (g - c) + 1)) ** 2)


def integrand(distribution: str, masking: str, f0: float, m: float, mu: float, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """F G P22 (1 + x T) at slopes (x, y) inside the disk."""
    sine = math.sqrt((1 - mu) * (1 + mu))
    r2 = x * x + y * y
    lift = 1 + x * sine / mu
    mu_o = np.maximum(mu * (2 * lift / (1 + r2) - 1), 1e-100)
    if masking == "none":
        masked: np.ndarray | float = 1.0
    elif masking == "v-cavities":
        masked = np.clip(np.minimum(4 / (1 + r2) - 2 / lift, 2 / lift), 0, 1)
    else:
        # V = 2 (L.H) H - L: its horizontal part, so that the sine is exact where V is near the normal.
        vx, vy = 2 * mu * lift * x / (1 + r2) - sine, 2 * mu * lift * y / (1 + r2)
        lambda_i = smith_lambda(distribution, m, np.asarray(mu), np.asarray(sine**2))
        lambda_o = smith_lambda(distribution, m, mu_o, vx * vx + vy * vy)
        if masking == "smith-separable":
            masked = 1 / ((1 + lambda_i) * (1 + lambda_o))
        else:
            masked = 1 / (1 + lambda_i + lambda_o)
    return fresnel_factor(f0, mu * lift / np.sqrt(1 + r2)) * masked * density(distribution, m, r2) * lift


def steps(distribution: str, refine: int) -> np.ndarray:
    """Ends of the panels in units of the lobe's width."""
    if distribution == "beckmann":
        return np.linspace(0, 6.7, 1 + 6 * refine)  # exp(-6.7^2) = 3e-20
    ratio = 2.0 ** (1 / refine)
    return np.concatenate([[0], 0.5 * ratio ** np.arange(0, 18 * refine)])


def albedo_of(
    distribution: str, masking: str, f0: float, m: float, mu: float, order: tuple[int, int], refine: int = 1
) -> float:
    sine = math.sqrt((1 - mu) * (1 + mu))
    theta = math.atan2(sine, mu)
    slope = sine / mu
    # The disk: 1 + 2 x T - x^2 > 0.
    left, right = -mu / (1 + sine), (1 + sine) / mu
    scales = m * steps(distribution, refine)
    # Where a curve meets y = 0, V = N (where Smith's term has its least analytic point), and the normal itself.
    special = [left, right, 0.0, slope, math.tan(theta / 2)]
    special += [math.tan((theta - math.pi / 2 + k * math.pi) / 3) for k in (-1, 0, 1)]
    if slope > 0:
        special.append(1 / slope)
    # Near these the curves rise like square roots and cross the lobe within a layer of this width.
    layer = scales**2 / (right - left)
    around = np.concatenate([-layer, layer, -scales, scales])
    edges = np.concatenate([around, (np.asarray(special)[:, None] + around).ravel()])
    if distribution == "beckmann":
        low, high = max(left, -scales[-1]), min(right, scales[-1])
    else:
        low, high = left, right
    edges = np.unique(np.clip(np.concatenate([edges, [low, high]]), low, high))
    edges = edges[np.concatenate([[True], np.diff(edges) > 1e-13 * (high - low)])]
    edges[-1] = high
    total = []
    xs, ws = composite(edges, order[0])
    # Chunks keep the arrays small.
    chunks = max(1, xs.size // 400)
    for x, w in zip(np.array_split(xs, chunks), np.array_split(ws, chunks), strict=True):
        top = np.sqrt(np.maximum((x - left) * (right - x), 0))
        limit = np.minimum(top, scales[-1]) if distribution == "beckmann" else top
        columns = [np.zeros_like(x), limit]
        # The width of P22 in y at this x: alpha for Beckmann, sqrt(alpha^2 + x^2) for GGX.
        width = np.full_like(x, 1.0) if distribution == "beckmann" else np.sqrt(1 + (x / m) ** 2)
        columns += [width * s for s in scales[1:]]
        if masking == "v-cavities":
            lift = 1 + x * slope
            kink = np.where(lift < 2, 4 * lift / (2 + lift) - 1 - x * x, (slope - x) * x)
            columns.append(np.sqrt(np.maximum(kink, 0)))
        stops = np.sort(np.minimum(np.stack(columns, axis=-1), limit[:, None]), axis=-1)
        # Panels empty everywhere are dropped.
        keep = np.concatenate([[True], np.any(np.diff(stops, axis=-1) > 0, axis=0)])
        y, wy = composite(stops[:, keep], order[1])
        values = integrand(distribution, masking, f0, m, mu, x[:, None], y)
        total.append(2 * np.sum(w * np.sum(values * wy, axis=-1)))
    return math.fsum(total)


def reference(distribution: str, masking: str, f0: float, m: float, mu: float) -> tuple[float, float]:
    """(albedo, error)."""
    best = albedo_of(distribution, masking, f0, m, mu, (48, 48), refine=2)
    fewer = albedo_of(distribution, masking, f0, m, mu, (32, 32), refine=2)
    other = albedo_of(distribution, masking, f0, m, mu, (40, 40), refine=1)
    return best, max(2 * abs(best - fewer), 2 * abs(best - other), 1e-14)


def rows() -> list[tuple[str, str, float, float, float]]:
    found = [
        (distribution, masking, 1.0, m, mu)
        for distribution in ("beckmann", "ggx")
        for masking in MASKINGS
        for m in SIZES
        for mu in COSINES
    ]
    found += [
        (distribution, masking, 0.04, m, mu)
        for distribution in ("beckmann", "ggx")
        for masking in MASKINGS
        for m in (1 / 64, 0.1, 0.4, 1.0)
        for mu in (1 / 64, 0.2, 0.8, 1.0)
    ]
    # Off the grid: cells of 1/64 where other tables have values.
    pairs = ((0.484375, 0.484375), (0.484375, 0.109375), (0.984375, 0.984375), (0.109375, 0.046875))
    found += [("beckmann", masking, 1.0, m, mu) for masking in MASKINGS for m, mu in pairs]
    return found + [("ggx", masking, 1.0, 1.0, mu) for masking in MASKINGS for mu in (1 / 31, 16 / 31)]


# --- checks ---------------------------------------------------------------------------------------------------------


def brute_force(distribution: str, masking: str, f0: float, m: float, mu: float) -> float:
    """f (N.V) summed over outgoing directions; nothing shared with the slope integral but D, Lambda and F."""
    x, w = np.polynomial.legendre.leggauss(16)

    def panels(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        half = np.diff(edges)[:, None] / 2
        return (edges[:-1, None] + half * (1 + x)).ravel(), (half * w).ravel()

    theta = math.acos(mu)
    polar, polar_w = panels(np.unique(np.concatenate([np.linspace(0, math.pi / 2, 61), [theta]])))
    azimuth, azimuth_w = panels(math.pi * np.linspace(0, 1, 61) ** 2)  # from the mirror azimuth
    sine = math.sqrt(1 - mu * mu)
    total = 0.0
    for angle, weight in zip(np.array_split(polar, 40), np.array_split(polar_w, 40), strict=True):
        ct, st = np.cos(angle)[:, None], np.sin(angle)[:, None]
        hx, hy, hz = sine - st * np.cos(azimuth), st * np.sin(azimuth), mu + ct
        length = np.sqrt(hx**2 + hy**2 + hz**2)
        n_h, v_h = hz / length, (sine * hx + mu * hz) / length
        d = density(distribution, m, np.maximum(1 / n_h**2 - 1, 0)) / n_h**4
        if masking == "v-cavities":
            g = np.minimum(1, np.minimum(2 * n_h * ct / v_h, 2 * n_h * mu / v_h))
        else:
            one = smith_lambda(distribution, m, np.asarray(mu), np.asarray(1 - mu * mu))
            two = smith_lambda(distribution, m, ct, st**2)
            g = 1 / ((1 + one) * (1 + two)) if masking == "smith-separable" else 1 / (1 + one + two)
        f = fresnel_factor(f0, v_h) * d * g / (4 * mu * ct)
        total += 2 * float(np.sum(f * ct * st * weight[:, None] * azimuth_w))
    return total


# (distribution, masking, m, cos theta, value, the accuracy it was printed with); F = 1, correct normalisation.
_DEGREE = math.pi / 180
PRINTED = (
    *(("beckmann", "v-cavities", 0.1, mu, v, 1e-6) for mu, v in ((0.8, 0.999999), (0.5, 0.999071), (0.2, 0.950302))),
    ("beckmann", "v-cavities", 0.1, 0.05, 0.956725, 1e-6),
    *(("beckmann", "v-cavities", 0.4, mu, v, 1e-6) for mu, v in ((1.0, 0.963521), (0.8, 0.925339), (0.5, 0.901405))),
    *(("beckmann", "v-cavities", 0.4, mu, v, 1e-6) for mu, v in ((0.2, 0.945439), (0.05, 0.985634))),
    *(("beckmann", "v-cavities", 1.0, mu, v, 1e-6) for mu, v in ((1.0, 0.453447), (0.8, 0.572333), (0.5, 0.791715))),
    *(("beckmann", "v-cavities", 1.0, mu, v, 1e-6) for mu, v in ((0.2, 0.928711), (0.05, 0.982550))),
    ("beckmann", "v-cavities", 0.2, 1.0, 1.0, 2e-4),
    ("beckmann", "v-cavities", 0.2, math.cos(60 * _DEGREE), 3.862 / 4, 2e-4),
    ("beckmann", "v-cavities", 0.2, math.cos(75 * _DEGREE), 3.710 / 4, 2e-4),
    ("beckmann", "v-cavities", 0.2, math.cos(89 * _DEGREE), 3.966 / 4, 2e-4),
    ("beckmann", "none", 0.4, math.cos(89 * _DEGREE), 6.97, 6e-3),
    ("beckmann", "smith-separable", 0.484375, 0.484375, 0.87243027, 1e-8),
    ("beckmann", "smith-correlated", 0.484375, 0.484375, 0.87285963, 1e-8),
    ("beckmann", "smith-separable", 0.484375, 0.109375, 0.93385679, 1e-8),
    ("beckmann", "smith-correlated", 0.484375, 0.109375, 0.95079987, 1e-8),
    ("beckmann", "smith-separable", 0.984375, 0.984375, 0.48322853, 1e-8),
    ("beckmann", "smith-correlated", 0.984375, 0.984375, 0.48322853, 1e-8),
    ("beckmann", "smith-separable", 0.109375, 0.046875, 0.92887820, 1e-8),
    ("beckmann", "smith-correlated", 0.109375, 0.046875, 0.93546848, 1e-8),
    ("ggx", "smith-correlated", 1.0, 1.0, 1 - math.log(2), 1e-13),
    ("ggx", "smith-correlated", 1.0, 1 / 31, 0.888202, 2e-6),
    ("ggx", "smith-correlated", 1.0, 16 / 31, 0.443841, 2e-6),
)


CASES = ((1.0, 0.2, 0.5), (1.0, 0.484375, 0.2), (0.04, 0.7, 0.8), (1.0, 1.0, 1.0), (0.04, 0.4, 0.05))  # f0, m, mu


def check() -> None:
    for distribution, masking, m, mu, printed, accuracy in PRINTED:
        value, error = reference(distribution, masking, 1.0, m, mu)
        mark = "" if abs(value - printed) <= accuracy + error else "  DIFFERS"
        print(f"{distribution} {masking} m={m} mu={mu:.6g}: {value:.10f}, printed {printed:.8f}{mark}")
    for distribution in ("beckmann", "ggx"):
        for masking in MASKINGS:
            for f0, m, mu in CASES:
                value, error = reference(distribution, masking, f0, m, mu)
                plain = brute_force(distribution, masking, f0, m, mu)
                where = f"{distribution} {masking} f0={f0} m={m} mu={mu}"
                print(f"{where}: {value:.12f} +- {error:.0e}, over wo {plain - value:+.1e}")


# The stability matrix: `--matrix`, for studies/stability.csv. Angles in degrees; 90 is the limit cos theta = 0.
MATRIX_LOBES = {
    "cook-torrance": ("beckmann", "v-cavities"),
    "beckmann-smith": ("beckmann", "smith-separable"),
    "beckmann-smith-correlated": ("beckmann", "smith-correlated"),
    "ggx": ("ggx", "smith-correlated"),
}
MATRIX_SIZES = (1e-3, 0.05, 0.1, 0.2, 0.4, 1.0, 2.0)
MATRIX_ANGLES = (0.0, 1e-4, 45.0, 75.0, 85.0, 89.0, 89.99)
# At 90 degrees the half-vector rule gives derivatives at the cosine epsilon^(3/4): that is the limit in float64, and a little
# before it in float32. For GGX, where the one in the angle grows like log cos(theta) and has no limit, it is the second.
LAST_COSINE = 2.0**-17.25


def limit(masking: str, m: float) -> float:
    """The limit of the albedo at 90 degrees, F = 1, for Beckmann facets; it is the same 1 for GGX with correlated masking.

    As T = tan t grows, facets that face the light (x > 0) are hit with (1 + x T) G1 = 2 sqrt(pi) x/m, which integrates to 1
    whatever the distribution (this is what defines Smith's Lambda), and Lambda of the light outgrows that of the viewer: the
    correlated albedo is 1. V-cavities keep 2 of (1 + x T) for every x > 0: 1 again. The separable one is a smooth integral over
    the facets that face the light, with N.V = 2 x/(1 + r^2).
    """
    return 1.0 if masking != "smith-separable" else half_plane(m, lambda x, r2: x * visible(m, 2 * x / (1 + r2)))


def half_plane(m: float, function, order: int = 60) -> float:
    """2 sqrt(pi)/m times the integral of P22 function(x, r^2) over x > 0, for Beckmann facets."""
    r, wr = composite(m * np.linspace(0, 6.7, 13), order)
    phi, wphi = composite(np.linspace(0, math.pi / 2, 5), order)
    values = density("beckmann", m, r * r)[:, None] * function(r[:, None] * np.cos(phi), (r * r)[:, None])
    return 4 * math.sqrt(math.pi) / m * float(np.sum((wr * r)[:, None] * wphi * values))


def visible(m: float, mu: np.ndarray) -> np.ndarray:
    """Smith's G1 of Beckmann facets."""
    return 1 / (1 + smith_lambda("beckmann", m, mu, (1 - mu) * (1 + mu)))


def grazing_slope(masking: str, m: float) -> float:
    """The limit of dE/dtheta at 90 degrees for Beckmann facets: minus the first-order term in cos t of what `limit` keeps.

    Smith: with c = 2 sqrt(pi)/m, (1 + x T) G1 = c x + cos t (c - c^2 x/2) + ... and N.V = 2 x/(1+r^2) + cos t (2/(1+r^2) - 1).
    V-cavities: all happens within x ~ cos t, where with s = 1 + y^2 and u = 1 + x T the albedo lacks 2 - min(u, 4u/s - 2, 2)
    for u > 0 and has 2 too few of it for u < 1; the integral over u is elementary.
    """
    if masking == "v-cavities":
        y, w = composite(m * np.linspace(0, 6.7, 25), 40)
        s = 1 + y * y
        first = 2 * s / np.maximum(4 - s, 1)
        flat = s + 4 * (first - s / 2) - 2 / s * (first**2 - s * s / 4) + (2 - first) ** 2 / 2
        lacks = np.where(s > 2, 1.5 * s, flat)
        return float(2 * np.sum(w * density("beckmann", m, y * y) * (lacks - 2)))
    c = 2 * math.sqrt(math.pi) / m
    if masking == "smith-correlated":

        def lost(x: np.ndarray, r2: np.ndarray) -> np.ndarray:
            mu = 2 * x / (1 + r2)
            return c * x * smith_lambda("beckmann", m, mu, (1 - mu) * (1 + mu))

        return half_plane(m, lost)

    def change(x: np.ndarray, r2: np.ndarray) -> np.ndarray:
        mu, step = 2 * x / (1 + r2), 1e-3
        # The derivative of G1 in N.V, by differences relative to N.V and to its distance from 1.
        h = step * mu * (1 - mu)
        slopes = [(visible(m, mu + k * h) - visible(m, mu - k * h)) / (2 * k * np.maximum(h, 1e-300)) for k in (1, 2)]
        return (1 - c * x / 2) * visible(m, mu) + x * (4 * slopes[0] - slopes[1]) / 3 * (2 / (1 + r2) - 1)

    return -half_plane(m, change)


def complement(distribution: str, m: float, mu: float, order: int = 12) -> float:
    """1 - E for correlated Smith masking and F = 1, to a relative 1e-10 however small cos t is.

    G1 is defined so that 1 = G1 int P22 (1 + x T) over 1 + x T > 0. So what is missing is the integral of P22 (1 + x T) times
    G1 Lambda_o/(1 + Lambda_i + Lambda_o) inside the disk and G1 beyond it, all positive. In polar coordinates (r, phi) with
    c = cos(phi) the rim of the disk is c0 = (r^2 - 1)/(2 r T) and N.V = 2 r sin t (c - c0)/(1 + r^2).
    """
    sine = math.sqrt((1 - mu) * (1 + mu))
    slope = sine / mu
    top = 6.7 * m if distribution == "beckmann" else 1e10 * slope
    edges = np.geomspace(1e-7 * m, top, math.ceil(1.5 * math.log2(top / (1e-7 * m))))
    edges = np.unique(np.concatenate([[0.0], edges, [e for e in (mu / (1 + sine), 1.0, (1 + sine) / mu) if e < top]]))
    r, wr = composite(edges, order)
    r, wr = r[:, None], wr[:, None]
    rim = np.clip((r * r - 1) / (2 * r * slope), -1, 1)
    # c = 1 - (1 - c0) s^2, with panels in 1 - s that shrink towards the rim: N.V goes through cos t there.
    w, ww = composite(np.concatenate([[0.0], 0.25 ** np.arange(26, -1, -1)]), order)
    above = (1 - rim) * w * (2 - w)  # c - c0
    c = rim + above
    mu_o = np.where(rim > -1, 2 * r * sine * above / (1 + r * r), mu * (2 * (1 + r * slope * c) / (1 + r * r) - 1))
    mu_o = np.clip(mu_o, 1e-60, 1)
    lambda_i = smith_lambda(distribution, m, np.asarray(mu), np.asarray(sine**2))
    lambda_o = smith_lambda(distribution, m, mu_o, (1 - mu_o) * (1 + mu_o))
    # The square root of 1 - c cancels against s; that of 1 + c is 0 only where the rim is the whole circle.
    turn = 2 * np.sqrt(1 - rim) / np.sqrt(1 + rim + above)
    inside = np.sum(ww * turn * (1 + r * slope * c) * lambda_o / (1 + lambda_i + lambda_o), axis=-1)
    last, edge = np.clip(-1 / (r * slope), -1, 1), np.minimum(rim, 1)
    beyond = np.arccos(last) - np.arccos(edge) + r * slope * (np.sqrt(1 - last**2) - np.sqrt(1 - edge**2))
    total = np.sum((wr * r * density(distribution, m, r * r))[:, 0] * (inside + beyond[:, 0]))
    return float(2 * total / (1 + lambda_i))


def central(function, step: float) -> float:
    """The derivative at 0 of a function of a shift, good to step^4."""
    narrow, wide = ((function(k * step) - function(-k * step)) / (2 * k * step) for k in (1, 2))
    return (4 * narrow - wide) / 3


def derivatives(name: str, m: float, mu: float) -> tuple[float, float, float]:
    """(m dE/dm, dE/dtheta, the same as float32 defines it): differences of the albedos above, good to 1e-6 of E or more."""
    distribution, masking = MATRIX_LOBES[name]

    def plain(m: float, mu: float) -> float:
        return albedo_of(distribution, masking, 1.0, m, mu, (32, 32), refine=2)

    def at_cosine(mu: float) -> float:
        sine = math.sqrt((1 - mu) * (1 + mu))
        if masking == "smith-correlated" and mu < 1e-5:
            return sine / mu * central(lambda shift: complement(distribution, m, mu * math.exp(shift)), 0.01)
        return -sine / mu * central(lambda shift: plain(m, mu * math.exp(shift)), 0.01)

    if mu > 0:
        by_logarithm = central(lambda shift: plain(m * math.exp(shift), mu), 0.01)
        angle = math.acos(mu)
        if mu == 1:
            return by_logarithm, 0.0, 0.0  # E is even in theta
        if angle > 1.5:
            by_angle = at_cosine(mu)
        else:
            step = min(0.003, angle / 4, m)
            by_angle = central(lambda shift: plain(m, math.cos(angle + shift)), step)
        return by_logarithm, by_angle, by_angle
    last = at_cosine(LAST_COSINE)
    if distribution == "ggx":
        return -central(lambda shift: complement(distribution, m * math.exp(shift), LAST_COSINE), 0.01), last, last
    return central(lambda shift: limit(masking, m * math.exp(shift)), 0.01), grazing_slope(masking, m), last


def print_matrix(names: list[str]) -> None:
    """Rows for make_zonal's matrix, with the slope m as n. About half an hour."""
    for name in names or MATRIX_LOBES:
        distribution, masking = MATRIX_LOBES[name]
        for m in MATRIX_SIZES:
            for mu in (*(math.cos(math.radians(angle)) for angle in MATRIX_ANGLES), 0.0):
                value, error = reference(distribution, masking, 1.0, m, mu) if mu > 0 else (limit(masking, m), 1e-14)
                slopes = ",".join(repr(float(part)) for part in derivatives(name, m, mu))
                print(f"{name},{m!r},{mu!r},{value!r},{error:.1e},{slopes}", flush=True)


def main(arguments: list[str]) -> None:
    if "--matrix" in arguments:
        print_matrix([one for one in arguments if not one.startswith("--")])
        return
    if "--check" in arguments:
        check()
        return
    print("distribution,masking,fresnel,f0,m,cos_theta,albedo,error")
    for distribution, masking, f0, m, mu in dict.fromkeys(rows()):
        value, error = reference(distribution, masking, f0, m, mu)
        fresnel = "none" if f0 == 1 else "dielectric"
        print(f"{distribution},{masking},{fresnel},{f0!r},{m!r},{mu!r},{value:.16f},{error:.1e}", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
