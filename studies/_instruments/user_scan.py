"""The largest albedo of a family by brute force: a dense scan with a rule of its own, nothing of brdfcheck's search or engines.

Sobol points over parameters, cosine and azimuth are integrated with a coarse product rule, the best again with a finer one,
and around the best of those the points are drawn denser and denser. The rule has its pole where the BRDF is sharp: rays from
there to the horizon, nodes dense at the pole and at the azimuths where a ray grazes the horizon.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

# Nodes of a quarter turn about the pole, and along a ray.
COARSE, MEDIUM = (8, 24), (16, 40)
FINE = ((60, 144), (48, 120), (40, 96))
LEAST = 1e-9  # cosine of incidence
_KEPT, _STARTS = 128, 3  # points looked at more closely; places around which they are drawn denser


@functools.cache
def _unit_rules(turns: int, steps: int, quarters: int) -> tuple[np.ndarray, ...]:
    """Angles of turn about the pole with weights; places on [0, 1] dense at both ends, with weights; dense at 0 only."""
    x, w = np.polynomial.legendre.leggauss(turns)
    y, v = np.polynomial.legendre.leggauss(steps)
    x, w, y, v = (1 + x) / 2, w / 2, (1 + y) / 2, v / 2

    def step(x: np.ndarray, w: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return x**3 * (10 - 15 * x + 6 * x**2), w * 30 * x**2 * (1 - x) ** 2

    turn, weight = step(x, w)
    turn = np.concatenate([(quarter + turn) * np.pi / 2 for quarter in range(quarters)])
    return turn, np.tile(weight, quarters) * np.pi / 2 * (4 // quarters), *step(y, v), y**3, v * 3 * y**2


def directions(xp: Any, cosine: Any, azimuth: Any, order: tuple[int, int], *, pole: str, whole: bool) -> tuple[Any, Any, Any]:
    """wi (3,), wo (nodes, 3) and the weights of f(wi, wo) in the albedo (nodes,). `xp`: numpy or jax.numpy.

    `pole`: "mirror" or "light", where the BRDF may be sharp, or "normal" for what has kinks where both directions are equally
    high or at right angles about the normal. `whole`: the whole turn, else half of it, twice: enough for what is isotropic.
    """
    turn, turn_weight, both, both_weight, one, one_weight = _unit_rules(*order, 4 if whole else 2)
    sine = xp.sqrt((1 - cosine) * (1 + cosine))
    cos_turn, sin_turn = np.cos(turn)[:, None], np.sin(turn)[:, None]
    if pole == "normal":
        theta, rest = xp.arctan2(sine, cosine), xp.arctan2(cosine, sine)
        ray = xp.concatenate([theta * both, theta + rest * both])
        height = xp.concatenate([xp.cos(theta * both), xp.sin(rest * (1 - both))])
        weight = xp.concatenate([theta * both_weight, rest * both_weight]) * xp.sin(ray) * height * turn_weight[:, None]
        along, across = xp.sin(ray) * cos_turn, xp.sin(ray) * sin_turn
        height, side = height + 0 * along, 1.0
    else:
        longest = xp.arctan2(cosine, sine * cos_turn)
        ray = longest * one
        # The height is a sine of what is left of the ray: no cancellation at the horizon.
        height = xp.hypot(cosine, sine * cos_turn) * xp.sin(longest * (1 - one))
        along, across = xp.cos(ray) * sine + xp.sin(ray) * cos_turn * cosine, xp.sin(ray) * sin_turn
        weight = xp.sin(ray) * longest * height * turn_weight[:, None] * one_weight
        side = 1.0 if pole == "light" else -1.0
    ex, ey = side * xp.cos(azimuth), side * xp.sin(azimuth)
    wo = xp.stack([along * ex - across * ey, along * ey + across * ex, height], axis=-1)
    wi = xp.stack([sine * xp.cos(azimuth), sine * xp.sin(azimuth), cosine])
    return wi, wo.reshape(-1, 3), weight.reshape(-1)


class Rule:
    """The albedo of a family at points (parameters, cosine, azimuth), by product rules; of RGB the largest channel."""

    def __init__(self, subject: Any):
        self.subject, self.evaluations = subject, 0
        self._program = self._in_numpy if subject.numpy else self._compiled()

    def _one(self, xp: Any, row: Any, cosine: Any, azimuth: Any, order: tuple[int, int]) -> Any:
        subject = self.subject
        wi, wo, weight = directions(xp, cosine, azimuth, order, pole=subject.pole, whole=subject.anisotropic)
        values = subject.build(**dict(zip(subject.ranges, row, strict=True)))(xp.broadcast_to(wi, wo.shape), wo)
        return xp.tensordot(weight, values, axes=(0, 0))

    def _compiled(self) -> Callable[..., Any]:
        def all_of(rows: Any, cosine: Any, azimuth: Any, order: tuple[int, int]) -> Any:
            return jax.lax.map(lambda at: self._one(jnp, at[0], at[1], at[2], order), (rows, cosine, azimuth), batch_size=16)

        return jax.jit(all_of, static_argnums=3)

    def _in_numpy(self, rows: np.ndarray, cosine: np.ndarray, azimuth: np.ndarray, order: tuple[int, int]) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.array([self._one(np, *point, order) for point in zip(rows, cosine, azimuth, strict=True)])

    def __call__(self, rows: np.ndarray, cosine: np.ndarray, azimuth: np.ndarray, order: tuple[int, int]) -> np.ndarray:
        self.evaluations += (
            len(rows) * order[0] * order[1] * (4 if self.subject.anisotropic or self.subject.pole == "normal" else 2)
        )
        with jax.numpy_dtype_promotion("standard"):  # users write for it
            albedo = np.asarray(self._program(rows, cosine, azimuth, order))
        return albedo if albedo.ndim == 1 else np.max(albedo, axis=-1)

    def at(self, parameters: Mapping[str, float], cos_theta: float, azimuth: float) -> tuple[float, float]:
        """The albedo at one place by the finest rule, and how far two others are from it."""
        row = np.array([[parameters[name] for name in self.subject.ranges]])
        value, *others = (float(self(row, np.array([max(cos_theta, LEAST)]), np.array([azimuth]), order)[0]) for order in FINE)
        return value, max(abs(value - other) for other in others)


def scan(rule: Rule, points: int, rounds: int = 10) -> dict[str, Any]:
    """The largest albedo: `points` (a power of 2) over the whole box, then `rounds` of denser ones around the best.

    A record: ``value`` with the difference of three rules as its ``error``, and where. ``unbounded``: near grazing incidence,
    where it grows on towards a cosine of 0. ``nonfinite``: how many were left out.
    """
    from scipy.stats import qmc

    subject = rule.subject
    low, high = (np.array(ends) for ends in zip(*subject.ranges.values(), strict=True))
    long = (low > 0) & (high > 10 * low)
    size = len(low) + (2 if subject.anisotropic else 1)

    def places(unit: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        part = unit[:, : len(low)]
        start = np.where(long, low, 1.0)
        rows = np.where(long, start * (np.where(long, high, 1.0) / start) ** part, low + (high - low) * part)
        cosine = LEAST + (1 - LEAST) * unit[:, len(low)] ** 2
        azimuth = 2 * np.pi * unit[:, -1] if subject.anisotropic else np.zeros(len(unit))
        return np.clip(rows, low, high), cosine, azimuth

    def ranked(unit: np.ndarray, order: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
        found = rule(*places(unit), order)
        found = np.where(np.isfinite(found), found, -np.inf)
        left_out.append(int(np.sum(np.isinf(found))))
        best = np.argsort(-found, kind="stable")[:_KEPT]
        return unit[best], found[best]

    left_out: list[int] = []
    # Stretched, so that faces and corners of the box are looked at too.
    spread = np.clip(0.5 + 1.15 * (qmc.Sobol(size, scramble=False).random_base2(points.bit_length() - 1) - 0.5), 0, 1)
    best, _ = ranked(ranked(spread, COARSE)[0], MEDIUM)
    starts: list[np.ndarray] = []
    for unit in best:
        if len(starts) < _STARTS and all(np.max(np.abs(unit - start)) > 0.1 for start in starts):
            starts.append(unit)
    cloud = qmc.Sobol(size, scramble=False).random_base2(_KEPT.bit_length() - 1)
    top, place = -np.inf, spread[:1]
    for start in starts:
        center = start[None]
        for width in 0.15 * 0.6 ** np.arange(rounds):
            near = np.clip(center + width * (2 * cloud - 1), 0, 1)
            near[0] = center[0]
            around, values = ranked(near, MEDIUM)
            center = around[:1]
        if values[0] > top:
            top, place = values[0], center
    rows, cosine, azimuth = places(place)
    parameters = {name: float(value) for name, value in zip(subject.ranges, rows[0], strict=True)}
    value, error = rule.at(parameters, float(cosine[0]), float(azimuth[0]))
    unbounded = cosine[0] < 100 * LEAST and value > 1.05 * rule.at(parameters, 1000 * LEAST, float(azimuth[0]))[0]
    seen = len(spread) + len(best) + len(starts) * rounds * len(cloud)
    return {
        "value": value, "error": error, "parameters": parameters, "cos_theta": float(cosine[0]), "azimuth": float(azimuth[0]),
        "unbounded": bool(unbounded), "nonfinite": sum(left_out), "points": seen, "evaluations": rule.evaluations,
    }  # fmt: skip
