r"""Many climbs to local maxima at a time, by quadratic models on shrinking stencils; no derivatives are asked for.

Around each climb's place the function is taken at two points an axis and one for each pair of axes, which is a quadratic
model with all its mixed terms (so that a ridge across the axes is followed, not zigzagged). The model's maximum within the
box, some parts and multiples of the step to it, and the stencil itself are the next places to go. The stencil shrinks with
the steps, as in implicit filtering (Kelley 2011), so the model becomes exact where the function is smooth, and a kink is
closed in on where it is not.

A value costs 10 to 20 ns a node here, and a gradient by automatic differentiation 1 to 4 s of compilation: the models were
measured to be cheaper in up to eight dimensions, and they serve numpy functions and finite accuracy alike.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from brdfcheck.numerics import Columns
from brdfcheck.verdict.box import Box

Function = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Points of the unit cube (points, dimension) -> values, and how far each may be off."""

# Multiples of the model's step that are tried.
_TRIALS = np.array([1.0, 0.3, 3.0, 9.0])
# A stencil that leaves less than this part of its arm inside the box is folded back into it.
_FOLD = 0.3
# Differences of values below this part of their error bars say nothing; a stencil that sees no others is made larger first,
# so many times and up to that size. (Error bars are wide: neighbouring values err alike.)
_NOISE = 0.1
_LARGER, _LARGEST = 3, 0.02
# What a crest may still gain that runs across the axes, relative to the value.
CREST = 2e-3
# In how many rounds the curvature must grow as stencils shrink, in differences above this, for a kink to be one.
_KINK_ROUNDS, _SHARP = 3, 1e-8
# Stencils so small that a smooth surface is flat across them.
_SMALL = 1e-7


@dataclass
class Climbs(Columns):
    """Where climbs ended. `gaps`: how much higher their maxima may still be; `settled`: that this is known to be little."""

    places: np.ndarray  # (climbs, dimension)
    values: np.ndarray
    errors: np.ndarray
    gaps: np.ndarray
    radii: np.ndarray
    settled: np.ndarray
    mixed: np.ndarray  # second derivatives, (climbs, dimension, dimension)
    kinked: np.ndarray  # that the place lies on a kink, with other directions to go

    @property
    def known_gaps(self) -> np.ndarray:
        """The gaps, 0 where no model has told any."""
        return np.where(np.isfinite(self.gaps), self.gaps, 0)


@dataclass
class Trail(Columns):
    """Where climbs were when they went on to the next rule, and how high by that: (climbs, dimension) and (climbs,)."""

    places: np.ndarray
    values: np.ndarray


def climb(
    function: Function,
    box: Box,
    starts: np.ndarray,
    radii: np.ndarray | float,
    *,
    goal: float,
    rounds: int,
    smallest: float,
    mixed: np.ndarray | None = None,
    drop: float = np.inf,
    calm: int = 2,
    reach: float = np.inf,
    crest: float = CREST,
    check: Callable[[], None] = lambda: None,
) -> Climbs:
    """Climb from each of `starts` (climbs, dimension), with stencils of `radii` at first.

    `goal`: the gain below which a maximum counts as reached, relative to max(|value|, 1); `smallest`: where stencils stop to
    shrink; `mixed`: mixed second derivatives (climbs, dimension, dimension) that are known, which saves the points for them;
    `drop`: how far below the best a climb is given up; `calm`: after how many rounds with little to gain it has ended; `reach`:
    how far from its start a climb goes, about, before it is stopped; `crest`: what a crest across the axes may still gain where
    there is a kink; `check` is called once a round.
    """
    count, dimension = starts.shape
    value, error = function(starts)
    state = Climbs(
        starts.copy(),
        value,
        error,
        np.full(count, np.inf),
        np.broadcast_to(np.asarray(radii, float), (count,)).copy(),
        np.zeros(count, bool),
        np.zeros((count, dimension, dimension)),
        np.zeros(count, bool),
    )
    if dimension == 0:
        state.gaps[:] = 0
        state.settled[:] = True
        return state
    curvature = np.full((count, dimension), np.nan)
    bends = np.zeros(count, int)
    quiet, grown = np.zeros(count, int), np.zeros(count, int)
    active = np.isfinite(state.values)
    for turn in range(rounds):
        check()
        best = np.max(state.values[active], initial=-np.inf)
        gap = np.where(np.isfinite(state.gaps), state.gaps, np.inf)
        active &= ~(state.values + 5 * gap < best - drop * max(abs(best), 1e-300))
        which = np.flatnonzero(active)
        if not which.size:
            break
        model = _Model(function, box, state, which, mixed, turn)
        step, gain = model.step()
        trials = box.kept(state.places[which][:, None] + step[:, None] * _TRIALS[:, None])
        found, uncertain = function(trials.reshape(-1, dimension))
        places = np.concatenate([model.points, trials], axis=1)
        values = np.concatenate([model.values, found.reshape(len(which), -1)], axis=1)
        errors = np.concatenate([model.errors, uncertain.reshape(len(which), -1)], axis=1)
        values = np.where(np.isnan(values), -np.inf, values)
        pick = np.argmax(values, axis=1)
        rows = np.arange(len(which))
        top = values[rows, pick]
        before, radius = state.values[which], state.radii[which]
        improved = top > before
        moved = np.max(np.abs(box.apart(places[rows, pick], state.places[which])), axis=1)
        state.places[which] = np.where(improved[:, None], places[rows, pick], state.places[which])
        state.values[which] = np.where(improved, top, before)
        state.errors[which] = np.where(improved, errors[rows, pick], state.errors[which])
        scale = np.maximum(np.abs(state.values[which]), 1)
        # What a kink would still hide: there the curvature grows as the stencil shrinks.
        unknown = np.any(np.isnan(curvature[which]), axis=1)
        bend = np.where(np.isnan(curvature[which]) | model.pressed, 0, np.abs(model.second - curvature[which]))
        curvature[which] = model.second
        state.mixed[which] = model.hessian
        kink = np.sum(bend, axis=1) * radius**2 / 4
        free = ~model.pressed & (model.rises > np.maximum(5 * state.errors[which], _SHARP * scale)[:, None])
        bent = np.any(free & (bend * radius[:, None] ** 2 > 0.4 * model.rises), axis=1)
        # A crest across the axes may rise where no axis does: a stencil of any size says nothing of that.
        bends[which] += bent & (np.count_nonzero(free, axis=1) > 1)
        state.kinked[which] = bends[which] >= _KINK_ROUNDS
        # A small stencil over a jump is steep without end: it promises no more than some of its own differences.
        promised = np.minimum(np.maximum(gain, kink), np.where(radius < 1e-3, 10 * model.spread, np.inf))
        hidden = np.where(state.kinked[which], crest * np.maximum(np.abs(state.values[which]), 1), 0)
        # A kink between the nodes of the smallest stencils is no higher than the surface falls across them.
        sides = np.where(radius < _SMALL, np.max(np.where(model.pressed, 0, model.rises), axis=1), 0)
        state.gaps[which] = np.maximum(promised + np.maximum(top - before, 0), np.maximum(hidden, sides))
        reached = np.maximum(goal * scale, 0.02 * state.errors[which])
        flat = model.spread <= np.maximum(_NOISE * state.errors[which], 4e-15 * scale)
        small_stencil = flat & (radius < _LARGEST) & (grown[which] < _LARGER)
        flat &= ~small_stencil
        grown[which] += small_stencil
        quiet[which] = np.where((state.gaps[which] <= reached) & ~small_stencil, quiet[which] + 1, 0)
        state.gaps[which] = np.where(flat, np.minimum(state.gaps[which], model.spread), state.gaps[which])
        # One stencil alone cannot tell a kink from a smooth crest.
        state.settled[which] = flat | ((quiet[which] >= calm) & (~unknown | (model.spread <= reached)))
        shrunk = np.where(improved, np.clip(1.5 * moved, radius / 6, 3 * radius), radius / 5)
        state.radii[which] = np.minimum(np.where(small_stencil, 5 * radius, shrunk), min(0.25, reach))
        small = state.radii[which] < smallest
        gone = box.distance(state.places[which], starts[which]) > reach
        state.settled[which] &= ~gone
        active[which] = ~(state.settled[which] | small | gone)
    return state


class _Model:
    """Quadratic models around some climbs: `points` (climbs, stencil, dimension), `values`, `second` derivatives an axis."""

    def __init__(self, function: Function, box: Box, state: Climbs, which: np.ndarray, mixed: np.ndarray | None, turn: int):
        self.box = box
        self.center = state.places[which]
        self.radius = state.radii[which]
        count, dimension = self.center.shape
        up = np.where(box.periodic, np.inf, 1 - self.center)
        down = np.where(box.periodic, np.inf, self.center)
        r = self.radius[:, None]
        first = np.where(up >= r, r, np.where(up >= _FOLD * r, up, -r))
        second = np.where(down >= r, -r, np.where(down >= _FOLD * r, -down, r))
        # Both arms on one side: one of them is half as long.
        second = np.where(first == second, second / 2, second)
        pairs = (
            np.array([(i, j) for i in range(dimension) for j in range(i)], int).reshape(-1, 2)
            if mixed is None
            else np.zeros((0, 2), int)
        )
        offsets = np.zeros((count, 2 * dimension + len(pairs), dimension))
        axes = np.arange(dimension)
        offsets[:, axes, axes] = first
        offsets[:, dimension + axes, axes] = second
        # In every other round the pairs go across the diagonal: along a crest that runs there and is seen in no other way.
        other = first if turn % 2 == 0 else second
        for row, (i, j) in enumerate(pairs):
            offsets[:, 2 * dimension + row, i] = first[:, i]
            offsets[:, 2 * dimension + row, j] = other[:, j]
        self.points = box.kept(self.center[:, None] + offsets)
        values, errors = function(self.points.reshape(-1, dimension))
        self.values, self.errors = values.reshape(count, -1), errors.reshape(count, -1)
        base = state.values[which][:, None]
        rise = np.where(np.isfinite(self.values), self.values - base, -1.0)
        a, b = first, second
        at_a, at_b = rise[:, :dimension], rise[:, dimension : 2 * dimension]
        at_other = at_a if turn % 2 == 0 else at_b
        self.gradient = (at_a * b**2 - at_b * a**2) / (a * b * (b - a))
        self.second = 2 * (at_a * b - at_b * a) / (a * b * (a - b))
        self.hessian = np.zeros((count, dimension, dimension)) if mixed is None else mixed[which].copy()
        self.hessian[:, axes, axes] = self.second
        for row, (i, j) in enumerate(pairs):
            cross = (rise[:, 2 * dimension + row] - at_a[:, i] - at_other[:, j]) / (a[:, i] * other[:, j])
            self.hessian[:, i, j] = self.hessian[:, j, i] = cross
        self.spread = np.max(np.abs(rise[:, : 2 * dimension]), axis=1)
        self.rises = np.maximum(np.abs(at_a), np.abs(at_b))
        # Axes along which the climb presses against the end of the box, and falls inwards.
        self.pressed = ((up <= 0) | (down <= 0)) & (at_a <= 0) & (at_b <= 0)

    def step(self) -> tuple[np.ndarray, np.ndarray]:
        """The step to the model's maximum near the stencil, and how much the model still promises within the box."""
        near = self._ascent(3 * self.radius)
        far = self._ascent(np.full(len(self.radius), 0.5))
        return near, np.maximum(self._gain(near), np.minimum(self._gain(far), 2 * self._bound(far)))

    def _gain(self, step: np.ndarray) -> np.ndarray:
        curved = np.einsum("ci,cij,cj->c", step, self.hessian, step)
        return np.maximum(np.einsum("ci,ci->c", self.gradient, step) + 0.5 * curved, 0)

    def _bound(self, step: np.ndarray) -> np.ndarray:
        """What the gradient alone promises along the step."""
        return np.maximum(np.einsum("ci,ci->c", self.gradient, step), 0)

    def _ascent(self, limit: np.ndarray) -> np.ndarray:
        """Newton's step for the model, made to climb, within `limit` of the centre and within the box."""
        periodic = self.box.periodic
        low = np.maximum(-limit[:, None], np.where(periodic, -np.inf, -self.center))
        high = np.minimum(limit[:, None], np.where(periodic, np.inf, 1 - self.center))
        step = np.zeros_like(self.gradient)
        fixed = np.zeros(step.shape, bool)
        for _ in range(3):
            slope = self.gradient + np.einsum("cij,cj->ci", self.hessian, np.where(fixed, step, 0))
            fixed |= ((high <= 0) & (slope > 0)) | ((low >= 0) & (slope < 0))
            free = ~fixed
            matrix = self.hessian * free[:, :, None] * free[:, None, :]
            eigenvalues, vectors = np.linalg.eigh(matrix)
            slope = np.where(free, slope, 0)
            along = np.einsum("cji,cj->ci", vectors, slope)
            size = np.abs(eigenvalues)
            least = np.maximum(1e-8 * np.max(size, axis=1), np.max(np.abs(slope), axis=1) / np.maximum(8 * limit, 1e-300))
            newton = np.einsum("cij,cj->ci", vectors, along / np.maximum(np.maximum(size, least[:, None]), 1e-300))
            step = np.where(free, newton, step)
            out = free & ((step > high) | (step < low))
            step = np.clip(step, low, high)
            if not np.any(out):
                break
            fixed |= out
        return step
