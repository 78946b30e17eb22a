"""BRDFs as people write them, each of which a check of energy conservation can easily get wrong.

Each one says what is right and why. Directions have shape (..., 3), the normal is +z, values are in 1/sr. Those with "numpy" in
their name, and what `in_numpy` makes of the others, turn their arguments into numpy arrays first, which JAX cannot trace.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import jax.numpy as jnp
import numpy as np

Brdf = Callable[[Any, Any], Any]


def in_numpy(f: Brdf) -> Brdf:
    """The same function of numpy arrays, with values in one."""
    return lambda wi, wo: np.asarray(f(np.asarray(wi), np.asarray(wo)))


def halfway(wi, wo):
    """The half vector."""
    h = wi + wo
    return h / jnp.linalg.norm(h, axis=-1, keepdims=True)


def ggx_lobe(wi, wo, alpha):
    """GGX with Smith's height-correlated masking and no Fresnel term: its albedo stays below 1, and tends to 1 at grazing."""
    a2, c, i, o = alpha**2, halfway(wi, wo)[..., 2], wi[..., 2], wo[..., 2]
    distribution = a2 / (jnp.pi * (1 - c**2 + a2 * c**2) ** 2)
    return distribution * 0.5 / (i * jnp.sqrt(a2 + (1 - a2) * o**2) + o * jnp.sqrt(a2 + (1 - a2) * i**2))


def schlick(f0, cosine):
    """Schlick's approximation of Fresnel's equations."""
    return f0 + (1 - f0) * (1 - cosine) ** 5


# --- what is reciprocal, isotropic and positive, but not in floating point ---


def ashikhmin_shirley(nu, nv, rs):
    """Conserves and is reciprocal; the h.k of nearly opposite grazing directions cancels. Largest at normal incidence, nv=1000:

    sqrt((nu+1)(nv+1))/(2 pi) int int (2 c^2 - 1) c^e dc dphi over c in [1/sqrt 2, 1], e = nu cos^2 phi + nv sin^2 phi.
    """

    def f(wi, wo):
        h = halfway(wi, wo)
        c, k = h[..., 2], jnp.sum(wi * h, axis=-1)
        exponent = (nu * h[..., 0] ** 2 + nv * h[..., 1] ** 2) / jnp.maximum(1 - c**2, 1e-12)
        size = jnp.sqrt((nu + 1) * (nv + 1)) / (8 * jnp.pi)
        return size * c**exponent / (k * jnp.maximum(wi[..., 2], wo[..., 2])) * schlick(rs, k)

    return f


def ashikhmin_blend(wi, wo):
    """Glossy over diffuse (Ashikhmin): conserves, largest at normal incidence; reciprocal, although wi.h cancels at grazing."""
    rs, m = 0.04, 0.3
    h = halfway(wi, wo)
    c2, k, i, o = h[..., 2] ** 2, jnp.sum(wi * h, axis=-1), wi[..., 2], wo[..., 2]
    beckmann = jnp.exp((c2 - 1) / (c2 * m**2)) / (jnp.pi * m**2 * c2**2)
    diffuse = 28 / (23 * jnp.pi) * (1 - rs) * (1 - (1 - i / 2) ** 5) * (1 - (1 - o / 2) ** 5)
    return diffuse + beckmann / (4 * k * jnp.maximum(i, o)) * schlick(rs, k)


def ggx_in_single_precision(roughness):
    """Isotropic: azimuth enters through rounding only. In float32, 1 - c^2 makes it violate, 1.0146 at roughness 0.05."""

    def f(wi, wo):
        wi, wo = wi.astype(jnp.float32), wo.astype(jnp.float32)
        h = wi + wo
        c = jnp.clip((h / jnp.sqrt(jnp.sum(h * h, axis=-1, keepdims=True)))[..., 2], 0, 1)
        alpha = jnp.asarray(roughness, jnp.float32) ** 2
        a2, i, o = alpha * alpha, wi[..., 2], wo[..., 2]
        distribution = alpha / (1 - c * c + (c * alpha) ** 2)
        visibility = 0.5 / (i * jnp.sqrt(a2 + (1 - a2) * o * o) + o * jnp.sqrt(a2 + (1 - a2) * i * i))
        return distribution * distribution / jnp.float32(jnp.pi) * visibility

    return f


def numpy_overwrites_wo(wi, wo):
    """0.9/pi NL NV, albedo 0.6 NL, reciprocal; it writes over its second argument."""
    wi, wo = np.asarray(wi), np.asarray(wo)
    value = 0.9 / np.pi * wi[..., 2] * wo[..., 2]
    wo[...] = 0
    return value


def numpy_overwrites_wi(wi, wo):
    """The same, writing over its first argument: it flips it in place, and back it is not."""
    wi, wo = np.asarray(wi), np.asarray(wo)
    wi *= -1
    return 0.9 / np.pi * -wi[..., 2] * wo[..., 2]


# --- maxima in narrow places ---


def oren_nayar(roughness, colour=1.0):
    """Oren-Nayar's fit with sigma = pi roughness: in the limit of grazing light 1 - s/2(s+.33) + .225 s/(s+.09), s = sigma^2.

    Largest where (s + .33)/(s + .09) = sqrt(.165/.02025); at roughness 0 the albedo is `colour` at every angle, a plateau.
    """
    s2 = (roughness * jnp.pi) ** 2

    def f(wi, wo):
        i, o = wi[..., 2], wo[..., 2]
        s = jnp.sum(wi * wo, axis=-1) - i * o
        t = jnp.where(s > 0, s / jnp.maximum(i, o), 0.0)
        return colour * (1 - 0.5 * s2 / (s2 + 0.33) + 0.45 * s2 / (s2 + 0.09) * t) / jnp.pi

    return f


def oren_nayar_paint(roughness):
    """The same, a little darker: the plateau at roughness 0 lies at 0.9875, the maximum at 1.0024890."""
    return oren_nayar(roughness, 0.9875)


def coated(clearcoat, coat_roughness, roughness):
    """Base under a clear coat whose Fresnel term takes from the base by another angle than it gives: 1.0010243492 at most.

    At clearcoat=1, coat_roughness=0.2990, roughness=0.05 (its lower end) and cos theta = 0.60473.
    """

    def f(wi, wo):
        darker = 1 - clearcoat * schlick(0.04, jnp.minimum(wi[..., 2], wo[..., 2]))
        coat = ggx_lobe(wi, wo, coat_roughness**2) * schlick(0.04, jnp.sum(wi * halfway(wi, wo), axis=-1))
        return darker * ggx_lobe(wi, wo, roughness**2) + clearcoat * coat

    return f


def bump_at_ten_degrees(wi, wo):
    """A ridge of incidence 3 degrees wide: 0.4448521855 + 0.701598411 on its crest at 10.177246783 degrees. Not reciprocal."""
    x = (jnp.arccos(jnp.clip(wi[..., 2], 0, 1)) - jnp.radians(10.177246783)) / jnp.radians(1.5)
    return (0.4448521855 + 0.701598411 * jnp.exp(-x * x)) / jnp.pi + 0 * wo[..., 0]


def ring(wi, wo):
    """A reciprocal ridge in the cosine, 0.9 + 0.3 (g(NL) + 2 int g(c) c dc): 1.208459922 at its crest, cos 0.7955."""

    def g(c):
        return jnp.exp(-(((c - 0.7955) / 0.01) ** 2))

    return (0.9 + 0.3 * (g(wi[..., 2]) + g(wo[..., 2]))) / jnp.pi


_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(200)
_SHARE = 2 * np.pi * np.radians(6) * np.sum(_WEIGHTS * (1 - _NODES**2) ** 2 * np.sin(2 * np.radians(14 + 6 * _NODES)) / 2)


def band_of_twelve_degrees(wi, wo):
    """A retro-band from 8 to 20 degrees: 0.8 + 0.1 (1 - cos t) + 0.5 (1 - ((t - 14)/6)^2)^2, largest 1.3029720 at 14.0076."""

    def band(w):
        t = jnp.degrees(jnp.arccos(jnp.clip(w[..., 2], 0, 1)))
        return jnp.maximum(0, 1 - ((t - 14) / 6) ** 2) ** 2

    return (0.8 + 0.3 * (1 - wi[..., 2]) * (1 - wo[..., 2])) / jnp.pi + 0.5 / _SHARE * band(wi) * band(wo)


# --- parameters that are held, or that only take away ---


def sixteenth(n):
    """The sixteenth power with its published factor (n + 6)/24.55: 1.0016005217 at n = 17.851, for n from 14.303 to 23.056."""
    return sixteenth_ks(n, 1.0)


def sixteenth_ks(n, ks):
    """ks times it: the same at ks = 1."""
    return sixteenth_dull(n, ks, 0.0, 0.0)


def sixteenth_dull(n, ks, f90, dull):
    """Two more parameters that only take away: the same where both are 0."""

    def f(wi, wo):
        c = halfway(wi, wo)[..., 2]
        return ks * (1 - f90 / 2) * (1 - dull / 2) * (n + 6) / 24.55 * jnp.maximum(0, 1 + n / 16 * (c - 1)) ** 16

    return f


def brushed(weight, f0, ax, ay):
    """Anisotropic GGX brushed at 45 degrees: at grazing along the brush 10 = sqrt(1/0.01), at 90 degrees to the axes 7.07.

    At weight = 0 there is nothing, at ax = ay it is isotropic: the corners and the diagonal of the box do not show the azimuth.
    """
    a2 = ax * ay

    def f(wi, wo):
        h = halfway(wi, wo)
        x, y = (h[..., 0] + h[..., 1]) / jnp.sqrt(2.0), (h[..., 1] - h[..., 0]) / jnp.sqrt(2.0)
        q = (x / ax) ** 2 + (y / ay) ** 2 + h[..., 2] ** 2
        i, o = wi[..., 2], wo[..., 2]
        li, lo = jnp.sqrt(a2 + (1 - a2) * i**2), jnp.sqrt(a2 + (1 - a2) * o**2)
        fresnel = schlick(f0, jnp.sum(wi * h, axis=-1))
        return weight * fresnel * 0.5 / (jnp.pi * ax * ay * q**2 * (li * o + lo * i))

    return f


def tinted_metal(specular_weight, f0, tint, alpha):
    """Metal with a tint at the edge: negative where f0 = tint = 0, about -4.5e3 at alpha = 0.05. At most 1 (f0 = tint = 1)."""
    m = 1 / 7
    b = schlick(f0, m) * (1 - tint) / (m * (1 - m) ** 6)

    def f(wi, wo):
        k = jnp.sum(wi * halfway(wi, wo), axis=-1)
        return specular_weight * ggx_lobe(wi, wo, alpha) * (schlick(f0, k) - b * k * (1 - k) ** 6)

    return f


def tinted_metal_in_the_dark(f0, tint, alpha):
    """The same with its weight in the code: just as negative."""
    return tinted_metal(1.0, f0, tint, alpha)


def rough_gloss(kd, ks, u, v):
    """A coat with multiple bounces: 52.90213219 in the limit of grazing light at ks = 1, u = v = 0.01, whatever kd is.

    There it is pi + 1/(4 pi) int o/((1-r) o + r)/(1 - (1-r) c^2)^2 dw, r = u v, o = N.wo, c = N.h; at cos 1e-9 still 5e-4 less.
    """

    def f(wi, wo):
        h = halfway(wi, wo)
        r = u * v
        skew = jnp.where(u < v, 1 - u**2 / v**2, v**2 / u**2 - 1)
        i, o = wi[..., 2], wo[..., 2]
        x2, y2 = h[..., 0] ** 2, h[..., 1] ** 2
        share = jnp.where(skew > 0, x2, y2) / jnp.maximum(x2 + y2, 1e-300)
        p = 1 - jnp.abs(skew)
        turned = jnp.sqrt(p / (p**2 - p**2 * share + share))
        distribution = r / (1 + (r - 1) * h[..., 2] ** 2) ** 2 * turned / jnp.pi
        g = (i / (i * (1 - r) + r)) * (o / (o * (1 - r) + r))
        fresnel = schlick(ks, jnp.sum(wo * h, axis=-1))
        bounces = o * jnp.clip((1 - g) / (4 * i * o), 0, 1)
        return (distribution * g / (4 * i) + bounces) / o * fresnel + (1 - fresnel) * kd / jnp.pi

    return f


# --- limits at grazing incidence, and what grows without bound ---


def grazing_root(limit: float, power: float) -> Brdf:
    """a/pi (1 - (NL NV)^p): its limit at grazing is a, approached like the power p. With a = 1 and p = 0.1 it is still 0.88 at
    the cosine 1e-9, with p = 0.5 2.5e-5 less than 1."""
    return lambda wi, wo: limit / jnp.pi * (1 - (wi[..., 2] * wo[..., 2]) ** power)


def grazing_power(wi, wo):
    """a (NL NV)^-0.359: grows without bound although at cos 1e-9 it is still 0.906."""
    return 1.39e-4 / (wi[..., 2] * wo[..., 2]) ** 0.359


def grazing_ggx(scale):
    """GGX times a scale: the scale is the limit, above 1 + 1e-9 where the scale is."""
    return lambda wi, wo: scale * ggx_lobe(wi, wo, 0.3)


def lommel_seeliger(wi, wo):
    """c/(NL + NV): its limit is 2 pi c = 1 + 1e-8, and at cos 1e-9 it is still below 1."""
    return (1 + 1e-8) / (2 * jnp.pi) / (wi[..., 2] + wo[..., 2])


def grazing_logarithm(s):
    """1.004 s in the limit, approached like 1 / log: (1 - 1/(1 - log c)) of both cosines, 1.00255 at a cosine of 1e-300."""
    x, weight = np.polynomial.laguerre.laggauss(60)
    mean = np.sum(weight * (1 - 1 / (1 + x / 2)))
    g = lambda c: 1 - 1 / (1 - jnp.log(c))  # noqa: E731
    return lambda wi, wo: 1.004 * s / (jnp.pi * mean) * g(wi[..., 2]) * g(wo[..., 2])


def singular_line(wi, wo):
    """0.12 / sqrt(|xi + xo|), 0.839058 at normal incidence: infinite on a line through the mirror direction, and integrable."""
    return 0.12 / jnp.sqrt(jnp.abs(wi[..., 0] + wo[..., 0]))


def inverse_square_cosines(wi, wo):
    """(NL NV)^-2: the integral is infinite at every angle, although no value is."""
    return 1 / (wi[..., 2] * wo[..., 2]) ** 2


def ward(ax, ay):
    """Ward's first form, with 1/sqrt(NL NV): grows without bound towards grazing."""

    def f(wi, wo):
        h = halfway(wi, wo)
        slopes = ((h[..., 0] / ax) ** 2 + (h[..., 1] / ay) ** 2) / h[..., 2] ** 2
        return jnp.exp(-slopes) / (4 * jnp.pi * ax * ay * jnp.sqrt(wi[..., 2] * wo[..., 2]))

    return f


def compensated(pr, f0):
    """GGX times 1 + f0 (1/x - 1) with a fitted x(roughness, NL) that crosses zero: a pole within the box, so no bound."""
    p = jnp.clip(pr, 0.089, 1.0)
    rx, ry, rz = 1 - pr, 0.0425 - 0.0275 * pr, 1.04 - 0.572 * pr

    def f(wi, wo):
        x = -1.04 * (jnp.minimum(rx * rx, 2.0 ** (-9.28 * wi[..., 2])) * rx + ry) + rz
        f90 = jnp.clip(f0 * 50 * 0.33 * 3, 0, 1)
        k = jnp.sum(wi * halfway(wi, wo), axis=-1)
        return ggx_lobe(wi, wo, p**2) * (f0 + (f90 - f0) * (1 - k) ** 5) * (1 + f0 * (1 / x - 1))

    return f


# --- a batch is not its rows ---


def norm_of_the_batch(wi, wo):
    """The norm without axis=-1 is that of all directions. One by one: 28 (20 + 2^-10)/(22 * 24) = 1.0606578480."""
    h = (wi + wo) / jnp.linalg.norm(wi + wo)
    return 28 / (8 * jnp.pi) * jnp.maximum(h[..., 2], 0) ** 20


def norm_of_each(wi, wo):
    """The same as it was meant: no finding, 1.0606578480."""
    return 28 / (8 * jnp.pi) * jnp.maximum(halfway(wi, wo)[..., 2], 0) ** 20


def largest_of_the_batch(wi, wo):
    """Divided by the largest value of whatever is asked together: no BRDF at all."""
    c = jnp.maximum(jnp.sum(wi * jnp.array([-1.0, -1.0, 1.0]) * wo, axis=-1), 0) ** 20
    return 2 / jnp.pi * c / jnp.max(c)


def numpy_largest_of_the_batch(wi, wo):
    """The same slip in numpy."""
    c = (np.asarray(wi)[..., 2] * np.asarray(wo)[..., 2]) ** 2
    return 2 / np.pi * c / np.max(c)


def running_mean(wi, wo):
    """A mean of what was asked before it: depends on the order of the directions."""
    c = wi[..., 2] * wo[..., 2]
    return 0.3 * jnp.cumsum(c) / jnp.arange(1.0, c.size + 1)


def divided_by_their_number(wi, wo):
    """A mean where there is nothing to average: 0.9/pi divided by how many directions are asked together."""
    return 0.9 / jnp.pi / len(wi) + 0 * wo[..., 2]


def numpy_random(wi, wo):
    """Noise: another value at each call."""
    return np.random.default_rng().uniform(0, 0.3, len(np.asarray(wo)))


def random_while_traced(wi, wo):
    """Noise from numpy in a function that JAX traces: it is drawn once for each program, another for each size."""
    return 0.3 * np.random.default_rng().uniform(size=wo.shape[0]) + 0 * wo[..., 2]


def numpy_counting() -> Brdf:
    """Keeps a count between calls: the values grow."""
    calls = itertools.count(1)
    return lambda wi, wo: 1e-3 * next(calls) + 0 * np.asarray(wo)[..., 2]


# --- every wi with every wo ---


def outer_product(wi, wo):
    """wi.wo of all pairs, shape (k, k): no channels."""
    return 0.3 * jnp.maximum(jnp.dot(wi, wo.T), 0)


def numpy_outer_product(wi, wo):
    """The same in numpy, where tens of thousands of directions would take tens of GiB."""
    return 0.3 * np.maximum(np.dot(wi, np.transpose(wo)), 0)


def numpy_pairs_within(wi, wo):
    """Takes all pairs, wastefully, and returns those that were asked, shape (k,): 0.3 (wi.wo)+, albedo 0.2 pi at most."""
    return np.diagonal(0.3 * np.maximum(np.dot(np.asarray(wi), np.transpose(np.asarray(wo))), 0)).copy()


# --- channels ---


def glows(*albedos):
    """Channels of these albedos; of four, which have no names, as of three the brightest counts."""
    return lambda wi, wo: jnp.array(albedos) / jnp.pi + 0 * wo[..., 2:]


def blue_glows(n):
    """Blue is 1.0016005217 at n = 17.851, red and green half of it and a tenth."""
    return lambda wi, wo: sixteenth(n)(wi, wo)[..., None] * jnp.array([0.5, 0.1, 1.0])


# --- not finite ---# --- not finite ---


def nan_everywhere(wi, wo):
    """No value is a number: nothing is negative, and nothing can be said about the albedo."""
    return jnp.nan * wi[..., 2]


def zero_by_zero_at_the_mirror(scale):
    """scale/pi sin(x)/x with x = |wo - mirror of wi|: NaN at one direction, of measure zero. Below `scale` everywhere."""

    def f(wi, wo):
        x = jnp.linalg.norm(wo - wi * jnp.array([-1.0, -1.0, 1.0]), axis=-1)
        return scale / jnp.pi * jnp.sin(x) / x

    return f


def zero_by_zero_at_the_normal(wi, wo):
    """0.5/pi times |t|/|t| with t the light in the plane: NaN for light along the normal and nowhere else. Albedo 0.5."""
    t = jnp.linalg.norm(wi[..., :2], axis=-1)
    return 0.5 / jnp.pi * t / t + 0 * wo[..., 2]


def infinite_at_the_mirror(wi, wo):
    """0.4/pi, but infinite at the mirror direction itself, of measure zero. Albedo 0.4."""
    gap = jnp.linalg.norm(wo - wi * jnp.array([-1.0, -1.0, 1.0]), axis=-1)
    return jnp.where(gap == 0, jnp.inf, 0.4 / jnp.pi)


def glows_but_for_the_mirror(wi, wo):
    """1.3/pi, NaN at the mirror direction itself: VIOLATES all the same."""
    gap = jnp.linalg.norm(wo - wi * jnp.array([-1.0, -1.0, 1.0]), axis=-1)
    return 1.3 / jnp.pi * gap / gap


def negative_throughout(wi, wo):
    """-0.1 everywhere: nothing that conserves."""
    return -0.1 + 0 * wi[..., 2] * wo[..., 2]


# --- parameters of any size ---


def fades_in(n):
    """0.9/pi (1 - 1/n): 0.9 for large n, whatever the exponent of n."""
    return lambda wi, wo: 0.9 / jnp.pi * (1 - 1 / n) + 0 * wo[..., 2]


def hill(x):
    """1.05/pi 2^-(x/1e307 - 1.3)^2 over both signs of x: 1.05 at x = 1.3e307."""
    return lambda wi, wo: 1.05 / jnp.pi * 2.0 ** (-((x / 1e307 - 1.3) ** 2)) + 0 * wo[..., 2]


def tiny(a):
    """0.7/pi + a with a up to 1e-300: 0.7."""
    return lambda wi, wo: 0.7 / jnp.pi + a + 0 * wo[..., 2]


# --- signatures ---


def three_arguments(wi, wo, n):
    """The parameter beside the directions: the albedo is 0.018 n times the cosine, 0.9 for n = 50 and normal light."""
    return 0.027 / jnp.pi * n * wi[..., 2] * wo[..., 2]


def three_arguments_default(wi, wo, n=5.0):
    """The same with a default: one BRDF where no range is given."""
    return three_arguments(wi, wo, n)


def three_arguments_bad(wi, wo, n):
    """Two per cent too much."""
    return 1.02 / 0.9 * three_arguments(wi, wo, n)


def normalised_phong(n):
    """(n+2)/(2 pi) cos^n of the mirror direction: 1 for normal light and for every n, a plateau on the line itself."""
    mirror = jnp.array([-1.0, -1.0, 1.0])
    return lambda wi, wo: (n + 2) / (2 * jnp.pi) * jnp.maximum(jnp.sum(wi * mirror * wo, axis=-1), 0) ** n


# --- results that are no numbers, or too few ---


def numpy_one_number(wi, wo):
    """One number for all directions, in numpy: 0.2/sr, albedo 0.2 pi."""
    np.asarray(wi)
    return 0.2


def one_number(wi, wo):
    """The same where JAX can trace it."""
    return 0.2


def numpy_values(value, kind=None):
    """One value for all directions in an array of a numpy type, of which only real numbers will do: complex ones are refused,
    here with nothing in their imaginary part, and so are dates, timedelta64, although numpy says that its kind is a number,
    Python objects and words, also those that look like numbers."""
    return lambda wi, wo: np.full(len(np.asarray(wo)), value, kind)


def complex_traced(wi, wo):
    """Complex values where JAX can trace them, as from a refractive index n + ik."""
    return (0.2 + 0.1j) * wo[..., 2]


def numpy_list(wi, wo):
    """A list of numbers will do: 0.2/sr."""
    return [0.2 for _ in np.asarray(wo)]


def returns_nothing(wi, wo):
    """The return was forgotten."""
    0.2 * wo[..., 2]
