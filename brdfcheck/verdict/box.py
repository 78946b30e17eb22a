r"""The box of parameters, angle of incidence and azimuth as a unit cube, and the points at which a scan looks.

The cosine of incidence is sin^2(pi t / 2): at normal incidence t runs like the angle, at grazing like the square root of the
cosine, which is how albedos behave there. Half a degree is at least 0.0039 in t everywhere.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping

import numpy as np

from brdfcheck.brdf.family import corners

# Ranges of a larger ratio run geometrically.
_GEOMETRIC = 20
# Ranges that begin at 0, or end there, are also looked at near 0, at these parts of their length.
_NEAR_AN_END = 10.0 ** np.arange(-6, -1)
# Steps of the recurrence that spreads points, by a search. The first two are those of the plastic number (Roberts 2018). Its
# generalisations leave holes in pairs of coordinates: of boxes in which 2.7 of n points lie on average they miss up to 85 %.
_STEPS = (
    0.7548776662466927, 0.5698402909980532, 0.3559200226885343, 0.9347984505566128, 0.2912303549628096,
    0.8089852690177098, 0.22218057380535458, 0.7846673990555803, 0.06640917635520892, 0.6465693312880862,
)  # fmt: skip
# Cosines at which grazing light is looked at, and values of t where all corners are.
DECADES = 10.0 ** np.arange(-1, -9.5, -1)
_ANGLES = np.array([0.0, 0.02, 0.08, 0.25, 0.5, 0.75, 0.93, 1.0])


class _Axis:
    """A range of a parameter as a map from the unit interval. `switch`: there is nothing between its ends."""

    def __init__(self, low: float, high: float, switch: bool):
        self.low, self.high, self.switch = low, high, switch
        self.geometric = low > 0 and high / low > _GEOMETRIC

    def at(self, unit: np.ndarray) -> np.ndarray:
        if self.switch:
            return np.where(unit < 0.5, self.low, self.high)
        with np.errstate(over="ignore"):
            if self.geometric:
                inside = np.exp((1 - unit) * np.log(self.low) + unit * np.log(self.high))
            else:
                inside = (1 - unit) * self.low + unit * self.high
        # The ends themselves, not their rounding.
        inside = np.where(unit >= 1, self.high, np.where(unit <= 0, self.low, inside))
        return np.clip(inside, self.low, self.high)


def cosine_at(t: np.ndarray) -> np.ndarray:
    """The cosine of incidence at t."""
    return np.sin(np.pi / 2 * t) ** 2


def place_of(cosine: np.ndarray | float) -> np.ndarray:
    """t at a cosine of incidence."""
    return 2 / np.pi * np.arcsin(np.sqrt(cosine))


class Box:
    """A box of swept parameters, cosines and (where `turning`) azimuths as a unit cube.

    `names` are those of its axes: the swept parameters, "angle", and "azimuth". Held parameters are no axes; `switches` are
    those that take the ends of their ranges only. The azimuth is a whole turn: opposite azimuths of incidence are different
    for a general BRDF.
    """

    def __init__(
        self,
        ranges: Mapping[str, tuple[float, float]],
        cos_theta: tuple[float, float],
        *,
        turning: bool,
        fixed_angle: bool = False,
        switches: frozenset[str] = frozenset(),
    ):
        self.ranges, self.switches = dict(ranges), switches
        self._axes = {name: _Axis(low, high, name in switches) for name, (low, high) in ranges.items() if low < high}
        self.swept = tuple(self._axes)
        self.cosines = (cos_theta[1], cos_theta[1]) if fixed_angle else cos_theta
        self._t = tuple(float(place_of(cosine)) for cosine in self.cosines)
        self.has_angle = self.cosines[0] < self.cosines[1]
        self.turning = turning
        self.names = (*self.swept, *(("angle",) if self.has_angle else ()), *(("azimuth",) if turning else ()))
        self.dimension = len(self.names)
        self.periodic = np.array(
            [name == "azimuth" and i == len(self.swept) + self.has_angle for i, name in enumerate(self.names)], bool
        )

    def changed(self, *, cosines: tuple[float, float] | None = None, turning: bool | None = None) -> Box:
        """This box with other cosines, or with or without an axis for the azimuth."""
        return Box(
            self.ranges,
            self.cosines if cosines is None else cosines,
            turning=self.turning if turning is None else turning,
            switches=self.switches,
        )

    def physical(self, unit: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Parameters (points, all names in order), cosines and azimuths (points,) of points (points, dimension) of the cube."""
        columns = []
        for name, (low, _) in self.ranges.items():
            if name in self._axes:
                columns.append(self._axes[name].at(unit[:, self.swept.index(name)]))
            else:
                columns.append(np.full(len(unit), float(low)))
        parameters = np.stack(columns, axis=1) if columns else np.zeros((len(unit), 0))
        if self.has_angle:
            part = unit[:, len(self.swept)]
            inside = cosine_at(self._t[0] + (self._t[1] - self._t[0]) * part)
            inside = np.clip(inside, *self.cosines)
            mu = np.where(part <= 0, self.cosines[0], np.where(part >= 1, self.cosines[1], inside))
        else:
            mu = np.full(len(unit), float(self.cosines[1]))
        azimuth = 2 * np.pi * (unit[:, -1] % 1) if self.turning else np.zeros(len(unit))
        return parameters, mu, azimuth

    def kept(self, unit: np.ndarray) -> np.ndarray:
        """Points of the cube nearest to `unit`; the azimuth goes round."""
        return np.where(self.periodic, unit % 1, np.clip(unit, 0, 1))

    def apart(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """`first` less `second`, of points of the cube; the azimuth the shorter way round."""
        difference = first - second
        return np.where(self.periodic, (difference + 0.5) % 1 - 0.5, difference)

    def distance(self, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """The largest difference of a coordinate, of points (..., dimension) of the cube."""
        return np.max(np.abs(self.apart(first, second)), axis=-1, initial=0.0)

    def angle_at(self, cosine: np.ndarray | float) -> np.ndarray:
        """The unit coordinate of a cosine of incidence, kept within the box."""
        low, high = self._t
        return np.clip((place_of(np.clip(cosine, *self.cosines)) - low) / max(high - low, 1e-300), 0, 1)

    # --- points ---

    def scan(self, count: int, first: int, levels: int) -> np.ndarray:
        """`count` points that fill the cube evenly, from number `first` of an endless sequence on.

        A third of them has some coordinates moved to the ends of their ranges. Angles take one of `levels` values, evenly
        spaced in t and shifted from one scan to the next, because directions are made once for each.
        """
        if not self.dimension:
            return np.zeros((1, 0))
        unit = _sequence(count, self.dimension, first)
        random = np.random.default_rng(first + 1)
        parameters = len(self.swept)
        # The last third: what is left of the sequence has no holes.
        moved = (np.arange(count) >= count - count // 3)[:, None] & (random.uniform(size=(count, parameters)) < 0.5)
        ends = random.integers(0, 2, (count, parameters))
        unit[:, :parameters] = np.where(moved, ends, unit[:, :parameters])
        if self.has_angle:
            shift = (first * 0.6180339887498949) % 1 if first else 0.0
            t = unit[:, parameters]
            unit[:, parameters] = np.clip((np.floor(t * levels) + shift) / (levels - 1 if not first else levels), 0, 1)
        return unit

    def landmarks(self) -> np.ndarray:
        """Corners, edges, ends of ranges, and both ends of the angle with what lies near them."""
        count = len(self.swept)
        frames = [np.array(list(itertools.product((0.0, 1.0), repeat=count)))]
        if 0 < count <= 4:
            frames.append(np.array(list(itertools.product((0.0, 0.5, 1.0), repeat=count))))
        elif count:
            middle = np.repeat(frames[0], count, axis=0)
            middle[np.arange(len(middle)), np.tile(np.arange(count), len(frames[0]))] = 0.5
            frames.append(np.unique(middle, axis=0))
        for axis in range(count):
            near = np.concatenate([_NEAR_AN_END, 1 - _NEAR_AN_END])
            extra = _sequence(4 * len(near), count, 77)
            extra[:, axis] = np.tile(near, 4)
            frames.append(extra)
        parameters = np.unique(np.concatenate(frames), axis=0)
        angles = self.angle_at(cosine_at(_ANGLES)) if self.has_angle else np.zeros(1)
        few = angles if len(parameters) <= 300 else angles[[0, 2, 4, 7]] if self.has_angle else angles
        return self._combined(parameters, few)

    def grazing(self, count: int) -> np.ndarray:
        """The same parameters at all decades of the cosine, (places, decades, dimension); empty where no light grazes."""
        if not self.has_angle or self.cosines[0] > 0:
            return np.zeros((0, len(DECADES), self.dimension))
        swept = len(self.swept)
        ends = np.array(corners([(0.0, 1.0)] * swept, 64))
        places = np.concatenate([ends, _sequence(count, swept, 31)]) if swept else np.zeros((1, 0))
        return self.at_decades(self._combined(places, np.zeros(1)))

    def at_decades(self, places: np.ndarray) -> np.ndarray:
        """Points of the cube (places, dimension) at all decades of the cosine."""
        ladder = np.repeat(places[:, None], len(DECADES), axis=1)
        ladder[..., len(self.swept)] = self.angle_at(DECADES)
        return ladder

    def _combined(self, parameters: np.ndarray, angles: np.ndarray) -> np.ndarray:
        points = np.repeat(parameters, len(angles), axis=0)
        if self.has_angle:
            points = np.concatenate([points, np.tile(angles, len(parameters))[:, None]], axis=1)
        if self.turning:
            turns = _sequence(len(points), 1, 5)
            points = np.concatenate([points, turns], axis=1)
        return points


def _sequence(count: int, dimension: int, first: int) -> np.ndarray:
    """Points `first`, ... of an additive recurrence: (count, dimension)."""
    steps = np.array([_STEPS[axis % len(_STEPS)] ** (1 + axis // len(_STEPS)) for axis in range(dimension)])
    return (0.5 + (first + np.arange(count)[:, None]) * steps) % 1
