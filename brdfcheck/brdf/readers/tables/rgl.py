r"""The RGL material database: ``NAME.bsdf``, isotropic or anisotropic, RGB or spectra (Dupuy & Jakob 2018, An Adaptive
Parameterization for Efficient Material Acquisition and Rendering).

A tensor file. Where a facet model with the distribution D and the projected area $\sigma$ is written
$f \cos\theta_o = \frac{D(\omega_m)}{4 \sigma(\omega_i)} \, s$, the factor s is smooth, and nearly constant once its argument is
the number that would have drawn $\omega_m$ from the facets that the light sees. That is what the file holds:

* directions are points of the unit square, $u = (\sqrt{2\theta/\pi}, (\phi + \pi)/2\pi)$; of an isotropic file the azimuth of
  $\omega_m$ is counted from that of the light;
* ``ndf`` (D) and ``sigma`` are interpolated there, bilinearly; rows run along $\phi$;
* ``vndf`` is for each light (``phi_i``, ``theta_i``, radians) a bilinear density p(u) of the visible facets. It moves u to
  $(\int_0^x p\,dx / \int_0^1 p\,dx, \int_0^y \int_0^1 p\,dx\,dy)$, evenly spread over the square. Between lights the densities,
  each of integral 1, are interpolated;
* ``rgb``, or ``spectra`` at ``wavelengths`` (nm), is s over that square, for each light and channel;
* without ``jacobian`` what is held is $f \cos\theta_o$ itself.

``luminance`` is for drawing samples only. The value is divided by $\cos\theta_o$, for it includes it.
"""

from __future__ import annotations

import dataclasses
from typing import Any, final

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck import geometry
from brdfcheck.brdf.readers.tables.file import AbstractTableFile, mistake
from brdfcheck.brdf.readers.tables.tensor_file import read_arrays
from brdfcheck.brdf.tables import AbstractTable, Bracket, Samples, bracket, looked_up, nodes_beside

_GUESS = "the largest value at that light"
_MOST_CHANNELS = 256


def _spherical(direction: Array) -> tuple[Array, Array]:
    """theta and phi of directions (..., 3); phi in (-pi, pi]."""
    x, y, z = (direction[..., i] for i in range(3))
    return jnp.arctan2(jnp.sqrt(x * x + y * y), z), jnp.arctan2(y, x)


@final
class Rgl(AbstractTable):
    """A file of the RGL database.

    `values` (lights x rows x columns, channels) is s, negative where there are no data, `shape` its rows and columns; `ndf`,
    `sigma` (rows, columns); `density` (lights x rows x columns,) with `inner`, its integral along a row up to each column, and
    `outer` (lights x rows,), that of whole rows up to each row. `lights`: phi_i and theta_i.
    """

    values: Float[Array | np.ndarray, "entries channels"]
    ndf: Float[Array | np.ndarray, "rows columns"]
    sigma: Float[Array | np.ndarray, "rows columns"]
    density: Float[Array | np.ndarray, " points"]
    inner: Float[Array | np.ndarray, " points"]
    outer: Float[Array | np.ndarray, " rows"]
    lights: tuple[Array | np.ndarray, Array | np.ndarray]
    shape: tuple[int, int] = eqx.field(static=True)
    density_shape: tuple[int, int] = eqx.field(static=True)
    jacobian: bool = eqx.field(static=True)
    reduction: int = eqx.field(static=True)
    nearest: bool = eqx.field(static=True)
    samples: Samples = eqx.field(static=True)

    def filled(self) -> Rgl | None:
        if not self.samples.missing:
            return None
        lights = len(self.lights[0]) * len(self.lights[1])
        values = np.asarray(self.values).reshape(lights, -1, self.values.shape[1])
        highest = np.maximum(values.max(axis=1, keepdims=True), 0)
        fresh = np.where(values < 0, np.where(highest > 0, highest, values.max()), values)
        return dataclasses.replace(self, values=fresh.reshape(self.values.shape))

    def __call__(self, wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Float[Array, "... channels"]:
        """f in 1/sr for each channel; 0 where a direction lies below the surface, and where there are no data."""
        wi, wo = jnp.broadcast_arrays(jnp.asarray(wi), jnp.asarray(wo))
        lit = geometry.above_horizon(wi, wo)
        if self.reduction >= 2:  # the surface is the same after half a turn, or mirrored at both axes: one part is measured
            flip_y = jnp.where(wi[..., 1] < 0, -1.0, 1.0)
            flip_x = jnp.where(wi[..., 0] < 0, -1.0, 1.0) if self.reduction == 4 else flip_y
            flip = jnp.stack([flip_x, flip_y, jnp.ones_like(flip_x)], axis=-1).astype(wi.dtype)
            wi, wo = wi * flip, wo * flip
        theta_i, phi_i = _spherical(wi)
        theta_m, phi_m = _spherical(jnp.where(lit[..., None], wi + wo, jnp.asarray([0.0, 0.0, 1.0], wi.dtype)))
        turned = phi_m - phi_i if len(self.lights[0]) <= 2 else phi_m
        light = [
            nodes_beside(place, jnp.asarray(nodes).astype(wi.dtype), nearest=self.nearest)
            for place, nodes in zip((phi_i, theta_i), self.lights, strict=True)
        ]
        x, y = self._unit(theta_m, turned)
        drawn = self._drawn(x, y, light)
        lights, dtype = (len(self.lights[0]), len(self.lights[1])), wi.dtype
        value = looked_up(self.values, (*lights, *self.shape), [*light, *self._grid(*drawn, self.shape)], dtype)
        if self.jacobian:
            facets, sigma = (
                looked_up(jnp.ravel(table), table.shape, self._grid(*place, table.shape), dtype)
                for table, place in ((self.ndf, (x, y)), (self.sigma, self._unit(theta_i, phi_i)))
            )
            value = value * (facets / (4 * sigma))[..., None]
        cosine = jnp.where(wo[..., 2] > 0, wo[..., 2], 1)[..., None]
        return jnp.where(lit[..., None] & (wo[..., 2:] > 0), value / cosine, 0).astype(wi.dtype)

    def _unit(self, theta: Array, phi: Array) -> tuple[Array, Array]:
        """Where a direction lies in the unit square."""
        y = (phi + np.pi) / (2 * np.pi)
        return jnp.sqrt(theta * (2 / np.pi)), y - jnp.floor(y)

    def _grid(self, x: Array, y: Array, shape: tuple[int, ...]) -> list[Bracket]:
        """The samples beside a point of the unit square: of rows along y and columns along x."""
        return [bracket(place * (count - 1), count, nearest=self.nearest) for place, count in zip((y, x), shape, strict=True)]

    def _drawn(self, x: Array, y: Array, light: list[Bracket]) -> tuple[Array, Array]:
        """The point that would have drawn this one from the density: its row given the rest, and all before it."""
        rows, columns = self.density_shape
        low_x, low_y = (jnp.clip(jnp.floor(place * (count - 1)), 0, count - 2) for place, count in ((x, columns), (y, rows)))
        right, up = x * (columns - 1) - low_x, y * (rows - 1) - low_y
        column, row = low_x.astype(int), low_y.astype(int)

        def at(table: Any, *place: Any) -> Array:
            """What a table holds for this light in a row and a column."""
            table = jnp.asarray(table)
            shape = (*map(len, self.lights), *self.density_shape[: len(place)])
            return looked_up(table, shape, [*light, *([(index, None)] for index in place)], table.dtype)

        p00, p10, p01, p11 = (at(self.density, row + i, column + j) for i in (0, 1) for j in (0, 1))
        before, before_up, whole, whole_up = (at(self.inner, row + i, j) for j in (column, columns - 1) for i in (0, 1))
        below = at(self.outer, row)
        # Linear between the rows, and within a patch linear along the row: so the integrals are parabolas.
        left, far = p00 + up * (p01 - p00), p10 + up * (p11 - p10)
        along = before + up * (before_up - before) + right * (left + right / 2 * (far - left)) / (columns - 1)
        row_total = whole + up * (whole_up - whole)
        across = below + up * (whole + up / 2 * (whole_up - whole)) / (rows - 1)
        return jnp.where(row_total > 0, along / jnp.where(row_total > 0, row_total, 1), x), across


class RglFile(AbstractTableFile):
    """A file of the RGL database that has been read. UsageError for one that is none."""

    def read(self, data: np.ndarray) -> Rgl:
        self._arrays = read_arrays(data, self.path)
        phi_i, theta_i = self._angles("phi_i", np.pi), self._angles("theta_i", np.pi / 2)
        lights = len(phi_i), len(theta_i)
        name = "rgb" if "rgb" in self._arrays else "spectra"
        jacobian = self._floats("jacobian", 1)
        values = self._floats(name, 5)
        values = values if values.dtype.itemsize > 2 and values.dtype.kind == "f" else values.astype(np.float32)
        channels = values.shape[2]
        if values.shape[:2] != lights or min(values.shape[3:]) < 2:
            raise self._wrong(
                name, values.shape, f"{lights[0]} x {lights[1]} lights x channels x rows x columns, 2 or more each"
            )
        names: tuple[str, ...] = ()
        if name == "spectra":
            wavelengths = self._floats("wavelengths", 1)
            if len(wavelengths) != channels:
                raise self._wrong("wavelengths", wavelengths.shape, f"as many as the {channels} of the spectra")
            names = tuple(f"{wavelength:g} nm" for wavelength in wavelengths)
        elif channels != 3:
            raise self._wrong(name, values.shape, "three channels")
        if not 1 <= channels <= _MOST_CHANNELS:
            raise mistake(self.path, f"has {channels} wavelengths; 1 to {_MOST_CHANNELS} are looked at")
        ndf, sigma = (self._not_negative(part, self._floats(part, 2)) for part in ("ndf", "sigma"))
        density = self._not_negative("vndf", self._floats("vndf", 4)).astype(float)
        if density.shape[:2] != lights or min(density.shape[2:]) < 2:
            raise self._wrong("vndf", density.shape, f"{lights[0]} x {lights[1]} lights x rows x columns, 2 or more each")
        for part, table in (("ndf", ndf), ("sigma", sigma)):
            if min(table.shape) < 2:
                raise self._wrong(part, table.shape, "rows x columns, 2 or more each")
        # Of each light, channels last, as one look-up wants them.
        entries = np.ascontiguousarray(np.moveaxis(values, 2, -1)).reshape(-1, channels)
        lost = np.any(entries < 0, axis=1)
        if np.all(lost):
            raise mistake(self.path, f"holds no data: all of {name!r} is negative")
        return Rgl(
            values=entries,
            ndf=ndf,
            sigma=sigma,
            **self._integrals(density),
            lights=(phi_i, theta_i),
            shape=values.shape[3:],
            density_shape=density.shape[2:],
            jacobian=bool(jacobian[0]),
            reduction=1 if len(phi_i) <= 2 else round(2 * np.pi / max(float(phi_i[-1] - phi_i[0]), 0.1)),
            nearest=False,
            samples=self._samples(lost.reshape(*lights, -1), values.shape, theta_i, names),
        )

    def _samples(self, lost: np.ndarray, shape: tuple[int, ...], theta_i: np.ndarray, names: tuple[str, ...]) -> Samples:
        where = ""
        if np.any(lost):
            worst = int(np.argmax(lost.sum(axis=(0, 2))))
            where = f"most at theta_i = {np.degrees(theta_i[worst]):.3g} deg"
        what = f"{len(names)} wavelengths" if names else "R, G and B"
        layout = f"RGL: {shape[0] * shape[1]} directions of light, {shape[3]} x {shape[4]} of the viewer each, {what}"
        return Samples(layout, lost.size, int(np.count_nonzero(lost)), where, _GUESS, names)

    def _integrals(self, density: np.ndarray) -> dict[str, np.ndarray]:
        """The density of each light, of integral 1, and its integrals along rows and over rows."""
        rows, columns = density.shape[2:]
        inner = np.zeros_like(density)
        np.cumsum((density[..., 1:] + density[..., :-1]) / (2 * (columns - 1)), axis=-1, out=inner[..., 1:])
        outer = np.zeros(density.shape[:3])
        np.cumsum((inner[:, :, 1:, -1] + inner[:, :, :-1, -1]) / (2 * (rows - 1)), axis=-1, out=outer[..., 1:])
        total = outer[..., -1]
        if not np.all(total > 0):
            light = ", ".join(map(str, np.argwhere(~(total > 0))[0]))
            raise mistake(self.path, f"the density 'vndf' of light [{light}] is 0 everywhere")
        scale = total[:, :, None, None]
        return {
            "density": (density / scale).ravel(),
            "inner": (inner / scale).ravel(),
            "outer": (outer / scale[..., 0]).ravel(),
        }

    def _floats(self, name: str, dimensions: int) -> np.ndarray:
        """An array by its name. UsageError where it is not there, not of so many dimensions, empty, or not finite."""
        if name not in self._arrays:
            there = ", ".join(map(repr, self._arrays)) or "nothing"
            raise mistake(self.path, f"has no array {name!r}; it holds {there}")
        found = self._arrays[name]
        if found.ndim != dimensions or not found.size:
            raise self._wrong(name, found.shape, f"{dimensions} dimensions, none of them empty")
        if found.dtype.kind == "f" and not np.all(np.isfinite(found)):
            place = ", ".join(map(str, np.argwhere(~np.isfinite(found))[0]))
            broken = np.count_nonzero(~np.isfinite(found))
            raise mistake(self.path, f"{broken} of {found.size} values of {name!r} are NaN or infinite; the first is [{place}]")
        return found

    def _not_negative(self, name: str, found: np.ndarray) -> np.ndarray:
        if np.any(found < 0):
            place = np.argwhere(found < 0)[0]
            raise mistake(
                self.path,
                f"{name!r} must not be negative; got {found[tuple(place)]:g} at [{', '.join(map(str, place))}]",
            )
        return found

    def _angles(self, name: str, most: float) -> np.ndarray:
        """The angles of the light: rising, in radians."""
        found = self._floats(name, 1).astype(float)
        if np.any(np.diff(found) <= 0) or np.any(np.abs(found) > most + 1e-3):
            raise mistake(self.path, f"{name!r} must rise, within {most:.4g} radians of 0; got {_few(found)}")
        return found

    def _wrong(self, name: str, shape: tuple[int, ...], allowed: str) -> Exception:
        return mistake(self.path, f"the array {name!r} has the shape {' x '.join(map(str, shape)) or '1'}; expected {allowed}")


def _few(numbers: np.ndarray) -> str:
    """A few numbers, for messages."""
    shown = ", ".join(f"{number:g}" for number in numbers[:6])
    return f"{shown}, ..." if len(numbers) > 6 else shown
