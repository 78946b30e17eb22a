"""What a rule is: one signature for everything that estimates a directional albedo.

``rule(brdf, cos_theta, *, key=None) -> Estimate``. A rule is an immutable value: its one field is its setting. Rules that
are not `on_host` are pure JAX: they may be jitted, batched with `jax.vmap` and differentiated in the parameters of the
BRDF and in cos_theta, and run in the precision of their arguments.
"""

from __future__ import annotations

import abc
import dataclasses
import math
from collections.abc import Callable
from typing import Any, ClassVar, Protocol, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from brdfcheck.brdf.base import AbstractBRDF, core_of
from brdfcheck.brdf.calling import name_of
from brdfcheck.geometry import safe_root

# Directions evaluated together; bounds the memory of fine settings.
_BLOCK = 2**16

# Rounding of a weighted sum in units of the machine epsilon: nodes, weights and profile each contribute a few.
ROUNDING = 32

OK, NOT_REACHED, NOT_FINITE, NOT_KNOWN = range(4)
MESSAGES = {
    OK: "ok",
    NOT_REACHED: "the tolerance was not reached: allow more evaluations or loosen the tolerance",
    NOT_FINITE: "the BRDF or the sum was not finite",
    NOT_KNOWN: "no closed form is known at this cosine: use another rule",
}


class Estimate(eqx.Module):
    """A directional albedo as one rule sees it; never clamped.

    `value` has the shape of cos_theta, with a trailing axis for channels. `error` is what the rule claims for itself, of
    the same shape: the standard error of a Monte Carlo rule, an estimated bound of a deterministic one, inf where the
    rule claims nothing. `evaluations` counts evaluations of the BRDF for each cosine; `status` is a key of `MESSAGES`.
    Both have the shape of cos_theta.
    """

    value: Float[Array, "..."]
    error: Float[Array, "..."]
    evaluations: Int[Array, "..."]
    status: Int[Array, "..."]


class Raw(eqx.Module):
    """What one rule finds for one cosine: value and error of shape () or (channels,)."""

    value: Any
    error: Any
    evaluations: Any
    status: Any = OK


class RuleKind(Protocol):
    """A final class of rules: what `AbstractRule` asks of it, and a setting makes one of it a rule."""

    name: str
    family: str
    ladder: tuple[Any, ...]
    needs: str
    random: bool
    on_host: bool

    def __call__(self, setting: Any, /) -> AbstractRule: ...


class AbstractRule(eqx.Module):
    """A way to estimate the directional albedo, with one setting.

    Arrays of cosines are worked off one after another, with independent randomness. Raises ValueError for cosines
    outside [0, 1] and where a rule with chance in it gets no `key`; TypeError where the rule does not take the BRDF, the
    key is not one of `jax.random.key`, or a rule that runs on the host is traced.
    """

    name: eqx.AbstractClassVar[str]
    family: eqx.AbstractClassVar[str]
    # Settings from cheap to accurate.
    ladder: eqx.AbstractClassVar[tuple[Any, ...]]
    # What the BRDF must offer, for messages.
    needs: ClassVar[str] = "a function f(wi, wo)"
    random: ClassVar[bool] = False
    on_host: ClassVar[bool] = False

    def applies(self, core: Any, cos_theta: Any) -> bool:
        """True where the rule can integrate `core`, a BRDF without wrappers; cos_theta is None for "at any"."""
        return True

    @abc.abstractmethod
    def integrate(self, core: Any, mu: Float[Array, ""], key: Any = None) -> Raw:
        """The albedo of a BRDF without wrappers at one cosine."""

    @property
    def setting_name(self) -> str:
        """The name of the rule's field: "order", "samples", "tolerance"."""
        return dataclasses.fields(self)[0].name

    @property
    def setting(self) -> Any:
        """The value of the rule's field."""
        return getattr(self, self.setting_name)

    def takes(self, brdf: Any, cos_theta: Any = None) -> bool:
        """True where the rule applies to this BRDF (at this cosine, if given; else at every one)."""
        if not callable(brdf):
            return False
        return self.applies(core_of(brdf), cos_theta)

    def __call__(self, brdf: Callable[..., Any], cos_theta: Any, *, key: Any = None) -> Estimate:
        brdf, mu = _of_one_type(brdf, cos_theta)
        traced = any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves((brdf, mu)))
        if not self.takes(brdf, mu):
            raise TypeError(f"{self.name} needs {self.needs}; got {_called(brdf)}")
        if self.on_host and traced:
            raise TypeError(f"{self.name} runs on the host: call it outside jit, vmap and grad")
        if self.random and key is None:
            raise ValueError(f"{self.name} draws at random: give it key=jax.random.key(seed)")
        if key is not None:
            key = _checked_key(key)
        core, scale = core_of(brdf), brdf.gain if isinstance(brdf, AbstractBRDF) else lambda mu: 1.0
        if not mu.ndim:
            return self._estimate(core, scale, mu, key)
        flat = mu.ravel()
        keys = None if key is None else jax.random.split(key, flat.size)
        if self.on_host or not flat.size:
            rows = [self._estimate(core, scale, flat[i], None if keys is None else keys[i]) for i in range(flat.size)]
            found = jax.tree.map(lambda *parts: jnp.stack(parts), *rows)
        else:
            found = jax.lax.map(lambda pair: self._estimate(core, scale, *pair), (flat, keys))
        return jax.tree.map(lambda part: part.reshape(mu.shape + part.shape[1:]), found)

    def _estimate(self, core: Any, scale: Callable[[Any], Any], mu: Array, key: Any) -> Estimate:
        raw = self.integrate(core, mu, key)
        factor = scale(mu)
        value = jnp.asarray(raw.value, mu.dtype) * factor
        finite = jnp.all(jnp.isfinite(value))
        error = jnp.broadcast_to(jnp.asarray(raw.error, mu.dtype), value.shape) * jnp.abs(factor)
        error = jnp.where(finite & ~jnp.isnan(error), error, jnp.inf)
        # What a claim is worth has no derivative.
        error = jax.lax.stop_gradient(error)
        status = jnp.where(finite, raw.status, jnp.where(jnp.asarray(raw.status) == NOT_KNOWN, NOT_KNOWN, NOT_FINITE))
        return Estimate(value, error, jnp.asarray(raw.evaluations), status)


class AbstractEngine(AbstractRule):
    """A rule that verdicts, tables, sweeps and charts rest on: it knows what accuracy it can reach, and what it costs.

    Its setting is an accuracy. Whoever needs an albedo asks `brdfcheck.quadrature.registry.engine_of` for the engine of a BRDF.
    """

    # The relative accuracy that it reaches.
    best: eqx.AbstractClassVar[float]
    # What a point costs, from 0: how densely one can afford to look at a BRDF goes by it.
    effort: eqx.AbstractClassVar[int]
    # Incidences integrated together in a large request, which bounds its memory.
    batch: eqx.AbstractClassVar[int]
    # Incidences of one program where many BRDFs are looked at.
    chunk: eqx.AbstractClassVar[int]

    @classmethod
    @abc.abstractmethod
    def at(cls, rtol: float | None) -> Self:
        """The engine at a relative accuracy, None for its best. ValueError where that is not between 0 and 1."""


def checked_accuracy(value: Any, name: str = "rtol") -> float:
    """`value` as a float; ValueError where it is not between 0 and 1."""
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating)) or not 0 < value < 1:
        raise ValueError(f"{name} must be a number between 0 and 1; got {value!r}")
    return float(value)


class AbstractDigits(AbstractEngine):
    """An engine in pure JAX whose setting is a number of digits: its nodes are those at which the worst lobe has as many.

    By default it aims at its best, and in a precision with fewer digits at those that there are. ValueError for digits that are
    not a number above 0, at most 16.
    """

    digits: float = eqx.field(static=True)

    def __init__(self, digits: float | None = None):
        value = -math.log10(self.best) if digits is None else digits
        if isinstance(value, bool) or not isinstance(value, (int, float, np.floating)) or not 0 < value <= 16:
            raise ValueError(f"digits must be a number above 0, at most 16; got {value!r}")
        self.digits = float(value)

    @classmethod
    def at(cls, rtol: float | None) -> Self:
        return cls(None if rtol is None else -math.log10(checked_accuracy(rtol)))

    def within(self, dtype: Any) -> float:
        """The digits to aim at in a precision."""
        return min(self.digits, -math.log10(float(jnp.finfo(dtype).eps)) - 1)


class AbstractLightRule(AbstractRule):
    """A rule that evaluates the BRDF from the direction to the light.

    The albedo depends on the square of the sine of the incidence, so that its derivative at normal incidence is a second
    derivative in the sine, while the derivative of the direction is infinite. So there derivatives are those at a sine of
    epsilon^(1/3), where rounding, which is divided by the sine, and what a derivative changes on the way are of one size. Where
    the nodes are not symmetric about the normal they are the mean of those from either side: what is odd in the sine would be
    divided by it too. As everywhere, a BRDF that jumps (a lobe that is cut off before it is 0) is differentiated between its
    jumps only.
    """

    # True where for every node there is another one at the azimuth + 180 degrees.
    symmetric: ClassVar[bool] = False

    @abc.abstractmethod
    def seen(self, core: Any, wi: Float[Array, " 3"], key: Any) -> Raw:
        """The albedo of a BRDF without wrappers from one direction to the light, at the azimuth 0 or 180 degrees."""

    def integrate(self, core: Any, mu: Float[Array, ""], key: Any = None) -> Raw:
        if not isinstance(mu, Tracer):  # no derivative in it
            return self.seen(core, light(mu), key)
        facts: list[Any] = []

        def look(core: Any, mu: Array, key: Any, side: Array) -> tuple[Array, Array]:
            raw = self.seen(core, light(mu, side), key)
            facts[:] = raw.evaluations, raw.status
            value = jnp.asarray(raw.value, mu.dtype)
            return value, jnp.broadcast_to(jnp.asarray(raw.error, mu.dtype), value.shape)

        # What a function of a user closes over becomes an argument, so that it has derivatives too.
        right = jnp.ones_like(mu)
        closed = eqx.filter_closure_convert(look, core, mu, key, right)
        value, error = _with_slope(closed, core, mu, key, right, self.symmetric)
        return Raw(value, error, *facts)


@eqx.filter_custom_jvp
def _with_slope(look: Any, core: Any, mu: Array, key: Any, side: Array, symmetric: bool) -> tuple[Array, Array]:
    return look(core, mu, key, side)


@_with_slope.def_jvp
def _(primals: tuple, tangents: tuple) -> tuple[Any, Any]:
    look, core, mu, key, side, symmetric = primals
    beside = 1 - float(jnp.finfo(mu.dtype).eps) ** (2 / 3) / 2
    shifted = jnp.minimum(mu, beside)
    moved = (*tangents[:4], None)  # of all but the side

    def slope(side: Array) -> tuple[Array, Array]:
        return eqx.filter_jvp(lambda look, *rest: look(*rest), (look, core, shifted, key, side), moved)[1]

    def mean() -> tuple[Array, Array]:
        return jax.tree.map(lambda one, two: (one + two) / 2, slope(side), slope(-side))

    outcome = slope(side) if symmetric else jax.lax.cond(mu <= beside, lambda: slope(side), mean)
    return look(core, mu, key, side), outcome


def checked_count(value: Any, name: str, lowest: int = 1) -> int:
    """`value` as an int; ValueError where it is not a whole number of at least `lowest`."""
    if isinstance(value, bool) or not isinstance(value, (int, np.integer)) or value < lowest:
        raise ValueError(f"{name} must be a whole number >= {lowest}; got {value!r}")
    return int(value)


def light(mu: Float[Array, ""], side: Array | float = 1.0) -> Float[Array, " 3"]:
    """The direction to the light, at azimuth 0; at azimuth 180 degrees for `side` -1.

    At normal incidence its derivative is taken as 0: rules that look from it are `AbstractLightRule`.
    """
    return jnp.stack([side * safe_root((1 - mu) * (1 + mu)), jnp.zeros_like(mu), mu])


def on_sphere(sine: Array, cosine: Array, azimuth: Array) -> Float[Array, "... 3"]:
    """Unit vectors from the sine and the cosine of the polar angle (shapes broadcast) and the azimuth."""
    sine, cosine, azimuth = jnp.broadcast_arrays(sine, cosine, azimuth)
    return jnp.stack([sine * jnp.cos(azimuth), sine * jnp.sin(azimuth), cosine], axis=-1)


def evaluate(brdf: Callable[..., Any], wi: Float[Array, " 3"], wo: Float[Array, "k 3"], weight: Float[Array, " k"]) -> Array:
    """f(wi, wo) times weight, shape (k,) or (k, channels)."""
    values = jnp.asarray(brdf(jnp.broadcast_to(wi, wo.shape), wo)).astype(weight.dtype)
    if values.ndim > weight.ndim:
        weight = weight[..., None]
    # A BRDF that is not finite where it does not count (below the horizon) is not asked there.
    return jnp.where(weight == 0, 0, values * weight)


def block_count(count: int, size: int = 1) -> int:
    """Into how many equal blocks to cut `count` items of `size` evaluations each: the fewest that bound the memory."""
    most = max(_BLOCK // size, 1)
    if count <= most:
        return 1
    return next(blocks for blocks in range(-(-count // most), count + 1) if count % blocks == 0)


def by_blocks(function: Callable[..., Any], tables: tuple[Array, ...], blocks: int) -> Any:
    """`function` of equal pieces of `tables` along their leading axis, summed over the pieces."""
    if blocks == 1:
        return function(*tables)
    pieces = tuple(table.reshape(blocks, -1, *table.shape[1:]) for table in tables)
    found = jax.lax.map(lambda piece: function(*piece), pieces)
    return jax.tree.map(lambda part: jnp.sum(part, axis=0), found)


def bar(fine: Any, coarse: Any, more: Any = 0.0, *, caution: float = 1, xp: Any = jnp) -> Any:
    """The error bar of two rules, with `xp` numpy or jax.numpy.

    `caution` times their difference and the rounding of the sum, and `more`; inf where that overflows.
    """
    error = caution * (xp.abs(fine - coarse) + ROUNDING * float(xp.finfo(fine.dtype).eps) * xp.abs(fine)) + more
    return xp.where(xp.isfinite(error), error, xp.inf)


def _called(brdf: Any) -> str:
    core = core_of(brdf)
    form = f" in the {core.form} form" if hasattr(core, "form") else ""
    return name_of(core) + form


def _checked_key(key: Any) -> Any:
    dtype = getattr(key, "dtype", None)
    if dtype is not None and jnp.issubdtype(dtype, jax.dtypes.prng_key):
        typed = key
    elif dtype == np.uint32 and key.shape == (2,):
        typed = jax.random.wrap_key_data(key)
    else:
        raise TypeError(f"key must be a key of jax.random.key; got {key!r}")
    if typed.shape:
        raise TypeError(f"key must be one key, not {typed.shape[0]}: use jax.vmap for a batch of keys")
    return typed


def _of_one_type(brdf: Any, cos_theta: Any) -> tuple[Any, Array]:
    """Parameters and cosines in the wider of their types; a Python number takes the type of the parameters."""
    if not isinstance(cos_theta, Tracer):
        values = np.asarray(cos_theta)
        if not np.issubdtype(values.dtype, np.number) or np.iscomplexobj(values):
            raise ValueError(f"cos_theta must be real numbers in [0, 1]; got {cos_theta!r}")
        if not np.all((values >= 0) & (values <= 1)):  # also refuses NaN
            raise ValueError(f"cos_theta must lie in [0, 1]; got {cos_theta}")
    known = [] if not isinstance(brdf, AbstractBRDF) else jax.tree.leaves(brdf)
    types = [leaf.dtype for leaf in known if _floating(leaf)]
    if _floating(cos_theta) and not getattr(cos_theta, "weak_type", False):
        types.append(cos_theta.dtype)
    dtype = jnp.dtype(np.result_type(*types) if types else jnp.asarray(0.0).dtype)
    if isinstance(brdf, AbstractBRDF):
        brdf = jax.tree.map(lambda leaf: jnp.asarray(leaf, dtype) if _floating(leaf) else leaf, brdf)
    return brdf, jnp.asarray(cos_theta).astype(dtype)


def _floating(leaf: Any) -> bool:
    return hasattr(leaf, "dtype") and bool(jnp.issubdtype(leaf.dtype, jnp.floating))
