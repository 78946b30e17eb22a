r"""The adaptive rule: the albedo of anything that can be called, with an error bar of its own making.

The hemisphere is cut into boxes about the places where lobes sit (`quadrature.boxes`).

A box carries the product of two Gauss-Kronrod rules (7, 15). Its error has two parts, found for each axis:

* On every line of nodes, K15 - G7 together with the one odd combination of the nodes that vanishes on polynomials of
  degree 12: each alone is blind to a kink in some places, the two are not blind in the same ones. Absolute values are
  taken line by line, so that lines do not cancel.
* At probes just inside the faces, where a rule has no nodes, the value less what the polynomial through the nodes says:
  a sliver of something that has its body in the box next door.

The box is cut across the axis to blame (`quadrature.cuts`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from brdfcheck.numerics import Columns
from brdfcheck.quadrature.boxes import CENTRE, Boxes, Grid, Mesh, directions, initial_boxes
from brdfcheck.quadrature.cuts import Cuts, halvings_of, pieces_of

# Probes sit this fraction of a box inside its faces; what they find wrong counts for this fraction of the box.
_SKIN = 1e-5
_SKIN_WEIGHT = 0.02
# Rows given to `evaluate` at a time, and rounds of refinement.
_LARGEST_BATCH = 72_000
_ROUNDS = 58
# Over how many rounds a sum is watched that does not converge.
_LAST_ROUNDS = 12
# What is looked at beside the circle of directions as high as the light: so far off (radians), at so many azimuths, for jumps
# that lie closer to it than probes, but not on it.
_BESIDE, _ON = 8e-6, 1e-13
_AZIMUTHS = 32
# The radius (radians) about a seed inside which directions are not told apart well enough.
_BLUR = 1e-11
# How many roundings an evaluation is taken to contain; from what size on a number counts as infinite.
_ROUNDINGS = 16
_INFINITE = 1e290
# Multiplications in a product of matrices that BLAS does in one thread.
_ALONE = 200_000

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


_NODES, _WEIGHTS = _rules()
_SIDE = _NODES.size
_TENSOR = _SIDE**2
_EDGES, _BETWEEN = np.array([_SKIN, 1 - _SKIN]), (_NODES[1:] + _NODES[:-1]) / 2
# What is made of the values on a line of nodes: its three rules, and what they predict at the ends.
_OF_LINES = np.concatenate([_WEIGHTS, _lagrange(_NODES, _EDGES)]).T
_TO_BETWEEN = _lagrange(_NODES, _BETWEEN).T
# Where a box is evaluated: the product of the nodes, then the probes of the faces across the first axis and the second.
_NODES_ONLY, *_FACES = (
    np.stack(np.meshgrid(*pair, indexing="ij"), axis=-1).reshape(-1, 2)
    for pair in ((_NODES, _NODES), (_EDGES, _BETWEEN), (_BETWEEN, _EDGES))
)
_POINTS = np.concatenate([_NODES_ONLY, *_FACES])
_GRID, _GRID_OF_NODES = Grid(_POINTS), Grid(_NODES_ONLY)


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
    mesh: Mesh  # the rule that gave the value, for BRDFs and incidences like this one


@dataclass(frozen=True)
class _Measured(Columns):
    """What the rule says of each box."""

    value: np.ndarray  # (boxes, channels)
    error: np.ndarray  # (boxes, channels)
    noise: np.ndarray  # (boxes, channels): the rounding error of `value`
    axis: np.ndarray  # (boxes,): the one with the larger error


def _product(rows: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    """rows @ matrix, in pieces below what BLAS shares out among threads of its own: the cores are busy already."""
    step = max(1, _ALONE // matrix.size)
    return np.concatenate([rows[i : i + step] @ matrix for i in range(0, len(rows), step)])


class _Integrand:
    """`evaluate` seen through boxes; keeps count of what it was asked for."""

    def __init__(self, evaluate: Callable[[np.ndarray], np.ndarray], azimuth: float, sides: int):
        self.evaluate, self.sides = evaluate, sides
        self.turn = np.cos(azimuth), np.sin(azimuth)
        self.evaluations = self.nonfinite = 0
        self.scalar = True

    def measure(self, boxes: Boxes) -> _Measured:
        most = _LARGEST_BATCH // len(_POINTS)
        parts = [self._measure(boxes.taken(slice(i, i + most))) for i in range(0, len(boxes.low), most)]
        return parts[0].joined(*parts[1:])

    def _measure(self, boxes: Boxes) -> _Measured:
        shape = len(boxes.low), len(_POINTS)
        wo, weight, count = np.empty((3, *shape)), np.empty(shape), shape[0] * shape[1]
        directions(boxes, _GRID, wo, weight)
        weight *= self.sides
        (c, s), (x, y, _) = self.turn, wo
        if s:
            wo[0], wo[1] = c * x - s * y, s * x + c * y
        answer = np.asarray(self.evaluate(wo.reshape(3, count).T))
        if answer.ndim not in (1, 2) or answer.shape[0] != count:
            raise ValueError(f"evaluate must return shape ({count},) or ({count}, channels); got {answer.shape}")
        self.scalar = answer.ndim == 1
        precision = np.finfo(answer.dtype if np.issubdtype(answer.dtype, np.floating) else float).eps
        # A row for each box and channel, so that all that follows is products of matrices.
        answer = answer.astype(float, copy=False).reshape(*shape, -1)
        channels = answer.shape[-1]
        self.evaluations += count
        good = np.abs(answer) < _INFINITE
        if not np.all(good):
            self.nonfinite += int(np.count_nonzero(~np.all(good, axis=2)))
            answer = np.where(good, answer, 0)
        values = (np.moveaxis(answer, 2, 1) * weight[:, None]).reshape(-1, len(_POINTS))
        rows, kronrod = len(values), _WEIGHTS[0]
        square = values[:, :_TENSOR].reshape(rows, _SIDE, _SIDE)
        # Along the first axis and along the second: (rows, line, rule or end).
        first, second = (
            _product(part.reshape(-1, _SIDE), _OF_LINES).reshape(rows, _SIDE, -1) for part in (square.swapaxes(1, 2), square)
        )
        error = np.stack([np.hypot(line[..., 1], line[..., 2]) @ kronrod for line in (first, second)], axis=1)
        # (rows, axis, face, probe). What is wrong all along a face calls for cuts parallel to it, what is wrong at some of its
        # probes only for cuts across it.
        predicted = np.stack([line[..., 3:].swapaxes(1, 2) for line in (first, second)], axis=1)
        probes = values[:, _TENSOR:].reshape(rows, 2, -1)
        probes = np.stack([probes[:, 0].reshape(rows, 2, -1), probes[:, 1].reshape(rows, -1, 2).swapaxes(1, 2)], axis=1)
        surprise = np.abs(probes - _product(predicted.reshape(-1, _SIDE), _TO_BETWEEN).reshape(rows, 2, 2, -1))
        mean = surprise.mean(axis=3)
        apart = surprise - mean[..., None]
        local = np.sqrt(np.einsum("bafp,bafp->baf", apart, apart) / surprise.shape[-1]).mean(axis=2)
        error += _SKIN_WEIGHT * (mean.mean(axis=2) + local[:, ::-1])
        total = (np.abs(values[:, :_TENSOR]) @ np.outer(kronrod, kronrod).ravel()).reshape(-1, channels)
        value = (first[..., 0] @ kronrod).reshape(-1, channels)
        error = error.reshape(-1, channels, 2)
        noise = _ROUNDINGS * precision * total
        axis, error = np.argmax(error.max(axis=1), axis=1), error.sum(axis=2)
        # Directions are rounded too: this close to a seed nothing is to be learnt from smaller boxes.
        blurred = (boxes.patch[:, 4] != 0) & (CENTRE * np.sinh(boxes.low[:, 0] + boxes.size[:, 0]) < _BLUR)
        noise = np.where(blurred[:, None], total, noise)
        return _Measured(value, np.where(blurred[:, None], 0, error), noise, axis)

    def slivers(self, sine: float, cosine: float) -> np.ndarray | float:
        """How much may lie between the circle as high as the light, where boxes end, and a jump just beside it: (channels,).

        Differences across the circle at three distances: what is smooth is in proportion to them, a jump on the circle is in
        all three, and neither counts here.
        """
        azimuth = (np.arange(_AZIMUTHS) + 0.5) * 2 * np.pi / _AZIMUTHS
        beside = _BESIDE * min(1, 100 * cosine)  # at low light even what is smooth changes within less
        angle = np.arctan2(sine, cosine) + np.array([beside, beside / 2, _ON])[:, None] * np.array([1.0, -1.0])
        if np.any((angle < 0) | (angle > np.pi / 2)):
            return 0.0  # at grazing light and along the normal the circle is a seed
        up, flat = np.cos(angle)[..., None], np.sin(angle)[..., None]
        wo = np.stack(np.broadcast_arrays(flat * np.cos(azimuth), flat * np.sin(azimuth), up), axis=-1).reshape(-1, 3)
        self.evaluations += len(wo)
        with np.errstate(all="ignore"):
            values = np.asarray(self.evaluate(wo), float).reshape(len(wo), -1)
            self.nonfinite += int(np.count_nonzero(~np.all(np.abs(values) < _INFINITE, axis=1)))
            far, middle, on = np.subtract(*values.reshape(3, 2, _AZIMUTHS, -1).swapaxes(0, 1))
            jump = np.abs(far - 2 * middle + on).mean(axis=0)
        return np.where(np.isfinite(jump), jump, 0) * 2 * np.pi * sine * cosine * beside


def _rises_without_end(sums: np.ndarray, halvings: np.ndarray) -> np.ndarray:
    """True for each channel whose sums (rounds, channels) rise by no less in the last rounds than in those before.

    `halvings` (rounds - 1,): for how many halvings of boxes each round stands.
    """
    steps = np.diff(sums, axis=0)[-_LAST_ROUNDS:]
    if len(steps) < _LAST_ROUNDS:
        return np.zeros(sums.shape[1], bool)
    half, lasting = _LAST_ROUNDS // 2, np.all(steps > 0, axis=0)
    for rise in (steps, steps / halvings[-_LAST_ROUNDS:, None]):  # a round of many halvings among others proves neither
        lasting &= rise[half:].mean(axis=0) > 0.9 * rise[:half].mean(axis=0)
    return lasting & (steps.sum(axis=0) > 0.01 * np.abs(sums[-1]))  # rounding may creep up, but not that far


def integrate_hemisphere(
    evaluate: Callable[[np.ndarray], np.ndarray],
    cos_theta: float,
    azimuth: float = 0.0,
    *,
    tolerance: float = 1e-8,
    max_evaluations: int = 4_000_000,
    half: bool = False,
) -> HemisphereIntegral:
    """The integral of f(wo) (N.wo) over the hemisphere, for light at the polar angle acos(cos_theta) and `azimuth`.

    `evaluate` takes wo, float64 of shape (k, 3) with N = +z, and returns f in 1/sr, shape (k,) or (k, channels). The
    goal for each channel is an error of `tolerance` * max(|value|, 1). Azimuth in radians. `half`: f is the same on both sides
    of the plane of incidence and is asked on one of them, for half of the evaluations.

    Lobes about the mirror direction, the normal and the light are found down to a width of 1e-6 radians. Any other is
    seen only where a point of the initial mesh meets it, and these are up to 0.04 radians apart: a spot of a smaller
    diameter with nothing around it, a smooth lobe narrower than about 0.005 radians, or a piece of a streak as thin as
    that, can be missed without a sign. A jump costs evaluations like 1 / error, and so ends with converged=False. So
    does a tolerance below the rounding of `evaluate`, which is known from the dtype of its answers.

    The initial mesh (29,000 to 84,000 evaluations) is evaluated whatever `max_evaluations` says. ValueError for a
    cosine outside [0, 1], an azimuth that is not finite, a tolerance that is not positive, or answers of a wrong shape.
    """
    if not 0 <= cos_theta <= 1:
        raise ValueError(f"cos_theta must be in [0, 1]; got {cos_theta}")
    if not np.isfinite(azimuth):
        raise ValueError(f"azimuth must be finite; got {azimuth}")
    if not tolerance > 0:
        raise ValueError(f"tolerance must be > 0; got {tolerance}")
    sides = 2 if half else 1
    integrand = _Integrand(evaluate, float(azimuth), sides)
    sine = float(np.sqrt((1 - cos_theta) * (1 + cos_theta)))
    boxes = initial_boxes(sine, float(cos_theta), half)
    found = integrand.measure(boxes)
    sums, halvings, cuts = [], [], Cuts.none(len(boxes.low))
    for _ in range(_ROUNDS):
        sums.append(found.value.sum(axis=0))
        goal = tolerance * np.maximum(np.abs(found.value.sum(axis=0)), 1)
        if np.all(found.error.sum(axis=0) + found.noise.sum(axis=0) <= goal):
            break
        # The best boxes are left alone as long as together they use up no more than half of the goal; so are those in
        # which rounding is the error.
        share = np.max(np.where(found.error > found.noise, found.error, 0) / goal, axis=-1)
        order = np.argsort(share)
        chosen = order[np.cumsum(share[order]) > 0.5][::-1]
        ways = cuts.taken(chosen).ways(found.axis[chosen], share[chosen], 0.5 / len(share))
        room = max(max_evaluations // sides - integrand.evaluations, 0) // len(_POINTS)
        fits = np.cumsum(pieces_of(ways)) <= room
        chosen, ways = chosen[fits], ways[fits]
        if not chosen.size:
            break
        halvings.append(np.average(halvings_of(ways), weights=share[chosen]))
        pieces, fresh_cuts = cuts.taken(chosen).applied(boxes.taken(chosen), found.axis[chosen], share[chosen], ways)
        fresh = integrand.measure(pieces)
        rest = np.delete(np.arange(len(share)), chosen)
        boxes, cuts = boxes.taken(rest).joined(pieces), cuts.taken(rest).joined(fresh_cuts)
        found = found.taken(rest).joined(fresh)
    value = found.value.sum(axis=0)
    error = found.error.sum(axis=0) + found.noise.sum(axis=0) + integrand.slivers(sine, float(cos_theta))
    converged = bool(np.all(error <= tolerance * np.maximum(np.abs(value), 1))) and integrand.nonfinite == 0
    if not converged and np.any(error > 0.05 * np.abs(value)):
        endless = _rises_without_end(np.array(sums), np.array(halvings))
        value, error = np.where(endless, np.inf, value), np.where(endless, np.inf, error)
    if integrand.scalar:
        value, error = value[0], error[0]
    mesh = Mesh(boxes, float(cos_theta), _GRID_OF_NODES, sides * np.outer(_WEIGHTS[0], _WEIGHTS[0]).ravel())
    return HemisphereIntegral(np.asarray(value), np.asarray(error), integrand.evaluations, converged, integrand.nonfinite, mesh)
