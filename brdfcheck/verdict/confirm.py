"""Albedos at the accuracy of a verdict where climbs have ended, with the rest of the way up; and the limits at grazing."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from brdfcheck.quadrature.pointwise import GRAZING
from brdfcheck.verdict.box import DECADES, Box
from brdfcheck.verdict.climb import CREST, Climbs, climb
from brdfcheck.verdict.kinks import crest, is_kinked, top_of_crest
from brdfcheck.verdict.poles import SUSPICIOUS, pole
from brdfcheck.verdict.surface import GRAZES, Surface
from brdfcheck.verdict.winners import Winners

RUNGS = (1e-5, 1e-7)
"""Accuracies at which places are confirmed, one after the other, as long as they may be the highest."""
# An error that is left at the last of these marks a BRDF with jumps.
_HARD = 1e-3
# How far off a quick rule may be for its climbs to say anything.
_BLIND = 1e-3
# How many places are asked by more than the first of these.
_FINEST = 6
# How many climbs that were not finished are gone on with, and after how many evaluations no more digits are asked for.
_UNFINISHED, _TIGHTENED = 10, 25_000_000
# On the last way up: how far the rule of one place is taken to serve, and how many such rules there may be.
_REACH, _RULES = 3e-3, 12
# How often a climb begins again where it was misled.
_STALE = 2
# An albedo that is known no better than this is not climbed from.
_ROUGH = 1e-6
# By how much an integral must miss its accuracy for the rule that it ended with to be blurred.
_BLURRED = 3
# How near (in the unit cube) a limit is to another one that speaks for it.
_SAME = 2e-3
# Gaps up to this may be the noise of a rule; where one is larger, the rule was not that of the place.
_NOISE, _PERHAPS_NOISE = 1e-7, 1e-6
# How far from the winner lines reach.
_RADII = (1.0, 0.25, 0.06, 0.015)
# How far from its end the angle is looked at once more where a place lies there.
_ARM = 1e-3


class Confirmation:
    """Puts places into `winners`. `check` is called between the steps."""

    def __init__(self, surface: Surface, winners: Winners, check: Callable[[], None]):
        self.surface, self.winners, self.check = surface, winners, check
        # Set where the rule of a verdict does not converge (jumps): more of its evaluations would tell little more.
        self.hard = False
        # A place, and towards what the albedo grows without bound.
        self.unbounded: tuple[np.ndarray, str] | None = None
        # Where `finish` has climbed from: a second climb from there would be the first one again.
        self._tried: set[tuple[float, ...]] = set()

    # --- places as they are, and ends of climbs ---

    def places(self, places: np.ndarray) -> None:
        """Confirm places as they are."""
        if len(places):
            self._add(places, *self._resolved(places))

    def ends(self, ends: Climbs) -> None:
        """Confirm where climbs ended; the best go on to the top by the rule of a verdict."""
        if not len(ends.places):
            return
        ends.places[:] = self.surface.snapped(ends.places)
        gaps = ends.known_gaps
        if self.surface.fast:  # the rule of the climb is that of a verdict
            self._crests(ends, gaps, ends.kinked & (ends.values + gaps > self.winners.least), ends.errors)
            self._add(ends.places, ends.values, ends.errors, None, gaps=gaps, settled=ends.settled, climbed=True)
            return
        value, error, asked = self._resolved(ends.places)
        # Where the rule does not reach its accuracy (edges, jumps), a climb by it says nothing.
        best = max(np.max(value[np.isfinite(value)], initial=-np.inf), self.winners.best - 1e-6)
        worth = np.flatnonzero((error < _ROUGH) & (value + 3 * error > best - 1e-6))
        worth = worth[np.argsort(-value[worth])][:2]
        kinked = ends.kinked & (error < _ROUGH) & (value + gaps > self.winners.least)
        kinked[worth] = False
        self._crests(ends, gaps, kinked, error)
        # Where the quick rule is far off, its climb is none: what counts is the place, and what is found by better rules.
        off = np.abs(ends.values - np.where(np.isfinite(value), value, ends.values))
        blind = (off > _BLIND) & (off > gaps)
        for which, climbed in ((np.flatnonzero(~blind), True), (np.flatnonzero(blind), False)):
            left = {"gaps": gaps[which], "settled": ends.settled[which]} if climbed else {}
            self._add(ends.places[which], value[which], error[which], asked, climbed=climbed, **left)
        if self.unbounded is not None or not np.any(np.isfinite(value)):
            return
        for index in worth:
            radius = float(np.clip(10 * ends.radii[index], 1e-4, 2e-3))
            self._polish(ends.places[index], ends.mixed[index], radius)
        if self.surface.grazes:
            places = np.concatenate([ends.places[worth], self.winners.places[-1:]])
            self.limits(places[places[:, self.surface.angle] < GRAZES])

    def _crests(self, ends: Climbs, gaps: np.ndarray, which: np.ndarray, error: np.ndarray) -> None:
        """Make gaps smaller where the jumps of the slopes at a kink say that its crest goes no higher."""
        for index in np.flatnonzero(which):
            near = self.surface, ends.places[index], float(ends.radii[index]), float(error[index])
            gaps[index] = min(gaps[index], crest(*near)[0])

    def _resolved(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """Albedos of some places, the more accurate the higher: what is clearly lower than the best needs no digits.

        The last number is the accuracy that the first of them was asked for.
        """
        rtol = self.surface.rtol
        if self.surface.fast:
            return *self.surface.produce(places, rtol), 0.0
        final = max(rtol or 0, 1e-13)
        value, error = np.full(len(places), -np.inf), np.full(len(places), np.inf)
        some, asked = np.arange(len(places)), final
        rungs = [rung for rung in RUNGS if rung > final]
        for asked in rungs if self.hard and rungs else [*rungs, final]:
            value[some], error[some] = self.surface.produce(places[some], asked)
            finite = np.isfinite(value)
            least = max(self.winners.best, float(np.max((value - error)[finite], initial=-np.inf)))
            some = np.flatnonzero(finite & (value + error >= least) & (error > 0))
            # What did not come near the accuracy asked for has an edge or a jump: only the highest is tried once more.
            stuck = error[some] > 3 * asked * np.maximum(np.abs(value[some]), 1)
            self.hard |= bool(asked == RUNGS[-1] and some.size and np.all(error[some] > _HARD))
            order = np.argsort(-value[some])
            some = some[order][: 1 if np.any(stuck) else _FINEST]
            if not some.size:
                break
        return value, error, asked if len(places) == 1 else RUNGS[0]

    def _add(self, places: np.ndarray, value: np.ndarray, error: np.ndarray, asked: float | None, **more: object) -> None:
        self.winners.add(places, value, error, asked, **more)  # pyright: ignore[reportArgumentType]
        for index in np.flatnonzero(np.isposinf(value)):
            if self.unbounded is None:
                _, mu, _ = self.surface.box.physical(places[index][None])
                everywhere = "near this place: the integral over the hemisphere does not converge"
                self.unbounded = places[index], "towards grazing incidence" if mu[0] == 0 else everywhere

    def _polish(self, place: np.ndarray, mixed: np.ndarray | None, radius: float, *, limit: bool = False) -> None:
        """Climb from a place to the top, by the rule that its integral ends with, and confirm that.

        At the ends of the angle the boxes of that rule are others than just inside: there it is held, and looked at by itself.
        """
        surface, angle = self.surface, self.surface.angle or 0
        rtol = surface.rtol_of_limits if limit else surface.rtol
        assert rtol is not None
        held, inner, whole = self._held(place)
        if held and mixed is not None:
            mixed = np.delete(np.delete(mixed, angle, axis=0), angle, axis=1)
        value, error, near = surface.beside(place, rtol, limit=limit)
        self._add(place[None], np.array([value]), np.array([error]), rtol, climbed=True, limit=limit)
        for turn in range(_RULES if np.isfinite(value) and inner.dimension else 0):
            start = float(near(place[None])[0][0])
            # Slopes below the error of the rule are not seen.
            blurred = error > _BLURRED * rtol * max(1, abs(value))

            def function(rest: np.ndarray, near=near) -> tuple[np.ndarray, np.ndarray]:
                return near(whole(rest))

            ends = climb(
                function,
                inner,
                (np.delete(place, angle) if held else place)[None],
                radius,
                goal=self.surface.rise(2e-11),
                rounds=12,
                smallest=self.surface.step(1e-9),
                mixed=None if mixed is None else mixed[None],
                calm=1,
                reach=_REACH,
                crest=CREST if blurred else 0.0,  # which is looked at below
                check=self.check,
            )
            end, top, gap = ends.places[0], float(ends.values[0]), float(ends.known_gaps[0])
            done = bool(ends.settled[0] or ends.radii[0] < self.surface.step(1e-8))
            # No small stencil sees where the crest of a kink rises that runs across the axes.
            if not limit and (ends.kinked[0] if blurred else is_kinked(function, inner, end, ends.radii[0])):
                bound, seen = crest(surface, whole(end[None])[0], ends.radii[0], error)
                if blurred:
                    gap, done = min(gap, bound), done and not seen
                elif seen:
                    end, top, gap = top_of_crest(function, inner, end, error)
                    gap, done = min(gap, bound), True
            end = whole(end[None])[0]
            promised, moved = top - start, float(surface.box.distance(end, place))
            fresh, bar, beside = surface.beside(end, rtol, limit=limit) if moved else (value, error, near)
            blur = error + bar + 1e-9 * max(1, abs(value))
            rises, stale = fresh - value > blur and moved > _REACH, promised - (fresh - value) > blur
            if moved > _REACH and not rises:  # along a ridge that hardly rises, which may go on to the other end of the box
                gap, done = max(gap, (fresh - value) / moved), True
            if blurred:
                gap = max(gap, 2 * error)
            if stale:  # the rule of one place does not serve at the other
                gap = max(gap, promised - (fresh - value))
            last = turn == _RULES - 1 or not (rises or (stale and turn < _STALE))
            if not last:  # what the next climb leaves is what counts
                gap, done = 0.0, True
            left = {"gaps": gap, "settled": done, "climbed": True, "limit": limit}
            self._add(end[None], np.array([fresh]), np.array([bar]), rtol, **left)
            if fresh >= value:
                place, value, error, near = end, fresh, bar, beside
            if last:
                break
            radius = float(np.clip(10 * ends.radii[0], 1e-5, 1e-3)) / (10 if stale else 1)
        if held and not limit and np.isfinite(value):
            self._inwards(place, value, error)
        elif not limit:
            self._outwards(place)

    def _held(self, place: np.ndarray) -> tuple[bool, Box, Callable[[np.ndarray], np.ndarray]]:
        """Whether a place lies at an end of the angle; the box of a climb from there, without the angle where it does; and what
        makes points of the whole box of those.
        """
        box = self.surface.box
        _, mu, _ = box.physical(place[None])
        held = box.has_angle and bool(mu[0] == 1 or mu[0] <= GRAZING)
        if not held:
            return False, box, lambda points: points
        angle = self.surface.angle or 0
        return True, box.changed(cosines=(1.0, 1.0)), lambda points: np.insert(points, angle, place[angle], axis=1)

    def _outwards(self, place: np.ndarray) -> None:
        """The ends of the ranges that are as near as a climb's rule reaches: towards them it may stop in its own noise."""
        surface = self.surface
        ends = np.round(place)
        near = (np.abs(ends - place) < _REACH) & (ends != place) & ~surface.box.periodic
        if surface.grazes and ends[surface.angle] == 0:  # grazing light has its limits
            near[surface.angle] = False
        if np.any(near):
            places = np.array([np.where(np.arange(len(place)) == axis, ends, place) for axis in np.flatnonzero(near)])
            self._add(places, *surface.produce(places, surface.rtol), surface.rtol)

    def _inwards(self, place: np.ndarray, value: float, error: float) -> None:
        """Whether the surface rises from the end of the angle inwards, by the rule of a verdict; then it is climbed."""
        surface, angle = self.surface, self.surface.angle
        arm = place.copy()
        arm[angle] += _ARM if place[angle] < 0.5 else -_ARM
        found, bar = surface.produce(arm[None], surface.rtol)
        self._add(arm[None], found, bar, surface.rtol)
        if not found[0] - bar[0] > value + error:
            return
        self._climbed(arm)

    # --- at the end of a search ---

    def finish(self) -> None:
        """Climb on where a climb stopped early and could still become the highest."""
        surface, winners = self.surface, self.winners
        if surface.fast or self.unbounded is not None or self.hard or not surface.box.dimension:
            return
        for _ in range(_UNFINISHED if np.any(winners.finite) else 0):
            early = [i for i in winners.open() if not (winners.climbed[i] and winners.asked[i] <= (surface.rtol or 0))]
            if not winners.climbed[winners.top]:
                early.insert(0, winners.top)
            early = [i for i in early if winners.errors[i] < _ROUGH and tuple(winners.places[i]) not in self._tried]
            if not early:
                return
            self._tried.add(tuple(winners.places[early[0]]))
            self._polish(winners.places[early[0]], None, _ARM)

    def lines(self) -> None:
        """Where jumps make the quick rules, and climbs by them, blind: lines through the winner by the rule of a verdict.

        One along each axis, first as long as the box and then ever shorter about the highest place.
        """
        surface, winners = self.surface, self.winners
        if not self.hard or self.unbounded is not None or not np.any(winners.finite) or not surface.box.dimension:
            return
        place, best = winners.places[winners.top], -np.inf
        for radius in _RADII:
            self.check()
            arms = radius * np.linspace(-1, 1, 9)[:, None, None] * np.eye(len(place))
            places = np.unique(surface.snapped(surface.box.kept((place + arms).reshape(-1, len(place)))), axis=0)
            value, _ = surface.produce(places, RUNGS[0])
            top = int(np.argmax(np.where(np.isfinite(value), value, -np.inf)))
            if value[top] > best:
                place, best = places[top], value[top]
        self.places(place[None])

    def level(self) -> None:
        """On a plateau a climb's gap is the noise of its rule: where the surface is level, there is nothing to climb.

        Level, by the rule of a verdict: it differs by no more than that gap on either side, or falls from the end of a range.
        Where the gap is more than noise it must be level to all digits; or the climb goes on by that rule.
        """
        surface, winners = self.surface, self.winners
        if surface.fast or self.unbounded is not None or self.hard or not np.any(winners.finite):
            return
        tops: list[tuple[np.ndarray, float]] = []
        for index in winners.open()[: 2 * _FINEST]:
            place, value, gap = winners.places[index], float(winners.values[index]), float(winners.gaps[index])
            if not (winners.climbed[index] and winners.settled[index]) or winners.limits[index]:
                continue
            noise = gap if gap <= _NOISE else 0.0
            if gap <= _PERHAPS_NOISE and (top := self._level(place, value, noise)) is not None:
                winners.gaps[index] = min(gap, max(0.0, top - value - winners.errors[index]))
            elif gap > _NOISE:  # the rule of the climb was that of another place
                near = [top for other, top in tops if surface.box.distance(other, place) < _SAME]
                tops.append((place, near[0] if near else self._top_from(place)))
                winners.gaps[index] = min(gap, max(0.0, tops[-1][1] - value))

    def _level(self, place: np.ndarray, value: float, noise: float) -> float | None:
        """How high the surface may be beside a place where it is level but for `noise`, or to all digits; else None."""
        surface = self.surface
        places = place + _ARM * np.concatenate([np.eye(len(place)), -np.eye(len(place))])
        inside = np.all((places >= 0) & (places <= 1) | surface.box.periodic, axis=1)
        found, bars = surface.produce(surface.box.kept(places[inside]), surface.rtol)
        both = np.tile(inside[: len(place)] & inside[len(place) :], 2)[inside]
        rises = found - value
        level = np.where(both, np.abs(rises) <= np.maximum(noise, 2 * bars), rises <= bars)
        return float(np.max(found + bars)) if np.all(level) and np.all(np.isfinite(found)) else None

    def _top_from(self, place: np.ndarray) -> float:
        """How high the surface may go where a climb by the rule of a verdict, from a place, ends.

        Of a limit before which the place lies, the rise is that of limits.
        """
        surface, winners = self.surface, self.winners
        ends = self._climbed(place)
        if not ends.settled[0]:
            return np.inf
        end, gap = ends.places[0], float(ends.gaps[0])
        if surface.grazes and place[surface.angle] == end[surface.angle] == 0:
            before = winners.limits & ~winners.climbed & (surface.box.distance(winners.places, place) < _SAME)
            there, bar = surface.produce(end[None], surface.rtol_of_limits, limit=True)
            self._add(end[None], there, bar, surface.rtol_of_limits, gaps=gap, climbed=True, limit=True)
            for index in np.flatnonzero(before):
                winners.climbed[index] = True
                winners.gaps[index] = max(0.0, float(there[0] - winners.values[index])) + gap
        return float(ends.values[0]) + gap

    def _climbed(self, place: np.ndarray) -> Climbs:
        """A climb by the rule of a verdict at each point, which is confirmed."""
        surface, angle = self.surface, self.surface.angle or 0
        held, inner, whole = self._held(place)
        ends = climb(
            lambda unit: surface.produce(whole(unit), surface.rtol),
            inner,
            (np.delete(place, angle) if held else place)[None],
            _ARM,
            goal=surface.rise(1e-10),
            rounds=8,
            smallest=surface.step(1e-8),
            calm=1,
            check=self.check,
        )
        ends = replace(ends, places=whole(ends.places))
        self._add(ends.places, ends.values, ends.errors, surface.rtol, gaps=ends.known_gaps, settled=ends.settled, climbed=True)
        if held:
            self._inwards(ends.places[0], float(ends.values[0]), float(ends.errors[0]))
        return ends

    def tighten(self) -> None:
        """More digits for places that are as high as the winner only by their own error."""
        rtol, winners = self.surface.rtol, self.winners
        if self.surface.fast or self.unbounded is not None or rtol is None or not np.any(winners.finite):
            return
        # Where the winner has few digits, the others need no more.
        rough = max(rtol, winners.errors[winners.top] / 3)
        began = self.surface.albedo.evaluations
        for accuracy in (max(RUNGS[-1], rtol), rough):
            while self.surface.albedo.evaluations - began < _TIGHTENED:
                loose = winners.loose(accuracy)[:8]
                if not loose.size:
                    break
                some = winners.places[loose]
                self._add(some, *self.surface.produce(some, accuracy), accuracy)

    # --- grazing light and poles ---

    def graze(self, corners: int) -> None:
        """The limit at grazing incidence where the decades before it promise more than has been found."""
        surface, winners = self.surface, self.winners
        ladder = surface.box.grazing(corners)
        if not len(ladder) or surface.fast:
            return
        if len(winners):
            ladder = np.concatenate([ladder, surface.box.at_decades(winners.places[-8:])])
        value, _ = surface.estimate(0, ladder.reshape(-1, surface.box.dimension))
        value = value.reshape(len(ladder), len(DECADES))
        with np.errstate(all="ignore"):
            step, before = value[:, -1] - value[:, -2], value[:, -2] - value[:, -3]
            ratio = np.clip(np.where(before > 0, step / before, 0), 0, 0.98)
            promise = value[:, -1] + np.where(step > 1e-8 * np.abs(value[:, -1]), step * ratio / (1 - ratio), 0)
        promise = np.where(np.isfinite(promise), promise, -np.inf)
        order = np.argsort(promise)[::-1]
        worth = [index for index in order if promise[index] > winners.best - 2e-3 * max(1, abs(winners.best))][:4]
        # Growth that has not come far yet is followed too.
        growth = step > 1e-6 * np.maximum(1e-9, np.abs(value[:, -1]))
        growing = [index for index in order if growth[index] and ratio[index] > 0.93][:2]
        self.limits(ladder[sorted({*worth, *growing}), -1])

    def limits(self, places: np.ndarray) -> None:
        """The limits at grazing incidence for the parameters and azimuths of some places; the best is followed to its top."""
        surface, angle = self.surface, self.surface.angle
        if not len(places) or angle is None:
            return
        places = places.copy()
        places[:, angle] = 0
        known = self.winners.places[self.winners.limits]
        near = [surface.box.distance(known, place).min(initial=np.inf) < _SAME for place in places]
        places = np.unique(places[~np.array(near, bool)], axis=0)
        if not len(places):
            return
        before, _ = surface.produce(places, RUNGS[-1])
        accuracy = RUNGS[0]
        value, error = surface.produce(places, accuracy, limit=True)
        # What is clearly lower than the best needs no digits.
        rest = ~(value + error < max(self.winners.best, np.max(value - error, initial=-np.inf))) & (not self.hard)
        self._add(places[~rest], value[~rest], error[~rest], accuracy, limit=True)
        if np.any(rest):
            accuracy = surface.rtol_of_limits
            value[rest], error[rest] = surface.produce(places[rest], accuracy, limit=True)
            self._add(places[rest], value[rest], error[rest], accuracy, limit=True)
        finite = np.isfinite(value)
        if self.unbounded is not None or not np.any(finite):
            return
        top = int(np.argmax(np.where(finite, value, -np.inf)))
        if value[top] < self.winners.best - 1e-6 or self.hard:
            return
        # Where the limit is that of values just before it, the climb that led here has found the best parameters.
        if abs(value[top] - before[top]) >= 1e-6 and surface.box.dimension > 1:
            self._polish(places[top], None, 3e-2, limit=True)

    def poles(self, ends: Climbs, level: int) -> None:
        """Whether a climb to a large value is one towards a pole: it goes on growing as the surroundings shrink."""
        for index in np.argsort(ends.values)[::-1][:2]:
            if ends.values[index] < SUSPICIOUS:
                return
            place = pole(self.surface, ends.places[index], float(ends.values[index]), level, self.check)
            if place is not None:
                parameters, mu, _ = self.surface.box.physical(place[None])
                names = [f"{name}={number:.4g}" for name, number in zip(self.surface.box.ranges, parameters[0], strict=True)]
                if mu[0] > 0:
                    self.unbounded = place, f"towards {' '.join([*names, f'cos={mu[0]:.4g}'])}"
                self._add(place[None], np.array([np.inf]), np.array([np.inf]), 0.0)
                return
