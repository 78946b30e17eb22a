"""Other ways to make a table of albedos: a plain rule in numpy, Mitsuba's sampling, scipy's `dblquad` compiled by numba."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from _instruments import timing
from _instruments.peers import metal_table
from brdfcheck import GGX, CookTorrance, albedo_table
from brdfcheck.cores import available_cores

# Of Mitsuba's sampling: samples of a cell, and cells.
_SAMPLES, _CELLS = (2**10, 2**14), 24


def numpy_table(
    alphas: Float[np.ndarray, " rows"], cosines: Float[np.ndarray, " mu"], order: int
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
        rule.integrate(lobes[0], columns[0], jax.random.key(1))
        began = time.process_time()
        values = [float(rule.integrate(lobes[i], columns[j], jax.random.key(k)).value) for k, (i, j) in enumerate(cells)]
        spent = (time.process_time() - began) / len(cells) * 64 * 64
        error = max(abs(value - own[cell]) for value, cell in zip(values, cells, strict=True))
        way = {"job": "GGX", "way": "Mitsuba", "setting": f"{samples} samples"}
        found.append({**way, "seconds": spent, "error": error, "claimed": None})
    return found


def _metal(m: Any) -> CookTorrance:
    """One function for all tables: for another one a program is compiled."""
    return CookTorrance(m, masking="smith-separable")


def metal() -> tuple[list[dict[str, Any]], str | None]:
    """The table of Beckmann metal that others make too, by us and by scipy on all cores; why scipy's is missing, if it is."""
    nodes = (np.arange(32) + 0.5) / 32
    exact = metal_table.slope_table(nodes, nodes)
    found = []

    def add(way: str, setting: str, spent: float, values: Any, claimed: float | None = None) -> None:
        error = float(np.max(np.abs(values - exact)))
        found.append({"way": way, "setting": setting, "seconds": spent, "error": error, "claimed": claimed, "job": "Beckmann"})

    for rtol in (1e-6, 1e-10):

        def table(rtol: float = rtol) -> tuple[np.ndarray, np.ndarray]:
            made = albedo_table(_metal, nodes, nodes, rtol=rtol)
            return np.asarray(made.value), np.asarray(made.error)

        value, error = table()
        add("brdfcheck", f"rtol {rtol:g}", timing.fastest(table, 5), value, float(np.max(error)))
    if (message := metal_table.missing()) is None:
        cores = len(available_cores())
        values, spent = metal_table.scipy_table(nodes, nodes, cores)
        add("scipy with numba", f"dblquad, {cores} processes", spent, values)
    return found, message
