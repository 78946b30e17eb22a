"""The places of a search whose albedo is known at the accuracy of a verdict, and what they say together."""

from __future__ import annotations

import numpy as np

from brdfcheck.verdict.box import Box

AROUND = 0.05
"""How near (in the unit cube) a place is to another one, that was climbed from and speaks for it."""
# How near it is to one that was climbed to, and to itself.
_SAME, _EQUAL = 2e-3, 1e-13
# What is this much lower than the best (relative to it) is not asked how much higher its climb might have gone.
_CLOSE = 1e-2
# A climb that was not finished may go this many times as high as the model of its last steps says, and by this at least.
_UNFINISHED, _MARGIN = 10, 1e-5


class Winners:
    """Confirmed places, one entry each.

    `values` +- `errors` are the albedos, found with the accuracy `asked`; `gaps` say how much higher a climb might have gone
    from there, `settled` that it ended, and `climbed` that there was one. `limits` says that an albedo is the limit at grazing
    incidence, and not the value just before it.
    """

    def __init__(self, box: Box):
        self.box = box
        self.places = np.zeros((0, box.dimension))
        self.values, self.errors, self.gaps, self.asked = (np.zeros(0) for _ in range(4))
        self.settled, self.climbed, self.limits = (np.zeros(0, bool) for _ in range(3))

    def __len__(self) -> int:
        return len(self.values)

    def add(
        self,
        places: np.ndarray,
        values: np.ndarray,
        errors: np.ndarray,
        asked: float | None,
        *,
        gaps: np.ndarray | float = 0.0,
        settled: np.ndarray | bool = True,
        climbed: bool = False,
        limit: bool = False,
    ) -> None:
        """Places (k, dimension) with the rest (k,). Of a place that is there already the better of the two albedos is kept."""
        for place, value, error, gap, done in zip(
            places, values, errors, *(np.broadcast_to(part, values.shape) for part in (gaps, settled)), strict=True
        ):
            index = self.find(place, limit)
            fresh = (value, error, gap, 0.0 if asked is None else asked, done, climbed, limit)
            if index is None:
                self.places = np.concatenate([self.places, place[None]])
                for name, part in zip(_COLUMNS, fresh, strict=True):
                    setattr(self, name, np.append(getattr(self, name), part))
                continue
            # Of values that exclude each other the larger one: no bar is trusted against what has been seen.
            apart = abs(value - self.values[index]) > error + self.errors[index]
            if value > self.values[index] if apart else error < self.errors[index]:
                self.values[index], self.errors[index] = value, error
            self.asked[index] = min(self.asked[index], fresh[3])
            if climbed:
                self.gaps[index], self.settled[index], self.climbed[index] = gap, done, True

    def find(self, place: np.ndarray, limit: bool) -> int | None:
        """The number of a place, or of the limit there."""
        same = np.flatnonzero((self.box.distance(self.places, place) < _EQUAL) & (self.limits == limit))
        return int(same[0]) if same.size else None

    @property
    def finite(self) -> np.ndarray:
        """Which albedos are numbers."""
        return np.isfinite(self.values)

    @property
    def best(self) -> float:
        """The largest albedo."""
        return float(np.max(self.values[self.finite], initial=-np.inf))

    @property
    def least(self) -> float:
        """What the largest albedo is at least."""
        return float(np.max((self.values - self.errors)[self.finite], initial=-np.inf))

    @property
    def top(self) -> int:
        """The winner: of values that are equal within their errors, the one that is known best."""
        return int(np.argmax(np.where(self.finite, self.values - self.errors, -np.inf)))

    @property
    def broken(self) -> bool:
        """True where some albedo is not known at all."""
        return bool(np.any(~self.finite & ~np.isposinf(self.values)))

    def is_climbed(self, place: np.ndarray) -> bool:
        """True where a climb has ended."""
        return bool(np.any((self.box.distance(self.places, place) < _SAME) & self.climbed))

    def leaders(self, below: float) -> np.ndarray:
        """The places that are at most so much lower than the best, relative to it."""
        return self.places[self.values > self.best - below * max(1, abs(self.best))]

    def reach(self) -> np.ndarray:
        """How high the surface may be at each place, its climb included; -inf where that is not known.

        Around the winner it is the winner's own climb that tells.
        """
        away = self.box.distance(self.places, self.places[self.top]) > AROUND
        # So it is around others that were climbed from with all digits and are as high.
        finest = np.min(self.asked[~self.limits], initial=np.inf)
        for index in np.flatnonzero(self.climbed & (self.limits | (self.asked <= finest))):
            near = self.box.distance(self.places, self.places[index]) < _SAME
            near &= self.values <= self.values[index] + self.errors[index]
            near[index] = False
            away &= ~(near & (self.asked > self.asked[index]))
        away[self.top] = True
        close = self.values > self.best - _CLOSE * max(1, abs(self.best))
        return np.where(self.finite, self.values + self.errors + np.where(away & close, self._left(), 0), -np.inf)

    def _left(self) -> np.ndarray:
        """How much higher climbs might have gone: the gaps; for limits that none has led to, of climbs just before them."""
        left = self.gaps.copy()
        for index in np.flatnonzero(self.limits & ~self.climbed):
            before = ~self.limits & (self.box.distance(self.places, self.places[index]) < _SAME)
            here = self.find(self.places[index], False)
            if here is not None and np.any(before & self.climbed):
                rise = (self.values + self.gaps)[before & self.climbed] - self.values[here]
                left[index] = max(left[index], float(np.max(rise)))
        return left

    def open(self) -> np.ndarray:
        """Indices of places that may be higher than the winner because their climb was not finished; the highest first."""
        if not np.any(self.finite):
            return np.zeros(0, int)
        reach, top = self.reach(), self.top
        early = (reach > self.least) & (~self.settled | (self.gaps > self.errors))
        early &= (self.box.distance(self.places, self.places[top]) > AROUND) | (np.arange(len(self)) == top)
        indices = np.flatnonzero(early)
        return indices[np.argsort(-reach[indices])]

    def unsettled(self, line: float, rounding: float = 0.0) -> bool:
        """True where a climb was not finished that might yet go above the line. `rounding`: what all errors hold of that."""
        open_ = self.open()
        might = self.values + self.errors + np.maximum(_UNFINISHED * self.gaps, _MARGIN)
        if np.any(~self.settled[open_] & (might[open_] > line)):
            return True
        # What was not climbed from because it is not known well enough.
        top = self.top
        rough = self.box.dimension > 0 and np.any(self.finite) and not self.is_climbed(self.places[top])
        if not rough:
            return False
        rounding = min(rounding, float(self.errors[top]))
        return bool(self.values[top] + rounding + _UNFINISHED * (self.errors[top] - rounding) > line)

    def loose(self, rtol: float) -> np.ndarray:
        """Indices of places that are as high as the winner only by their error, and were not asked with this accuracy."""
        reach = np.where(self.finite, self.values + self.errors, -np.inf)
        loose = (reach > reach[self.top]) & (self.errors > 2 * self.errors[self.top]) & (self.asked > rtol) & ~self.limits
        indices = np.flatnonzero(loose)
        return indices[np.argsort(-reach[indices])]


_COLUMNS = ("values", "errors", "gaps", "asked", "settled", "climbed", "limits")
