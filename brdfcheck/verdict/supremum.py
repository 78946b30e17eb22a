r"""The largest albedo of a family over a box of parameters and angles: a continuous maximum, with an error bar.

No direction and no parameter is assumed to be the worst, except by theorem (lobes that do not rise with their angle are
largest at normal incidence). The search has four steps, and its answer says what it rests on:

1. *Scan* (`verdict.scan`): thousands of points, evenly spread and at all corners, edges and ends, by a quick rule. What is
   high, or may be high within its error, is looked at again by finer rules.
2. *Climb* (`verdict.climb`) from the best well-separated points, by quadratic models, rule after rule.
3. *Look again*: disjoint points, half of them where the surface is steep, close to the largest value or on a ridge; until
   nothing higher is found.
4. *Confirm* (`verdict.confirm`): the winners at the accuracy of a verdict, by the rule with an error bar of its own. The bar
   holds the error of the quadrature, what the climb may have left, and whatever other place could still be higher.

Grazing light is its limit; where the albedo grows without bound, towards grazing or towards a pole inside the box, that is
the answer, and no number.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from brdfcheck.quadrature.members import OtherKind
from brdfcheck.quadrature.pointwise import GRAZING, PointwiseAlbedo, TwoSided
from brdfcheck.verdict.climb import CREST, Climbs, Trail, climb
from brdfcheck.verdict.confirm import RUNGS, Confirmation
from brdfcheck.verdict.intervals import intervals_above
from brdfcheck.verdict.kinks import up_crests
from brdfcheck.verdict.scan import Points, Scan, standing_out
from brdfcheck.verdict.surface import GRAZES, Surface, Watch
from brdfcheck.verdict.winners import AROUND, Winners

EFFORTS = ("quick", "normal", "thorough")
NORMAL_IS_WORST = "normal incidence is the worst angle"
NEVER_ABOVE_ONE = "masked facets never reflect more than they receive"
NEVER_ABOVE_ONE_IN_ALL = "a boundary never reflects and transmits more than it receives"
_SCALE = {"quick": 0.25, "normal": 1.0, "thorough": 4.0}
# What a function that is called for each pair of directions is given of each: by the second of them it takes minutes.
_ONE_BY_ONE = {"quick": "quick", "normal": "quick", "thorough": "normal"}
_STARTS = 40
# The part of the points that are scanned where a theorem or a proof has the verdict.
_BOUNDED = 1 / 16
# How many of the highest points are confirmed then before any climb, and how near to 1 is as high as can be.
_HIGHEST, _TOP = 4, 1e-9
# Scans after the first one, at most.
_AGAIN = 4
# Ends of climbs that are nearer to each other are one, if they are as high.
_SAME, _LEVEL = 1e-3, 1e-5
# Points of a line through the winner along each axis, and how many of the crests found on them are climbed.
_LINE, _RIVALS = 513, 24
# By how much a rule may err for its crests to be followed.
_ROUGH = 1e-4
# What is this much lower than the best (relative to it) is none.
_NO_RIVAL = 2e-2
# How many scanned points are confirmed at a time, and of a BRDF with jumps.
_CONFIRMED, _CONFIRMED_JUMPS = 16, 4
# Parameters at which all decades towards grazing are looked at, besides the corners.
_GRAZING_LIGHT = 64
# By how much what is in doubt must exceed the best for the quick rules to count as blind.
_IN_DOUBT = 1e-3


@dataclass(frozen=True)
class Supremum:
    """Where the albedo of a family is largest, and what that rests on.

    `value` +- `error` is the largest albedo, `parameters`, `cos_theta` and `azimuth` (radians) say where; `least` is what it
    is at least. `above` are the intervals of the single parameter in which some angle exceeds the line (None where they
    were not looked for). `basis`: "theorem" where one holds (`theorem` says which), else "search". `points` were scanned,
    `climbs` begun; `settled` says that the last scan found nothing higher, and that no climb was left unfinished that might
    yet cross the line. `width`: the widest region that the scan may have missed: by parameter, as a part of its range, "angle",
    "azimuth" and "view" (the reflected directions of a function) in degrees, and "cell" in all at once. `unbounded` says where
    the albedo grows without bound (value and error are then infinite), `channel` which channel is the largest.
    """

    value: float
    error: float
    parameters: dict[str, float]
    cos_theta: float
    azimuth: float
    above: tuple[tuple[float, float], ...] | None = field(default=None)
    least: float = -np.inf
    basis: str = "search"
    theorem: str | None = None
    points: int = 0
    climbs: int = 0
    settled: bool = True
    width: Mapping[str, float] = field(default_factory=dict)
    unbounded: str | None = None
    channel: int | None = None
    channels: int = 1


def affordable(effort: str, albedo: PointwiseAlbedo) -> str:
    """The effort that a search makes where `effort` was asked for: less for a function that is called pair by pair."""
    return _ONE_BY_ONE[effort] if albedo.one_by_one else effort


def supremum(
    albedo: PointwiseAlbedo,
    *,
    threshold: float = 1 + 1e-9,
    intervals: bool = True,
    rtol: float | None = None,
    effort: str = "normal",
    axial: bool = False,
    watch: Watch | None = None,
) -> Supremum:
    """The largest albedo of the family behind `albedo` over its box of parameters, cosines and azimuths.

    `intervals`: for a family of one parameter whose albedo exceeds `threshold`, also find where it does. `rtol`: the accuracy
    of the confirmed albedos, by default the best. `effort`: one of `EFFORTS`, how many points are scanned, as far as that is
    `affordable`. `axial`: all kinks are known to run along the axes, as those of look-ups do. A value that is not a number is
    returned as such where nothing else was found. Raises Finding where a user's BRDF fails.
    """
    watch = watch or (lambda points, best: None)
    try:
        search = _Search(albedo, threshold, rtol, effort, axial, watch)
        with np.errstate(all="ignore"):
            found = search.run()
            search.surface.confirm_sides(search.winner)
    except (TwoSided, OtherKind):  # found out late: from now on on both sides of the plane of incidence, or as functions
        albedo.mirrored = False
        again = {"threshold": threshold, "intervals": intervals, "rtol": rtol, "effort": effort, "axial": axial}
        return supremum(albedo, watch=watch, **again)
    box = search.surface.box
    # Between the two values of a switch there is nothing.
    if intervals and len(box.swept) == 1 and not albedo.family.switches & {*box.swept} and not np.isnan(found.value):
        above = intervals_above(albedo, box, search.winner, search.scan.points, threshold) if found.least > threshold else ()
        found = replace(found, above=above)
    return found


class _Search:
    """One search: its surface, what it has scanned, and what it has confirmed."""

    def __init__(self, albedo: PointwiseAlbedo, threshold: float, rtol: float | None, effort: str, axial: bool, watch: Watch):
        # What a climb allows for where a kink may run across the axes.
        self.crest = 0.0 if axial else CREST
        self.bounded = (albedo.bounded or albedo.proved) and threshold >= 1
        self.costly = albedo.family.surface is not None
        # Where the verdict is a theorem's, or that of a proof, only the value is left to look for.
        self.threshold, self.scale = threshold, _SCALE[affordable(effort, albedo)]
        if self.bounded:
            self.scale *= _BOUNDED / 4 if self.costly else _BOUNDED
        self.surface = Surface(albedo, rtol, watch)
        self.scan = Scan(self.surface, self.scale)
        self.winners = Winners(self.surface.box)
        self.confirm = Confirmation(self.surface, self.winners, self.tell)
        self.winner = np.zeros(self.surface.box.dimension)
        # Parameters of which all angles are looked at.
        self.odd = np.zeros((0, self.surface.box.dimension))
        self.climbs = 0
        # By level, where climbs ended from which finer rules went on to a settled end: there the way is known.
        self.known: dict[int, Trail] = {}
        # The part of their promise (how far they might rise above the best) that scanned points kept when they were confirmed;
        # and the points looked at by the rule of a verdict where the quick rules resolve nothing.
        self.kept = 1.0
        self.resolved: np.ndarray | None = None

    def tell(self) -> None:
        self.surface.tell(self.winners.least)

    def run(self) -> Supremum:
        surface, scan, winners = self.surface, self.scan, self.winners
        self.tell()
        if self.bounded:
            self.confirm.places(scan.points.places[np.argsort(-scan.points.values)[:_HIGHEST]])
            # There is nothing left to find; or a point costs so much that the bar may as well reach up to 1.
            if winners.least >= 1 - _TOP or self.costly:
                return self.answer(True)
        # A single place, by a rule with digits to spare: there is nothing to climb. Of functions several rules are to agree.
        if surface.fast and surface.rtol is None and not surface.box.dimension:
            self.confirm.places(scan.points.places[:1])
            return self.answer(True)
        self.ascend(scan.points, _STARTS)
        self.every_channel()
        self.rivals()
        self.confirm.graze(int(_GRAZING_LIGHT * self.scale))
        settled = False
        for turn in range(_AGAIN):
            before = winners.best
            winner = winners.places[winners.top] if len(winners) else scan.points.places[0]
            fresh = scan.again(turn, before, winner, self.odd)
            self.tell()
            self.ascend(fresh, _STARTS // 4)
            # Higher by more than the errors of the two.
            blur = 2 * float(np.min(winners.errors[winners.finite & (winners.values == winners.best)], initial=0.005))
            if winners.best > before + blur:
                self.rivals()
            settled = not winners.best > before + 1e-7 * max(1, abs(before)) + min(blur, 1e-2)
            if settled or self.confirm.unbounded is not None:
                break
        self.rest()
        self.confirm.lines()
        self.confirm.finish()
        self.confirm.tighten()
        self.confirm.finish()  # with more digits the winner may be another one, that was not climbed from
        self.confirm.level()
        surface.tell(winners.least)
        return self.answer(settled)

    # --- climbs ---

    def ascend(self, points: Points, most: int) -> None:
        """Climb from the best points, rule after rule, and confirm where the climbs end."""
        self.follow(points, self.scan.starts(points, max(int(most * min(1, 2 * self.scale)), 8)))

    def every_channel(self) -> None:
        """Climb each channel by itself: the largest of all does not lead to a top of one that another surrounds."""
        for channel, points in self.scan.channels.items():
            starts = self.scan.starts(points, _STARTS // 5)
            best = self.winners.best
            self.surface.channel = channel
            self.follow(points, starts[points.values[starts] > best - _NO_RIVAL * max(1, abs(best))])
        self.surface.channel = None

    def follow(self, points: Points, chosen: np.ndarray) -> None:
        """Climb from some of the points."""
        surface, box = self.surface, self.surface.box
        if not chosen.size or self.confirm.unbounded is not None:
            return
        self.climbs += len(chosen)
        places = points.places[chosen]
        radii = np.full(len(chosen), 0.25 * len(points.values) ** (-1 / max(box.dimension, 1)))
        # Where the quick rule is not good enough to climb by, the next one is.
        first = 1 if surface.finest > 0 and np.median(points.errors[chosen]) > 1e-2 else 0
        kept = (len(chosen), 5 if surface.fast else 10, 5)
        ends: Climbs | None = None
        trails: dict[int, Trail] = {}
        doubt, kinked = points.errors[chosen], np.zeros(len(chosen), bool)
        for level in range(first, surface.finest + 1):
            last = level == surface.finest
            ends = climb(
                lambda unit, level=level: surface.estimate(level, unit),
                box,
                places,
                radii,
                goal=surface.rise(1e-12 if surface.fast and last else 1e-10 if last else _LEVEL),
                rounds=40 if last else 24,
                smallest=surface.step(1e-12 if surface.fast and last else 1e-8 if last else 1e-4),
                drop=1e-2 if level else 5e-2,
                crest=self.crest,
                check=self.tell,
            )
            ends.kinked |= kinked  # the short stencils that a finer rule begins with may not see it any more
            self.confirm.poles(ends, level)
            if self.confirm.unbounded is not None:
                return
            if not last:
                finer, _ = surface.estimate(level + 1, ends.places)
                doubt = np.abs(finer - ends.values) / 3
                ends.values[:] = finer
                here = Trail(ends.places, finer)
                keep = self.distinct(ends, doubt, kept[level + 1])
                keep = keep[self.unknown(here.taken(keep), level)]
                if not keep.size:
                    break
                doubt, kinked = doubt[keep], ends.kinked[keep] & (level > 0)
                trails = {key: trail.taken(keep) for key, trail in {**trails, level: here}.items()}
                places, radii = ends.places[keep], np.clip(3 * ends.radii[keep], 1e-3, 0.05)
        else:
            assert ends is not None
            for level, trail in trails.items():
                settled = trail.taken(np.flatnonzero(ends.settled))
                self.known[level] = self.known[level].joined(settled) if level in self.known else settled
            keep = self.distinct(ends, doubt, 4)
            clear = doubt[keep] < _ROUGH
            up_crests(lambda unit: surface.estimate(surface.finest, unit), box, ends, keep[clear], self.crest)
            keep = keep[self.distinct(ends.taken(keep), doubt[keep], len(keep))]
            best = self.winners.best + surface.rise(1e-8)
            keep = [i for i in keep if not self.winners.is_climbed(ends.places[i]) or ends.values[i] > best]
            self.confirm.ends(ends.taken(np.array(keep, int)))
        # What the scan saw higher than the climbs ended is confirmed as it is: a jump, or a place that no model fits.
        reach = points.reach
        higher = np.flatnonzero((points.levels == surface.finest) & (reach > self.winners.best + surface.rise(1e-9)))
        self.confirm.places(points.places[higher[np.argsort(-reach[higher])][: self.most]])

    @property
    def most(self) -> int:
        """How many scanned points may be confirmed at a time."""
        return _CONFIRMED_JUMPS if self.confirm.hard else int(_CONFIRMED * self.scale)

    def distinct(self, ends: Climbs, doubt: np.ndarray, most: int) -> np.ndarray:
        """The highest climbs, one for each place: by what they may be and by what they are at least, in turn."""
        doubt = np.where(np.isfinite(doubt), doubt, 0)
        order = np.stack([np.argsort(-(ends.values - doubt)), np.argsort(-(ends.values + doubt))], axis=1).ravel()
        least = np.max(ends.values - doubt, initial=-np.inf)
        chosen: list[int] = []
        for index in order:
            if len(chosen) >= most:
                break
            if index in chosen or not ends.values[index] + doubt[index] > least - _NO_RIVAL * max(1, abs(least)):
                continue
            if self.surface.box.distance(ends.places[chosen], ends.places[index]).min(initial=np.inf) >= _SAME:
                chosen.append(int(index))
        return np.array(chosen, int)

    def unknown(self, ends: Trail, level: int) -> np.ndarray:
        """Which ends of climbs by the rule of a level are none from which the way is known."""
        places, height = self.known.get(level, ends.taken(np.zeros(0, int)))
        return np.array(
            [
                not np.any((self.surface.box.distance(places, place) < _SAME) & (height >= value - _LEVEL * max(1, abs(value))))
                for place, value in zip(*ends, strict=True)
            ],
            bool,
        )

    def rivals(self) -> None:
        """Climb from the crests that lines through the winner, along each axis, go over."""
        winners, box = self.winners, self.surface.box
        if not np.any(winners.finite) or not box.dimension or self.confirm.unbounded is not None:
            return
        winner = winners.places[int(np.argmax(np.where(winners.finite, winners.values, -np.inf)))]
        along = np.linspace(0, 1, max(int(_LINE * self.scale), 65))
        lines = np.tile(winner, (box.dimension, len(along), 1))
        for axis in range(box.dimension):
            lines[axis, :, axis] = along
        lines = lines.reshape(-1, box.dimension)
        value, error = self.surface.estimate(0, lines)
        swept = len(box.swept) * len(along)
        self.odd = standing_out(lines[:swept].reshape(-1, len(along), box.dimension), value[:swept].reshape(-1, len(along)))
        if self.confirm.hard:
            return
        height = np.pad(value.reshape(box.dimension, -1), ((0, 0), (1, 1)), constant_values=-np.inf)
        before, middle, after = height[:, :-2], height[:, 1:-1], height[:, 2:]
        crest = (middle > before) & (middle >= after) & (np.abs(along - winner[:, None]) > 1.5 / len(along))
        # How high a crest is between the points of its line: by a parabola.
        bend = before - 2 * middle + after
        top = np.where(np.isfinite(bend) & (bend < 0), middle - (after - before) ** 2 / (8 * bend), middle).ravel()
        tops = np.flatnonzero(crest.ravel() & (top > winners.best - _NO_RIVAL * max(1, abs(winners.best))))
        found = Points(lines, value, error, np.zeros(len(value), int))
        self.follow(found, tops[np.argsort(-top[tops])][:_RIVALS])

    # --- what is left in doubt ---

    def rest(self) -> None:
        """Confirm what could still be higher than the winner by its own error.

        Where that is much of the scan, the quick rules do not resolve the BRDF (a spot between their nodes): then the rule of a
        verdict looks at a few hundred points, and climbs.
        """
        surface, winners, points = self.surface, self.winners, self.scan.points
        if surface.fast or self.confirm.unbounded is not None:
            return
        self.scan.sharpen(winners.best)
        most = self.most
        left = self.doubtful()
        blind = points.reach[left] > winners.best + _IN_DOUBT * max(1, abs(winners.best))
        if surface.angle is not None:  # grazing light is no spot: it has its limits
            blind &= points.places[left, surface.angle] > GRAZES
        if np.count_nonzero(blind) > most:
            spread = self.scan.spread((16 if surface.box.dimension < 3 else 4) * most)
            self.resolved = np.concatenate([points.places[left[:: max(1, len(left) // (2 * most))]], spread])
            self.resolve(np.concatenate([self.resolved, self.scan.at_all_angles(self.odd)]))
        if left.size:
            reach, best = points.reach, winners.best
            some = left[np.argsort(-reach[left])][:most]
            self.confirm.places(points.places[some])
            points.levels[some] = surface.finest + 1
            found = np.array([winners.find(place, False) for place in points.places[some]], int)
            kept = ((winners.values - winners.errors)[found] - best) / np.maximum(reach[some] - best, 1e-300)
            self.kept = float(np.clip(np.nan_to_num(np.max(kept), nan=1.0), 0, 1))

    def resolve(self, places: np.ndarray) -> None:
        """Look at places by the rule of a verdict, and climb from the best of them by it."""
        surface = self.surface
        value, error = surface.produce(places, RUNGS[0])
        known = Points(
            places,
            np.where(np.isfinite(value), value, -np.inf),
            np.where(np.isfinite(error), error, 0),
            np.zeros(len(value), int),
        )
        if self.confirm.hard:
            self.confirm.places(places[np.argsort(-known.values)[:2]])
            return
        starts = self.scan.starts(known, 8)
        starts = starts[np.argsort(-known.values[starts])][:4]
        ends = climb(
            lambda unit: surface.produce(unit, RUNGS[0]),
            surface.box,
            places[starts],
            0.05,
            goal=1e-6,
            rounds=6,
            smallest=1e-4,
            drop=1e-2,
            check=self.tell,
        )
        self.climbs += len(starts)
        self.confirm.ends(ends.taken(np.argsort(-ends.values)[:2]))

    def doubtful(self) -> np.ndarray:
        """Indices of scanned points that may be higher than the winner by their own error, away from the winners."""
        return self.scan.doubtful(self.winners.best, self.winners.leaders(1e-3), AROUND)

    # --- the answer ---

    def answer(self, settled: bool) -> Supremum:
        """`settled`: the last scan found nothing higher."""
        surface, winners = self.surface, self.winners
        theorem = NORMAL_IS_WORST if surface.theorem else None
        if theorem is None and self.bounded and surface.albedo.bounded:
            theorem = NEVER_ABOVE_ONE if surface.albedo.family.surface is None else NEVER_ABOVE_ONE_IN_ALL
        common = {
            "basis": "search" if theorem is None else "theorem",
            "theorem": theorem,
            "points": surface.count,
            "climbs": self.climbs,
            "width": (width := self.scan.width(self.resolved)),
        }
        if self.confirm.unbounded is not None:
            self.winner, whither = self.confirm.unbounded
            return self.at(self.winner, np.inf, np.inf, least=np.inf, settled=True, unbounded=whither, **common)
        if not np.any(winners.finite):
            self.winner = winners.places[0] if len(winners) else self.scan.points.places[0]
            return self.at(self.winner, np.nan, np.inf, settled=False, **common)
        top = winners.top
        value, error, least = float(winners.values[top]), float(winners.errors[top]), winners.least
        self.winner = winners.places[top]
        upper = float(np.max(winners.reach()))
        if not surface.fast:
            # A place that could not be resolved, and could be higher: of those that promised most, so much was kept.
            promise = float(np.max(self.scan.points.reach[self.doubtful()], initial=-np.inf))
            upper = max(upper, winners.best + self.kept * max(promise - winners.best, 0))
            settled &= not winners.unsettled(self.threshold, self.surface.rise(0.0))
            width["view"] = surface.view(self.winner)
        if self.bounded:  # whatever the search left open is not above 1
            looked = self.climbs > 0 or not surface.box.dimension or least >= 1 - _TOP
            upper, settled = min(upper, 1.0) if looked else 1.0, True
        bar = max(upper - value, error)
        if winners.broken or surface.unknown():  # somewhere the albedo is not known at all
            bar = np.inf if least <= self.threshold else bar
        return self.at(self.winner, value, bar, least=least, settled=settled, **common)

    def at(self, place: np.ndarray, value: float, error: float, **more: object) -> Supremum:
        albedo = self.surface.albedo
        parameters, mu, azimuth = self.surface.box.physical(place[None])
        channel, channels = None, 1
        if albedo.evaluator is None or (albedo.evaluator.channels or 1) > 1:
            with np.errstate(all="ignore"):
                every, _ = albedo.channels(parameters, np.maximum(mu, GRAZING), azimuth, rtol=None if albedo.fast else 1e-5)
            if every.ndim > 1 and every.shape[1] > 1:
                channel, channels = int(np.argmax(np.where(np.isnan(every[0]), -np.inf, every[0]))), every.shape[1]
        names = {name: float(number) for name, number in zip(self.surface.box.ranges, parameters[0], strict=True)}
        return Supremum(value, error, names, float(mu[0]), float(azimuth[0]), channel=channel, channels=channels, **more)  # pyright: ignore[reportArgumentType]
