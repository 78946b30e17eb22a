r"""The multiple-scattering compensation of Kulla and Conty (2017), as a renderer has it: looked up in a table.

What a lobe with F = 1 loses, light that leaves after more than one bounce, comes back as

$f_{ms}(\omega_i, \omega_o) = \frac{(1 - E(\mu_i))\,(1 - E(\mu_o))}{\pi\,(1 - E_{avg})}$,

whose albedo is 1 - E where E and its average are exact. With E looked up linearly between nodes, as $\hat E$, and the average
taken of $\hat E$ itself, the albedo of both together is exactly $1 + E - \hat E$: above 1 wherever the table lies below the
albedo, that is where this is convex upwards. So the compensation has a table of its own, raised at each node by as much as E
exceeds the look-up in the cells around it; then it conserves, and what it still loses is measured.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.ndimage import maximum_filter

from brdfcheck.brdf.callables import with_options_of
from brdfcheck.brdf.calling import directional
from brdfcheck.brdf.family import Family
from brdfcheck.fits.renderer import RendererTable, cells
from brdfcheck.messages import UsageError
from brdfcheck.runtime import double_precision
from brdfcheck.verdict import Report
from brdfcheck.verdict.checking import check_family

# Of a parabola the middle of a cell misses the most; this is for what bends otherwise.
_MARGIN = 1.25
# What 1 less the average is at least, so that where nothing is lost a renderer divides nothing by something, in float32 too.
_SMALLEST = 1e-6
_RTOL = 1e-4


@dataclass(frozen=True)
class Compensation:
    """`energy`: the raised table of E (parameter, cos_theta), `average`: its averages (parameter,), to be looked up linearly.

    `excess`: by how much the albedo would exceed 1 with the table of E as it is; `loss`: how much is still lost with the raised
    one; both largest on `points` cells between and beyond the nodes. `family`: the compensated BRDF.
    """

    energy: Float[np.ndarray, "parameter cos_theta"]
    average: Float[np.ndarray, " parameter"]
    excess: float
    loss: float
    points: tuple[int, int]
    family: Family


def compensation(table: RendererTable, rtol: float | None = None, row: Callable[[], None] = lambda: None) -> Compensation:
    """The compensation of a table's target, which must have a Fresnel term of 1 where it has one.

    `rtol` and `row` as for `cells`. UsageError where the target's Fresnel term is not 1, where not all angles are looked at, or
    where E exceeds 1: then nothing is lost.
    """
    found, grid = table.sources, table.grid
    name = found.family.name
    if found.white is not None and found.white is not found.family:
        raise UsageError(f"{name}: the compensation is that of facets with F = 1; hold F0 at 1, or leave the Fresnel term out")
    if table.average is None:
        raise UsageError(f"{name}: the compensation needs all angles of incidence; leave --cos-theta out")
    with double_precision():
        above = grid.values - grid.errors > 1
        if np.any(above):
            i, j = np.unravel_index(np.argmax(grid.values), grid.values.shape)
            place = f"{grid.parameter}={grid.nodes[i]:g}, cos_theta={grid.cos_theta[j]:g}"
            raise UsageError(
                f"{name}: the albedo is {grid.values[i, j]:.6g} at {place}: above 1 there is no loss to compensate"
            )
        low, high = found.family.ranges[grid.parameter]
        axes = _between(grid.nodes, low, high), _between(grid.cos_theta, 0.0, 1.0)
        values, bars = cells(found.family, axes[0], axes[1], rtol, row)
        missed = values + bars - _looked_up(grid.nodes, grid.cos_theta, grid.values, *axes)
        around = maximum_filter(np.maximum(missed, 0), size=5, mode="nearest")[1::2, 1::2]
        energy = np.minimum(grid.values + grid.errors + _MARGIN * around, 1)
        exact = averages(grid.cos_theta, energy)
        average = np.minimum(exact, 1 - _SMALLEST)
        returned, divisor = (1 - np.interp(axes[0], grid.nodes, row) for row in (exact, average))
        added = (1 - _looked_up(grid.nodes, grid.cos_theta, energy, *axes)) * (returned / divisor)[:, None]
        return Compensation(
            energy, average, float(np.max(missed - bars)), float(np.max(1 - values - added)), (len(axes[0]), len(axes[1])),
            _compensated(table, energy, average),
        )  # fmt: skip


def averages(mu: Float[np.ndarray, " n"], energy: Float[np.ndarray, "rows n"]) -> Float[np.ndarray, " rows"]:
    r"""$2 \int_0^1 \hat E\, \mu\, d\mu$ of rows that run linearly between the nodes `mu` and are level beyond them. Exact."""
    x = np.concatenate([[0.0], mu, [1.0]])
    y = np.concatenate([energy[:, :1], energy, energy[:, -1:]], axis=1)
    low, high = x[:-1], x[1:]
    return ((high - low) * (y[:, :-1] * (2 * low + high) + y[:, 1:] * (low + 2 * high))).sum(axis=1) / 3


def _between(nodes: np.ndarray, low: float, high: float) -> np.ndarray:
    """The ends of the range, the nodes and the middles between them, 2 N + 1 in all: node k is number 2 k + 1."""
    ends = np.concatenate([[low], nodes, [high]])
    found = np.empty(2 * len(nodes) + 1)
    found[1::2] = nodes
    found[0::2] = (ends[:-1] + ends[1:]) / 2
    found[0], found[-1] = low, high
    return found


def _looked_up(p: np.ndarray, mu: np.ndarray, table: np.ndarray, at_p: np.ndarray, at_mu: np.ndarray) -> np.ndarray:
    """The table between its nodes, linear along each axis and level beyond: (at_p, at_mu)."""
    across = np.stack([np.interp(at_mu, mu, row) for row in table])
    return np.stack([np.interp(at_p, p, column) for column in across.T], axis=1)


def _compensated(table: RendererTable, energy: np.ndarray, average: np.ndarray) -> Family:
    family, grid = table.sources.family, table.grid
    nodes, mu = grid.nodes, grid.cos_theta

    def build(**own: Any) -> Callable[[Any, Any], Any]:
        base = directional(family.build(**own))
        (number,) = own.values()
        # Along the parameter once for each BRDF, along mu for each pair.
        row = jax.vmap(lambda column: jnp.interp(number, nodes, column), in_axes=1)(jnp.asarray(energy))
        mean = jnp.interp(number, nodes, average)

        def brdf(wi: Float[Array, "... 3"], wo: Float[Array, "... 3"]) -> Any:
            missing = [1 - jnp.interp(w[..., 2], mu, row) for w in (jnp.asarray(wi), jnp.asarray(wo))]
            above = (wi[..., 2] > 0) & (wo[..., 2] > 0)
            more = jnp.where(above, missing[0] * missing[1] / (jnp.pi * (1 - mean)), 0)
            value = base(wi, wo)
            return value + (more[..., None] if jnp.ndim(value) > jnp.ndim(more) else more)

        return brdf

    build.__name__ = f"{family.name}-compensated"
    return replace(family, name=build.__name__, build=with_options_of(family.build, build), tolerance=1e-6)


def checked(found: Compensation) -> Report:
    """`check` of the compensated BRDF as a function of two directions, from cos theta 0.01 on, with a tolerance of 5e-4.

    It refutes a table that violates. Of one that conserves it mostly says UNDECIDED: the albedo is 1 wherever nothing is lost,
    and look-ups have an edge in every cell, so that the search does not settle and its bar is 2e-3. The grid of
    `compensation` is finer: there nothing exceeds 1 by more than the bars of the table.
    """
    family = replace(found.family, cos_theta=(0.01, 1.0))
    return check_family(family, tolerance=5e-4, rtol=_RTOL, intervals=False, effort="quick")
