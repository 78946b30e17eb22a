r"""What renderers use instead of a table with error bars: published fits of GGX's split sum, and a plain rule in numpy.

All for GGX with height-correlated Smith masking (Karis' own table has the separable term of Schlick's form with k = alpha/2,
which his approximation therefore fits) and Schlick's Fresnel term: the albedo is F0 scale + bias.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from brdfcheck import GGX, albedo_table

# Of Mitsuba's sampling: samples of a cell, and cells.
_SAMPLES, _CELLS = (2**10, 2**14), 24

Pair = tuple[np.ndarray, np.ndarray]


def materialx(roughness: np.ndarray, mu: np.ndarray) -> Pair:
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
    return np.clip(a / c, 0, 1), np.clip(b / d, 0, 1)


def karis_mobile(roughness: np.ndarray, mu: np.ndarray) -> Pair:
    """Karis' approximation for mobile hardware (2014), in mu and roughness; three.js uses it too."""
    x, y, z, w = (roughness * slope + start for slope, start in ((-1, 1), (-0.0275, 0.0425), (-0.572, 1.04), (0.022, -0.04)))
    a = np.minimum(x * x, np.exp2(-9.28 * mu)) * x + y
    return -1.04 * a + z, 1.04 * a + w


FITS: Mapping[str, Callable[[np.ndarray, np.ndarray], Pair]] = MappingProxyType(
    {"MaterialX, rational": materialx, "Karis 2014, mobile": karis_mobile}
)


def numpy_table(
    alphas: Float[np.ndarray, " rows"], cosines: Float[np.ndarray, " mu"], order: int, f0: float = 1.0
) -> Float[np.ndarray, "rows mu"]:
    """Albedos of GGX by Gauss nodes over the half vector, `order` in the polar angle and in azimuth, cut at the horizon.

    What a careful programmer writes: the polar angle by the distribution itself, tan^2 = alpha^2 u / (1 - u), and u in two
    panels that meet where the horizon begins to cut the circle, with nodes that take out square roots at their ends. Shares no
    code with the rules of the package.
    """
    x, w = np.polynomial.legendre.leggauss(order)
    t, turn = np.sin(np.pi * (x + 1) / 4) ** 2, (x + 1) / 2
    wt = w * np.pi / 4 * np.sin(np.pi * (x + 1) / 2)
    sine_i = np.sqrt(1 - cosines**2)[:, None, None]
    mu = cosines[:, None, None]
    table = np.empty((len(alphas), len(cosines)))
    for row, alpha in enumerate(alphas):
        # The polar angles of H at which its circle meets the horizon of reflected light, and where it lies wholly below.
        theta = np.arccos(cosines)
        ends = [np.tan(part) ** 2 for part in (np.pi / 4 - theta / 2, np.pi / 4 + theta / 2)]
        first, last = (square / (square + alpha**2) for square in ends)
        u = np.concatenate([first[:, None] * t, first[:, None] + (last - first)[:, None] * t], axis=1)[:, :, None]
        weight = np.concatenate([first[:, None] * wt, (last - first)[:, None] * wt], axis=1)
        square = alpha**2 * u / (1 - u)
        cosine = 1 / np.sqrt(1 + square)
        across, along = cosine * mu, np.sqrt(square) * cosine * sine_i
        full = np.arccos(np.clip((mu / (2 * cosine) - across) / np.maximum(along, 1e-300), -1, 1))
        meets = across + along * np.cos(full * turn)
        out = np.clip(2 * meets * cosine - mu, 1e-150, 1)
        lambdas = [(np.sqrt(1 + alpha**2 * (1 - z * z) / (z * z)) - 1) / 2 for z in (mu, out)]
        value = meets / (mu * cosine * (1 + lambdas[0] + lambdas[1]))
        if f0 < 1:
            value = value * (f0 + (1 - f0) * (1 - meets) ** 5)
        table[row] = np.sum(weight * (full[..., 0] / np.pi) * (value @ (w / 2)), axis=1)
    return table


def seconds(job: Callable[[], object]) -> float:
    """Seconds of CPU that a job takes, of all threads together."""
    began = time.process_time()
    job()
    return time.process_time() - began


def mitsuba(peer: Any, rows: Any, columns: Any) -> list[dict[str, Any]]:
    """Its own sampling of the separable form, which is what it has: off by its noise against a table of that form."""
    own = np.asarray(albedo_table(lambda alpha: GGX(alpha, masking="smith-separable"), rows**2, columns).value)
    found = []
    for samples in _SAMPLES:
        rule, cells = peer(samples), [(i, j) for i in range(len(rows)) for j in range(len(columns))][:_CELLS]
        lobes = {i: GGX(rows[i] ** 2, masking="smith-separable") for i in range(len(rows))}
        rule.compute(lobes[0], columns[0], jax.random.key(1))
        began = time.process_time()
        values = [float(rule.compute(lobes[i], columns[j], jax.random.key(k)).value) for k, (i, j) in enumerate(cells)]
        spent = (time.process_time() - began) / len(cells) * 64 * 64
        error = max(abs(value - own[cell]) for value, cell in zip(values, cells, strict=True))
        found.append({"way": "Mitsuba", "setting": f"{samples} samples", "seconds": spent, "error": error, "claimed": None})
    return found


def formula(name: str, scale: Any, bias: Any, ours: Any, nodes: Any) -> dict[str, Any]:
    """How far a pair is off: the largest errors, where, and by row."""
    errors = [np.abs(scale - ours.scale[0]), np.abs(bias - ours.bias[0]), np.abs(scale + bias - ours.grid.values)]
    i, j = np.unravel_index(np.argmax(errors[2]), errors[2].shape)
    return {
        "name": name,
        "scale": float(errors[0].max()),
        "bias": float(errors[1].max()),
        "E": float(errors[2].max()),
        "rms": float(np.sqrt(np.mean(errors[2] ** 2))),
        "roughness": float(nodes[i]),
        "cos_theta": float(nodes[j]),
        "above_1": int(np.sum(scale + bias > 1)),
        "by_row": [float(value) for value in errors[2].max(axis=1)],
    }
