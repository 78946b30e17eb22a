"""The albedo of a family as a function on the unit cube of its parameters and angles: quick, accurate, and beside a place."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from brdfcheck.quadrature.frozen import worst_channel
from brdfcheck.quadrature.members import OtherKind
from brdfcheck.quadrature.pointwise import GRAZING, PointwiseAlbedo
from brdfcheck.verdict.box import Box
from brdfcheck.verdict.climb import Function
from brdfcheck.verdict.precision import is_single

GRAZES = 0.02
"""The coordinate of the angle below which light grazes."""
# The accuracy asked of a function that rounds, in roundings: in single precision no integral gets better.
_ROUNDINGS = 100
# By how many roundings of a function's values its albedo must rise to be higher.
_ROUNDINGS_OF_A_RISE = 16
# The accuracy of a verdict on a function: clearly below its tolerance, for many are made to reflect exactly 1.
_VERDICT = 4e-10
# The accuracy from which limits are extrapolated.
_LIMITS = 2e-11
# How many nodes a rule near a place may have, and the accuracy at which it has fewer. How a surface slopes is told well
# enough by a rule that is less accurate than its values must be.
_DEAR, _CHEAPER = 120_000, 1e-7
# How many places are kept at which the albedo is not a number, and the accuracy at which they are asked again.
_LOST, _ASKED_AGAIN = 6, 1e-5

Watch = Callable[[int, float], None]
"""Called with the points looked at so far and the largest albedo seen: for progress."""


class Surface:
    """The albedo over the cube `box`. Values come with how far each may be off; `count` says how many were asked for.

    `rtol` is the accuracy of a verdict (None: the best of the engine), `theorem` that light along the normal is the worst.
    """

    def __init__(self, albedo: PointwiseAlbedo, rtol: float | None, watch: Watch):
        family = albedo.family
        self.albedo, self._watch, self._engine = albedo, watch, albedo.engine
        rtol = albedo.best if rtol is None and albedo.table is not None else rtol
        self.theorem = albedo.monotone and family.cos_theta[1] == 1
        # A function may turn out to be anisotropic in a place where it was not asked: scans look at all azimuths.
        self.box = Box(
            family.ranges, family.cos_theta, turning=not albedo.fast, fixed_angle=self.theorem, switches=family.switches
        )
        self.rtol = rtol if rtol is not None or albedo.fast else max(_VERDICT, _ROUNDINGS * albedo.epsilon)
        # An extrapolation makes errors larger, and the limit of many a BRDF is 1.
        self.rtol_of_limits = max(_LIMITS, _ROUNDINGS * albedo.epsilon) if rtol is None else rtol
        self.count = 0
        self.channel: int | None = None  # the one that is looked at
        self._lost: list[np.ndarray] = []

    @property
    def fast(self) -> bool:
        """True for engines 1 and 2."""
        return self.albedo.fast

    def rise(self, least: float) -> float:
        """`least`, or where a function computes in single precision what its rounding leaves to be seen of a rise."""
        return max(least, _ROUNDINGS_OF_A_RISE * self.albedo.epsilon) if is_single(self.albedo) else least

    def step(self, least: float) -> float:
        """`least`, or there the step over which a smooth surface bends by as much as its values round."""
        return max(least, 0.25 * self.albedo.epsilon**0.5) if is_single(self.albedo) else least

    @property
    def finest(self) -> int:
        """The finest level of `estimate`."""
        return self.albedo.levels - 1

    @property
    def angle(self) -> int | None:
        """Which axis is the angle of incidence."""
        return len(self.box.swept) if self.box.has_angle else None

    @property
    def grazes(self) -> bool:
        """True where light may graze a function's surface: what happens there is a limit."""
        return self.box.has_angle and self.box.cosines[0] == 0 and not self.fast

    def estimate(self, level: int, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """By the rule of a level, of the largest channel, or of `channel`. What is not a number is nothing to climb to."""
        value, error = self.channels(level, places)
        if self.channel is None:
            return worst_channel(value, error)[:2]
        return value[:, self.channel], error[:, self.channel]

    def channels(self, level: int, places: np.ndarray, *, both: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """The same channel by channel, (points, channels) or (points,). `both`: see `PointwiseAlbedo.estimate`."""
        self.count += len(places)
        with np.errstate(all="ignore"):
            value, error = self.albedo.estimated_channels(*self.box.physical(places), level, both=both)
        self._unchanged()
        unknown = np.isnan(value)
        if len(self._lost) < _LOST and np.any(unknown):
            lost = np.flatnonzero(np.any(unknown.reshape(len(places), -1), axis=1))
            self._lost += list(places[lost[:: max(1, len(lost) // 3)]])
        return np.where(unknown, -np.inf, value), np.where(unknown, 0, error)

    def produce(self, places: np.ndarray, rtol: float | None, *, limit: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """At the accuracy of a verdict; at grazing incidence the limit, or for a function just before it."""
        self.count += len(places)
        with np.errstate(all="ignore"):
            found = self.albedo(*self._physical(places, limit), rtol=rtol)
        self._unchanged()
        return found

    def _unchanged(self) -> None:
        """OtherKind where the family turned out to be one of functions."""
        if self.albedo.engine is not self._engine:
            raise OtherKind

    def beside(self, place: np.ndarray, rtol: float, *, limit: bool = False) -> tuple[float, float, Function]:
        """Value and error at a place, and the albedo near it as a smooth function, which is as accurate unless that is dear.

        Of functions only; the engines of lobes climb by the rule of a verdict.
        """
        self.count += 1
        parameters, mu, azimuth = self._physical(place[None], limit)
        point = parameters[0], float(mu[0]), float(azimuth[0])
        with np.errstate(all="ignore"):
            exact = self.albedo.frozen(*point, rtol)
        rule = exact if exact.size <= _DEAR or rtol >= _CHEAPER else None

        def near(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            nonlocal rule
            self.count += len(places)
            with np.errstate(all="ignore"):
                rule = rule or self.albedo.frozen(*point, _CHEAPER)
                return rule(*self._physical(places, limit))

        return exact.value, exact.error, near

    def view(self, place: np.ndarray) -> float:
        """The widest cone of reflected directions (degrees) that the integral at a place of a function has not looked into."""
        parameters, mu, azimuth = self._physical(place[None], False)
        with np.errstate(all="ignore"):
            rule = self.albedo.frozen(parameters[0], float(mu[0]), float(azimuth[0]), self.rtol or self.albedo.best)
        return float(np.degrees(rule.gap()))

    def _physical(self, places: np.ndarray, limit: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        parameters, mu, azimuth = self.box.physical(places)
        return parameters, mu if limit or self.fast else np.maximum(mu, GRAZING), azimuth

    def snapped(self, places: np.ndarray) -> np.ndarray:
        """Places as they are asked: what is nearer to grazing than any light that is looked at, at grazing incidence."""
        if not self.grazes:
            return places
        places = places.copy()
        places[self.box.physical(places)[1] < GRAZING, self.angle] = 0
        return places

    def confirm_sides(self, place: np.ndarray) -> None:
        """TwoSided where the albedo at a place is not that of one side of the plane of incidence, if that is what is taken."""
        self.albedo.confirm_sides(*self._physical(place[None], False))

    def unknown(self) -> bool:
        """True where the albedo is not a number at more than single angles, beside which it is one."""
        if not self._lost:
            return False
        # Some were seen before the azimuth was known not to matter.
        places = np.array([place[: self.box.dimension] for place in self._lost[:_LOST]])
        return bool(np.any(np.isnan(self.produce(places, _ASKED_AGAIN)[0])))

    def tell(self, best: float) -> None:
        """Report how far the search is."""
        self._watch(self.count, best)
