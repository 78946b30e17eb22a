"""Physical surfaces, whose BRDFs conserve energy."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping, Sequence
from typing import Any, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from brdfcheck.brdf import catalog
from brdfcheck.brdf.base import AbstractBRDF, AbstractBSDF
from brdfcheck.brdf.calling import name_of
from brdfcheck.brdf.lobes import Lambert
from brdfcheck.brdf.readers.base import Reading, refuse_reading
from brdfcheck.brdf.signatures import signature_of
from brdfcheck.brdf.transmission import AbstractSmooth, LambertTransmission
from brdfcheck.brdf.two_sides import BELOW
from brdfcheck.brdf.values import components
from brdfcheck.runtime import double_precision
from brdfcheck.scene.functions import Function, FunctionSurface, brdf_of
from brdfcheck.scene.furnace import directional_albedo
from brdfcheck.scene.lights import AbstractLight, AbstractRayLight, Ambient, Environment, Polygon
from brdfcheck.scene.shading import FRESNELS, AbstractMaterial, Meeting, Place, reflected
from brdfcheck.scene.vectors import SMOOTHEST, TINY, checked, color_of, scalar, spread
from brdfcheck.verdict import TOLERANCE, Report, Verdict, check


@final
class Term(eqx.Module):
    """One BRDF of a surface times a colour, or times the Fresnel reflectance whose value at normal incidence is the colour.

    `brdf`: a catalogue name with its parameters, as in ``Term("blinn-phong", 0.3, n=50)``, or whatever else `brdfcheck.check`
    takes: a lobe, ``Term("mine.py:glossy", n=50)``, a function f(wi, wo), whose x axis is level on every surface; or a BSDF,
    which is lit from both sides. `reading`: how a file is read.
    `fresnel`: "none", "exact" or "schlick", at the angle between the light and the half vector; for what only reflects.

    Raises KeyError for an unknown name, ValueError for bad parameters or a BRDF that cannot be called, TypeError for something
    that is no BRDF.
    """

    brdf: AbstractBRDF | AbstractBSDF
    tint: Float[Array, " 3"]
    fresnel: str = eqx.field(static=True)
    name: str = eqx.field(static=True)
    # True where all parameters lie within the range over which the catalogue's family is checked.
    within: bool = eqx.field(static=True)

    def __init__(self, brdf: Any, tint: Any = 1.0, *, fresnel: str = "none", reading: Reading | None = None, **parameters: Any):
        if fresnel not in ("none", *FRESNELS):
            raise ValueError(f"fresnel must be one of none, {', '.join(FRESNELS)}; got {fresnel!r}")
        reflectance = fresnel != "none"
        self.tint = color_of(tint, "the Fresnel reflectance" if reflectance else "tint", 1 if reflectance else np.inf)
        self.fresnel, self.name, self.within = fresnel, "", False
        if isinstance(brdf, str) and brdf in catalog.names() and not _whole(brdf, parameters):
            if reading is not None:
                refuse_reading(reading, {brdf: None})
            self.name, family = brdf, catalog.entry(brdf).family
            known = [name for name in family.ranges if name != BELOW or family.surface is None]
            for parameter in parameters.keys() - set(known):
                raise ValueError(f"{brdf} has no parameter {parameter!r}; its parameters: {', '.join(known)}")
            for parameter in set(known) - parameters.keys() - {"reflectance"}:
                raise ValueError(f"{brdf} needs its parameter {parameter}")
            for parameter, value in parameters.items():
                (checked if parameter == "reflectance" else scalar)(value, f"{brdf}: {parameter}", -np.inf)
            ranges = [family.ranges[name] for name in parameters]
            self.within = all(
                isinstance(value, Tracer) or bool(np.all((low <= np.asarray(value)) & (np.asarray(value) <= high)))
                for value, (low, high) in zip(parameters.values(), ranges, strict=True)
            )
            build = family.build if family.surface is None else family.surface
            brdf = build(**({"reflectance": 1.0} if "reflectance" in family.ranges else {}) | parameters)
        elif not isinstance(brdf, (AbstractBRDF, AbstractBSDF)):
            numbers: dict[str, Any] = {}
            for key, value in parameters.items():
                if np.ndim(value) == 1 and 2 <= len(value) <= 4:
                    numbers |= components(key, [float(scalar(part, key, -np.inf)) for part in value])
                else:
                    numbers[key] = float(scalar(value, key, -np.inf))
            brdf = brdf_of(brdf, numbers, reading)
        elif parameters:
            raise TypeError(f"a lobe has its parameters; got {', '.join(parameters)} beside {type(brdf).__name__}")
        what = self.name or name_of(brdf)
        if reflectance and isinstance(brdf, AbstractBSDF):
            raise ValueError(f"{what} transmits: a Fresnel reflectance is for what only reflects")
        self.brdf = jax.tree.map(lambda leaf: checked(leaf, f"a parameter of {what}", -np.inf), brdf)
        for slope in ("m", "alpha"):
            if hasattr(core := self.brdf.core, slope):
                checked(getattr(core, slope), f"{what}: {slope}", SMOOTHEST)

    @property
    def transmits(self) -> bool:
        """True for a BSDF."""
        return isinstance(self.brdf, AbstractBSDF)

    @property
    def matt(self) -> bool:
        """True for a perfectly diffuse term, which sends on light from anywhere by the same share."""
        return isinstance(self.brdf.core, (Lambert, LambertTransmission)) and self.fresnel == "none"

    def shares(self) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
        """What a matt term reflects, and what it transmits, of shape (3,) each."""
        core = self.brdf.core
        if isinstance(core, LambertTransmission):
            return self.tint * core.reflectance, self.tint * core.transmittance
        return self.tint * (np.pi * core.amplitude()), jnp.zeros_like(self.tint)

    def albedo(self) -> Float[Array, "..."]:
        """All that a matt term sends on, shape (3,)."""
        return sum(self.shares(), jnp.zeros_like(self.tint))


class NotConserving(ValueError):
    """A BRDF or a sum of BRDFs that `brdfcheck.check` does not call conserving: `reason`, and a `remedy` where there is one."""

    def __init__(self, reason: str, remedy: str = ""):
        self.reason, self.remedy = reason, remedy
        super().__init__(f"{self.advice()}{', or' if remedy else ';'} allow_unvalidated=True renders it all the same")

    def advice(self) -> str:
        """Why, and what to do about it, for those who take no BRDF that does not conserve."""
        return f"{self.reason}; {self.remedy}" if self.remedy else self.reason


@final
class Surface(AbstractMaterial):
    """A sum of BRDFs: reflected radiance in the lights' unit, all terms and all lights added.

    ``Surface(Term("lambert", (0.6, 0.3, 0.1)), Term("blinn-phong", 0.3, n=50))``. Every BRDF must be one that
    `brdfcheck.check` calls conserving, and so must the sum be in every channel, by the same check of the sum over all
    angles where the tints alone do not show it. `allow_unvalidated=True` builds it all the same. Numbers that are traced
    are not checked. One of the terms may be smooth: a boundary or a clear pane, whose light goes on as rays (`glass`).

    In an `Environment` a BSDF sends on R + T: its radiance over the square of the index is taken to be the same on both sides.

    Raises NotConserving, with the reason, for a BRDF or a sum that does not conserve; ValueError for two smooth terms.
    """

    terms: tuple[Term, ...]

    def __init__(self, *terms: Term, allow_unvalidated: bool = False):
        if not terms or not all(isinstance(term, Term) for term in terms):
            raise TypeError(
                f"a surface is a sum of at least one Term; got {', '.join(type(t).__name__ for t in terms) or 'none'}"
            )
        self.terms = terms
        if sum(isinstance(term.brdf, AbstractSmooth) for term in terms) > 1:
            raise ValueError("a surface has at most one smooth term: each has its own direction of refraction")
        if not allow_unvalidated:
            for term in terms:
                _refuse_unvalidated(term)
            _refuse_excess(terms)

    @property
    def glass(self) -> tuple[Array, AbstractSmooth] | None:
        return next(((term.tint, term.brdf) for term in self.terms if isinstance(term.brdf, AbstractSmooth)), None)

    @property
    def matter(self) -> Surface | None:
        rest = [term for term in self.terms if not isinstance(term.brdf, AbstractSmooth)]
        return Surface(*rest, allow_unvalidated=True) if rest else None

    def color(self, lights: Sequence[AbstractLight], place: Place) -> Float[Array, "3 ..."]:
        dimensions = len(place.shape)
        total = jnp.zeros((3,) + (1,) * dimensions, place.normal.x.dtype)
        for number, light in enumerate(lights):
            meeting = Meeting(place, light) if isinstance(light, AbstractRayLight) else None
            for term in self.terms:
                if meeting is not None:
                    value = reflected(term.brdf, meeting) * meeting.falloff
                    if term.fresnel == "none":
                        total = total + spread(light.intensity * term.tint, dimensions) * value
                    else:
                        share = FRESNELS[term.fresnel](meeting.light_half, spread(term.tint, dimensions))
                        total = total + spread(light.intensity, dimensions) * share * value
                elif term.matt:
                    if not isinstance(light, Polygon):
                        total = total + spread(light.intensity * term.albedo().astype(total.dtype), dimensions)
                        continue
                    sides = (place.normal, place.normal * -1)
                    for share, normal in zip(term.shares()[: 1 + term.transmits], sides, strict=False):
                        field = light.irradiance(place.point, normal) / np.pi
                        total = total + spread(light.intensity * share.astype(total.dtype), dimensions) * field
                elif isinstance(light, Environment):
                    value = _surrounded(term, place)
                    tint = term.tint if term.fresnel == "none" else jnp.ones_like(term.tint)
                    total = total + spread(light.intensity * tint, dimensions) * value
                elif not isinstance(light, Ambient) and not (isinstance(light, Polygon) and light.matt_only):
                    raise ValueError(
                        f"lights[{number}]: a {type(light).__name__} light has a closed form on matt terms only; this surface"
                        f" has {type(term.brdf.core).__name__}: a light that is matt_only reaches the matt terms alone"
                    )
        return total


def _whole(name: str, parameters: Mapping[str, Any]) -> bool:
    """True where whole numbers of a lobe are given, such as the k of the binomial power: it is another family then."""
    family = catalog.entry(name).family
    others = parameters.keys() - family.ranges.keys()
    return bool(others) and others <= signature_of(family).whole


def _surrounded(term: Term, place: Place) -> Float[Array, "..."]:
    """What a term sends on of a uniform surrounding of radiance 1, but for a tint that is not in its Fresnel term."""

    def value(brdf: AbstractBRDF) -> Array:
        turn = None if hasattr(brdf.core, "breaks") else place.turn
        seen = place.seen if turn is None else jnp.broadcast_to(place.seen, place.shape)
        return directional_albedo(brdf, seen, term.fresnel, term.tint, turn)

    if not isinstance(term.brdf, AbstractBSDF):
        return value(term.brdf)
    above = value(term.brdf.lit(0.0))
    return above if place.below is None else jnp.where(place.below, value(term.brdf.lit(1.0)), above)


@functools.cache
def _report(name: str) -> Report:
    with double_precision(), jax.ensure_compile_time_eval():  # the program that builds a material may be traced
        return check(name, intervals=False)


@functools.lru_cache(1024)
def _own_report(structure: Any, leaves: tuple[tuple[tuple[int, ...], bytes], ...]) -> Report:
    """Of one BRDF, by its numbers: scenes and the plans of a budget ask for the same one many times."""
    with double_precision():
        numbers = [jnp.asarray(np.frombuffer(content).reshape(shape)) for shape, content in leaves]
        brdf = jax.tree.unflatten(structure, numbers)
        brdf = brdf.function if isinstance(brdf, FunctionSurface) else brdf
        return check(brdf.call if isinstance(brdf, Function) else brdf, intervals=False)


def _concrete(term: Term) -> bool:
    return not any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(term))


def _refuse_unvalidated(term: Term) -> None:
    """The family once and for all, where the parameters are in its range; else this one BRDF."""
    if term.name and term.within:
        report = _report(term.name)
    elif _concrete(term):
        with double_precision():
            leaves, structure = jax.tree.flatten(jax.tree.map(lambda leaf: np.asarray(leaf, np.float64), term.brdf))
        report = _own_report(structure, tuple((leaf.shape, leaf.tobytes()) for leaf in leaves))
    else:
        return
    if not report.passed:
        where = "".join(f" at {name}={value:.4g}" for name, value in report.parameters.items())
        reason = (
            report.findings[0]
            if report.verdict is Verdict.CONSERVES
            else (f"{report.verdict.name}: albedo {report.albedo:.6g} +- {report.error:.1g}{where}, {report.angle:.3g} degrees")
        )
        raise NotConserving(f"{term.name or name_of(term.brdf)} is not validated ({reason})")


def _double(tree: Any) -> Any:
    return jax.tree.map(lambda leaf: jnp.asarray(np.asarray(leaf), jnp.float64), tree)


def _refuse_excess(terms: tuple[Term, ...]) -> None:
    """Each channel's sum: by the tints where they do, else by the check of the sum itself over all angles."""
    if not all(_concrete(term) for term in terms):
        return
    # A Fresnel reflectance is at most 1, an albedo that has passed too.
    most = sum(np.ones(3) if term.fresnel != "none" else _bound(term) for term in terms)
    sides = (0.0, 1.0) if any(term.transmits for term in terms) else (0.0,)
    for channel, below in itertools.product(np.flatnonzero(np.asarray(most) > 1 + TOLERANCE), sides):
        report = _sum_report(terms, int(channel), below)
        if report.verdict is not Verdict.CONSERVES:
            raise NotConserving(
                f"the surface reflects up to {report.albedo:.6g} of the light in channel {'RGB'[channel]}, at"
                f" {report.angle:.3g} degrees: {report.albedo - 1:.3g} more than arrives",
                "take smaller tints",
            )


def _bound(term: Term) -> np.ndarray:
    return np.asarray(term.albedo() if term.matt else term.tint, float)


def _sum_report(terms: tuple[Term, ...], channel: int, below: float) -> Report:
    """The check of a channel's sum; what transmits as the BRDF that has its energy, lit from one side."""
    with double_precision():
        parts = [_double(term) for term in terms]
        lit = [part.brdf.lit(below) if part.transmits else part.brdf for part in parts]

        def total(wi: Array, wo: Array) -> Array:
            value = jnp.zeros(wo.shape[:-1], wo.dtype)
            for part, brdf in zip(parts, lit, strict=True):
                one = brdf(wi, wo)
                one = one[..., channel] if one.ndim > value.ndim else one
                if part.fresnel == "none":
                    one = one * part.tint[channel]
                else:
                    cosine = jnp.sqrt(jnp.maximum((1 + jnp.sum(wi * wo, axis=-1)) / 2, TINY))
                    one = one * FRESNELS[part.fresnel](cosine, part.tint[channel])
                value = value + one
            return value

        return check(total, intervals=False)
