r"""The MERL BRDF database: ``NAME.binary``, isotropic, RGB (Matusik, Pfister, Brand & McMillan 2003).

Three 32-bit integers, 90, 90, 180, then as many 64-bit floats for each of R, G and B, all little-endian. The bins: of the
angle $\theta_h$ between the normal and the half vector, even in $\sqrt{\theta_h}$; of the angle $\theta_d$ between the half
vector and the light, even; of the azimuth $\phi_d$ of the light about the half vector, even in $[0, \pi)$, for f is the same
half a turn away (reciprocity). The values are in units of 1/1500, 1.15/1500 and 1.66/1500 per steradian. A negative number
says that there are no data.

A sample stands for its bin, so that it lies in its middle: half a bin from where its index is reached.
"""

from __future__ import annotations

import dataclasses
import math
from typing import final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck import geometry
from brdfcheck.brdf.readers.tables.file import AbstractTableFile, mistake
from brdfcheck.brdf.tables import AbstractTable, Samples, bracket, looked_up

SHAPE = (90, 90, 180)
"""Bins of theta_h, theta_d and phi_d."""
SCALE = (1 / 1500, 1.15 / 1500, 1.66 / 1500)
"""What the numbers of R, G and B are multiplied by, in 1/sr."""
_HEADER = 12
_QUARTER = np.pi / 2
_LAYOUT = "MERL: 90 x 90 x 180 bins of half and difference angle, R, G and B"
_GUESS = "the largest value at their half angle"


def half_and_difference(wi: Array, wo: Array) -> tuple[Array, Array, Array]:
    """theta_h, theta_d in [0, pi/2] and phi_d in (-pi, pi] of directions (..., 3): Rusinkiewicz's coordinates (1998)."""
    h, d = wi + wo, wi - wo
    length = jnp.sqrt(jnp.sum(h * h, axis=-1))
    # Opposite directions have no half vector; both lie on the horizon then, where nothing is reflected.
    safe = jnp.where(length > 0, length, 1)
    x, y, z = (jnp.where(length > 0, h[..., i] / safe, (0.0, 0.0, 1.0)[i]) for i in range(3))
    sine = jnp.sqrt(x * x + y * y)
    theta_d = jnp.arctan2(jnp.sqrt(jnp.sum(d * d, axis=-1)), length)
    # The light along the two axes across the half vector (times sine, which is no matter for an azimuth). Where the half
    # vector is the normal the azimuth is that of the light.
    along = z * (wi[..., 0] * x + wi[..., 1] * y) - sine * sine * wi[..., 2]
    across = wi[..., 1] * x - wi[..., 0] * y
    upright = sine == 0
    phi_d = jnp.arctan2(jnp.where(upright, wi[..., 1], across), jnp.where(upright, wi[..., 0], along))
    return jnp.arctan2(sine, z), theta_d, phi_d


@final
class Merl(AbstractTable):
    """A file of the MERL database. `values`: (bins, 3) in 1/sr, negative where there are no data."""

    values: Float[Array | np.ndarray, "bins 3"]
    nearest: bool = eqx.field(static=True)
    samples: Samples = eqx.field(static=True)

    def filled(self) -> Merl | None:
        if not self.samples.missing:
            return None
        values = np.asarray(self.values).reshape(SHAPE[0], -1, 3)
        highest = values.max(axis=1)
        # Of a row without any data the row before it, or else the first one that has some.
        known = np.where(highest >= 0, np.arange(SHAPE[0])[:, None], 0)
        first = np.argmax(highest >= 0, axis=0)
        guess = np.take_along_axis(highest, np.maximum(np.maximum.accumulate(known, axis=0), first), axis=0)
        return dataclasses.replace(self, values=np.where(values < 0, guess[:, None], values).reshape(-1, 3))

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "... 3"]:
        """f in 1/sr for R, G and B; 0 where a direction lies below the surface, and where there are no data."""
        wi, wo = jnp.broadcast_arrays(jnp.asarray(wi), jnp.asarray(wo))
        theta_h, theta_d, phi_d = half_and_difference(wi, wo)
        places = (
            SHAPE[0] * jnp.sqrt(theta_h / _QUARTER) - 0.5,
            SHAPE[1] * (theta_d / _QUARTER) - 0.5,
            SHAPE[2] * (phi_d / np.pi) - 0.5,
        )
        brackets = [
            bracket(place, count, nearest=self.nearest, periodic=axis == 2)
            for axis, (place, count) in enumerate(zip(places, SHAPE, strict=True))
        ]
        found = looked_up(self.values, SHAPE, brackets, wi.dtype)
        return jnp.where(geometry.above_horizon(wi, wo)[..., None], found, 0).astype(wi.dtype)


class MerlFile(AbstractTableFile):
    """A file of the MERL database that has been read. UsageError for one that is none."""

    def read(self, data: np.ndarray) -> Merl:
        if len(data) < _HEADER:
            raise mistake(self.path, f"is not a MERL file: {len(data)} bytes, shorter than the header of {_HEADER}")
        found = tuple(int(size) for size in data[:_HEADER].view("<i4"))
        if found != SHAPE:
            shown, asked = (" x ".join(map(str, sizes)) for sizes in (found, SHAPE))
            raise mistake(self.path, f"is not a MERL file: it begins with the dimensions {shown}; a MERL file has {asked}")
        wanted = _HEADER + 3 * 8 * math.prod(SHAPE)
        if len(data) != wanted:
            what = "truncated" if len(data) < wanted else "too long"
            raise mistake(self.path, f"is {what}: {len(data)} bytes; a MERL file has {wanted}")
        planes = data[_HEADER:].view("<f8").reshape(3, -1)
        # One channel after the other lies in the file; one look-up wants all three.
        values = np.empty((math.prod(SHAPE), 3))
        for channel, scale in enumerate(SCALE):
            np.multiply(planes[channel], scale, out=values[:, channel])
        if not np.all(np.isfinite(values)):
            plane, index = np.argwhere(~np.isfinite(planes))[0]
            place = ", ".join(str(part) for part in np.unravel_index(index, SHAPE))
            broken = np.count_nonzero(~np.isfinite(planes))
            where = f"the first is {'RGB'[plane]} [{place}]"
            raise mistake(self.path, f"{broken} of {planes.size} values are NaN or infinite; {where}. Negative means no data")
        seen = _seen()
        lost = np.any(values < 0, axis=1).reshape(SHAPE) & seen
        if np.all(lost == seen):
            raise mistake(self.path, "holds no data: all values are negative")
        count, missing = int(np.count_nonzero(seen)), int(np.count_nonzero(lost))
        samples = Samples(_LAYOUT, count, missing, _mostly(lost), _GUESS)
        return Merl(values=values, nearest=False, samples=samples)


def _bins(place: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A place in each bin in radians, 0 its lower edge and 1/2 its middle, ready to be broadcast."""
    h, d, p = ((np.arange(size) + place) / size for size in SHAPE)
    return _QUARTER * h[:, None, None] ** 2, _QUARTER * d[:, None], np.pi * p


def _seen() -> np.ndarray:
    """The bins that light and viewer above the surface meet, of shape `SHAPE`.

    With N.wi, N.wo = cos theta_d cos theta_h -+ sin theta_d sin theta_h cos phi_d both are above it where
    |cos phi_d| tan theta_d tan theta_h < 1: in a bin that is likeliest at its smallest angles and nearest to phi_d = 90 deg.
    """
    theta_h, theta_d, phi_d = _bins(0)
    least = np.minimum(np.abs(np.cos(phi_d)), np.abs(np.cos(phi_d + np.pi / SHAPE[2])))
    return least * np.tan(theta_d) * np.tan(theta_h) < 1


def _mostly(lost: np.ndarray) -> str:
    """Where most of the bins without data are: beyond which angle of the light or the viewer, in the middle of a bin."""
    if not np.any(lost):
        return ""
    h, d, p = _bins(0.5)
    lower = np.cos(d) * np.cos(h) - np.sin(d) * np.sin(h) * np.abs(np.cos(p))
    angle = np.degrees(np.arccos(np.maximum(lower[lost], 0)))
    return f"nine in ten of them where light or viewer are more than {np.quantile(angle, 0.1):.3g} deg from the normal"
