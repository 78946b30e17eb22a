r"""Normalisation factors, and the lobe that a factor makes into a BRDF.

A lobe has peak value 1; its factor is what it is multiplied by, as a function of its exponent. `Factor(A, B)` is the
two-constant form (n+A)/B of the literature; the closed forms, named Exact, make the albedo at normal incidence exactly 1.

At normal incidence the albedo of a lobe g(c) is one elementary integral: $2\pi\int_0^1 g\,c\,dc$ in the mirror form,
$8\pi\int_{1/\sqrt2}^1 g\,(2c^3-c)\,dc$ in the half form, of which rational, polynomial and trigonometric lobes, and the
powers, have a closed form.
"""

from __future__ import annotations

import abc
import math
from collections.abc import Callable
from typing import Any, TypeGuard, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from brdfcheck.brdf.base import (
    FORMS,
    AbstractBRDF,
    AbstractHalves,
    AbstractMicrofacetLobe,
    AbstractZonalLobe,
    Form,
    as_parameter,
    checked_number,
    core_of,
)
from brdfcheck.messages import UsageError, one_of
from brdfcheck.numerics import gauss

_TINY = 1e-18
# The versine (the cosine) at which the lobe meets the horizon.
_END = {"mirror": 1.0, "half": 1 - math.sqrt(0.5)}
# Between these exponents Schlick's antiderivative cancels, and its pole is so far away that 24 Gauss nodes give 1e-15.
_FAR_POLE = (0.25, 4.0)


class AbstractFactor(eqx.Module):
    """What a lobe is multiplied by, in 1/sr, as a function of its exponent."""

    @abc.abstractmethod
    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        """The factor at the exponents `n`, same shape."""

    def formula(self, show: Callable[[float], str], n: str = "n") -> str | None:
        """The factor as an expression of C and GLSL in `n`; `show` writes numbers. None where it is longer than that."""
        return None


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

    def formula(self, show: Callable[[float], str], n: str = "n") -> str:
        a, b = float(self.A), float(self.B)
        return f"({show(-a)} - {n})/{show(-b)}" if b < 0 else f"({n} {'-' if a < 0 else '+'} {show(abs(a))})/{show(b)}"


@final
class Constant(AbstractFactor):
    """The same factor for every exponent, in 1/sr. ValueError unless it is finite and > 0."""

    value: Float[Array, ""]

    def __init__(self, value: object):
        self.value = checked_number(value, "the constant", above=True)

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        return jnp.broadcast_to(self.value, jnp.shape(n))

    def formula(self, show: Callable[[float], str], n: str = "n") -> str:
        return show(float(self.value))


@final
class Proportional(AbstractFactor):
    r"""The one-constant factor $n / B$. ValueError unless B is finite and > 0."""

    B: Float[Array, ""]

    def __init__(self, B: object):
        self.B = checked_number(B, "B", above=True)

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        return n / self.B

    def formula(self, show: Callable[[float], str], n: str = "n") -> str:
        return f"{n}/{show(float(self.B))}"


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

    def formula(self, show: Callable[[float], str], n: str = "n") -> str:
        def series(coefficients: list[float]) -> str:
            text = show(coefficients[-1])
            for value in coefficients[-2::-1]:
                text = f"{show(value)} + {n} * ({text})"
            return text

        return f"({series(self.numerator.tolist())})/({series(self.denominator.tolist())})"


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

    def formula(self, show: Callable[[float], str], n: str = "n") -> str:
        return f"({n} + {show(2)})/{show(2 * np.pi)}"


@final
class BlinnPhongExact(AbstractFactor):
    r"""$(n+2)(n+4)/(8\pi(2^{-n/2}+n))$: the half-form power reflects exactly 1 at normal incidence (Giesen 2009)."""

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        return (n + 2) * (n + 4) / (8 * np.pi * (jnp.exp2(-n / 2) + n))

    def formula(self, show: Callable[[float], str], n: str = "n") -> str:
        return f"({n} + {show(2)}) * ({n} + {show(4)})/({show(8 * np.pi)} * (exp2({show(-0.5)} * {n}) + {n}))"


def _checked_form(form: str) -> Form:
    return one_of(form, FORMS, "form")


def _weight(form: Form, versine: Any) -> Any:
    """What the profile is multiplied by under the integral over the versine, at normal incidence."""
    c = 1 - versine
    return 2 * np.pi * c if form == "mirror" else 8 * np.pi * c * (2 * c * c - 1)


@final
class TruncatedPowerExact(AbstractFactor):
    r"""For $\max(0, 1 - n(1-c)/k)^k$: the binomial power, and Lyon's lobe with k = 2^w.

    The integrand is a polynomial of degree k+1 (mirror) or k+3 (half) up to the first zero of the lobe, so a Gauss rule of
    that degree is a closed form. `clamped`: false for the power without the max. ValueError for an unknown form or k < 1.
    """

    k: int = eqx.field(static=True)
    form: Form = eqx.field(static=True)
    clamped: bool = eqx.field(static=True)

    def __init__(self, k: int, form: str = "half", clamped: bool = True):
        if k < 1:
            raise ValueError(f"k must be at least 1; got {k}")
        self.k, self.form, self.clamped = int(k), _checked_form(form), bool(clamped)

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        n, end = jnp.asarray(n), _END[self.form]
        if self.clamped:
            end = jnp.minimum(end, self.k / jnp.maximum(n, self.k))
        total = jnp.zeros_like(n)
        for node, weight in zip(*gauss((self.k + 5) // 2), strict=True):
            versine = end * float(node)
            total = total + float(weight) * _weight(self.form, versine) * (1 - n * versine / self.k) ** self.k
        return 1 / (end * total)


@final
class SchlickExact(AbstractFactor):
    r"""For $c/(n - nc + c)$. With A = n/(n-1), mirror: $(n-1)/(2\pi(A^2\ln n - A - 1/2))$; half: by partial fractions.

    ValueError for an unknown form.
    """

    form: Form = eqx.field(static=True, converter=_checked_form, default="mirror")

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        n = jnp.asarray(n)
        low, high = _FAR_POLE
        if self.form == "half":  # starts at c = 1/sqrt 2: no pole comes near for small n
            low = 0.0
        by_nodes = (n >= low) & (n <= high)
        large = jnp.where(by_nodes, 2 * high, jnp.maximum(n, 1e-30))
        pole = large / (large - 1)
        if self.form == "mirror":
            closed = 2 * np.pi / (large - 1) * (pole**2 * jnp.log(large) - pole - 0.5)
        else:
            # p(c) = 2 c^4 - c^2 = p(A) - (A - c) (2 (A^3 + A^2 c + A c^2 + c^3) - (A + c)), integrated from 1/sqrt 2 to 1.
            start = math.sqrt(0.5)
            moments = [(1 - start**j) / j for j in range(1, 5)]  # of 1, c, c^2, c^3
            quotient = (
                (2 * pole**3 - pole) * moments[0] + (2 * pole**2 - 1) * moments[1] + 2 * pole * moments[2] + 2 * moments[3]
            )
            logarithm = jnp.log(jnp.abs((pole - start) * (large - 1)))  # A - 1 = 1/(n-1)
            closed = 8 * np.pi / (large - 1) * ((2 * pole**4 - pole**2) * logarithm - quotient)
        small, end, near = jnp.where(by_nodes, n, high), _END[self.form], jnp.zeros_like(n)
        for node, weight in zip(*gauss(24), strict=True):
            versine = end * float(node)
            near = near + end * float(weight) * _weight(self.form, versine) * (1 - versine) / (small * versine + 1 - versine)
        return 1 / jnp.where(by_nodes, near, closed)


@final
class KuijkBlakeExact(AbstractFactor):
    r"""For Kuijk and Blake's piecewise quadratic in the angle a.

    The albedo is $\pi\int g \sin 2a\,da$ in the mirror form and $2\pi\int g \sin 4a\,da$ in the half form. Over at most half a
    wave, 12 Gauss nodes give each piece to rounding, where the antiderivatives cancel.

    ValueError for an unknown form.
    """

    form: Form = eqx.field(static=True, converter=_checked_form, default="mirror")

    def __call__(self, n: Float[Array, "..."]) -> Float[Array, "..."]:
        n = jnp.asarray(n)
        wave = 2.0 if self.form == "mirror" else 4.0
        p = (n + 5.6) / (jnp.maximum(n, 1e-14) * (0.09 * n + 5.2))
        q = (n + 65) / (5 * n + 31.7)
        near_end = jnp.minimum(p, np.pi / wave)
        far_end = jnp.clip(q, near_end, np.pi / wave)
        # Where p lies beyond q there is no second piece; the safe value keeps its gradient finite.
        spread = jnp.where(q > p, q * (q - p), 1)
        near, far = jnp.zeros_like(n), jnp.zeros_like(n)
        for node, weight in zip(*gauss(12), strict=True):
            a = near_end * float(node)
            near = near + float(weight) * (1 - a * a / (p * q)) * jnp.sin(wave * a)
            b = near_end + (far_end - near_end) * float(node)
            far = far + float(weight) * (q - b) ** 2 / spread * jnp.sin(wave * b)
        return 1 / (wave / 2 * np.pi * (near_end * near + (far_end - near_end) * far))


def exact_factor(lobe: object) -> AbstractFactor | None:
    """The factor in closed form with which `lobe` reflects exactly 1 at normal incidence; None where there is none."""
    return lobe.exact_factor() if isinstance(lobe, AbstractZonalLobe) else None


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
    """UsageError where a lobe holds many exponents: it stands for many BRDFs, and says how to ask for them."""
    core = core_of(brdf)
    factor = getattr(brdf, "factor", None)
    numbers = [getattr(core, "n", None), getattr(core, "alpha", None), getattr(factor, "A", None), getattr(factor, "B", None)]
    shapes = [number.shape for number in numbers if number is not None and getattr(number, "ndim", 0)]
    if shapes:
        raise UsageError(
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
