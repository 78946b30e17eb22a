"""Mitsuba 3: the mean weight of its own sampling of a rough conductor, in the variant that this machine can run."""

from __future__ import annotations

import math
from typing import Any, ClassVar, final

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from _instruments.peers.peer import AbstractPeer, load
from brdfcheck.brdf.microfacet import GGX, CookTorrance
from brdfcheck.brdf.readers.mitsuba.runtime import variant
from brdfcheck.quadrature.rule import Raw

_LARGEST_SCALAR = 2**16


@final
class MitsubaSampling(AbstractPeer):
    """The mean of what Mitsuba's `roughconductor.sample` returns; the error is its standard error.

    For Beckmann and GGX metal with F = 1 and separable Smith masking.
    """

    samples: int = eqx.field(static=True)
    name: ClassVar[str] = "mitsuba"
    package: ClassVar[str] = "mitsuba"
    ladder: ClassVar[tuple[Any, ...]] = (2**6, 2**8, 2**10, 2**12, 2**14, 2**16, 2**18)
    needs: ClassVar[str] = "Beckmann or GGX metal with F = 1 and masking='smith-separable'"
    random: ClassVar[bool] = True

    def __init__(self, samples: int = 2**14):
        self.samples = samples

    def applies(self, core: Any, cos_theta: Any) -> bool:
        if isinstance(core, CookTorrance):
            plain = not core.m.ndim and core.convention == "correct" and bool(np.all(np.asarray(core.weights) == 1))
        else:
            plain = isinstance(core, GGX)
        return plain and core.f0 is None and core.masking == "smith-separable"

    def integrate(self, core: Any, mu: Float[Array, ""], key: Any) -> Raw:
        name, _ = variant()
        mitsuba = load("mitsuba")
        beckmann = isinstance(core, CookTorrance)
        bsdf = mitsuba.load_dict(
            {
                "type": "roughconductor",
                "distribution": "beckmann" if beckmann else "ggx",
                "alpha": float(core.m if beckmann else core.alpha),
                "material": "none",
            }
        )
        # Two uniforms a sample, from the key: Mitsuba computes in single precision.
        u = np.asarray(jax.random.uniform(key, (2, self.samples), jnp.float32))
        wi = [math.sqrt((1 - float(mu)) * (1 + float(mu))), 0.0, float(mu)]
        context = mitsuba.BSDFContext()
        surface = mitsuba.SurfaceInteraction3f()
        surface.wi = wi
        if name.startswith("llvm"):
            _, weight = bsdf.sample(context, surface, 0.5, mitsuba.Point2f(mitsuba.Float(u[0]), mitsuba.Float(u[1])))
            weights = np.array(weight[0]).astype(float)
        else:
            if self.samples > _LARGEST_SCALAR:
                raise ValueError(f"the scalar variant takes at most {_LARGEST_SCALAR} samples; {variant()[1]}")
            weights = np.array([bsdf.sample(context, surface, 0.5, pair)[1][0] for pair in u.T.tolist()], dtype=float)
        weights = np.broadcast_to(weights, (self.samples,))
        return Raw(weights.mean(), weights.std(ddof=1) / math.sqrt(self.samples), self.samples)
