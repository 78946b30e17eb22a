r"""Albedos of GGX as renderers have them, formulas and tables of numbers, and how far each cell is off.

What a renderer means by a number is seldom written beside it: where nodes lie, which axis comes first, which masking was
integrated. So each is compared in every reading that is known to be in use, and told in the one that fits best in the median.
"""

from __future__ import annotations

import functools
import itertools
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from brdfcheck import GGX, albedo_table
from brdfcheck.messages import UsageError

Grid = Float[np.ndarray, "roughness mu"]
# Of E at F0 = 1 and at F0 = 0, between which Schlick's Fresnel term runs: scale + bias, and bias.
Pair = tuple[Grid, Grid]
MASKINGS = ("smith-correlated", "smith-separable")
LIMITS = (1e-4, 1e-3, 1e-2, 1e-1)
"""A cell counts as off by more than each of these."""
# Renderers keep away from 0, where facets are none, by this much.
_LEAST = 1e-4
_SIDE = 16


def materialx(roughness: Grid, mu: Grid) -> Pair:
    """MaterialX's rational quadratic fit to Monte Carlo data, in mu and alpha = roughness^2, clamped to [0, 1]."""
    x, y = mu, roughness**2
    terms = np.stack(np.broadcast_arrays(np.ones_like(x * y), x, y, x * y, x * x, y * y, x * x * y, x * y * y, (x * y) ** 2))
    coefficients = np.array(
        [
            [0.1003, -0.6303, 9.748, -2.038, 29.34, -8.245, -26.44, 19.99, -5.448],
            [0.9345, -2.323, 2.229, -3.748, 1.424, -0.7684, 1.436, 0.2913, 0.6286],
            [1.0, -1.765, 8.263, 11.53, 28.96, -7.507, -36.11, 15.86, 33.37],
            [1.0, 0.2281, 15.94, -55.83, 13.08, 41.26, 54.9, 300.2, -285.1],
        ]
    )
    a, b, c, d = np.tensordot(coefficients, terms, 1)
    scale, bias = np.clip(a / c, 0, 1), np.clip(b / d, 0, 1)
    return scale + bias, bias


def karis(roughness: Grid, mu: Grid) -> Pair:
    """Karis' approximation for mobile hardware (2014), in mu and roughness; three.js uses it too."""
    x, y, z, w = (roughness * slope + start for slope, start in ((-1, 1), (-0.0275, 0.0425), (-0.572, 1.04), (0.022, -0.04)))
    a = np.minimum(x * x, np.exp2(-9.28 * mu)) * x + y
    return z + w, 1.04 * a + w


def lazarov(gloss: Grid, mu: Grid) -> Pair:
    """Lazarov's form (2013), fitted to GGX by Narkowicz (2014), in mu and gloss."""
    a, b, c, delta = (gloss * slope + start for slope, start in _LAZAROV)
    return np.clip(delta, 0, 1), np.clip(a * np.minimum(b, np.exp2(-7.672 * mu)) + c, 0, 1)


_LAZAROV = ((0.5745, 0.5753), (1.548, -0.2511), (-0.02397, -0.02066), (1.301, 0.4755))


def narkowicz(gloss: Grid, mu: Grid) -> Pair:
    """Narkowicz' polynomials (2014), in mu and gloss."""
    x, y = gloss, mu
    bias = np.minimum(-0.1688 * x + 1.895 * x * x, 0.9903 - 4.853 * y + 8.404 * y * y - 5.069 * y**3)
    delta = 0.6045 + 1.699 * x - 0.5228 * y - 3.603 * x * x + 1.404 * x * y + 0.1939 * y * y + 2.661 * x**3
    return np.clip(delta, 0, 1), np.clip(bias, 0, 1)


def unreal(roughness: Grid, mu: Grid) -> Pair:
    """The fit of Unreal Engine 5 for its conservation of energy, in mu and roughness."""
    r, c = roughness, mu
    lost = r ** (c / r) * ((r * c + 0.0266916) / (0.466495 + c))
    return 1 - np.clip(lost, 0, 1), (1 - c) ** 5 * (2.36651 * c ** (4.7703 * r) + 0.0387332) ** r


def _of_gloss(fit: Callable[[Grid, Grid], Pair]) -> Mapping[str, Callable[[Grid, Grid], Pair]]:
    """A fit in gloss, in the ways that engines make gloss of roughness."""
    return {f"gloss = (1 - roughness)^{k}": lambda r, mu, k=k: fit((1 - r) ** k, mu) for k in (1, 2, 4)}


FITS: Mapping[str, Mapping[str, Callable[[Grid, Grid], Pair]]] = MappingProxyType(
    {
        "MaterialX, rational": {"alpha = roughness^2": materialx},
        "Karis 2014, mobile": {"roughness": karis},
        "Lazarov 2013, for GGX": _of_gloss(lazarov),
        "Narkowicz 2014": _of_gloss(narkowicz),
        "Unreal Engine 5": {"roughness": unreal},
    }
)


class Reading(NamedTuple):
    """One way to read a table: what is said of it, its values with roughness down and mu across, and the albedo there."""

    words: str
    values: Grid
    exact: Grid
    nodes: np.ndarray


def nodes_of(count: int, placement: str) -> np.ndarray:
    """Where the nodes lie on [0, 1], both axes alike."""
    return (np.arange(count) + 0.5) / count if placement == "centres" else np.maximum(np.linspace(0, 1, count), _LEAST)


@functools.cache
def exact(count: int, placement: str, squared: bool, masking: str, f0: float) -> Grid:
    """Albedos of GGX with error bars of 1e-8 and less: `count` nodes of roughness, or of alpha where not `squared`, and mu."""
    nodes = nodes_of(count, placement)
    fresnel = {} if f0 == 1 else {"f0": f0, "fresnel": "schlick"}
    found = albedo_table(lambda alpha: GGX(alpha, masking=masking, **fresnel), nodes**2 if squared else nodes, nodes)
    return np.asarray(found.value)


def of_formula(name: str, count: int) -> dict[str, Any]:
    """How far one of the `FITS` is off, in the middles of count x count texels."""
    nodes = nodes_of(count, "centres")
    roughness, mu = np.meshgrid(nodes, nodes, indexing="ij")
    read = {words: fit(roughness, mu) for words, fit in FITS[name].items()}
    readings = [
        (Reading(f"{words}, {masking}", pair[0], exact(count, "centres", True, masking, 1), nodes), masking, pair[1])
        for (words, pair), masking in itertools.product(read.items(), MASKINGS)
    ]
    best, masking, bias = min(readings, key=lambda one: _middle(one[0]))
    return {**told(name, best), "bias": float(np.max(np.abs(bias - exact(count, "centres", True, masking, 0))))}


def sampled(count: int = 64, samples: int = 1024) -> list[dict[str, Any]]:
    """How far the table is off that Filament makes: texels of 1,024 half vectors each, by its method, not from its file.

    These are Hammersley points by the distribution of normals, with height-correlated masking. Twice: at the roughness that
    each row is computed for, which is (h - y + 1/2)/h for row y of h, at most 1; and as if it were that of the middle of its
    texel, (h - y - 1/2)/h.
    """
    nodes = nodes_of(count, "centres")
    computed = np.minimum(nodes + 1 / count, 1)
    values = np.stack([_by_half_vectors(roughness**2, nodes, samples) for roughness in computed])
    found = albedo_table(lambda alpha: GGX(alpha, masking="smith-correlated"), computed**2, nodes)
    words = f"{samples} half vectors a cell, smith-correlated"
    ways = {
        "Filament's method": Reading(f"{words}, at its own roughness", values, np.asarray(found.value), computed),
        "Filament's, by texels": Reading(
            f"{words}, at texels", values, exact(count, "centres", True, "smith-correlated", 1), nodes
        ),
    }
    return [{**told(name, reading), "bias": None} for name, reading in ways.items()]


def _by_half_vectors(alpha: float, mu: np.ndarray, samples: int) -> np.ndarray:
    """Albedos of GGX as means over Hammersley points, half vectors distributed as D cos: (mu,)."""
    index = np.arange(samples)
    turn = 2 * np.pi * index / samples
    radical = sum(((index >> bit) & 1) * 0.5 ** (bit + 1) for bit in range(samples.bit_length()))
    height = np.sqrt((1 - radical) / (1 + (alpha * alpha - 1) * radical))
    mu = mu[:, None]
    meets = height * mu + np.sqrt((1 - height**2) * (1 - mu * mu)) * np.cos(turn)
    out = np.clip(2 * meets * height - mu, 1e-12, 1)
    masked = [light * np.sqrt(view**2 * (1 - alpha**2) + alpha**2) for light, view in ((out, mu), (mu, out))]
    value = 2 * out * meets / (height * (masked[0] + masked[1]))
    return np.mean(np.where((2 * meets * height > mu) & (meets > 0), value, 0), axis=1)


def of_file(path: str) -> dict[str, Any]:
    """How far the table in a file is off: FILE or FILE#ARRAY, as for `square_table`."""
    return {**told(Path(path).name, min(_readings(square_table(path)), key=_middle)), "bias": None}


def _readings(table: np.ndarray) -> Iterator[Reading]:
    ways = itertools.product(("ends", "centres"), (True, False), MASKINGS, (False, True), (False, True), (False, True))
    for placement, squared, masking, turned, flipped, lost in ways:
        values = table.T if turned else table
        values = values[::-1] if flipped else values
        words = [f"nodes at {placement}", "roughness" if squared else "alpha", "across" if turned else "down", masking]
        words += ["from 1 to 0"] * flipped + ["1 - E"] * lost
        true = exact(len(table), placement, squared, masking, 1)
        yield Reading(", ".join(words), 1 - values if lost else values, true, nodes_of(len(table), placement))


def _middle(reading: Reading) -> float:
    return float(np.median(np.abs(reading.values - reading.exact)))


def square_table(path: str) -> np.ndarray:
    """The first square table of numbers in FILE, or the one called ARRAY in FILE#ARRAY.

    .npy, or text: .csv, C source, bare lists. Whole numbers of 16 bits are parts of 65535. UsageError where there is none.
    """
    name, _, wanted = path.partition("#")
    if not Path(name).is_file():
        raise UsageError(f"there is no file {name!r}")
    if name.endswith(".npy"):
        found = [("", np.load(name))]
    else:
        text = re.sub(
            r"/\*.*?\*/|//[^\n]*|^#[^\n]*", "", Path(name).read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE
        )
        arrays = re.findall(r"(\w+)\s*(?:\[[^]]*\]\s*)+=\s*\{([^;]*)\}", text) or [("", text)]
        found = [(array, np.array(re.findall(r"-?\d+\.?\d*(?:[eE][-+]?\d+)?", body), float)) for array, body in arrays]
    for array, numbers in found:
        side = round(numbers.size**0.5)
        if side >= 8 and side * side == numbers.size and wanted in ("", array):
            return numbers.reshape(side, side).astype(float) / (65535 if numbers.max() > 255 else 1)
    raise UsageError(f"{name} holds no square table of numbers{f' called {wanted}' if wanted else ''}")


def told(name: str, reading: Reading) -> dict[str, Any]:
    """Which cells are off, and by how much. `inside`: the largest error apart from the row and the column of the least nodes.

    `map`: the largest error in each of 16 x 16 squares, three digits.
    """
    error = np.abs(reading.values - reading.exact)
    i, j = np.unravel_index(np.argmax(error), error.shape)
    blocks = [np.linspace(0, len(error), _SIDE + 1).astype(int)[:-1]] * 2
    worst = np.maximum.reduceat(np.maximum.reduceat(error, blocks[0], axis=0), blocks[1], axis=1)
    return {
        "name": name,
        "reading": reading.words,
        "cells": error.size,
        "off": [int(np.sum(error > limit)) for limit in LIMITS],
        "largest": float(error[i, j]),
        "inside": float(error[1:, 1:].max()),
        "rms": float(np.sqrt(np.mean(error**2))),
        "roughness": float(reading.nodes[i]),
        "cos_theta": float(reading.nodes[j]),
        "above_1": int(np.sum(reading.values > 1)),
        "map": [[float(f"{value:.3g}") for value in row] for row in worst],
    }
