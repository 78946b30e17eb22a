"""Polynomials in a family's parameters, with exact coefficients, and their extremes over boxes, which are at corners."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from typing import Any

from brdfcheck.brdf.family import Family
from brdfcheck.proof.certificate import Ends
from brdfcheck.proof.cover import written
from brdfcheck.proof.operations import COVERED
from brdfcheck.proof.programs import Program
from brdfcheck.proof.reading import Unknown
from brdfcheck.proof.symmetry import polynomials

Terms = Mapping[str, str]
"""A polynomial: coefficients by products of parameters, such as "albedo*through"."""


def terms_of(family: Family, what: str, values: Callable[[Any], Any]) -> list[Terms]:
    """What `values` takes from each member of a family, as polynomials in its parameters. Unknown where it is none."""

    def build(**parameters: Any) -> Any:
        made = values(family.build(**parameters))
        return lambda wi, wo: made + 0 * wi[..., 2:]

    plain = dataclasses.replace(family, build=build, surface=None, switches=frozenset())
    found = polynomials(Program(plain, COVERED))
    if found is None:
        raise Unknown(f"{family.name}: {what} is no polynomial in its parameters for a proof")
    return [{"*".join(names): written(value) for names, value in sorted(poly.items())} for poly in found]


def words(terms: Terms) -> str:
    """A polynomial as text."""
    parts = [f"{value}*{names}".removesuffix("*").replace("1*", "", value in ("1", "-1")) for names, value in terms.items()]
    return " + ".join(parts).replace("+ -", "- ") or "0"


def corners(what: str, sums: Sequence[Terms], ranges: Mapping[str, Ends]) -> list[tuple[dict[str, Fraction], Fraction]]:
    """The corners of the box of the parameters that are in a sum of polynomials, and its values there.

    Unknown where a parameter is in it by a higher power than the first, so that extremes may be elsewhere, or has no largest
    value.
    """
    total: dict[str, Fraction] = {}
    for terms in sums:
        for names, value in terms.items():
            total[names] = total.get(names, Fraction(0)) + Fraction(value)
    total = {names: value for names, value in total.items() if value}
    used = [names.split("*") if names else [] for names in total]
    if any(len(set(names)) < len(names) for names in used):
        raise Unknown(f"the {what} holds a power of a parameter")
    axes = [key for key in ranges if any(key in names for names in used)]
    if any(ranges[key][1] is None for key in axes):
        raise Unknown(f"the range of {axes[0]} must be finite")
    found = []
    for corner in itertools.product(*(ranges[key] for key in axes)):
        place: dict[str, Any] = dict(zip(axes, corner, strict=True))
        parts = (math.prod((place[key] for key in names.split("*") if key), start=value) for names, value in total.items())
        found.append((place, sum(parts, Fraction(0))))
    return found
