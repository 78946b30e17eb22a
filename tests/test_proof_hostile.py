"""Functions made to be proved wrongly: what is not so is not proved, whatever the program is written with."""

# pyright: reportArgumentType=false
from __future__ import annotations

from decimal import Decimal, localcontext
from itertools import accumulate

import jax.numpy as jnp
import numpy as np
import pytest

import brdfcheck
from brdfcheck.brdf.subject import as_family
from brdfcheck.messages import UsageError
from brdfcheck.proof import NotProved, certify, intervals
from brdfcheck.proof.functions import _angles
from brdfcheck.proof.hemisphere import Box, Cells, Hemisphere
from brdfcheck.proof.operations import COVERED
from brdfcheck.proof.programs import Program
from brdfcheck.proof.symmetry import symmetry


def bounds(function, place, **ranges):
    """From below and above, at one place: tau and the parameters."""
    made = Program(as_family(function, ranges), COVERED)
    area = Hemisphere(made, symmetry(made))
    at = np.array([place[0], 0.0, *place[1:]])
    found = area.bound(Box(at, at), Cells.start(area.turns))
    return found.low, found.high


def ring(wo):
    """A narrow ring of directions; over pi, its weight in the albedo is 0.0244."""
    return jnp.abs(wo[..., 2] - 0.61) < 1e-2


NARROW = {
    "a condition chosen among constants": lambda wi, wo: jnp.where(jnp.where(ring(wo), True, False), 100.0, 0.1),
    "a condition beside a constant": lambda wi, wo: jnp.where(jnp.stack([ring(wo), jnp.ones_like(ring(wo))])[0], 100.0, 0.1),
    "the larger of two conditions": lambda wi, wo: jnp.where(jnp.maximum(ring(wo), wi[..., 2] > 2), 100.0, 0.1),
    "conditions compared": lambda wi, wo: jnp.where(ring(wo) > (wi[..., 2] > 2), 100.0, 0.1),
    "1/0 in the ring": lambda wi, wo: jnp.clip(1 / jnp.minimum(1e-2 - jnp.abs(wo[..., 2] - 0.61), 0), 0.1, 100.0),
    "1/-0 in the ring": lambda wi, wo: jnp.clip(-1 / -jnp.minimum(1e-2 - jnp.abs(wo[..., 2] - 0.61), 0), 0.1, 100.0),
    "a condition as a number": lambda wi, wo: 0.1 + 99.9 * ring(wo).astype(wo.dtype),
    "a condition as a number, and back": lambda wi, wo: jnp.where(ring(wo).astype(wo.dtype) > 0.5, 100.0, 0.1),
}


@pytest.mark.parametrize("name", NARROW)
def test_a_condition_that_no_cell_decides_may_hold(name):
    """The albedo is 0.1 pi + 0.0244 pi 99.9 = 7.98, from a ring that is narrower than the cells."""
    exact = np.pi * (0.1 + 99.9 * (0.62**2 - 0.60**2))
    low, high = bounds(NARROW[name], (0.5,))
    assert low <= exact <= high


def test_whole_numbers_as_exponents_of_negative_bases():
    """(-1.5 - N.L)^n has no value but for whole n: 6.25 for n = 2 along the normal, and the range holds 2."""

    def sometimes(wi, wo, n):
        return jnp.power(-1.5 - wi[..., 2], n) + 0 * wo[..., 2]

    for place in ((0.0, 2.0), (0.0, 3.0), (0.5, 2.0)):
        base = -1.5 - np.cos(place[0] * np.pi / 2)
        low, high = bounds(sometimes, place, n=(1.5, 3.5))
        assert low <= np.pi * base ** place[1] <= high
    with pytest.raises(NotProved):
        certify(sometimes, seconds=1, n=(1.5, 2.5))


@pytest.mark.parametrize("power", [0, 0.0])
def test_a_power_of_zero_keeps_its_shape(power):
    assert certify(lambda wi, wo: 0.1 * (wi**power)[..., 2] + 0 * wo[..., 2])


@pytest.mark.parametrize("cosine", ["0.9999999999", "0.99999999999999", "0.3"])
def test_angles_hold_the_decimals_that_are_meant(cosine):
    """Against 50 digits: near 1 a cosine's last digit moves the angle by far more than an angle's last digit."""
    with localcontext() as context:
        context.prec = 50
        pi = Decimal(intervals.pi().low) / 2**intervals.BITS

        def cos(angle):
            x = Decimal(angle) * pi / 2
            terms = accumulate(range(1, 60), lambda term, k: -term * x * x / ((2 * k - 1) * (2 * k)), initial=Decimal(1))
            return sum(terms)

        (outer, _), (inner, _) = _angles((0.0, float(cosine)))
        assert cos(inner) <= Decimal(cosine) <= cos(outer)


def test_constants_are_read_in_double_precision():
    """In single precision B would be the nearest number to 2 pi, and taken to be it."""

    def false(n):
        return brdfcheck.Normalized(brdfcheck.Phong(n), brdfcheck.Factor(2.0, 2 * np.pi * (1 - 1e-9)))

    assert not certify(false, n=(1, 5))
    assert certify(lambda n: brdfcheck.Normalized(brdfcheck.Phong(n), brdfcheck.Factor(2.0, 2 * np.pi)), n=(1, 5))
    with pytest.raises(UsageError, match="add up to at most 1"):
        certify(lambda: brdfcheck.Mixture([brdfcheck.Lambert(1.0)] * 2, [0.5, 0.5 + 1e-9]), seconds=0)
