"""What is proved, as a small document that anyone can check again: `Certificate`, its words and its JSON."""

from __future__ import annotations

import json
import math
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from brdfcheck import __version__
from brdfcheck.proof.cover import ABOVE, BELOW, Claim, Piece, written
from brdfcheck.proof.intervals import Number, lower, upper
from brdfcheck.proof.lobes import Profile

SCHEMA = "brdfcheck-certificate"
SCHEMA_VERSION = 1
CONSERVES, VIOLATES = "CONSERVES", "VIOLATES"
_DIGITS = 30
Ends = tuple[Fraction, Fraction | None]
"""A range of a parameter; without an upper end, where that is None."""


@dataclass(frozen=True)
class Certificate:
    """A proof that a family of BRDFs conserves energy, or that it does not. True where it conserves.

    `record` is all of it, ready for strict JSON: schema, verdict, statement in words, formula, range, theorems used, boxes as
    exact numbers, versions. ``proof.verify`` checks it again from the numbers alone.
    """

    record: Mapping[str, Any]

    @property
    def verdict(self) -> str:
        """CONSERVES or VIOLATES."""
        return self.record["verdict"]

    @property
    def statement(self) -> str:
        """What is proved, in words."""
        return self.record["statement"]

    def __bool__(self) -> bool:
        return self.verdict == CONSERVES

    def __str__(self) -> str:
        return f"{self.verdict}: {self.statement}"

    def to_json(self) -> str:
        """The certificate as JSON text."""
        return json.dumps(self.record, indent=1, allow_nan=False) + "\n"


def document(verdict: str, statement: str, **content: Any) -> Certificate:
    """A certificate with its schema and versions."""
    head = {"schema": SCHEMA, "schema_version": SCHEMA_VERSION, "verdict": verdict, "statement": statement}
    return Certificate({**head, **content, "versions": {"brdfcheck": __version__, "python": platform.python_version()}})


def bound(value: Fraction | None) -> str:
    """The end of a range as text; None is infinite."""
    return "inf" if value is None else written(value)


def range_record(ranges: Mapping[str, Ends]) -> dict[str, list[str]]:
    """The ranges of parameters in a certificate."""
    return {name: [written(low), bound(high)] for name, (low, high) in ranges.items()}


def over(ranges: Mapping[str, Ends]) -> str:
    """The ranges of parameters in words."""
    parts = [f"every {name} from {low} to {high}" for name, (low, high) in range_record(ranges).items()]
    return " and ".join(parts) or "its parameters"


def of_lobe(claim: Claim, parameter: str, ends: Ends, pieces: Sequence[Piece], point: Fraction | None = None) -> Certificate:
    """The certificate of a lobe with a factor: of its one piece below 1, or that it exceeds 1 at `point`.

    `pieces` then says where else it is above or below.
    """
    brdf = f"{claim.factor.formula} {claim.profile.formula}" if claim.profile.formula else "reflectance/pi"
    parts, more = [], {}
    if point is not None:
        least, most = decimals(claim.albedo(point))
        parts = [f"in [{least}, {most}] for {parameter} = {written(point)} at normal incidence"]
        more = {"point": {parameter: written(point), "albedo": [least, most]}}
        # Where a lobe rises with its angle, normal incidence says nothing of other angles.
        limit = claim.profile.falls_until()
        pieces = [piece for piece in pieces if piece.side == ABOVE or limit == math.inf or piece.nodes[-1] <= limit]
    for piece in pieces:
        last = ends[1] if piece.onwards else piece.nodes[-1]
        place = {BELOW: "every angle of incidence", ABOVE: "normal incidence"}[piece.side]
        parts.append(f"{piece.side} for every {parameter} from {written(piece.nodes[0])} to {bound(last)} at {place}")
    return document(
        CONSERVES if point is None else VIOLATES,
        f"The directional albedo of {brdf} is {'; it is '.join(parts)}.",
        formula=brdf,
        lobe=claim.profile.record,
        factor=claim.factor.record,
        range=range_record({parameter: ends}),
        theorems=["normal incidence", "convex in n"],
        **more,
        cover=[
            {"albedo": piece.side, "nodes": [written(node) for node in piece.nodes], "onwards": piece.onwards}
            for piece in pieces
        ],
    )


def reciprocal(profile: Profile, parameter: str, ends: Ends) -> Certificate:
    """The certificate of a lobe over its own albedo at normal incidence."""
    brdf = f"{profile.formula}, divided by its albedo at normal incidence,"
    return document(
        CONSERVES,
        f"The directional albedo of {brdf} is at most 1 for {over({parameter: ends})} at every angle of incidence, and 1"
        " at normal incidence.",
        formula=brdf,
        lobe=profile.record,
        factor="reciprocal of the albedo",
        range=range_record({parameter: ends}),
        theorems=["normal incidence"],
    )


def decimals(value: Number) -> tuple[str, str]:
    """Two decimal numbers of 30 places around an exact or enclosed one."""
    scale = 10**_DIGITS
    low, high = lower(value) * scale // 1, -(-upper(value) * scale // 1)
    return written(Fraction(low, scale)), written(Fraction(high, scale))
