"""A proof, by boxes, that the albedo of a program is at most 1 on all of a box; a point above 1; or how far it got.

The box with the largest bound is taken next: its hemisphere is cut finer where cells make the difference between the bound
and the value at its middle, and it is cut in two where its own width does. So at any time the largest bound of all boxes is
proved, and time spent lowers it.
"""

from __future__ import annotations

import heapq
import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np

from brdfcheck.proof.hemisphere import Bound, Box, Cells, Hemisphere

# Cells of a box, and of a point at which a violation is to be shown.
_MOST_CELLS, _MOST_AT_POINT = 20_000, 200_000
# Of the cells' excess this part is worked on at a time.
_PART = 0.8
_ROUNDS = 40
# Cells are cut while their excess is more than this part of that of the box's width.
_BALANCE = 0.5


@dataclass(frozen=True)
class Found:
    """What a search found. `high`: the albedo is at most that on all boxes. `point`: where it is at least `low` > 1; None:
    nowhere. `proved`: the part of all boxes on which it is at most 1; `boxes`: how many were looked at. `cuts`: how each of the
    first boxes was cut: a letter for the variable along which, then its halves in this way, and a point for what is proved."""

    high: float
    proved: float
    boxes: int
    seconds: float
    point: np.ndarray | None = None
    low: float | Fraction = 0.0
    cuts: tuple[str, ...] = ()


class Search:
    """The search over `boxes`, for so many seconds. `inside`: the part of each in which a violation counts."""

    def __init__(
        self,
        hemisphere: Hemisphere,
        boxes: list[Box],
        inside: list[Box],
        seconds: float,
        watch: Callable[[float, float], None] | None = None,
    ):
        self._hemisphere, self._start, self._seconds, self._watch = hemisphere, time.perf_counter(), seconds, watch
        self._roots, self._inside, self._count = boxes, inside, 0
        self._widths = [box.high - box.low for box in boxes]
        self._least_cells = Cells.start(hemisphere.turns)

    @property
    def _spent(self) -> float:
        return time.perf_counter() - self._start

    def run(self) -> Found:
        """Search until all is proved, a point above 1 is found, or time is up."""
        violation = self._violation()
        if violation is not None:
            return self._found(np.inf, 0.0, *violation)
        number = itertools.count()
        waiting: list[tuple[float, int, int, str, float, Box, Cells, Bound]] = []
        cuts: dict[tuple[int, str], int] = {}

        def look(box: Box, cells: Cells, root: int, half: str, share: float, ceiling: float) -> float:
            """Bound a box; what is above 1 waits. Its share of all, if it is proved."""
            bound, cells = self._refined(box, cells)
            high = min(bound.high, ceiling)  # what holds of a box holds of its parts
            if high <= 1:
                return share
            heapq.heappush(waiting, (-high, next(number), root, half, share, box, cells, bound))
            return 0.0

        proved, tried = 0.0, 1.0
        for root, box in enumerate(self._roots):
            proved += look(box, self._least_cells, root, "", 1 / len(self._roots), np.inf)
        while waiting and self._spent < self._seconds:
            high, _, root, which, share, box, cells, bound = heapq.heappop(waiting)
            if self._watch is not None:
                self._watch(-high, proved)
            # Where the middle of a box lies above 1, and higher than any seen before, a violation may be shown there.
            if bound.estimate > tried:
                tried = bound.estimate + 1e-3 * (bound.estimate - 1)
                place = np.clip(box.middle, self._inside[root].low, self._inside[root].high)
                low = self.at(place)
                if low > 1:
                    return self._found(-high, proved, place, low)
            cuts[root, which] = j = self._widest(box, bound, root)
            for letter, half in zip("01", box.halves(j), strict=True):
                part = float((half.high[j] - half.low[j]) / (box.high[j] - box.low[j]))
                proved += look(half, cells, root, which + letter, share * part, -high)
        if waiting:
            return self._found(max(1.0, -waiting[0][0]), proved)
        return replace(self._found(1.0, 1.0), cuts=tuple(_as_text(cuts, root) for root in range(len(self._roots))))

    def covered(self, cuts: Sequence[str]) -> bool:
        """Is the albedo at most 1 on each of the boxes that are left of the first ones after these cuts (`Found.cuts`)?"""
        for box, text in zip(self._roots, cuts, strict=True):
            parts, cells = [box], self._least_cells
            for letter in text:
                part = parts.pop()
                if letter != ".":
                    parts += reversed(part.halves("abcdefghijklmnopqrstuvwxyz".index(letter)))
                else:  # mostly the cells of a neighbour will do
                    bound, cells = self._refined(part, cells, 0.0)
                    if bound.high > 1:
                        bound, cells = self._refined(part, self._least_cells, 0.0)
                    if bound.high > 1:
                        return False
            if parts:
                return False
        return True

    def _found(self, high: float, proved: float, point: np.ndarray | None = None, low: float = 0.0) -> Found:
        return Found(high, proved, self._count, self._spent, point, low)

    def _bound(self, box: Box, cells: Cells) -> Bound:
        self._count += 1
        return self._hemisphere.bound(box, cells)

    def _refined(self, box: Box, cells: Cells, balance: float = _BALANCE) -> tuple[Bound, Cells]:
        """The bound of a box, with cells cut finer while they make more of a difference than a part of the box's own width."""
        bound = self._bound(box, cells)
        for _ in range(_ROUNDS):
            count, excess, width = cells.s.shape[1], bound.cells.sum(), bound.radii.sum()
            if bound.high <= 1 or count > _MOST_CELLS or self._spent > self._seconds or not excess > balance * width:
                break
            cells = _cut(cells, bound, _PART)
            bound = self._bound(box, cells)
        return bound, cells

    def _widest(self, box: Box, bound: Bound, root: int) -> int:
        """The variable along which a box is cut: the one that makes the most of its excess."""
        relative = np.divide(box.high - box.low, self._widths[root], out=np.zeros(len(box.low)), where=self._widths[root] > 0)
        shares = np.nan_to_num(bound.radii, posinf=1e300)
        rough = np.nan_to_num(bound.cells, posinf=1e300).sum()
        score = shares + relative / max(relative.sum(), 1e-300) * min(rough, 1e300) * 0.5
        return int(np.argmax(np.where(box.high > box.low, score, -1.0)))

    def at(self, place: np.ndarray) -> float:
        """A lower bound of the albedo at one place, above 1 if that can be shown."""
        box, cells = Box(place, place), self._least_cells
        bound = self._bound(box, cells)
        while bound.low <= 1 < bound.estimate and cells.s.shape[1] < _MOST_AT_POINT and self._spent < 2 * self._seconds:
            finer = _cut(cells, bound, _PART)
            if finer.s.shape[1] == cells.s.shape[1]:
                break
            cells = finer
            bound = self._bound(box, cells)
        return bound.low

    def _violation(self) -> tuple[np.ndarray, float] | None:
        """A place above 1 and a lower bound of the albedo there: the best of a few places, and of their neighbours."""
        fine = self._least_cells.split(*(np.ones(self._least_cells.s.shape[1], bool),) * 2)
        best: tuple[float, np.ndarray, Box] | None = None

        def value(place: np.ndarray) -> float:
            return float(np.nan_to_num(self._bound(Box(place, place), fine).estimate, nan=-np.inf))

        for box in self._inside:
            for part in itertools.islice(itertools.product((0.0, 0.5, 1.0), repeat=len(box.low)), 81):
                place = box.low + np.array(part) * (box.high - box.low)
                place = np.clip(place, box.low, box.high)
                found = value(place)
                if best is None or found > best[0]:
                    best = found, place, box
        assert best is not None
        height, place, box = best
        step = 0.25
        while step > 0.01 and self._spent < 0.2 * self._seconds:
            moved = False
            for j, sign in itertools.product(range(len(place)), (-1, 1)):
                other = place.copy()
                other[j] = np.clip(place[j] + sign * step * (box.high[j] - box.low[j]), box.low[j], box.high[j])
                found = value(other) if other[j] != place[j] else -np.inf
                if found > height:
                    height, place, moved = found, other, True
            step = step if moved else step / 2
        if height <= 1 - 1e-2:  # so few cells are not exact
            return None
        low = self.at(place)
        return (place, low) if low > 1 else None


def _as_text(cuts: Mapping[tuple[int, str], int], root: int) -> str:
    """The cuts of one of the first boxes as in `Found.cuts`."""
    text, waiting = [], [""]
    while waiting:
        which = waiting.pop()
        j = cuts.get((root, which))
        text.append("." if j is None else chr(ord("a") + j))
        waiting += [] if j is None else [which + "1", which + "0"]
    return "".join(text)


def _cut(cells: Cells, bound: Bound, part: float) -> Cells:
    """The cells, those halved that make this part of the excess."""
    excess = bound.cells
    order = np.argsort(-excess, kind="stable")
    running = np.cumsum(np.minimum(excess[order], 1e200))
    enough = int(np.searchsorted(running, part * running[-1])) + 1
    chosen = np.zeros(len(excess), bool)
    chosen[order[:enough]] = True
    return cells.split(chosen & bound.along_s, chosen & bound.along_q)
