r"""The multiple-scattering compensation of Kulla and Conty (2017), as a renderer has it: looked up in a table.

What a lobe with F = 1 loses, light that leaves after more than one bounce, comes back as

$f_{ms}(\omega_i, \omega_o) = \frac{(1 - E(\mu_i))\,(1 - E(\mu_o))}{\pi\,(1 - E_{avg})}$,

whose albedo is 1 - E where E and its average are exact. With E looked up linearly between nodes, as $\hat E$, and the average
taken of $\hat E$ itself, the albedo of both together is exactly $1 + E - \hat E$: above 1 wherever the table lies below the
albedo, that is where this is convex upwards. So the compensation has a table of its own, raised at each node by as much as E
exceeds the look-up in the cells around it; then it conserves, and what it still loses is measured.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from brdfcheck.brdf.family import Family
from brdfcheck.fits.grids import Sampler
from brdfcheck.fits.renderer import RendererTable, cells
from brdfcheck.messages import UsageError
from brdfcheck.runtime import double_precision
from brdfcheck.verdict.checking import check_family
from brdfcheck.verdict.report import Verdict

Lookup = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""A number for each of some parameters and cosines (points,)."""

SMALLEST = 1e-6
"""What 1 less the average is at least: where nothing is lost a renderer divides nothing by something, in float32 too."""
# What has no albedo where its range begins (facets of no roughness) is covered from this part of the way to the first node on.
_BEGINS = 0.1
# A cell is divided until what it holds differs from a parabola by no more than this, or this part of what is missed; so often
# at most. Of functions a value is dear: there more is allowed for instead.
_LOBES, _FUNCTIONS = (5e-6, 0.1, 6), (2e-4, 0.3, 3)
# How often nodes are raised at most, for points that lie lower by more than this.
_RAISED, _ROUNDING = 100, 1e-12
# From values at 0, 1/2 and 1 those of a parabola at 0, 1/4, ... 1.
_PARABOLA = np.array([[1, 0, 0], [0.375, 0.75, -0.125], [0, 1, 0], [-0.125, 0.75, 0.375], [0, 0, 1]])
# The accuracy that is asked of functions where nothing is said.
_SEARCHED = 1e-6


@dataclass(frozen=True)
class Compensation:
    """`energy`: the raised table of E (parameter, cos_theta), `average`: its averages (parameter,), to be looked up linearly.

    Both are numbers of float32. `returned` are the averages of `energy`, which `average` may lie below. `family`: the target
    over all of the range that the table covers. `excess`: by how much the albedo would exceed 1 with the table of E as it is;
    `loss`: how much is still lost with the raised one, at most on the grid of `cover`.
    """

    nodes: Float[np.ndarray, " parameter"]
    cos_theta: Float[np.ndarray, " cos_theta"]
    energy: Float[np.ndarray, "parameter cos_theta"]
    average: Float[np.ndarray, " parameter"]
    returned: Float[np.ndarray, " parameter"]
    excess: float
    loss: float
    cover: Cover
    family: Family

    def __call__(self, parameter: np.ndarray, mu: np.ndarray) -> np.ndarray:
        """The albedo of what is added, with linear look-ups: exact."""
        returned, divisor = (1 - np.interp(parameter, self.nodes, part) for part in (self.returned, self.average))
        return (1 - looked_up(self.nodes, self.cos_theta, self.energy, parameter, mu)) * returned / divisor


def compensation(table: RendererTable, rtol: float | None = None, row: Callable[[], None] = lambda: None) -> Compensation:
    """The compensation of a table's target, which must have a Fresnel term of 1 where it has one.

    `rtol` and `row` as for `cells`. UsageError where the target's Fresnel term is not 1, where not all angles are looked at, or
    where the search of `check` finds an albedo above 1: then nothing is lost.
    """
    found, grid = table.sources, table.grid
    name = found.family.name
    if found.white is not None and found.white is not found.family:
        raise UsageError(f"{name}: the compensation is that of facets with F = 1; hold F0 at 1, or leave the Fresnel term out")
    if table.average is None:
        raise UsageError(f"{name}: the compensation needs all angles of incidence; leave --cos-theta out")
    with double_precision():
        family = covered(table)
        exact = Sampler(family, None).albedo.fast
        judged = check_family(family, rtol=None if exact else _SEARCHED, intervals=False, effort="quick")
        if judged.verdict is Verdict.VIOLATES:
            place = ", ".join(f"{key}={value:g}" for key, value in judged.parameters.items() if key in family.ranges)
            raise UsageError(
                f"{name}: the albedo is {judged.albedo:.6g} at {place}, cos_theta={judged.cos_theta:g}: above 1 there is no"
                " loss to compensate"
            )
        known = Cover(
            family,
            grid.nodes,
            grid.cos_theta,
            lambda parameter, mu: looked_up(grid.nodes, grid.cos_theta, grid.values, parameter, mu),
            rtol,
            row,
        )
        energy = _float32(raised(grid.nodes, grid.cos_theta, grid.values + grid.errors, known), np.inf)
        returned = averages(grid.cos_theta, energy)
        average = _float32(np.minimum(returned, 1 - SMALLEST), -np.inf)
        made = Compensation(
            grid.nodes, grid.cos_theta, energy, average, returned, float(np.max(known.missed)), 0.0, known, family
        )
        return replace(made, loss=known.loss(made))


def covered(table: RendererTable) -> Family:
    """The target of a table over all of its range; where it is nothing at the beginning, from a tenth of the first node on."""
    ((name, (begins, high)),), low = table.sources.family.ranges.items(), table.bounds[0]
    return replace(table.sources.family, ranges={name: (low + _BEGINS * (begins - low), high)})


class Cover:
    """A family's albedo in all cells between nodes, as points that say what it is in each cell, in which it is smooth.

    The axes are divided at the nodes and at the ends of the ranges, `parameter` and `mu` are the sides and middles of the
    cells, `values` the albedos there, `missed` by how much they with their bars exceed the approximation. Cells in which it may
    be missed elsewhere are divided until a parabola says what the next values are. `seen` are parameters and cosines
    (points, 2) of all albedos that were looked at, and what these are with their bars; `points` and `upper` are these and
    more, for what lies between.
    """

    def __init__(
        self,
        family: Family,
        nodes: np.ndarray,
        cos_theta: np.ndarray,
        approximation: Lookup,
        rtol: float | None,
        row: Callable[[], None] = lambda: None,
    ):
        ((low, high),) = family.ranges.values()
        self._approximation, self._sampler = approximation, Sampler(family, rtol)
        self._few, self._part, self._depth = _LOBES
        if not self._sampler.albedo.fast:
            self._sampler.rtol, (self._few, self._part, self._depth) = rtol or _SEARCHED, _FUNCTIONS
        self.parameter = _halved(np.concatenate([[low], nodes, [high]]))
        self.mu = _halved(np.concatenate([[0.0], cos_theta, [1.0]]))
        p, where = np.unique(self.parameter, return_inverse=True)
        mu, across = np.unique(self.mu, return_inverse=True)
        self.values, bars = (part[np.ix_(where, across)] for part in cells(family, p, mu, rtol, row))
        self._grid = np.stack(np.meshgrid(self.parameter, self.mu, indexing="ij"), axis=-1)
        self.missed = self.values + bars - approximation(*self._grid.reshape(-1, 2).T).reshape(self.values.shape)
        self._seen = [(self._grid.reshape(-1, 2), (self.values + bars).ravel())]
        self._between: list[tuple[np.ndarray, np.ndarray]] = []
        self._divide()
        self.seen = tuple(np.concatenate(part) for part in zip(*self._seen, strict=True))
        self.points, self.upper = (np.concatenate(part) for part in zip(*self._seen, *self._between, strict=True))

    def loss(self, added: Lookup) -> float:
        """How much is still lost where this much is added, at most."""
        return float(np.max(1 - self.values - added(*self._grid.reshape(-1, 2).T).reshape(self.values.shape)))

    def _divide(self) -> None:
        blocks, places, roughness = (
            np.lib.stride_tricks.sliding_window_view(part, (3, 3), axis=(0, 1))[::2, ::2]
            for part in (self.missed, self._grid, np.maximum(*(_third(self.values, axis) for axis in (0, 1))))
        )
        blocks, rough = blocks.reshape(-1, 3, 3), roughness.reshape(-1, 9).max(axis=1) / 4
        # Of each cell the lower and the upper end along either axis.
        boxes = places.reshape(-1, 2, 3, 3)[:, :, [0, 2], [0, 2]]
        inner = blocks.reshape(-1, 9)[:, [1, 3, 4, 5, 7]].max(axis=1)
        # Third differences tell where a parabola may be trusted as it is: it errs by a sixteenth of them.
        unclear, left = inner + rough > 0, rough > np.maximum(self._part * inner, self._few)
        self._settle(boxes[unclear & ~left], blocks[unclear & ~left], rough[unclear & ~left])
        boxes, blocks = boxes[unclear & left], blocks[unclear & left]
        for depth in range(self._depth):
            if not len(boxes):
                break
            boxes, blocks = self._halves(boxes, blocks, depth == self._depth - 1)

    def _settle(self, boxes: np.ndarray, blocks: np.ndarray, off: np.ndarray) -> None:
        """Take boxes (boxes, axes, ends) as they are, in which parabolas through what is missed are off by so much."""
        sides = np.stack([boxes[..., 0], boxes.mean(axis=-1), boxes[..., 1]], axis=-1)
        points = np.stack(np.broadcast_arrays(sides[:, 0, :, None], sides[:, 1, None, :]), axis=-1).reshape(-1, 2)
        # Between the points of a parabola its crest is higher by some of its bend.
        bend = np.maximum(*(-np.diff(blocks, 2, axis=axis).min(axis=(1, 2)) for axis in (1, 2)))
        doubt = np.repeat(off + np.maximum(bend, 0) / 8, 9)
        self._between.append((points, blocks.ravel() + doubt + self._approximation(*points.T)))

    def _halves(self, boxes: np.ndarray, blocks: np.ndarray, last: bool) -> tuple[np.ndarray, np.ndarray]:
        """Look at quarters of boxes (boxes, axes, ends), of which `blocks` is what is missed; those that are to be divided."""
        t = np.linspace(0, 1, 5)
        ends = boxes[:, :, [0]] + t * (boxes[:, :, [1]] - boxes[:, :, [0]])
        points = np.stack(np.broadcast_arrays(ends[:, 0, :, None], ends[:, 1, None, :]), axis=-1)
        fresh = np.ones((5, 5), bool)
        fresh[::2, ::2] = False
        finer = np.einsum("ai,nij,bj->nab", _PARABOLA, blocks, _PARABOLA)
        asked = points[:, fresh].reshape(-1, 2)
        value, error = self._sampler.at(*asked.T)
        missed = (value + error - self._approximation(*asked.T)).reshape(len(boxes), -1)
        off = np.abs(missed - finer[:, fresh]).max(axis=1)
        finer[:, fresh] = missed
        self._seen.append((asked, value + error))
        corners = [(i, j) for i in (0, 2) for j in (0, 2)]
        parts = np.stack([finer[:, i : i + 3, j : j + 3] for i, j in corners], axis=1)
        halves = np.stack([ends[:, :, :3:2], ends[:, :, 2::2]], axis=1)  # (boxes, halves, axes, ends)
        quarters = np.stack([halves[:, [i // 2, j // 2], [0, 1]] for i, j in corners], axis=1)
        tops = parts.max(axis=(2, 3))
        # The next parabola errs by an eighth of what this one did.
        off = np.repeat(off[:, None], 4, axis=1)
        unclear, left = tops + off > 0, (off > np.maximum(self._part * tops, self._few)) & (not last)
        self._settle(quarters[unclear & ~left], parts[unclear & ~left], off[unclear & ~left] / 4)
        return quarters[unclear & left], parts[unclear & left]


def raised(nodes: np.ndarray, cos_theta: np.ndarray, table: np.ndarray, known: Cover) -> np.ndarray:
    """The table, which holds no more than 1, raised as little as looking up between nodes asks for not to lie below `upper`.

    Where a node cannot be raised above 1 the others around the point are raised by more.
    """
    (i, k, x), (j, m, y) = (_between(axis, part) for axis, part in zip((nodes, cos_theta), known.points.T, strict=True))
    rows, columns = np.stack([i, i, k, k]), np.stack([j, m, j, m])
    weights = np.stack([(1 - x) * (1 - y), (1 - x) * y, x * (1 - y), x * y])
    upper = np.minimum(known.upper, 1)
    table = np.minimum(table, 1)
    for _ in range(_RAISED):
        below = upper - np.sum(weights * table[rows, columns], axis=0)
        if np.all(below <= _ROUNDING):
            return table
        free = np.where(table[rows, columns] < 1, weights, 0)
        lift = np.zeros_like(table)
        step = np.maximum(below, 0) / np.maximum(free.sum(axis=0), 1e-12)
        np.maximum.at(lift, (rows, columns), np.where(free > 0, step, 0))
        table = np.minimum(table + lift, 1)
    return table


def averages(mu: Float[np.ndarray, " n"], energy: Float[np.ndarray, "rows n"]) -> Float[np.ndarray, " rows"]:
    r"""$2 \int_0^1 \hat E\, \mu\, d\mu$ of rows that run linearly between the nodes `mu` and are level beyond them. Exact."""
    x = np.concatenate([[0.0], mu, [1.0]])
    y = np.concatenate([energy[:, :1], energy, energy[:, -1:]], axis=1)
    low, high = x[:-1], x[1:]
    return ((high - low) * (y[:, :-1] * (2 * low + high) + y[:, 1:] * (low + 2 * high))).sum(axis=1) / 3


def looked_up(nodes: np.ndarray, cos_theta: np.ndarray, table: np.ndarray, parameter: np.ndarray, mu: np.ndarray) -> np.ndarray:
    """The table at points between its nodes, linear along each axis and level beyond: (points,)."""
    (i, k, x), (j, m, y) = _between(nodes, parameter), _between(cos_theta, mu)
    return (1 - x) * ((1 - y) * table[i, j] + y * table[i, m]) + x * ((1 - y) * table[k, j] + y * table[k, m])


def _between(nodes: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The nodes before and after each number, and how far it is from the first to the second."""
    place = np.interp(at, nodes, np.arange(len(nodes)))
    first = place.astype(int)
    return first, np.minimum(first + 1, len(nodes) - 1), place - first


def _halved(sides: np.ndarray) -> np.ndarray:
    """The sides of cells with the middles between them."""
    found = np.empty(2 * len(sides) - 1)
    found[::2], found[1::2] = sides, (sides[:-1] + sides[1:]) / 2
    return found


def _third(values: np.ndarray, axis: int) -> np.ndarray:
    """The largest third difference along an axis that each value takes part in; a parabola errs by a sixteenth of it."""
    differences = np.abs(np.diff(values, 3, axis=axis))
    padding = [(3, 3) if along == axis else (0, 0) for along in range(values.ndim)]
    return np.lib.stride_tricks.sliding_window_view(np.pad(differences, padding), 4, axis=axis).max(axis=-1)


def _float32(values: np.ndarray, towards: float) -> np.ndarray:
    """The nearest numbers of float32 that lie on this side."""
    single = values.astype(np.float32)
    wrong = single < values if towards > 0 else single > values
    return np.where(wrong, np.nextafter(single, np.float32(towards)), single).astype(float)
