r"""The adaptive rule: the albedo of anything that can be called, with an error bar of its own making.

Directions are written about the axis *across* the plane of incidence, not about the normal:

    wo = (cos b sin t, sin b, cos b cos t),  -pi/2 < t, b < pi/2,  (N.wo) dwo = cos^2 b cos t db dt.

The hemisphere is then a square without a pole, the weight vanishes on its rim, and every place where lobes sit lies on
the line b = 0: the mirror direction (t = -theta), the normal (0) and the light (theta). The great circle at 90 degrees
from the mirror direction, where a cut lobe has its kink, is the straight line t = pi/2 - theta. These four are *seeds*.

Each seed is the corner of squares that reach half way to the next seed. A square is two triangles with their apex at
the seed, in the coordinates (r, q): the offsets along and across are (r, r q) or (r q, r), with r = `_CENTRE` sinh(u)
and q = v^2. In u a lobe of any width down to `_CENTRE` is a bump of length one, so a few panels see every needle about
a seed, and v crowds the nodes where grazing light makes a needle long and thin. The rest is cut into rectangles that
grow away from the seeds, up to `_LONGEST`.

A box carries the product of two Gauss-Kronrod rules (7, 15). Its error has two parts, found for each axis:

* On every line of nodes, K15 - G7 together with the one odd combination of the nodes that vanishes on polynomials of
  degree 12: each alone is blind to a kink in some places, the two are not blind in the same ones. Absolute values are
  taken line by line, so that lines do not cancel.
* At probes just inside the faces, where a rule has no nodes, the value less what the polynomial through the nodes says:
  a sliver of something that has its body in the box next door.

The box is halved across the axis to blame.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np

# The radius (radians) about a seed inside which nodes are spread evenly, and the longest side of an initial box.
_CENTRE = 1e-6
_LONGEST = 0.4
# Seeds closer together than this are one.
_SAME = 1e-7
# Lengths of the first panels in u, from r = _LONGEST inwards: short in u where they would be long in radians. One more
# panel has the rest, if any.
_PANELS = (1.2, 2.4, 5.0, 5.0)
# Probes sit this fraction of a box inside its faces; what they find wrong counts for this fraction of the box.
_SKIN = 1e-5
_SKIN_WEIGHT = 0.02
# Rows given to `evaluate` at a time, and rounds of refinement.
_LARGEST_BATCH = 2**17
_ROUNDS = 58
# Over how many rounds a sum is watched that does not converge.
_LAST_ROUNDS = 12
# The radius (radians) about a seed inside which directions are not told apart well enough.
_BLUR = 1e-13
# How many roundings an evaluation is taken to contain; from what size on a number counts as infinite.
_ROUNDINGS = 16
_INFINITE = 1e290

# What Kronrod adds to the nodes of the seven-point Gauss rule, from QUADPACK.
_ADDED = np.array([0.991455371120812640, 0.864864423359769073, 0.586087235467691130, 0.207784955007898468])


def _rules() -> tuple[np.ndarray, np.ndarray]:
    """Nodes on [0, 1]; on them the weights of K15, of K15 - G7 and of the odd null rule. Shapes (15,) and (3, 15)."""
    gauss_nodes, gauss_weights = np.polynomial.legendre.leggauss(7)
    nodes = np.sort(np.concatenate([gauss_nodes, _ADDED, -_ADDED]))
    basis = np.polynomial.legendre.legvander(nodes, 14)
    kronrod = np.linalg.solve(basis.T, 2.0 * (np.arange(15) == 0))
    even = kronrod.copy()
    even[1::2] -= gauss_weights
    # Two dimensions of rules vanish up to degree 12; the odd one is what is left beside the even one, at the same size.
    taken = np.concatenate([basis[:, :13], even[:, None]], axis=1)
    odd = np.linalg.qr(taken, mode="complete")[0][:, -1] * np.linalg.norm(even)
    return (1 + nodes) / 2, np.stack([kronrod, even, odd]) / 2


def _lagrange(nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The matrix that takes values at `nodes` to those of their polynomial at `x`."""
    others = ~np.eye(nodes.size, dtype=bool)
    factors = (x[:, None, None] - nodes) / np.where(others, nodes[:, None] - nodes, 1)
    return np.prod(np.where(others, factors, 1), axis=-1)


def _probes(nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Probes in the unit square, shape (probes, 2), face by face, and the matrix that predicts them from the nodes."""
    between = (nodes[1:] + nodes[:-1]) / 2
    low, high = np.full(between.size, _SKIN), np.full(between.size, 1 - _SKIN)
    first = np.concatenate([low, high, between, between])
    second = np.concatenate([between, between, low, high])
    matrix = np.einsum("pi,pj->pij", _lagrange(nodes, first), _lagrange(nodes, second))
    return np.stack([first, second], axis=-1), matrix.reshape(first.size, -1)


_NODES, _WEIGHTS = _rules()
_TENSOR = _NODES.size**2
_PROBES, _PREDICTION = _probes(_NODES)
# Where a box is evaluated: the product of the nodes, then the probes.
_POINTS = np.concatenate([np.stack(np.meshgrid(_NODES, _NODES, indexing="ij"), axis=-1).reshape(-1, 2), _PROBES])


class HemisphereIntegral(NamedTuple):
    """The integral of f(wo) (N.wo) over the hemisphere, and how far it is to be believed.

    `converged` says that `error` is within the tolerance and that every evaluation was finite. Where the sum rises as fast at
    the end as before, however small the boxes, the integral has no finite value: inf +- inf.
    """

    value: np.ndarray  # shape (), or (channels,)
    error: np.ndarray  # an estimated bound of the absolute error, rounding included; the shape of `value`
    evaluations: int
    converged: bool
    nonfinite: int  # evaluations that were NaN or infinite, and were replaced by 0


class _Boxes(NamedTuple):
    """Boxes [low, low + size] of the coordinates (u, v) of a patch, or of (along, across) where it is plain."""

    low: np.ndarray  # (boxes, 2)
    size: np.ndarray  # (boxes, 2)
    # Columns: the half of the plane of incidence (+1: the light's), the elevation of the seed, whether the elevation
    # rises or falls (+1, -1) away from it, the sign of b, and the kind: 0 plain, 1 first triangle, 2 second triangle.
    patch: np.ndarray  # (boxes, 5)


class _Measured(NamedTuple):
    """What the rule says of each box."""

    value: np.ndarray  # (boxes, channels)
    error: np.ndarray  # (boxes, channels)
    noise: np.ndarray  # (boxes, channels): the rounding error of `value`
    axis: np.ndarray  # (boxes,): the one with the larger error


def _initial_boxes(sine: float, cosine: float) -> _Boxes:
    theta, elevation = np.arctan2(sine, cosine), np.arctan2(cosine, sine)
    # (t, elevation) of the seeds: the elevation on its own keeps its digits near the horizon.
    seeds = [(0.0, np.pi / 2)]
    for seed in ((-theta, elevation), (theta, elevation), (elevation, theta)):
        if all(abs(seed[0] - other[0]) > _SAME for other in seeds):
            seeds.append(seed)
    seeds.sort()
    rows: list[tuple[float, ...]] = []
    for index, (angle, height) in enumerate(seeds):
        for way in (-1, 1):
            neighbour = index + way
            reach = abs(seeds[neighbour][0] - angle) / 2 if 0 <= neighbour < len(seeds) else height
            side = np.sign(angle) or way
            rise = -1 if side == way else 1
            rows += [(*box, side, height, rise, sign, kind) for *box, kind in _corner(reach) for sign in (-1, 1)]
    table = np.array(rows)
    return _Boxes(table[:, 0:2], table[:, 2:4], table[:, 4:])


def _corner(reach: float) -> list[tuple[float, float, float, float, int]]:
    """Boxes (low, low, size, size, kind) that fill the rectangle [0, reach] x [0, pi/2] with a seed at its corner."""
    if reach <= 0:
        return []
    core = min(reach, _LONGEST)
    stops = np.arcsinh(_LONGEST / _CENTRE) - np.cumsum([0.0, *_PANELS])
    stops = np.unique(np.clip([*stops, 0.0], 0, np.arcsinh(core / _CENTRE)))
    boxes = [(low, 0.0, high - low, 1.0, kind) for low, high in pairwise(stops) for kind in (1, 2)]
    # Beside the square, across the plane: a ladder of rectangles that grow with their distance from the seed.
    rungs = [core]
    while rungs[-1] < np.pi / 2:
        rung = min(max(4 * rungs[-1], _CENTRE), rungs[-1] + _LONGEST)
        rungs.append(rung if rung < np.pi / 2 - _LONGEST / 2 else np.pi / 2)
    boxes += [(0.0, low, core, high - low, 0) for low, high in pairwise(rungs)]
    if reach > core:
        # Beyond it, along the plane. An angle along the plane is shorter by cos b than it reads.
        rungs = list(np.linspace(0, np.pi / 2, int(np.ceil(np.pi / 2 / _LONGEST)) + 1))
        for low, high in pairwise(rungs):
            count = int(np.ceil((reach - core) * np.cos(low) / _LONGEST))
            size = (reach - core) / count
            boxes += [(core + i * size, low, size, high - low, 0) for i in range(count)]
    return boxes


def _directions(boxes: _Boxes) -> tuple[np.ndarray, np.ndarray]:
    """wo for light at azimuth 0, shape (boxes, points, 3), and (N.wo) dwo over the box, shape (boxes, points)."""
    first = boxes.low[:, :1] + boxes.size[:, :1] * _POINTS[:, 0]
    second = boxes.low[:, 1:] + boxes.size[:, 1:] * _POINTS[:, 1]
    side, height, rise, sign, kind = (column[:, None] for column in boxes.patch.T)
    plain = kind == 0
    stretched = np.where(plain, 0, first)
    radius = _CENTRE * np.sinh(stretched)
    lead = np.where(plain, first, radius)
    lag = np.where(plain, second, radius * second**2)
    density = np.where(plain, 1, radius * _CENTRE * np.cosh(stretched) * 2 * second)
    # Rounding must not push a direction below the horizon.
    elevation = np.maximum(height + rise * np.where(kind == 2, lag, lead), 0)
    across = np.where(kind == 2, lead, lag)
    cosine = np.maximum(np.cos(across), 0)
    normal = cosine * np.sin(elevation)
    wo = np.stack([side * cosine * np.cos(elevation), sign * np.sin(across), normal], axis=-1)
    return wo, density * cosine * normal * boxes.size[:, :1] * boxes.size[:, 1:]


class _Integrand:
    """`evaluate` seen through boxes; keeps count of what it was asked for."""

    def __init__(self, evaluate: Callable[[np.ndarray], np.ndarray], azimuth: float):
        self.evaluate = evaluate
        self.turn = np.cos(azimuth), np.sin(azimuth)
        self.evaluations = self.nonfinite = 0
        self.scalar = True

    def measure(self, boxes: _Boxes) -> _Measured:
        most = _LARGEST_BATCH // len(_POINTS)
        starts = range(0, len(boxes.low), most)
        parts = [self._measure(_Boxes(*(column[i : i + most] for column in boxes))) for i in starts]
        return _Measured(*(np.concatenate(column) for column in zip(*parts, strict=True)))

    def _measure(self, boxes: _Boxes) -> _Measured:
        wo, weight = _directions(boxes)
        (c, s), x, y = self.turn, wo[..., 0], wo[..., 1]
        wo[..., 0], wo[..., 1] = c * x - s * y, s * x + c * y
        count = weight.size
        answer = np.asarray(self.evaluate(wo.reshape(count, 3)))
        if answer.ndim not in (1, 2) or answer.shape[0] != count:
            raise ValueError(f"evaluate must return shape ({count},) or ({count}, channels); got {answer.shape}")
        self.scalar = answer.ndim == 1
        precision = np.finfo(answer.dtype if np.issubdtype(answer.dtype, np.floating) else float).eps
        answer = answer.astype(float).reshape(*weight.shape, -1)
        good = np.abs(answer) < _INFINITE
        self.evaluations += count
        self.nonfinite += count - int(np.count_nonzero(np.all(good, axis=-1)))
        values = np.where(good, answer, 0) * weight[..., None]
        nodes, probes = values[:, :_TENSOR], values[:, _TENSOR:]
        surprise = np.abs(probes - np.matmul(_PREDICTION, nodes))
        nodes = nodes.reshape(len(nodes), _NODES.size, _NODES.size, -1)
        kronrod = _WEIGHTS[0]
        # (boxes, rule, line, channels), the rules along the first axis and along the second.
        lines = np.einsum("ri,bijc->brjc", _WEIGHTS, nodes), np.einsum("rj,bijc->bric", _WEIGHTS, nodes)
        error = np.stack([np.einsum("blc,l->bc", np.hypot(line[:, 1], line[:, 2]), kronrod) for line in lines], axis=1)
        # (boxes, axis, face, probe, channels). What is wrong all along a face calls for cuts parallel to it, what is
        # wrong at some of its probes only for cuts across it.
        surprise = surprise.reshape(len(nodes), 2, 2, -1, nodes.shape[-1])
        whole, local = surprise.mean(axis=(2, 3)), surprise.std(axis=3).mean(axis=2)
        error += _SKIN_WEIGHT * (whole + local[:, ::-1])
        value = np.einsum("blc,l->bc", lines[0][:, 0], kronrod)
        total = np.einsum("bijc,i,j->bc", np.abs(nodes), kronrod, kronrod)
        noise = _ROUNDINGS * precision * total
        axis, error = np.argmax(error.max(axis=-1), axis=1), error.sum(axis=1)
        # Directions are rounded too: this close to a seed nothing is to be learnt from smaller boxes.
        blurred = (boxes.patch[:, 4] != 0) & (_CENTRE * np.sinh(boxes.low[:, 0] + boxes.size[:, 0]) < _BLUR)
        noise = np.where(blurred[:, None], total, noise)
        return _Measured(value, np.where(blurred[:, None], 0, error), noise, axis)


def _halves(boxes: _Boxes, axis: np.ndarray) -> _Boxes:
    """The lower halves of all boxes, then the upper ones."""
    cut = axis[:, None] == np.arange(2)
    size = np.where(cut, boxes.size / 2, boxes.size)
    upper = np.where(cut, boxes.low + size, boxes.low)
    return _Boxes(np.concatenate([boxes.low, upper]), np.tile(size, (2, 1)), np.tile(boxes.patch, (2, 1)))


def _rises_without_end(sums: np.ndarray) -> np.ndarray:
    """True for each channel whose sums (rounds, channels) rise by no less in the last rounds than in those before."""
    steps = np.diff(sums, axis=0)[-_LAST_ROUNDS:]
    if len(steps) < _LAST_ROUNDS:
        return np.zeros(sums.shape[1], bool)
    half = _LAST_ROUNDS // 2
    lasting = np.all(steps > 0, axis=0) & (steps[half:].mean(axis=0) > 0.9 * steps[:half].mean(axis=0))
    return lasting & (steps.sum(axis=0) > 0.01 * np.abs(sums[-1]))  # rounding may creep up, but not that far


def integrate_hemisphere(
    evaluate: Callable[[np.ndarray], np.ndarray],
    cos_theta: float,
    azimuth: float = 0.0,
    *,
    tolerance: float = 1e-8,
    max_evaluations: int = 4_000_000,
) -> HemisphereIntegral:
    """The integral of f(wo) (N.wo) over the hemisphere, for light at the polar angle acos(cos_theta) and `azimuth`.

    `evaluate` takes wo, float64 of shape (k, 3) with N = +z, and returns f in 1/sr, shape (k,) or (k, channels). The
    goal for each channel is an error of `tolerance` * max(|value|, 1). Azimuth in radians.

    Lobes about the mirror direction, the normal and the light are found down to a width of 1e-6 radians. Any other is
    seen only where a point of the initial mesh meets it, and these are up to 0.04 radians apart: a spot of a smaller
    diameter with nothing around it, a smooth lobe narrower than about 0.005 radians, or a piece of a streak as thin as
    that, can be missed without a sign. A jump costs evaluations like 1 / error, and so ends with converged=False. So
    does a tolerance below the rounding of `evaluate`, which is known from the dtype of its answers.

    The initial mesh (29,000 to 72,000 evaluations) is evaluated whatever `max_evaluations` says. ValueError for a
    cosine outside [0, 1], an azimuth that is not finite, a tolerance that is not positive, or answers of a wrong shape.
    """
    if not 0 <= cos_theta <= 1:
        raise ValueError(f"cos_theta must be in [0, 1]; got {cos_theta}")
    if not np.isfinite(azimuth):
        raise ValueError(f"azimuth must be finite; got {azimuth}")
    if not tolerance > 0:
        raise ValueError(f"tolerance must be > 0; got {tolerance}")
    integrand = _Integrand(evaluate, float(azimuth))
    boxes = _initial_boxes(float(np.sqrt((1 - cos_theta) * (1 + cos_theta))), float(cos_theta))
    found = integrand.measure(boxes)
    sums = []
    for _ in range(_ROUNDS):
        sums.append(found.value.sum(axis=0))
        goal = tolerance * np.maximum(np.abs(found.value.sum(axis=0)), 1)
        if np.all(found.error.sum(axis=0) + found.noise.sum(axis=0) <= goal):
            break
        # The best boxes are left alone as long as together they use up no more than half of the goal; so are those in
        # which rounding is the error.
        share = np.max(np.where(found.error > found.noise, found.error, 0) / goal, axis=-1)
        order = np.argsort(share)
        room = max(max_evaluations - integrand.evaluations, 0) // (2 * len(_POINTS))
        chosen = order[np.cumsum(share[order]) > 0.5][::-1][:room]
        if not chosen.size:
            break
        halves = _halves(_Boxes(*(column[chosen] for column in boxes)), found.axis[chosen])
        fresh = integrand.measure(halves)
        rest = np.delete(np.arange(len(share)), chosen)
        boxes = _Boxes(*(np.concatenate([old[rest], new]) for old, new in zip(boxes, halves, strict=True)))
        found = _Measured(*(np.concatenate([old[rest], new]) for old, new in zip(found, fresh, strict=True)))
    value = found.value.sum(axis=0)
    error = found.error.sum(axis=0) + found.noise.sum(axis=0)
    converged = bool(np.all(error <= tolerance * np.maximum(np.abs(value), 1))) and integrand.nonfinite == 0
    if not converged and np.any(error > 0.05 * np.abs(value)):
        endless = _rises_without_end(np.array(sums))
        value, error = np.where(endless, np.inf, value), np.where(endless, np.inf, error)
    if integrand.scalar:
        value, error = value[0], error[0]
    return HemisphereIntegral(np.asarray(value), np.asarray(error), integrand.evaluations, converged, integrand.nonfinite)
