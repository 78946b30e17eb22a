"""Budgets: the search against brute force and its promises; knobs against what they stand for; real scenes."""

from __future__ import annotations

import itertools
import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from selection import few

import brdfcheck
from brdfcheck import plots
from brdfcheck.brdf.lobes import BinomialPower, Phong
from brdfcheck.budgets import knobs, programs, report, scenes
from brdfcheck.budgets import measure as measuring
from brdfcheck.budgets.measure import Beside, Budget, BudgetError, beside, full_model, measure
from brdfcheck.budgets.programs import Compiler
from brdfcheck.budgets.room import irradiance, room_numbers
from brdfcheck.budgets.search import REFUSED, Fault, Search
from brdfcheck.budgets.shaders import split
from brdfcheck.messages import UsageError
from brdfcheck.operations import program_of
from brdfcheck.operations import work_of as work_of_program
from brdfcheck.scene.artistic import Highlight, Translucent
from brdfcheck.scene.images import codes
from brdfcheck.scene.lights import Distant, Polygon
from brdfcheck.scene.raster import rasterise
from brdfcheck.scene.sphere import sphere_image
from brdfcheck.scene.vectors import Vector
from brdfcheck.transport import box, direct, neumann_series

GLOSSY = {
    "size": 48,
    "material": {
        "kind": "surface",
        "terms": [{"brdf": "lambert", "tint": [0.6, 0.3, 0.1]}, {"brdf": "blinn-phong", "tint": 0.2, "n": 50}],
    },
    "lights": [
        {"kind": "point", "position": [3, 3, 5], "intensity": 60, "constant_attenuation": 0, "quadratic_attenuation": 1}
    ],
}
MATT = {"kind": "surface", "terms": [{"brdf": "lambert", "tint": [0.6, 0.3, 0.1]}]}
DISTANT = {"kind": "distant", "direction": [1, 1, 1], "intensity": 2}
PANEL = {"kind": "polygon", "vertices": [[2, -1, -1], [2, 1, -1], [2, 1, 1], [2, -1, 1]], "intensity": 1}


ROOM = {"reflectance": 0.5, "emission": 1}
ASIDE = {"kind": "perspective", "eye": [2, 1, -4], "target": [0.3, 0.1, 0.2]}


def work_of(compiler: Compiler, plan: Any) -> float:
    seen, points = compiler.seeing(plan)
    return seen + points * compiler.shading(plan) + compiler.grid(plan) + compiler.room(plan)


@pytest.fixture(scope="module")
def glossy():
    return measure(GLOSSY)


# --- the search ---


@st.composite
def searches(draw):
    """Ladders of random costs and errors; pictures that err up to the sum of their rungs, or cancel."""
    sizes = draw(st.lists(st.integers(2, 4), min_size=1, max_size=3))
    number = st.floats(0, 1).map(lambda x: round(x, 2))
    own = [[Fault(draw(number), draw(number)) for _ in range(size - 1)] + [Fault(0.0, 0.0)] for size in sizes]
    if draw(st.booleans()):
        own[0][0] = REFUSED
    combinations = list(itertools.product(*(range(size) for size in sizes)))
    cost = {one: draw(st.sampled_from([0.1, 0.5, 0.5, 1.0])) for one in combinations}
    share = {one: draw(number) for one in combinations}
    forbidden = {one for one in combinations[:-1] if draw(st.integers(0, 5)) == 0}

    def picture(one):
        assert all(np.isfinite(own[k][i].pixel) for k, i in enumerate(one)), "a refused rung was rendered"
        return Fault(
            share[one] * sum(own[k][i].pixel for k, i in enumerate(one)), sum(own[k][i].energy for k, i in enumerate(one))
        )

    return lambda: Search(
        own, cost.__getitem__, picture, lambda one: REFUSED if one in forbidden else Fault(0, 0)
    ), combinations


@settings(max_examples=300)  # no picture is made
@given(searches(), st.lists(st.floats(0, 1.5), min_size=3, max_size=6), st.sampled_from([0.3, 1.0, math.inf]))
def test_the_choice_is_monotone_and_does_not_depend_on_what_was_asked_before(made, tolerances, energy):
    make, combinations = made
    search, backwards = make(), make()
    chosen = [(t, search.best(Fault(t, energy))) for t in sorted(tolerances)]
    assert [backwards.best(Fault(t, energy)) for t in sorted(tolerances, reverse=True)] == [one for _, one in reversed(chosen)]
    for (_, tight), (_, loose) in itertools.pairwise(chosen):
        assert search.cost(loose) <= search.cost(tight)
        assert search.error(tight).pixel <= search.error(loose).pixel or search.cost(loose) < search.cost(tight)
        # As a tighter one never errs more:
        assert search.error(tight).pixel <= search.error(loose).pixel
    for tolerance, one in chosen:
        assert search.error(one).within(Fault(tolerance, energy))
        good = [
            other
            for other in combinations
            if search.least(other).within(Fault(tolerance, energy))
            and search.error(other).within(Fault(tolerance, energy))
            and search.program(other) != REFUSED
        ]
        assert search.cost(one) == min(map(search.cost, good))


def test_errors_that_cancel_are_not_counted_on():
    own = [[Fault(0.4, 0), Fault(0, 0)], [Fault(0.4, 0), Fault(0, 0)]]
    search = Search(own, lambda one: 0.5 ** sum(i == 0 for i in one), lambda _: Fault(0.0, 0.0))
    assert search.best(Fault(0.3, math.inf)) == (1, 1)
    assert search.best(Fault(0.4, math.inf)) == (0, 0)
    assert search.error((0, 0)).pixel == 0.4


def test_a_combination_that_is_never_good_enough_is_not_rendered():
    rendered = []

    def picture(one):
        rendered.append(one)
        return Fault(0.0, 0.0)

    search = Search([[Fault(0.5, 0), Fault(0, 0)]], lambda one: one[0] + 1.0, picture)
    assert search.best(Fault(0.1, math.inf)) == (1,)
    assert rendered == [(1,)]
    assert search.best(Fault(0.5, math.inf)) == (0,)


def test_nothing_is_given_away_for_equal_costs():
    own = [[Fault(0.2, 0), Fault(0.1, 0), Fault(0, 0)]]
    assert Search(own, lambda _: 1.0, lambda _: Fault(0, 0)).best(Fault(1, 1)) == (2,)
    # By rounding alone it is not cheaper; by a part in a million it is.
    assert Search(own, lambda one: 1.0 + one[0] * 1e-13, lambda _: Fault(0, 0)).best(Fault(1, 1)) == (2,)
    assert Search(own, lambda one: 1.0 + one[0] * 1e-6, lambda _: Fault(0, 0)).best(Fault(1, 1)) == (0,)


def test_the_frontier_has_every_known_error():
    own = [[Fault(0.3, 0), Fault(0.1, 0), Fault(0, 0)], [Fault(0.2, 0), Fault(0, 0)]]
    costs: dict[Any, float] = {(0, 1): 0.3, (1, 1): 0.5, (2, 0): 0.5, (2, 1): 1.0, (0, 0): 0.1, (1, 0): 0.3}
    known: dict[Any, Fault] = {(0, 1): Fault(0.3, 0), (1, 1): Fault(0.1, 0), (2, 0): Fault(0.2, 0), (2, 1): Fault(0, 0)}

    def refuse(one):
        return REFUSED if one == (1, 1) else Fault(0, 0)

    search = Search(own, lambda one: costs[one], lambda _: Fault(0.5, 0), refuse, dict(known))
    assert search.frontier() == [(0, 1), (1, 1), (2, 1)]
    assert search.best(Fault(0.15, 1)) == (2, 1)  # (1, 1) is refused, which is known from now on
    assert search.frontier() == [(0, 1), (2, 0), (2, 1)]


# --- the work ---


def traced(function, *arguments, loops=()):
    return work_of_program(program_of(function, *arguments), loops)


def test_operations_are_counted_with_their_loops_and_prices():
    x, many = jnp.zeros(10), jnp.zeros((7, 5))
    assert traced(lambda x: x * x + x, x) == 20
    assert traced(lambda x: x * x, x.astype(jnp.float32)) == pytest.approx(10 / 3)
    assert traced(lambda x: jax.lax.integer_pow(x, 16), x) == 40  # by squaring
    assert traced(jnp.exp, x) == traced(jnp.log, x) == 240
    assert traced(jax.jit(lambda x: jnp.broadcast_to(x[:, None], (10, 10)) * 2), x) == 100
    assert traced(lambda a: a @ a.T, many) == pytest.approx(7 * 7 * 5 * 2 * traced(lambda a, b: a @ b, x, x) / 20)
    assert traced(lambda x: jax.lax.fori_loop(0, 6, lambda _, y: y * x, x), x) == pytest.approx(60, abs=10)

    def unknown(x, count):
        return jax.lax.fori_loop(0, count, lambda _, y: jax.lax.fori_loop(0, count, lambda _, z: z * x, y), x)

    once, more = (traced(unknown, x, 3, loops=loops) for loops in ((), (4.0, 5.0)))
    assert 200 <= more < 260
    assert 10 <= once < 20
    assert traced(jax.nn.relu, x) >= 10  # a function with a derivative of its own


@pytest.mark.parametrize(
    "document",
    [
        pytest.param(GLOSSY, marks=pytest.mark.slow),
        {"size": 20, "material": MATT, "lights": [PANEL], "room": {"reflectance": 0.5, "emission": 1}},
        {"size": 20, "material": GLOSSY["material"], "lights": [{"kind": "environment"}]},
        {**GLOSSY, "size": 20, "camera": {"kind": "perspective"}},
    ],
)
def test_the_work_of_the_parts_is_that_of_the_whole(document):

    scene = scenes.parse_scene(document)
    for choice in (
        {},
        {"precision": "float32", "light": "distant", "surrounding": "4 nodes", "bounces": "3"},
        {"grid": "20 x 20"},  # as many points as pixels: those of a surrounding are integrated in blocks
    ):
        plan = knobs.plan_of(scene, choice)
        numbers = Compiler(scene)._numbers(plan)
        whole = traced(
            lambda numbers, plan=plan: programs._picture(scene, plan, numbers, None), numbers, loops=(plan.bounces or 0.0,)
        )
        assert work_of(Compiler(scene), plan) == pytest.approx(whole, rel=1e-3)


FAR = {"kind": "perspective", "eye": [0.5, 0.3, 20], "target": [2, 0.5, 0]}


def test_of_many_lights_not_every_number_is_tried_and_each_kind_is_traced_once(monkeypatch):
    lights = [{**DISTANT, "direction": [1, k / 9, 1], "intensity": 0.1 * 0.8**k} for k in range(30)]
    lamps = [{"kind": "point", "position": [9, k, 9], "intensity": 0.01} for k in range(4)]
    scene = scenes.parse_scene({"size": 12, "material": MATT, "lights": lights + lamps})
    rungs = next(knob.rungs for knob in knobs.knobs_of(scene) if knob.name == "lights")
    counts = [int(rung.split()[0]) for rung in rungs]
    assert counts[:8] == list(range(1, 9))
    assert counts[-1] == 34
    assert counts == sorted(set(counts))
    assert 12 <= len(counts) < 22
    traces = []
    monkeypatch.setattr(programs, "program_of", lambda *a: traces.append(None) or program_of(*a))
    compiler = Compiler(scene)
    works = [work_of(compiler, knobs.plan_of(scene, {"lights": rung})) for rung in rungs]
    assert len(traces) < 10
    assert all(more > fewer for fewer, more in itertools.pairwise(works))
    plan = knobs.plan_of(scene, {})
    numbers = compiler._numbers(plan)
    assert works[-1] == pytest.approx(traced(lambda numbers: programs._picture(scene, plan, numbers, None), numbers), rel=1e-3)
    brightest = knobs.plan_of(scene, {"lights": rungs[4]}).lights
    assert [float(light.intensity[0]) for light in brightest] == pytest.approx([0.1 * 0.8**k for k in range(5)])


FROM_ABOVE = {"kind": "orthographic", "half_height": 4, "eye": [1, 2, 5], "target": [1, 0, 0]}


@pytest.mark.parametrize("camera", few([FAR, FROM_ABOVE], (FAR,)))
@pytest.mark.parametrize("shape", few([{"geometry": {"kind": "icosphere", "level": 2}}, {}], ({},)))
def test_a_box_around_the_object_is_all_that_needs_shading(camera, shape):
    scene = scenes.parse_scene({**GLOSSY, "size": [40, 60], "camera": camera, "background": [0.1, 0.2, 0.3], **shape})
    window = next(knob for knob in knobs.knobs_of(scene) if knob.name == "window")
    compiler = Compiler(scene)
    full, part = (knobs.plan_of(scene, {"window": rung}) for rung in reversed(window.rungs))
    assert full.window is None
    top, bottom, left, right = part.window
    covered = np.argwhere(compiler.picture(full).covered)
    np.testing.assert_array_less([top - 1, left - 1], covered.min(axis=0))
    np.testing.assert_array_less(covered.max(axis=0), [bottom, right])
    assert (bottom - top) * (right - left) < 6 * len(covered)
    for image in (compiler.picture(part).image, compiler.program(part).image()):
        np.testing.assert_allclose(image, compiler.program(full).image(), atol=1e-13)
    np.testing.assert_array_equal(compiler.picture(part).covered, compiler.picture(full).covered)
    # A frame is drawn into again and again, and what was seen of it before stays as it was.
    program = compiler.program(part)
    first = program.image()
    kept = first.copy()
    assert program.seconds() > 0
    np.testing.assert_array_equal(program.image(), kept)
    np.testing.assert_array_equal(first, kept)
    outside = 40 * 60 - (bottom - top) * (right - left)
    assert work_of(compiler, full) - work_of(compiler, part) >= 0.99 * outside * compiler.shading(full) > 0


FACETS = {"size": 20, "geometry": {"kind": "icosphere", "level": 2}, **{key: GLOSSY[key] for key in ("material", "lights")}}


@pytest.mark.parametrize(
    ("document", "choices"),
    [
        (GLOSSY, [{}, {"precision": "float32", "light": "distant"}, {"lobe": "Lyon w=2, exact factor"}, {"grid": "9 x 9"}]),
        pytest.param(
            {"size": 20, "material": MATT, "lights": [PANEL], "room": ROOM},
            [{}, {"bounces": "2", "precision": "float32"}, {"cells": "2 x 2"}, {"grid": "9 x 9"}],
            marks=pytest.mark.slow,
        ),
        pytest.param(
            {**GLOSSY, "size": 24, "room": ROOM, "lights": [{**PANEL, "matt_only": True}, *GLOSSY["lights"]], "camera": ASIDE},
            [{}, {"grid": "9 x 9"}, {"grid": "12 x 12", "precision": "float32"}],
            marks=pytest.mark.slow,
        ),
        pytest.param(
            FACETS,
            [{}, {"facets": "the sphere itself"}, *({"facets": f"80 faces, {name}"} for name in ("flat", "Gouraud", "Phong"))],
            marks=pytest.mark.slow,
        ),
        (
            {**GLOSSY, "material": {"kind": "translucent", "base": 0.5}, "lights": [DISTANT]},
            [{}, {"lobe": "Schlick"}, {"grid": "9 x 9"}],
        ),
    ],
)
def test_a_picture_by_steps_is_that_of_its_program(document, choices):
    scene = scenes.parse_scene({**document, "background": [0.1, 0.2, 0.3]})
    compiler, shown = Compiler(scene), []
    for choice in choices:
        plan = knobs.plan_of(scene, choice)
        picture, image = compiler.picture(plan), compiler.program(plan).image()
        assert picture.image.dtype == image.dtype
        np.testing.assert_allclose(picture.image, image, rtol=0, atol=20 * np.finfo(image.dtype).eps)
        np.testing.assert_allclose(image[:, ~picture.covered].T, [[0.1, 0.2, 0.3]] * (~picture.covered).sum(), rtol=1e-6)
        shown.append(picture.image)
    assert all(np.abs(one - shown[0]).max() > 1e-9 for one in shown[1:])


@pytest.mark.slow
def test_the_choice_is_the_cheapest_of_all_combinations():
    panel = {**PANEL, "horizon_clipping": False}
    scene = scenes.parse_scene({"size": 12, "material": MATT, "lights": [panel, DISTANT], "room": {**ROOM, "cells": 2}})
    measured = measure(scene)
    # By all pictures and works, without the search, and of works without what is shared between combinations.
    compiler = measured.compiler
    table = []
    for rungs in itertools.product(*(knob.rungs for knob in measured.knobs)):
        choice = {knob.name: rung for knob, rung in zip(measured.knobs, rungs, strict=True)}
        try:
            plan = knobs.plan_of(scene, choice)
            picture = compiler.picture(plan)
        except NotImplementedError:
            continue
        table.append((work_of(Compiler(scene), plan), measured.fault(picture).pixel, choice))
    assert len(table) > 60
    for tolerance in (0.0, 1e-4, 0.5 / 255, 3 / 255, 0.05, 0.2, 1.0):
        found = measured.choose(tolerance)
        alone = [rung.fault.pixel for row in found.rows for rung in [row.chosen]]
        assert max(alone) <= tolerance
        chosen = next(work for work, _, choice in table if choice == found.chosen)
        good = [
            work for work, error, choice in table
            if error <= tolerance and all(
                rung.fault.pixel <= tolerance
                for name, ladder in measured.ladders.items() for rung in ladder if rung.name == choice[name]
            )
        ]  # fmt: skip
        assert chosen == pytest.approx(min(good), rel=1e-9)
        assert found.cost == pytest.approx(chosen / work_of(compiler, knobs.plan_of(scene, {})), rel=1e-9)


@pytest.mark.slow
def test_a_budget_of_many_combinations_traces_each_part_once(monkeypatch):
    """Once over 200 s without a word, where an icosphere of level 4 made 7,020 combinations of the 3,276 here."""
    lamp = {**GLOSSY["lights"][0], "position": [40, 30, 60], "intensity": 9000}
    terms = [{"brdf": "lambert", "tint": [0.2, 0.3, 0.6]}, {"brdf": "blinn-phong", "tint": 0.3, "n": 200}]
    scene = {
        "size": 24,
        "matters": {"pixel": "1/255"},
        "geometry": {"kind": "icosphere", "level": 1, "shading": "phong"},
        "material": {"kind": "surface", "terms": terms},
        "lights": [lamp, {**DISTANT, "direction": [-1, 0.2, 0.5], "intensity": 0.4}, {"kind": "ambient", "intensity": 0.1}],
    }
    drawn = []
    monkeypatch.setattr(programs, "rasterise", lambda *a, **k: drawn.append(None) or rasterise(*a, **k))
    found = brdfcheck.budget(scene)
    assert found.verified.pixel <= 1 / 255
    assert found.combinations == 3276
    assert len(drawn) < 20  # was 100 when each combination was a program of its own


@pytest.mark.slow
def test_what_is_much_less_work_takes_less_time():
    # Large ratios, in turns, by the median of the rounds.
    environment = {"kind": "environment", "intensity": 0.8}
    room = {"reflectance": 0.7, "emission": 0.6, "cells": 10}
    checked = 0
    for document, choices in (
        ({**GLOSSY, "size": 256}, [{"precision": "float32", "light": "distant"}, {"precision": "float16"}]),
        ({**GLOSSY, "size": 16, "lights": [environment]}, [{"surrounding": "2 nodes"}, {"surrounding": "32 nodes"}]),
        ({"size": 32, "material": MATT, "lights": [DISTANT], "room": room}, [{"bounces": "1"}, {"bounces": "32"}]),
    ):
        scene = scenes.parse_scene(document)
        compiler = Compiler(scene)
        plans = [knobs.plan_of(scene, choice) for choice in ({}, *choices)]
        for one, other in itertools.permutations(plans, 2):
            if work_of(compiler, other) >= 2.5 * work_of(compiler, one):
                checked += 1
                time = beside(compiler.program(one), compiler.program(other))
                assert time.quartiles[1] < 1, (one, other, time)
    assert checked >= 7


# --- a scene with a highlight ---


def test_the_choice_is_verified_by_an_image_of_its_own(glossy):
    budget = glossy.choose("4/255")
    scene = glossy.scene
    again = Compiler(scene).program(knobs.plan_of(scene, budget.chosen)).image()
    full = Compiler(scene).program(knobs.plan_of(scene, {})).image()
    # By the codes of a file of 16 bits, not by the budget's own measure.
    apart = np.abs(codes(again, 16).astype(float) - codes(full, 16).astype(float)).max() / 65535
    assert apart == pytest.approx(budget.verified.pixel, abs=1.1 / 65535)
    assert budget.verified.pixel <= budget.error.pixel <= 4 / 255
    energy = abs(again.astype(float).sum() / full.astype(float).sum() - 1)
    assert budget.verified.energy == pytest.approx(energy, rel=1e-6)
    assert budget.seconds > 0
    assert budget.saving == pytest.approx(budget.full_seconds / budget.seconds)
    assert budget.ratios[0] <= budget.ratios[1] <= budget.ratios[2]
    assert budget.ratios[1] == pytest.approx(1 / budget.saving)


def test_the_full_model_is_the_scene_as_render_shows_it(glossy):

    picture = scenes.parse_scene(GLOSSY).picture
    shown = sphere_image(picture.material, picture.lights, picture.camera, size=picture.size, dtype=jnp.float64)
    np.testing.assert_allclose(glossy.whole, shown, atol=1e-13)


def test_what_does_not_conserve_is_never_chosen(glossy):
    ladder = {rung.name: rung for rung in glossy.ladders["lobe"]}
    refused = ladder["Schlick, factor of the power"]
    assert "VIOLATES" in refused.refused
    assert refused.fault == REFUSED
    # The others are refused for the same reason, or not at all: a fitted or exact factor conserves.
    assert all(not rung.refused or "VIOLATES" in rung.refused for rung in ladder.values())
    assert all("factor of the power" in name for name, rung in ladder.items() if rung.refused)
    for tolerance in (0, "0.5/255", 0.1, 0.5, 1):
        assert not ladder[glossy.choose(tolerance).chosen["lobe"]].refused


def test_a_sum_that_does_not_conserve_is_never_chosen():
    # Schlick's lobe with a factor that conserves, over a base that leaves no room for a Fresnel term: each passes, the sum not.
    scene = scenes.parse_scene(GLOSSY)
    assert knobs.refusal_of(scene, {"lobe": "Schlick, exact factor"}) == ""
    term = scene.picture.material.terms[1]
    shiny = knobs.Surface(knobs.Term("lambert", 0.9), knobs.Term("blinn-phong", 0.2, n=50.0), allow_unvalidated=True)
    broken = scenes.Scene(picture=scene.picture.__class__(shiny, scene.picture.lights, scene.picture.camera))
    assert "more than arrives" in knobs.refusal_of(broken, {"precision": "float32"})
    assert term.name == "blinn-phong"


def test_factors_are_one_program_and_one_cost(glossy):
    scene, compiler = glossy.scene, Compiler(glossy.scene)
    names = [f"Lyon w=2, {factor}" for factor in ("factor of the power", "two constants", "exact factor")]
    programs = [compiler.program(knobs.plan_of(scene, {"lobe": name})) for name in names]
    assert len({id(program.compiled) for program in programs}) == 1
    costs = {rung.cost for rung in glossy.ladders["lobe"] if rung.name in names}
    assert len(costs) == 1


def test_an_energy_that_matters_is_kept(glossy):
    search = Search(glossy.search.own, lambda one: 1.0 + sum(one), glossy.search.picture)
    loose = search.best(Fault(0.2, math.inf))
    tight = search.best(Fault(0.2, 1e-3))
    assert search.error(tight).energy <= 1e-3 < search.error(loose).energy
    assert search.cost(loose) < search.cost(tight)


# --- what rungs stand for ---


def at_center(light, *, irradiance):

    way, found = light.arriving(Vector(0.0, 0.0, 0.0))
    assert float(found * light.intensity[0]) == pytest.approx(irradiance, rel=1e-6)
    return np.array([float(part) for part in way])


def test_simpler_lights_agree_at_the_centre():
    panel = scenes.parse_scene({"material": MATT, "lights": [PANEL | {"matt_only": True}]})
    light: Any = panel.picture.lights[0]

    facing = float(light.irradiance(Vector(*jnp.zeros(3)), Vector(*jnp.array([1.0, 0.0, 0.0]))))
    for model in ("point", "distant"):
        plan = knobs.plan_of(panel, {"light": model})
        np.testing.assert_allclose(at_center(plan.lights[0], irradiance=facing), [1, 0, 0], atol=1e-12)
    assert knobs.plan_of(panel, {"light": "polygon"}).lights[0] is light
    unclipped = knobs.plan_of(panel, {"light": "polygon, unclipped"}).lights[0]
    assert unclipped.matt_only
    assert not unclipped.horizon_clipping
    point = scenes.parse_scene(GLOSSY)
    far = knobs.plan_of(point, {"light": "distant"}).lights[0]
    at_center(far, irradiance=60 / 43)


def test_metal_as_a_power_agrees_at_the_highlight():
    scene = scenes.parse_scene(
        {"material": {"kind": "metal", "base": 1.0, "lobes": [[0.04, 0.2]], "d": 0.0}, "lights": [DISTANT]}
    )
    half = knobs.plan_of(scene, {"metal": "power of N.H (15)"}).material.lobes[0]
    mirror = knobs.plan_of(scene, {"metal": "power of R.V (16)"}).material.lobes[0]
    np.testing.assert_allclose(half, [[1.0, 46.0]])
    np.testing.assert_allclose(mirror, [[1.0, 11.5]])
    angle = 1e-3
    facets = math.exp(-(math.tan(angle) ** 2) / 0.04) / math.cos(angle) ** 4
    assert math.cos(angle) ** 46 == pytest.approx(facets, abs=1e-9)


@pytest.mark.parametrize(
    "model",
    [
        pytest.param(Highlight((0.3, 0.5, 0.8), n=14.0), marks=pytest.mark.slow),
        Translucent((0.3, 0.5, 0.8), behind=0.4, n=14.0),
    ],
)
def test_painted_lobes_are_the_model_with_another_profile(model):

    lights, size = [Distant((1, 1, 1), 0.9), Distant((-1, 0, 1), 0.4)], (40, 40)
    exact = sphere_image(model, lights, size=size, dtype=jnp.float64)
    same = sphere_image(knobs.Painted(model, Phong(14.0)), lights, size=size, dtype=jnp.float64)
    np.testing.assert_allclose(same, exact, atol=1e-12)
    other = sphere_image(knobs.Painted(model, BinomialPower(14.0, form="mirror")), lights, size=size, dtype=jnp.float64)
    assert 1e-3 < float(jnp.max(jnp.abs(other - exact))) < 0.1


def test_bounces_are_those_of_the_transport():
    room = {"reflectance": 0.7, "emission": 1.5}
    camera = {"kind": "orthographic", "half_height": 1}
    scene = scenes.parse_scene({"size": 16, "camera": camera, "material": MATT, "lights": [], "room": room})
    compiler = Compiler(scene)
    cube = box(cells=4)
    emission = cube.on_wall(3, 1.5)
    moments = np.asarray(room_numbers(scenes.Room(**room))["moments"])
    # The normals of the pixels of column 8: of a sphere that fills the image.
    x, y = 1 / 16, (7.5 - np.arange(16)) / 8
    seen = x * x + y * y < 1
    z = np.sqrt(np.maximum(1 - x * x - y * y, 0))

    def shown(bounces):
        return compiler.program(knobs.plan_of(scene, {"bounces": bounces})).image()[:, seen, 8]

    def expected(value):
        field = irradiance(jnp.asarray(np.asarray(value) @ moments), Vector(jnp.full(16, x), jnp.asarray(y), jnp.asarray(z)))
        return np.array([0.6, 0.3, 0.1])[:, None] * np.asarray(field)[seen] / math.pi

    for bounces in (0, 2, 8):
        series = neumann_series(cube, emission, 0.7, terms=bounces + 1)
        np.testing.assert_allclose(shown(str(bounces)), expected(series.value), rtol=1e-12)
    np.testing.assert_allclose(shown("all"), expected(direct(cube, emission, 0.7).value), rtol=1e-11)


@pytest.mark.slow
def test_a_room_of_one_radiance_is_a_surrounding():
    # Nothing is lost between the walls, and all normals get pi: by moments of solid angles.
    for cells in (1, 5):
        sums = jnp.sum(room_numbers(scenes.Room(reflectance=0.5, emission=1, cells=cells))["moments"], axis=0) * math.pi
        np.testing.assert_allclose(sums, [4 * math.pi, 0, 0, 0, *[4 * math.pi / 3] * 3, 0, 0, 0], atol=1e-9)
        for normal in ((0.0, 0.0, 1.0), (0.6, 0.0, -0.8)):
            assert float(irradiance(sums, Vector(*normal))) == pytest.approx(math.pi, rel=1e-9)


@pytest.mark.slow
def test_the_irradiance_by_moments_is_that_of_the_walls_as_polygons():
    # Independently: each patch of uneven radiosity as a polygon, clipped at the horizon of the middle.
    rng = np.random.default_rng(5)
    numbers = room_numbers(scenes.Room(reflectance=0.5, emission=1, cells=2))
    cube = box(cells=2)
    value = 1 + rng.random(cube.patches)
    whole = jnp.asarray(value @ np.asarray(numbers["moments"]))
    corners = [np.asarray(cube.point(jnp.arange(cube.patches, dtype=np.int32), jnp.full((cube.patches, 2), u) * 1.0)[0])
               for u in (0.0, 1.0)]  # fmt: skip

    for normal in (np.array([0.0, 1.0, 0.0]), rng.normal(size=3), rng.normal(size=3)):
        normal = normal / np.linalg.norm(normal)
        exact = 0.0
        for low, high, one in zip(*corners, value, strict=True):
            flat = int(np.argmin(np.abs(high - low)))
            p, q = (axis for axis in range(3) if axis != flat)
            ring = [low.copy() for _ in range(4)]
            ring[1][p] = ring[2][p] = high[p]
            ring[2][q] = ring[3][q] = high[q]
            light = Polygon(np.array(ring) - 0.5, 1.0)
            exact += one / math.pi * float(light.irradiance(Vector(*jnp.zeros(3)), Vector(*jnp.asarray(normal))))
        assert float(irradiance(whole, Vector(*jnp.asarray(normal)))) == pytest.approx(exact, rel=0.02)


@pytest.mark.slow
def test_each_bounce_buys_accuracy_for_work():
    room = {"reflectance": 0.7, "emission": 1.5, "cells": 8}
    ladder = measure({"size": 16, "material": MATT, "lights": [DISTANT], "room": room}).ladders["bounces"]
    assert [rung.name for rung in ladder] == ["0", "1", "2", "4", "8", "16", "32", "all"]
    for fewer, more in itertools.pairwise(ladder):
        assert more.fault.pixel < fewer.fault.pixel
        assert more.cost > fewer.cost
    assert ladder[0].fault.pixel > 0.1
    assert ladder[0].cost < 0.2 * ladder[-1].cost


def errors_of(document, knob, *rungs):
    """How far the pictures of some rungs of a knob are from that of the full model, and the largest value of this one."""
    scene = scenes.parse_scene(document)
    compiler = Compiler(scene)
    choices = [{}, *({knob: rung} for rung in rungs)]
    full, *pictures = (compiler.program(knobs.plan_of(scene, choice)).image() for choice in choices)
    return *(np.abs(picture - full).max() for picture in pictures), full.max()


@pytest.mark.slow
def test_the_albedo_by_a_rule_tends_to_the_furnace():
    surface = {"kind": "surface", "terms": [{"brdf": "phong", "tint": 0.8, "n": 20}, {"brdf": "lambert", "tint": 0.1}]}
    document = {"size": 12, "material": surface, "lights": [{"kind": "environment", "intensity": 0.9}]}
    few, many, _ = errors_of(document, "surrounding", "2 nodes", "32 nodes")
    assert few > 1e-2
    assert many < 2e-5  # what the furnace itself is good for


ICOSPHERE = {"size": 24, "geometry": {"kind": "icosphere", "level": 3}, "material": MATT, "lights": [DISTANT]}


@pytest.mark.slow
def test_what_is_looked_up_tends_to_the_surrounding_as_entries_grow():
    facets = {"kind": "surface", "terms": [{"brdf": "cook-torrance", "tint": 0.9, "m": 0.4, "fresnel": "exact"}]}
    document = {"size": 12, "material": facets, "lights": [{"kind": "environment"}, DISTANT]}
    few, many, _ = errors_of(document, "surrounding", "table of 8", "table of 128")
    # Between entries it is linear: errors fall as the square of their distance.
    assert 2e-4 < few < 0.05
    assert many < few / 100


@pytest.mark.slow
def test_lights_that_do_not_matter_are_left_out():
    weak = [{**DISTANT, "direction": [1, k, 2], "intensity": 1e-6} for k in range(4)]
    scene = {"size": 16, "material": MATT, "lights": [*weak[:2], DISTANT, *weak[2:], {"kind": "ambient", "intensity": 0.2}]}
    found = brdfcheck.budget(scene, "1/255")
    assert found.chosen["lights"] == "2 of 6"
    both = full_model(scenes.parse_scene({**scene, "lights": [scene["lights"][2], scene["lights"][5]]}))
    np.testing.assert_allclose(found.image, both, rtol=1e-5)
    # The tolerance decides: none of them may go where each is seen.
    assert brdfcheck.budget({**scene, "output": {"bits": 16, "transfer": "linear"}}, 1e-9).chosen["lights"] == "6 of 6"


@pytest.mark.parametrize(
    ("material", "lights", "camera", "nearly"),
    [
        pytest.param(
            MATT, [{**PANEL, "vertices": [[3, -1, -9], [3, 1, -9], [-3, 1, -9], [-3, -1, -9]]}], ASIDE, 6e-4,
            marks=pytest.mark.slow,
        ),
        (
            GLOSSY["material"], [{**GLOSSY["lights"][0], "position": [-3, 1, -5]}],
            {"kind": "orthographic", "eye": [-1, -2, -3], "half_height": 0.9}, 1.2e-2,  # it has a sharp highlight
        ),
    ],
)  # fmt: skip
def test_a_grid_of_points_tends_to_each_pixel(material, lights, camera, nearly):
    document = {"size": [40, 60], "camera": camera, "material": material, "lights": lights}
    few, many, brightest = errors_of(document, "grid", "28 x 28", "112 x 112")
    # Between points it is linear: errors fall as the square of their distance, up to the outline.
    assert 0 < many < nearly * brightest
    assert 10 * many < few < 30 * many


def test_a_grid_holds_what_areas_send_and_rays_only_where_there_is_nothing_else():
    document = {**GLOSSY, "size": 12, "lights": [{**PANEL, "matt_only": True}, DISTANT, {"kind": "ambient", "intensity": 0.1}]}
    lights = scenes.parse_scene(document).picture.lights
    plan = knobs.plan_of(scenes.parse_scene(document), {"grid": "4 x 4"})
    panel, distant, ambient = lights
    assert split(plan, lights, False) == ((panel,), (distant, ambient))
    assert split(plan, (distant,), False) == ((distant,), ())
    assert split(plan, (distant,), True) == ((), (distant,))
    assert split(knobs.plan_of(scenes.parse_scene(document), {}), lights, True) == ((), lights)


@pytest.mark.slow
def test_a_grid_is_chosen_where_each_pixel_is_dear():
    scene = {"size": 80, "material": MATT, "lights": [PANEL]}
    found = brdfcheck.budget(scene, "4/255")
    assert found.chosen["grid"] == "24 x 24"
    assert 0 < found.verified.pixel <= 4 / 255
    # All others as they are: each pixel is dearer, and nearer.
    rungs = {rung.name: rung for rung in found.ladders["grid"]}
    assert list(rungs) == ["24 x 24", "36 x 36", "each pixel"]
    assert 3 * rungs["24 x 24"].cost < rungs["each pixel"].cost == 1
    assert rungs["24 x 24"].fault.pixel > rungs["36 x 36"].fault.pixel > rungs["each pixel"].fault.pixel == 0
    assert brdfcheck.budget(scene, "0.01/255").chosen["grid"] == "each pixel"


@pytest.mark.slow
def test_facets_approach_those_of_the_scene():
    scene = scenes.parse_scene(ICOSPHERE)
    compiler = Compiler(scene)
    full = compiler.picture(knobs.plan_of(scene, {}))
    np.testing.assert_allclose(full.image, scene.picture.render(), atol=2e-6)
    (ladder,) = (knob.rungs for knob in knobs.knobs_of(scene) if knob.name == "facets")
    assert ladder[:2] == ("the sphere itself", "20 faces, flat")
    assert ladder[-1] == "1280 faces, Phong"
    last = compiler.picture(knobs.plan_of(scene, {"facets": ladder[-1]}))
    np.testing.assert_allclose(last.image, full.image, atol=1e-12)
    found = []
    for name in ("20 faces, flat", "320 faces, Phong", ladder[0]):
        picture = compiler.picture(knobs.plan_of(scene, {"facets": name}))
        both = picture.covered & full.covered
        assert 200 < both.sum() <= full.covered.sum()
        found.append(np.abs(picture.image - full.image)[:, both].max())
    assert found[0] > 2 * found[1] > 0
    assert 0 < found[2] < found[1]


@pytest.mark.slow
@pytest.mark.parametrize("silhouette", [False, True])
def test_the_sphere_stands_for_its_facets_where_the_outline_does_not_matter(silhouette):
    icosphere = {"kind": "icosphere", "level": 2}
    found = measure({**ICOSPHERE, "geometry": icosphere, "matters": {"pixel": 0.1, "silhouette": silhouette}}).choose()
    assert (found.chosen["facets"] == "the sphere itself") != silhouette
    assert (found.cost < 0.05) != silhouette
    assert found.verified.pixel < 0.1


def test_a_picture_that_does_not_repeat_is_an_error(glossy, monkeypatch):
    verified = glossy.verified
    monkeypatch.setattr(type(glossy), "verified", lambda self, one, image: verified(one, image + 1))
    with pytest.raises(
        BudgetError,
        match=r"rendered again, the chosen combination errs \S+ \(energy \S+\) where 0.00196 \(energy \S+\) is allowed",
    ):
        glossy.choose()


def test_a_scene_is_measured_once_and_again_where_it_names_files(tmp_path, monkeypatch):
    monkeypatch.setattr(measuring, "_measure", lambda scene, watch: object())
    document = {"size": 8, "material": MATT, "lights": [DISTANT]}
    assert measure(document) is measure(dict(document))
    assert measure(document) is not measure({**document, "size": 9})
    scene = scenes.parse_scene(document)
    assert measure(scene) is measure(scene)
    path = tmp_path / "s.toml"
    text = 'size = 8\n[material]\nkind = "surface"\nterms = [{ brdf = "lambert" }]\n[[lights]]\nkind = "ambient"\n'
    path.write_text(text)
    first = measure(path)
    assert measure(str(path)) is first
    path.write_text(text.replace("size = 8", "size = 7"))
    assert measure(path) is not first
    # Of a file that the scene names something else may be in it by now.
    trimesh.creation.icosphere(0).export(tmp_path / "ball.ply")
    path.write_text('geometry = { kind = "mesh", file = "ball.ply" }\n' + text)
    assert measure(path) is not measure(path)


@pytest.mark.slow
def test_what_clearly_takes_longer_than_the_full_model_is_not_chosen(monkeypatch):
    measured = measure({**GLOSSY, "size": 21, "material": MATT})
    full = tuple(len(knob.rungs) - 1 for knob in measured.knobs)
    search = measured.search
    # However cheap its rungs are by themselves.
    monkeypatch.setattr(search, "cost", lambda one: 1.0 if one == full else 0.1 + sum(one) / 100)
    search.__post_init__()
    # A quarter of the rounds in which it took less, by chance as on a busy machine, is no reason to take another one.
    for ratios, chosen in (((1.5, 2.0, 2.5), full), ((0.9, 1.3, 9.0), search.order[0]), ((0.4, 0.5, 0.6), search.order[0])):
        search._final.clear()
        search.errors.clear()
        monkeypatch.setattr(type(measured), "time", lambda self, program, ratios=ratios: Beside(1.0, ratios))
        found = search.best(Fault(1.0, math.inf))
        assert found == chosen


@pytest.mark.slow
def test_meshes_and_functions_of_users_have_budgets(tmp_path):
    trimesh.creation.icosphere(1).export(tmp_path / "ball.stl")
    (tmp_path / "mine.py").write_text("import math\ndef matt(wi, wo, albedo):\n    return albedo / math.pi\n")
    (tmp_path / "s.toml").write_text(
        'size = 12\ngeometry = { kind = "mesh", file = "ball.stl" }\n[material]\nkind = "surface"\n'
        'terms = [{ brdf = "mine.py:matt", albedo = 0.5 }]\n[[lights]]\nkind = "distant"\ndirection = [1, 1, 1]\n'
    )
    found = brdfcheck.budget(tmp_path / "s.toml", "1/255")
    assert list(found.chosen) == ["shading", "precision"]
    assert found.verified.pixel <= 1 / 255
    same = {"size": 12, "geometry": {"kind": "icosphere", "level": 1}, "lights": [{"kind": "distant", "direction": [1, 1, 1]}]}
    matt = {"kind": "surface", "terms": [{"brdf": "lambert", "tint": 0.5}]}
    np.testing.assert_allclose(found.reference, full_model(scenes.parse_scene({**same, "material": matt})), atol=1e-5)


# --- knobs that a scene has ---


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({}, ["lobe", "light", "precision"]),
        ({"lights": [DISTANT]}, ["lobe", "precision"]),
        ({"material": MATT, "lights": [PANEL]}, ["light", "precision"]),
        ({"lights": [{"kind": "environment"}]}, ["lobe", "surrounding", "precision"]),
        ({"lights": [DISTANT, {"kind": "environment"}]}, ["lobe", "surrounding", "lights", "precision"]),
        ({"material": MATT, "lights": [DISTANT, {"kind": "environment"}]}, ["lights", "precision"]),
        ({"room": {"reflectance": 0.5, "emission": 1}}, ["lobe", "light", "bounces", "cells", "precision"]),
        ({"geometry": {"kind": "icosphere"}, "lights": [DISTANT]}, ["lobe", "facets", "precision"]),
        ({"geometry": {"kind": "zigzag"}, "lights": [DISTANT]}, ["lobe", "shading", "precision"]),
        ({"geometry": {"kind": "zigzag", "shading": "flat"}, "lights": [DISTANT]}, ["lobe", "precision"]),
        ({"material": {"kind": "translucent", "base": 0.5}, "lights": [DISTANT]}, ["lobe", "precision"]),
        ({"material": {"kind": "metal", "base": 1.0, "lobes": [[0.04, 0.2]]}, "lights": [DISTANT]}, ["metal", "precision"]),
    ],
)
def test_a_scene_offers_only_the_knobs_it_has(change, expected):
    assert [knob.name for knob in knobs.knobs_of(scenes.parse_scene({**GLOSSY, **change}))] == expected


@pytest.mark.slow
def test_a_fresnel_term_has_the_rungs_below_its_own():
    def ladder(name):
        terms = [{"brdf": "cook-torrance", "tint": 0.5, "m": 0.3, "fresnel": name}]
        scene = scenes.parse_scene({"material": {"kind": "surface", "terms": terms}, "lights": [DISTANT]})
        found = {knob.name: knob.rungs for knob in knobs.knobs_of(scene)}
        return scene, found["fresnel"], found["metal"]

    assert ladder("schlick")[1] == ("constant", "Schlick")
    scene, rungs, metals = ladder("exact")
    assert rungs == ("constant", "Schlick", "exact")
    assert metals == ("power of N.H", "microfacets")
    plan = knobs.plan_of(scene, {"fresnel": "constant", "metal": "power of N.H"})
    assert plan.material.terms[0].fresnel == "none"
    assert float(plan.material.terms[0].brdf.lobe.n) == pytest.approx(2 / 0.09 - 2)


# --- reading ---


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"matters": {"pixel": "1/0"}}, "matters.pixel: must be a number from 0 to 1 or a fraction"),
        ({"matters": {"pixel": True}}, "matters.pixel: must be a number"),
        ({"size": 16384}, "size: must be at most 16777216 pixels in all"),
        ({"allow_unvalidated": True}, "allow_unvalidated has no place"),
        (
            {"material": {"kind": "highlight", "base": 0.5}, "room": {"reflectance": 0.5, "emission": 1}},
            "a room lights matt terms",
        ),
    ],
)
def test_what_is_wrong_with_a_scene_is_said_in_one_line(change, message):
    with pytest.raises(UsageError) as caught:
        scenes.parse_scene({**GLOSSY, **change}, "s.toml")
    text = str(caught.value)
    assert text.startswith("s.toml: ")
    assert message in text
    assert "\n" not in text


def test_what_does_not_conserve_is_refused_without_a_way_out():
    for terms, reason in (
        ([{"brdf": "blinn-phong-ndf", "n": 50}], "is not validated"),
        ([{"brdf": "lambert", "tint": 0.9}, {"brdf": "blinn-phong", "tint": 0.3, "n": 50}], "take smaller tints"),
    ):
        with pytest.raises(UsageError, match=reason) as caught:
            scenes.parse_scene({**GLOSSY, "material": {"kind": "surface", "terms": terms}})
        assert "allow_unvalidated" not in str(caught.value)


def test_tolerances():
    assert scenes.tolerance_of("0.5/255") == 0.5 / 255
    assert scenes.tolerance_of(0.25) == scenes.tolerance_of(" 1 / 4") == 0.25
    for wrong in ("a", "1/2/3", -0.1, 2, None, "nan", [], ""):
        with pytest.raises(ValueError, match="tolerance must be a number from 0 to 1"):
            scenes.tolerance_of(wrong)
    assert scenes.parse_scene({**GLOSSY, "output": {"bits": 16}}).pixel == 0.5 / 65535
    with pytest.raises(ValueError, match="tolerance must be"):
        brdfcheck.budget(GLOSSY, "much")
    with pytest.raises(TypeError, match="a scene is a path"):
        brdfcheck.budget(3)


# --- what is made of it ---


@pytest.mark.slow
def test_the_public_function_works_in_single_precision_too():
    with jax.enable_x64(False):
        found = brdfcheck.budget({**GLOSSY, "size": 8, "material": MATT, "lights": [DISTANT]}, 0.5)
        assert jnp.zeros(1).dtype == jnp.float32
    assert isinstance(found, Budget)
    assert isinstance(found, brdfcheck.Budget)
    assert found.reference.dtype == np.float64


def test_the_record_the_table_and_the_figures(glossy):
    budget = glossy.choose("4/255")
    record = report.document(budget)
    assert record["summary"]["chosen"] == budget.chosen
    assert [row["knob"] for row in record["results"]] == ["lobe", "light", "precision"]
    header, rows = report.cells(record)
    assert len({len(row) for row in (header, *rows)}) == 1
    assert any("verified" in line and "(rendered)" in line for line in report.sentences(record))
    assert any("Schlick, factor of the power" in line for line in report.sentences(record))
    kinds = {kind for _, _, kind in budget.points}
    assert kinds <= {"frontier", "other"}
    frontier = [(cost, error) for cost, error, kind in budget.points if kind == "frontier"]
    assert all(a[1] > b[1] for a, b in itertools.pairwise(frontier))

    first = plots.to_bytes(report.chart(record), ".svg")
    assert first == plots.to_bytes(report.chart(record), ".svg")
    assert b"mathdefault" not in first
    picture = report.pictures(budget)
    assert picture.shape[0] == 3
    assert np.all(np.isfinite(picture))
