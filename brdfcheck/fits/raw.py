"""The albedo of a lobe without its factor, as a function of its exponent, and the lobe with another factor on it."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from brdfcheck.brdf.base import AbstractBRDF, AbstractZonalLobe
from brdfcheck.brdf.calling import directional, name_of
from brdfcheck.brdf.factors import AbstractFactor, Constant, Normalized, PerCosine
from brdfcheck.brdf.family import Family, interval
from brdfcheck.brdf.readers.base import Reading
from brdfcheck.brdf.signatures import signature_of
from brdfcheck.brdf.subject import Target, as_family, named, resolve
from brdfcheck.brdf.two_sides import BELOW
from brdfcheck.fits.minimax import extrema, spread
from brdfcheck.messages import UsageError
from brdfcheck.quadrature.pointwise import PointwiseAlbedo

# A range that is narrower than this part of its end is one exponent: what a slope would win is below the error bars.
_NARROW = 1e-9
# Minima that are equal up to this part are one value, reached more than once.
_TIE = 1e-12
ONE = (1.0, 1.0)
"""The exponents of a BRDF without any, as a table is: its factor is one constant, n/B at n = 1."""


class RawAlbedo:
    """The albedo of a family of one exponent n without its factor, as a function of n, and the family with a factor on it.

    `constant`: there is no exponent; `own`: n is the exponent of the lobe itself. ValueError where other parameters run over
    ranges, and for what transmits.
    """

    def __init__(self, target: Any, n: tuple[float, float]):
        n = interval("n", n)
        if n[0] < 0:
            raise ValueError(f"the range of n must be >= 0; got {n[0]:g}:{n[1]:g}")
        family, self.constant = _one_exponent(target, n)
        self.low, self.high = family.ranges["n"]
        self.name = family.name
        self.family = dataclasses.replace(family, build=lambda n: _with_factor(family.build(n=n), None, n))
        self._albedo, self.own = PointwiseAlbedo(self.family), _is_exponent(self.family)

    @property
    def lobe(self) -> Any:
        """The family's member at the lower end of the range, without its factor."""
        return self.family.build(n=self.low)

    @property
    def single(self) -> bool:
        """True where the range is one exponent in all but name: within it no factor varies."""
        return self.high - self.low <= _NARROW * self.high

    @property
    def fast(self) -> bool:
        """True where an albedo costs microseconds."""
        return self._albedo.fast

    def grid(self) -> np.ndarray:
        """Exponents to begin with, the ends of the range among them."""
        return spread(self.low, self.high, (257, 65, 33, 33)[self._albedo.effort])

    def __call__(self, n: np.ndarray) -> np.ndarray:
        """The raw albedo at normal incidence (or the cosine nearest to it that the family allows), shape (points,)."""
        return self.at(n, np.full(len(n), self.family.cos_theta[1]))

    def at(self, n: np.ndarray, cos_theta: np.ndarray) -> np.ndarray:
        """The raw albedo at pairs of exponent and cosine of incidence, shape (points,)."""
        return self._albedo(n[:, None], cos_theta, np.zeros(len(n)))[0]

    def with_factor(self, factor: AbstractFactor) -> Family:
        """The family with this factor instead of none."""
        raw, own = self.family, self.own
        return dataclasses.replace(raw, build=lambda n: _with_factor(raw.build(n=n), factor, n, own))

    def lowest(self, factor: AbstractFactor) -> tuple[float, float]:
        """The smallest albedo at normal incidence with `factor`, and its exponent: a continuous minimum.

        Where it is reached more than once, as minimax factors reach it, the exponent is the smallest.
        """
        places, values = self.extrema(factor, 6 if self.fast else 2)
        smallest = float(np.min(values))
        return smallest, float(np.min(places[values <= smallest * (1 + _TIE)]))

    def extrema(self, factor: AbstractFactor, rounds: int) -> tuple[np.ndarray, np.ndarray]:
        """The extrema of the albedo at normal incidence with `factor`, as `minimax.extrema` finds them: (n, value)."""
        grid = self.grid()

        def curve(n: np.ndarray) -> np.ndarray:
            return np.asarray(factor(jnp.asarray(n))) * self(n)

        return extrema(curve, grid, curve(grid), rounds)


def of_exponent(
    name: str, n: tuple[float, float], held: Mapping[str, tuple[float, float]] | None = None, reading: Reading | None = None
) -> Target:
    """A name as a target over exponents n, where it has any, other parameters held. UsageError where it refuses its values."""
    modules: dict[str, Any] = {}
    own = signature_of(named(name, modules, reading)[0])
    if "n" in own.integers and n[0] < n[1]:
        raise UsageError(f"{name}: n is a whole number, and a factor is for a range of exponents; give one, as in --n 3")
    exponent = {"n": n} if own.open or "n" in own.names else {}
    (target,) = resolve([name], {**exponent, **(held or {})}, None, reading, modules)
    if target.finding is not None:
        raise UsageError(target.finding)
    return target


def _one_exponent(target: Any, n: tuple[float, float]) -> tuple[Family, bool]:
    """The family of the exponent alone; whether there is none."""
    if isinstance(target, str):
        target = of_exponent(target, n).family
    name = getattr(target, "name", None) or name_of(target)
    known = target if isinstance(target, Family) else None
    if known is not None and (known.surface is not None or BELOW in {*known.ranges, *known.held}):
        raise UsageError(f"{name} transmits, and a factor is for what reflects: it would dim what is let through, too")
    constant = known is not None and "n" not in known.ranges
    family = known if known is not None and constant else as_family(target, {"n": n}, None)
    running = [key for key, (low, high) in family.ranges.items() if key != "n" and low != high]
    if running and constant:
        has = f"it has {', '.join(family.ranges)}: where they are held its factor is one constant"
        raise UsageError(f"{name} has no exponent n to normalise over; {has}")
    if running:
        low, high = family.ranges[running[0]]
        raise ValueError(f"{name}: a factor is a function of n alone; hold {running[0]} at one value, not {low:g}:{high:g}")
    values = {key: low for key, (low, _) in family.ranges.items() if key != "n"}
    only = dataclasses.replace(family, held={**family.held, **values}, switches=frozenset(), pointwise=None)
    if not constant:
        return dataclasses.replace(only, build=lambda n: family.build(n=n, **values), ranges={"n": n}), False
    whole = family.pointwise
    pointwise = None if whole is None else lambda n: whole(**values)
    return dataclasses.replace(only, build=lambda n: family.build(**values), pointwise=pointwise, ranges={"n": ONE}), True


def _is_exponent(family: Family) -> bool:
    """True where the n of the family is the exponent of its lobe: not where the lobe is held at one, or squares it."""
    try:
        program = jax.make_jaxpr(lambda n: family.build(n=n).core.n)(jnp.asarray(1.0, float)).jaxpr
    except Exception:  # what has no lobe, and what wants numbers, not tracers
        return False
    return program.outvars == program.invars


def _with_factor(brdf: Any, factor: AbstractFactor | None, n: Any, own: bool = False) -> Any:
    """`brdf` with the factor at n in place of its own (None: without any). `own`: n is the exponent of the lobe."""
    if isinstance(brdf, Normalized):
        return _with_factor(brdf.lobe, factor, n, own)
    if isinstance(brdf, PerCosine):
        return PerCosine(_with_factor(brdf.base, factor, n, own))
    if factor is None:
        return brdf
    if isinstance(brdf, AbstractZonalLobe) and hasattr(brdf, "n"):
        return Normalized(brdf, factor if own else Constant(factor(jnp.asarray(n))))
    if isinstance(brdf, AbstractBRDF):
        return _Scaled(brdf, factor, n)
    brdf, scale = directional(brdf), factor(jnp.asarray(n))
    # A function stays what it was: one that JAX can trace, or one of numpy, of many directions or of one pair.
    scale = scale if isinstance(scale, Tracer) else float(scale)

    def scaled(wi: Any, wo: Any) -> Any:
        value = brdf(wi, wo)
        return [scale * part for part in value] if isinstance(value, (list, tuple)) else scale * value

    return scaled


class _Scaled(AbstractBRDF):
    """Any BRDF times a factor: for families whose exponent is hidden in other parameters."""

    base: AbstractBRDF
    factor: AbstractFactor
    n: Any

    def __call__(self, wi: Any, wo: Any) -> Any:
        return self.factor(jnp.asarray(self.n)) * self.base(wi, wo)
