r"""Bounds of the albedo of a program over a box of parameters and angles of incidence, by cells of the hemisphere.

The direction to the viewer is $(\sin a \cos \varphi, \sin a \sin \varphi, \cos a)$ with $a = \pi s/2$ and $\varphi = \pi q$,
so that the albedo is the integral of $G = f \cos a \sin a\, \pi^2/2$ over s in [0, 1] and q in [0, 2], or twice that over q in
[0, 1] for programs that have a plane of symmetry. On a cell of the size u by v about c and a box of radii r about p, with
enclosures $D_j$ of the slopes of G,

* $\int G(x, p')\, dx \le u v\, (G(c, p) + u |D_s|/8 + v |D_q|/8) + \sum_j r_j \max|u v D_j|$, |D| the width of an
  interval: the mean of a slope is multiplied by a mean distance of 0, so that only what the slope varies counts. The last terms
  are added over all cells before the maximum is taken.
* where that is worse, or the slopes say nothing, $u v \sup G$.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from brdfcheck.proof import enclosures as e
from brdfcheck.proof.enclosures import Enclosed, Pair
from brdfcheck.proof.grazing import enclose
from brdfcheck.proof.operations import evaluate
from brdfcheck.proof.programs import Program
from brdfcheck.proof.quotients import unit_quotients

_SUM = 2.0**-52
# The least cell; below, halves would not be exact in relation to 1.
_FINEST = 2.0**-40
# So many cells, of one box or of several, are bounded together.
_TOGETHER = 4096


@dataclass(frozen=True)
class Cells:
    """Rectangles of the hemisphere: `s` and `q` with the shape (2, cells), lower and upper ends, dyadic numbers."""

    s: np.ndarray
    q: np.ndarray

    @staticmethod
    def start(turns: float) -> Cells:
        """8 by 8 cells for each half turn."""
        s, q = np.meshgrid(np.arange(8) / 8, np.arange(8 * int(turns)) / 8, indexing="ij")
        return Cells(np.stack([s.ravel(), s.ravel() + 1 / 8]), np.stack([q.ravel(), q.ravel() + 1 / 8]))

    def split(self, along_s: np.ndarray, along_q: np.ndarray) -> Cells:
        """These cells, halved where it is said."""
        s, q, again = _halved(self.s, self.q, along_s)
        q, s, _ = _halved(q, s, along_q[again])
        return Cells(s, q)


def _halved(ends: np.ndarray, others: np.ndarray, mask: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Intervals of which some are halved, the ends of the other side, and which of the old ones each one is of."""
    mask = mask & (ends[1] - ends[0] > _FINEST)
    middle = (ends[0] + ends[1]) / 2
    again = np.concatenate([np.arange(len(mask)), np.flatnonzero(mask)])
    first = np.stack([ends[0], np.where(mask, middle, ends[1])])
    second = np.stack([middle, ends[1]])[:, mask]
    return np.concatenate([first, second], 1), others[:, again], again


@dataclass(frozen=True)
class Box:
    """Ranges of the variables of an albedo: tau (the angle of incidence over 90 degrees), the azimuth of the light over 180
    degrees, and the parameters."""

    low: np.ndarray
    high: np.ndarray

    @property
    def middle(self) -> np.ndarray:
        return np.clip(self.low / 2 + self.high / 2, self.low, self.high)

    @property
    def is_wide(self) -> np.ndarray:
        """Along which variables it can be cut: those that have a number between both ends."""
        return (self.low < self.middle) & (self.middle < self.high)

    @property
    def radii(self) -> np.ndarray:
        middle = self.middle
        return np.nextafter(np.maximum(middle - self.low, self.high - middle), np.inf)

    def halves(self, j: int) -> tuple[Box, Box]:
        """Cut in two along one variable; a range over more than a factor of 4 at its geometric mean."""
        low, high = self.low[j], self.high[j]
        middle = np.sqrt(low) * np.sqrt(high) if 0 < 4 * low < high else self.middle[j]
        upper, lower = self.high.copy(), self.low.copy()
        upper[j] = lower[j] = middle
        return Box(self.low, upper), Box(lower, self.high)


@dataclass(frozen=True)
class Bound:
    """The albedo of the channel with the largest bound: at most `high` on all of a box, at least `low` there, too.

    `estimate`: about its value at the middle. What separates the bound from it: `cells`, for each cell its excess and whether
    it had better be halved along s and q, and `radii`, for each variable its share.
    """

    high: float
    low: float
    estimate: float
    cells: np.ndarray
    along_s: np.ndarray
    along_q: np.ndarray
    radii: np.ndarray


def _variable(low: np.ndarray, high: np.ndarray, index: int, count: int) -> Enclosed:
    """An input with the slope 1 by the variable of this number."""
    slopes = tuple(e.ONE if i == index else None for i in range(count))
    return Enclosed((np.atleast_2d(low), np.atleast_2d(high)), slopes)


def _direction(angle: Enclosed, azimuth: Enclosed) -> tuple[Enclosed, Enclosed]:
    """The unit vector as an enclosure, and the sine of its angle with the normal, which is in [0, 90] degrees."""
    sine, cosine = (_positive(part) for part in (e.sin(angle), e.cos(angle)))
    parts = [e.multiply(sine, e.cos(azimuth)), e.multiply(sine, e.sin(azimuth)), cosine]
    return e.take(parts, np.arange(3)), sine


def _positive(a: Enclosed) -> Enclosed:
    return replace(a, ends=(np.maximum(a.ends[0], 0), np.maximum(a.ends[1], 0)))


class Hemisphere:
    """The albedo of a program. `turns`: half turns of the viewer's azimuth to integrate over, 1 where the rest is the same."""

    def __init__(self, program: Program, symmetry: str):
        self.program, self._units = program, unit_quotients(program)
        self.turns = 1 if symmetry == "mirror" else 2
        self._scale = e.multiply(e.multiply(e.PI, e.PI), e.point(1.0 / self.turns))
        self.azimuth = symmetry == "none"
        """Whether the azimuth of the light is a variable."""

    def _integrand(self, s: Pair, q: Pair, box: Sequence[Pair], slopes: bool) -> Enclosed:
        """G on cells for variables in a box, with slopes by s, q and the variables if wanted. Shape (channels, cells)."""
        wi, wo, sine, parameters = self._directions(s, q, box, 2 + len(box) if slopes else 0)
        weight = e.multiply(sine, e.take([wo], np.array([2])))
        return e.multiply(evaluate(self.program, self._units, wi, wo, parameters), e.multiply(weight, self._scale))

    def _grazing(self, s: Pair, q: Pair, box: Sequence[Pair]) -> Pair:
        """G on cells, without slopes, where the cosines that it is divided by may be 0."""
        wi, wo, sine, parameters = self._directions(s, q, box, 0)
        found = enclose(self.program, self._units, wi, wo, parameters)
        return e.times(found, e.multiply(sine, self._scale).ends)

    def _directions(
        self, s: Pair, q: Pair, box: Sequence[Pair], count: int
    ) -> tuple[Enclosed, Enclosed, Enclosed, list[Enclosed]]:
        """wi, wo, the sine of its angle with the normal, and the parameters, with slopes by so many variables."""
        half = e.multiply(e.PI, e.point(0.5))
        s_, q_, tau, turn, *parameters = (_variable(*pair, i, count) for i, pair in enumerate((s, q, *box)))
        turn = e.multiply(e.PI, turn)
        view = e.plus(e.multiply(e.PI, q_), turn) if self.azimuth else e.multiply(e.PI, q_)
        wi, _ = _direction(e.multiply(half, tau), turn if self.azimuth else e.point(0.0))
        wo, sine = _direction(e.multiply(half, s_), view)
        return wi, wo, sine, parameters

    def bound(self, box: Box, cells: Cells) -> Bound:
        """What is known of the albedo on the box from these cells."""
        return self.bounds([box], [cells])[0]

    def bounds(self, boxes: Sequence[Box], cells: Sequence[Cells]) -> list[Bound]:
        """`bound` of several boxes, each with cells of its own; some at a time, since numpy is slow at short arrays."""
        found: list[Bound] = []
        start, columns = 0, 0
        with np.errstate(all="ignore"):
            for i, own in enumerate(cells):
                columns += own.s.shape[1]
                if columns >= _TOGETHER or i + 1 == len(cells):
                    found += self._bounds(boxes[start : i + 1], cells[start : i + 1])
                    start, columns = i + 1, 0
        return found

    def _bounds(self, boxes: Sequence[Box], cells: Sequence[Cells]) -> list[Bound]:
        counts = np.array([own.s.shape[1] for own in cells])
        starts = np.cumsum(counts) - counts
        s, q = np.concatenate([own.s for own in cells], 1), np.concatenate([own.q for own in cells], 1)
        area = (s[1] - s[0]) * (q[1] - q[0])

        def columns(of: Sequence[np.ndarray]) -> np.ndarray:
            """A row for each variable, with a column for each cell, or one for all."""
            return np.repeat(np.stack(of, 1), counts, 1) if len(boxes) > 1 else np.asarray(of[0])[:, None]

        lows, highs, middles = (columns([part(box) for box in boxes]) for part in _PARTS)
        radii = np.stack([box.radii for box in boxes], 1)
        pairs = list(zip(lows, highs, strict=True))
        whole = self._integrand((s[0], s[1]), (q[0], q[1]), pairs, True)
        at = s.mean(0), q.mean(0)
        centre = self._integrand((at[0], at[0]), (at[1], at[1]), [(x, x) for x in middles], False)
        shape = np.broadcast_shapes(whole.ends[0].shape, area.shape)
        low, high = (np.array(np.broadcast_to(x, shape)) for x in whole.ends)
        none = np.flatnonzero(~np.isfinite(high).all(0))
        for lost in np.split(none, range(_TOGETHER // 4, len(none), _TOGETHER // 4)) if len(none) else ():
            box = [tuple(end[lost] if end.size > 1 else end for end in pair) for pair in pairs]
            some = self._grazing((s[0, lost], s[1, lost]), (q[0, lost], q[1, lost]), box)
            low[:, lost], high[:, lost] = np.maximum(low[:, lost], some[0]), np.minimum(high[:, lost], some[1])
        at_low, at_high = (np.broadcast_to(x, shape) for x in centre.ends)
        undefined = np.broadcast_to(np.False_ if whole.undefined is None else whole.undefined, shape)
        # What is undefined counts as 0.
        low, high = np.where(undefined, np.minimum(low, 0), low), np.where(undefined, np.maximum(high, 0), high)
        smooth = ~undefined & np.isfinite(at_low) & np.isfinite(at_high)
        if whole.jumps is not None:
            smooth = smooth & ~whole.jumps
        slopes = [e.ZERO if slope is None else slope for slope in whole.slopes] or [e.ZERO] * (2 + len(pairs))
        slopes = [tuple(np.broadcast_to(x, shape) for x in slope) for slope in slopes]
        for slope in slopes:
            smooth = smooth & np.isfinite(slope[0]) & np.isfinite(slope[1])
        spread = [(slope[1] - slope[0]) * (ends[1] - ends[0]) / 8 for slope, ends in zip(slopes, (s, q), strict=False)]
        excess = (spread[0] + spread[1]) * (1 + 1e-14) + 1e-300
        # Slopes by the variables of a box are added over its cells: of them, about what they vary counts.
        varied = [
            (slope[1] - slope[0]) * radius / 2 for slope, radius in zip(slopes[2:], np.repeat(radii, counts, 1), strict=True)
        ]
        sloped, smooth = smooth, smooth & (at_high + excess + sum(varied) < high)
        total = _sums(np.where(smooth, at_high + excess, high) * area, starts, counts)[1]
        least = _sums(np.where(smooth, at_low - excess, low) * area, starts, counts)[0]
        shares = np.zeros((len(pairs), *total.shape))
        for j, slope in enumerate(slopes[2:]):
            ends = [_sums(np.where(smooth, x, 0) * area, starts, counts) for x in slope]
            share = np.maximum(-ends[0][0], ends[1][1]) * radii[j] * (1 + 1e-15)
            shares[j] = np.where(radii[j] > 1e-300, share, 0)  # a box that is a point along j has the least number as radius
        most = total + shares.sum(0) * (1 + 1e-14)
        least = least - shares.sum(0) * (1 + 1e-14)
        found = []
        for k, box in enumerate(boxes):
            own = slice(starts[k], starts[k] + counts[k])
            channel = int(np.argmax(np.where(np.isnan(most[:, k]), np.inf, most[:, k])))
            there = (channel, own)
            middle_value = np.where(np.isfinite(at_high[there]), at_high[there], 0)
            above = high[there] - middle_value
            blunt = sloped[there] & ~smooth[there]
            rough = ~smooth[there] & (above > 0)
            pieces = np.where(smooth[there], excess[there], np.where(blunt, np.minimum(excess[there], above), above))
            widths = [np.sum(np.where(blunt, np.minimum(part[there], above), 0) * area[own]) for part in varied]
            bound = float(most[channel, k])
            found.append(
                Bound(
                    np.inf if np.isnan(bound) else float(np.nextafter(bound, np.inf)),
                    float(np.nextafter(np.nan_to_num(least[channel, k], nan=-np.inf), -np.inf)),
                    float(np.sum(middle_value * area[own])),
                    np.where(np.isnan(pieces), np.inf, pieces) * area[own],
                    rough | (spread[0][there] * 2 >= spread[1][there]),
                    rough | (spread[1][there] * 2 >= spread[0][there]),
                    np.where(box.high > box.low, shares[:, channel, k] + widths, 0),
                )
            )
        return found


_PARTS: tuple[Callable[[Box], np.ndarray], ...] = (lambda box: box.low, lambda box: box.high, lambda box: box.middle)


def _sums(values: np.ndarray, starts: np.ndarray, counts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sums over the columns of each box, from below and above."""
    total = np.add.reduceat(values, starts, axis=-1)
    error = np.add.reduceat(np.abs(values), starts, axis=-1) * (_SUM * (counts + 16)) + 1e-290
    return total - error, total + error
