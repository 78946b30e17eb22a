"""A factor that is proved to keep the albedo at or below 1, next to the optimum, which touches 1 and rounds to either side."""

from __future__ import annotations

from decimal import ROUND_CEILING, ROUND_FLOOR, Decimal

from brdfcheck.brdf.factors import AbstractFactor, Factor
from brdfcheck.fits.raw import RawAlbedo
from brdfcheck.messages import UsageError
from brdfcheck.proof.certify import certify_family
from brdfcheck.proof.cover import NotProved

_DIGITS = 10
# By how much B is enlarged, at first by the rounding of its digits alone; where the albedo comes that close to 1, a proof of so
# many boxes takes a second at most.
_MARGINS = (0.0, 1e-9, 1e-8, 1e-7, 1e-6)
_BOXES = 1000


def proved_factor(raw: RawAlbedo, factor: AbstractFactor) -> Factor | None:
    """(n+A)/B with constants of 10 digits, near `factor`, whose albedo is proved to be at most 1 on the range of `raw`.

    None for lobes and factors that the theorems do not know, and where none so near is proved.
    """
    if not isinstance(factor, Factor) or float(factor.B) <= 0:
        return None
    offset = float(_rounded(float(factor.A), ROUND_FLOOR))
    for margin in _MARGINS:
        near = Factor(offset, float(_rounded(float(factor.B) * (1 + margin), ROUND_CEILING)))
        try:
            if certify_family(raw.with_factor(near), most=_BOXES):
                return near
        except NotProved:
            continue
        except UsageError:
            return None
    return None


def _rounded(value: float, how: str) -> Decimal:
    """`value` with 10 digits, rounded down or up."""
    exact = Decimal(value)
    return exact if not exact else exact.quantize(Decimal(1).scaleb(exact.adjusted() - _DIGITS + 1), rounding=how)
