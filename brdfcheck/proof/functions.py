"""Certificates of functions: a user's f(wi, wo) in JAX or GLSL, or any BRDF of this package whose formula no theorem knows."""

from __future__ import annotations

import hashlib
import itertools
import math
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

import numpy as np

from brdfcheck.brdf.family import Family
from brdfcheck.brdf.tables import table_in
from brdfcheck.messages import UsageError
from brdfcheck.proof.certificate import CONSERVES, VIOLATES, Certificate, document
from brdfcheck.proof.cover import NotProved, written
from brdfcheck.proof.hemisphere import Box, Hemisphere
from brdfcheck.proof.operations import COVERED
from brdfcheck.proof.programs import Program, Uncovered
from brdfcheck.proof.search import Found, Search
from brdfcheck.proof.symmetry import symmetry

KIND = "program"
_SYMMETRIES = {
    "mirror": "it depends on the directions by what turns about N and reflections leave as it is",
    "turn": "it depends on the directions by what turns about N leave as it is",
    "none": "the azimuth of the light is one of the variables",
}
_ASSUMES = [
    "IEEE 754 arithmetic, rounded to nearest; every end is moved outwards by 2^-51 of itself",
    "exp, log, power, sin, cos, tanh, arctan, arcsin and erf of numpy and scipy are right to 2^-48",
    "the program is the formula that JAX traces in double precision, in real numbers; what is undefined counts as 0",
]


def certificate(family: Family, seconds: float, watch: Callable[[float, float], None] | None = None) -> Certificate:
    """The certificate of a family whose functions JAX can trace, found in about so many seconds.

    `watch` is called with the largest bound of all boxes and with the part of the ranges that is proved.
    UsageError for what JAX cannot trace and for primitives that are not covered, which are named; NotProved, with what is
    proved all the same, where time is up.
    """
    if not family.ranges and table_in(family.build()) is not None:
        raise UsageError(
            f"{family.name} is a table: nothing is proved between its samples; brdfcheck check has them in its error bar"
        )
    try:
        program = Program(family, COVERED)
    except SystemExit:
        raise UsageError(f"{family.name} ends the process while JAX traces it") from None
    except Uncovered as error:
        raise Uncovered(f"{family.name}: {error}") from None
    kind = symmetry(program)
    found = Search(Hemisphere(program, kind), *_boxes(family, kind == "none"), seconds, watch).run()
    return _document(family, program, kind, found)


def again(record: Mapping[str, Any], family: Family) -> Certificate:
    """The certificate of a family that the boxes of this record, or its point, prove. NotProved where they do not."""
    program = Program(family, COVERED)
    if record["lobe"]["sha256 of its jaxpr"] != _digest(program):
        raise NotProved(f"{family.name} is another program, or this version of JAX traces it otherwise")
    kind = symmetry(program)
    outer, inner = _boxes(family, kind == "none")
    search = Search(Hemisphere(program, kind), outer, inner, math.inf)
    if record["verdict"] == CONSERVES:
        if not search.covered(record["boxes"]):
            raise NotProved("the albedo is not shown to be at most 1 on all of its boxes")
        return _document(family, program, kind, Found(1.0, 1.0, 0, 0.0, cuts=tuple(record["boxes"])))
    stated, angles = record["point"], {"theta in degrees": 90, "phi in degrees": 180}
    place = [Fraction(stated.get(name, 0)) / full for name, full in angles.items()]
    point = np.array([*place, *(Fraction(stated[name]) for name in family.ranges)], float)
    least = Fraction(stated["albedo at least"])
    if not any(np.all((box.low <= point) & (point <= box.high)) for box in inner) or not search.at(point) >= least > 1:
        raise NotProved(f"at its point the albedo is not shown to be at least {written(least)}")
    return _document(family, program, kind, Found(math.inf, 0.0, 0, 0.0, point, least))


def _document(family: Family, program: Program, kind: str, found: Found) -> Certificate:
    """What was found as a certificate; NotProved where it is neither a proof nor a point above 1."""
    formula = f"the program of {family.name} ({len(program.steps)} operations)"
    shown = [(name, *(written(Fraction(end)) for end in ends)) for name, ends in _shown(family)]
    where = " and ".join(
        f"every {name} from {first} to {last}" if first != last else f"{name} = {first}" for name, first, last in shown
    )
    low, high = (Fraction(str(float(end))) for end in family.cos_theta)
    angles = "every angle of incidence" if (low, high) == (0, 1) else f"every cos(theta) from {written(low)} to {written(high)}"
    covered = f"{where} at {angles}" if where else angles
    if found.point is None and found.high > 1:
        raise NotProved(_so_far(found, covered))
    content = {
        "formula": formula,
        "lobe": {
            "kind": KIND,
            "name": family.name,
            "operations": len(program.steps),
            "sha256 of its jaxpr": _digest(program),
            "symmetry": _SYMMETRIES[kind],
        },
        "range": {
            **{name: [first, last] for name, first, last in shown},
            "cos_theta": [written(low), written(high)],
        },
        "theorems": ["mean values on cells of the hemisphere"],
        "assumes": list(_ASSUMES),
    }
    if found.point is None:
        content["boxes"] = list(found.cuts)
        return document(CONSERVES, f"The directional albedo of {formula} is at most 1 for {covered}.", **content)
    place = _place(family, found.point, kind == "none")
    least = written(Fraction(math.floor(Fraction(found.low) * 10**12), 10**12))
    if Fraction(least) <= 1:
        least = written(Fraction(found.low))
    spots = " and ".join(f"{name} = {value}" for name, value in place.items())
    return document(
        VIOLATES,
        f"The directional albedo of {formula} is at least {least} for {spots}.",
        **content,
        point={**place, "albedo at least": least},
    )


def _digest(program: Program) -> str:
    return hashlib.sha256(program.text.encode()).hexdigest()


def _shown(family: Family) -> list[tuple[str, tuple[str, str]]]:
    """The ranges of parameters, held ones included, as the decimals that they are written as."""
    ranges: Mapping[str, Any] = {**{name: (value, value) for name, value in family.held.items()}, **family.ranges}
    return [(name, (str(float(low)), str(float(high)))) for name, (low, high) in ranges.items()]


def _so_far(found: Found, covered: str) -> str:
    """What is proved where time was not enough."""
    spent = f"after {found.seconds:.0f} s and {found.boxes} boxes"
    if not math.isfinite(found.high):
        return (
            f"{spent} no bound is proved for {covered}: somewhere the arithmetic cannot tell that the BRDF is finite, mostly"
            f" where it is divided by a cosine that may be 0; at most 1 is proved on {_percent(found.proved)} % of the box"
        )
    least = f"{math.ceil(found.high * 1e4) / 1e4:.4f}" if found.high < 1e3 else f"{1.01 * found.high:.2g}"
    part = f"at most 1 on {_percent(found.proved)} % of the box"
    return f"{spent} the albedo is proved to be at most {least} for {covered}, and {part}"


def _percent(part: float) -> str:
    return f"{math.floor(1000 * part) / 10:g}"


def _ends(low: float, high: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """A range of decimals in floating point: all of it, and what is surely in it (or nearest to it, where nothing is)."""
    outer, inner = [], []
    for value, away in ((low, -np.inf), (high, np.inf)):
        rest = Fraction(float(value)) - Fraction(str(float(value)))
        outwards = rest * (1 if away > 0 else -1) >= 0
        outer.append(float(value) if outwards else float(np.nextafter(value, away)))
        inner.append(float(value) if rest == 0 or not outwards else float(np.nextafter(value, -away)))
    return (outer[0], outer[1]), ((inner[0], inner[1]) if inner[0] <= inner[1] else (float(low), float(low)))


def _angles(cosines: tuple[float, float]) -> tuple[tuple[float, float], tuple[float, float]]:
    """The angles of incidence over 90 degrees: all of them, and those that are surely meant."""
    ends = [math.acos(end) / (math.pi / 2) for end in reversed(cosines)]
    # What a cosine may be off as a decimal, by the slope of acos there; acos itself is right to far less.
    slack = [0.0 if x in (0, 1) else 1e-12 + 2.0**-52 / math.sqrt((1 - x) * (1 + x)) for x in reversed(cosines)]
    outer = max(0.0, ends[0] - slack[0]), min(1.0, ends[1] + slack[1])
    inner = ends[0] + slack[0], ends[1] - slack[1]
    return outer, inner if inner[0] <= inner[1] else (ends[0], ends[0])


def _boxes(family: Family, azimuth: bool) -> tuple[list[Box], list[Box]]:
    """The ranges as boxes of tau, the azimuth of the light and the parameters, one for each setting of the switches: all of
    them, and what is surely in them."""
    turn = (0.0, 2.0 * azimuth)
    choices = [[_angles(family.cos_theta)], [(turn, turn)]]
    for name, (first, last) in family.ranges.items():
        switch = name in family.switches and first < last
        single = [((first, first), (first, first)), ((last, last), (last, last))]
        choices.append(single if switch else [_ends(first, last)])
    settings = list(itertools.product(*choices))
    outer, inner = (
        [Box(*np.array([pair[side] for pair in setting], float).T.copy()) for setting in settings] for side in (0, 1)
    )
    return outer, inner


def _place(family: Family, point: np.ndarray, azimuth: bool) -> dict[str, str]:
    """A point as exact numbers: parameters, and angles in degrees."""
    theta, phi, *values = (Fraction(float(value)) for value in point)
    place = {name: written(value) for name, value in zip(family.ranges, values, strict=True)}
    return {**place, "theta in degrees": written(90 * theta), **({"phi in degrees": written(180 * phi)} if azimuth else {})}
