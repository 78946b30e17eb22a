r"""Tables of the albedo over exponents and angles in one compiled program.

Three observations make a table much cheaper than its cells one by one:

* the nodes of the exact-azimuth rule depend on theta alone once they are graded for the narrowest and the widest lobe of
  a range of exponents, so the trigonometry is paid once a column;
* with shared nodes an exponent costs one `exp` a node;
* log E is analytic in log(1 + n) (for the power lobes E is a Laplace transform in n), so a range of exponents of ratio
  1000 is interpolated to 1e-13 from 56 Chebyshev exponents, and a row costs a matrix product.

A lobe that ends with a zero of high order is so smooth there that shared nodes may run across the moving end, if they are
more and the range is shorter (`_PLANS`). Lobes with sharper breaks, exponents below 1 (where Schlick's lobe has a layer of
width n) and microfacet lobes are integrated cell by cell.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, ArrayLike, Float

from brdfcheck.brdf import catalog
from brdfcheck.brdf.base import AbstractZonalLobe, structure_of
from brdfcheck.brdf.factors import has_engine
from brdfcheck.brdf.family import Family, NoRange
from brdfcheck.brdf.subject import as_target
from brdfcheck.cores import available_cores, threads
from brdfcheck.quadrature import albedo as directional
from brdfcheck.quadrature.functions import Albedo
from brdfcheck.quadrature.polar import Order
from brdfcheck.quadrature.registry import engine_of
from brdfcheck.quadrature.rule import ROUNDING
from brdfcheck.quadrature.zonal import zonal_weights
from brdfcheck.runtime import double_precision, is_double


class _Plan(NamedTuple):
    """For lobes of at least this smoothness: the largest ratio of (1+n) in a block, and how it is sampled."""

    smoothness: float
    ratio: float
    exponents: int  # Chebyshev points in log(1+n)
    fine: Order
    coarse: Order


# Measured on n in [1, 1000]: relative errors of 2e-14 and 5e-14.
_PLANS = (
    _Plan(np.inf, 1100.0, 56, Order(92, 132), Order(76, 112)),
    _Plan(16, 33.0, 48, Order(152, 216), Order(128, 184)),
)


# The coarse rule is run for every so many-th exponent only.
_CHECKED = 4
# The cost of a cell by itself in cells with shared nodes, and from how many of these on another thread pays.
_CELL = 2000
_LEAST = 15_000


def _chebyshev(count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points in [-1, 1], barycentric weights, and the matrix from values to the last two coefficients."""
    k = np.arange(count)
    angle = (2 * k + 1) * np.pi / (2 * count)
    tail = 2 / count * np.cos(np.array([count - 2, count - 1])[:, None] * angle)
    return np.cos(angle), (-1.0) ** k * np.sin(angle), tail


def _interpolation(at: Array, points: Array, weights: Array) -> Array:
    difference = at[:, None] - points
    exact = difference == 0
    terms = weights / jnp.where(exact, 1, difference)
    terms = jnp.where(jnp.any(exact, axis=1, keepdims=True), exact.astype(terms.dtype), terms)
    return terms / jnp.sum(terms, axis=1, keepdims=True)


def _plan(lobe: object) -> _Plan | None:
    """How a family of such lobes shares nodes; None where it cannot."""
    if not isinstance(lobe, AbstractZonalLobe):
        return None
    return next((plan for plan in _PLANS if lobe.smoothness() >= plan.smoothness), None)


def _block(lobe_of_n: Callable[[Array], AbstractZonalLobe], plan: _Plan, n: Array, mu: Array) -> tuple[Array, Array]:
    """Raw albedo and relative error, both (n, mu), for rising exponents of a ratio that one set of nodes serves."""
    widest, narrowest = lobe_of_n(n[0]), lobe_of_n(n[-1])
    interpolated = n.size > plan.exponents
    if interpolated:
        points, weights, tail = (jnp.asarray(table, mu.dtype) for table in _chebyshev(plan.exponents))
        low, high = jnp.log1p(n[0]), jnp.log1p(n[-1])
        half, middle = (high - low) / 2, (high + low) / 2
        nodes_n = jnp.expm1(middle + half * points)
    else:
        nodes_n = n

    lobes = jax.vmap(lobe_of_n)(nodes_n)
    breaks, width = widest.breaks(), narrowest.width()

    def column(mu: Array) -> tuple[Array, Array]:
        """One cosine: albedos of all lobes by the fine rule, and of every fourth by the coarse one."""

        def by(order: Order, lobes: AbstractZonalLobe) -> Array:
            versine, weight = zonal_weights(widest.form, mu, breaks, width, (order,))
            return jax.vmap(lambda lobe: lobe.profile(versine))(lobes) @ weight[0]

        return by(plan.fine, lobes), by(plan.coarse, jax.tree.map(lambda leaf: leaf[::_CHECKED], lobes))

    # One column at a time: its nodes and profiles stay in the cache, and memory does not grow with the table.
    fine, coarse = (part.T for part in jax.lax.map(column, mu))
    checked = fine[::_CHECKED]
    # The worst exponent speaks for its column: a single difference of two rules may vanish by chance.
    relative = 4 * jnp.max(jnp.abs(checked - coarse) / jnp.abs(checked), axis=0)
    relative = relative + ROUNDING * float(jnp.finfo(mu.dtype).eps)
    if not interpolated:
        return fine, relative
    logarithm = jnp.log(fine)
    # The coefficients fall geometrically; twice the last two bounds what was cut off.
    relative = relative + 2 * jnp.sum(jnp.abs(tail @ logarithm), axis=0)
    at = jnp.where(half > 0, (jnp.log1p(n) - middle) / jnp.where(half > 0, half, 1), 0)
    return jnp.exp(_interpolation(at, points, weights) @ logarithm), relative


@eqx.filter_jit
def _shared_nodes(
    brdf_of_n: Callable[[Array], Any], plan: _Plan, n: Array, blocks: tuple[int, ...], mu: Array
) -> tuple[Array, Array]:
    wrapped = brdf_of_n(n[0])

    def core_of_n(value: Array) -> Any:
        return brdf_of_n(value).core

    values, errors = [], []
    for start, end in zip((0, *blocks), (*blocks, n.size), strict=True):
        part = n[start:end]
        value, relative = _block(core_of_n, plan, part, mu)
        if wrapped.core is not wrapped:  # the factors around the lobe
            value = value * jax.vmap(lambda value: brdf_of_n(value).gain(mu) * jnp.ones_like(mu))(part)
        amplitude = jax.vmap(lambda value: core_of_n(value).amplitude())(part)
        if amplitude.ndim > 1:
            value, relative = value[..., None] * amplitude[:, None, :], relative[..., None]
        else:
            value = value * amplitude[:, None]
        values.append(value)
        errors.append(jnp.abs(value) * relative)
    if len(values) == 1:
        return values[0], errors[0]
    return jnp.concatenate(values), jnp.concatenate(errors)


@eqx.filter_jit
def _cells(brdf_of_n: Callable[[Array], Any], n: Array, mu: Array, rtol: float | None) -> tuple[Array, Array, int]:
    engine = engine_of(brdf_of_n(n[0])).at(rtol)
    count = 0

    def cell(index: Array) -> tuple[Array, Array]:
        nonlocal count
        brdf, cosine = brdf_of_n(n[index // mu.size]), mu[index % mu.size]
        found = engine.integrate(brdf.core, cosine)
        count, gain = found.evaluations, brdf.gain(cosine)
        return found.value * gain, found.error * jnp.abs(gain)

    size = n.size * mu.size
    value, error = directional.batched(cell, jnp.arange(size), size, engine.batch)
    shape = (n.size, mu.size, *value.shape[1:])
    return value.reshape(shape), error.reshape(shape), count


# Programs that are known to be compiled: two threads that meet a new one would both compile it.
_seen: dict[Any, None] = {}
_SEEN = 256
# The threads that share out columns.
_COLUMNS = "brdfcheck-columns"


def _on_all_cores(program: Callable[[Array], tuple], same: tuple, mu: Array, column: int) -> tuple:
    """`program(mu)` with the columns shared out among threads; XLA runs such a program on one core.

    `same` tells programs apart; `column`: what one column costs, in cells with shared nodes.
    """
    # Within a program that is being traced (a sweep's) there is nothing to share out.
    cores = len(available_cores()) if jax.default_backend() == "cpu" and not isinstance(mu, Tracer) else 1
    parts = min(cores, mu.size, mu.size * column // _LEAST)
    if parts < 2:
        return program(mu)
    # Parts of one length share one program: the last one may overlap the one before.
    length = -(-mu.size // parts)
    starts = [min(part * length, mu.size - length) for part in range(parts)]
    # Cut and joined by numpy: each step of JAX outside of a program takes a tenth of a millisecond.
    host = np.asarray(mu)
    pieces = [jnp.asarray(host[start : start + length]) for start in starts]
    try:
        fresh = (same, length, mu.dtype.name) not in _seen
        while len(_seen) >= _SEEN:
            _seen.pop(next(iter(_seen)))
        _seen[same, length, mu.dtype.name] = None
    except TypeError:  # a callable that cannot be hashed
        fresh = True
    if fresh:
        results = [program(piece) for piece in pieces]
    else:
        double = is_double()

        def run(piece: Array) -> tuple:
            with double_precision(double):
                return jax.block_until_ready(program(piece))

        # This thread takes a share itself: waking another one costs as much as a thousand cells.
        others = [threads(cores, _COLUMNS).submit(run, piece) for piece in pieces[1:]]
        results = [run(pieces[0]), *(other.result() for other in others)]
    drop = [0] + [max(0, before + length - start) for before, start in itertools.pairwise(starts)]

    def joined(*columns: Any) -> Any:
        if getattr(columns[0], "ndim", 0) < 2:  # a count
            return columns[0]
        return jnp.asarray(
            np.concatenate([np.asarray(column)[:, skip:] for column, skip in zip(columns, drop, strict=True)], axis=1)
        )

    return tuple(joined(*columns) for columns in zip(*results, strict=True))


def _blocks(rising: np.ndarray, plan: _Plan) -> tuple[int, ...]:
    """Where to cut rising exponents so that no part spans more of 1+n than the plan's ratio."""
    position = np.log1p(rising) - np.log1p(rising[0])
    parts = max(1, int(np.ceil(position[-1] / np.log(plan.ratio) - 1e-9)))
    cuts = np.searchsorted(position, position[-1] * np.arange(1, parts) / parts)
    return tuple(sorted({int(cut) for cut in cuts} - {0, len(rising)}))


def _checked_exponents(n: object) -> np.ndarray:
    values = np.asarray(n)
    # Not numpy's own conversion: it reads text and times, and drops imaginary parts.
    if values.dtype.kind not in "iuf" or any(isinstance(leaf, (bool, np.bool_)) for leaf in jax.tree.leaves(n)):
        raise TypeError(f"n must be a list of real numbers; got {n!r}")
    values = values.astype(float)
    if values.ndim != 1 or values.size == 0:
        raise ValueError(f"n must be a non-empty list of exponents; got shape {values.shape}")
    if not np.all(np.isfinite(values) & (values >= 0)):
        raise ValueError(f"exponents must be finite and >= 0; got {values[~(np.isfinite(values) & (values >= 0))][0]:g}")
    return values


def albedo_table(
    brdf_of_n: Callable[..., Any] | str | Family,
    n: Float[ArrayLike, " n"],
    cos_theta: Float[ArrayLike, " cos_theta"],
    *,
    rtol: float | None = None,
) -> Albedo:
    """Directional albedo over exponents and cosines of incidence, shape (n, cos_theta) (and channels), never clamped.

    `brdf_of_n`: a lobe class, a callable n -> BRDF, a catalogue name, ``file.py:object`` or a `Family` of one parameter, which
    `n` is then. `n` and `cos_theta` are one-dimensional; `rtol` as for `albedo`. `error` bounds the absolute error of each
    cell. The axes are numbers, not traced values.
    Raises ValueError for empty or wrong axes and for what has not one parameter, KeyError for an unknown catalogue name.
    """
    exponents = _checked_exponents(n)
    if isinstance(brdf_of_n, (str, Family)):
        brdf_of_n = _of_one_number(brdf_of_n, (float(exponents.min()), float(exponents.max())))
    mu = directional.checked_cosines(cos_theta)
    if mu.ndim != 1 or mu.size == 0:
        raise ValueError(f"cos_theta must be a non-empty list of cosines; got shape {mu.shape}")
    shape = _structure(brdf_of_n, np.dtype(mu.dtype))
    if shape is None:
        rows = [directional.albedo(brdf_of_n(float(value)), mu, rtol=rtol) for value in exponents]
        count = np.sum([row.evaluations for row in rows])
        value, error = (np.stack([np.asarray(getattr(row, part)) for row in rows]) for part in ("value", "error"))
        return Albedo(value, error, count, rows[0].engine)  # pyright: ignore[reportArgumentType]
    plan = _plan(shape.core)
    order = np.argsort(exponents, kind="stable")
    rising = exponents[order].astype(mu.dtype)
    alone = len(rising) if plan is None else int(np.searchsorted(rising, 1.0))
    parts, counts = [], [0]
    if alone:
        singles = jnp.asarray(rising[:alone])
        *cells, count = _on_all_cores(
            lambda mu: _cells(brdf_of_n, singles, mu, rtol), (brdf_of_n, alone, rtol), mu, alone * _CELL
        )
        parts.append(cells)
        counts.append(count)
    if plan is not None and alone < len(rising):
        shared = jnp.asarray(rising[alone:])
        blocks = _blocks(rising[alone:], plan)
        same = (brdf_of_n, shared.size, blocks)
        parts.append(_on_all_cores(lambda mu: _shared_nodes(brdf_of_n, plan, shared, blocks, mu), same, mu, shared.size))
        counts.append(plan.fine.circle + plan.fine.cut)
    value, error = (column[0] if len(parts) == 1 else jnp.concatenate(column) for column in zip(*parts, strict=True))
    if np.any(order[1:] < order[:-1]):
        back = np.argsort(order, kind="stable")
        value, error = value[back], error[back]
    return Albedo(value, error, jnp.asarray(max(counts)), engine_of(shape).name)


def _of_one_number(target: str | Family, bounds: tuple[float, float]) -> Callable[..., Any]:
    """number -> BRDF of a name or a family of one parameter."""
    if isinstance(target, str) and target in catalog.names():
        return catalog.exponent_family(target)
    try:
        found = as_target(target)
    except NoRange as error:
        if len(error.names) != 1:
            raise
        found = as_target(target, {error.names[0]: bounds})
    if found.finding is not None:
        raise ValueError(found.finding)
    return catalog.of_one_number(found.family)


def _structure(brdf_of_n: Callable[..., Any], dtype: np.dtype) -> Any:
    """What the family builds, without numbers; None where engines 1 and 2 cannot take it."""
    try:
        return _known_structure(brdf_of_n, dtype)
    except TypeError:  # a callable that cannot be hashed
        return _known_structure.__wrapped__(brdf_of_n, dtype)


@functools.lru_cache(maxsize=64)
def _known_structure(brdf_of_n: Callable[..., Any], dtype: np.dtype) -> Any:
    shape = structure_of(brdf_of_n, jax.ShapeDtypeStruct((), dtype))
    return shape if has_engine(shape) else None
