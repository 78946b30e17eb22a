"""A proof, by boxes, that the albedo of a program is at most 1 on all of a box; a point above 1; or how far it got.

The boxes with the largest bounds are taken next: a box's hemisphere is cut finer where cells make the difference between the
bound and the value at its middle, and the box is cut in two where its own width does. So at any time the largest bound of all
boxes is proved, and time spent lowers it.
"""

from __future__ import annotations

import heapq
import itertools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

import numpy as np

from brdfcheck.proof.hemisphere import Bound, Box, Cells, Hemisphere

# Cells of a box, and of a point at which a violation is to be shown.
_MOST_CELLS, _MOST_AT_POINT = 20_000, 200_000
# Of the cells' excess this part is worked on at a time.
_PART = 0.8
_ROUNDS = 40
# Cells are cut while their excess is more than this part of that of the box's width.
_BALANCE = 0.5
# They are not cut again where that left more than this part of what the bound exceeds 1 by: the box is too wide then.
_PAYS = 0.8
# So many boxes are bounded together.
_AT_ONCE = 16


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
        waiting: list[tuple[Any, ...]] = []
        cuts: dict[tuple[int, str], int] = {}

        def look(tasks: list[tuple[Box, Cells, int, str, float, float]]) -> float:
            """Bound boxes; what is above 1 waits. The share of all of those that are proved."""
            proved = 0.0
            refined = self._refined([task[0] for task in tasks], [task[1] for task in tasks])
            for (box, _, root, half, share, ceiling), bound, cells in zip(tasks, *refined, strict=True):
                high = min(bound.high, ceiling)  # what holds of a box holds of its parts
                if high <= 1:
                    proved += share
                else:
                    heapq.heappush(waiting, (-high, next(number), root, half, share, box, cells, bound))
            return proved

        tried = 1.0
        proved = look(
            [(box, self._least_cells, root, "", 1 / len(self._roots), np.inf) for root, box in enumerate(self._roots)]
        )
        while waiting and self._spent < self._seconds:
            if self._watch is not None:
                self._watch(-waiting[0][0], proved)
            if not waiting[0][5].is_wide.any():
                break  # time would not lower what is proved
            tasks = []
            for high, _, root, which, share, box, cells, bound in self._next(waiting):
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
                    tasks.append((half, cells, root, which + letter, share * part, -high))
            proved += look(tasks)
        if waiting:
            return self._found(max(1.0, -waiting[0][0]), proved)
        return replace(self._found(1.0, 1.0), cuts=tuple(_as_text(cuts, root) for root in range(len(self._roots))))

    def covered(self, cuts: Sequence[str]) -> bool:
        """Is the albedo at most 1 on each of the boxes that are left of the first ones after these cuts (`Found.cuts`)?"""
        left: list[Box] = []
        for box, text in zip(self._roots, cuts, strict=True):
            parts = [box]
            for letter in text:
                part = parts.pop()
                if letter == ".":
                    left.append(part)
                else:
                    parts += reversed(part.halves("abcdefghijklmnopqrstuvwxyz".index(letter)))
            if parts:
                return False
        cells = self._least_cells
        for start in range(0, len(left), _AT_ONCE):
            some = left[start : start + _AT_ONCE]
            # Mostly the cells of a neighbour will do.
            bounds, found = self._refined(some, [cells] * len(some), 0.0)
            again = [box for box, bound in zip(some, bounds, strict=True) if bound.high > 1]
            if any(bound.high > 1 for bound in self._refined(again, [self._least_cells] * len(again), 0.0)[0]):
                return False
            cells = found[-1]
        return True

    def _found(self, high: float, proved: float, point: np.ndarray | None = None, low: float = 0.0) -> Found:
        return Found(high, proved, self._count, self._spent, point, low)

    def _bound(self, box: Box, cells: Cells) -> Bound:
        return self._bounds([box], [cells])[0]

    def _bounds(self, boxes: Sequence[Box], cells: Sequence[Cells]) -> list[Bound]:
        self._count += len(boxes)
        return self._hemisphere.bounds(boxes, cells)

    def _next(self, waiting: list[tuple[Any, ...]]) -> list[tuple[Any, ...]]:
        """The boxes with the largest bounds that can be cut, taken from those that wait."""
        taken = []
        while waiting and len(taken) < _AT_ONCE // 2 and waiting[0][5].is_wide.any():
            taken.append(heapq.heappop(waiting))
        return taken

    def _refined(
        self, boxes: Sequence[Box], cells: Sequence[Cells], balance: float = _BALANCE
    ) -> tuple[list[Bound], list[Cells]]:
        """The bounds of boxes, with cells cut finer while they make more of a difference than a part of the box's own width."""
        cells, bounds = list(cells), self._bounds(boxes, cells)
        active = list(range(len(boxes)))
        for _ in range(_ROUNDS):
            active = [i for i in active if self._may_fall(boxes[i], cells[i], bounds[i], balance)]
            if not active or self._spent > self._seconds:
                break
            for i in active:
                cells[i] = _cut(cells[i], bounds[i], _PART)
            again = self._bounds([boxes[i] for i in active], [cells[i] for i in active])
            before = [bounds[i].high for i in active]
            for i, bound in zip(active, again, strict=True):
                bounds[i] = bound
            if balance:
                active = [i for i, high in zip(active, before, strict=True) if bounds[i].high - 1 <= _PAYS * (high - 1)]
        return bounds, cells

    @staticmethod
    def _may_fall(box: Box, cells: Cells, bound: Bound, balance: float) -> bool:
        """May finer cells lower a bound?"""
        most = _MOST_CELLS if box.is_wide.any() else _MOST_AT_POINT
        return bound.high > 1 and cells.s.shape[1] <= most and bound.cells.sum() > balance * bound.radii.sum()

    def _widest(self, box: Box, bound: Bound, root: int) -> int:
        """The variable along which a box is cut: the one that makes the most of its excess."""
        relative = np.divide(box.high - box.low, self._widths[root], out=np.zeros(len(box.low)), where=self._widths[root] > 0)
        shares = np.nan_to_num(bound.radii, posinf=1e300)
        rough = np.nan_to_num(bound.cells, posinf=1e300).sum()
        score = shares + relative / max(relative.sum(), 1e-300) * min(rough, 1e300) * 0.5
        return int(np.argmax(np.where(box.is_wide, score, -1.0)))

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
