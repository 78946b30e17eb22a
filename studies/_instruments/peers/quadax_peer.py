"""quadax: nested adaptive Gauss-Kronrod, and its adaptive cubature. Compiled once for a kind of BRDF."""

from __future__ import annotations

from typing import Any, ClassVar, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from _instruments.peers.peer import AbstractAdaptivePeer, load
from brdfcheck.quadrature.rule import NOT_REACHED, OK, Raw, light, on_sphere

# Regions that the cubature may cut the square into.
_REGIONS = 2000


def _value(core: Any, mu: Array, theta: Array, phi: Array) -> Array:
    sine, cosine = jnp.sin(theta), jnp.cos(theta)
    wo = on_sphere(sine, cosine, phi)
    return core(jnp.broadcast_to(light(mu), wo.shape), wo) * (sine * cosine)


# Evaluations of each ring, as a compiled program reports them.
_RINGS: list[int] = []


@eqx.filter_jit
def _nested(core: Any, mu: Array, tolerance: Array) -> tuple[Array, Array, Array]:
    quadgk = load("quadax").quadgk
    goal = {"epsabs": tolerance, "epsrel": tolerance}

    def ring(theta: Array) -> Array:
        value, info = quadgk(lambda phi: _value(core, mu, theta, phi), jnp.array([0, 2 * np.pi], mu.dtype), **goal)
        jax.debug.callback(lambda count: _RINGS.append(int(np.sum(count))), info.neval)
        return value

    value, info = quadgk(jnp.vectorize(ring), jnp.array([0, np.pi / 2], mu.dtype), **goal)
    return value, info.err, info.status


@eqx.filter_jit
def _cubature(core: Any, mu: Array, tolerance: Array) -> tuple[Array, Array, Array, Array]:
    square = jnp.array([[0, np.pi / 2], [0, 2 * np.pi]], mu.dtype)
    value, info = load("quadax").cubegm(
        lambda x: _value(core, mu, x[0], x[1]), square, epsabs=tolerance, epsrel=tolerance, max_nregion=_REGIONS
    )
    return value, info.err, info.neval, info.status


@final
class QuadaxNested(AbstractAdaptivePeer):
    """`quadax.quadgk` over the polar angle of `quadgk` over the azimuth."""

    name: ClassVar[str] = "quadax-nested"
    package: ClassVar[str] = "quadax"
    needs: ClassVar[str] = "a scalar function f(wi, wo) that JAX can trace"
    compiles: ClassVar[bool] = True

    def integrate(self, core: Any, mu: Float[Array, ""], key: Any) -> Raw:
        _RINGS.clear()
        with jax.numpy_dtype_promotion("standard"):
            value, error, status = _nested(core, mu, jnp.asarray(self.tolerance, mu.dtype))
        value.block_until_ready()
        jax.effects_barrier()
        return Raw(value, error, sum(_RINGS), OK if int(status) == 0 else NOT_REACHED)


@final
class QuadaxCubature(AbstractAdaptivePeer):
    """`quadax.cubegm`, adaptive Genz-Malik cubature."""

    name: ClassVar[str] = "quadax-cubature"
    package: ClassVar[str] = "quadax"
    needs: ClassVar[str] = "a scalar function f(wi, wo) that JAX can trace"
    compiles: ClassVar[bool] = True

    def integrate(self, core: Any, mu: Float[Array, ""], key: Any) -> Raw:
        with jax.numpy_dtype_promotion("standard"):
            value, error, count, status = _cubature(core, mu, jnp.asarray(self.tolerance, mu.dtype))
        return Raw(value, error, int(count), OK if int(status) == 0 else NOT_REACHED)
