"""The albedo of a family of BRDFs at scattered points (parameters, cosine, azimuth), whatever engine it needs.

Requests are padded to one fixed size, so a class of lobes compiles one program, whatever its factor and its ranges.
For RGB families the value at a point is that of the worst channel.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import islice, product
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf import AbstractZonalLobe
from brdfcheck.callables import Evaluator
from brdfcheck.directional import adaptive_albedo, has_engine, paired_lobes, peel
from brdfcheck.family import Family

CHUNK = 256
_CHUNK_2D = 64


class PointwiseAlbedo:
    """Callable: (parameters (points, names), cos_theta (points,), azimuth (points,)) -> value, error, both (points,).

    `engine` names the engine, `anisotropic` says whether the azimuth matters, `evaluations` counts the BRDF's evaluations,
    `channel` is the worst channel of the last call (None for scalar BRDFs). Raises Finding where a user's BRDF fails.
    """

    def __init__(self, family: Family):
        self.family = family
        self.names = tuple(family.ranges)
        self.evaluations = 0
        self.anisotropic = False
        middle = {name: (low + high) / 2 for name, (low, high) in family.ranges.items()}
        self._template = self._abstract(middle)
        self.evaluator: Evaluator | None = None
        if self._template is None:
            self.evaluator = Evaluator(family.build, middle)
            self.engine = "adaptive (numpy)" if self.evaluator.slow else "adaptive"
            self.anisotropic = any(
                _turns_with_the_surface(self.evaluator.bind(dict(zip(self.names, place, strict=True))))
                for place in _places(family)
            )
        else:
            core = peel(self._template)[0]
            self.engine = "zonal" if isinstance(core, AbstractZonalLobe) else "half-vector"

    def _abstract(self, middle: dict[str, float]) -> Any:
        """The BRDF's structure where engines 1 and 2 can take it, else None."""
        try:
            brdf = eqx.filter_eval_shape(
                self.family.build, **{name: jnp.asarray(value, float) for name, value in middle.items()}
            )
        except Exception:  # the factory needs numbers: engine 3 decides
            return None
        return brdf if has_engine(brdf) else None

    @property
    def fast(self) -> bool:
        """True where a point costs microseconds (engines 1 and 2) rather than an adaptive integral."""
        return self.evaluator is None

    def brdfs(self, parameters: np.ndarray) -> Any:
        """The family's members at `parameters` (points, names) as one BRDF with batched leaves (engines 1 and 2)."""
        if not self.names:
            brdf = self.family.build()
            return jax.tree.map(lambda leaf: np.broadcast_to(leaf, (len(parameters), *np.shape(leaf))), brdf)
        columns = {name: parameters[:, i] for i, name in enumerate(self.names)}
        return jax.tree.map(np.asarray, jax.vmap(lambda values: self.family.build(**values))(columns))

    def __call__(
        self, parameters: np.ndarray, cos_theta: np.ndarray, azimuth: np.ndarray, *, rtol: float | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        if self.evaluator is None:
            value, error = self._engines(parameters, cos_theta, rtol)
        else:
            value, error = self._adaptive(self.evaluator, parameters, cos_theta, azimuth, rtol or 1e-8)
        if value.ndim == 1:
            return value, error
        worst = np.argmax(np.where(np.isnan(value), np.inf, value), axis=-1)[:, None]
        return np.take_along_axis(value, worst, -1)[:, 0], np.take_along_axis(error, worst, -1)[:, 0]

    def _engines(self, parameters: np.ndarray, cos_theta: np.ndarray, rtol: float | None) -> tuple[np.ndarray, np.ndarray]:
        core = peel(self._template)[0]
        chunk = CHUNK if self.engine == "zonal" else _CHUNK_2D
        padding = (0, -len(cos_theta) % chunk)
        mu = np.pad(cos_theta, padding, mode="edge")
        brdfs = self.brdfs(np.pad(parameters, (padding, (0, 0)), mode="edge"))
        values, errors = [], []
        for start in range(0, len(mu), chunk):
            rows = slice(start, start + chunk)
            part = jax.tree.map(lambda leaf, rows=rows: leaf[rows], brdfs)
            value, error, count = paired_lobes(peel(part)[0], mu[rows], rtol)
            self.evaluations += min(chunk, len(cos_theta) - start) * count
            if core is not self._template:
                with np.errstate(all="ignore"):
                    # In numpy, not in a program: there would be one for each lobe and factor.
                    scale = np.asarray(peel(part)[1](mu[rows]))
                    scale = scale.reshape(scale.shape + (1,) * (value.ndim - 1))
                    value, error = value * scale, error * np.abs(scale)
            values.append(value)
            errors.append(error)
        return np.concatenate(values)[: len(cos_theta)], np.concatenate(errors)[: len(cos_theta)]

    def _adaptive(
        self, evaluator: Evaluator, parameters: np.ndarray, cos_theta: np.ndarray, azimuth: np.ndarray, rtol: float
    ) -> tuple[np.ndarray, np.ndarray]:
        values, errors = [], []
        for row, mu, turn in zip(parameters, cos_theta, azimuth, strict=True):
            bound = evaluator.bind({name: float(value) for name, value in zip(self.names, row, strict=True)})
            result = adaptive_albedo(bound, mu, turn, rtol, max_evaluations=_budget(rtol))
            self.evaluations += int(result.evaluations)
            values.append(np.asarray(result.value))
            errors.append(np.asarray(result.error))
        return np.asarray(values), np.asarray(errors)


def _places(family: Family) -> list[tuple[float, ...]]:
    """Where a family is asked whether it is anisotropic: at corners, in the middle and off it (some are isotropic there)."""
    ranges = list(family.ranges.values())
    inside = [tuple(low + part * (high - low) for low, high in ranges) for part in (0.5, 0.37)]
    return list(dict.fromkeys([*islice(product(*ranges), 8), *inside]))


def _budget(rtol: float) -> int:
    """Evaluations that one adaptive integral may cost. What jumps never reaches an accuracy; a look-around must end."""
    return 150_000 if rtol >= 1e-6 else 600_000 if rtol >= 5e-8 else 3_000_000


def _turns_with_the_surface(evaluate: Callable[[np.ndarray, np.ndarray], np.ndarray]) -> bool:
    """True where f changes when both directions turn about N together, on seeded pairs: an anisotropic BRDF."""
    random = np.random.default_rng(20)
    count = 96
    cosines = random.uniform(0.05, 1, (2, count))
    # Half of the pairs are near the mirror direction, where a sharp lobe is not zero.
    cosines[1, ::2] = np.clip(cosines[0, ::2] + random.normal(0, 0.05, count // 2), 0.02, 1)
    azimuths = random.uniform(0, 2 * np.pi, (2, count))
    azimuths[1, ::2] = azimuths[0, ::2] + np.pi + random.normal(0, 0.05, count // 2)
    turn = random.uniform(0.2, 2 * np.pi - 0.2, count)

    def directions(cosine: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
        sine = np.sqrt((1 - cosine) * (1 + cosine))
        return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)

    first = evaluate(directions(cosines[0], azimuths[0]), directions(cosines[1], azimuths[1]))
    second = evaluate(directions(cosines[0], azimuths[0] + turn), directions(cosines[1], azimuths[1] + turn))
    with np.errstate(all="ignore"):
        scale = np.maximum(np.abs(first), np.abs(second))
        return bool(np.any(np.abs(first - second) > 1e-6 * scale + 1e-12 * np.max(scale, where=~np.isnan(scale), initial=0)))
