r"""Monte Carlo and quasi-Monte Carlo rules.

$E \approx \frac1N\sum f(w_i, w_o)(N \cdot w_o)/p(w_o)$. Randomness comes from the explicit key and from nowhere else: the
same key gives the same directions. The error of a Monte Carlo rule is its standard error, one sigma, estimated from the
same samples: a lobe that no sample hits has the value 0 and the standard error 0.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, ClassVar, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.quadrature.proposals import LobeGeometry, has_axis
from brdfcheck.quadrature.rule import AbstractLightRule, Raw, block_count, by_blocks, checked_count, evaluate, on_sphere

_SAMPLES = (2**6, 2**8, 2**10, 2**12, 2**14, 2**16, 2**18, 2**20)
# How the samples of the lobe rule are shared out, in eighths: the main proposal, the tail (zonal lobes), the cosine.
_SHARES = {"zonal": (5, 2, 1), "facets": (7, 1)}
# Random shifts of a quasi-Monte-Carlo sequence: as many estimates, whose scatter is its error.
_SHIFTS = 8


def _uniforms(key: Any, count: int, dtype: Any) -> tuple[Array, Array]:
    """u in (0, 1] and azimuths."""
    u, v = jax.random.uniform(key, (2, count), dtype)
    return 1 - u, 2 * np.pi * v


def _moments(terms: Array) -> tuple[Array, Array]:
    """(mean, sum of squared deviations) over the leading axis."""
    mean = jnp.mean(terms, axis=0)
    return mean, jnp.sum((terms - mean) ** 2, axis=0)


def _mean(terms: Callable[[Any, int], Array], key: Any, count: int, shares: tuple[int, ...] = (1,)) -> tuple[Array, Array]:
    """(mean, its standard error) of `count` random terms, drawn and dropped in blocks.

    The terms of a block are strata one after another, whose sizes are in proportion to `shares`.
    """
    whole = sum(shares)
    blocks = block_count(count // whole, whole)
    size = count // blocks
    stops = np.cumsum(shares)[:-1] * (size // whole)

    def block(key: Any) -> list[tuple[Array, Array]]:
        return [_moments(stratum) for stratum in jnp.split(terms(key, size), stops)]

    strata = block(key) if blocks == 1 else jax.lax.map(block, jax.random.split(key, blocks))
    mean, variance = 0.0, 0.0
    for (means, squares), share in zip(strata, shares, strict=True):
        each = size * share // whole
        if blocks > 1:
            means, between = _moments(means)
            squares = jnp.sum(squares, axis=0) + each * between
        number = each * blocks
        mean = mean + means * (share / whole)
        variance = variance + squares / max(number - 1, 1) / number * (share / whole) ** 2
    return jnp.asarray(mean), _root(jnp.asarray(variance)) if count > 1 else jnp.full_like(mean, jnp.inf)


def _root(square: Array) -> Array:
    """sqrt for standard errors, which are not differentiated but must not make a NaN of what is."""
    return jnp.sqrt(jax.lax.stop_gradient(square))


@final
class UniformMonteCarlo(AbstractLightRule):
    """Directions of equal probability over the hemisphere. ValueError for fewer than one sample."""

    samples: int = eqx.field(static=True)
    name: ClassVar[str] = "uniform-monte-carlo"
    family: ClassVar[str] = "montecarlo"
    ladder: ClassVar[tuple[Any, ...]] = _SAMPLES
    random: ClassVar[bool] = True

    def __init__(self, samples: int = 2**14):
        self.samples = checked_count(samples, "samples")

    def seen(self, core: Any, wi: Float[Array, " 3"], key: Any) -> Raw:
        def terms(key: Any, count: int) -> Array:
            z, azimuth = _uniforms(key, count, wi.dtype)
            wo = on_sphere(jnp.sqrt((1 - z) * (1 + z)), z, azimuth)
            return evaluate(core, wi, wo, 2 * np.pi * z)

        return Raw(*_mean(terms, key, self.samples), self.samples)


@final
class CosineMonteCarlo(AbstractLightRule):
    """Directions with the density (N.wo)/pi. ValueError for fewer than one sample."""

    samples: int = eqx.field(static=True)
    name: ClassVar[str] = "cosine-monte-carlo"
    family: ClassVar[str] = "montecarlo"
    ladder: ClassVar[tuple[Any, ...]] = _SAMPLES
    random: ClassVar[bool] = True

    def __init__(self, samples: int = 2**14):
        self.samples = checked_count(samples, "samples")

    def seen(self, core: Any, wi: Float[Array, " 3"], key: Any) -> Raw:
        def terms(key: Any, count: int) -> Array:
            u, azimuth = _uniforms(key, count, wi.dtype)
            wo = on_sphere(jnp.sqrt(1 - u), jnp.sqrt(u), azimuth)
            return evaluate(core, wi, wo, jnp.full_like(u, np.pi))

        return Raw(*_mean(terms, key, self.samples), self.samples)


@final
class LobeMonteCarlo(AbstractLightRule):
    """Directions where the lobe is: a power of the cosine about its axis, or the slopes of its facets.

    An eighth of the samples follows the cosine instead, and for lobes about an axis a quarter a tail, so that no part of
    a lobe is left out; all are weighted by the balance heuristic (Veach 1997). Directions below the horizon count as
    evaluations; towards normal incidence derivatives lack, as those of `LobeWarpedGauss`, what the directions about the lobe
    gain at the horizon. ValueError unless the samples are a multiple of 8.
    """

    samples: int = eqx.field(static=True)
    name: ClassVar[str] = "lobe-monte-carlo"
    family: ClassVar[str] = "montecarlo"
    ladder: ClassVar[tuple[Any, ...]] = _SAMPLES
    needs: ClassVar[str] = "a lobe about an axis or a microfacet lobe"
    random: ClassVar[bool] = True

    def __init__(self, samples: int = 2**14):
        self.samples = checked_count(samples, "samples", 16)
        if self.samples % 8:
            raise ValueError(f"samples must be a multiple of 8; got {samples}")

    def applies(self, core: Any, cos_theta: Any) -> bool:
        return has_axis(core)

    def seen(self, core: Any, wi: Float[Array, " 3"], key: Any) -> Raw:
        lobe = LobeGeometry(core, wi[2], wi)
        shares = _SHARES["facets" if lobe.facets else "zonal"]

        def terms(key: Any, count: int) -> Array:
            """The terms of the balance heuristic for directions drawn from one proposal after the other."""
            u, azimuth = _uniforms(key, count, wi.dtype)
            main = count * shares[0] // 8
            about = count - count * shares[-1] // 8
            versine = jnp.concatenate([lobe.versine(u[:main]), lobe.tail_versine(u[main:about])])
            wo, jacobian = lobe.directions(versine, azimuth[:about])
            rest = on_sphere(jnp.sqrt(1 - u[about:]), jnp.sqrt(u[about:]), azimuth[about:])
            wo = jnp.concatenate([wo, rest])
            useful = jnp.concatenate([jacobian > 0, u[about:] > 0])
            wo = jnp.where(useful[:, None], wo, jnp.array([0, 0, 1], wo.dtype))
            versine, jacobian = lobe.angle(wo)
            density = shares[0] * lobe.density(versine)
            if len(shares) == 3:
                density = density + shares[1] * lobe.tail_density(versine)
            mixed = density / jnp.maximum(jacobian, 1e-18) + shares[-1] * wo[..., 2] / np.pi
            weight = jnp.where(useful, 8 * wo[..., 2] / mixed, 0)
            return evaluate(core, lobe.wi, wo, weight)

        return Raw(*_mean(terms, key, self.samples, shares), self.samples)


@functools.lru_cache(maxsize=16)
def _sobol(count: int) -> np.ndarray:
    from scipy.stats import qmc

    # The first 2^k points, moved by half a cell so that none lies on an edge.
    points = qmc.Sobol(2, scramble=False).random_base2(count.bit_length() - 1)
    return points + 0.5 / count


@functools.lru_cache(maxsize=16)
def _r2(count: int) -> np.ndarray:
    # The plastic number, the root of g^3 = g + 1 (Roberts 2018).
    g = 1.32471795724474602596
    return (0.5 + np.arange(1, count + 1)[:, None] * np.array([1 / g, 1 / g**2])) % 1.0


def _quasi(core: Callable[..., Any], wi: Array, key: Any, table: Callable[[int], np.ndarray], count: int) -> Raw:
    """Points of the unit square as directions with the density (N.wo)/pi; with a key, shifted at random."""

    def total(points: Array) -> Array:
        u, azimuth = points[:, 0], 2 * np.pi * points[:, 1]
        wo = on_sphere(jnp.sqrt(u), jnp.sqrt(jnp.maximum(1 - u, 0)), azimuth)
        return jnp.sum(evaluate(core, wi, wo, jnp.full_like(u, np.pi)), axis=0)

    if key is None:
        points = jnp.asarray(table(count), wi.dtype)
        return Raw(by_blocks(total, (points,), block_count(count)) / count, jnp.inf, count)
    part = count // _SHIFTS
    points = jnp.asarray(table(part), wi.dtype)
    shifts = jax.random.uniform(key, (_SHIFTS, 2), wi.dtype)
    values = jax.lax.map(lambda shift: by_blocks(total, ((points + shift) % 1.0,), block_count(part)) / part, shifts)
    mean, square = _moments(values)
    return Raw(mean, _root(square / (_SHIFTS - 1) / _SHIFTS), count)


@final
class Sobol(AbstractLightRule):
    """Sobol's sequence mapped to directions of density (N.wo)/pi.

    Without a key the sequence is as it is, and the rule claims nothing; with one, the points are divided over eight
    randomly shifted copies, whose scatter is the error. ValueError unless the points are a power of 2, at least 16.
    """

    points: int = eqx.field(static=True)
    name: ClassVar[str] = "sobol"
    family: ClassVar[str] = "quasi-montecarlo"
    ladder: ClassVar[tuple[Any, ...]] = _SAMPLES

    def __init__(self, points: int = 2**14):
        self.points = checked_count(points, "points", 16)
        if self.points & (self.points - 1):
            raise ValueError(f"points must be a power of 2; got {points}")

    def seen(self, core: Any, wi: Float[Array, " 3"], key: Any) -> Raw:
        return _quasi(core, wi, key, _sobol, self.points)


@final
class R2Lattice(AbstractLightRule):
    """The additive lattice of the plastic number (Roberts 2018), mapped to directions of density (N.wo)/pi.

    The key as for `Sobol`. ValueError unless the points are a multiple of 8, at least 16.
    """

    points: int = eqx.field(static=True)
    name: ClassVar[str] = "r2-lattice"
    family: ClassVar[str] = "quasi-montecarlo"
    ladder: ClassVar[tuple[Any, ...]] = _SAMPLES

    def __init__(self, points: int = 2**14):
        self.points = checked_count(points, "points", 16)
        if self.points % _SHIFTS:
            raise ValueError(f"points must be a multiple of {_SHIFTS}; got {points}")

    def seen(self, core: Any, wi: Float[Array, " 3"], key: Any) -> Raw:
        return _quasi(core, wi, key, _r2, self.points)
