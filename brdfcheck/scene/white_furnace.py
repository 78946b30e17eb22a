"""Spheres in a uniform surrounding: what conserves vanishes or darkens, what does not glows."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int

from brdfcheck.brdf import catalog
from brdfcheck.brdf.base import AbstractBRDF
from brdfcheck.brdf.factors import Constant, Normalized, PerCosine
from brdfcheck.quadrature.albedo import albedo
from brdfcheck.scene.cameras import checked_size
from brdfcheck.scene.canvas import Canvas, Image, averaged, color_scale, colored, stacked
from brdfcheck.scene.functions import brdf_of
from brdfcheck.scene.furnace import directional_albedo
from brdfcheck.scene.images import contact_sheet

_ENVIRONMENT = 0.4  # a sphere that returns 2.5 times the light is white
_USUAL = {
    "n": 20.0, "m": 0.3, "alpha": 0.3, "reflectance": 1.0, "albedo": 1.0, "through": 0.5, "index": 1.5, "clear": 0.9,
    "eta": 1.5, "below": 0.0,
}  # fmt: skip
# (published, its parameters where the excess is of interest, the validated one of the same lobe)
PAIRS: tuple[tuple[str, dict[str, float], str], ...] = (
    ("binomial-power-raw", {"n": 4}, "binomial-power-half"),
    ("binomial-power-published", {"n": 17.85}, "binomial-power-half"),
    ("binomial-power-unclamped", {"n": 40}, "binomial-power-half"),
    ("blinn-phong-6", {"n": 20}, "blinn-phong"),
    ("blinn-phong-8", {"n": 8.76}, "blinn-phong"),
    ("blinn-phong-ndf", {"n": 100}, "blinn-phong"),
    ("blinn-phong-linear", {"n": 20}, "blinn-phong"),
    ("phong-pdf", {"n": 20}, "phong"),
    ("phong-classical", {"n": 4}, "phong"),
    ("schlick-phong-factor", {"n": 100}, "schlick-mirror"),
    ("kuijk-blake-phong-factor", {"n": 9}, "kuijk-blake-mirror"),
    ("cook-torrance-published", {"m": 0.4}, "cook-torrance"),
    ("cook-torrance-no-masking", {"m": 0.4}, "cook-torrance"),
)
"""What was published beside the validated BRDF of the same lobe."""


_DOWN = "the largest of 0 to 89 degrees"
_SCALE = "grey: what is reflected, up to 1; colour: what is reflected beyond 1"
_CLOSER = 12
_USUAL_SIDE = 2.1  # of what the usual camera sees; the sphere's radius is 1


@functools.lru_cache(maxsize=2)
def _distances(side: int, samples: int = 1) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, "n n"]]:
    """The squared distances from the sphere's centre that a square of pixels has, and which of them each sample has.

    Inside the disc all samples of a pixel have its centre's: the albedo is smooth there, and an edge is not. Those that miss
    the sphere have the number -1. Distances are sums of two squares of whole numbers, so that many pixels share one.
    """
    count = side * samples
    own = 2 * np.arange(count) + 1 - count  # in half samples from the middle
    center = np.repeat(samples * (2 * np.arange(side) + 1 - side), samples)
    limit = (2 * count / _USUAL_SIDE) ** 2
    square, within = own[:, None] ** 2 + own**2, center[:, None] ** 2 + center**2
    reach = np.abs(center) + samples
    inside = reach[:, None] ** 2 + reach**2 < limit
    whole = np.where(inside, within, square)
    found, number = np.unique(np.where(whole < limit, whole, -1), return_inverse=True)
    hit = found >= 0
    return found[hit] / limit, number.reshape(count, count) - int(not hit.all())


def _alike(brdf: Any) -> Any:
    """The BRDF in single precision with its factor as a number: lobes of one kind are then one compiled program."""
    if isinstance(brdf, PerCosine):
        return PerCosine(_alike(brdf.base))
    if hasattr(brdf.core, "n"):
        brdf = Normalized(brdf.core, Constant(brdf.gain(1.0)))
    return jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.float32), brdf)


def _member(name: str, parameters: Mapping[str, Any]) -> Any:
    """Of the catalogue, whose parameters may be colours, or any other name that `brdfcheck.check` takes."""
    if name in catalog.names() and parameters.keys() == catalog.entry(name).family.ranges.keys():
        return catalog.entry(name).family.build(**parameters)
    return brdf_of(name, parameters, furnace=True)


_integrated = eqx.filter_jit(directional_albedo)
_AT_ONCE = 512  # angles in one call, whatever the size of the picture: no other program for another number of them


def _reflected(
    brdf: str | AbstractBRDF, parameters: Mapping[str, float], cosine: Float[np.ndarray, " k"]
) -> Float[np.ndarray, "*channels k"]:
    """What a BRDF, or one of the catalogue, reflects of a uniform surrounding of radiance 1, integrated at each cosine."""
    member: Any = _alike(_member(brdf, parameters) if isinstance(brdf, str) else brdf)
    # A function that is called each time is no program, which would be one more for another number of angles.
    most = _AT_ONCE if getattr(member, "traced", True) else max(min(_AT_ONCE, cosine.size), 1)
    padded = np.pad(cosine, (0, -cosine.size % most), mode="edge").astype(np.float32).reshape(-1, most)
    return np.concatenate([_integrated(member, jnp.asarray(part)) for part in padded], axis=-1)[..., : cosine.size]


def furnace_largest(brdf: str | AbstractBRDF, parameters: Mapping[str, float] = MappingProxyType({})) -> float:
    """The most that a BRDF reflects of a uniform surrounding of radiance 1, of all whole degrees from 0 to 89.

    A name is one that `brdfcheck.check` takes, with its `parameters`. Some published forms have no largest value at 90
    degrees, and the brightest pixel of a picture depends on its size.
    """
    return float(_reflected(brdf, parameters, np.cos(np.radians(np.arange(90.0)))).max())


def furnace_excess(
    brdf: str | AbstractBRDF, parameters: Mapping[str, float], side: int, samples: int = 1
) -> tuple[Float[np.ndarray, "*channels n n"], Float[np.ndarray, "n n"]]:
    """(how much more than its surrounding a sphere of a BRDF shows, as a share; what it covers) of each pixel.

    Means over samples x samples, 0 beside the sphere. A BRDF with channels has an excess in each. Integrated at every distance
    from the centre that a pixel has, seen along the x axis: 27 times fewer than pixels on a side of 512. KeyError for an
    unknown name of the catalogue, ValueError for bad parameters or a side that is none.
    """
    checked_size((side, side))
    square, number = _distances(side, samples)
    excess = _reflected(brdf, parameters, np.sqrt(1 - square)) - 1
    beside = np.zeros((*excess.shape[:-1], 1), np.float32)
    # -1 is the last
    return averaged(np.append(excess, beside, axis=-1)[..., number], samples), averaged(number >= 0, samples)


def _furnace_pair(canvas: Canvas, brdf: str | AbstractBRDF, parameters: Mapping[str, float]) -> list[Image]:
    """The sphere before its surrounding, of the radiance 0.4, as `sphere_image` shows it, and its excess in false colour."""
    excess, covered = furnace_excess(brdf, parameters, canvas.side, canvas.samples)
    canvas.done()
    most = excess if excess.ndim == 2 else excess.max(axis=0)
    return [np.broadcast_to(np.float32(_ENVIRONMENT) * (1 + excess), (3, *most.shape)), colored(most, covered)]


def _middle(canvas: Canvas, brdf: str, parameters: Mapping[str, float]) -> Image:
    """The excess in the middle of the sphere in false colour, `_CLOSER` times enlarged."""
    across = np.abs(2 * np.arange(canvas.side) + 1 - canvas.side) / canvas.side * _USUAL_SIDE / 2 / _CLOSER
    radius = np.linspace(0, 1.5 * _USUAL_SIDE / 2 / _CLOSER, 256)
    excess = np.interp(np.hypot(across[:, None], across), radius, _reflected(brdf, parameters, np.sqrt(1 - radius**2)) - 1)
    return colored(excess, np.ones_like(excess))


def furnace_of(canvas: Canvas, brdf: AbstractBRDF, label: str) -> Image:
    """One BRDF: the sphere, and its excess (of the brightest channel) in false colour with the scale."""
    pair, most = _furnace_pair(canvas, brdf, {}), furnace_largest(brdf)
    sheet = contact_sheet([pair], columns=("furnace", "excess"), labels=[f"{label}: {most:.4f}"], down=_DOWN)
    return stacked(sheet, color_scale(sheet.shape[2], _SCALE, grey=True))


def _numbers(parameters: Mapping[str, float]) -> str:
    return ", ".join(f"{key} = {value:g}" for key, value in parameters.items())


def _share(most: float) -> str:
    if most > 2:
        return f"{most:.3g} times"
    return f"+{most - 1:.2%}" if most - 1 > 1e-5 else "conserves"


def furnace(canvas: Canvas) -> Image:
    """Every published BRDF beside the validated one of the same lobe, with the excess in false colour and its scale."""
    # First what returns all light and vanishes: the validated lobes of the others lose some away from the normal.
    white, whiter = {"reflectance": 1.0}, {"reflectance": 1.2}
    rows = [_furnace_pair(canvas, "lambert", white) + _furnace_pair(canvas, "lambert", whiter)]
    labels = [f"lambert, reflectance = 1, beside 1.2: {_share(furnace_largest('lambert', whiter))}"]
    for name, parameters, validated in PAIRS:
        rows.append(_furnace_pair(canvas, validated, parameters) + _furnace_pair(canvas, name, parameters))
        label = f"{name}, {_numbers(parameters)}: {_share(furnace_largest(name, parameters))}"
        if name == "binomial-power-published":
            rows[-1][-1] = _middle(canvas, name, parameters)
            label += f"\n(excess: the middle, {_CLOSER} times enlarged)"
        if name == "phong-classical":  # not reciprocal, and the furnace gathers over the direction of the light
            other = float(albedo(catalog.entry(name).family.build(**parameters), np.cos(np.radians(89.0))).value)
            label += f"\n(summed over views, light at 89 degrees: {other:.3g} times)"
        labels.append(label)
    columns = ("validated", "excess", "published", "excess")
    sheet = contact_sheet(rows, columns=columns, labels=labels, down=_DOWN)
    return stacked(sheet, color_scale(sheet.shape[2], _SCALE, grey=True))


def furnace_validated(canvas: Canvas) -> Image:
    """Every validated BRDF, with what it lacks in grey."""
    tiles, labels = [], []
    for entry in catalog.entries():
        if entry.validated:
            values = {name: _USUAL.get(name, sum(bounds) / 2) for name, bounds in entry.family.ranges.items()}
            tiles.append(_furnace_pair(canvas, entry.name, values))
            labels.append(f"{entry.name}, {_numbers(values)}")
    half = -(-len(tiles) // 2)
    columns = ("furnace", "excess")
    left, right = (
        contact_sheet(tiles[part], columns=columns, labels=labels[part]) for part in (slice(half), slice(half, None))
    )
    # Of an odd number the last row has one.
    right = np.pad(right, ((0, 0), (0, left.shape[1] - right.shape[1]), (0, 0)), constant_values=1)
    sheet = np.concatenate([left, right], axis=2)
    return stacked(sheet, color_scale(sheet.shape[2], _SCALE, grey=True))
