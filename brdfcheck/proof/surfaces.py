r"""Certificates of what transmits: R + T of sheets, panes and boundaries, by theorems that hold for all their parameters.

What is left to check is that parameters are in their domains. Each field of a surface is a polynomial in the family's
parameters, with exact coefficients (`fields`); where each parameter is in it by its first power at most, its extremes over a
box are at corners.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from brdfcheck.brdf.family import Family
from brdfcheck.brdf.transmission import LambertTransmission, RoughDielectric, SmoothDielectric, ThinSheet
from brdfcheck.brdf.two_sides import BELOW
from brdfcheck.proof.certificate import CONSERVES, VIOLATES, Certificate, bound, document
from brdfcheck.proof.cover import NotProved, written
from brdfcheck.proof.operations import COVERED
from brdfcheck.proof.programs import Program
from brdfcheck.proof.reading import Unknown, exact
from brdfcheck.proof.symmetry import polynomials

Ends = tuple[Fraction, Fraction | None]
Terms = Mapping[str, str]
"""A polynomial: coefficients by products of parameters, such as "albedo*through"."""

KIND = "surface"
# The least and the largest value of each field; least values of None are left out, and infinite largest ones are no bound.
_POSITIVE, _SHARE = (None, math.inf), (0, 1)
_DOMAINS: dict[str, dict[str, tuple[int | None, float]]] = {
    "matte sheet": {"reflectance": (0, math.inf), "transmittance": (0, math.inf)},
    "clear pane": {"index": _POSITIVE, "transmittance": _SHARE},
    "smooth boundary": {"eta": _POSITIVE},
    "rough boundary, Beckmann's D": {"alpha": _POSITIVE, "eta": _POSITIVE},
    "rough boundary, GGX's D": {"alpha": _POSITIVE, "eta": _POSITIVE},
}


def _name(surface: Any) -> str | None:
    if type(surface) is RoughDielectric:
        return f"rough boundary, {'GGX' if surface.distribution == 'ggx' else 'Beckmann'}'s D"
    names = {LambertTransmission: "matte sheet", ThinSheet: "clear pane", SmoothDielectric: "smooth boundary"}
    return names.get(type(surface))


def record_of(family: Family) -> dict[str, Any]:
    """The plain record of a family of surfaces of this package. Unknown for anything else."""
    build: Any = family.surface
    ranges = {name: bounds for name, bounds in family.ranges.items() if name != BELOW}
    first = build(**{name: low for name, (low, _) in ranges.items()})
    name = _name(first)
    if name is None:
        raise Unknown(f"{family.name} transmits, and is no surface that certify knows")

    def terms(field: str) -> Terms:
        if np.ndim(getattr(first, field)):
            raise Unknown(f"{family.name}: for a proof by theorem the {field} must be one number")
        if not ranges:
            return {"": written(exact(getattr(first, field), field))}

        def values(**parameters: Any) -> Any:
            surface = build(**parameters)
            if _name(surface) != name:
                raise Unknown(f"{family.name} is not always the same kind of surface")
            return lambda wi, wo: getattr(surface, field) + 0 * wi[..., 2]

        program = Program(dataclasses.replace(family, build=values, ranges=ranges, surface=None, switches=frozenset()), COVERED)
        found = polynomials(program)
        if found is None or len(found) != 1:
            raise Unknown(f"{family.name}: {field} is no polynomial in its parameters for a proof")
        return {"*".join(names): written(value) for names, value in sorted(found[0].items())}

    return {"kind": KIND, "surface": name, "fields": {field: terms(field) for field in _DOMAINS[name]}}


def certificate(lobe: Mapping[str, Any], ranges: Mapping[str, Ends]) -> Certificate:
    """The certificate of a surface from its record, over `ranges` of its parameters. NotProved where one leaves its domain."""
    name, fields = lobe["surface"], lobe["fields"]
    if set(fields) != set(_DOMAINS[name]):
        raise NotProved(f"the fields of a {name} are {', '.join(_DOMAINS[name])}")
    for field, (least, most) in _DOMAINS[name].items():
        values = [value for _, value in _corners(field, [fields[field]], ranges)]
        if (min(values) <= 0 if least is None else min(values) < least) or max(values) > most:
            domain = "> 0" if least is None else ">= 0" if most == math.inf else "from 0 to 1"
            raise NotProved(f"the {field} of a {name} must be {domain}")
    formula = f"R + T of a {name} with " + ", ".join(f"{field} = {_words(terms)}" for field, terms in fields.items())
    over = " and ".join(f"every {key} from {written(low)} to {bound(high)}" for key, (low, high) in ranges.items())
    content: dict[str, Any] = {
        "formula": formula,
        "lobe": {**lobe, "fields": {field: dict(terms) for field, terms in fields.items()}},
        "range": {key: [written(low), bound(high)] for key, (low, high) in ranges.items()},
        "theorems": ["what is not reflected is transmitted, or lost"],
    }
    if name == "matte sheet":
        place, energy = max(_corners("energy", list(fields.values()), ranges), key=lambda found: found[1])
        if energy > 1:
            spot = {key: written(value) for key, value in place.items()}
            where = " and ".join(f"{key} = {value}" for key, value in spot.items()) or "its parameters"
            statement = f"The energy {formula} is {written(energy)} for {where} at every angle of incidence, from both sides."
            return document(VIOLATES, statement, **content, point={**spot, "albedo": [written(energy)] * 2})
    statement = (
        f"The energy {formula} is at most 1 for {over or 'its parameters'} at every angle of incidence, from both sides."
    )
    return document(CONSERVES, statement, **content)


def _words(terms: Terms) -> str:
    parts = [f"{value}*{names}".removesuffix("*").replace("1*", "", value in ("1", "-1")) for names, value in terms.items()]
    return " + ".join(parts).replace("+ -", "- ") or "0"


def _corners(field: str, sums: Sequence[Terms], ranges: Mapping[str, Ends]) -> list[tuple[dict[str, Fraction], Fraction]]:
    """The corners of the box of the parameters that are in a sum of polynomials, with its values there."""
    total: dict[str, Fraction] = {}
    for terms in sums:
        for names, value in terms.items():
            total[names] = total.get(names, Fraction(0)) + Fraction(value)
    total = {names: value for names, value in total.items() if value}
    used = [names.split("*") if names else [] for names in total]
    if any(len(set(names)) < len(names) for names in used):
        raise Unknown(f"the {field} holds a power of a parameter")
    axes = [key for key in ranges if any(key in names for names in used)]
    if any(ranges[key][1] is None for key in axes):
        raise Unknown(f"the range of {axes[0]} must be finite")
    found = []
    for corner in itertools.product(*(ranges[key] for key in axes)):
        place: dict[str, Any] = dict(zip(axes, corner, strict=True))
        parts = (math.prod((place[key] for key in names.split("*") if key), start=value) for names, value in total.items())
        value = sum(parts, Fraction(0))
        found.append((place, value))
    return found
