"""What each rung errs and costs in a scene, and the budget for a tolerance, verified by rendering it.

The reference is the full model: every knob at its dearest rung. A rung is measured by itself, all other knobs at their dearest.
Costs of combinations are products of the rungs' measured costs; what is about to be chosen is timed itself, and is not chosen
where it is no faster than the full model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from brdfcheck.budgets import scenes
from brdfcheck.budgets.choice import REFUSED, Combination, Fault, Search, pooled
from brdfcheck.budgets.knobs import Knob, knobs_of, plan_of, refusal_of
from brdfcheck.budgets.programs import Compiler, Image, Program, timed
from brdfcheck.budgets.scenes import Scene
from brdfcheck.documents import read_document
from brdfcheck.messages import one_line
from brdfcheck.precision import double_precision
from brdfcheck.scene.colour import encode_srgb
from brdfcheck.scene.materials import NotConserving

# Tolerances, over the one that is asked for, whose choices are rendered for the chart.
_AROUND = (0.0, 0.125, 4.0, 16.0, 64.0)
# Seconds that a combination is timed for beside the full model.
_TIMED = 0.5
# Scenes whose measurements are kept.
_KEPT = 8
_kept: list[tuple[Any, Measured]] = []


class BudgetError(ValueError):
    """The chosen combination is not within the tolerance when it is rendered again."""


@dataclass(frozen=True)
class Rung:
    """One rung by itself: its error, its cost over the dearest, median seconds. `refused`: why it is never chosen."""

    name: str
    fault: Fault
    cost: float = 1.0
    seconds: float = 0.0
    work: float = 0.0
    refused: str = ""


@dataclass(frozen=True)
class Row:
    """A knob's chosen rung, and the next dearer rung with a smaller error, None where there is none."""

    knob: Knob
    chosen: Rung
    dearer: Rung | None


@dataclass(frozen=True)
class Budget:
    """The cheapest combination within a tolerance.

    `predicted`: the sum of the errors of its rungs; `error`: that of its picture, or of its worst rung alone if that is larger;
    `verified`: of the picture, rendered once more. Errors of pixels are in units of full scale, after the transfer curve, those
    of energy relative. `seconds` beside `full_seconds`, of the full model: medians of one run. `points`: (cost, error,
    "frontier" or "other") of the combinations that were rendered; `cost`: the chosen one's place among them.
    """

    scene: Scene
    tolerance: Fault
    rows: tuple[Row, ...]
    predicted: Fault
    error: Fault
    verified: Fault
    cost: float
    seconds: float
    full_seconds: float
    noise: float
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
    def saving(self) -> float:
        """How many times faster than the full model the budgeted picture is."""
        return self.full_seconds / self.seconds


@dataclass
class Measured:
    """The rungs of a scene's knobs, and the search over their combinations. Made by `measure`."""

    scene: Scene
    knobs: tuple[Knob, ...]
    ladders: dict[str, tuple[Rung, ...]]
    search: Search
    noise: float
    view: _View

    def choose(self, tolerance: Any = None) -> Budget:
        """The budget for a tolerance of a pixel, as in "0.5/255", by default the scene's; that of the energy is the scene's.

        ValueError for a tolerance that is none; BudgetError where the chosen picture misses it when it is rendered again.
        """
        pixel = self.scene.pixel if tolerance is None else scenes.tolerance_of(tolerance)
        limit = Fault(pixel, self.scene.energy)
        with double_precision():
            combination = self.search.best(limit)
            assert combination is not None, "the full model is within every tolerance"
            for share in _AROUND:  # what other tolerances would have chosen: the frontier about this one
                self.search.best(limit._replace(pixel=min(pixel * share, 1.0)))
            return self._budget(combination, limit)

    def _budget(self, combination: Combination, limit: Fault) -> Budget:
        view, search = self.view, self.search
        program = view.program(combination)
        seconds, full_seconds = view.seconds(program)
        image = program.image()
        verified = view.fault(program, image)
        if not verified.within(limit):
            raise BudgetError(
                f"{self.scene.label}: rendered again, the chosen combination errs {verified.pixel:.3g} where"
                f" {limit.pixel:.3g} is allowed; render on a machine that repeats its results"
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
            search.cost(combination), seconds, full_seconds, self.noise, len(search.order), tuple(points),
            self.ladders, view.reference, image,
        )  # fmt: skip


@dataclass
class _View:
    """Pictures of a scene against its full model."""

    scene: Scene
    knobs: tuple[Knob, ...]
    compiler: Compiler
    full: Program
    reference: Image
    covered: Bool[np.ndarray, "height width"]
    times: dict[Any, tuple[float, float]] = field(default_factory=dict)

    def choice(self, combination: Combination) -> dict[str, str]:
        return {knob.name: knob.rungs[i] for knob, i in zip(self.knobs, combination, strict=True)}

    def program(self, combination: Combination) -> Program:
        return self.compiler.program(plan_of(self.scene, self.choice(combination)))

    def picture(self, combination: Combination) -> Fault:
        try:
            return self.fault(self.program(combination))
        except (ValueError, NotImplementedError):  # rungs that go by themselves and not together
            return REFUSED

    def seconds(self, program: Program) -> tuple[float, float]:
        """Of a program and of the full model, by medians of one run: of the latter's time and of their ratio. Measured once."""
        if program.key not in self.times:
            found = timed([self.full, program], 0, _TIMED)
            self.times[program.key] = found.costs[-1] * found.seconds[0], found.seconds[0]
        return self.times[program.key]

    def allowed(self, combination: Combination) -> bool:
        """Whether it conserves energy, and takes less time than the full model where it is another program."""
        if refusal_of(self.scene, self.choice(combination)):
            return False
        program = self.program(combination)
        if program.key == self.full.key:
            return True
        seconds, full_seconds = self.seconds(program)
        return seconds < full_seconds

    def fault(self, program: Program, image: Image | None = None) -> Fault:
        """The largest error of a pixel after the transfer curve, and the relative error of the sum in linear light."""
        picture = np.asarray(program.image() if image is None else image, float)
        if not np.all(np.isfinite(picture)):
            return REFUSED
        reference = self.reference
        if not self.scene.silhouette:
            both = self.covered & program.covered()
            picture, reference = picture[:, both], reference[:, both]
        if not picture.size:
            return REFUSED
        pixel = float(np.max(np.abs(self._shown(picture) - self._shown(reference))))
        whole = float(np.sum(reference))
        lost = abs(float(np.sum(picture)) - whole)
        return Fault(pixel, lost / whole if whole > 0 else (0.0 if lost == 0 else np.inf))

    def _shown(self, linear: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
        return encode_srgb(linear) if self.scene.transfer == "srgb" else np.clip(linear, 0, 1)


def measure(scene: Any) -> Measured:
    """Render and time each rung of a scene's knobs. `scene`: a path, a document of its keys, or a `scenes.Scene`.

    A scene is measured once in a process, so that its budgets for several tolerances go by the same costs.

    Raises UsageError for a scene that is wrong, ValueError where its lights, materials and camera do not go together.
    """
    with double_precision():
        key: Any = scene
        if isinstance(scene, str | Path):
            document, label = read_document(scene)
            scene, key = scenes.parse_scene(document, label), (label, repr(document))
        elif isinstance(scene, Mapping):
            scene, key = scenes.parse_scene(scene), ("", repr(scene))
        if not isinstance(scene, Scene):
            raise TypeError(f"a scene is a path, a document or a Scene of brdfcheck.budgets; got {type(scene).__name__}")
        for other, measured in _kept:
            if other is key or (isinstance(key, tuple) and other == key):
                return measured
        measured = _measure(scene)
        _kept[: len(_kept) + 1 - _KEPT] = []
        _kept.append((key, measured))
        return measured


def _measure(scene: Scene) -> Measured:
    scene.picture.render((4, 4))  # refuses what does not go together, as a camera inside the object
    knobs, compiler = knobs_of(scene), Compiler(scene)
    ladder_of = {knob.name: knob for knob in knobs}
    dearest = {knob.name: knob.rungs[-1] for knob in knobs}
    base = compiler.program(plan_of(scene, dearest))
    reference = base.image()
    if not np.all(np.isfinite(reference)):
        raise ValueError(f"{scene.label}: the full model is not finite in {int(np.sum(~np.isfinite(reference)))} values")
    view = _View(scene, knobs, compiler, base, reference, base.covered())
    found: dict[tuple[str, int], tuple[Program, Fault]] = {}
    refused: dict[tuple[str, int], str] = {}
    for knob in knobs:
        for i, name in enumerate(knob.rungs):
            try:
                program = compiler.program(plan_of(scene, {**dearest, knob.name: name}))
            except ValueError as error:
                refused[knob.name, i] = one_line(error.reason if isinstance(error, NotConserving) else error)
                continue
            except NotImplementedError:  # as a linear solver in float16
                refused[knob.name, i] = "does not run here"
                continue
            fault = view.fault(program)
            found[knob.name, i] = program, fault
            if fault == REFUSED:
                refused[knob.name, i] = "the picture is not finite"
    # Of lobes in either precision: a stand-in for the power saves more of the time in float64, where a logarithm takes longer.
    keys, plans = list(found), {}
    for knob, i in keys:
        plans[knob, i] = [
            compiler.program(
                plan_of(scene, {**dearest, knob: ladder_of[knob].rungs[i], **({"precision": kind} if kind else {})})
            )
            for kind in (("", "float32") if knob == "lobe" else ("",))
        ]
    programs = [base, *(program for key in keys for program in plans[key])]
    times = timed(programs, 0)
    taken = dict(zip([(*key, which) for key in keys for which in range(len(plans[key]))], range(1, len(programs)), strict=True))
    ladders: dict[str, tuple[Rung, ...]] = {}
    shares: dict[str, list[list[float]]] = {}
    for knob in knobs:
        here = [i for i in range(len(knob.rungs)) if (knob.name, i) in found]
        shares[knob.name] = []
        for which in range(2 if knob.name == "lobe" else 1):
            level = pooled([times.costs[taken[knob.name, i, which]] for i in here], times.noise)
            # The dearest is 1, whatever it is pooled with.
            among = {i: cost / level[-1] for i, cost in zip(here, level, strict=True)}
            shares[knob.name].append([among.get(i, 1.0) for i in range(len(knob.rungs))])
        ladders[knob.name] = tuple(
            Rung(
                name,
                REFUSED if (knob.name, i) in refused else found[knob.name, i][1],
                shares[knob.name][0][i],
                times.seconds[taken[knob.name, i, 0]] if i in here else 0.0,
                found[knob.name, i][0].work - base.work if i in here else 0.0,
                refused.get((knob.name, i), ""),
            )
            for i, name in enumerate(knob.rungs)
        )

    def cost(combination: Combination) -> float:
        column = 0 if view.choice(combination)["precision"] == "float64" else -1
        return float(np.prod([shares[knob.name][column][i] for knob, i in zip(knobs, combination, strict=True)]))

    last = tuple(len(knob.rungs) - 1 for knob in knobs)
    known = {
        (*last[:place], i, *last[place + 1 :]): rung.fault
        for place, knob in enumerate(knobs)
        for i, rung in enumerate(ladders[knob.name])
    }
    search = Search(
        own=[[rung.fault for rung in ladders[knob.name]] for knob in knobs],
        cost=cost,
        work=lambda combination: sum(ladders[k.name][i].work for k, i in zip(knobs, combination, strict=True)),
        picture=view.picture,
        allowed=view.allowed,
        errors=known,
    )
    return Measured(scene, knobs, ladders, search, times.noise, view)


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
