"""What the solvers cost and how wrong they are: speed against accuracy, and growth with the number of patches.

Nothing here knows the answer: the reference is handed in. Times are of warm programs, the fastest repeat.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import numpy as np

from brdfcheck.transport.enclosures import AbstractEnclosure, Box, Sphere, box
from brdfcheck.transport.neumann import neumann_series
from brdfcheck.transport.paths import trace
from brdfcheck.transport.radiosity import checked_steps, direct, krylov, progressive, solve_directly
from brdfcheck.transport.solution import Solution, problem

_TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
_PATHS = (2**12, 2**14, 2**16, 2**18, 2**20)
METHODS = ("direct", "krylov", "progressive", "neumann", "paths")


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
    enclosure: AbstractEnclosure,
    emission: Any,
    reflectance: Any,
    reference: Any,
    *,
    key: Any,
    settings: int = 8,
    most_seconds: float = 2.0,
    repeats: int = 3,
) -> list[Point]:
    """Every solver through its settings: the first `settings` of them, until one takes longer than `most_seconds`.

    `reference`: the radiosity of each patch from elsewhere. Paths solve the equation of patches, so that all solve one. Raises
    ValueError for bad values, counts, or a reference of another shape.
    """
    truth = np.asarray(reference, float)
    if truth.shape != enclosure.areas.shape or not np.all(np.isfinite(truth)):
        raise ValueError(
            f"reference must be finite, one for each of the {enclosure.patches} patches; got the shape {truth.shape}"
        )
    settings, repeats = checked_steps(settings, "settings"), checked_steps(repeats, "repeats")
    runs: list[tuple[str, Sequence[float], Callable[[Any], Solution]]] = [
        ("direct", (0.0,), lambda _: direct(enclosure, emission, reflectance)),
        ("krylov", _TOLERANCES, lambda aim: krylov(enclosure, emission, reflectance, tolerance=aim)),
        ("progressive", _TOLERANCES, lambda aim: progressive(enclosure, emission, reflectance, tolerance=aim)),
        ("neumann", _TOLERANCES, lambda aim: neumann_series(enclosure, emission, reflectance, tolerance=aim)),
    ]
    if isinstance(enclosure, (Sphere, Box)):
        walk = enclosure  # for the type checker: a closure would forget
        runs.append(
            ("paths", _PATHS, lambda paths: trace(walk, emission, reflectance, key=key, paths=int(paths), equation="patches"))
        )
    size, found = float(np.max(np.abs(truth))), []
    for method, ladder, solve in runs:
        for setting in ladder[:settings]:
            seconds, solution = timed(lambda solve=solve, setting=setting: solve(setting), repeats)
            error = float(np.max(np.abs(np.asarray(solution.value, float) - truth))) / size
            claimed = float(np.max(np.asarray(solution.error, float))) / size
            found.append(
                Point(method, setting, error, claimed, seconds, float(solution.cost), int(solution.steps), solution.message)
            )
            if seconds > most_seconds:
                break
    return found


@dataclass(frozen=True)
class Growth:
    """Seconds and memory for one number of patches: form factors made, then each solver; bytes of the direct program."""

    patches: int
    form_factor_seconds: float
    solver_seconds: dict[str, float]
    matrix_bytes: int
    direct_bytes: int


def growth(
    cells: Sequence[tuple[int, int, int]],
    *,
    size: tuple[float, float, float] = (1.0, 1.0, 0.5),
    reflectance: float = 0.7,
    dtype: Any = None,
    repeats: int = 2,
) -> list[Growth]:
    """Boxes of more and more patches, the floor emitting: what form factors and deterministic solvers take (tolerance 1e-6).

    `direct_bytes`: what the compiled program of the direct solve holds at once, arguments and result included.
    ValueError for bad cells, sizes or reflectances.
    """
    found = []
    for counts in cells:
        making, room = timed(lambda counts=counts: box(size, counts, dtype=dtype), repeats, warm=False)
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
        found.append(Growth(room.patches, making, seconds, int(room.form_factors.nbytes), int(held)))
    return found


def timed(run: Callable[[], Any], repeats: int, *, warm: bool = True) -> tuple[float, Any]:
    """(seconds of the fastest repeat, result), after one run that compiles unless not `warm`."""
    if warm:
        jax.block_until_ready(run())
    best, answer = float("inf"), None
    for _ in range(repeats):
        began = time.perf_counter()
        answer = jax.block_until_ready(run())
        best = min(best, time.perf_counter() - began)
    return best, answer
