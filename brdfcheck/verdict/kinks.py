"""How much a kink of the surface may hide: a crest that runs across the axes, where the surface falls along each of them."""

from __future__ import annotations

import numpy as np

from brdfcheck.verdict.surface import Surface

# How near to a kink the surface is looked at, how many times as far where nothing is seen there, and how far away at most.
_STEP, _LONGER, _FAR = 6e-5, 16, 0.05


def crest(surface: Surface, place: np.ndarray, radius: float) -> tuple[float, bool]:
    """How much higher a kink at a place may go, by the rule of a verdict, and whether one is seen. `radius`: how near it is.

    Where the surface falls on both sides along every axis, no direction d rises from it faster than the sum over all axes but
    one of |d_i| times the jump of the slope there (for the least of smooth functions: of their superadditive derivative g,
    g(d) <= g(d - d_i e_i) - g(-d_i e_i), and g <= 0 along the axis that is left: one at whose end the place lies, and which has
    no jump, or the one with the largest); and a direction is no longer than the cube.
    """
    step = max(_STEP, 5 * radius)
    bound, seen = _jumps(surface, place, step)
    if seen:
        return bound, seen
    # Where rounding is all that is seen, longer steps say more.
    farther, seen = _jumps(surface, place, _LONGER * step)
    return min(bound, farther), seen


def _jumps(surface: Surface, place: np.ndarray, step: float) -> tuple[float, bool]:
    """The bound, and whether a jump is told from rounding, by second differences at a step and at four times that.

    Curvature adds to these in proportion to the step.
    """
    dimension = len(place)
    steps = np.array([4.0, 1.0]) * step
    arms = steps[:, None, None, None] * np.array([1, -1])[:, None, None] * np.eye(dimension)
    places = place + arms  # (steps, sides, axes, dimension)
    outside = np.any((places < 0) | (places > 1), axis=-1) & ~surface.box.periodic
    free = ~np.any(outside, axis=(0, 1))
    if steps[0] > _FAR or not np.any(free):
        return np.inf, True
    asked = np.concatenate([place[None], surface.box.kept(places[:, :, free].reshape(-1, dimension))])
    value, error = surface.produce(asked, surface.rtol)
    beside, bars = (part[1:].reshape(2, 2, -1).sum(axis=1) for part in (value, error))
    jump, noise = (2 * value[0] - beside) / steps[:, None], (2 * error[0] + bars) / steps[:, None]
    sharp, rounding = 4 * jump[1] - jump[0], 4 * noise[1] + noise[0]
    largest = (np.maximum(sharp, 0) + rounding) / 3
    # Twice, because the kink may be off the place by a part of the shorter step.
    bound = 2 * float(np.sum(largest) - (np.max(largest) if np.all(free) else 0))
    return (bound if np.isfinite(bound) else np.inf), bool(np.any(sharp > rounding))
