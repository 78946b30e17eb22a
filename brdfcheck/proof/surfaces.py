r"""Certificates of what transmits: R + T of sheets, panes and boundaries, by theorems that hold for all their parameters.

What is left to check is that parameters are in their domains: each field of a surface is a polynomial in the family's
parameters (`terms`).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from brdfcheck.brdf.family import Family
from brdfcheck.brdf.transmission import LambertTransmission, RoughDielectric, SmoothDielectric, ThinSheet
from brdfcheck.brdf.two_sides import BELOW
from brdfcheck.proof.certificate import CONSERVES, VIOLATES, Certificate, Ends, document, over, range_record
from brdfcheck.proof.cover import NotProved, written
from brdfcheck.proof.reading import Unknown, exact
from brdfcheck.proof.terms import Terms, corners, terms_of, words

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

        def value(surface: Any) -> Any:
            if _name(surface) != name:
                raise Unknown(f"{family.name} is not always the same kind of surface")
            return getattr(surface, field)

        return terms_of(dataclasses.replace(family, build=build, ranges=ranges), field, value)[0]

    return {"kind": KIND, "surface": name, "fields": {field: terms(field) for field in _DOMAINS[name]}}


def certificate(lobe: Mapping[str, Any], ranges: Mapping[str, Ends]) -> Certificate:
    """The certificate of a surface from its record, over `ranges` of its parameters. NotProved where one leaves its domain."""
    name, fields = lobe["surface"], lobe["fields"]
    if set(fields) != set(_DOMAINS[name]):
        raise NotProved(f"the fields of a {name} are {', '.join(_DOMAINS[name])}")
    for field, (least, most) in _DOMAINS[name].items():
        values = [value for _, value in corners(field, [fields[field]], ranges)]
        if (min(values) <= 0 if least is None else min(values) < least) or max(values) > most:
            domain = "> 0" if least is None else ">= 0" if most == math.inf else "from 0 to 1"
            raise NotProved(f"the {field} of a {name} must be {domain}")
    formula = f"R + T of a {name} with " + ", ".join(f"{field} = {words(terms)}" for field, terms in fields.items())
    content: dict[str, Any] = {
        "formula": formula,
        "lobe": {**lobe, "fields": {field: dict(terms) for field, terms in fields.items()}},
        "range": range_record(ranges),
        "theorems": ["what is not reflected is transmitted, or lost"],
    }
    if name == "matte sheet":
        place, energy = max(corners("energy", list(fields.values()), ranges), key=lambda found: found[1])
        if energy > 1:
            spot = {key: written(value) for key, value in place.items()}
            where = " and ".join(f"{key} = {value}" for key, value in spot.items()) or "its parameters"
            statement = f"The energy {formula} is {written(energy)} for {where} at every angle of incidence, from both sides."
            return document(VIOLATES, statement, **content, point={**spot, "albedo": [written(energy)] * 2})
    statement = f"The energy {formula} is at most 1 for {over(ranges)} at every angle of incidence, from both sides."
    return document(CONSERVES, statement, **content)
