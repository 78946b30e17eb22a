r"""The largest albedo of a family over a box of parameters and angles: a continuous maximum, with an error bar.

No direction and no parameter is assumed to be the worst, except by theorem (lobes that do not rise with their angle are
largest at normal incidence). The search has four steps, and its answer says what it rests on:

1. *Scan*: thousands of points, evenly spread and at all corners, edges and ends, by a quick rule. What is high, or may be
   high within its error, is looked at again by finer rules.
2. *Climb* from the best well-separated points, by quadratic models, rule after rule.
3. *Look again*: disjoint points, half of them where the surface is steep, close to the largest value or on a ridge; until
   nothing higher is found.
4. *Confirm*: the winners at the accuracy of a verdict, by the rule with an error bar of its own. The bar holds the error of
   the quadrature, what the climb may have left, and whatever other place could still be higher.

Grazing light is its limit; where the albedo grows without bound, towards grazing or towards a pole inside the box, that is
the answer, and no number.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial import KDTree

from brdfcheck.pointwise import GRAZING, PointwiseAlbedo
from brdfcheck.verdict.box import DECADES, Box, cosine_at
from brdfcheck.verdict.climb import Climbs, climb
from brdfcheck.verdict.intervals import intervals_above

EFFORTS = ("quick", "normal", "thorough")
_SCALE = {"quick": 0.25, "normal": 1.0, "thorough": 4.0}
# Points of the first scan for no, one, two, and more swept parameters.
_POINTS = (4096, 8192, 8192, 12288)
# Values of the cosine in a scan of a function.
_COSINES = 513
_STARTS = 40
# Points of a line through the winner along each axis, and how many of the crests found on them are climbed.
_LINE, _RIVALS = 769, 24
# Into how many parts the angles are divided, each with its share of the starts.
_SHARES = 8
# How many points of a scan may be looked at by the second and the third rule, and how many by the rule of the verdict.
_SECOND, _THIRD, _CONFIRMED = 512, 64, 16
# What is this much lower than the best cannot become the best by a finer rule, beyond its own error.
_MARGIN = 1e-3
# How many places are kept at which the albedo is not a number.
_LOST = 6
# How near (in the unit cube) a place is to another one that speaks for it, and to one that is the same.
_AROUND, _SAME = 0.05, 2e-3
# The accuracy asked of a function that rounds, in roundings: in single precision no integral gets better.
_ROUNDINGS = 100
# Accuracies at which places are confirmed, one after the other, as long as they may be the highest.
_RUNGS = (1e-5, 1e-7)
# An error that is left at the last of these marks a BRDF with jumps.
_HARD = 1e-3
# How many of them by more than the first of these.
_FINEST = 6
# Values above this are examined for a pole.
_SUSPICIOUS = 30.0


@dataclass(frozen=True)
class Supremum:
    """Where the albedo of a family is largest, and what that rests on.

    `value` +- `error` is the largest albedo, `parameters`, `cos_theta` and `azimuth` (radians) say where; `least` is what it
    is at least. `above` are the intervals of the single parameter in which some angle exceeds `threshold` (None where they
    were not looked for). `basis`: "theorem" where the angle needed no search, else "search". `points` were scanned, `climbs`
    begun; `settled` says that the climbs ended and a second scan found nothing higher. `width`: the widest region that the
    scan may have missed: by parameter, as a part of its range, "angle" in degrees and "cell" in all at once. `unbounded`
    says where the albedo grows without bound (value and error are then infinite), `channel` which channel is the largest.
    """

    value: float
    error: float
    parameters: dict[str, float]
    cos_theta: float
    azimuth: float
    threshold: float
    above: tuple[tuple[float, float], ...] | None = field(default=None)
    least: float = -np.inf
    basis: str = "search"
    points: int = 0
    climbs: int = 0
    settled: bool = True
    width: Mapping[str, float] = field(default_factory=dict)
    unbounded: str | None = None
    channel: int | None = None
    channels: int = 1


Watch = Callable[[int, float], None]
"""Called with the points looked at so far and the largest albedo seen: for progress."""


def supremum(
    albedo: PointwiseAlbedo,
    *,
    threshold: float = 1 + 1e-9,
    intervals: bool = True,
    rtol: float | None = None,
    effort: str = "normal",
    watch: Watch | None = None,
) -> Supremum:
    """The largest albedo of the family behind `albedo` over its box of parameters, cosines and azimuths.

    `intervals`: for a family of one parameter whose albedo exceeds `threshold`, also find where it does. `rtol`: the accuracy
    of the confirmed albedos, by default the best. `effort`: one of `EFFORTS`, how many points are scanned. A value that is not
    a number is returned as such where nothing else was found. Raises Finding where a user's BRDF fails.
    """
    search = _Search(albedo, threshold, rtol, effort, watch or (lambda points, best: None))
    with np.errstate(all="ignore"):
        found = search.run()
    if intervals and len(search.box.swept) == 1 and not np.isnan(found.value):
        above = intervals_above(albedo, search.box, search.winner, threshold) if found.least > threshold else ()
        found = replace(found, above=above)
    return found


@dataclass
class _Points:
    """Scanned points: places in the cube, values, how far they may be off, and the level of the rule (levels: confirmed)."""

    places: np.ndarray
    values: np.ndarray
    errors: np.ndarray
    levels: np.ndarray

    def joined(self, other: _Points) -> _Points:
        return _Points(
            *(np.concatenate([mine, theirs]) for mine, theirs in zip(vars(self).values(), vars(other).values(), strict=True))
        )


class _Search:
    """One search: its box, what it has seen, and what it has confirmed."""

    def __init__(self, albedo: PointwiseAlbedo, threshold: float, rtol: float | None, effort: str, watch: Watch):
        self.albedo, self.threshold, self.watch = albedo, threshold, watch
        family = albedo.family
        self.theorem = albedo.monotone and family.cos_theta[1] == 1
        self.scale = _SCALE[effort]
        # A function may turn out to be anisotropic in a place where it was not asked: scans look at all azimuths.
        self.box = Box(family.ranges, family.cos_theta, turning=not albedo.fast, fixed_angle=self.theorem)
        self.rtol = rtol if rtol is not None or albedo.fast else max(1e-9, _ROUNDINGS * albedo.epsilon)
        self.count = self.climbs = 0
        self.settled = True
        self.scanned: _Points | None = None
        self.confirmed = _Points(np.zeros((0, self.box.dimension)), np.zeros(0), np.zeros(0), np.zeros(0, int))
        self.gaps = np.zeros(0)
        self.winner = np.zeros(self.box.dimension)
        self.unbounded: tuple[np.ndarray, str] | None = None
        # How much of what they promised scanned points kept when they were confirmed, and where the quick rules resolve nothing
        # the points that were looked at by another one.
        self.kept = 1.0
        # Set where the rule of a verdict does not converge (jumps): more of its evaluations would tell little more.
        self.hard = False
        # Places at which the albedo is not a number.
        self.lost: list[np.ndarray] = []
        self.resolved_places: np.ndarray | None = None

    # --- albedos ---

    def estimate(self, level: int, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """By the rule of a level. What is not a number is nothing to climb to."""
        self.count += len(places)
        with np.errstate(all="ignore"):
            value, error = self.albedo.estimate(*self.box.physical(places), level)
        unknown = np.isnan(value)
        if len(self.lost) < _LOST:
            self.lost += list(places[np.flatnonzero(unknown)[:: max(1, np.count_nonzero(unknown) // 3)]])
        return np.where(np.isnan(value), -np.inf, value), np.where(np.isnan(value), 0, error)

    def produce(self, places: np.ndarray, rtol: float | None, *, limit: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """At the accuracy of a verdict; at grazing incidence the limit, or for a function just before it."""
        self.count += len(places)
        parameters, mu, azimuth = self.box.physical(places)
        if not (limit or self.albedo.fast):
            mu = np.maximum(mu, GRAZING)
        with np.errstate(all="ignore"):
            return self.albedo(parameters, mu, azimuth, rtol=rtol)

    def tell(self) -> None:
        best = np.max(self.confirmed.values, initial=-np.inf)
        if self.scanned is not None:
            best = max(best, float(np.max(self.scanned.values - self.scanned.errors, initial=-np.inf)))
        self.watch(self.count, float(best))

    # --- the steps ---

    def run(self) -> Supremum:
        size = min(len(self.box.swept), 3)
        count = int(_POINTS[size] * self.scale)
        if self.albedo.fast:
            count = max(count // (4 if self.theorem or not size else 2), 257)
        fresh = self.look(np.concatenate([self.box.landmarks(), self.box.scan(count, 0, self.cosines())]))
        self.scanned = fresh
        self.straighten()
        self.tell()
        self.ascend(fresh, _STARTS)
        self.rivals()
        self.graze()
        for again in range(4):
            before = self.best
            more = np.concatenate(
                [self.box.scan(count // 4, count + again * count, self.cosines()), self.near(count // 8, again)]
            )
            fresh = self.look(more)
            self.scanned = self.scanned.joined(fresh)
            self.tell()
            self.ascend(fresh, _STARTS // 4)
            if self.best > before:
                self.rivals()
            # Higher by more than the errors of the two.
            finite = np.isfinite(self.confirmed.values)
            blur = self.confirmed.errors[finite & (self.confirmed.values == self.best)]
            self.settled = not self.best > before + 1e-7 * max(1, abs(before)) + min(2 * np.min(blur, initial=0.005), 1e-2)
            if self.settled or self.unbounded is not None:
                break
        self.rest()
        self.finish()
        self.tighten()
        return self.answer()

    def cosines(self) -> int:
        return max(int(_COSINES * min(1, 2 * self.scale)), 257)

    def look(self, places: np.ndarray) -> _Points:
        """A scan by the quick rule, and finer rules where that may matter."""
        value, error = self.estimate(0, places)
        found = _Points(places, value, error, np.zeros(len(value), int))
        finer = (_THIRD,) if self.albedo.fast else (_SECOND, _THIRD)
        for level, most in zip(range(1, self.albedo.levels), finer, strict=False):
            self.sharpen(found, level, int(most * self.scale))
        return found

    def sharpen(self, points: _Points, level: int, most: int) -> None:
        """Take the points that may be the highest by the rule of the next level; the change is the error."""
        reach = points.values + points.errors
        known = np.isfinite(self.best)
        floor = self.best + (1e-9 if level > 1 else -_MARGIN * max(1, abs(self.best))) if known else -np.inf
        open_ = np.flatnonzero((points.levels == level - 1) & (reach > floor))
        if not self.albedo.fast:
            open_ = open_[points.errors[open_] > 1e-10]
        chosen = open_[np.argsort(-reach[open_])][:most]
        if not chosen.size:
            return
        value, error = self.estimate(level, points.places[chosen])
        if not self.albedo.fast:
            error = np.abs(value - points.values[chosen]) / 3
        points.values[chosen], points.errors[chosen], points.levels[chosen] = (
            value,
            np.where(np.isfinite(error), error, 0),
            level,
        )

    def straighten(self) -> None:
        """Without an axis for the azimuth where that does not matter."""
        if self.albedo.fast or self.scanned is None:
            return
        points = self.scanned
        # In single precision all albedos change by rounding when they turn: there the pairs have decided.
        if not self.albedo.anisotropic and self.albedo.epsilon < 1e-10:
            order = np.argsort(points.values)[::-1]
            some = np.concatenate([order[:128], order[128 :: max(1, len(order) // 128)]])
            places = points.places[some]
            values = []
            for turn in (0.0, 0.381966, 2e-7, 1e-6):
                moved = places.copy()
                moved[:, -1] = (moved[:, -1] + turn) % 1
                values.append(self.estimate(0, moved)[0])
            with np.errstate(all="ignore"):
                change, noise = np.abs(values[1] - values[0]), np.abs(np.array(values[2:]) - values[0]).max(axis=0)
                told = self.box.physical(places)[1] < 1 - 1e-6  # light along N has no azimuth
                told &= change > np.maximum(1e-7, 64 * self.albedo.epsilon) * np.maximum(np.abs(values[0]), 1e-3) + 10 * noise
            self.albedo.anisotropic = bool(np.any(told))
        if self.albedo.anisotropic:
            return
        self.box = Box(self.box.ranges, self.box.cosines, turning=False)
        points.places = points.places[:, :-1]
        self.confirmed.places = self.confirmed.places[:, :-1]

    @property
    def most(self) -> int:
        """How many scanned points may be confirmed at a time."""
        return 4 if self.hard else int(_CONFIRMED * self.scale)

    @property
    def best(self) -> float:
        """The largest confirmed albedo."""
        finite = self.confirmed.values[np.isfinite(self.confirmed.values)]
        return float(np.max(finite, initial=-np.inf))

    def starts(self, points: _Points, most: int) -> np.ndarray:
        """Indices of the best points that are well separated, from all angles; a plateau of equal values is few of them.

        Towards grazing many BRDFs reflect all there is: without shares for the other angles, starts would be nowhere else.
        """
        spacing = 0.5 * len(points.values) ** (-1 / max(self.box.dimension, 1))
        angles = points.places[:, len(self.box.swept)] if self.box.has_angle else np.zeros(len(points.values))
        share = np.minimum((angles * _SHARES).astype(int), _SHARES - 1)
        chosen: list[int] = []
        for part in np.unique(share):
            inside = np.flatnonzero((share == part) & np.isfinite(points.values))
            quota = -(-most // len(np.unique(share)))
            # One by what it may be, one by what it is at least, in turn.
            hopeful = inside[np.argsort(-(points.values + 0.5 * points.errors)[inside])]
            surely = inside[np.argsort(-(points.values - points.errors)[inside])]
            mine: list[int] = []
            for index in np.stack([surely, hopeful], axis=1).ravel()[: 128 * quota]:
                if len(mine) >= quota:
                    break
                value = points.values[index]
                if sum(abs(points.values[i] - value) <= 1e-7 * max(1.0, abs(value)) for i in mine) >= 2:
                    continue
                near = [*mine, *chosen]
                if (
                    near
                    and np.min(np.max(np.abs(self.box.apart(points.places[near], points.places[index])), axis=1, initial=0))
                    < spacing
                ):
                    continue
                mine.append(int(index))
            chosen += mine
        return np.array(chosen, int)

    def ascend(self, points: _Points, most: int) -> None:
        """Climb from the best points, rule after rule, and confirm where the climbs end."""
        self.follow(points, self.starts(points, max(int(most * min(1, 2 * self.scale)), 8)))

    def follow(self, points: _Points, chosen: np.ndarray) -> None:
        """Climb from some of the points."""
        dimension = self.box.dimension
        if not chosen.size:
            return
        self.climbs += len(chosen)
        places, radii = points.places[chosen], np.full(len(chosen), 0.25 * len(points.values) ** (-1 / max(dimension, 1)))
        # Where the quick rule is not good enough to climb by, the next one is.
        first = 1 if self.albedo.levels > 1 and np.median(points.errors[chosen]) > 1e-2 else 0
        kept = (len(chosen), 5 if self.albedo.fast else 10, 5)
        ends: Climbs | None = None
        doubt = points.errors[chosen]
        for level in range(first, self.albedo.levels):
            last = level == self.albedo.levels - 1
            ends = climb(
                lambda unit, level=level: self.estimate(level, unit),
                self.box,
                places,
                radii,
                goal=1e-12 if self.albedo.fast and last else 1e-10 if last else 1e-5,
                rounds=40 if last else 24,
                smallest=1e-12 if self.albedo.fast and last else 1e-8 if last else 1e-4,
                drop=1e-2 if level else 5e-2,
                check=self.tell,
            )
            self.poles(ends, level)
            if self.unbounded is not None:
                return
            if not last:
                finer, _ = self.estimate(level + 1, ends.places)
                doubt = np.abs(finer - ends.values) / 3
                ends.values[:] = finer
                keep = self.distinct(ends, doubt, kept[level + 1])
                doubt = doubt[keep]
                places, radii = ends.places[keep], np.clip(3 * ends.radii[keep], 1e-3, 0.05)
        assert ends is not None
        keep = self.distinct(ends, doubt, 4)
        keep = np.array([i for i in keep if not self.known(ends.places[i]) or ends.values[i] > self.best + 1e-8], int)
        self.confirm(ends.places[keep], ends.taken(keep))
        # What the scan saw higher than the climbs ended is confirmed as it is: a jump, or a place that no model fits.
        reach = points.values + points.errors
        higher = np.flatnonzero((points.levels == self.albedo.levels - 1) & (reach > self.best + 1e-9))
        self.confirm(points.places[higher[np.argsort(-reach[higher])][: self.most]])

    def rivals(self) -> None:
        """Climb from the crests that lines through the winner, along each axis, go over."""
        finite = np.isfinite(self.confirmed.values)
        if not np.any(finite) or not self.box.dimension or self.unbounded is not None or self.hard:
            return
        winner = self.confirmed.places[int(np.argmax(np.where(finite, self.confirmed.values, -np.inf)))]
        along = np.linspace(0, 1, max(int(_LINE * self.scale), 65))
        lines = np.tile(winner, (self.box.dimension, len(along), 1))
        for axis in range(self.box.dimension):
            lines[axis, :, axis] = along
        value, error = self.estimate(0, lines.reshape(-1, self.box.dimension))
        height = np.pad(value.reshape(len(lines), -1), ((0, 0), (1, 1)), constant_values=-np.inf)
        crest = (height[:, 1:-1] > height[:, :-2]) & (height[:, 1:-1] >= height[:, 2:])
        crest &= np.abs(along - winner[:, None]) > 1.5 / len(along)
        # How high a crest is between the points of its line: by a parabola.
        before, middle, after = height[:, :-2], height[:, 1:-1], height[:, 2:]
        with np.errstate(all="ignore"):
            bend = before - 2 * middle + after
            top = np.where(np.isfinite(bend) & (bend < 0), middle - (after - before) ** 2 / (8 * bend), middle).ravel()
        tops = np.flatnonzero(crest.ravel() & (top > self.best - 2e-2 * max(1, abs(self.best))))
        found = _Points(lines.reshape(-1, self.box.dimension), value, error, np.zeros(len(value), int))
        self.follow(found, tops[np.argsort(-top[tops])][:_RIVALS])

    def distinct(self, ends: Climbs, doubt: np.ndarray, most: int) -> np.ndarray:
        """The highest climbs, one for each place: by what they may be and by what they are at least, in turn."""
        doubt = np.where(np.isfinite(doubt), doubt, 0)
        order = np.stack([np.argsort(-(ends.values - doubt)), np.argsort(-(ends.values + doubt))], axis=1).ravel()
        least = np.max(ends.values - doubt, initial=-np.inf)
        chosen: list[int] = []
        for index in order:
            if len(chosen) >= most:
                break
            if index in chosen or not ends.values[index] + doubt[index] > least - 2e-2 * max(1, abs(least)):
                continue
            near = [i for i in chosen if np.max(np.abs(self.box.apart(ends.places[i], ends.places[index])), initial=0) < 1e-3]
            if not near:
                chosen.append(int(index))
        return np.array(chosen, int)

    def known(self, place: np.ndarray) -> bool:
        """True where a climb has been confirmed there already."""
        near = np.max(np.abs(self.box.apart(self.confirmed.places, place)), axis=1, initial=0) < _SAME
        return bool(np.any(near & (self.gaps > 0)))

    # --- confirming ---

    def confirm(self, places: np.ndarray, ends: Climbs | None = None) -> None:
        """Albedos at the accuracy of a verdict. With `ends`: of climbs, whose best are followed to the top by that rule too."""
        if not len(places):
            return
        gaps = np.zeros(len(places)) if ends is None else np.where(np.isfinite(ends.gaps), ends.gaps, 0)
        if self.albedo.levels == 1 and ends is not None:  # the rule of the climb is that of a verdict
            self.add(ends.places, ends.values, ends.errors, gaps)
            return
        value, error = self.resolved(places)
        if ends is not None:
            # What a climb says of its gap is worth nothing where the quick rule that it went by is far off.
            off = np.abs(ends.values - np.where(np.isfinite(value), value, ends.values))
            gaps = np.where((off > 1e-3) & (off > gaps), 0, gaps)
        self.add(places, value, error, gaps)
        if ends is None or self.unbounded is not None or not np.any(np.isfinite(value)):
            return
        # Where the rule does not reach its accuracy (edges, jumps), a climb by it would take forever: a coarser one does.
        worth = np.flatnonzero((error < 1e-4) & (value + 3 * error > max(np.nanmax(value), self.best - 1e-6) - 1e-6))
        worth = worth[np.argsort(-value[worth])][:2]
        if worth.size:
            smooth = self.albedo.fast or error[worth[0]] <= 3 * max(self.rtol or 0, 1e-9) * max(abs(value[worth[0]]), 1)
            accuracy = self.rtol if smooth else 1e-6
            polished = climb(
                lambda unit: self.produce(unit, accuracy),
                self.box,
                places[worth],
                np.clip(10 * ends.radii[worth], 1e-4, 2e-3),
                goal=2e-11 if smooth else 1e-8,
                rounds=8 if smooth else 6,
                smallest=1e-9,
                mixed=ends.mixed[worth],
                calm=1,
                check=self.tell,
            )
            left = np.where(np.isfinite(polished.gaps), polished.gaps, 1e-6)
            self.add(polished.places, polished.values, polished.errors, left)
            if not smooth:
                top = [int(np.argmax(polished.values))]
                self.add(polished.places[top], *self.produce(polished.places[top], self.rtol), left[top])
        if self.box.has_angle and not self.albedo.fast and self.box.cosines[0] == 0:
            grazing = self.confirmed.places[-max(len(worth), 1) :]
            self.limits(grazing[grazing[:, len(self.box.swept)] < 0.02])

    def resolved(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Albedos of some places, the more accurate the higher: what is clearly lower than the best needs no digits."""
        if self.albedo.fast:
            return self.produce(places, self.rtol)
        final = max(self.rtol or 0, 1e-13)
        value, error = np.full(len(places), -np.inf), np.full(len(places), np.inf)
        some = np.arange(len(places))
        rungs = [rung for rung in _RUNGS if rung > final]
        for rtol in rungs if self.hard and rungs else [*rungs, final]:
            value[some], error[some] = self.produce(places[some], rtol)
            finite = np.isfinite(value)
            least = max(self.best, float(np.max((value - error)[finite], initial=-np.inf)))
            some = np.flatnonzero(finite & (value + error >= least) & (error > 0))
            # What did not come near the accuracy asked for has an edge or a jump: only the highest is tried once more.
            stuck = error[some] > 3 * rtol * np.maximum(np.abs(value[some]), 1)
            self.hard |= bool(rtol == _RUNGS[-1] and some.size and np.all(error[some] > _HARD))
            order = np.argsort(-value[some])
            some = some[order][: 1 if np.any(stuck) else _FINEST]
            if not some.size:
                break
        return value, error

    def add(self, places: np.ndarray, value: np.ndarray, error: np.ndarray, gaps: np.ndarray) -> None:
        fresh = _Points(places, value, error, np.full(len(value), self.albedo.levels))
        self.confirmed = self.confirmed.joined(fresh)
        self.gaps = np.concatenate([self.gaps, gaps])
        for index in np.flatnonzero(np.isposinf(value)):
            if self.unbounded is None:
                self.unbounded = places[index], self.whither(places[index])

    def whither(self, place: np.ndarray) -> str:
        _, mu, _ = self.box.physical(place[None])
        if mu[0] == 0:
            return "towards grazing incidence"
        return "everywhere near this place: the integral over the hemisphere does not converge"

    # --- grazing light and poles ---

    def graze(self) -> None:
        """The limit at grazing incidence where the decades before it promise more than has been found."""
        ladder = self.box.grazing(int(64 * self.scale))
        if not len(ladder) or self.albedo.fast:
            return
        if len(self.confirmed.places):
            ladder = np.concatenate([ladder, self.box.at_decades(self.confirmed.places[-8:])])
        value, _ = self.estimate(0, ladder.reshape(-1, self.box.dimension))
        value = value.reshape(len(ladder), len(DECADES))
        with np.errstate(all="ignore"):
            step, before = value[:, -1] - value[:, -2], value[:, -2] - value[:, -3]
            ratio = np.clip(np.where(before > 0, step / before, 0), 0, 0.98)
            promise = value[:, -1] + np.where(step > 1e-8 * np.abs(value[:, -1]), step * ratio / (1 - ratio), 0)
        promise = np.where(np.isfinite(promise), promise, -np.inf)
        order = np.argsort(promise)[::-1]
        worth = [index for index in order if promise[index] > self.best - 2e-3 * max(1, abs(self.best))][:4]
        # Growth that has not come far yet is followed too.
        growing = [index for index in order if step[index] > 1e-6 * max(1e-9, abs(value[index, -1])) and ratio[index] > 0.93][
            :2
        ]
        self.limits(ladder[sorted({*worth, *growing}), -1])

    def limits(self, places: np.ndarray) -> None:
        """The limits at grazing incidence for the parameters and azimuths of some places; the best is followed to its top."""
        if not len(places):
            return
        swept = len(self.box.swept)
        places = places.copy()
        places[:, swept] = 0
        before, _ = self.produce(places, 1e-7)
        value, error = self.produce(places, _RUNGS[0] if self.hard else max(self.rtol or 0, 1e-9), limit=True)
        self.add(places, value, error, np.zeros(len(value)))
        finite = np.isfinite(value)
        if self.unbounded is not None or not np.any(finite):
            return
        top = int(np.argmax(np.where(finite, value, -np.inf)))
        if value[top] < self.best - 1e-6 or self.box.dimension == 1:
            return
        # Where the limit is that of values just before it, the climb that led here has found the best parameters.
        if abs(value[top] - before[top]) < 1e-6:
            return
        inner = Box(self.box.ranges, (1.0, 1.0), turning=self.box.turning)
        found = climb(
            lambda rest: self.produce(np.insert(rest, swept, 0.0, axis=1), 1e-8, limit=True),
            inner,
            np.delete(places[top], swept)[None],
            0.03,
            goal=1e-9,
            rounds=8 if inner.dimension < 4 else 4,
            smallest=1e-6,
            check=self.tell,
        )
        gaps = np.where(np.isfinite(found.gaps), found.gaps, 1e-6)
        self.add(np.insert(found.places, swept, 0.0, axis=1), found.values, found.errors, gaps)

    def poles(self, ends: Climbs, level: int) -> None:
        """Whether a climb to a large value is one towards a pole: it goes on growing as the surroundings shrink."""
        for index in np.argsort(ends.values)[::-1][:2]:
            if ends.values[index] < _SUSPICIOUS:
                return
            if self.whether_pole(ends.places[index], float(ends.values[index]), level):
                return

    def whether_pole(self, place: np.ndarray, value: float, level: int) -> bool:
        random = np.random.default_rng(4)
        dimension = self.box.dimension
        tops, around = [], []
        for exponent in range(1, 15):
            offsets = random.uniform(-1, 1, (48 + 16 * dimension, dimension))
            offsets[: 4 * dimension] = np.concatenate([np.eye(dimension) * s for s in (1, -1, 0.5, -0.5)])
            places = self.box.kept(place + 10.0**-exponent * offsets)
            found, _ = self.estimate(level, places)
            top = int(np.argmax(found))
            if found[top] > value:
                place, value = places[top], float(found[top])
            tops.append(value)
            around.append(float(np.median(found)))
            self.tell()
        rising = np.array(around[1:]) > 1.2 * np.abs(np.array(around[:-1]))
        nearer = np.array(tops[1:]) > 1.2 * np.array(tops[:-1])
        # Higher the nearer, over decades; and no end to it where the surroundings are smaller than the distance to the pole.
        if np.count_nonzero(rising) + np.count_nonzero(nearer) < 6 or not (
            np.all(nearer[-3:]) or np.all(rising[-5:-2]) or value > 1e15
        ):
            return False
        parameters, mu, _ = self.box.physical(place[None])
        names = [f"{name}={number:.4g}" for name, number in zip(self.box.ranges, parameters[0], strict=True)]
        if mu[0] <= cosine_at(np.array(1e-3)):
            return False  # that is grazing, which has a limit of its own
        self.unbounded = place, f"towards {' '.join([*names, f'cos={mu[0]:.4g}'])}"
        self.add(place[None], np.array([np.inf]), np.array([np.inf]), np.zeros(1))
        return True

    # --- looking again ---

    def near(self, count: int, seed: int) -> np.ndarray:
        """Points where the surface may rise above the best between the points known so far: `count` of them, at most."""
        points = self.scanned
        dimension = self.box.dimension
        assert points is not None
        good = np.flatnonzero(np.isfinite(points.values))
        if dimension == 0 or len(good) < 4 * (dimension + 1):
            return np.zeros((0, dimension))
        tree = KDTree(points.places[good])
        top = good[np.argsort(points.values[good])[::-1][: min(len(good), 4096)]]
        distance, neighbours = tree.query(points.places[top], k=2 * dimension + 2)
        around = points.values[good][neighbours]
        # As steep on as it was so far: what a point could be half way to the next.
        steep = np.max(np.abs(around - points.values[top][:, None]), axis=1)
        hope = points.values[top] + 0.5 * steep
        centres = np.argsort(hope)[::-1][: max(1, count // 3)]
        random = np.random.default_rng(100 + seed)
        reach = np.maximum(distance[centres, -1], 1e-4)[:, None]
        moved = [points.places[top[centres]] + reach * random.normal(0, 0.5, (len(centres), dimension)) for _ in range(3)]
        return self.box.kept(np.concatenate(moved))

    def rest(self) -> None:
        """Confirm what could still be higher than the winner by its own error.

        Where that is much of the scan, the quick rules do not resolve the BRDF (a spot between their nodes): then the rule of a
        verdict looks at a few hundred points, and climbs.
        """
        points = self.scanned
        assert points is not None
        if self.albedo.fast:
            return
        self.sharpen(points, self.albedo.levels - 1, int(2 * _SECOND * self.scale))
        most = self.most
        left = self.doubtful()
        if len(left) > most:
            spread = self.box.scan(4 * most, 10**6, self.cosines())
            if spread.shape[1] > self.box.dimension:
                spread = spread[:, : self.box.dimension]
            places = np.concatenate([points.places[left[:: max(1, len(left) // (2 * most))]], spread])
            value, error = self.produce(places, _RUNGS[0])
            known = _Points(
                places,
                np.where(np.isfinite(value), value, -np.inf),
                np.where(np.isfinite(error), error, 0),
                np.zeros(len(value), int),
            )
            if not self.hard:
                starts = self.starts(known, 8)[:4]
                starts = starts[np.argsort(-known.values[starts])]
                ends = climb(
                    lambda unit: self.produce(unit, _RUNGS[0]),
                    self.box,
                    known.places[starts],
                    0.05,
                    goal=1e-6,
                    rounds=6,
                    smallest=1e-4,
                    drop=1e-2,
                    check=self.tell,
                )
                self.climbs += len(starts)
                self.confirm(ends.places[np.argsort(-ends.values)][:2], ends.taken(np.argsort(-ends.values)[:2]))
            else:
                self.confirm(known.places[np.argsort(-known.values)[:2]])
            self.resolved_places = places
        if left.size:
            reach = points.values + points.errors
            some = left[np.argsort(-reach[left])][:most]
            best = self.best
            before = len(self.confirmed.values)
            self.confirm(points.places[some])
            fresh = slice(before, before + len(some))
            points.levels[some] = self.albedo.levels
            with np.errstate(all="ignore"):
                kept = (self.confirmed.values - self.confirmed.errors)[fresh] - best
                self.kept = float(np.clip(np.nan_to_num(np.max(kept / np.maximum(reach[some] - best, 1e-300)), nan=1.0), 0, 1))

    def doubtful(self) -> np.ndarray:
        """Indices of scanned points that may be higher than the winner by their own error, away from the winners.

        Around a winner it is the climb that tells how high it goes.
        """
        points = self.scanned
        assert points is not None
        inside = (points.levels > 0) & (points.levels < self.albedo.levels) & (points.errors > 1e-7)
        indices = np.flatnonzero(inside & (points.values + points.errors > self.best + 1e-9))
        known = self.confirmed.places[self.confirmed.values > self.best - 1e-3 * max(1, abs(self.best))]
        away = [
            np.min(np.max(np.abs(self.box.apart(known, points.places[i])), axis=1, initial=0), initial=np.inf) > _AROUND
            for i in indices
        ]
        return indices[np.array(away, bool)]

    # --- the answer ---

    def tighten(self) -> None:
        """More digits for places that are as high as the winner only by their own error."""
        if self.albedo.fast or self.unbounded is not None:
            return
        confirmed = self.confirmed
        for i in range(len(confirmed.values)):
            # What was asked again at the same place with more accuracy (and is the same: a limit is not) is known by that.
            same = np.flatnonzero(np.all(confirmed.places == confirmed.places[i], axis=1))
            j = same[np.argmin(confirmed.errors[same])]
            apart = abs(confirmed.values[i] - confirmed.values[j]) > confirmed.errors[i] + confirmed.errors[j]
            if confirmed.errors[j] < confirmed.errors[i] / 10 and not apart:
                confirmed.values[i], confirmed.errors[i] = confirmed.values[j], confirmed.errors[j]
        for _ in range(10):
            finite = np.isfinite(confirmed.values)
            if not np.any(finite):
                return
            top = int(np.argmax(np.where(finite, confirmed.values - confirmed.errors, -np.inf)))
            reach = np.where(finite, confirmed.values + confirmed.errors, -np.inf)
            loose = np.flatnonzero((reach > reach[top]) & (confirmed.errors > 2 * confirmed.errors[top]))
            loose = loose[np.argsort(-reach[loose])][:_FINEST]
            limit = confirmed.places[:, len(self.box.swept)] == 0 if self.box.has_angle else np.zeros(len(reach), bool)
            loose = loose[~limit[loose]]
            if not loose.size:
                return
            value, error = self.produce(confirmed.places[loose], self.rtol)
            better = error < confirmed.errors[loose]
            confirmed.values[loose[better]], confirmed.errors[loose[better]] = value[better], error[better]

    def finish(self) -> None:
        """Climb on, by the rule of a verdict, where a climb stopped early and could still become the highest."""
        if self.albedo.fast or self.unbounded is not None or self.hard or not self.box.dimension:
            return
        confirmed = self.confirmed
        finite = np.isfinite(confirmed.values)
        if not np.any(finite):
            return
        top = int(np.argmax(np.where(finite, confirmed.values - confirmed.errors, -np.inf)))
        counted = self.counted(confirmed.places[top])
        reach = np.where(finite, confirmed.values + confirmed.errors + counted, -np.inf)
        early = np.flatnonzero((reach > confirmed.values[top] + confirmed.errors[top]) & (counted > confirmed.errors))
        early = early[early != top]
        early = early[np.argsort(-reach[early])][:4]
        if not early.size:
            return
        ends = climb(
            lambda unit: self.produce(unit, self.rtol),
            self.box,
            confirmed.places[early],
            1e-3,
            goal=1e-10,
            rounds=5,
            smallest=1e-8,
            calm=1,
            check=self.tell,
        )
        self.gaps[early] = 0
        self.add(ends.places, ends.values, ends.errors, np.where(np.isfinite(ends.gaps), ends.gaps, 1e-6))

    def answer(self) -> Supremum:
        assert self.scanned is not None
        confirmed = self.confirmed
        finite = np.isfinite(confirmed.values)
        basis = "theorem" if self.theorem else "search"
        common = {
            "threshold": self.threshold,
            "basis": basis,
            "points": self.count,
            "climbs": self.climbs,
            "width": self.width(),
        }
        if self.unbounded is not None:
            place, whither = self.unbounded
            self.winner = place
            return self.at(place, np.inf, np.inf, least=np.inf, settled=True, unbounded=whither, **common)
        if not np.any(finite):
            place = confirmed.places[0] if len(confirmed.places) else self.scanned.places[0]
            return self.at(place, np.nan, np.inf, settled=False, **common)
        # Of values that are equal within their errors, the one that is known best.
        top = int(np.argmax(np.where(finite, confirmed.values - confirmed.errors, -np.inf)))
        value, error = float(confirmed.values[top]), float(confirmed.errors[top])
        self.winner = confirmed.places[top]
        with np.errstate(invalid="ignore"):
            upper = float(np.max(np.where(finite, confirmed.values + confirmed.errors + self.counted(self.winner), -np.inf)))
        # A place that could not be resolved, and could be higher.
        if not self.albedo.fast:
            # Of those that promised most, so much was kept; the others are not taken to keep more.
            promise = float(np.max((self.scanned.values + self.scanned.errors)[self.doubtful()], initial=-np.inf))
            upper = max(upper, self.best + self.kept * max(promise - self.best, 0))
        broken = ~np.isfinite(confirmed.values) & ~np.isposinf(confirmed.values)
        least = float(np.max(np.where(finite, confirmed.values - confirmed.errors, -np.inf)))
        bar = max(upper - value, error)
        if np.any(broken) or self.unknown():  # somewhere the albedo is not known at all
            bar = np.inf if least <= self.threshold else bar
        return self.at(self.winner, value, bar, least=least, settled=self.settled, **common)

    def unknown(self) -> bool:
        """True where the albedo is not a number at more than single angles, beside which it is one."""
        if not self.lost:
            return False
        # Some were seen before the azimuth was known not to matter.
        places = np.array([place[: self.box.dimension] for place in self.lost[:_LOST]])
        value, _ = self.produce(places, _RUNGS[0])
        return bool(np.any(np.isnan(value)))

    def counted(self, winner: np.ndarray) -> np.ndarray:
        """What the climbs left, but for those around the winner: there its own climb tells."""
        away = np.max(np.abs(self.box.apart(self.confirmed.places, winner)), axis=1, initial=0) > _AROUND
        own = np.all(self.confirmed.places == winner, axis=1)
        close = self.confirmed.values > self.best - 1e-2 * max(1, abs(self.best))
        return np.where((away & close) | own, self.gaps, 0)

    def at(self, place: np.ndarray, value: float, error: float, **more: object) -> Supremum:
        parameters, mu, azimuth = self.box.physical(place[None])
        channel, channels = None, 1
        if self.albedo.evaluator is None or (self.albedo.evaluator.channels or 1) > 1:
            with np.errstate(all="ignore"):
                every, _ = self.albedo.channels(
                    parameters, np.maximum(mu, 1e-9), azimuth, rtol=None if self.albedo.fast else 1e-5
                )
            if every.ndim > 1 and every.shape[1] > 1:
                channel, channels = int(np.argmax(np.where(np.isnan(every[0]), -np.inf, every[0]))), every.shape[1]
        names = {name: float(number) for name, number in zip(self.box.ranges, parameters[0], strict=True)}
        return Supremum(value, error, names, float(mu[0]), float(azimuth[0]), channel=channel, channels=channels, **more)  # pyright: ignore[reportArgumentType]

    def width(self) -> dict[str, float]:
        """The widest region that the scan may have missed: the largest gaps between its points, axis by axis and in all."""
        assert self.scanned is not None
        places = self.scanned.places if self.resolved_places is None else self.resolved_places
        found: dict[str, float] = {}
        for axis, name in enumerate(self.box.names):
            values = np.unique(np.concatenate([[0.0, 1.0], places[:, axis]]))
            gap = float(np.max(np.diff(values)))
            if name == "angle":
                middle = np.linspace(0, 1, 512)
                ends = np.clip(np.stack([middle - gap / 2, middle + gap / 2]), 0, 1)
                low, high = (np.degrees(np.arccos(np.clip(self.box.physical(self._along(axis, end))[1], 0, 1))) for end in ends)
                gap = float(np.max(np.abs(low - high)))
            elif name == "azimuth":
                gap *= 360.0
            found[name] = gap
        if self.box.dimension > 1:
            found["cell"] = float(min(1.0, 2.5 * len(places) ** (-1 / self.box.dimension)))
        return found

    def _along(self, axis: int, values: np.ndarray) -> np.ndarray:
        places = np.zeros((len(values), self.box.dimension))
        places[:, axis] = values
        return places
