"""What a BRDF owes besides energy: reciprocity, no negative values, no NaN or Inf. On seeded pairs, and on what a scan saw."""

from __future__ import annotations

from collections.abc import Callable

import jax
import numpy as np

from brdfcheck import geometry
from brdfcheck.brdf.base import AbstractBRDF, AbstractZonalLobe
from brdfcheck.brdf.callables import BLOCK, Evaluator, in_rows
from brdfcheck.brdf.factors import Normalized
from brdfcheck.brdf.family import corners
from brdfcheck.brdf.two_sides import below_surface
from brdfcheck.numerics import unit_vectors
from brdfcheck.quadrature.albedo import lobe_values
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.quadrature.samples import TIMES
from brdfcheck.quadrature.zonal import Zonal
from brdfcheck.verdict.parts import SideChecks, Witness

# |f(wi,wo) - f(wo,wi)| may reach this share of the larger of the two: far above rounding, far below any real defect.
RECIPROCITY_LIMIT = 1e-6
_NOTHING = 1e-12  # values this far below the peak are rounding
_SCANNED_NOTHING = 1e-9  # in 1/sr: what is less negative than that in a scan is rounding
# All corners of the box up to this number, and how many times the directions are moved by their rounding.
_CORNERS = 256
_TREMORS = 6
# The cosine of both directions below which the values of a table are not compared: 84 degrees.
_STEEP = 0.1
# How far values may differ for a hint at what is wrong with them.
_HINT = 1e-3

Values = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Directions (pairs, 3) twice -> values (places, pairs) or (places, pairs, channels)."""


def direction_pairs() -> tuple[np.ndarray, np.ndarray]:
    """Pairs (wi, wo), each (pairs, 3): random, mirror, near-mirror, retro, normal, grazing and both-grazing ones."""
    random = np.random.default_rng(7)
    count = 96

    def turn() -> np.ndarray:
        return random.uniform(0, 2 * np.pi, count)

    cosine, azimuth = random.uniform(0, 1, count), turn()
    grazing = 10 ** random.uniform(-6, -2, count)
    light = unit_vectors(cosine, azimuth)
    straight = np.tile([0.0, 0.0, 1.0], (count, 1))
    nearby = np.clip(cosine + random.normal(0, 0.02, count), 1e-3, 1)
    pairs = [
        (light, unit_vectors(random.uniform(0, 1, count), turn())),
        (light, unit_vectors(cosine, azimuth + np.pi)),
        (light, unit_vectors(nearby, azimuth + np.pi + random.normal(0, 0.02, count))),
        (light, light),
        (straight, unit_vectors(random.uniform(0, 1, count), turn())),
        (straight, straight),
        (unit_vectors(grazing, azimuth), unit_vectors(random.uniform(0, 1, count), turn())),
        (unit_vectors(grazing, azimuth), straight),
        (unit_vectors(grazing, azimuth), unit_vectors(grazing[::-1], turn())),
        (unit_vectors(grazing, azimuth), unit_vectors(grazing, azimuth + np.pi)),
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
    values = lobe_values(lobes, np.where(visible, versine, 0), Zonal.chunk)
    return np.where(visible if values.ndim == 2 else visible[:, None], values, 0)


def _sampled_parameters(ranges: list[tuple[float, float]], worst: list[float]) -> np.ndarray:
    """All corners of the box, its middle, and `worst`, one row each."""
    ends = corners(ranges, _CORNERS)
    # By logarithms: the product of two large ends would overflow.
    middle = [
        float(np.exp(0.5 * np.log(low) + 0.5 * np.log(high))) if low > 0 else 0.5 * low + 0.5 * high for low, high in ranges
    ]
    inside = [min(max(value, low), high) for value, (low, high) in zip(middle, ranges, strict=True)]
    rows = np.array([*ends, inside, worst], float).reshape(len(ends) + 2, len(ranges))
    # At least four rows, so that families of the same kind share one program.
    return rows[np.minimum(np.arange(max(4, len(rows))), len(rows) - 1)]


def _function_values(evaluator: Evaluator, parameters: np.ndarray) -> Values:
    """`Values` of a function at parameters (places, swept names)."""

    def values(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        light, view = (np.tile(in_rows(part), (1, len(parameters), 1)) for part in (wi, wo))
        rows = view.shape[1] // len(parameters)
        found = evaluator.rows(np.repeat(parameters, rows, axis=0), light, view)
        return found.reshape(len(parameters), rows * BLOCK, -1)[:, : len(wi)].astype(float)

    return values


def side_checks(albedo: PointwiseAlbedo, worst: dict[str, float]) -> SideChecks:
    """Checks at all corners, in the middle of the parameters' box and at the `worst` point. May raise Finding.

    What transmits is looked at on the whole sphere. Two values of a table may be equal where they differ by less than their
    bars (see `brdfcheck.quadrature.samples`); towards grazing its samples are too far apart for a bar to mean anything.
    """
    wi, wo = direction_pairs()
    folded = albedo.family.surface is not None
    if folded:  # on one side, through the surface, on the other side
        light, view = below_surface(wi), below_surface(wo)
        wi, wo = np.concatenate([wi, wi, light]), np.concatenate([wo, view, view])
    parameters = _sampled_parameters(list(albedo.family.ranges.values()), [worst[name] for name in albedo.names])
    evaluator = albedo.reflection
    if evaluator is None:
        brdfs = albedo.brdfs(parameters)
        scale: np.ndarray | float = 1.0
        if isinstance(brdfs, Normalized):  # the lobe alone, so that all its factors share one program
            scale = np.asarray(brdfs.scale())
            brdfs = brdfs.lobe
        lobes = _zonal_values if isinstance(brdfs, AbstractZonalLobe) else _values

        def of_lobes(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
            found = np.asarray(lobes(brdfs, wi, wo))  # pyright: ignore[reportArgumentType]
            return found * (np.reshape(scale, (-1,) + (1,) * (found.ndim - 1)) if np.ndim(scale) else scale)

        values: Values = of_lobes
    else:
        parameters = np.unique(parameters, axis=0)
        swept = [albedo.names.index(name) for name in albedo.swept]
        values = _function_values(evaluator, parameters[:, swept])
    with np.errstate(all="ignore"):
        both = values(np.concatenate([wi, wo]), np.concatenate([wo, wi]))
    both = both if both.ndim == 3 else both[..., None]
    there, back = both[:, : len(wi)], both[:, len(wi) :]

    def witness(index: tuple[np.intp, ...], value: float, swapped: float | None = None) -> Witness:
        place, pair = index[0], index[1]
        return Witness(tuple(parameters[place].tolist()), tuple(wi[pair].tolist()), tuple(wo[pair].tolist()), value, swapped)

    finite = np.isfinite(there) & np.isfinite(back)
    peak = float(np.max(np.abs(both), where=np.isfinite(both), initial=0.0))
    larger = np.maximum(np.abs(there), np.abs(back))
    with np.errstate(all="ignore"):
        gap = np.where(finite & (larger > _NOTHING * peak), np.abs(there - back), 0)
        residual = np.where(gap > 0, gap / larger, 0)
    limit = max(RECIPROCITY_LIMIT, 1e3 * albedo.epsilon)
    unequal = residual > limit
    if np.any(unequal):
        unequal &= gap > limit * larger + 8 * _noise(values, wi, wo, there, back, albedo.epsilon)
        if np.any(unequal) and albedo.table is not None:
            nearest = albedo.nearest.evaluator
            assert nearest is not None
            sampled = _function_values(nearest, parameters[:, swept])(np.concatenate([wi, wo]), np.concatenate([wo, wi]))
            doubt = np.abs(both - sampled)
            doubt = doubt[:, : len(wi)] + doubt[:, len(wi) :]
            steep = np.broadcast_to((np.minimum(wi[:, 2], wo[:, 2]) > _STEEP)[:, None], larger.shape)
            # Two look-ups may agree by chance, where their lines cross: a bar is at least half of what it usually is.
            usual = np.median((doubt / np.maximum(larger, 1e-300))[steep & (larger > _NOTHING * peak)])
            unequal &= steep & (gap > TIMES * np.maximum(doubt, usual / 2 * larger))
    told = np.where(unequal, residual, 0) if np.any(unequal) else np.where(residual <= limit, residual, 0)
    where = np.unravel_index(np.argmax(told), told.shape)
    least = np.where(finite, np.minimum(there, back), np.inf)
    lowest_at = np.unravel_index(np.argmin(least), least.shape)
    minimum = float(least[lowest_at]) if np.any(finite) else float("nan")
    nothing = max(_NOTHING * max(peak, 1.0), 4 * albedo.epsilon * min(peak, 1.0))
    lowest = witness(lowest_at, minimum) if minimum < -nothing else None
    nonfinite = int(np.count_nonzero(~np.isfinite(both)))
    broken = None
    if nonfinite:
        first = np.unravel_index(np.argmax(~finite), finite.shape)
        value = float(there[first]) if not np.isfinite(there[first]) else float(back[first])
        broken = witness(first, value)
    seen = albedo.seen
    below = max(_SCANNED_NOTHING, nothing)
    if seen.smallest is not None and seen.smallest.value < -below and not seen.smallest.value >= minimum:
        minimum = seen.smallest.value
        lowest = Witness(*seen.smallest, folded=folded)
    if seen.first_nonfinite is not None:
        nonfinite += seen.nonfinite
        broken = broken or Witness(*seen.first_nonfinite, folded=folded)
    return SideChecks(
        float(told[where]),
        minimum,
        nonfinite,
        int(both.size) + seen.values,
        not bool(np.any(unequal)),
        lowest is None,
        witness(where, float(there[where]), float(back[where])) if np.any(unequal) else None,
        lowest,
        broken,
        _cosine_in(unequal, there, back, wi, wo) if np.any(unequal) else "",
    )


def _cosine_in(unequal: np.ndarray, there: np.ndarray, back: np.ndarray, wi: np.ndarray, wo: np.ndarray) -> str:
    """The direction by whose cosine values that differ must be divided to be reciprocal: "wi", "wo", or empty."""
    light, view = (np.broadcast_to(part[:, 2, None], there.shape)[unequal] for part in (wi, wo))
    there, back = there[unequal], back[unequal]
    with np.errstate(all="ignore"):
        for name, one, other in (("wi", there / light, back / view), ("wo", there / view, back / light)):
            if np.all(np.abs(one - other) <= _HINT * np.maximum(np.abs(one), np.abs(other))):
                return name
    return ""


def _noise(values: Values, wi: np.ndarray, wo: np.ndarray, there: np.ndarray, back: np.ndarray, epsilon: float) -> np.ndarray:
    """How much the values change where the directions move by their rounding.

    At grazing, wi + wo of nearly opposite directions cancels, and a BRDF that is reciprocal in exact arithmetic is not in
    floating point: there the two orders differ no more than this.
    """
    random = np.random.default_rng(9)
    noise = np.zeros_like(there)
    for _ in range(_TREMORS):
        moved_i, moved_o = (part + 4 * epsilon * random.uniform(-1, 1, part.shape) for part in (wi, wo))
        with np.errstate(all="ignore"):
            both = values(np.concatenate([moved_i, moved_o]), np.concatenate([moved_o, moved_i])).reshape(
                len(there), 2 * len(wi), -1
            )
            change = np.maximum(np.abs(both[:, : len(wi)] - there), np.abs(both[:, len(wi) :] - back))
        noise = np.maximum(noise, np.where(np.isfinite(change), change, np.inf))
    return noise
