"""What each rung errs and costs in a scene, and the budget for a tolerance, verified by rendering it.

The reference is the full model: every knob at its dearest rung. Errors are those of pictures. Costs are the work of programs
(`brdfcheck.operations`), as shares of the full model's: the same in every process, so that the choice is, and stays monotone
in the tolerance. Time is measured of the choice alone, beside the full model: it says what is really saved, and a combination
that takes longer against the model's word is not chosen.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from brdfcheck.budgets import scenes
from brdfcheck.budgets.knobs import Knob, knobs_of, plan_of, refusal_of
from brdfcheck.budgets.programs import Compiler, Image, Picture, Program
from brdfcheck.budgets.scenes import Scene
from brdfcheck.budgets.search import REFUSED, Combination, Fault, Search
from brdfcheck.documents import read_document
from brdfcheck.messages import one_line
from brdfcheck.runtime import double_precision
from brdfcheck.scene.materials import NotConserving
from brdfcheck.scene.smooth import refuse_behind
from brdfcheck.scene.sphere import refuse_inside

Watch = Callable[[str], None]
"""Called with the name of what is rendered next."""


# Tolerances, over the one that is asked for, for which the cheapest pictures are made, for the chart.
_AROUND = (0.0, 0.125, 4.0, 16.0, 64.0)
# A combination is refused where three of four rounds took so much longer than the full model's. A busy machine does not do that
# to two programs in turns, only a model of work that is wrong for this machine.
_SLOWER = 1.25
# Seconds for which a program is timed beside another, about, and the fewest and most rounds.
_LONGEST, _FEWEST, _MOST = 1.0, 9, 101
# The knobs that each part of the work depends on.
_DEPENDS = {
    "seeing": ("facets", "shading", "window", "precision"),
    "shading": ("lobe", "fresnel", "metal", "light", "lights", "surrounding", "grid", "precision"),
    "grid": ("lobe", "fresnel", "metal", "light", "lights", "surrounding", "grid", "precision"),
    "room": ("bounces", "cells", "precision"),
}  # fmt: skip
# Scenes whose measurements are kept.
_KEPT = 8
_kept: dict[Any, Measured] = {}


class BudgetError(ValueError):
    """The chosen combination is not within the tolerance when it is rendered again."""


@dataclass(frozen=True)
class Rung:
    """One rung by itself: its error, its work over the full model's. `refused`: why it is never chosen."""

    name: str
    fault: Fault
    cost: float = 1.0
    refused: str = ""


@dataclass(frozen=True)
class Row:
    """A knob's chosen rung, and the next dearer rung with a smaller error, None where there is none."""

    knob: Knob
    chosen: Rung
    dearer: Rung | None


@dataclass(frozen=True)
class Budget:
    """The cheapest combination within the `tolerance` of a `scene`: a row for each knob, in `rows`.

    `predicted`: the sum of the errors of its rungs; `error`: that of its picture, or of its worst rung alone if that is larger;
    `verified`: of the picture, rendered once more. Errors of pixels are in units of full scale, after the transfer curve, those
    of energy relative. `cost`: its work over the full model's. `full_seconds`: of the full model, the median of one run in
    which both were rendered in turns; `ratios`: quartiles of the time over the full model's in the same round. `points`: (cost,
    error, "frontier" or "other") of the `combinations` that were rendered. `ladders`: the rungs of each knob, from cheap to
    dear; `image` and `reference`: the pictures (3, height, width) of the combination and of the full model, in linear light.
    """

    scene: Scene
    tolerance: Fault
    rows: tuple[Row, ...]
    predicted: Fault
    error: Fault
    verified: Fault
    cost: float
    full_seconds: float
    ratios: tuple[float, float, float]
    combinations: int
    points: tuple[tuple[float, float, str], ...]
    ladders: Mapping[str, tuple[Rung, ...]]
    reference: Image = field(repr=False)
    image: Image = field(repr=False)

    @property
    def chosen(self) -> dict[str, str]:
        """The rung of each knob, by name."""
        return {row.knob.name: row.chosen.name for row in self.rows}

    @property
    def seconds(self) -> float:
        """Of the budgeted picture: the full model's by the median of their ratio."""
        return self.full_seconds * self.ratios[1]

    @property
    def saving(self) -> float:
        """How many times faster than the full model the budgeted picture was, by the median of the rounds."""
        return 1 / self.ratios[1]


@dataclass
class Measured:
    """The rungs of a scene's knobs, and the search over their combinations. Made by `measure`.

    Pictures are held against those of the full model: `reference` is made as those of combinations are, `whole` by the `full`
    model's program. `watch`: called with the name of what is rendered next.
    """

    scene: Scene
    knobs: tuple[Knob, ...]
    compiler: Compiler
    full: Program
    reference: Picture
    whole: Image
    ladders: dict[str, tuple[Rung, ...]] = field(init=False)
    search: Search = field(init=False)
    watch: Watch = lambda name: None
    times: dict[Any, Beside] = field(default_factory=dict)
    works: dict[Any, Any] = field(default_factory=dict)

    def choose(self, tolerance: Any = None, watch: Watch = lambda name: None) -> Budget:
        """The budget for a tolerance of a pixel, as in "0.5/255", by default the scene's; that of the energy is the scene's.

        `watch`: called before each combination of rungs is rendered.

        ValueError for a tolerance that is none; BudgetError where the chosen picture misses it when it is rendered again.
        """
        pixel = self.scene.pixel if tolerance is None else scenes.tolerance_of(tolerance)
        limit = Fault(pixel, self.scene.energy)
        self.watch = watch
        with double_precision():
            combination = self.search.best(limit)
            assert combination is not None, "the full model is within every tolerance"
            for share in _AROUND:  # what other tolerances would have chosen: the frontier about this one
                next(self.search.within(limit._replace(pixel=min(pixel * share, 1.0))))
            return self._budget(combination, limit)

    def _budget(self, combination: Combination, limit: Fault) -> Budget:
        search, program = self.search, self.program(combination)
        time, image = self.time(program), program.image()
        verified = self.verified(combination, image)
        if not verified.within(limit):
            raise BudgetError(
                f"{self.scene.label}: rendered again, the chosen combination errs {verified.pixel:.3g} (energy"
                f" {verified.energy:.3g}) where {limit.pixel:.3g} (energy {limit.energy:.3g}) is allowed; render on a machine"
                " that repeats its results"
            )
        rows = []
        for knob, i in zip(self.knobs, combination, strict=True):
            ladder = self.ladders[knob.name]
            better = [rung for rung in ladder if rung.fault.pixel < ladder[i].fault.pixel and rung.cost >= ladder[i].cost]
            rows.append(Row(knob, ladder[i], min(better, key=lambda rung: (rung.cost, rung.fault.pixel), default=None)))
        frontier = set(search.frontier())
        points = sorted(
            (
                (search.cost(one), fault.pixel, "frontier" if one in frontier else "other")
                for one, fault in search.errors.items()
                if np.isfinite(fault.pixel)
            ),
            key=lambda point: (point[0], -point[1]),
        )
        return Budget(
            self.scene, limit, tuple(rows), search.predicted(combination), search.error(combination), verified,
            search.cost(combination), time.seconds, time.quartiles, len(search.order), tuple(points),
            self.ladders, self.whole, image,
        )  # fmt: skip

    def choice(self, combination: Combination) -> dict[str, str]:
        """The rung of each knob, by name."""
        return {knob.name: knob.rungs[i] for knob, i in zip(self.knobs, combination, strict=True)}

    def program(self, combination: Combination) -> Program:
        """Its program, compiled."""
        return self.compiler.program(plan_of(self.scene, self.choice(combination)))

    def picture(self, combination: Combination) -> Fault:
        """The error of its picture; refused where rungs that go by themselves do not go together."""
        self.watch(", ".join(self.choice(combination).values()))
        try:
            return self.fault(self.compiler.picture(plan_of(self.scene, self.choice(combination))))
        except (ValueError, NotImplementedError):
            return REFUSED

    def work(self, combination: Combination) -> float:
        """The work of its program; inf where rungs that go by themselves do not go together."""
        choice, dearest = self.choice(combination), _dearest(self.knobs)

        def part(name: str) -> Any:
            turned = {knob: choice[knob] for knob in _DEPENDS[name] if knob in choice}
            key = (name, *turned.items())
            if key not in self.works:
                try:
                    self.works[key] = getattr(self.compiler, name)(plan_of(self.scene, {**dearest, **turned}))
                except (ValueError, NotImplementedError):
                    self.works[key] = (np.inf, 0) if name == "seeing" else np.inf
            return self.works[key]

        seen, points = part("seeing")
        return float(seen + points * part("shading") + part("grid") + part("room"))

    def time(self, program: Program) -> Beside:
        """Beside the full model. Measured once, so that what is said of a combination does not change."""
        if program.key not in self.times:
            self.times[program.key] = beside(program, self.full)
        return self.times[program.key]

    def final(self, combination: Combination) -> Fault:
        """The error of its program; refused where it does not conserve energy, or clearly takes longer than the full model."""
        if refusal_of(self.scene, self.choice(combination)):
            return REFUSED
        program = self.program(combination)
        slower = program.key != self.full.key and self.time(program).quartiles[0] >= _SLOWER
        return REFUSED if slower else self.verified(combination, program.image())

    def verified(self, combination: Combination, image: Image) -> Fault:
        """The error of an image that its program made, against that of the full model's program."""
        seen = self.compiler.picture(plan_of(self.scene, self.choice(combination)))
        return self.fault(seen._replace(image=image), self.whole)

    def fault(self, shown: Picture, reference: Image | None = None) -> Fault:
        """The largest error of a pixel after the transfer curve, and the relative error of the sum in linear light."""
        picture, reference = np.asarray(shown.image, float), self.reference.image if reference is None else reference
        if not np.all(np.isfinite(picture)):
            return REFUSED
        if not self.scene.silhouette:
            both = self.reference.covered & shown.covered
            picture, reference = picture[:, both], reference[:, both]
        if not picture.size:
            return REFUSED
        pixel = float(np.max(np.abs(self.scene.shown(picture) - self.scene.shown(reference))))
        whole = float(np.sum(reference))
        lost = abs(float(np.sum(picture)) - whole)
        return Fault(pixel, lost / whole if whole > 0 else (0.0 if lost == 0 else np.inf))


@dataclass(frozen=True)
class Beside:
    """A program timed beside another: the other's seconds (median), and the quartiles of the ratio of their times."""

    seconds: float
    quartiles: tuple[float, float, float]


def beside(program: Program, full: Program) -> Beside:
    """Time a program beside the full model's, in turns, now one first and now the other, for about a second.

    A ratio is that of two times a moment apart: what else the machine does falls upon both alike.
    """
    pair = (program, full)
    pace = sum(sum(one.seconds() for one in pair) for _ in range(2)) / 2
    rounds = int(np.clip(_LONGEST / pace, _FEWEST, _MOST))
    table = np.empty((rounds, 2))
    for r in range(rounds):
        for place in (0, 1) if r % 2 else (1, 0):
            table[r, place] = pair[place].seconds()
    low, middle, high = np.quantile(table[:, 0] / table[:, 1], (0.25, 0.5, 0.75))
    return Beside(float(np.median(table[:, 1])), (float(low), float(middle), float(high)))


def measure(scene: Any, watch: Watch = lambda name: None) -> Measured:
    """Render each rung of a scene's knobs and count its work. `scene`: a path, a document of its keys, or a `scenes.Scene`.

    `watch`: called before each rung is rendered. A scene is measured once in a process, so that its budgets for several
    tolerances share pictures.

    Raises UsageError for a scene that is wrong, ValueError where its lights, materials and camera do not go together.
    """
    with double_precision():
        key: Any = scene
        if isinstance(scene, str | Path):
            document, label = read_document(scene)
            scene, key = scenes.parse_scene(document, label, folder=Path(scene).parent), (label, repr(document))
        elif isinstance(scene, Mapping):
            scene, key = scenes.parse_scene(scene), ("", repr(scene))
        if not isinstance(scene, Scene):
            raise TypeError(f"a scene is a path, a document or a Scene of brdfcheck.budgets; got {type(scene).__name__}")
        key = scene if scene.picture.named_files else key
        if key not in _kept:
            _kept[key] = _measure(scene, watch)
            if len(_kept) > _KEPT:
                del _kept[next(iter(_kept))]  # the oldest
        return _kept[key]


def full_model(scene: Scene, size: tuple[int, int] | None = None) -> Image:
    """The picture (3, height, width) in linear light that all others are compared with, at `size` or the scene's own.

    ValueError where lights, materials and camera do not go together.
    """
    if size is not None:
        scene = replace(scene, picture=replace(scene.picture, size=size))
    with double_precision():
        return _full(scene, Compiler(scene), knobs_of(scene)).image()


def _full(scene: Scene, compiler: Compiler, knobs: tuple[Knob, ...]) -> Program:
    """Every knob at its dearest rung. ValueError where lights, materials and camera do not go together."""
    picture = scene.picture
    if picture.mesh is not None:
        refuse_behind(picture.mesh, picture.camera)
    else:
        refuse_inside(picture.camera.eye, picture.center, picture.radius, "the sphere")
    return compiler.program(plan_of(scene, _dearest(knobs)))


def _dearest(knobs: tuple[Knob, ...]) -> dict[str, str]:
    return {knob.name: knob.rungs[-1] for knob in knobs}


def _measure(scene: Scene, watch: Watch) -> Measured:
    knobs, compiler = knobs_of(scene), Compiler(scene)
    dearest, base = _dearest(knobs), _full(scene, compiler, knobs)
    whole = base.image()
    if not np.all(np.isfinite(whole)):
        raise ValueError(f"{scene.label}: the full model is not finite in {int(np.sum(~np.isfinite(whole)))} values")
    measured = Measured(scene, knobs, compiler, base, compiler.picture(plan_of(scene, dearest)), whole)

    def tried(choice: dict[str, str]) -> tuple[Fault, str]:
        """The error of a rung alone, and why it is refused."""
        watch(", ".join(choice.values()))
        try:
            picture = compiler.picture(plan_of(scene, {**dearest, **choice}))
        except ValueError as error:
            return REFUSED, one_line(error.reason if isinstance(error, NotConserving) else error)
        except NotImplementedError:  # as a linear solver in float16
            return REFUSED, "does not run here"
        fault = measured.fault(picture)
        return fault, "the picture is not finite" if fault == REFUSED else ""

    found = [[tried({knob.name: name}) for name in knob.rungs] for knob in knobs]
    own = [[fault for fault, _ in ladder] for ladder in found]
    last = tuple(len(ladder) - 1 for ladder in own)
    work = measured.work(last)

    def alone(place: int, i: int) -> Combination:
        return (*last[:place], i, *last[place + 1 :])

    def cost(combination: Combination) -> float:
        refused = any(own[place][i] == REFUSED for place, i in enumerate(combination))
        return np.inf if refused else measured.work(combination) / work

    measured.ladders = {
        knob.name: tuple(
            Rung(name, fault, 1.0 if why else cost(alone(place, i)), why)
            for i, (name, (fault, why)) in enumerate(zip(knob.rungs, found[place], strict=True))
        )
        for place, knob in enumerate(knobs)
    }
    known = {alone(place, i): fault for place, ladder in enumerate(own) for i, fault in enumerate(ladder)}
    measured.search = Search(own, cost, measured.picture, measured.final, known)
    return measured


def budget(scene: Any, tolerance: Any = None) -> Budget:
    """The cheapest combination of models whose picture of the scene is within `tolerance` of the full one.

    `scene`: a path of a TOML file, a document with its keys, or a `brdfcheck.budgets.scenes.Scene`. `tolerance`: of a pixel, a
    number in units of full scale or a text, "0.5/255"; by default the scene's own. Computed in float64 whatever the process
    runs in. Nothing that `brdfcheck.check` does not call conserving is chosen, nor what takes longer than the full model.

    Raises UsageError for a scene that is wrong, ValueError for a tolerance that is none, and BudgetError, a ValueError, where
    the chosen picture misses it when it is rendered again.
    """
    if tolerance is not None:
        scenes.tolerance_of(tolerance)
    return measure(scene).choose(tolerance)
