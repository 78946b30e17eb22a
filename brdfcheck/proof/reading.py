"""From a family of BRDFs to what can be proved of it: which formula it is, and its constants as exact numbers.

Nothing is sampled. The family is built from a symbol in place of its parameter, so that it is seen whether the parameter goes
into the lobe as it is and whether all else is constant. Constants are the decimals that they are written as (7.2427 is
72427/10000); one that is the nearest floating-point number to a whole multiple of pi, up to 64 pi, is that multiple.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from brdfcheck.brdf.base import AbstractBRDF
from brdfcheck.brdf.factors import (
    BlinnPhongExact,
    Constant,
    Factor,
    KuijkBlakeExact,
    Normalized,
    PhongExact,
    Proportional,
    SchlickExact,
    TruncatedPowerExact,
)
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, KuijkBlake, Lambert, Lyon, Phong, Schlick
from brdfcheck.messages import UsageError, one_line
from brdfcheck.proof.cover import LinearFactor
from brdfcheck.proof.lobes import Constant as ConstantProfile
from brdfcheck.proof.lobes import Power, Profile, Quadratics, Rational, TruncatedPower
from brdfcheck.runtime import double_precision

_MOST_PI = 64
# What JAX makes of a number that goes somewhere as it is.
_UNCHANGED = frozenset(("convert_element_type", "copy", "copy_p", "device_put"))
_KNOWN = (
    "Lambert, Phong, BlinnPhong, Schlick, KuijkBlake, Lyon and BinomialPower with a factor (n+A)/B, a constant or an exact one,"
    " and CookTorrance and GGX"
)


class Unknown(UsageError):
    """A BRDF is no formula that the theorems know; it may be a function that boxes can be put around."""


def built(family: Family) -> Any:
    """What the family makes, with symbols in its core in place of its parameters.

    UsageError where its factory needs numbers, where what it makes is no BRDF of this package, where a parameter does not go
    into the core as it is, or where anything else depends on it.
    """
    names = tuple(family.ranges)

    def fields(brdf: Any) -> list[Any]:
        if not isinstance(brdf, AbstractBRDF) or not isinstance(brdf.core, AbstractBRDF):
            raise Unknown(f"certify has no exact proof for {family.name}; it has proofs for {_KNOWN}")
        return [getattr(brdf.core, name, 0.0) for name in names]

    try:
        brdf, jaxpr = from_symbols(family, fields)
    except UsageError:
        raise
    except (Exception, SystemExit) as error:
        raise Unknown(f"{family.name} cannot be built from a symbol: {one_line(error).partition('. ')[0]}") from None
    if not names:
        return brdf
    makers = {variable: equation for equation in jaxpr.eqns for variable in equation.outvars}
    for name, variable, source in zip(names, jaxpr.outvars, jaxpr.invars, strict=True):
        while variable is not source:
            maker = makers.get(variable) if not hasattr(variable, "val") else None
            floating = maker is not None and np.issubdtype(variable.aval.dtype, np.floating)
            if maker is None or not floating or maker.primitive.name not in _UNCHANGED:
                raise Unknown(f"{family.name}: {name} does not go into {type(brdf.core).__name__} as it is")
            variable = maker.invars[0]
    constant = [leaf for leaf in jax.tree.leaves(brdf) if not isinstance(leaf, Tracer)]
    if len(constant) + len(names) != len(jax.tree.leaves(brdf)):
        raise Unknown(f"{family.name}: something beside {', '.join(names)} depends on {', '.join(names)}")
    return brdf


def from_symbols(family: Family, fields: Callable[[Any], list[Any]]) -> tuple[Any, Any]:
    """What a family makes with symbols in place of its parameters, and the jaxpr of its `fields` (None without parameters).

    What does not depend on a parameter is a number there. Raises what the family's factory and `fields` raise.
    """
    names = tuple(family.ranges)
    most = float(np.finfo(np.float32).max)
    values = tuple(np.float32(1 if low <= 1 <= high else min(max(low, -most), most)) for low, high in family.ranges.values())
    made: list[Any] = []

    def build(*numbers: Any) -> list[Any]:
        made.append(family.build(**dict(zip(names, numbers, strict=True))))
        return fields(made[-1])

    with double_precision():  # constants keep their digits
        if not names:
            build()
            return made[-1], None
        jaxpr = jax.make_jaxpr(build)(*values).jaxpr
        jax.jvp(build, values, tuple(map(np.ones_like, values)))  # symbols, but constants are numbers
    return made[-1], jaxpr


def exact(value: Any, name: str) -> Fraction:
    """A number as the decimals that it is written as. UsageError where it is not one finite number."""
    array = np.asarray(value)
    if array.ndim or not np.isfinite(array):
        raise UsageError(f"{name} must be one finite number; got {one_line(array)}")
    return Fraction(str(array[()]))


def multiple_of_pi(value: Any, name: str) -> tuple[Fraction, int]:
    """(divisor, power of pi) of a number: a whole multiple of pi, or a rational number."""
    array = np.asarray(value)
    for whole in range(1, _MOST_PI + 1):
        if array.ndim == 0 and array == array.dtype.type(whole * np.pi):
            return Fraction(whole), 1
    return exact(value, name), 0


def lobe_of(brdf: Any, name: str) -> tuple[Profile, LinearFactor | None]:
    """A lobe of this package and its factor, as the proofs know them (see `factor_of`). UsageError for anything else."""
    core, factor = (brdf.lobe, brdf.factor) if type(brdf) is Normalized else (brdf, None)
    if type(core) is Lambert:
        return ConstantProfile("half"), LinearFactor(Fraction(0), power=1)
    profile = _profile(core)
    if profile is None:
        raise Unknown(f"{name}: {type(core).__name__} is no lobe that certify knows; it knows {_KNOWN}")
    return profile, factor_of(factor, profile, name)


def _profile(core: Any) -> Profile | None:
    # The very classes: of a class derived from one of them the formula is not known.
    if type(core) in (Phong, BlinnPhong):
        return Power(core.form)
    if type(core) is Schlick:
        return Rational(core.form)
    if type(core) is KuijkBlake:
        return Quadratics(core.form)
    if type(core) is Lyon:
        return TruncatedPower(core.form, 2**core.w)
    if type(core) is BinomialPower:
        return TruncatedPower(core.form, core.k, core.clamped)
    return None


def factor_of(factor: Any, profile: Profile | None, name: str) -> LinearFactor | None:
    """A factor as the proofs know it; None for the reciprocal of the albedo of `profile`. UsageError for anything else."""
    if factor is None:
        return LinearFactor(Fraction(1), constant=True)
    if type(factor) is PhongExact:
        return LinearFactor(Fraction(2), Fraction(2), 1)
    if type(factor) in (Factor, Proportional):
        divisor, power = multiple_of_pi(factor.B, "B")
        if divisor <= 0:
            raise Unknown(f"{name}: B must be > 0 for a proof; got {one_line(np.asarray(factor.B))}")
        return LinearFactor(exact(factor.A, "A") if type(factor) is Factor else Fraction(0), divisor, power)
    if type(factor) is Constant:
        return LinearFactor(exact(factor.value, "the constant"), constant=True)
    reciprocal = {
        BlinnPhongExact: lambda: profile == Power("half"),
        KuijkBlakeExact: lambda: profile == Quadratics(factor.form),
        SchlickExact: lambda: profile == Rational(factor.form),
        TruncatedPowerExact: lambda: profile == TruncatedPower(factor.form, factor.k, factor.clamped),
    }.get(type(factor))
    if reciprocal is None or not reciprocal():
        raise Unknown(f"{name}: {type(factor).__name__} is no factor that certify knows for this lobe; it knows {_KNOWN}")
    return None
