"""The albedo of a family of BRDFs at scattered points (parameters, cosine, azimuth), whatever engine it needs.

A point can be asked for in two ways: `estimate` is quick and coarse, for scans and climbs over thousands of points; a call is
what a verdict rests on. For RGB families the value at a point is that of the worst channel.
"""

from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.base import AbstractBRDF
from brdfcheck.brdf.callables import BLOCK, TABLE, Evaluator, with_options_of
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.tables import AbstractTable, reread, table_in
from brdfcheck.cores import available_cores, side_by_side
from brdfcheck.numerics import unit_vectors
from brdfcheck.quadrature.albedo import paired_lobes
from brdfcheck.quadrature.anisotropy import CLEAN, has_two_sides, turns_with_the_surface
from brdfcheck.quadrature.boxes import Mesh
from brdfcheck.quadrature.frozen import Frozen, worst_channel
from brdfcheck.quadrature.functions import Adaptive, Albedo, adaptive_albedo
from brdfcheck.quadrature.graded import GradedRule
from brdfcheck.quadrature.members import Members, OtherKind
from brdfcheck.quadrature.registry import engine_of
from brdfcheck.quadrature.rule import AbstractEngine
from brdfcheck.quadrature.seen import Seen

Rule = GradedRule | Mesh

TABULATED = 1e-5
"""The accuracy that is asked of the albedo of a table."""
GRAZING = 1e-9
"""The cosine at which functions are integrated for grazing light; what happens in the limit is extrapolated."""

# The rules of the levels, from coarse to fine, for one side of the plane of incidence and for both, so that they fill blocks of
# directions. The first one has a companion of half its size: their difference is its error.
_LEVELS = {
    sides: ((GradedRule(10, 4, 4, 5, 1e-3, sides == 1), GradedRule(7, 3, 3, 3, 1e-3, sides == 1)), *finer)
    for sides, finer in (
        (1, ((GradedRule(22, 8, 9, 10, 1e-4, half=True),), (GradedRule(42, 14, 12, 18, 1e-6, half=True),))),
        (2, ((GradedRule(20, 8, 7, 9, 1e-4),), (GradedRule(39, 14, 12, 18, 1e-6),))),
    )
}
# An albedo below which a difference of the sides is compared with this.
_DARK = 1e-3
# The accuracy of the albedos of which one side is compared with both.
_CONFIRMED = 1e-7
# How many rows of nodes are kept at a time for points of a function of numpy.
_ROWS = 2048
# The accuracy at which engines 1 and 2 are asked on the levels (None: their best).
_QUICK_RTOL = 1e-3


class TwoSided(Exception):
    """A BRDF is seen to differ on the two sides of the plane of incidence, after all."""


class PointwiseAlbedo:
    """Callable: (parameters (points, names), cos_theta (points,), azimuth (points,)) -> value, error, both (points,).

    `engine` is the engine, `engine_name` what reports call it, `table` what a table looks up in (None for anything else).
    `anisotropic` says whether the azimuth matters, `two_sided` that the BRDF was seen to differ on the two sides of the plane
    of incidence. Where it is the same on both, `mirrored` has it taken on one of them: `look_at_sides` sets that, and
    `confirm_sides` looks again. `proved`: somebody has proved that it never exceeds 1. `evaluations` counts those of the BRDF,
    `epsilon` is the rounding of its values. Parameters whose range is one value are held: the BRDF is built with that number.
    Raises Finding where a user's BRDF fails.
    """

    def __init__(self, family: Family):
        self.family = family
        self.names = tuple(family.ranges)
        self.swept = tuple(name for name, (low, high) in family.ranges.items() if low < high)
        self.evaluations = 0
        self.anisotropic = self.two_sided = self.mirrored = self.proved = False
        self.seen = Seen()
        self._held = {name: low for name, (low, high) in family.ranges.items() if low == high}
        self._columns = [self.names.index(name) for name in self.swept]
        self._middle = {name: 0.5 * low + 0.5 * high for name, (low, high) in family.ranges.items()}
        self.evaluator: Evaluator | None = None
        self.table: AbstractTable | None = None
        self.epsilon = float(jnp.finfo(float).eps)
        self.engine: type[AbstractEngine] = Adaptive
        self._members = Members(family)
        if self._members.kind is None:
            self._as_function()
        else:
            self.engine = engine_of(self._members.kind)

    def _as_function(self) -> None:
        """From now on by engine 3."""
        family = self.family
        self.evaluator = Evaluator(self._with_held(family.build), {name: self._middle[name] for name in self.swept})
        self.engine = Adaptive
        self.table = None if self.swept else table_in(self._with_held(family.build)())
        self.epsilon = self.evaluator.epsilon
        self.anisotropic = turns_with_the_surface(self.evaluator, [family.ranges[name] for name in self.swept])

    @property
    def engine_name(self) -> str:
        """The name of the engine; of a function that JAX cannot trace with " (numpy)" or " (one pair at a time)"."""
        how = " (one pair at a time)" if self.one_by_one else " (numpy)" if self.slow else ""
        return f"{self.engine.name}{how}"

    @property
    def slow(self) -> bool:
        """True for a function that JAX cannot trace."""
        return self.evaluator is not None and self.evaluator.slow

    @property
    def one_by_one(self) -> bool:
        """True for a function that is called for each pair of directions: a hundred times as dear as any other."""
        return self.evaluator is not None and self.evaluator.slow and self.evaluator.single

    @property
    def effort(self) -> int:
        """What a point costs, from 0 to 3: that of the engine, and more where numpy evaluates the function."""
        return self.engine.effort + self.slow

    @functools.cached_property
    def reflection(self) -> Evaluator | None:
        """What evaluates the part of the BRDF that owes reciprocity: `evaluator` unless the family says otherwise."""
        if self.family.pointwise is None:
            return self.evaluator
        return Evaluator(self._with_held(self.family.pointwise), {name: self._middle[name] for name in self.swept})

    def _with_held(self, made: Callable[..., Any]) -> Callable[..., Any]:
        """What builds a BRDF of the parameters that run alone."""
        held = self._held

        def build(**swept: Any) -> Any:
            return made(**held, **swept)

        name = getattr(made, "__name__", "<lambda>")
        build.__name__ = self.family.name if name == "<lambda>" else name
        return with_options_of(made, build)

    @property
    def fast(self) -> bool:
        """True where a point costs microseconds (engines 1 and 2) rather than an adaptive integral."""
        return self.evaluator is None

    @property
    def levels(self) -> int:
        """How many levels `estimate` has.

        One where a theorem has the verdict and a point is cheap: a second program to compile takes longer than what it saves.
        """
        if self.evaluator is not None:
            return len(_LEVELS[1])
        return 1 if self.bounded and self.family.surface is None else 1 + self.engine.effort

    @property
    def _kind(self) -> AbstractBRDF | None:
        """What all members of the family are, whatever their numbers."""
        return self._members.kind if self.evaluator is None else None

    @property
    def one_of_many(self) -> bool:
        """True where members are lobes of one kind whose numbers say nothing about the next: JAX cannot trace the factory."""
        return self.evaluator is None and not self._members.traced

    @property
    def monotone(self) -> bool:
        """True for lobes that are largest at normal incidence, by theorem."""
        return self._kind is not None and self._kind.monotone

    @functools.cached_property
    def bounded(self) -> bool:
        """True for BRDFs whose albedo never exceeds 1, by theorem: by their structure, and the numbers that they hold."""
        if self._kind is None or self.one_of_many or not self._kind.bounded:
            return False
        return self.family.build(**self._middle).bounded

    def brdfs(self, parameters: np.ndarray) -> Any:
        """The family's members at `parameters` (points, names) as one BRDF with batched leaves (engines 1 and 2).

        OtherKind where they are of several kinds: from then on they are functions, and `engine` is another one.
        """
        try:
            return self._members(parameters)
        except OtherKind:
            self._as_function()
            raise

    def __call__(
        self, parameters: np.ndarray, cos_theta: np.ndarray, azimuth: np.ndarray, *, rtol: float | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        value, error = self.channels(parameters, cos_theta, azimuth, rtol=rtol)
        return worst_channel(value, error)[:2]

    def channels(
        self, parameters: np.ndarray, cos_theta: np.ndarray, azimuth: np.ndarray, *, rtol: float | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Like a call, channel by channel: (points, channels), or (points,) for a BRDF of one number."""
        if self.evaluator is None:
            with contextlib.suppress(OtherKind):
                return self._engines(parameters, cos_theta, rtol)
        assert self.evaluator is not None
        return self._adaptive(self.evaluator, parameters, cos_theta, azimuth, rtol or self.best)

    @property
    def best(self) -> float:
        """The accuracy that is asked of a function where nothing is said; a table has kinks wherever one looks."""
        return TABULATED if self.table is not None else Adaptive.best

    @functools.cached_property
    def nearest(self) -> PointwiseAlbedo:
        """The albedo of a table by its nearest samples."""
        assert self.table is not None
        return self.reading(self.table.by_nearest())

    def reading(self, table: AbstractTable) -> PointwiseAlbedo:
        """The same with another table in place of this one."""
        family = self.family
        found = PointwiseAlbedo(replace(family, build=lambda **held: reread(family.build(**held), table)))
        found.anisotropic = self.anisotropic
        return found

    def estimate(
        self, parameters: np.ndarray, cos_theta: np.ndarray, azimuth: np.ndarray, level: int, *, both: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """A quick estimate, and for the coarsest level of a function how far it may be off (else 0: compare the levels).

        Shapes as for a call. `level` counts from 0, the coarsest, which looks at `both` sides of the plane of incidence where
        one is taken for both: TwoSided where it is not.
        """
        return worst_channel(*self.estimated_channels(parameters, cos_theta, azimuth, level, both=both))[:2]

    def estimated_channels(
        self, parameters: np.ndarray, cos_theta: np.ndarray, azimuth: np.ndarray, level: int, *, both: bool = False
    ) -> tuple[np.ndarray, np.ndarray]:
        """Like `estimate`, channel by channel: (points, channels), or (points,) for a BRDF of one number."""
        if self.evaluator is None:
            with contextlib.suppress(OtherKind):
                return self._engines(parameters, cos_theta, _QUICK_RTOL if level + 1 < self.levels else None)
        assert self.evaluator is not None
        mu, sides = np.maximum(cos_theta, GRAZING), 1 if self.mirrored and not both else 2
        watched = sides == 2 and level == 0 and not (self.anisotropic or self.two_sided)
        found = self._graded(self.evaluator, parameters, mu, azimuth, *_LEVELS[sides][level], watched=watched)
        if self.mirrored and self.two_sided:
            raise TwoSided
        return found

    def look_at_sides(self) -> None:
        """Take a function on one side of the plane of incidence from now on, unless pairs or an estimate so far differ."""
        if self.evaluator is not None and not self.two_sided:
            ranges = [self.family.ranges[name] for name in self.swept]
            self.two_sided = self.anisotropic or has_two_sides(self.evaluator, ranges)
            self.mirrored = not self.two_sided

    def confirm_sides(self, parameters: np.ndarray, cos_theta: np.ndarray, azimuth: np.ndarray) -> None:
        """TwoSided where albedos of one side, shapes as for a call, are not those of both."""
        if self.evaluator is not None and self.mirrored:
            place = self.evaluator, parameters, cos_theta, azimuth, _CONFIRMED
            (half, bar), (whole, error) = (self._adaptive(*place, half=half) for half in (True, False))
            self.two_sided = bool(np.any(np.abs(whole - half) > error + bar))
            if self.two_sided:
                raise TwoSided

    def _engines(self, parameters: np.ndarray, cos_theta: np.ndarray, rtol: float | None) -> tuple[np.ndarray, np.ndarray]:
        chunk = self.engine.chunk
        padding = (0, -len(cos_theta) % chunk)
        mu = np.pad(cos_theta, padding, mode="edge")
        brdfs = self.brdfs(np.pad(parameters, (padding, (0, 0)), mode="edge"))
        values, errors = [], []
        for start in range(0, len(mu), chunk):
            rows = slice(start, start + chunk)
            part = jax.tree.map(lambda leaf, rows=rows: leaf[rows], brdfs)
            wanted = min(chunk, len(cos_theta) - start)
            value, error, count = paired_lobes(part.core, mu[rows], rtol, wanted)
            self.evaluations += wanted * count
            if part.core is not part:
                with np.errstate(all="ignore"):
                    # In numpy, not in a program: there would be one for each lobe and factor.
                    scale = np.asarray(part.gain(mu[rows]))
                    scale = scale.reshape(scale.shape + (1,) * (value.ndim - 1))
                    value, error = value * scale, error * np.abs(scale)
            values.append(value)
            errors.append(error)
        return np.concatenate(values)[: len(cos_theta)], np.concatenate(errors)[: len(cos_theta)]

    # --- engine 3 ---

    def _graded(
        self,
        evaluator: Evaluator,
        parameters: np.ndarray,
        mu: np.ndarray,
        azimuth: np.ndarray,
        *rules: Rule,
        watched: bool = False,
    ) -> tuple[np.ndarray, np.ndarray]:
        """By a fixed rule, shapes as for `_adaptive`; the difference to a second one is the error.

        `watched`: the first rule is one of both sides of the plane of incidence, which are compared.
        """
        size = sum(rule.size for rule in rules)
        rows = -(-size // BLOCK)
        # Sums by each rule, and the difference of the sides.
        sums_of = len(rules) + watched
        wi = unit_vectors(mu, azimuth)
        value = np.zeros((sums_of, len(mu), evaluator.channels or 1))
        unknown: set[int] = set()

        def piece(points: np.ndarray) -> None:
            # Points of the same cosine share their nodes.
            cosines, which = np.unique(mu[points], return_inverse=True)
            share = np.empty((len(cosines), sums_of, rows * BLOCK))
            space = evaluator.space(len(cosines) * rows)
            wo = space[:, : len(cosines) * rows].reshape(3, len(cosines), -1)
            start = 0
            for number, rule in enumerate(rules):
                end = start + rule.size
                rule.fill(cosines, wo[..., start:end], share[:, number, start:end])
                share[:, number, :start], share[:, number, end:] = 0, 0
                start = end
            if watched:  # the first half of the nodes lies on one side
                half = rules[0].size // 2
                share[:, -1] = share[:, 0]
                share[:, -1, half : 2 * half] *= -1
            wo[..., end:] = wo[..., end - 1 : end]
            sums = evaluator.sums(
                parameters[points][:, self._columns],
                wi[points],
                azimuth[points],
                space,
                np.moveaxis(share.reshape(len(cosines), sums_of, rows, BLOCK), 1, 2),
                which,
                lambda at, *found: unknown.update(
                    points[at[self.seen.note(parameters[points[at]], wi[points[at]], *found)]].tolist()
                ),
            )
            value[:, points] = np.moveaxis(sums.sum(axis=1), 1, 0)

        cores = 1 if evaluator.slow else len(available_cores())
        if evaluator.slow:
            # Called with points of the same parameters together, as far as the nodes of all cosines fit into memory.
            group = np.unique(mu, return_inverse=True)[1] // max(1, _ROWS // rows)
            order = np.lexsort([*parameters.T[::-1], group])
            pieces = np.split(order, np.flatnonzero(np.diff(group[order])) + 1) if len(order) else []
        else:
            order = np.argsort(mu, kind="stable")
            most = max(1, min(TABLE // rows, -(-len(mu) // cores)))
            pieces = [order[i : i + most] for i in range(0, len(mu), most)]
        if not evaluator.traced and len(pieces) > 1:
            piece(pieces.pop(0))
        side_by_side(piece, pieces, most=cores)
        nodes = len(mu) * rows * BLOCK
        self.evaluations += nodes
        self.seen.values += nodes * (evaluator.channels or 1)
        if watched:
            least = max(CLEAN, 64 * self.epsilon) * np.maximum(np.abs(value[0]), _DARK)
            self.two_sided |= bool(np.any(np.abs(value[-1]) > least))
        value[0, list(unknown)] = np.nan
        error = np.abs(value[0] - value[1]) if len(rules) > 1 else np.zeros_like(value[0])
        return (value[0, :, 0], error[:, 0]) if evaluator.channels is None else (value[0], error)

    def frozen(self, parameters: np.ndarray, cos_theta: float, azimuth: float, rtol: float) -> Frozen:
        """The albedo near one place (parameters (names,)) by the rule that the integral there ends with (functions only)."""
        return Frozen(self, parameters, cos_theta, azimuth, rtol)

    def _adaptive(
        self,
        evaluator: Evaluator,
        parameters: np.ndarray,
        cos_theta: np.ndarray,
        azimuth: np.ndarray,
        rtol: float,
        keep: Callable[[float, Mesh], object] = lambda mu, mesh: None,
        half: bool | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """By an adaptive integral for each point: (points, channels), or (points,). `keep` gets the rule each ends with."""
        half = self.mirrored if half is None else half

        def integrated(point: tuple[np.ndarray, float, float]) -> Albedo:
            row, mu, turn = point
            bound = evaluator.bind({name: float(value) for name, value in zip(self.swept, row, strict=True)})
            return adaptive_albedo(bound, mu, turn, rtol, max_evaluations=_budget(rtol), keep=keep, half=half)

        points = list(zip(parameters[:, self._columns], cos_theta, azimuth, strict=True))
        results = side_by_side(integrated, points, most=8 if evaluator.heavy else 1)
        self.evaluations += sum(int(result.evaluations) for result in results)
        return np.array([result.value for result in results]), np.array([result.error for result in results])


def _budget(rtol: float) -> int:
    """Evaluations that one adaptive integral may cost. What jumps never reaches an accuracy; a look-around must end."""
    return 150_000 if rtol >= 1e-6 else 600_000 if rtol >= 5e-8 else 3_000_000
