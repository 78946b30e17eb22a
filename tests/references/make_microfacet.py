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
            for f0, m, mu in (
                (1.0, 0.2, 0.5),
                (1.0, 0.484375, 0.2),
                (0.04, 0.7, 0.8),
                (1.0, 1.0, 1.0),
                (0.04, 0.4, 0.05),
            ):
                value, error = reference(distribution, masking, f0, m, mu)
                plain = brute_force(distribution, masking, f0, m, mu)
                where = f"{distribution} {masking} f0={f0} m={m} mu={mu}"
                print(f"{where}: {value:.12f} +- {error:.0e}, over wo {plain - value:+.1e}")


# The stability matrix: `--matrix`, for studies/stability.csv. Angles in degrees; 90 is the limit cos theta = 0, taken from
# two cosines so small that the rest is covered by the error.
MATRIX_LOBES = {
    "cook-torrance": ("beckmann", "v-cavities"),
    "beckmann-smith": ("beckmann", "smith-separable"),
    "beckmann-smith-correlated": ("beckmann", "smith-correlated"),
    "ggx": ("ggx", "smith-correlated"),
}
MATRIX_SIZES = (1e-3, 0.05, 0.1, 0.2, 0.4, 1.0, 2.0)
MATRIX_ANGLES = (0.0, 1e-4, 45.0, 75.0, 85.0, 89.0, 89.99)


def print_matrix() -> None:
    """Rows for make_zonal's table: lobe,n,cos_theta,albedo,radius with the slope m as n. About ten minutes."""
    for name, (distribution, masking) in MATRIX_LOBES.items():
        for m in MATRIX_SIZES:
            for mu in (math.cos(math.radians(angle)) for angle in MATRIX_ANGLES):
                value, error = reference(distribution, masking, 1.0, m, mu)
                print(f"{name},{m!r},{mu!r},{value!r},{error:.1e}", flush=True)
            value, error = reference(distribution, masking, 1.0, m, 1e-10)
            nearby, _ = reference(distribution, masking, 1.0, m, 1e-9)
            print(f"{name},{m!r},0.0,{value!r},{max(error, 4 * abs(value - nearby)):.1e}", flush=True)


def main(arguments: list[str]) -> None:
    if "--matrix" in arguments:
        print_matrix()
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
