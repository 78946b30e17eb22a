"""What the solvers cost and how wrong they are: speed against accuracy, and growth with the number of patches.

Nothing here knows the answer: the reference is handed in. Times are of warm programs, the fastest repeat.
"""

from __future__ import annotations

import itertools
import sys
import time
from collections.abc import Callable, Sequence
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
# How each solver is drawn: label, colour and marker (those of Okabe & Ito 2008, without the yellow).
SOLVERS: dict[str, tuple[str, str, str]] = {
    "direct": ("direct (LU)", "#000000", "X"),
    "krylov": ("conjugate gradients", "#0072B2", "o"),
    "progressive": ("progressive shooting", "#E69F00", "s"),
    "neumann": ("Neumann series", "#009E73", "^"),
    "paths": ("path tracing", "#CC79A7", "D"),
}


def work_precision(
    enclosure: Box,
    emission: Any,
    reflectance: float,
    reference: np.ndarray,
    *,
    key: Any,
    settings: int,
    repeats: int,
) -> list[dict[str, Any]]:
    """Every solver through its settings: the first `settings` of them, until one takes longer than `_LONGEST` seconds.

    `reference`: the radiosity of each patch from elsewhere. Paths solve the equation of patches, so that all solve one.
    ``error``, and the ``claimed`` one: the largest, by the largest radiosity.
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
            found.append({
                "method": method, "setting": setting, "error": error, "claimed": claimed, "seconds": seconds,
                "cost": float(solution.cost), "steps": int(solution.steps), "message": solution.message,
            })  # fmt: skip
            if seconds > _LONGEST:
                break
    return found


def growth(
    cells: Sequence[tuple[int, int, int]],
    *,
    size: tuple[float, float, float],
    repeats: int,
) -> list[dict[str, Any]]:
    """Boxes of more and more patches, the floor emitting: what form factors and deterministic solvers take (tolerance 1e-6).

    ``direct_bytes``: what the compiled program of the direct solve holds at once, arguments and result included.
    ``process_bytes``: the most that the whole process has held so far, whatever for; 0 where the system does not tell.
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
        found.append({
            "patches": room.patches, "form_factor_seconds": making, "solver_seconds": seconds,
            "matrix_bytes": int(room.form_factors.nbytes), "direct_bytes": int(held), "process_bytes": _process_bytes(),
        })  # fmt: skip
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


def levels(
    enclosure: Sphere | Box, emission: Any, reflectances: Sequence[float], *, key: Any = None, paths: int = 2**16
) -> list[dict[str, Any]]:
    """All solvers at uniform reflectances, those at and above 1 too; path tracing where there is a `key`.

    ``value``: the radiosity of each patch; ``error``: the largest.
    """
    found = []
    for rho in reflectances:
        solutions = [solve(enclosure, emission, rho) for solve in (direct, krylov, progressive, neumann_series)]
        if key is not None:
            solutions.append(trace(enclosure, emission, rho, key=key, paths=paths))
        for one in solutions:
            found.append({
                "method": one.method, "reflectance": float(rho), "value": np.asarray(one.value, float).tolist(),
                "error": float(np.max(np.asarray(one.error))), "residual": float(one.residual), "cost": float(one.cost),
                "status": one.status.name, "message": one.message,
            })  # fmt: skip
    return found


def refinement(
    cells: Sequence[int], reflectance: float, *, key: Any, paths: int
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """A cube whose floor emits 1, by k x k patches a wall for each k, and without patches by path tracing.

    The mean radiosity of its walls, the ``sides`` together; ``errors`` in the same order: where they are known, else 0.
    """

    def means(values: Any) -> list[float]:
        walls = np.asarray(values, float).reshape(6, -1).mean(axis=1)
        return [float(walls[4]), float(walls[5]), float(np.mean(walls[:4]))]

    def told(patches: int, values: Any, errors: Any) -> dict[str, Any]:
        walls = dict(zip(("glowing", "opposite", "sides"), means(values), strict=True))
        return {"patches": patches, **walls, "errors": means(errors)}

    found = []
    for count in cells:
        cube = box(cells=count)
        found.append(told(cube.patches, krylov(cube, cube.on_wall(4, 1.0), reflectance).value, np.zeros(6)))
    cube = box()
    light = trace(cube, cube.on_wall(4, 1.0), reflectance, key=key, paths=paths)
    return found, told(0, light.value, light.error)


def radii(family: Callable[[float], Any], parameters: Sequence[float], **nodes: int) -> dict[str, list[float]]:
    """The radius of the angular operator of ``family(parameter)``; crossings of 1 between neighbours to 1e-4.

    ``largest``: the largest albedo over the operator's nodes. `nodes`: what `angular_operator` takes.
    """

    def operator(parameter: float) -> AngularOperator:
        return angular_operator(family(float(parameter)), **nodes)

    def excess(parameter: float) -> float:
        return float(operator(parameter).spectral_radius().value) - 1

    operators = [operator(parameter) for parameter in parameters]
    found = [float(part.spectral_radius().value) - 1 for part in operators]
    pairs = zip(itertools.pairwise(parameters), itertools.pairwise(found), strict=True)
    between = [ends for ends, (low, high) in pairs if low * high < 0]
    crossings: list[Any] = [brentq(excess, *map(float, ends), xtol=1e-4) for ends in between]
    return {
        "parameters": list(map(float, parameters)),
        "largest": [float(jnp.max(part.albedo())) for part in operators],
        "radii": [1 + value for value in found],
        "crossings": crossings,
    }
