"""What the solvers cost and how wrong they are: speed against accuracy, and growth with the number of patches.

Nothing here knows the answer: the reference is handed in. Times are of warm programs, the fastest repeat.
"""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.optimize import brentq

from brdfcheck.transport.angular import AngularOperator, angular_operator
from brdfcheck.transport.enclosures import Box, Sphere, box
from brdfcheck.transport.paths import trace
from brdfcheck.transport.radiosity import direct, krylov, neumann_series, progressive, solve_directly
from brdfcheck.transport.solution import Solution, problem

_TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
_PATHS = (2**12, 2**14, 2**16, 2**18)
# Seconds of repeats after which something has been timed enough.
_ENOUGH = 0.3
# Seconds of one solve that end a solver's settings.
_LONGEST = 2.0
# How each solver is drawn: colour and marker (those of Okabe & Ito 2008, without the yellow).
SOLVERS: dict[str, tuple[str, str]] = {
    "direct": ("#000000", "X"),
    "krylov": ("#0072B2", "o"),
    "progressive": ("#E69F00", "s"),
    "neumann": ("#009E73", "^"),
    "paths": ("#CC79A7", "D"),
}
LABELS: dict[str, str] = {
    "direct": "direct (LU)",
    "krylov": "conjugate gradients",
    "progressive": "progressive shooting",
    "neumann": "Neumann series",
    "paths": "path tracing",
}


@dataclass(frozen=True)
class Point:
    """One solver with one setting: largest error and largest claimed error by the largest radiosity, seconds, cost, steps."""

    method: str
    setting: float
    error: float
    claimed: float
    seconds: float
    cost: float
    steps: int
    message: str


def work_precision(
    enclosure: Box,
    emission: Any,
    reflectance: float,
    reference: np.ndarray,
    *,
    key: Any,
    settings: int,
    repeats: int,
) -> list[Point]:
    """Every solver through its settings: the first `settings` of them, until one takes longer than `_LONGEST` seconds.

    `reference`: the radiosity of each patch from elsewhere. Paths solve the equation of patches, so that all solve one.
    """
    runs: list[tuple[str, Sequence[float], Callable[[Any], Solution]]] = [
        ("direct", (0.0,), lambda _: direct(enclosure, emission, reflectance)),
        ("krylov", _TOLERANCES, lambda aim: krylov(enclosure, emission, reflectance, tolerance=aim)),
        ("progressive", _TOLERANCES, lambda aim: progressive(enclosure, emission, reflectance, tolerance=aim)),
        ("neumann", _TOLERANCES, lambda aim: neumann_series(enclosure, emission, reflectance, tolerance=aim)),
        ("paths", _PATHS, lambda paths: trace(enclosure, emission, reflectance, key=key, paths=int(paths), equation="patches")),
    ]
    size, found = float(np.max(np.abs(reference))), []
    for method, ladder, solve in runs:
        for setting in ladder[:settings]:
            seconds, solution = timed(lambda solve=solve, setting=setting: solve(setting), repeats)
            error = float(np.max(np.abs(np.asarray(solution.value, float) - reference))) / size
            claimed = float(np.max(np.asarray(solution.error, float))) / size
            found.append(
                Point(method, setting, error, claimed, seconds, float(solution.cost), int(solution.steps), solution.message)
            )
            if seconds > _LONGEST:
                break
    return found


@dataclass(frozen=True)
class Growth:
    """Seconds and memory for one number of patches: form factors made, then each solver; bytes of the direct program.

    `process_bytes`: the most that the whole process has held so far, whatever for; 0 where the system does not tell.
    """

    patches: int
    form_factor_seconds: float
    solver_seconds: dict[str, float]
    matrix_bytes: int
    direct_bytes: int
    process_bytes: int


def growth(
    cells: Sequence[tuple[int, int, int]],
    *,
    size: tuple[float, float, float],
    repeats: int,
) -> list[Growth]:
    """Boxes of more and more patches, the floor emitting: what form factors and deterministic solvers take (tolerance 1e-6).

    `direct_bytes`: what the compiled program of the direct solve holds at once, arguments and result included.
    """
    reflectance, found = 0.7, []
    for counts in cells:
        making, room = timed(lambda counts=counts: box(size, counts), repeats, warm=False)
        light = room.on_wall(4, 1.0)
        runs: dict[str, Callable[[], Solution]] = {
            "direct": lambda room=room, light=light: direct(room, light, reflectance),
            "krylov": lambda room=room, light=light: krylov(room, light, reflectance, tolerance=1e-6),
            "progressive": lambda room=room, light=light: progressive(room, light, reflectance, tolerance=1e-6),
            "neumann": lambda room=room, light=light: neumann_series(room, light, reflectance, tolerance=1e-6),
        }
        seconds = {name: timed(run, repeats)[0] for name, run in runs.items()}
        posed = problem(room, light, reflectance)
        memory = solve_directly.lower(posed).compile().memory_analysis()
        held = memory.argument_size_in_bytes + memory.output_size_in_bytes + memory.temp_size_in_bytes if memory else 0
        found.append(Growth(room.patches, making, seconds, int(room.form_factors.nbytes), int(held), _process_bytes()))
    return found


def _process_bytes() -> int:
    """The largest resident size of this process so far."""
    if sys.platform == "win32":
        return 0
    import resource

    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def timed(run: Callable[[], Any], repeats: int, *, warm: bool = True) -> tuple[float, Any]:
    """(seconds of the fastest repeat, result), after one run that compiles unless not `warm`.

    No more repeats are begun once they took `_ENOUGH` seconds.
    """
    if warm:
        jax.block_until_ready(run())
    best, spent, answer = float("inf"), 0.0, None
    for _ in range(repeats):
        began = time.perf_counter()
        answer = jax.block_until_ready(run())
        seconds = time.perf_counter() - began
        best, spent = min(best, seconds), spent + seconds
        if spent > _ENOUGH:
            break
    return best, answer


@dataclass(frozen=True)
class Level:
    """What one solver says at one reflectance: radiosity of each patch, its largest error, the residual, and the status."""

    method: str
    reflectance: float
    value: tuple[float, ...]
    error: float
    residual: float
    cost: float
    status: str
    message: str


def levels(
    enclosure: Sphere | Box, emission: Any, reflectances: Sequence[float], *, key: Any = None, paths: int = 2**16
) -> list[Level]:
    """All solvers at uniform reflectances, those at and above 1 too; path tracing where there is a `key`."""
    found = []
    for rho in reflectances:
        solutions = [solve(enclosure, emission, rho) for solve in (direct, krylov, progressive, neumann_series)]
        if key is not None:
            solutions.append(trace(enclosure, emission, rho, key=key, paths=paths))
        for one in solutions:
            value, error = tuple(np.asarray(one.value, float).tolist()), float(np.max(np.asarray(one.error)))
            numbers = (float(one.residual), float(one.cost))
            found.append(Level(one.method, float(rho), value, error, *numbers, one.status.name, one.message))
    return found


@dataclass(frozen=True)
class Walls:
    """Mean radiosity of a cube's walls where the floor glows: the floor, the ceiling, the sides. Errors where known, else 0."""

    patches: int
    glowing: float
    opposite: float
    sides: float
    errors: tuple[float, float, float] = (0.0, 0.0, 0.0)


def refinement(cells: Sequence[int], reflectance: float, *, key: Any, paths: int) -> tuple[list[Walls], Walls]:
    """A cube whose floor emits 1, by k x k patches a wall for each k, and without patches by path tracing."""

    def walls(values: Any) -> tuple[float, float, float]:
        means = np.asarray(values, float).reshape(6, -1).mean(axis=1)
        return float(means[4]), float(means[5]), float(np.mean(means[:4]))

    found = []
    for count in cells:
        cube = box(cells=count)
        found.append(Walls(cube.patches, *walls(krylov(cube, cube.on_wall(4, 1.0), reflectance).value)))
    cube = box()
    light = trace(cube, cube.on_wall(4, 1.0), reflectance, key=key, paths=paths)
    return found, Walls(0, *walls(light.value), errors=walls(light.error))


@dataclass(frozen=True)
class Radii:
    """A family inside a sphere at rising parameters: largest albedo and spectral radius, and where the latter crosses 1."""

    parameters: tuple[float, ...]
    largest: tuple[float, ...]
    radii: tuple[float, ...]
    crossings: tuple[float, ...]


def radii(family: Callable[[float], Any], parameters: Sequence[float], **nodes: int) -> Radii:
    """The radius of the angular operator of ``family(parameter)``; crossings of 1 between neighbours to 1e-4.

    The largest albedo is that over the operator's nodes. `nodes`: what `angular_operator` takes.
    """

    def operator(parameter: float) -> AngularOperator:
        return angular_operator(family(float(parameter)), **nodes)

    def excess(parameter: float) -> float:
        return float(operator(parameter).spectral_radius().value) - 1

    operators = [operator(parameter) for parameter in parameters]
    found = [float(part.spectral_radius().value) - 1 for part in operators]
    largest = tuple(float(jnp.max(part.albedo())) for part in operators)
    pairs = zip(itertools.pairwise(parameters), itertools.pairwise(found), strict=True)
    between = [ends for ends, (low, high) in pairs if low * high < 0]
    crossings: list[Any] = [brentq(excess, *map(float, ends), xtol=1e-4) for ends in between]
    return Radii(tuple(map(float, parameters)), largest, tuple(1 + value for value in found), tuple(crossings))
