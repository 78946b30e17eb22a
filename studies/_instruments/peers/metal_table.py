r"""The table that others make too: albedos of Beckmann metal (F = 1, separable Smith masking) over slopes and cosines.

`slope_table` is a reference: a Gauss rule in numpy over the slopes of the facets, which shares nothing with the rules of this
package. `scipy_table` is the strongest peer: `dblquad` with a C callback compiled by numba, over half vectors above the
horizon, the rows shared out among processes.

With H proportional to (x, y, 1), the light at azimuth 0 and T = tan(theta), the Jacobians cancel (Walter et al. 2007,
Heitz 2014):

$E = \int\int G_1(\mu_i)\, G_1(\mu_o)\, \frac{e^{-r^2/m^2}}{\pi m^2} (1 + x T)\, dx\, dy$,
$\mu_o = \mu_i \left(2 \frac{1 + x T}{1 + r^2} - 1\right)$, over the disk where $\mu_o > 0$.
"""

from __future__ import annotations

import functools
import math
import multiprocessing
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any

import numpy as np
from jaxtyping import Float

from _instruments import Unheard
from _instruments.peers.peer import load, not_installed

# exp(-42) = 6e-19: slopes beyond 6.5 m add nothing.
_LARGEST_SLOPE = 6.5
_TOLERANCE = 1e-9


def _masking(mu: np.ndarray, m: float) -> np.ndarray:
    """Smith's G1 = 1/(1 + Lambda) of Beckmann facets at cosines mu >= 0."""
    from scipy.special import erf

    tangent = np.sqrt(np.maximum((1 - mu) * (1 + mu), 1e-300))
    a = np.minimum(mu / (m * tangent), 40)  # beyond, Lambda is 0
    root = math.sqrt(math.pi)
    return 2 * root * a / (root * a * (1 + erf(a)) + np.exp(-a * a))


def _panels(edges: np.ndarray, order: int) -> tuple[np.ndarray, np.ndarray]:
    """Nodes and weights on the panels between rising edges; the map sin^2(pi u/2) takes out square roots at their ends."""
    x, w = np.polynomial.legendre.leggauss(order)
    u = (1 + x) / 2
    nodes, weights = np.sin(np.pi * u / 2) ** 2, w / 2 * np.pi / 2 * np.sin(np.pi * u)
    length = np.diff(edges)[:, None]
    return (edges[:-1, None] + length * nodes).ravel(), (length * weights).ravel()


def slope_table(
    slopes: Float[np.ndarray, " m"], cosines: Float[np.ndarray, " mu"], order: int = 48
) -> Float[np.ndarray, "m mu"]:
    """Albedos by `order` Gauss nodes on each panel of |slope| and twice as many in azimuth; cosines in (0, 1).

    Polar coordinates: below r = sqrt(1 + T^2) - T the whole circle is above the horizon, beyond it the azimuths with
    cos(phi) > (r^2 - 1)/(2 r T). Order 40 is good to 1e-13 from m = 1/64 and mu = 1/64 on.
    """
    x, w = np.polynomial.legendre.leggauss(2 * order)
    turn, turn_weight = (1 + x) / 2, w / 2
    table = np.empty((len(slopes), len(cosines)))
    for i, m in enumerate(slopes):
        for j, mu in enumerate(cosines):
            tangent = math.sqrt((1 - mu) * (1 + mu)) / mu
            kink, largest = math.hypot(1, tangent) - tangent, math.hypot(1, tangent) + tangent
            end = min(_LARGEST_SLOPE * m, largest)
            # Layers of the lobe's width, and of the kink's place beyond it.
            edges = np.concatenate(
                [m * np.arange(0, _LARGEST_SLOPE, 1.3), kink * np.array([1, 1.5, *(3 * 2.0 ** np.arange(8))]), [end]]
            )
            r, weight = _panels(np.unique(np.append(edges[edges < end], end)), order)
            full = np.arccos(np.clip((r * r - 1) / np.maximum(2 * r * tangent, 1e-300), -1, 1))
            phi = full[:, None] * turn
            lift = 1 + r[:, None] * tangent * np.cos(phi)
            out = np.clip(mu * (2 * lift / (1 + r * r)[:, None] - 1), 0, 1)
            ring = 2 * full * ((_masking(out, m) * lift) @ turn_weight)
            density = np.exp(-((r / m) ** 2)) / (np.pi * m * m)
            table[i, j] = float(_masking(np.asarray(mu), m)) * float(np.sum(weight * r * density * ring))
    return table


def missing() -> str | None:
    """None where `scipy_table` can run; else a message that says what is missing."""
    return not_installed("numba")


@functools.cache
def _callback() -> Any:
    from scipy import LowLevelCallable

    numba = load("numba")
    carray, cfunc, types = numba.carray, numba.cfunc, numba.types

    @cfunc(types.double(types.intc, types.CPointer(types.double)))
    def integrand(_count: Any, arguments: Any) -> float:
        values = carray(arguments, (4,))
        phi, gamma, m, mu = values[0], values[1], values[2], values[3]
        cosine, sine = math.cos(gamma), math.sin(gamma)
        incident = cosine * mu + sine * math.sqrt(1 - mu * mu) * math.cos(phi)
        out = 2 * incident * cosine - mu
        if out <= 0 or incident <= 0:
            return 0.0
        tangent = sine / cosine
        density = math.exp(-tangent * tangent / (m * m)) / (math.pi * m * m * cosine**4)

        def masking(z: float) -> float:
            if z >= 1:
                return 1.0
            a = z / (m * math.sqrt(1 - z * z))
            return 1 / (1 + (math.erf(a) - 1) / 2 + math.exp(-a * a) / (2 * a * math.sqrt(math.pi)))

        return 2 * density * masking(mu) * masking(out) * incident / mu * sine

    return LowLevelCallable(integrand.ctypes)


def _row(m: float, cosines: Sequence[float]) -> list[float]:
    from scipy.integrate import dblquad

    callback = _callback()
    values = []
    for mu in cosines:
        theta = math.acos(mu)

        def horizon(gamma: float, theta: float = theta, mu: float = mu) -> float:
            across, along = math.cos(gamma) * mu, math.sin(gamma) * math.sin(theta)
            if along == 0:
                return math.pi
            return math.acos(min(max((mu / (2 * math.cos(gamma)) - across) / along, -1), 1))

        end = min(math.pi / 4 + theta / 2, math.atan(6 * m))
        start = min(math.pi / 4 - theta / 2, end)
        total = 0.0
        for low, high in ((0, start), (start, end)):
            if high > low:
                total += dblquad(callback, low, high, 0, horizon, args=(m, mu), epsabs=_TOLERANCE, epsrel=_TOLERANCE)[0]
        values.append(total)
    return values


def scipy_table(
    slopes: Float[np.ndarray, " m"], cosines: Float[np.ndarray, " mu"], processes: int
) -> tuple[Float[np.ndarray, "m mu"], float]:
    """(albedos, seconds) by scipy's `dblquad` in so many processes; starting and compiling them is not in the seconds."""
    row = functools.partial(_row, cosines=[float(mu) for mu in cosines])
    with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        with Unheard():
            warm = pool.map(row, [float(slopes[-1])] * processes)
        list(warm)
        began = time.perf_counter()
        rows = list(pool.map(row, [float(m) for m in slopes]))
        seconds = time.perf_counter() - began
    return np.array(rows), seconds
