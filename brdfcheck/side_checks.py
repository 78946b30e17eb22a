"""What a BRDF owes besides energy: reciprocity, no negative values, no NaN or Inf. On seeded pairs of directions."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import jax
import numpy as np

from brdfcheck import geometry
from brdfcheck.brdf import AbstractBRDF, AbstractZonalLobe
from brdfcheck.directional import lobe_values
from brdfcheck.factors import Normalized
from brdfcheck.pointwise import CHUNK, PointwiseAlbedo

# |f(wi,wo) - f(wo,wi)| may reach this share of the larger of the two: far above rounding, far below any real defect.
RECIPROCITY_LIMIT = 1e-6
_NOTHING = 1e-12  # values this far below the peak are rounding


@dataclass(frozen=True)
class SideChecks:
    """Over the seeded pairs and the sampled parameters.

    `reciprocity`: largest |f(wi,wo) - f(wo,wi)| relative to the larger value; `minimum`: smallest value in 1/sr;
    `nonfinite`: how many values are NaN or Inf; `pairs`: how many values were looked at.
    """

    reciprocity: float
    minimum: float
    nonfinite: int
    pairs: int
    reciprocal: bool
    positive: bool

    @property
    def passed(self) -> bool:
        """True where the BRDF is reciprocal, nowhere negative and everywhere finite."""
        return self.reciprocal and self.positive and self.nonfinite == 0


def direction_pairs() -> tuple[np.ndarray, np.ndarray]:
    """Pairs (wi, wo), each (pairs, 3): random, mirror, near-mirror, retro, normal, grazing and both-grazing ones."""
    random = np.random.default_rng(7)
    count = 96

    def unit(cosine: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
        sine = np.sqrt((1 - cosine) * (1 + cosine))
        return np.stack([sine * np.cos(azimuth), sine * np.sin(azimuth), cosine], axis=-1)

    def turn() -> np.ndarray:
        return random.uniform(0, 2 * np.pi, count)

    cosine, azimuth = random.uniform(0, 1, count), turn()
    grazing = 10 ** random.uniform(-6, -2, count)
    light = unit(cosine, azimuth)
    straight = np.tile([0.0, 0.0, 1.0], (count, 1))
    nearby = np.clip(cosine + random.normal(0, 0.02, count), 1e-3, 1)
    pairs = [
        (light, unit(random.uniform(0, 1, count), turn())),
        (light, unit(cosine, azimuth + np.pi)),
        (light, unit(nearby, azimuth + np.pi + random.normal(0, 0.02, count))),
        (light, light),
        (straight, unit(random.uniform(0, 1, count), turn())),
        (straight, straight),
        (unit(grazing, azimuth), unit(random.uniform(0, 1, count), turn())),
        (unit(grazing, azimuth), straight),
        (unit(grazing, azimuth), unit(grazing[::-1], turn())),
        (unit(grazing, azimuth), unit(grazing, azimuth + np.pi)),
    ]
    return np.concatenate([wi for wi, _ in pairs]), np.concatenate([wo for _, wo in pairs])


@jax.jit
def _values(brdfs: AbstractBRDF, wi: jax.Array, wo: jax.Array) -> jax.Array:
    return jax.vmap(lambda brdf: brdf(wi, wo))(brdfs)


@jax.jit
def _versines(wi: jax.Array, wo: jax.Array) -> dict[str, jax.Array]:
    return {"mirror": geometry.mirror_versine(wi, wo), "half": geometry.half_versine(wi, wo)}


def _zonal_values(lobes: AbstractZonalLobe, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
    """What a call of the lobes gives, put together from their geometry and their profile."""
    versine = np.asarray(_versines(wi, wo)[lobes.form])
    visible = versine < 1 if lobes.form == "mirror" else np.ones(len(versine), bool)
    values = lobe_values(lobes, np.where(visible, versine, 0), CHUNK)
    return np.where(visible if values.ndim == 2 else visible[:, None], values, 0)


def _sampled_parameters(ranges: list[tuple[float, float]], worst: list[float]) -> np.ndarray:
    corners = list(product(*((low, high) for low, high in ranges)))[:8]
    middle = [float(np.sqrt(low * high)) if low > 0 else (low + high) / 2 for low, high in ranges]
    rows = np.array([*corners, middle, worst], float).reshape(len(corners) + 2, len(ranges))
    # A fixed number of rows, so that families of the same kind share one program.
    return rows[np.minimum(np.arange(max(4, len(rows))), len(rows) - 1)]


def side_checks(albedo: PointwiseAlbedo, worst: dict[str, float]) -> SideChecks:
    """Checks at the corners and the middle of the parameters' box and at the `worst` point. May raise Finding."""
    wi, wo = direction_pairs()
    parameters = _sampled_parameters(list(albedo.family.ranges.values()), [worst[name] for name in albedo.names])
    if albedo.evaluator is None:
        brdfs = albedo.brdfs(parameters)
        scale: np.ndarray | float = 1.0
        if isinstance(brdfs, Normalized):  # the lobe alone, so that all its factors share one program
            scale = np.asarray(brdfs.scale())
            brdfs = brdfs.lobe
        values = _zonal_values if isinstance(brdfs, AbstractZonalLobe) else _values
        both = np.asarray(values(brdfs, np.concatenate([wi, wo]), np.concatenate([wo, wi])))  # pyright: ignore[reportArgumentType]
        there, back = both[:, : len(wi)], both[:, len(wi) :]
        scale = np.reshape(scale, (-1,) + (1,) * (there.ndim - 1)) if np.ndim(scale) else scale
        there, back = there * scale, back * scale
    else:
        rows = [dict(zip(albedo.names, row, strict=True)) for row in np.unique(parameters, axis=0)]
        bound = [albedo.evaluator.bind(row) for row in rows]
        there = np.stack([evaluate(wi, wo) for evaluate in bound])
        back = np.stack([evaluate(wo, wi) for evaluate in bound])
    finite = np.isfinite(there) & np.isfinite(back)
    nonfinite = int(np.sum(~np.isfinite(there)) + np.sum(~np.isfinite(back)))
    there, back = np.where(finite, there, 0), np.where(finite, back, 0)
    peak = float(np.max(np.abs(there), initial=0.0))
    larger = np.maximum(np.abs(there), np.abs(back))
    with np.errstate(all="ignore"):
        residual = np.where(larger > _NOTHING * peak, np.abs(there - back) / larger, 0)
    worst_residual = float(np.max(residual, initial=0.0))
    minimum = float(np.min(np.minimum(there, back), where=finite, initial=np.inf)) if np.any(finite) else float("nan")
    return SideChecks(
        worst_residual,
        minimum,
        nonfinite,
        int(there.size + back.size),
        worst_residual <= RECIPROCITY_LIMIT,
        minimum >= -_NOTHING * max(peak, 1.0),
    )
