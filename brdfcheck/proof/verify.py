"""A certificate checked again: its boxes one by one, and everything else made anew from its numbers and compared."""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Mapping
from fractions import Fraction
from typing import Any

from brdfcheck.brdf.readers.base import Reading
from brdfcheck.brdf.subject import as_target
from brdfcheck.messages import UsageError, one_line
from brdfcheck.proof import facets, functions, mixtures, surfaces
from brdfcheck.proof.certificate import CONSERVES, SCHEMA, SCHEMA_VERSION, Certificate, Ends, of_lobe, reciprocal
from brdfcheck.proof.cover import ABOVE, BELOW, Claim, LinearFactor, NotProved, Piece
from brdfcheck.proof.lobes import KINDS, Profile

_EXPONENT = re.compile(r"[^a-z]*\d[eE][-+]?\d+\s*")


class Rejected(ValueError):
    """A certificate that does not prove what it states. One line that says why."""


def read(text: str) -> Certificate:
    """The certificate in a JSON text. Rejected where it is none."""
    try:
        record = json.loads(text, object_pairs_hook=_once)
    except Rejected:
        raise
    except (ValueError, RecursionError) as error:
        raise Rejected(f"it is not JSON: {one_line(error)}") from None
    if not isinstance(record, dict) or record.get("schema") != SCHEMA:
        raise Rejected(f"it is not a certificate: its schema is not {SCHEMA!r}")
    if record.get("schema_version") != SCHEMA_VERSION:
        raise Rejected(f"its schema version must be {SCHEMA_VERSION}; got {one_line(record.get('schema_version'))}")
    return Certificate(record)


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object. Rejected where a name is in it twice: other readers may take the other value."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise Rejected("a name is there twice in one object")
    return found


def verify(certificate: Certificate, target: Any = None, reading: Reading | None = None) -> None:
    """Check a certificate again, believing nothing in it but its versions. Rejected where it does not prove its statement.

    `target`, `reading`: what a certificate of a program is of, as for `brdfcheck.certify`; the ranges are its own. Of lobes,
    facets and their sums the certificate says all that is needed. Raises UsageError for a target that cannot be read.
    """
    record = certificate.record
    _refuse_exponents(record)
    try:
        again = _proved(record) if target is None else _of_program(record, target, reading)
    except Rejected:
        raise
    except UsageError as error:
        if target is not None:
            raise
        raise Rejected(f"it is damaged: {one_line(error)}") from None
    except NotProved as error:
        raise Rejected(str(error)) from None
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        raise Rejected(f"it is damaged: {type(error).__name__}: {one_line(error)}") from None
    for key in dict.fromkeys((*record, *again.record)):
        if key != "versions" and _text(record.get(key)) != _text(again.record.get(key)):
            raise Rejected(f"{key} is not what its numbers prove: {one_line(again.record.get(key))}")


def _text(value: Any) -> str:
    """As JSON, which tells 1 from true and 1.0."""
    return json.dumps(value, sort_keys=True)


def _refuse_exponents(value: Any) -> None:
    """Rejected where a number has an exponent: no certificate has one, and 1e999999999 would fill the memory."""
    for part in value.values() if isinstance(value, Mapping) else value if isinstance(value, list) else ():
        if isinstance(part, str) and _EXPONENT.fullmatch(part):
            raise Rejected(f"numbers are decimals or quotients, without exponents; got {one_line(part)!r}")
        _refuse_exponents(part)


def _proved(record: Mapping[str, Any]) -> Certificate:
    """The certificate that the numbers of this one prove. Rejected where they prove none."""
    if record["lobe"]["kind"] == functions.KIND:
        raise Rejected("it is of a program, which must be given too: brdfcheck certify FILE.py:OBJECT --verify CERTIFICATE")
    if record["lobe"]["kind"] in mixtures.KINDS:
        for part in record["parts"]:
            verify(Certificate(part))
        return mixtures.assembled(record["lobe"], record["parts"], _ranges(record))
    if record["lobe"]["kind"] == surfaces.KIND:
        return surfaces.certificate(record["lobe"], _ranges(record))
    if record["lobe"]["kind"] not in KINDS:
        return facets.certificate(record["lobe"], _ranges(record), Fraction(record.get("point", {}).get("cos_theta", 0)))
    ((parameter, ends),) = _ranges(record).items()
    low, high = ends
    if low < 0 or (high is not None and high < low):
        first, last = record["range"][parameter]
        raise Rejected(f"{parameter} must run over numbers >= 0, from the lower to the upper end; got {first} to {last}")
    lobe = dict(record["lobe"])
    profile: Profile = KINDS[lobe.pop("kind")](**lobe)
    if (parameter == "reflectance") != (profile.record["kind"] == "constant") or parameter not in ("reflectance", "n"):
        raise Rejected(f"{one_line(parameter)} is not the parameter of this lobe")
    if record["verdict"] == CONSERVES and profile.falls_until() < (float("inf") if high is None else high):
        raise Rejected("the lobe rises with its angle: the theorem on normal incidence does not apply")
    if isinstance(record["factor"], str):
        return reciprocal(profile, parameter, ends)
    claim = Claim(profile, LinearFactor.of(record["factor"]))
    if profile.record["kind"] == "constant" and claim.factor != LinearFactor(Fraction(0), power=1):
        raise Rejected("the factor of Lambert's lobe is the reflectance over pi")
    pieces = [
        Piece(part["albedo"], tuple(Fraction(node) for node in part["nodes"]), part["onwards"]) for part in record["cover"]
    ]
    for piece in pieces:
        _check(claim, piece, low, high)
    if record["verdict"] != CONSERVES:
        point = Fraction(record["point"][parameter])
        if not low <= point or (high is not None and point > high) or claim.side(point) != ABOVE:
            raise Rejected(f"at {parameter} = {point} the albedo is not above 1, or {parameter} is out of range")
        return of_lobe(claim, parameter, ends, pieces, point)
    (piece,) = pieces
    if piece.side != BELOW or piece.nodes[0] != low or not (piece.onwards or piece.nodes[-1] == high):
        raise Rejected("its boxes do not cover the range")
    return of_lobe(claim, parameter, ends, pieces)


def _of_program(record: Mapping[str, Any], target: Any, reading: Reading | None) -> Certificate:
    """The certificate that the boxes or the point of this one prove of this program. Rejected where they prove none."""
    if record["lobe"]["kind"] != functions.KIND:
        raise Rejected("it is not of a program: it is checked without one")
    ranges = {name: (float(low), float(high)) for name, (low, high) in record["range"].items()}
    cosines = ranges.pop("cos_theta")
    subject = as_target(target, ranges, cosines, reading)
    if subject.finding is not None:
        raise UsageError(subject.finding)
    return functions.again(record, subject.family)


def _ranges(record: Mapping[str, Any]) -> dict[str, Ends]:
    return {name: (Fraction(low), None if high == "inf" else Fraction(high)) for name, (low, high) in record["range"].items()}


def _check(claim: Claim, piece: Piece, low: Fraction, high: Fraction | None) -> None:
    """Rejected where the albedo is not shown to be on the piece's side of 1."""
    nodes = piece.nodes
    if type(piece.onwards) is not bool:
        raise Rejected(f"onwards is true or false; got {one_line(piece.onwards)}")
    if piece.side not in (BELOW, ABOVE):
        raise Rejected(f"an albedo is {BELOW} or {ABOVE}; got {one_line(piece.side)}")
    if low > nodes[0] or (high is not None and nodes[-1] > high and not piece.onwards):
        raise Rejected(f"its boxes leave the range at {nodes[0]} or {nodes[-1]}")
    test = claim.below if piece.side == BELOW else claim.above
    boxes = list(itertools.pairwise(nodes))
    if claim.side(nodes[0]) != piece.side or not all(a < b and test(a, b) for a, b in boxes):
        raise Rejected(f"the albedo is not shown to be {piece.side} on all boxes from {nodes[0]} to {nodes[-1]}")
    if piece.onwards and (piece.side == ABOVE or not claim.onwards(nodes[-1])):
        raise Rejected(f"the albedo is not shown to be {piece.side} from {nodes[-1]} on")
