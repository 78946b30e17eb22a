"""Radiosity and Neumann: all solvers on all problems with known answers, and what they say where there is none."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from brdfcheck import transport
from brdfcheck.transport import Status, radiosity
from brdfcheck.transport.solution import standing

SOLVERS = {
    "direct": transport.direct,
    "krylov": transport.krylov,
    "progressive": transport.progressive,
    "neumann": transport.neumann_series,
}
RHO = (0.5, 0.9, 0.99)


def spotted_sphere(reflectances=None):
    """The integrating sphere with a spot of light; the closed form is rank one, whatever the reflectances."""
    room = transport.sphere(6, 4)
    emission = np.zeros(24)
    emission[0], emission[7] = 1.0, 0.3
    rho = np.full(24, 0.9) if reflectances is None else reflectances
    evenly = np.mean(emission) / (1 - np.mean(rho))
    return room, emission, rho, emission + rho * evenly


def problems():
    """name -> (enclosure, emission, reflectance, radiosity). Of 24 patches, so that one program serves all."""
    found = {}
    for rho in RHO:
        room, emission, _, _ = spotted_sphere()
        found[f"integrating sphere {rho}"] = (room, emission, rho, emission + rho * np.mean(emission) / (1 - rho))
        for name, shell in (
            ("box", transport.box((1.0, 2.0, 0.5), 2)),
            ("cylinder", transport.cylinder(1.0, 0.3, rings=5, bands=14)),
        ):
            found[f"furnace in a {name} {rho}"] = (shell, 0.2, rho, np.full(shell.patches, 0.2 / (1 - rho)))
    # Patches that reflect nothing, and some above 1, as long as the whole stays below.
    mixed = np.tile([0.0, 1.2, 0.8, 1.0, 0.3, 0.9], 4)
    found["sphere of many reflectances"] = spotted_sphere(mixed)
    cube = transport.box()
    facts = np.array([0.40938030] * 4 + [1.28654972, 0.40926241])
    found["cube of the facts"] = (cube, cube.on_wall(4, 1.0), 0.7, facts)
    # Any radiosity is the answer to some emission.
    room = transport.box((1.0, 1.0, 0.5), 2)
    generator = np.random.default_rng(5)
    wanted, rho = 1 + generator.random(room.patches), 0.4 + 0.2 * generator.random(room.patches)
    found["manufactured"] = (room, wanted - rho * (np.asarray(room.form_factors) @ wanted), rho, wanted)
    return found


PROBLEMS = problems()


# Of 6 patches, and so a program of its own for each solver.
CUBE = "cube of the facts"
EACH = [(solver, name) for solver in SOLVERS for name in PROBLEMS]


@pytest.mark.parametrize(
    ("solver", "name"),
    [pytest.param(*one, marks=[pytest.mark.slow] if one[1] == CUBE and one[0] != "direct" else []) for one in EACH],
)
def test_every_solver_on_every_problem(solver, name):
    room, emission, reflectance, exact = PROBLEMS[name]
    solution = SOLVERS[solver](room, emission, reflectance)
    digits = 5e-9 if "facts" in name else 1e-13 * np.max(exact)
    assert solution.status is Status.SOLVED, solution.message
    assert solution.ok
    assert solution.value.shape == solution.error.shape == exact.shape
    off = np.abs(np.asarray(solution.value) - exact)
    assert (
        np.max(off) < {"direct": 1e-12, "krylov": 1e-8, "progressive": 2e-6, "neumann": 1e-9}[solver] * np.max(exact) + digits
    )
    # Honest: within the error, which is not much larger than it need be.
    assert np.all(off <= np.asarray(solution.error) + digits)
    assert np.max(solution.error) < 1e-4 * np.max(exact)
    assert solution.cost > 0
    assert solution.steps > 0
    assert solution.residual < 1e-6


def test_furnace_next_to_one():
    room = transport.cylinder(1.0, 2.0, rings=5, bands=14)
    solution = transport.direct(room, 1e-6, 1 - 1e-6)
    assert np.max(np.abs(solution.value - 1)) < np.max(solution.error) < 1e-4
    assert solution.ok


# --- at 1 and above ---


@pytest.mark.parametrize("rho", [1.0, 1.01])
def test_no_sum_at_one_and_above(rho):
    cube = transport.box()
    light = cube.on_wall(4, 1.0)
    for refusing in (transport.neumann_series, transport.progressive):
        solution = refusing(cube, light, rho)
        assert solution.status is Status.DIVERGES
        assert not solution.ok
        assert np.all(np.isnan(solution.value))
        assert np.all(np.isinf(solution.error))
        assert solution.message.startswith(f"spectral radius {rho:g} to {rho:g}: no sum is reported")
        assert "brdfcheck check" in solution.message
    solution = transport.direct(cube, light, rho)
    assert solution.status is Status.MEANINGLESS
    assert "this finite answer means nothing" in solution.message
    assert np.all(np.isfinite(solution.value))
    assert np.all(solution.value < 0)
    assert np.all(np.isinf(solution.error))
    if rho > 1:  # it does solve the system
        assert solution.residual < 1e-13


@pytest.mark.parametrize("rho", [1.0, 1.01, 1.3])
def test_no_finite_answer_at_one_is_explained_by_the_radius(rho):
    cube = transport.box()
    # In the furnace conjugate gradients find nothing to reduce at 1: the answer is not even finite.
    for light in (1.0, cube.on_wall(4, 1.0)):
        for solver in (transport.krylov, transport.direct):
            solution = solver(cube, light, rho)
            assert solution.status is Status.MEANINGLESS
            assert solution.message.startswith(f"spectral radius {rho:g} to {rho:g}: ")
            assert np.all(np.isinf(solution.error))


def test_a_radius_next_to_one_is_undecided():
    # A wall that takes a little, one that gives a little, and an iteration that is stopped before it knows.
    room = transport.cylinder(1.0, 8.0, rings=1, bands=12)
    rho = np.full(14, 1.0)
    rho[0], rho[-1] = 0.9, 1.05
    few = transport.spectral_radius(room, rho, iterations=3)
    assert few.lower < 1 < few.upper
    assert standing(few, refuses=True) == standing(few, refuses=False) == Status.UNDECIDED
    much = transport.spectral_radius(room, rho)
    matrix = rho[:, None] * np.asarray(room.form_factors)
    exact = np.max(np.abs(np.linalg.eigvals(matrix)))
    assert few.lower - 1e-12 <= exact <= few.upper + 1e-12
    assert much.value == pytest.approx(exact, rel=1e-11)


# --- the spectral radius ---


@pytest.mark.parametrize("seed", range(3))
def test_bounds_of_the_spectral_radius(seed):
    generator = np.random.default_rng(seed)
    room = transport.box((1.0, 1.5, 0.4), 2)
    rho = generator.uniform(0, 1.3, room.patches) * (generator.random(room.patches) > 0.2)
    found = transport.spectral_radius(room, rho)
    exact = np.max(np.abs(np.linalg.eigvals(rho[:, None] * np.asarray(room.form_factors))))
    assert found.lower - 1e-12 <= exact <= found.upper + 1e-12
    assert found.upper - found.lower < 1e-11
    assert found.iterations < 200


def test_two_plates_that_see_only_each_other():
    # The eigenvalues are +1 and -1: plain power iteration would swap for ever.
    room = transport.enclosure([[0, 1], [1, 0]], [1, 1])
    found = transport.spectral_radius(room, [0.9, 0.4])
    assert found.value == pytest.approx(0.6, rel=1e-11)
    solution = transport.neumann_series(room, [1.0, 0.0], [0.9, 0.4])
    assert solution.value == pytest.approx([1 / 0.64, 0.4 / 0.64], rel=1e-9)


def test_black_walls():
    room = transport.box()
    found = transport.spectral_radius(room, 0.0)
    assert (found.lower, found.upper) == (0, 0)
    for solver in SOLVERS.values():
        solution = solver(room, room.on_wall(1, 2.0), 0.0)
        assert solution.ok
        assert np.array_equal(solution.value, room.on_wall(1, 2.0))


# --- Neumann ---


@pytest.mark.parametrize("terms", [1, 3, 10, 60])
def test_truncation_is_bounded(terms):
    room, emission, _, _ = spotted_sphere()
    for rho in RHO:
        exact = emission + rho * np.mean(emission) / (1 - rho)
        solution = transport.neumann_series(room, emission, rho, terms=terms)
        assert solution.steps == terms
        off = np.max(np.abs(solution.value - exact))
        # What is left out <= what the solution says <= the bound that needs no solution.
        assert off <= np.max(solution.error) * (1 + 1e-12)
        assert np.max(solution.error) <= rho**terms / (1 - rho) * 1.01 + 1e-12
    constant = transport.neumann_series(room, 1.0, 0.9, terms=terms)
    # For the furnace the bound is the error.
    assert np.max(10 - constant.value) == pytest.approx(0.9**terms / 0.1, rel=1e-9)


@pytest.mark.parametrize("tolerance", [1e-2, 1e-5])
def test_the_series_stops_when_the_rest_is_small_not_the_term(tolerance):
    room, emission, _, _ = spotted_sphere()
    exact = emission + 0.99 * np.mean(emission) / 0.01
    solution = transport.neumann_series(room, emission, 0.99, tolerance=tolerance)
    off = np.max(np.abs(solution.value - exact)) / np.max(exact)
    assert tolerance / 3 < off < 1.02 * tolerance


def test_too_few_terms_say_so():
    room, emission, rho, _ = spotted_sphere()
    solution = transport.neumann_series(room, emission, rho, max_terms=5)
    assert solution.status is Status.NOT_REACHED
    assert "solve directly" in solution.message
    for solver in (transport.krylov, transport.progressive):
        box = transport.box((1.0, 2.0, 0.5), 2)
        assert solver(box, box.on_wall(0, 1.0), 0.9, max_steps=2).status is Status.NOT_REACHED


# --- programs ---


@pytest.mark.slow
def test_float32_stays_float32():
    room = transport.box(cells=2, dtype=jnp.float32)
    exact = transport.direct(transport.box(cells=2), transport.box(cells=2).on_wall(4, 1.0), 0.7).value
    for name, solver in SOLVERS.items():
        solution = solver(room, room.on_wall(4, 1.0), 0.7, **({} if name == "direct" else {"tolerance": 1e-5}))
        kinds = {leaf.dtype for leaf in jax.tree.leaves(solution) if jnp.issubdtype(leaf.dtype, jnp.floating)}
        assert kinds == {jnp.dtype("float32")}, name
        assert solution.ok
        off = np.abs(np.asarray(solution.value, float) - np.asarray(exact))
        assert np.all(off <= np.asarray(solution.error))
        assert np.max(off) < 5e-5


def test_no_number_recompiles():
    programs = [radiosity.solve_directly, radiosity._krylov, radiosity._progressive]
    before = None
    for i, rho in enumerate((0.3, 0.5, 1.2)):
        room = transport.box((1.0, 1.0 + i, 0.7), 2)
        transport.direct(room, room.on_wall(0, 1.0 + i), rho)
        transport.krylov(room, room.on_wall(0, 1.0 + i), rho, tolerance=10.0 ** (-4 - i), max_steps=50 + i)
        transport.progressive(room, room.on_wall(0, 1.0 + i), rho, tolerance=10.0 ** (-4 - i), max_steps=50 + i)
        sizes = [program._cache_size() for program in programs]
        assert before is None or sizes == before
        before = sizes


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda box: transport.direct(box, -1.0, 0.5), "emission must be finite and >= 0; got -1"),
        (lambda box: transport.direct(box, 1.0, np.nan), "reflectance must be finite and >= 0; got nan"),
        (lambda box: transport.direct(box, [1.0, 2.0], 0.5), "one for each of the 6 patches; got the shape"),
        (lambda box: transport.direct(box, 1.0, "white"), "reflectance must be real numbers >= 0; got 'white'"),
        (lambda box: transport.krylov(box, 1.0, 0.5, tolerance=0.0), "tolerance must be a number between 0 and 1; got 0.0"),
        (lambda box: transport.krylov(box, 1.0, 0.5, max_steps=0), "max_steps must be a whole number >= 1; got 0"),
        (lambda box: transport.progressive(box, 1.0, 0.5, tolerance=2), "tolerance must be a number between 0 and 1; got 2"),
        (lambda box: transport.neumann_series(box, 1.0, 0.5, terms=0), "terms must be a whole number >= 1; got 0"),
        (lambda box: transport.spectral_radius(box, -0.1), "reflectance must be finite and >= 0; got -0.1"),
    ],
)
def test_wrong_arguments(call, says):
    with pytest.raises(ValueError, match=says) as caught:
        call(transport.box())
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("solver", [*SOLVERS.values(), transport.spectral_radius])
def test_something_that_is_no_enclosure(solver):
    arguments = (0.5,) if solver is transport.spectral_radius else (1.0, 0.5)
    for wrong in ("x", None, np.eye(3)):
        with pytest.raises(TypeError, match=r"an enclosure is made by transport\.sphere, .*; got (str|NoneType|ndarray)"):
            solver(wrong, *arguments)
