"""The points at which a search looks before it climbs: quick values, finer ones where they matter, and where to look again."""

from __future__ import annotations

import functools
import importlib
import threading
from dataclasses import dataclass

import numpy as np

from brdfcheck.numerics import Columns
from brdfcheck.quadrature.anisotropy import CLEAN, TREMORS, apart
from brdfcheck.quadrature.frozen import worst_channel
from brdfcheck.verdict.surface import Surface

# Points of the first scan for no, one, two, and more swept parameters; one more for a BRDF that is anisotropic.
_POINTS = (2048, 4096, 9216, 9216)
# Values of the cosine in a scan of a function.
_COSINES = 513
# Into how many parts the angles are divided, each with its share of the starts.
_SHARES = 8
# How many points of a scan may be looked at by the second and the third rule, and how many at the end by the third.
_SECOND, _THIRD, _LAST = 512, 64, 512
# How many are looked at by the second rule where so many may be the highest.
_DOUBTFUL = 4096
# What is this much lower than the best cannot become the best by a finer rule, beyond its own error.
_MARGIN = 1e-3
# How many points that stand out are looked at again at the angles of the winner; of how many that do, upwards or downwards, and
# are so far apart, the parameters are looked at again at all angles, and at how many of these.
_ECHOES, _ODD, _ODD_APART, _ODD_ANGLES = 96, 16, 4e-3, 33
_BETWEEN = np.arange(-3, 4) / 4
# Which part of a line is far enough from a place for it to stand out, and at most how many places of a line do.
_BESIDE, _ON_A_LINE = 64, 3
# Up to how many places every distance is taken sooner than a tree is imported (20 ms against 250), so many points at a time.
_FEW, _BLOCK = 1200, 64
# Between which angles (radians) albedos are turned, and how many of those that changed are looked at for their rounding.
_TURNS, _SUSPECTS = (0.0, 2.4), 64


@functools.cache
def _prepare() -> None:
    """Import a tree for the neighbours of many points, and of directions, beside other work: it takes a quarter of a second."""
    threading.Thread(target=importlib.import_module, args=("scipy.spatial",), daemon=True).start()


def _neighbours(places: np.ndarray, at: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Distances and indices (points of `at`, count) of the `count` of the places next to each point, the nearest first."""
    if places.shape[1] == 1:
        order = np.argsort(places[:, 0], kind="stable")
        line, wide = places[order, 0], min(2 * count, len(places))
        first = np.clip(np.searchsorted(line, at[:, 0]) - count, 0, len(line) - wide)[:, None] + np.arange(wide)
        apart_by = np.abs(line[first] - at)
        nearest = np.argsort(apart_by, axis=1, kind="stable")[:, :count]
        return np.take_along_axis(apart_by, nearest, 1), order[np.take_along_axis(first, nearest, 1)]
    if len(places) > _FEW:
        from scipy.spatial import KDTree

        return KDTree(places).query(at, count)  # pyright: ignore[reportReturnType]
    found = []
    for block in np.split(at, range(_BLOCK, len(at), _BLOCK)):
        squares = np.zeros((len(block), len(places)))
        for here, there in zip(block.T, places.T, strict=True):
            squares += np.square(here[:, None] - there)
        nearest = np.argpartition(squares, count - 1, axis=1)[:, :count]
        order = np.argsort(np.take_along_axis(squares, nearest, 1), axis=1, kind="stable")
        nearest = np.take_along_axis(nearest, order, 1)
        found.append((np.sqrt(np.take_along_axis(squares, nearest, 1)), nearest))
    distance, index = (np.concatenate(part) for part in zip(*found, strict=True))
    return distance, index


@dataclass
class Points(Columns):
    """Scanned points: places in the cube, values, how far they may be off, and the level of the rule (levels: confirmed)."""

    places: np.ndarray
    values: np.ndarray
    errors: np.ndarray
    levels: np.ndarray

    @property
    def reach(self) -> np.ndarray:
        """What the values may be."""
        return self.values + self.errors


class Scan:
    """Scans of a surface. `scale` multiplies how many points there are."""

    def __init__(self, surface: Surface, scale: float):
        self.surface, self.scale = surface, scale
        swept = len(surface.box.swept)
        self._count = int(_POINTS[min(swept + surface.albedo.anisotropic, 3)] * scale)
        if surface.fast and not surface.albedo.one_of_many:
            self._count = max(self._count // (4 if surface.theorem or not swept else 2), 257)
        if not surface.fast or (self._count > _FEW and swept):
            _prepare()
        self._cosines = max(int(_COSINES * min(1, 2 * scale)), 257)
        box = surface.box
        places = np.concatenate([box.landmarks(), box.scan(self._count, 0, self._cosines)])
        self.points, every = self._glance(places)
        self._straighten()
        # The same of each channel of several, but for one that is the largest at all points.
        self.channels: dict[int, Points] = {}
        for channel, (value, error) in enumerate(zip(*(part.T for part in every), strict=True) if every[0].ndim > 1 else ()):
            if np.any(value < self.points.values):
                self.channels[channel] = Points(self.points.places, value, error, np.zeros(len(value), int))
        surface.albedo.look_at_sides()
        self._refine(self.points, -np.inf)

    def again(self, turn: int, best: float, winner: np.ndarray, odd: np.ndarray) -> Points:
        """Another scan, disjoint from those before: evenly, where the surface may rise above the best seen, and echoes.

        Of the parameters of the places `odd` all angles are looked at.
        """
        places = [self.surface.box.scan(self._count // 4, (turn + 1) * self._count, self._cosines)]
        places += [self._near(self._count // 8, turn), self._echoes(winner), self.at_all_angles(odd)]
        fresh = self.look(np.concatenate(places), best)
        self.points = self.points.joined(fresh)
        return fresh

    def spread(self, count: int) -> np.ndarray:
        """So many more places, evenly."""
        return self.surface.box.scan(count, 10**6, self._cosines)

    def look(self, places: np.ndarray, best: float) -> Points:
        """A scan by the quick rule, and finer rules where that may matter for what is higher than `best`."""
        found, _ = self._glance(places)
        self._refine(found, best)
        return found

    def _glance(self, places: np.ndarray) -> tuple[Points, tuple[np.ndarray, np.ndarray]]:
        """Points as the coarsest rule sees them, and values and errors of each channel."""
        every = self.surface.channels(0, places, both=True)
        value, error, _ = worst_channel(*every)
        return Points(places, value.copy(), error.copy(), np.zeros(len(value), int)), every

    def _refine(self, points: Points, best: float) -> None:
        finer = (_THIRD,) if self.surface.fast else (_SECOND, _THIRD)
        for level, most in zip(range(1, self.surface.finest + 1), finer, strict=False):
            self._sharpen(points, level, int(most * self.scale), best)

    def sharpen(self, best: float) -> None:
        """Take what may be higher than the best by the finest of the quick rules."""
        high = int(np.count_nonzero(self.points.reach > best + _MARGIN * max(1, abs(best))))
        self._sharpen(self.points, self.surface.finest, max(int(_LAST * self.scale), min(_LAST, high)), best)

    def _sharpen(self, points: Points, level: int, most: int, best: float) -> None:
        """Take the points that may be the highest by the rule of the next level; the change is the error."""
        reach = points.reach
        floor = best + (1e-9 if level > 1 else -_MARGIN * max(1, abs(best))) if np.isfinite(best) else -np.inf
        chosen = np.flatnonzero((points.levels == level - 1) & (reach > floor))
        if not self.surface.fast:
            chosen = chosen[points.errors[chosen] > 1e-10]
        chosen = chosen[np.argsort(-reach[chosen])]
        if level == 1:  # whatever may be the highest, and that is soon told
            sure = best if np.isfinite(best) else float(np.max(points.values - points.errors, initial=-np.inf))
            most = max(most, min(int(_DOUBTFUL * self.scale), int(np.count_nonzero(reach[chosen] > sure))))
        chosen = chosen[:most]
        if not chosen.size:
            return
        value, error = self.surface.estimate(level, points.places[chosen])
        if not self.surface.fast:
            error = np.abs(value - points.values[chosen]) / 3
        points.values[chosen], points.levels[chosen] = value, level
        points.errors[chosen] = np.where(np.isfinite(error), error, 0)

    def _straighten(self) -> None:
        """Without an axis for the azimuth where that does not matter."""
        surface, points = self.surface, self.points
        if surface.fast:
            return
        albedo = surface.albedo
        if not albedo.anisotropic:
            order = np.argsort(points.values)[::-1]
            places = points.places[np.concatenate([order[:128], order[128 :: max(1, len(order) // 128)]])]
            clean = max(CLEAN, 64 * albedo.epsilon)
            first, second = (self._turned(places, turn)[0] for turn in _TURNS)
            with np.errstate(all="ignore"):
                change = np.abs(first - second) / np.maximum(np.maximum(np.abs(first), np.abs(second)), 1e-3)
                told = surface.box.physical(places)[1] < 1 - 1e-6  # light along N has no azimuth
                suspects = np.flatnonzero(told & (change > clean))
                suspects = suspects[np.argsort(-change[suspects])][:_SUSPECTS]
                here, there = (self._turned(places[suspects], *(turn + TREMORS)) for turn in _TURNS)
                told = apart(here, there, clean)
            albedo.anisotropic = bool(np.any(told))
        if not albedo.anisotropic:
            surface.box = surface.box.changed(turning=False)
            points.places = points.places[:, :-1]

    def _turned(self, places: np.ndarray, *angles: float) -> np.ndarray:
        """Quick values with the light turned by some angles (radians): (angles, places)."""
        every = np.repeat(places[None], len(angles), axis=0)
        every[..., -1] = (every[..., -1] + np.array(angles)[:, None] / (2 * np.pi)) % 1
        return self.surface.estimate(0, every.reshape(-1, places.shape[1]))[0].reshape(len(angles), -1)

    def starts(self, points: Points, most: int) -> np.ndarray:
        """Indices of the best points that are well separated, from all angles; a plateau of equal values is few of them.

        Towards grazing many BRDFs reflect all there is: without shares for the other angles, starts would be nowhere else.
        """
        box, angle = self.surface.box, self.surface.angle
        spacing = 0.5 * len(points.values) ** (-1 / max(box.dimension, 1))
        share = np.zeros(len(points.values), int)
        if angle is not None:
            share = np.minimum((points.places[:, angle] * _SHARES).astype(int), _SHARES - 1)
        parts = np.unique(share)
        quota = -(-most // len(parts))
        chosen: list[int] = []
        for part in parts:
            inside = np.flatnonzero((share == part) & np.isfinite(points.values))
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
                if box.distance(points.places[[*mine, *chosen]], points.places[index]).min(initial=np.inf) >= spacing:
                    mine.append(int(index))
            chosen += mine
        return np.array(chosen, int)

    def doubtful(self, best: float, known: np.ndarray, around: float) -> np.ndarray:
        """Indices of points that may be higher than `best` by their own error, not within `around` of the places `known`.

        Around those it is a climb that tells how high the surface goes.
        """
        points = self.points
        inside = (points.levels > 0) & (points.levels <= self.surface.finest) & (points.errors > 1e-7)
        indices = np.flatnonzero(inside & (points.reach > best + 1e-9))
        away = [self.surface.box.distance(known, points.places[i]).min(initial=np.inf) > around for i in indices]
        return indices[np.array(away, bool)]

    def _near(self, count: int, seed: int) -> np.ndarray:
        """Points where the surface may rise above the best between the points known so far: `count` of them, at most."""
        points, box = self.points, self.surface.box
        dimension = box.dimension
        good = np.flatnonzero(np.isfinite(points.values))
        if dimension == 0 or len(good) < 4 * (dimension + 1):
            return np.zeros((0, dimension))
        top = good[np.argsort(points.values[good])[::-1][: min(len(good), 4096)]]
        distance, neighbours = _neighbours(points.places[good], points.places[top], 2 * dimension + 2)
        around = points.values[good][neighbours]
        # As steep on as it was so far: what a point could be half way to the next.
        steep = np.max(np.abs(around - points.values[top][:, None]), axis=1)
        centres = np.argsort(points.values[top] + 0.5 * steep)[::-1][: max(1, count // 3)]
        random = np.random.default_rng(100 + seed)
        reach = np.maximum(distance[centres, -1], 1e-4)[:, None]
        moved = [points.places[top[centres]] + reach * random.normal(0, 0.5, (len(centres), dimension)) for _ in range(3)]
        return box.kept(np.concatenate(moved))

    def _echoes(self, winner: np.ndarray) -> np.ndarray:
        """Points that stand out from their neighbours, with the winner's angles, or all but one of its parameters.

        A narrow violation is met by few points, most of them at angles at which the albedo is lower throughout.
        """
        points, box, angle = self.points, self.surface.box, self.surface.angle
        swept, dimension = len(box.swept), box.dimension
        good = np.flatnonzero(np.isfinite(points.values))
        neighbours = 2 * dimension + 4
        if not swept or angle is None or len(good) < 4 * neighbours:
            return np.zeros((0, dimension))
        places, values = points.places[good], points.values[good]
        index = _neighbours(places, places, neighbours + 1)[1]
        # What a plane through the neighbours says of a point; shrunk a little, for neighbours that lie on a line.
        others = values[index[:, 1:]]
        offset = places[index[:, 1:]] - places[:, None]
        middle = offset.mean(axis=1, keepdims=True)
        spread = np.einsum("pki,pkj->pij", offset - middle, offset - middle)
        spread += 1e-3 * np.trace(spread, axis1=1, axis2=2)[:, None, None] * np.eye(dimension) + 1e-300 * np.eye(dimension)
        lever = np.einsum("pki,pk->pi", offset - middle, others - others.mean(axis=1, keepdims=True))
        slope = np.linalg.solve(spread, lever[..., None])[..., 0]
        plane = others.mean(axis=1) - np.einsum("pi,pi->p", slope, middle[:, 0])
        excess = (values - np.maximum(plane, np.median(others, axis=1))) / np.maximum(np.abs(values), 1e-300)
        # Those that are high for their angle, too.
        order = np.argsort(places[:, angle], kind="stable")
        window = max(len(order) // 64, 8)
        usual = np.empty(len(order))
        beyond = np.pad(values[order], window, mode="edge")
        usual[order] = np.convolve(beyond, np.full(2 * window + 1, 1 / (2 * window + 1)), mode="valid")
        high = values - usual
        ranked = np.argsort(-excess)
        chosen = np.unique(np.concatenate([ranked[:_ECHOES], np.argsort(-high)[: _ECHOES // 2]]))
        echoes = [places[chosen]]
        echoes[0][:, angle] = winner[angle]
        if box.turning:  # at their own azimuth, and at the winner's
            echoes.append(echoes[0].copy())
            echoes[1][:, -1] = winner[-1]
        # In a narrow range of a parameter the albedo may be lower than around it at most angles, and the highest at others.
        off = np.abs(values - plane)
        orders = np.stack([np.argsort(-off), np.argsort(-off / (points.errors[good] + 1e-9))], axis=1).ravel()
        odd: list[int] = []
        for row in orders[: 32 * _ODD]:
            if len(odd) < _ODD and np.all(np.max(np.abs(places[odd] - places[row])[:, :swept], axis=1) > _ODD_APART):
                odd.append(row)
        echoes.append(self.at_all_angles(places[odd]))
        # One parameter at a time with all else as for the winner, and with the point's own angle: what is narrow in both.
        few = places[ranked[: _ECHOES // 2]]
        for axis in range(swept if swept > 1 else 0):
            for kept in ([axis], [axis, angle]):
                crossed = np.tile(winner, (len(few), 1))
                crossed[:, kept] = few[:, kept]
                echoes.append(crossed)
        return np.concatenate(echoes)

    def at_all_angles(self, places: np.ndarray) -> np.ndarray:
        """The parameters (and azimuths) of some places at the angles about which the albedo is the highest, of all."""
        angle = self.surface.angle
        if angle is None or not len(places):
            return places

        def at(angles: np.ndarray) -> np.ndarray:  # (places, angles)
            lines = np.repeat(places[:, None], angles.shape[1], axis=1)
            lines[..., angle] = angles
            return lines.reshape(-1, places.shape[1])

        every = np.tile(np.linspace(0, 1, _ODD_ANGLES), (len(places), 1))
        value = np.pad(self.surface.estimate(0, at(every))[0].reshape(every.shape), ((0, 0), (1, 1)), constant_values=-np.inf)
        crest = (value[:, 1:-1] >= value[:, :-2]) & (value[:, 1:-1] >= value[:, 2:])
        tops = np.argsort(-np.where(crest, value[:, 1:-1], -np.inf), axis=1)[:, :2] / (_ODD_ANGLES - 1)
        found = []
        for step in (1, 1 / 4, 1 / 16):
            beside = np.clip(tops[..., None] + step * _BETWEEN / (_ODD_ANGLES - 1), 0, 1)
            value = self.surface.estimate(0, at(beside.reshape(len(places), -1)))[0].reshape(beside.shape)
            tops = np.take_along_axis(beside, np.argmax(value, axis=2)[..., None], 2)[..., 0]
            found.append(beside.reshape(len(places), -1))
        return at(np.concatenate(found, axis=1))

    def width(self, places: np.ndarray | None) -> dict[str, float]:
        """The widest region that scans may have missed: the largest gaps between points, axis by axis and in all.

        `places`: those that count, where the quick rules resolve nothing.
        """
        box = self.surface.box
        places = self.points.places if places is None else places
        found: dict[str, float] = {}
        for axis, name in enumerate(box.names):
            if axis < len(box.swept) and name in box.switches:  # between its two values there is nothing to miss
                continue
            values = np.unique(np.concatenate([[0.0, 1.0], places[:, axis]]))
            gap = float(np.max(np.diff(values)))
            if axis == self.surface.angle:
                middle = np.linspace(0, 1, 512)
                ends = np.zeros((2, 512, box.dimension))
                ends[0, :, axis], ends[1, :, axis] = np.clip([middle - gap / 2, middle + gap / 2], 0, 1)
                low, high = (np.degrees(np.arccos(np.clip(box.physical(end)[1], 0, 1))) for end in ends)
                gap = float(np.max(np.abs(low - high)))
            elif box.periodic[axis]:
                gap *= 360.0
            # A user's parameter may have the name of an angle.
            own = axis < len(box.swept) and name in ("angle", "azimuth", "view", "cell")
            found[f"parameter {name}" if own else name] = gap
        if box.dimension > 1:
            found["cell"] = float(min(1.0, 2.5 * len(places) ** (-1 / box.dimension)))
        return found


def standing_out(lines: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Where lines along parameters (axes, points, dimension) stand out upwards or downwards: (places, dimension).

    Quick rules err alike along them: so a narrow range is seen in which the BRDF is another one.
    """
    far = max(2, height.shape[1] // _BESIDE)
    chosen = []
    for line, along in zip(lines, height, strict=True):
        beyond = np.pad(along, far, mode="edge")
        off = np.nan_to_num(np.abs(along - (beyond[: -2 * far] + beyond[2 * far :]) / 2), posinf=0.0)
        for _ in range(_ON_A_LINE):
            top = int(np.argmax(off))
            if off[top] > 0:
                chosen.append(line[top])
            off[max(0, top - far) : top + far + 1] = 0
    return np.array(chosen).reshape(-1, lines.shape[-1])
