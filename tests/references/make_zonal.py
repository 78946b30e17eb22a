r"""Reference albedos of the zonal lobes, by ball arithmetic: ``python tests/references/make_zonal.py > zonal.csv``.

Columns: lobe, n, cos_theta, albedo, radius. The albedo is for factor 1 (peak value of the lobe 1); n and cos_theta are
doubles printed so that they read back exactly; the true value lies within `radius` of the number printed.

Method. For a lobe g that depends on one angle only, the azimuth integral is elementary and the albedo is one integral:
mirror form, psi the angle from the mirror direction, kink at psi = pi/2 - theta,

    E = int_0^{pi/2} g(psi) W(psi) sin(psi) dpsi,   W = 2 [p a + b sin p],
    a = cos psi cos theta, b = sin psi sin theta, cos p = -a/b   (p = pi before the kink);

half form, gamma the angle of the half vector, kinks at pi/4 -+ theta/2 (the second is the end),

    E = int g(gamma) U(gamma) sin(gamma) dgamma,
    U = 8 {2 cos gamma [a^2 p + 2 a b sin p + b^2 (p/2 + sin(2p)/4)] - cos theta [a p + b sin p]},
    a = cos gamma cos theta, b = sin gamma sin theta, cos p = (cos theta / (2 cos gamma) - a) / b.

Each piece between kinks and breakpoints of the lobe is integrated by Arb's `acb.integral` (adaptive Gauss-Legendre with
rigorous error bounds from complex balls; Johansson 2018), so nothing is taken on trust but the two formulas. They are
checked apart: `--check` compares with the closed forms (Phong at any angle, Mallett & Yuksel 2020; Blinn-Phong, Schlick
and the binomial power at normal incidence; Blinn-Phong at grazing), and with a plain two-dimensional sum of the BRDF over
directions that knows neither formula. About 80 seconds.

The lobes: phong and schlick, kb (Kuijk-Blake) and ``*_mirror`` are functions of R.V; blinn, schlick_half, kb_half,
lyonW and binomialK functions of N.H. lyonW has exponent 2^W; binomialK is max(0, 1 + (n/K)(c - 1))^K, ``_unclamped``
without the max.

Options: ``--check`` verifies; ``--matrix [lobe ...]`` makes the rows of the stability study instead (all lobes of it, half an
hour).

The matrix has more columns, by_logarithm = n dE/dn and by_angle = dE/dtheta (twice, the second time as float32 defines it for
microfacets), good to 1e-12 of the larger of themselves and E. They are integrals of the same kind: n dg/dn in place of g (g is
continuous, so that its breakpoints add nothing), or dW/dtheta and dU/dtheta in place of W and U. In these p may be held: what
is integrated over the azimuth is 0 at its ends, where N.V = 0.
With a' = -cos x sin theta and b' = b cos theta / sin theta, dW/dtheta = 2 [p a' + b' sin p] and

    dU/dtheta = 8 {4 cos gamma [a a' p + (a b' + a' b) sin p + b b' (p/2 + sin(2p)/4)]
                   - cos theta [a' p + b' sin p] + sin theta [a p + b sin p]}.

At 90 degrees it is the derivative from below, with p = pi/2.
"""

from __future__ import annotations

import itertools
import math
import sys
import time

from flint import acb, arb, ctx

BITS = 64  # accuracy asked of every value: 2^-64 = 5.4e-20 relative
SLOPE_BITS = 40  # of derivatives, as a part of the albedo or more
NAN = acb(float("nan"))


class Lobe:
    """A profile on complex balls, and the angles where its formula changes."""

    def __init__(self, name: str, n: float):
        self.name, self.n = name, arb(n)
        self.integer = int(n) if n == int(n) and n <= 1e7 else None
        self.mirror = name in ("phong", "schlick", "kb") or "mirror" in name
        self.family = name.split("_")[0]
        self.clamped = "unclamped" not in name
        if self.family.startswith("lyon"):
            self.k = 2 ** int(self.family[4:])
        elif self.family.startswith("binomial"):
            self.k = int(self.family[8:])

    def breaks(self, end: arb) -> list[arb]:
        """Ends of the pieces of g, in order, the last one its support; none lies beyond `end`."""
        if self.family == "kb":
            reciprocal_p, q = self.kuijk_blake()
            p = 1 / reciprocal_p if reciprocal_p > 0 else end
            if not p < end:
                return [end]
            return [p, q] if q < end else [p, end]
        if hasattr(self, "k") and self.clamped and self.n > 0:
            c = 1 - self.k / self.n
            if c > -1:
                support = 2 * (self.k / self.n / 2).sqrt().asin()
                return [support] if support < end else [end]
        return [end]

    def kuijk_blake(self) -> tuple[arb, arb]:
        n = self.n
        # 0.09, 5.2, ... are decimal numbers: as rationals, not as doubles.
        reciprocal_p = n * (n * 9 / 100 + arb(26) / 5) / (n + arb(28) / 5)
        return reciprocal_p, (n + 65) / (5 * n + arb(317) / 10)

    def __call__(self, angle: acb, piece: int, analytic: bool) -> acb:
        if self.family in ("phong", "blinn"):
            c = angle.cos()
            if self.n == 0:
                return acb(1)
            if self.integer is not None and self.integer <= 16:
                return c**self.integer
            if c.real > 0:
                return (self.n * c.log()).exp()
            if analytic:
                return NAN
            bound = (self.n * c.abs_upper().log()).exp()
            return acb(arb(0, bound.upper()))
        if self.family == "schlick":
            c = angle.cos()
            half = (angle / 2).sin()
            return c / (2 * self.n * half * half + c) if self.n > 0 else acb(1)
        if self.family == "kb":
            reciprocal_p, q = self.kuijk_blake()
            if piece == 0:
                return 1 - angle * angle * reciprocal_p / q
            return (angle - q) ** 2 * reciprocal_p / (q * (q * reciprocal_p - 1))
        half = (angle / 2).sin()
        return (1 - 2 * self.n / self.k * half * half) ** self.k

    def by_logarithm(self, angle: acb, piece: int, analytic: bool) -> acb:
        """n times the derivative in n."""
        if self.family in ("phong", "blinn"):
            c = angle.cos()
            if c.real > 0:
                return self.n * c.log() * (self.n * c.log()).exp()
            if analytic:
                return NAN
            # |c^n n log c| <= 1/e + n pi for |c| <= 1, and c is small where it may be 0.
            return acb(arb(0, (arb(-1).exp() + self.n * arb.pi()).upper()))
        half = (angle / 2).sin()
        versine = 2 * half * half
        if self.family == "schlick":
            c = angle.cos()
            return -c * self.n * versine / (self.n * versine + c) ** 2
        if self.family == "kb":
            n = self.n
            reciprocal_p, q = self.kuijk_blake()
            top, bottom = n * 9 / 100 + arb(26) / 5, n + arb(28) / 5
            p_slope = reciprocal_p * (1 + n * 9 / 100 / top - n / bottom)
            q_slope = n / (5 * n + arb(317) / 10) - q * 5 * n / (5 * n + arb(317) / 10)
            if piece == 0:
                return -angle * angle * (p_slope - reciprocal_p * q_slope / q) / q
            away, below = angle - q, q * (q * reciprocal_p - 1)
            below_slope = 2 * q * q_slope * reciprocal_p + q * q * p_slope - q_slope
            rise = away * away * p_slope - 2 * away * q_slope * reciprocal_p
            return (rise - away * away * reciprocal_p * below_slope / below) / below
        return -self.n * versine * (1 - self.n / self.k * versine) ** (self.k - 1)


def turned(along: acb, across: acb, radius: acb) -> acb:
    """The azimuth p with radius e^(ip) = along + i across, continued analytically past p = 0 and p = pi."""
    w = (along + across * acb(0, 1)) / radius
    minus_i = acb(0, -1)
    if w.real > 0:
        return minus_i * w.log()
    if w.real < 0:
        return acb.pi() + minus_i * (-w).log()
    if w.imag > 0:
        return acb.pi() / 2 + minus_i * (minus_i * w).log()
    return NAN


def full_kernel(mirror: bool, mu: arb, sine: arb, angle: acb, slope: bool) -> acb:
    """Azimuth integral times sin(angle) where the whole circle is above the horizon; `slope`: its derivative in theta."""
    c, s = angle.cos(), angle.sin()
    if mirror:
        return 2 * acb.pi() * c * s * (-sine if slope else mu)
    if slope:
        return 16 * acb.pi() * s * mu * sine * c * (1 + s * s - 2 * c * c)
    a, b = c * mu, s * sine
    return 8 * acb.pi() * s * (2 * c * (a * a + b * b / 2) - mu * a)


def cut_kernel(mirror: bool, mu: arb, sine: arb, theta: arb, u: acb, analytic: bool, slope: bool) -> tuple[acb, acb]:
    """(angle, kernel dangle/du) past the kink; u in [0, 1] runs so that square roots at the kinks become polynomial.

    `slope`: with the kernel's derivative in theta at a fixed angle.
    """
    if mirror:
        # psi = kink + d, d = theta u^2; b^2 sin^2 p = sin d sin(2 theta - d).
        d = theta * u * u
        angle = acb.pi() / 2 - theta + d
        across = u * (theta * d.sinc() * (2 * theta - d).sin()).sqrt(analytic=analytic)
        c, s = angle.cos(), angle.sin()
        a, b = c * mu, s * sine
        p = turned(-a, across, b)
        kernel = across * mu / sine - p * c * sine if slope else p * a + across
        return angle, 2 * kernel * s * 2 * theta * u
    # gamma = pi/4 - theta/2 + d, e = theta - d; b^2 sin^2 p = sin 2d sin 2e / (4 cos^2 gamma).
    v = 1 - u
    d, e = theta * u * u * (1 + 2 * v), theta * v * v * (1 + 2 * u)
    # Counted from the nearer end: the ball of d is then narrow where it has to be.
    angle = acb.pi() / 4 + theta / 2 - e if u.real > 0.5 else acb.pi() / 4 - theta / 2 + d
    c, s = angle.cos(), angle.sin()
    smooth = (1 + 2 * v) * (1 + 2 * u) * (2 * d).sinc() * (2 * e).sinc()
    across = theta * u * v * smooth.sqrt(analytic=analytic) / c
    a, b = c * mu, s * sine
    along = mu / (2 * c) - a
    p = turned(along, across, b)
    second = b * b * p / 2 + along * across / 2
    if slope:
        turn, a_slope = mu / sine, -c * sine
        first = a * a_slope * p + (a * turn + a_slope) * across + turn * second
        kernel = 4 * c * first - mu * (a_slope * p + turn * across) + sine * (a * p + across)
    else:
        kernel = 2 * c * (a * a * p + 2 * a * across + second) - mu * (a * p + across)
    return angle, 8 * kernel * s * 6 * theta * u * v


def grazing_kernel(mirror: bool, angle: acb, slope: bool) -> acb:
    """mu = 0: p = pi/2 everywhere."""
    s = angle.sin()
    if slope:
        c = angle.cos()
        return -acb.pi() * c * s if mirror else 8 * s * s * (1 - 4 * c * c)
    return 2 * s * s if mirror else 4 * acb.pi() * angle.cos() * s * s * s


def parameter(mirror: bool, t: arb) -> arb:
    """u at the fraction t of the way from the kink to the end."""
    if mirror:
        return t.sqrt()
    return arb(1) / 2 - ((1 - 2 * t).asin() / 3).sin()


def pieces(lobe: Lobe, mu_value: float, by: str = "") -> list[tuple]:
    """Every (function, low, high) whose integrals add up to the albedo, or to its derivative `by` "logarithm" or "angle"."""
    slope = by == "angle"
    mu = arb(mu_value)
    theta = mu.acos() if mu_value < 1 else arb(0)
    sine = ((1 - mu) * (1 + mu)).sqrt()
    half_pi = arb.pi() / 2
    kink = half_pi - theta if lobe.mirror else arb.pi() / 4 - theta / 2
    end = half_pi if lobe.mirror else arb.pi() / 4 + theta / 2
    if mu_value == 1:
        kink = end
    found = []
    low = arb(0)
    # Scales of the lobe: the start of the bisection only, no influence on the value.
    hints = [arb(f) / (1 + lobe.n).sqrt() for f in (0.5, 1.5, 4.0, 9.0)]
    for piece, high in enumerate(lobe.breaks(end)):

        def profile(angle: acb, analytic: bool, piece: int = piece) -> acb:
            return lobe.by_logarithm(angle, piece, analytic) if by == "logarithm" else lobe(angle, piece, analytic)

        cuts = sorted([h.mid() for h in hints if low < h < high], key=float)
        ends = [low.mid(), *cuts, high.mid()]
        for one, two in itertools.pairwise(ends):
            if mu_value == 0:

                def over_grazing(x: acb, analytic: bool, profile=profile) -> acb:
                    return profile(x, analytic) * grazing_kernel(lobe.mirror, x, slope)

                found.append((over_grazing, one, two))
                continue
            if one < kink:

                def over_full(x: acb, analytic: bool, profile=profile) -> acb:
                    return profile(x, analytic) * full_kernel(lobe.mirror, mu, sine, x, slope)

                found.append((over_full, one, two if two < kink else kink.mid()))
            if two > kink:

                def over_cut(u: acb, analytic: bool, profile=profile) -> acb:
                    angle, kernel = cut_kernel(lobe.mirror, mu, sine, theta, u, analytic, slope)
                    return profile(angle, analytic) * kernel

                first = parameter(lobe.mirror, (one - kink) / theta).mid() if one > kink else arb(0)
                last = parameter(lobe.mirror, (two - kink) / theta).mid() if two < end else arb(1)
                found.append((over_cut, first, last))
        low = high
    return found


def integrate(parts: list[tuple], relative: int, absolute: arb) -> arb:
    total = arb(0)
    for function, low, high in parts:
        value = acb.integral(
            function, low, high, rel_tol=arb(2) ** -relative, abs_tol=absolute, eval_limit=400000, depth_limit=4000
        )
        total += value.real
    return total


def albedo(name: str, n: float, mu: float) -> arb:
    """The enclosure of the albedo, at least BITS relative bits."""
    for precision in (160, 256, 512):
        ctx.prec = precision
        parts = pieces(Lobe(name, n), mu)
        rough = integrate(parts, 12, arb(2) ** -(precision - 30))
        size = abs(rough).mid()
        value = integrate(parts, BITS + 16, size * arb(2) ** -(BITS + 14))
        if value.is_finite() and value.rad() < abs(value).mid() * arb(2) ** -BITS:
            return value
    raise ArithmeticError(f"{name} n={n} mu={mu}: {value}")


def derivative(name: str, n: float, mu: float, by: str, scale: arb) -> float:
    """n dE/dn (`by` "logarithm") or dE/dtheta ("angle"), to `SLOPE_BITS` of the larger of itself and `scale`, which is E."""
    if by == "angle" and mu == 1:
        return 0.0  # E is even in theta
    for precision in (128, 256, 512):
        ctx.prec = precision
        value = integrate(pieces(Lobe(name, n), mu, by), SLOPE_BITS + 16, scale * arb(2) ** -(SLOPE_BITS + 14))
        if value.is_finite() and value.rad() < max(scale, abs(value).mid()) * arb(2) ** -SLOPE_BITS:
            return float(value.mid())
    raise ArithmeticError(f"{name} n={n} mu={mu} by {by}: {value}")


# --- rows -----------------------------------------------------------------------------------------------------------

COMPACT = {"lyon1": 2, "lyon2": 4, "lyon3": 8, "lyon4": 16, "binomial8": 8, "binomial16": 16}
LOBES = (
    "phong",
    "blinn",
    "schlick",
    "schlick_half",
    "kb",
    "kb_half",
    "lyon1",
    "lyon1_mirror",
    "lyon2",
    "lyon2_mirror",
    "lyon3",
    "lyon3_mirror",
    "lyon4_mirror",
    "binomial8",
    "binomial16",
    "binomial16_mirror",
    "binomial16_unclamped",
    "binomial16_mirror_unclamped",
)
# (n, mu): exponents over the whole range against angles over the whole range, no two alike.
GENERAL = (
    (1.0, 0.5),
    (1.5, 0.02),
    (2.0, 1.0),
    (3.5, 0.999999),
    (5.0, 1e-6),
    (10.0, 0.7),
    (17.3, 0.25),
    (30.0, 0.95),
    (64.0, 0.1),
    (110.0, 0.6),
    (250.0, 0.01),
    (700.0, 0.85),
    (1e3, 1e-3),
)
LARGE = ((3e3, 0.3), (1e4, 1e-4), (3e4, 0.999999), (1e5, 0.45), (1e6, 1e-6), (1e7, 0.8), (1e7, 1.0), (1e7, 1e-5))


# The stability matrix: `--matrix`, for studies/stability.csv. Angles in degrees; 90 is the limit cos theta = 0.
MATRIX_LOBES = (
    *LOBES[:12],
    "lyon4_mirror",
    "lyon5",
    "lyon5_mirror",
    "lyon6",
    "lyon6_mirror",
    "binomial4",
    "binomial8",
    "binomial8_mirror",
    "binomial8_unclamped",
    "binomial8_mirror_unclamped",
    "binomial16",
    "binomial16_mirror",
    "binomial16_unclamped",
    "binomial16_mirror_unclamped",
    "binomial32",
    "binomial64",
)
MATRIX_N = (0.01, 1.0, 8.0, 16.0, 17.85, 32.0, 37.0, 54.63, 110.4, 1e3, 1e5, 1e7)
MATRIX_ANGLES = (0.0, 1e-4, 45.0, 75.0, 85.0, 89.0, 89.99, 90.0)


def matrix_rows() -> list[tuple[float, float]]:
    """(n, cos theta) of the stability matrix."""
    cosines = [0.0 if angle == 90 else math.cos(math.radians(angle)) for angle in MATRIX_ANGLES]
    return [(n, mu) for n in MATRIX_N for mu in cosines]


def support_of(name: str, n: float) -> list[float]:
    if name.startswith("kb"):
        return [(n + 5.6) / (n * (0.09 * n + 5.2)), (n + 65) / (5 * n + 31.7)]
    return [math.acos(1 - COMPACT[name.split("_")[0]] / n)]


def rows_of(name: str) -> list[tuple[float, float]]:
    mirror = Lobe(name, 1.0).mirror
    rows = list(GENERAL)
    if not name.startswith("kb"):
        rows += list(LARGE) if "unclamped" not in name else [(1e4, 0.3), (3e3, 1e-4)]
    if name in ("phong", "blinn"):
        rows += [(n, mu) for n in (0.01, 0.1, 0.5) for mu in (1.0, 0.6, 1e-3)]
    rows += [(0.0, 1.0), (0.0, 0.3), (10.0, 0.0)]
    # Layers as wide as the lobe.
    for n, factor in ((100.0, 1.0), (1e3, 0.3), (1e4, 3.0), (1e5, 0.1), (1e6, 1.0), (1e7, 1.0)):
        if n <= 1e3 or not (name.startswith("kb") or "unclamped" in name):
            rows.append((n, factor / math.sqrt(n)))
    # The edge of the lobe at the kink, and near it.
    if (name.split("_")[0] in COMPACT and "unclamped" not in name) or name.startswith("kb"):
        k = COMPACT.get(name.split("_")[0], 4)
        for n, shift in ((k * 1.3, 0.0), (k * 2.0, 1e-9), (k * 5.0, 0.0), (k * 40.0, -1e-6), (k * 900.0, 1e-12)):
            if name.startswith("kb") and n > 1e3:
                continue
            for angle in support_of(name, n):
                mu = math.sin(angle if mirror else 2 * angle)
                if 0 < mu + shift < 1:
                    rows.append((n, mu + shift))
    else:
        # Half the lobe's height at the kink.
        for n in (20.0, 2000.0):
            angle = math.acos(0.5 ** (1 / n))
            rows.append((n, math.sin(angle if mirror else 2 * angle)))
    return rows


def printed(value: arb) -> tuple[str, str]:
    """25 digits and a radius that covers both the ball and the rounding of these digits."""
    text = value.mid().str(25, radius=False)
    radius = abs(value - arb(text)).upper()
    return text, f"{float(radius) * 1.06:.1e}"


# --- checks ---------------------------------------------------------------------------------------------------------


def phong_closed(n: float, mu: float) -> arb:
    """Mallett & Yuksel 2020."""
    n, mu = arb(n), arb(mu)
    q = 1 - mu * mu
    if mu * mu < 0.5:
        whole = (n / 2).gamma() * arb.pi().sqrt() / ((n + 1) / 2).gamma()
        beta = whole - (mu * mu).beta_lower(arb(1) / 2, n / 2)
    else:
        beta = q.beta_lower(n / 2, arb(1) / 2)
    gammas = arb.pi().sqrt() * ((n + 1) / 2).gamma() / (n / 2 + 1).gamma()
    return (2 * arb.pi() * mu + gammas * (q ** (n / 2) - mu * n / 2 * beta)) / (n + 2)


def closed_form(name: str, n_value: float, mu: float) -> arb | None:
    n, pi = arb(n_value), arb.pi()
    if name == "phong" and 0 < n_value <= 1e5 and mu < 1:
        return phong_closed(n_value, mu) if mu > 0 else ((n + 1) / 2).gamma() * pi.sqrt() / 2 / (n / 2 + 2).gamma()
    if name == "phong" and mu == 1:
        return 2 * pi / (n + 2)
    if name == "blinn" and mu == 1:
        return 8 * pi * (arb(2) ** (-n / 2) + n) / ((n + 2) * (n + 4))
    if name == "blinn" and mu == 0:
        return 8 * pi / ((n + 2) * (n + 4))
    if name == "schlick" and mu == 1 and n_value > 1:
        a = n / (n - 1)
        return 2 * pi / (n - 1) * (a * a * n.log() - a - arb(1) / 2)
    if name == "binomial16" and mu == 1 and n_value >= 54.63:
        a = 16 / n
        return 128 * pi / n * (arb(1) / 17 - 5 * a / 306 + 6 * a**2 / 2907 - 2 * a**3 / 19380)
    return None


def brute_force(name: str, n: float, mu: float, order: int) -> float:
    """The BRDF summed over outgoing directions with a product rule graded to the normal and the mirror azimuth."""
    import numpy as np

    lobe = Lobe(name, n)
    sine = math.sqrt(1 - mu * mu)
    x, w = np.polynomial.legendre.leggauss(order)

    def panels(edges):
        half = np.diff(edges)[:, None] / 2
        return (np.asarray(edges)[:-1, None] + half * (1 + x)).ravel(), (half * w).ravel()

    polar, polar_w = panels(np.linspace(0, np.pi / 2, 41))
    phi, phi_w = panels(np.linspace(0, np.pi, 41))
    ct, st = np.cos(polar)[:, None], np.sin(polar)[:, None]
    # wi = (sine, 0, mu); the mirror direction is (-sine, 0, mu).
    vx, vz = st * np.cos(phi), ct + 0 * phi
    c = -sine * vx + mu * vz
    if not lobe.mirror:
        c = (mu + vz) / np.sqrt(2 * np.maximum(1 + sine * vx + mu * vz, 1e-300))
    c = np.clip(c, 0, 1)
    if lobe.family in ("phong", "blinn"):
        g = c**n
    elif lobe.family == "schlick":
        g = c / (n - n * c + c)
    elif lobe.family == "kb":
        a, p, q = np.arccos(c), (n + 5.6) / (n * (0.09 * n + 5.2)), (n + 65) / (5 * n + 31.7)
        g = np.where(a < p, 1 - a * a / (p * q), np.where(a < q, (a - q) ** 2 / (q * (q - p)), 0))
    else:
        base = 1 + n / lobe.k * (c - 1)
        g = (np.maximum(base, 0) if lobe.clamped else base) ** lobe.k
    if lobe.mirror:
        g = np.where(c > 0, g, 0)
    return float(2 * np.sum(g * ct * st * polar_w[:, None] * phi_w))


def check() -> None:
    worst = 0.0
    cases = [(name, n, mu) for name in LOBES for n, mu in rows_of(name)]
    cases += [("schlick", 10.0, 1.0), ("schlick", 1e4, 1.0), ("binomial16", 60.0, 1.0), ("blinn", 10.0, 1.0)]
    for name, n, mu in cases:
        if closed_form(name, n, mu) is None:
            continue
        value = albedo(name, n, mu)
        ctx.prec = 500
        exact = closed_form(name, n, mu)
        assert value.overlaps(exact), (name, n, mu, value, exact)
        worst = max(worst, float(abs(value - exact) / exact))
    print(f"{len(cases)} cases; closed forms: all inside; worst relative distance {worst:.1e}")
    for name in LOBES:
        for n, mu in ((2.5, 0.3), (20.0, 0.8)):
            value, plain = float(albedo(name, n, mu).mid()), brute_force(name, n, mu, 24)
            print(f"two-dimensional sum: {name} n={n} mu={mu}: relative difference {plain / value - 1:.1e}")


def main(arguments: list[str]) -> None:
    if "--check" in arguments:
        check()
        return
    if "--matrix" in arguments:
        print("lobe,n,cos_theta,albedo,radius,by_logarithm,by_angle,by_angle_float32")
        for name in [one for one in arguments if not one.startswith("--")] or MATRIX_LOBES:
            for n, mu in matrix_rows():
                value = albedo(name, n, mu)
                text, radius = printed(value)
                by_logarithm, by_angle = (derivative(name, n, mu, by, abs(value).mid()) for by in ("logarithm", "angle"))
                print(f"{name},{n!r},{mu!r},{text},{radius},{by_logarithm!r},{by_angle!r},{by_angle!r}", flush=True)
        return
    print("lobe,n,cos_theta,albedo,radius")
    for name in LOBES:
        start = time.perf_counter()
        for n, mu in dict.fromkeys(rows_of(name)):
            text, radius = printed(albedo(name, n, mu))
            print(f"{name},{n!r},{mu!r},{text},{radius}", flush=True)
        print(f"{name}: {time.perf_counter() - start:.1f} s", file=sys.stderr)


if __name__ == "__main__":
    main(sys.argv[1:])
