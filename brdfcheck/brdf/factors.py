"""Normalisation factors, and the lobe that a factor makes into a BRDF.

A lobe has peak value 1; its factor is what it is multiplied by, as a function of its exponent. `Factor(A, B)` is the
two-constant form (n+A)/B of the literature; the closed forms make the albedo at normal incidence exactly 1.
"""

from __future__ import annotations

import abc
from collections.abc import Callable
from typing import Any, TypeGuard, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from brdfcheck.brdf.base import (
    AbstractBRDF,
    AbstractHalves,
    AbstractMicrofacetLobe,
    AbstractZonalLobe,
    as_parameter,
    checked_number,
    core_of,
)
from brdfcheck.messages import UsageError

_TINY = 1e-18


class AbstractFactor(eqx.Module):
    """What a lobe is multiplied by, in 1/sr, as a function of its exponent."""

    @abc.abstractmethod
    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        """The factor at the exponents `n`, same shape."""


@final
class Factor(AbstractFactor):
    r"""The two-constant factor $(n + A) / B$. ValueError unless A and B are finite and it is positive for some n >= 0.

    So B > 0; or B < 0 and A < 0, a factor that falls with n and is of use for n < -A.
    """

    A: Float[Array, ""]
    B: Float[Array, ""]

    def __init__(self, A: object, B: object):
        self.A, self.B = as_parameter(A, "A"), as_parameter(B, "B")
        if isinstance(self.A, Tracer) or isinstance(self.B, Tracer):
            return
        if not np.all(np.isfinite(np.asarray(self.A))):
            raise ValueError(f"A must be finite; got {A}")
        a, b = np.asarray(self.A), np.asarray(self.B)
        if not np.all(np.isfinite(b) & ((b > 0) | ((b < 0) & (a < 0)))):
            raise ValueError(f"B must be finite and {'not 0' if np.all(a < 0) else '> 0'}; got {B}")

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        return (n + self.A) / self.B


@final
class Constant(AbstractFactor):
    """The same factor for every exponent, in 1/sr. ValueError unless it is finite and > 0."""

    value: Float[Array, ""]

    def __init__(self, value: object):
        self.value = checked_number(value, "the constant", above=True)

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        return jnp.broadcast_to(self.value, jnp.shape(n))


@final
class Proportional(AbstractFactor):
    r"""The one-constant factor $n / B$. ValueError unless B is finite and > 0."""

    B: Float[Array, ""]

    def __init__(self, B: object):
        self.B = checked_number(B, "B", above=True)

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        return n / self.B


@final
class RationalFactor(AbstractFactor):
    r"""$\sum_i a_i n^i / \sum_j b_j n^j$, coefficients from the lowest power on.

    ValueError where a coefficient is not finite or there is none.
    """

    numerator: Float[Array, " p"]
    denominator: Float[Array, " q"]

    def __init__(self, numerator: object, denominator: object):
        self.numerator, self.denominator = as_parameter(numerator, "numerator"), as_parameter(denominator, "denominator")
        for name, part in (("numerator", self.numerator), ("denominator", self.denominator)):
            if isinstance(part, Tracer):
                continue
            if part.ndim != 1 or not part.size or not np.all(np.isfinite(np.asarray(part))):
                raise ValueError(f"{name} must be a non-empty list of finite coefficients; got {part}")

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        return _horner(self.numerator, n) / _horner(self.denominator, n)


def _horner(coefficients: Array, n: Array) -> Array:
    # The powers are the last axis, whatever a batch of factors puts before it.
    value = coefficients[..., -1]
    for power in range(coefficients.shape[-1] - 2, -1, -1):
        value = value * n + coefficients[..., power]
    return value


@final
class PhongExact(AbstractFactor):
    r"""$(n+2)/(2\pi)$: the mirror-form power reflects exactly 1 at normal incidence (Lafortune & Willems 1994)."""

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        return (n + 2) / (2 * np.pi)


@final
class BlinnPhongExact(AbstractFactor):
    r"""$(n+2)(n+4)/(8\pi(2^{-n/2}+n))$: the half-form power reflects exactly 1 at normal incidence (Giesen 2009)."""

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        return (n + 2) * (n + 4) / (8 * np.pi * (jnp.exp2(-n / 2) + n))


@final
class Normalized(AbstractBRDF):
    """A lobe times its factor: ``factor(lobe.n) * lobe(wi, wo)`` in 1/sr.

    TypeError where the lobe has no exponent `n` or the factor is not callable.
    """

    lobe: AbstractZonalLobe
    factor: AbstractFactor

    def __init__(self, lobe: AbstractZonalLobe, factor: AbstractFactor):
        if not hasattr(lobe, "n"):
            raise TypeError(f"a factor needs a lobe with an exponent n; got {type(lobe).__name__}")
        if not callable(factor):
            raise TypeError(f"factor must be a Factor or a closed form; got {factor!r}")
        self.lobe = lobe
        self.factor = factor

    def scale(self) -> Float[Array, ""]:
        """The factor at the lobe's own exponent."""
        return self.factor(self.lobe.n)  # pyright: ignore[reportAttributeAccessIssue]

    @property
    def core(self) -> Any:
        return self.lobe.core

    def gain(self, cos_theta: Any) -> Any:
        return self.scale() * self.lobe.gain(cos_theta)

    def with_core(self, core: AbstractBRDF) -> AbstractBRDF:
        return eqx.tree_at(lambda tree: tree.lobe, self, self.lobe.with_core(core))

    @property
    def monotone(self) -> bool:
        return self.lobe.monotone

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        return self.scale() * self.lobe(wi, wo)


@final
class PerCosine(AbstractBRDF):
    """A BRDF divided by N.L: what the classical shading formulas amount to when their specular term lacks the cosine.

    Not reciprocal, and its albedo grows without bound towards grazing incidence.
    """

    base: AbstractBRDF

    @property
    def core(self) -> Any:
        return self.base.core

    def gain(self, cos_theta: Any) -> Any:
        return self.base.gain(cos_theta) / cos_theta

    def with_core(self, core: AbstractBRDF) -> AbstractBRDF:
        return eqx.tree_at(lambda tree: tree.base, self, self.base.with_core(core))

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "..."]:
        wi = jnp.asarray(wi)
        value = self.base(wi, wo)
        cosine = jnp.maximum(wi[..., 2], _TINY)
        return value / (cosine if value.ndim == cosine.ndim else cosine[..., None])


def has_engine(brdf: object) -> TypeGuard[AbstractBRDF]:
    """True where the albedo of `brdf` can be computed inside a JAX program (engines 1 and 2)."""
    return isinstance(brdf, AbstractBRDF) and isinstance(brdf.core, (AbstractZonalLobe, AbstractMicrofacetLobe, AbstractHalves))


def refuse_batched(brdf: Any) -> None:
    """ValueError where a lobe holds many exponents: it stands for many BRDFs, and says how to ask for them."""
    core = core_of(brdf)
    factor = getattr(brdf, "factor", None)
    numbers = [getattr(core, "n", None), getattr(core, "alpha", None), getattr(factor, "A", None), getattr(factor, "B", None)]
    shapes = [number.shape for number in numbers if number is not None and getattr(number, "ndim", 0)]
    if shapes:
        raise ValueError(
            f"this lobe holds a batch of parameters of shape {shapes[0]}: use jax.vmap(albedo, (0, None))(lobe, cos_theta),"
            " or albedo_table"
        )


def varied(brdf: Any, names: tuple[str, ...]) -> Callable[..., Any]:
    """One BRDF or BSDF as a family: its parameters `names` replaced. ValueError where it has no such number."""
    core = brdf.core
    for name in names:
        if not isinstance(getattr(core, name, None), jax.Array):
            known = [field for field in core.__dataclass_fields__ if isinstance(getattr(core, field), jax.Array)]
            raise UsageError(f"{type(core).__name__} has no parameter {name!r}; its parameters: {', '.join(known) or 'none'}")

    def build(**values: Any) -> AbstractBRDF:
        # The lobe's own constructor would check the domain, but may not know all its fields by these names.
        for name, value in values.items():
            if not isinstance(value, Tracer):
                if value < 0 or (name in ("m", "alpha") and value == 0):
                    raise ValueError(f"{name} must be {'> 0' if name in ('m', 'alpha') else '>= 0'}; got {value:g}")
                if name == "f0" and value > 1:
                    raise ValueError(f"f0 must be >= 0 and <= 1; got {value:g}")
        replaced = [jnp.asarray(values[name]) for name in names]
        return brdf.with_core(eqx.tree_at(lambda tree: [getattr(tree, name) for name in names], core, replaced))

    return build
