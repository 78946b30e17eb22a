"""Families of BRDFs that are hard to judge, each with the supremum of its directional albedo known by derivation.

`cases(count, seed)` cycles through all `kinds()`; the same arguments give the same cases. Every BRDF is written as a user
would write it, once for numpy and JAX alike, and gets parameters without an effect, or with one that only takes away.

Two facts carry most truths. A *carrier* has the albedo 1 as its supremum, so a carrier times E(parameters) has that of E.
And a cap of half-angle w whose profile is (1 - v/v0)^p, v = 1 - cos(angle to its axis), v0 = 1 - cos w, has about N

    integral of profile (N.wo) dwo = 2 pi (v0/(p + 1) - v0^2/((p + 1)(p + 2))),

times N.axis where it is tilted but above the horizon; no tilt gives more, since N.wo falls away from N.
"""

# ruff: noqa: E731 - a family is a function that returns a function: on one line where it has one.
from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from numpy.random import Generator
from scipy.optimize import minimize_scalar

from brdfcheck.brdf.factors import Factor, Normalized
from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, Phong

Brdf = Callable[[Any, Any], Any]


@dataclass(frozen=True)
class Case:
    """A family of BRDFs and the supremum of its albedo over its parameters, all cosines in (0, 1] and all azimuths.

    `build(**parameters)` gives f(wi, wo); where `ranges` is empty, `build` is that f. `truth` (np.inf where the albedo
    grows without bound) is known to +- `accuracy`. `place` is where: values of the parameters that matter, "cos_theta" (0:
    only in the limit) and "azimuth" where these matter; `unique` says that the supremum is at no other. `spot` is the
    direction (theta, azimuth) and the half-angle of what a rule over the hemisphere may overlook. `curve` is the albedo at
    the place as a function of the cosine, where it is known.
    """

    build: Callable[..., Any]
    truth: float
    ranges: dict[str, tuple[float, float]] = field(default_factory=dict)
    accuracy: float = 1e-11
    place: dict[str, float] = field(default_factory=dict)
    unique: bool = True
    jumps: bool = False
    numpy: bool = False
    single: bool = False
    reciprocal: bool = True
    anisotropic: bool = False
    spot: tuple[float, float, float] | None = None
    curve: Callable[[float], float] | None = None
    name: str = ""
    kind: str = ""

    def brdf(self, **parameters: float) -> Brdf:
        """A member: parameters that are not given are those of the supremum, or the low ends of their ranges."""
        if not self.ranges:
            return self.build
        return self.build(**{name: parameters.get(name, self.place.get(name, low)) for name, (low, _) in self.ranges.items()})

    @property
    def angles(self) -> tuple[float, float]:
        """(cos_theta, azimuth) of the supremum; anything where they do not matter."""
        return self.place.get("cos_theta", 0.7), self.place.get("azimuth", 0.3)


class _Kind(NamedTuple):
    draw: Callable[[Generator, Any], Case]
    idle: int  # the most parameters that are added
    classes: bool  # BRDFs of the package: for JAX only, and not to be multiplied


_KINDS: dict[str, _Kind] = {}


def _kind(name: str, idle: int = 1, classes: bool = False) -> Callable:
    def register(draw: Callable[[Generator, Any], Case]) -> Callable:
        _KINDS[name] = _Kind(draw, idle, classes)
        return draw

    return register


def kinds() -> tuple[str, ...]:
    """The names of all kinds."""
    return tuple(_KINDS)


def case(kind: str, key: tuple[int, ...], numpy: bool = False) -> Case:
    """The case of a kind that belongs to a few whole numbers."""
    entry = _KINDS[kind]
    if numpy and entry.classes:
        raise ValueError(f"{kind} is for JAX only")
    random, xp = np.random.default_rng([*key, list(_KINDS).index(kind)]), np if numpy else jnp
    drawn = _completed(entry, entry.draw(random, xp), random, xp)
    name = f"{kind} {'-'.join(map(str, key))}{' numpy' if numpy else ''}"
    return replace(drawn, name=name, kind=kind, numpy=numpy)


def cases(count: int, seed: int) -> list[Case]:
    """`count` cases of all kinds in turn, one in five written with numpy."""
    return [drawn(seed, index) for index in range(count)]


def drawn(seed: int, index: int) -> Case:
    """The case of that number among those of a seed."""
    kind = kinds()[index % len(_KINDS)]
    numpy = not _KINDS[kind].classes and np.random.default_rng([seed, index]).random() < 0.2
    return case(kind, (seed, index), numpy)


def plain_kinds() -> tuple[str, ...]:
    """The kinds that numpy can write too."""
    return tuple(kind for kind, entry in _KINDS.items() if not entry.classes)


def twins(kind: str, seed: int) -> tuple[Case, Case]:
    """One family written with numpy and for JAX."""
    return case(kind, (seed, 0), numpy=True), case(kind, (seed, 0))


def _completed(entry: _Kind, drawn: Case, random: Generator, xp: Any) -> Case:
    """With further parameters that do nothing or only take away, all in random order."""
    core, own, ranges, place = drawn.build, tuple(drawn.ranges), dict(drawn.ranges), dict(drawn.place)
    effects: dict[str, Callable[[Any], Any]] = {}
    for index in range(int(random.integers(entry.idle + 1))):
        name, effect = f"idle{index}", int(random.integers(3))
        ranges[name] = (0.0, 1.0)
        if effect and not entry.classes:
            place[name] = float(effect - 1)
            effects[name] = (lambda value: 1 - 0.5 * value) if effect == 1 else (lambda value: value)
    if random.random() < 0.25:
        value = _uniform(random, 0.2, 3)
        ranges["held"] = (value, value)
        if not entry.classes:
            effects["held"] = lambda parameter: parameter / value
    if not ranges:
        return replace(drawn, build=_on_arrays(core()) if xp is np else core())

    def build(**parameters: Any) -> Brdf:
        if xp is np:
            parameters = {name: float(parameter) for name, parameter in parameters.items()}
        f = core(**{name: parameters[name] for name in own})
        if not effects:
            return _on_arrays(f) if xp is np else f
        scale = 1.0
        for name, effect in effects.items():
            scale = scale * effect(parameters[name])

        def scaled(wi: Any, wo: Any) -> Any:
            value = f(wi, wo)
            return value * xp.asarray(scale, value.dtype)

        return _on_arrays(scaled) if xp is np else scaled

    names = [str(name) for name in random.permutation(list(ranges))]
    keywords = [inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY) for name in names]
    build.__signature__ = inspect.Signature(keywords)  # pyright: ignore[reportFunctionMemberAccess]
    order = [str(name) for name in random.permutation(names)]
    return replace(drawn, build=build, ranges={name: ranges[name] for name in order}, place=place)


def _on_arrays(f: Brdf) -> Brdf:
    """As numpy code is: what JAX traces cannot go through it."""
    return lambda wi, wo: f(np.asarray(wi), np.asarray(wo))


# --- draws ---


def _uniform(random: Generator, low: float, high: float) -> float:
    return float(random.uniform(low, high))


def _log_uniform(random: Generator, low: float, high: float) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def _one_of(random: Generator, *options: Any) -> Any:
    return options[int(random.integers(len(options)))]


def _target(random: Generator, close: float = 0.3) -> float:
    """A supremum above or below 1: within 1e-6 with the probability `close`, else by 1e-4 to 1e-2 or by a tenth or more."""
    sign, draw = _one_of(random, -1, 1), random.random()
    if draw < close:
        return 1 + sign * _log_uniform(random, 2e-8, 1e-6)
    return 1 + sign * (_log_uniform(random, 1e-4, 1e-2) if draw < (1 + close) / 2 else _uniform(random, 0.1, 0.4))


class _Range(NamedTuple):
    """A range of a parameter as the unit interval, geometric or linear."""

    low: float
    high: float
    geometric: bool

    def unit(self, value: Any, xp: Any) -> Any:
        if self.geometric:
            return xp.log(value / self.low) / float(np.log(self.high / self.low))
        return (value - self.low) / (self.high - self.low)

    def at(self, unit: float) -> float:
        if self.geometric:
            return float(self.low * (self.high / self.low) ** unit)
        return self.low + (self.high - self.low) * unit

    def share(self, width: float) -> float:
        """[p, p (1 + width)] on a geometric range, `width` of the whole on a linear one: in units of the unit interval."""
        return float(np.log1p(width) / np.log(self.high / self.low)) if self.geometric else width

    @property
    def ends(self) -> tuple[float, float]:
        return self.low, self.high


def _range(random: Generator) -> _Range:
    return _one_of(
        random, _Range(0.0, 1.0, False), _Range(-2.0, 5.0, False), _Range(1.0, 1000.0, True), _Range(0.01, 1.0, True)
    )


def _highest(function: Callable[[np.ndarray], Any], span: _Range) -> tuple[float, float]:
    """(place, value) of the largest value on a range of something that a grid of 4001 resolves."""
    grid = np.array([span.at(unit) for unit in np.linspace(0, 1, 4001)])
    height = np.pad(np.asarray(function(grid), float), 1, constant_values=-np.inf)
    crests = np.flatnonzero((height[1:-1] >= height[:-2]) & (height[1:-1] >= height[2:]))
    places = [float(grid[crest]) for crest in crests]
    for crest in crests[np.argsort(-height[1:-1][crests])][:12]:
        around = (grid[max(crest - 1, 0)], grid[min(crest + 1, 4000)])
        lowest = minimize_scalar(
            lambda p: -float(function(np.asarray(p))), bounds=around, method="bounded", options={"xatol": 1e-12}
        )
        places += [float(lowest.x), *around]  # pyright: ignore[reportAttributeAccessIssue]
    place = max(places, key=lambda p: float(function(np.asarray(p))))
    return place, float(function(np.asarray(place)))


# --- directions and profiles ---


def _dot(a: Any, b: Any, xp: Any) -> Any:
    return xp.sum(a * b, axis=-1)


def _direction(theta: float, azimuth: float) -> list[float]:
    return [float(np.sin(theta) * np.cos(azimuth)), float(np.sin(theta) * np.sin(azimuth)), float(np.cos(theta))]


def _angle(w: Any, xp: Any) -> Any:
    return xp.arctan2(xp.hypot(w[..., 0], w[..., 1]), w[..., 2])


def _mirror(wi: Any, xp: Any) -> Any:
    return wi * xp.asarray([-1.0, -1.0, 1.0], wi.dtype)


def _half(wi: Any, wo: Any, xp: Any) -> Any:
    h = wi + wo
    return h / xp.linalg.norm(h, axis=-1, keepdims=True)


def _phong(wi: Any, wo: Any, n: Any, xp: Any) -> Any:
    return (n + 2) / (2 * np.pi) * xp.maximum(_dot(_mirror(wi, xp), wo, xp), 0.0) ** n


def _retro(wi: Any, wo: Any, n: Any, xp: Any) -> Any:
    return (n + 2) / (2 * np.pi) * xp.maximum(_dot(wi, wo, xp), 0.0) ** n


def _blinn_phong(wi: Any, wo: Any, n: Any, xp: Any) -> Any:
    return (n + 2) * (n + 4) / (8 * np.pi * (2.0 ** (-n / 2) + n)) * _half(wi, wo, xp)[..., 2] ** n


def _lambert(wi: Any, wo: Any, n: Any, xp: Any) -> Any:
    return 1 / np.pi * xp.ones_like(wo[..., 2])


def _rising(wi: Any, wo: Any, n: Any, xp: Any) -> Any:
    return (1 - wi[..., 2] * wo[..., 2]) / np.pi


_PEAKED = (_phong, _retro, _blinn_phong)  # the albedo is 1 at normal incidence for every exponent, less elsewhere


class _Carrier(NamedTuple):
    """A reciprocal BRDF whose albedo has the supremum 1, and where."""

    f: Brdf
    place: Mapping[str, float]


def _carrier(random: Generator, xp: Any, *choice: Callable) -> _Carrier:
    form, n = _one_of(random, *(choice or (*_PEAKED, _lambert, _rising))), _uniform(random, 2, 50)
    place = {} if form is _lambert else {"cos_theta": 0.0 if form is _rising else 1.0}
    return _Carrier(lambda wi, wo: form(wi, wo, n, xp), place)


def _times(surface: Callable[..., Any], f: Brdf) -> Callable[..., Brdf]:
    """The family of f times a function of the parameters."""
    return lambda **parameters: lambda wi, wo: surface(**parameters) * f(wi, wo)


def _versine(width: float) -> float:
    return float(2 * np.sin(width / 2) ** 2)


def _cap(axis: Any, w: Any, width: float, power: float, xp: Any) -> Any:
    """(1 - v/v0)^power inside a cap about an axis, 0 outside; power 0 is a disc."""
    versine = xp.sum((w - axis) ** 2, axis=-1) / 2
    if power == 0:
        return xp.where(versine < _versine(width), 1.0, 0.0)
    return xp.maximum(1 - versine / _versine(width), 0.0) ** power


def _cap_albedo(width: float, power: float) -> float:
    v0 = _versine(width)
    return 2 * np.pi * (v0 / (power + 1) - v0**2 / ((power + 1) * (power + 2)))


def _bell(shape: str, t: Any, xp: Any) -> Any:
    """1 at t = 0, 0 from |t| = 1 on."""
    if shape == "smooth":
        return xp.maximum(1 - t * t, 0.0) ** 3
    if shape == "tent":
        return xp.maximum(1 - xp.abs(t), 0.0)
    return (1 - xp.clip(2 * xp.abs(t) - 1, 0.0, 1.0) ** 2) ** 2  # flat as far as |t| = 1/2


def _reach(shape: str, level: float) -> float:
    """The |t| at which a bell has come down to `level`."""
    if shape == "smooth":
        return float(np.sqrt(1 - level ** (1 / 3)))
    return 1 - level if shape == "tent" else float(1 + np.sqrt(1 - np.sqrt(level))) / 2


class _Spike(NamedTuple):
    """E = low + height bell(t), low = 0.9 where it reaches above 1: that is at |t| < `reach`."""

    shape: str
    truth: float
    low: float
    height: float

    @property
    def reach(self) -> float:
        return _reach(self.shape, 0.1 / self.height)


def _spike(random: Generator) -> _Spike:
    truth, shape = _target(random), _one_of(random, "smooth", "tent", "flat")
    height = abs(truth - 1) + 0.1
    return _Spike(shape, truth, truth - height, height)


# --- lobes of the literature ---


def _at_normal(lobe: str, n: np.ndarray) -> np.ndarray:
    """The albedo of a lobe with peak value 1 at normal incidence, where it is largest."""
    if lobe == "phong":
        return 2 * np.pi / (n + 2)
    if lobe == "blinn-phong":
        return 8 * np.pi * (2.0 ** (-n / 2) + n) / ((n + 2) * (n + 4))
    nodes, weights = np.polynomial.legendre.leggauss(16)  # exact for the polynomial of degree 19
    low = np.maximum(np.sqrt(0.5), 1 - 16 / n)[..., None]
    c = low + (1 - low) * (nodes + 1) / 2
    return 4 * np.pi * np.sum(weights * (1 - low) * (1 - n[..., None] * (1 - c) / 16) ** 16 * (2 * c**3 - c), axis=-1)


def _peaking(random: Generator) -> tuple[str, float, float, _Range, dict[str, float], float]:
    """A lobe times (n + A)/B: (lobe, A, B, the range of n, where it is largest, the supremum)."""
    lobe = _one_of(random, "phong", "blinn-phong", "binomial")
    span = _one_of(random, _Range(1.0, 1000.0, True), _Range(1.0, 200.0, True), _Range(5.0, 300.0, True))
    exact = lobe == "phong" and random.random() < 0.5
    a = 2.0 if exact else _uniform(random, *{"phong": (1, 4), "blinn-phong": (5, 9), "binomial": (4, 9)}[lobe])
    truth = _target(random, 0.6)
    n, peak = _highest(lambda n: (n + a) * _at_normal(lobe, n), span)
    return lobe, a, peak / truth, span, {"cos_theta": 1.0} if exact else {"n": n, "cos_theta": 1.0}, truth


@_kind("catalogue lobe", idle=3)
def _catalogue_lobe(random: Generator, xp: Any) -> Case:
    lobe, a, b, span, place, truth = _peaking(random)
    which = random.random()
    if which < 0.15:
        lambert = lambda rho: lambda wi, wo: rho * _lambert(wi, wo, 0, xp)
        return Case(lambert, truth, {"rho": (0.2, truth)}, place={"rho": truth})
    if which < 0.4:
        exact = lambda n: lambda wi, wo: truth * _blinn_phong(wi, wo, n, xp)
        return Case(exact, truth, {"n": span.ends}, place={"cos_theta": 1.0})

    def family(n: Any) -> Brdf:
        def f(wi: Any, wo: Any) -> Any:
            if lobe == "phong":
                return (n + a) / b * xp.maximum(_dot(_mirror(wi, xp), wo, xp), 0.0) ** n
            c = _half(wi, wo, xp)[..., 2]
            return (n + a) / b * (c**n if lobe == "blinn-phong" else xp.maximum(1 - n * (1 - c) / 16, 0.0) ** 16)

        return f

    return Case(family, truth, {"n": span.ends}, place=place)


@_kind("catalogue class", idle=3, classes=True)
def _catalogue_class(random: Generator, xp: Any) -> Case:
    lobe, a, b, span, place, truth = _peaking(random)
    of = {"phong": Phong, "blinn-phong": BlinnPhong, "binomial": BinomialPower}[lobe]
    if random.random() < 0.5:
        return Case(lambda n: Normalized(of(n), Factor(a, b)), truth, {"n": span.ends}, place=place)
    family = lambda fade, n: Normalized(of(n), Factor(a, b * (1 + fade)))
    return Case(family, truth, {"n": span.ends, "fade": (0.0, 2.0)}, place={**place, "fade": 0.0})


@_kind("sum", idle=2)
def _sum(random: Generator, xp: Any) -> Case:
    truth, specular = _target(random), _carrier(random, xp, *_PEAKED).f
    diffuse = lambda wi, wo: _lambert(wi, wo, 0, xp)
    if random.random() < 0.5:
        kd = _uniform(random, 0.1, 0.9) * truth
        family = lambda kd, ks: lambda wi, wo: kd * diffuse(wi, wo) + ks * specular(wi, wo)
        ranges = {"kd": (0.0, kd), "ks": (0.0, truth - kd)}
        return Case(family, truth, ranges, place={"kd": kd, "ks": truth - kd, "cos_theta": 1.0})
    less, mirrored = truth * _uniform(random, 0.5, 0.999), random.random() < 0.5
    a, b = (less, truth) if mirrored else (truth, less)
    family = lambda blend: lambda wi, wo: (1 - blend) * a * diffuse(wi, wo) + blend * b * specular(wi, wo)
    place = {"blend": 1.0, "cos_theta": 1.0} if mirrored else {"blend": 0.0}
    return Case(family, truth, {"blend": (0.0, 1.0)}, place=place)


@_kind("retro lobe", idle=2)
def _retro_lobe(random: Generator, xp: Any) -> Case:
    truth = _target(random)
    family = lambda n: lambda wi, wo: truth * _retro(wi, wo, n, xp)
    return Case(family, truth, {"n": (1.0, _log_uniform(random, 20, 1000))}, place={"cos_theta": 1.0})


@_kind("off-specular lobe", idle=2)
def _off_specular_lobe(random: Generator, xp: Any) -> Case:
    """A cosine power about the mirror direction turned by `turn` towards N and beyond: largest where it is about N."""
    truth, turn = _target(random), _uniform(random, 0.1, 0.8)
    cosine, sine = float(np.cos(turn)), float(np.sin(turn))

    def family(n: Any) -> Brdf:
        def f(wi: Any, wo: Any) -> Any:
            s, c = xp.hypot(wi[..., 0], wi[..., 1]), wi[..., 2]
            safe = xp.where(s > 0, s, 1.0)
            out = c * sine - s * cosine  # along the tangent of wi
            x, y = xp.where(s > 0, wi[..., 0] / safe, 1.0), wi[..., 1] / safe
            axis = xp.stack([out * x, out * y, c * cosine + s * sine], axis=-1)
            return truth * (n + 2) / (2 * np.pi) * xp.maximum(_dot(axis, wo, xp), 0.0) ** n

        return f

    return Case(family, truth, {"n": (2.0, 60.0)}, place={"cos_theta": cosine}, reciprocal=False)


# --- caps and wedges ---


def _capped(random: Generator, xp: Any, widths: tuple[float, float], power: float, about: str) -> Case:
    """base/pi plus a cap: about a fixed outgoing direction or N ("out"), the same for both directions ("both"), or a moving
    axis ("mirror", "light")."""
    truth, width = _target(random), _log_uniform(random, *widths)
    tilt = 0.0 if random.random() < 0.25 else _uniform(random, 0, np.pi / 2 - 0.02 - width)
    azimuth = _uniform(random, 0, 2 * np.pi)
    axis, tall = _direction(tilt, azimuth), truth * _uniform(random, 0.1, 0.6)
    moving = about in ("mirror", "light")
    height = tall / (_cap_albedo(width, power) * (1.0 if moving else axis[2]))
    base = (truth - tall) / np.pi

    def f(wi: Any, wo: Any) -> Any:
        if moving:
            return base + height * _cap(_mirror(wi, xp) if about == "mirror" else wi, wo, width, power, xp)
        value = _cap(xp.asarray(axis), wo, width, power, xp)
        if about == "both":
            value = value * _cap(xp.asarray(axis), wi, width, power, xp)
        return base + height * value + 0 * wi[..., 2]

    place = {}
    if moving or (about == "both" and tilt == 0):
        place = {"cos_theta": 1.0}
    elif about == "both":
        place = {"cos_theta": axis[2], "azimuth": azimuth}
    return Case(
        lambda: f, truth, place=place, unique=power > 0 or about != "both", jumps=power == 0,
        reciprocal=about != "out", anisotropic=not moving and tilt > 0,
        spot=None if moving else (tilt, azimuth, width),
    )  # fmt: skip


@_kind("spot")
def _spot(random: Generator, xp: Any) -> Case:
    return _capped(random, xp, (0.005, 1.0), _one_of(random, 1, 4), "out")


@_kind("reciprocal cone")
def _cone(random: Generator, xp: Any) -> Case:
    return _capped(random, xp, _one_of(random, (0.05, 1.0), (0.14, 0.14)), _one_of(random, 2, 4), "both")


@_kind("moving bump")
def _moving(random: Generator, xp: Any) -> Case:
    return _capped(random, xp, (0.005, 1.0), _one_of(random, 1, 4), _one_of(random, "mirror", "light"))


@_kind("disc")
def _disc(random: Generator, xp: Any) -> Case:
    return _capped(random, xp, (0.1, 1.0), 0, _one_of(random, "out", "both", "mirror", "light"))


@_kind("wedge")
def _wedge(random: Generator, xp: Any) -> Case:
    """A wedge of azimuth of the angle w holds w/2 of the integral of N.wo, which is pi."""
    truth, width, middle = _target(random), _log_uniform(random, 0.02, 2), _uniform(random, 0, 2 * np.pi)
    tall, about = truth * _uniform(random, 0.1, 0.6), _one_of(random, "out", "both", "mirror")
    base, height = (truth - tall) / np.pi, 2 * tall / width

    def inside(azimuth: Any) -> Any:
        return xp.where(xp.abs(xp.mod(azimuth + np.pi, 2 * np.pi) - np.pi) < width / 2, 1.0, 0.0)

    def f(wi: Any, wo: Any) -> Any:
        out, light = xp.arctan2(wo[..., 1], wo[..., 0]), xp.arctan2(wi[..., 1], wi[..., 0])
        if about == "mirror":
            return base + height * inside(out - light - np.pi)
        return base + height * inside(out - middle) * (inside(light - middle) if about == "both" else 1.0)

    return Case(
        lambda: f, truth, place={"azimuth": middle} if about == "both" else {}, unique=about != "both", jumps=True,
        reciprocal=about != "out", anisotropic=about != "mirror",
    )  # fmt: skip


# --- narrow in parameters or in the angle ---


@_kind("narrow parameter")
def _narrow_parameter(random: Generator, xp: Any) -> Case:
    """Above 1 on a tenth or a hundredth of the range; on a geometric one between p and 1.1 p or 1.01 p."""
    spike, span, carrier = _spike(random), _range(random), _carrier(random, xp)
    unit, width = _uniform(random, 0.05, 0.95), span.share(_one_of(random, 0.1, 0.01)) / (2 * spike.reach)

    def surface(p: Any) -> Any:
        return spike.low + spike.height * _bell(spike.shape, (span.unit(p, xp) - unit) / width, xp)

    place = {"p": span.at(unit), **carrier.place}
    return Case(_times(surface, carrier.f), spike.truth, {"p": span.ends}, place=place, unique=spike.shape != "flat")


@_kind("two narrow parameters")
def _two_narrow_parameters(random: Generator, xp: Any) -> Case:
    """Above 1 on a part of two ranges, a twentieth of one of them: less of both is what a report says that it could miss."""
    spike, spans, carrier = _spike(random), (_range(random), _range(random)), _carrier(random, xp)
    units = [_uniform(random, 0.05, 0.95) for _ in spans]
    widths = [span.share(_one_of(random, 0.1, 0.01)) / (2 * spike.reach) for span in spans]
    mild = random.random() < 0.5
    widths[1] = max(widths[1], 0.05 / (2 * spike.reach))

    def surface(p: Any, q: Any) -> Any:
        first, second = ((span.unit(v, xp) - unit) for span, unit, v in zip(spans, units, (p, q), strict=True))
        across = 1 / (1 + second**2) if mild else _bell(spike.shape, second / widths[1], xp)
        return spike.low + spike.height * _bell(spike.shape, first / widths[0], xp) * across

    place = {"p": spans[0].at(units[0]), "q": spans[1].at(units[1]), **carrier.place}
    ranges = {"p": spans[0].ends, "q": spans[1].ends}
    return Case(_times(surface, carrier.f), spike.truth, ranges, place=place, unique=spike.shape != "flat")


def _ring(random: Generator, xp: Any) -> tuple[_Spike, float, Callable[[Any], Any], float]:
    """A bell in the angle of incidence, above 1 on 5, 1 or 0.5 degrees: its place, itself, and 2 int bell(c) c dc."""
    spike, theta = _spike(random), _uniform(random, 0.06, 1.5)
    width = np.radians(_one_of(random, 5, 1, 0.5)) / (2 * spike.reach)
    nodes, weights = np.polynomial.legendre.leggauss(40)
    edges = np.unique(np.clip(theta + width * np.array([-1, -0.5, 0, 0.5, 1]), 0, np.pi / 2))
    angles = edges[:-1, None] + np.diff(edges)[:, None] * (nodes + 1) / 2
    inside = np.diff(edges)[:, None] / 2 * weights * _bell(spike.shape, (angles - theta) / width, np) * np.sin(2 * angles)
    return spike, theta, lambda w: _bell(spike.shape, (_angle(w, xp) - theta) / width, xp), float(np.sum(inside))


def _angular(surface: Callable[..., Any], spike: _Spike, bell: Callable, mean: float, reciprocal: bool) -> Callable[..., Brdf]:
    """The family whose albedo at the parameters' best is low + height bell(theta): a ring in both angles, or in theta_i."""

    def family(**parameters: Any) -> Brdf:
        height = spike.height * surface(**parameters) / np.pi
        base = spike.low / np.pi - height * mean if reciprocal else spike.low / np.pi
        return lambda wi, wo: base + height * (bell(wi) + (bell(wo) if reciprocal else 0 * wo[..., 2]))

    return family


@_kind("narrow angle")
def _narrow_angle(random: Generator, xp: Any) -> Case:
    spike, theta, bell, mean = _ring(random, xp)
    reciprocal = random.random() < 0.6
    family = _angular(lambda: 1.0, spike, bell, mean, reciprocal)
    place = {"cos_theta": float(np.cos(theta))}
    return Case(family, spike.truth, place=place, reciprocal=reciprocal, unique=spike.shape != "flat")


@_kind("narrow angle and parameter")
def _narrow_angle_and_parameter(random: Generator, xp: Any) -> Case:
    spike, theta, bell, mean = _ring(random, xp)
    span, unit, reciprocal = _range(random), _uniform(random, 0.05, 0.95), random.random() < 0.6
    width = max(span.share(0.1) / (2 * spike.reach), 0.02)
    surface = lambda p: _bell("smooth", (span.unit(p, xp) - unit) / width, xp)
    family = _angular(surface, spike, bell, mean, reciprocal)
    place = {"p": span.at(unit), "cos_theta": float(np.cos(theta))}
    unique = spike.shape != "flat"
    return Case(family, spike.truth, {"p": span.ends}, place=place, reciprocal=reciprocal, unique=unique)


@_kind("ridge")
def _ridge(random: Generator, xp: Any) -> Case:
    """A diagonal of two parameters, sloping gently up to an end or to a place inside."""
    truth, carrier, width = _target(random), _carrier(random, xp), _uniform(random, 0.02, 0.2)
    up, slope, end = _one_of(random, -1, 1), _log_uniform(random, 1e-4, 0.3), random.random() < 0.5
    p0 = _one_of(random, 0.0, 1.0) if end else _uniform(random, 0.1, 0.9)
    q0 = _uniform(random, 0.1, 0.9)

    def surface(p: Any, q: Any) -> Any:
        along = xp.abs(p - p0) if end else (p - p0) ** 2
        return truth * (0.5 + 0.5 * xp.exp(-(((q - q0 - up * (p - p0)) / width) ** 2)) * (1 - slope * along))

    place = {"p": p0, "q": q0, **carrier.place}
    return Case(_times(surface, carrier.f), truth, {"p": (0.0, 1.0), "q": (0.0, 1.0)}, place=place)


@_kind("curved ridge")
def _curved_ridge(random: Generator, xp: Any) -> Case:
    """Along p q = constant."""
    truth, carrier, width = _target(random), _carrier(random, xp), _uniform(random, 0.02, 0.1)
    slope, p0, q0 = _log_uniform(random, 1e-4, 0.1), _log_uniform(random, 0.2, 5), _log_uniform(random, 0.2, 5)
    p0 = _one_of(random, p0, 0.1)

    def surface(p: Any, q: Any) -> Any:
        across, along = xp.log(p * q / (p0 * q0)) / width, xp.log(p / p0)
        return truth * (0.5 + 0.5 * xp.exp(-(across**2)) / (1 + slope * along**2))

    place = {"p": p0, "q": q0, **carrier.place}
    return Case(_times(surface, carrier.f), truth, {"p": (0.1, 10.0), "q": (0.1, 10.0)}, place=place)


@_kind("many parameters", idle=0)
def _many_parameters(random: Generator, xp: Any) -> Case:
    """4 to 8, of which one or two matter; or a sum over all, largest in a corner or, correlated, inside."""
    truth, carrier, count = _target(random), _carrier(random, xp), int(random.integers(4, 9))
    names = [f"p{index}" for index in range(count)]
    ranges, which = dict.fromkeys(names, (0.0, 1.0)), _one_of(random, "few", "corner", "inside")
    chosen = [str(name) for name in random.permutation(names)[: int(random.integers(1, 3))]] if which == "few" else names
    if which == "corner":
        best = {name: float(random.integers(2)) for name in chosen}
    else:
        best = {name: _uniform(random, 0.05, 0.95) for name in chosen}
    loss, sharp = random.dirichlet(np.ones(count)), _log_uniform(random, 1, 10)
    mixing = random.normal(size=(len(chosen), len(chosen)))

    def surface(**p: Any) -> Any:
        away = [p[name] - best[name] for name in chosen]
        if which == "corner":
            return truth * (1 - sum(0.8 * float(c) * xp.abs(x) for c, x in zip(loss, away, strict=True)))
        if which == "few":
            return truth * (0.5 + 0.5 * xp.exp(-sum((sharp * x) ** 2 for x in away)))
        return truth / (1 + sum(sum(float(m) * x for m, x in zip(row, away, strict=True)) ** 2 for row in mixing))

    return Case(_times(surface, carrier.f), truth, ranges, place={**best, **carrier.place})


@_kind("thin film")
def _thin_film(random: Generator, xp: Any) -> Case:
    """Interference orders under an envelope that makes one of 5 to 40 crests the highest."""
    truth, carrier, count, phase = _target(random), _carrier(random, xp), _uniform(random, 5, 40), _uniform(random, 0, 6)
    top, fall, swing = _uniform(random, 0.1, 0.9), _uniform(random, 0.05, 0.5), _log_uniform(random, 0.01, 0.4)

    def crests(p: Any, xp: Any) -> Any:
        return 1 + swing * (1 - fall * (p - top) ** 2) * xp.cos(2 * np.pi * count * p + phase)

    p, peak = _highest(lambda p: crests(p, np), _Range(0.0, 1.0, False))
    surface = lambda p: truth / peak * crests(p, xp)
    return Case(_times(surface, carrier.f), truth, {"p": (0.0, 1.0)}, place={"p": p, **carrier.place})


@_kind("kink")
def _kink(random: Generator, xp: Any) -> Case:
    """A lopsided tent, the lesser of two slopes, the larger of two bumps."""
    truth, carrier, span = _target(random), _carrier(random, xp), _range(random)
    unit, shape = _uniform(random, 0.05, 0.95), _one_of(random, "tent", "lesser", "larger")
    left, right = _log_uniform(random, 0.3, 50), _log_uniform(random, 0.3, 50)
    other, less, width = _uniform(random, 0.05, 0.95), _log_uniform(random, 1e-6, 1e-2), _uniform(random, 0.02, 0.3)

    def surface(p: Any) -> Any:
        t = span.unit(p, xp) - unit
        if shape == "tent":
            return truth * (0.3 + 0.7 * xp.maximum(1 - xp.where(t < 0, -left * t, right * t), 0.0))
        if shape == "lesser":
            return truth * xp.minimum(xp.exp(left * t), xp.exp(-right * t))
        second = (1 - less) * xp.exp(-(((t + unit - other) / width) ** 2))
        return truth * xp.maximum(xp.exp(-((t / width) ** 2)), second)

    place = {"p": span.at(unit), **carrier.place}
    return Case(_times(surface, carrier.f), truth, {"p": span.ends}, place=place)


@_kind("pole")
def _pole(random: Generator, xp: Any) -> Case:
    """Without bound at one value of a parameter; above 1 nearby only."""
    carrier, span, unit = _carrier(random, xp), _range(random), _uniform(random, 0.05, 0.95)
    power, reach = _one_of(random, 0.5, 1.0, 2.0), _log_uniform(random, 1e-3, 0.03)
    surface = lambda p: (reach / xp.abs(span.unit(p, xp) - unit)) ** power
    place = {"p": span.at(unit), **carrier.place}
    return Case(_times(surface, carrier.f), np.inf, {"p": span.ends}, accuracy=0.0, place=place)


@_kind("near pole")
def _near_pole(random: Generator, xp: Any) -> Case:
    """Like a pole as far as 1e-3 of the range, then finite."""
    truth = _one_of(random, _target(random, close=0.0), _log_uniform(random, 2, 100))
    carrier, span, unit, rounded = _carrier(random, xp), _range(random), _uniform(random, 0.05, 0.95), random.random() < 0.5

    def surface(p: Any) -> Any:
        away = xp.abs(span.unit(p, xp) - unit) / 1e-3
        return truth / (1 + away**2 if rounded else 1 + away)

    place = {"p": span.at(unit), **carrier.place}
    return Case(_times(surface, carrier.f), truth, {"p": span.ends}, accuracy=1e-11 * truth, place=place)


@_kind("plateau")
def _plateau(random: Generator, xp: Any) -> Case:
    """The same albedo at all angles at one end of the range, a slightly higher one elsewhere."""
    truth, p0 = _target(random), _uniform(random, 0.02, 0.3)
    if random.random() < 0.3:  # Oren and Nayar in one square root: 1 - A + B t, largest in the limit of grazing light
        faded = lambda s: 1 - 0.5 * s / (s + 0.33) + 0.225 * s / (s + 0.09)
        s, peak = _highest(faded, _Range(0.0, 1.0, False))
        tint = truth / peak

        def rough(roughness: Any) -> Brdf:
            def f(wi: Any, wo: Any) -> Any:
                i, o, s2 = wi[..., 2], wo[..., 2], (roughness * np.pi) ** 2
                s = _dot(wi, wo, xp) - i * o
                t = xp.where(s > 0, s / xp.maximum(i, o), 0.0)
                return tint / np.pi * (1 - 0.5 * s2 / (s2 + 0.33) + 0.45 * s2 / (s2 + 0.09) * t)

            return f

        place = {"roughness": float(np.sqrt(s) / np.pi), "cos_theta": 0.0}
        return Case(rough, truth, {"roughness": (0.0, 1.0)}, place=place)
    flat = min(truth, 1.0) - _log_uniform(random, 1e-4, 0.05)
    power, grazing = _one_of(random, 1.0, 2.0), random.random() < 0.5
    middle = _uniform(random, 0.5, 1) if grazing else 0.2
    best = middle if grazing else 2 / (2 + power) - middle
    rise = (truth / flat - 1) / best

    def family(p: Any) -> Brdf:
        lift = rise * p / p0 * xp.exp(1 - p / p0)
        sign = -1 if grazing else 1
        return lambda wi, wo: flat / np.pi * (1 + lift * sign * ((wi[..., 2] * wo[..., 2]) ** power - middle))

    curve = lambda mu: flat * (1 + rise * (-1 if grazing else 1) * (2 / (2 + power) * mu**power - middle))
    place = {"p": p0, "cos_theta": 0.0 if grazing else 1.0}
    return Case(family, truth, {"p": (0.0, 1.0)}, place=place, curve=curve)


# --- towards grazing light ---


def _metal(tint: float, ax: float, ay: float, xp: Any) -> Brdf:
    """GGX facets with height-correlated masking: the albedo tends to `tint` towards grazing from below, since the facets
    that wi sees fill its whole projected area, and the second masking tends to 1 beside the first."""

    def sigma(w: Any) -> Any:
        return xp.sqrt((ax * w[..., 0]) ** 2 + (ay * w[..., 1]) ** 2 + w[..., 2] ** 2)

    def f(wi: Any, wo: Any) -> Any:
        h = _half(wi, wo, xp)
        d = 1 / (np.pi * ax * ay * ((h[..., 0] / ax) ** 2 + (h[..., 1] / ay) ** 2 + h[..., 2] ** 2) ** 2)
        return tint * 0.5 * d / (wi[..., 2] * sigma(wo) + wo[..., 2] * sigma(wi))

    return f


@_kind("grazing limit")
def _grazing_limit(random: Generator, xp: Any) -> Case:
    truth, which = _target(random), _one_of(random, "power", "lunar", "metal", "fresnel", "logarithm")
    if which == "logarithm":  # so slow that the limit is known to a few thousandths
        truth = _one_of(random, _uniform(random, 0.5, 0.95), _uniform(random, 1.05, 1.5))
        offset, power = _uniform(random, 0.5, 3), _one_of(random, 1, 2)
        share = _uniform(random, 0.2, 0.9) * offset**power
        # 2 c dc = -e^-2x d(2x) with c = e^-x: Laguerre's rule in 2x.
        x, weight = np.polynomial.laguerre.laggauss(60)
        mean = float(np.sum(weight * (1 - share / (offset + x / 2) ** power)))
        g = lambda c: 1 - share / (offset - xp.log(c)) ** power
        f = lambda wi, wo: truth / (np.pi * mean) * g(wi[..., 2]) * g(wo[..., 2])
        return Case(lambda: f, truth, place={"cos_theta": 0.0}, curve=lambda mu: truth * g(mu))
    if which == "metal":
        alpha = _uniform(random, 0.1, 0.6)
        metal = _metal(truth, alpha, alpha, xp)
        return Case(lambda: metal, truth, place={"cos_theta": 0.0})
    if which == "power":
        power = _one_of(random, 0.1, 0.25, 0.5, _uniform(random, 0.1, 1))
        f = lambda wi, wo: truth / np.pi * (1 - (wi[..., 2] * wo[..., 2]) ** power)
        curve = lambda mu: truth * (1 - 2 / (2 + power) * mu**power)
    elif which == "lunar":  # Lommel and Seeliger
        f = lambda wi, wo: truth / (2 * np.pi) / (wi[..., 2] + wo[..., 2])
        curve = lambda mu: truth * (1 - mu * np.log((1 + mu) / mu))
    else:
        low = truth * _uniform(random, 0.02, 0.9)
        f = lambda wi, wo: (low + (truth - low) * (1 - wi[..., 2]) ** 5) / np.pi + 0 * wo[..., 2]
        curve = lambda mu: low + (truth - low) * (1 - mu) ** 5
    return Case(lambda: f, truth, place={"cos_theta": 0.0}, reciprocal=which != "fresnel", curve=curve)


@_kind("near grazing")
def _near_grazing(random: Generator, xp: Any) -> Case:
    """Largest at a cosine of 1e-4 to 0.1: a + height (s(ci) + s(co)), s(c) = 4 c m/(c + m)^2."""
    truth, m = _target(random), _log_uniform(random, 1e-4, 0.1)
    height, reciprocal = truth * _uniform(random, 0.05, 0.4), random.random() < 0.6
    mean = 8 * m * (1 - 2 * m * np.log1p(1 / m) + m / (1 + m)) if reciprocal else 0.0
    base = truth - height * (1 + mean)

    def f(wi: Any, wo: Any) -> Any:
        i, o = wi[..., 2], wo[..., 2]
        both = 4 * m * i / (i + m) ** 2 + (4 * m * o / (o + m) ** 2 if reciprocal else 0 * o)
        return (base + height * both) / np.pi

    curve = lambda mu: base + height * (4 * m * mu / (mu + m) ** 2 + mean)
    return Case(lambda: f, truth, place={"cos_theta": m}, reciprocal=reciprocal, curve=curve)


@_kind("divergence")
def _divergence(random: Generator, xp: Any) -> Case:
    """Without bound towards grazing; 1 is passed at a cosine between 1e-6 and 0.01."""
    crossing = _log_uniform(random, 1e-6, 1e-2)
    which = _one_of(random, "cosine", "both cosines", "power", "square", "logarithm", "ward")
    power = _one_of(random, 0.5, 0.359, _uniform(random, 0.3, 0.9))
    grown = {
        "cosine": lambda mu: 1 / mu,
        "both cosines": lambda mu: 2 / mu,
        "power": lambda mu: 2 / (2 - power) * mu**-power,
        "square": lambda mu: mu**-2,
        "logarithm": lambda mu: 0.5 - np.log(mu),
    }
    ax, ay = _uniform(random, 0.1, 0.5), _uniform(random, 0.1, 0.5)
    if which == "ward":
        ay = _one_of(random, ax, ay)

        def ward(wi: Any, wo: Any) -> Any:
            h = wi + wo
            slope = ((h[..., 0] / ax) ** 2 + (h[..., 1] / ay) ** 2) / h[..., 2] ** 2
            return 0.3 * xp.exp(-slope) / (4 * np.pi * ax * ay * xp.sqrt(wi[..., 2] * wo[..., 2]))

        return Case(lambda: ward, np.inf, accuracy=0.0, place={"cos_theta": 0.0}, anisotropic=ax != ay)
    scale = float(1 / (np.pi * grown[which](crossing)))

    def f(wi: Any, wo: Any) -> Any:
        i, o = wi[..., 2], wo[..., 2]
        if which == "logarithm":
            return -scale * xp.log(i * o)
        return scale / {"cosine": i, "both cosines": i * o, "power": (i * o) ** power, "square": i * i}[which] + 0 * o

    reciprocal, curve = which not in ("cosine", "square"), lambda mu: np.pi * scale * grown[which](mu)
    return Case(lambda: f, np.inf, accuracy=0.0, place={"cos_theta": 0.0}, reciprocal=reciprocal, curve=curve)


@_kind("saturation")
def _saturation(random: Generator, xp: Any) -> Case:
    """Like a divergence as far as a cosine of 1e-3 to 1e-6, then finite: base + rise/((ci + e)(co + e))."""
    truth, e = _one_of(random, _target(random), _log_uniform(random, 10, 1e5)), _log_uniform(random, 1e-6, 1e-3)
    base = min(truth, 1.0) * _uniform(random, 0.0, 0.8)
    rise = (truth - base) * e / (2 * (1 - e * np.log1p(1 / e)))
    f = lambda wi, wo: (base + rise / ((wi[..., 2] + e) * (wo[..., 2] + e))) / np.pi
    curve = lambda mu: base + (truth - base) * e / (mu + e)
    return Case(lambda: f, truth, accuracy=1e-11 * max(truth, 1), place={"cos_theta": 0.0}, curve=curve)


# --- other ways to write a BRDF ---


@_kind("brushed")
def _brushed(random: Generator, xp: Any) -> Case:
    """Anisotropic: facets longer than wide; or base + h (u.wi)^2 (u.wo)^2 with a direction u of the surface."""
    truth, azimuth = _target(random), _uniform(random, 0, 2 * np.pi)
    if random.random() < 0.5:
        ax = _uniform(random, 0.1, 0.6)
        metal = _metal(truth, ax, ax * _uniform(random, 1.5, 3), xp)
        return Case(lambda: metal, truth, place={"cos_theta": 0.0}, anisotropic=True)
    base, u = truth * _uniform(random, 0.2, 0.95), _direction(np.pi / 2, azimuth)

    def f(wi: Any, wo: Any) -> Any:  # the integral of (u.wo)^2 (N.wo) is pi/4
        along = (u[0] * wi[..., 0] + u[1] * wi[..., 1]) * (u[0] * wo[..., 0] + u[1] * wo[..., 1])
        return (base + 4 * (truth - base) * along**2) / np.pi

    curve = lambda mu: base + (truth - base) * (1 - mu**2)
    place = {"cos_theta": 0.0, "azimuth": azimuth}
    return Case(lambda: f, truth, place=place, unique=False, anisotropic=True, curve=curve)


@_kind("single precision")
def _single_precision(random: Generator, xp: Any) -> Case:
    truth, n, p0 = _target(random, close=0.1), _uniform(random, 1, 30), _uniform(random, 0.1, 0.9)
    form, width = _one_of(random, _phong, _retro, _lambert), _uniform(random, 0.1, 1)

    def family(p: Any) -> Brdf:
        away = (xp.asarray(p, xp.float32) - p0) / width

        def f(wi: Any, wo: Any) -> Any:
            value = form(wi.astype(xp.float32), wo.astype(xp.float32), n, xp)
            return (truth / (1 + away * away) * value).astype(xp.float32)

        return f

    place = {"p": p0} if form is _lambert else {"p": p0, "cos_theta": 1.0}
    return Case(family, truth, {"p": (0.0, 1.0)}, accuracy=2e-5, place=place, single=True)


@_kind("RGB")
def _rgb(random: Generator, xp: Any) -> Case:
    """Three channels of different lobes, one of them the brightest."""
    truth, span = _target(random), _range(random)
    channels = [_carrier(random, xp) for _ in range(3)]
    tints, best = [truth * _uniform(random, 0.3, 0.999) for _ in range(3)], int(random.integers(3))
    tints[best], unit = truth, _uniform(random, 0.05, 0.95)

    def family(p: Any) -> Brdf:
        brightness = xp.exp(-((span.unit(p, xp) - unit) ** 2))
        return lambda wi, wo: xp.stack(
            [brightness * tint * f(wi, wo) for tint, (f, _) in zip(tints, channels, strict=True)], axis=-1
        )

    place = {"p": span.at(unit), **channels[best].place}
    return Case(family, truth, {"p": span.ends}, place=place)
