r"""The whole albedo E(n, mu) of a family as one small rational function, with its error.

E is a rational function P(u, v)/Q(u, v) of two variables that straighten it, each mapped affinely to [-1, 1]:

* of an exponent n: x = 1/sqrt(n + 1), x = 1/sqrt(n + 4) (a lobe of exponent n is about s = 1/sqrt(n) radians wide) or
  x = log(1 + n); of a roughness s: x = s or x = s^2;
* of mu = cos theta: mu itself, or what spreads the layer of width s at grazing incidence: mu/(mu + 2 s) for exponents,
  mu sqrt((1 + s^2)/(mu^2 + s^2)) for a roughness, which is what the masking of rough surfaces is made of; the slope s is
  the square of what renderers call roughness.

All pairs are tried on one grid by the best rational approximation (`brdfcheck.fits.rational`); the winner is then measured on
another, four times finer grid and around its worst point. The stated error includes the bar of the albedo itself.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import ArrayLike, Float

from brdfcheck.brdf.factors import AbstractFactor
from brdfcheck.brdf.family import Family
from brdfcheck.fits.grids import Sampler, formula_of, one_parameter_family
from brdfcheck.fits.rational import Approximation, RationalSurface, best_surface, lower_bound, rounded
from brdfcheck.runtime import double_precision

DEGREES = ((4, 3), (5, 2))
"""Total degrees of numerator and denominator that are tried where no degree is given."""

# By `PointwiseAlbedo.effort`: exponents and cosines of the grid that is fitted, and along each axis of the finer one and of the
# one around its worst point.
_GRIDS = (((33, 29), 129, 17), ((25, 25), 65, 17), ((11, 11), 13, 3), ((11, 11), 13, 3))
# Of a function of one variable, unless it is slow. They are equal, for each number of points is a program to compile.
_ROW_GRID = ((65, 1), 65, 65)
# Its degrees; it is smooth enough for the first of its variables.
_ROW_DEGREES = ((4, 2),)
# By how much an albedo may exceed 1 by rounding.
_ROUNDED = 1e-9
# Grids larger than this are thinned for the first trials; so many of these are then looked at on the whole grid.
_FEW = 400
_PROMISING = 3


@dataclass(frozen=True)
class Variables:
    """How (parameter, mu) becomes (u, v) in [-1, 1]^2: u = (x - u_centre) u_scale, v = (y - v_centre) v_scale.

    `kind` of x: "reciprocal-root", "logarithm", "itself" or "square" of the parameter; `layer` of y: "none", "quotient",
    "root", or "steep", the root with the square of the parameter for s. `describe` gives the formulas.
    """

    kind: str
    shift: float
    layer: str
    u_centre: float = 0.0
    u_scale: float = 1.0
    v_centre: float = 0.0
    v_scale: float = 1.0

    def xy(self, parameter: np.ndarray, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Both variables before they are scaled."""
        x = s = parameter
        if self.kind == "reciprocal-root":
            x = s = 1 / np.sqrt(parameter + self.shift)
        elif self.kind != "itself":
            x = np.log(1 + parameter) if self.kind == "logarithm" else parameter * parameter
        if self.layer == "quotient":
            return x, mu / (mu + 2 * s)
        if self.layer == "steep":
            s = s * s
        return x, mu * np.sqrt((1 + s * s) / (mu * mu + s * s)) if self.layer in ("root", "steep") else mu

    def __call__(self, parameter: np.ndarray, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        x, y = self.xy(parameter, mu)
        return (x - self.u_centre) * self.u_scale, (y - self.v_centre) * self.v_scale

    def describe(self, name: str) -> tuple[str, str]:
        """Formulas of x and y in the parameter called `name`."""
        root = f"1/sqrt({name} + {self.shift:g})"
        x = {"reciprocal-root": root, "logarithm": f"log(1 + {name})", "square": f"{name}^2"}.get(self.kind, name)
        s = "x" if self.kind == "reciprocal-root" else name
        layers = {
            "quotient": f"cos_theta/(cos_theta + 2 {s})",
            "root": f"cos_theta sqrt((1 + {s}^2)/(cos_theta^2 + {s}^2))",
            "steep": f"cos_theta sqrt((1 + {s}^4)/(cos_theta^2 + {s}^4))",
        }
        return x, layers.get(self.layer, "cos_theta")

    @property
    def flops(self) -> int:
        """Operations from (parameter, mu) to (u, v); a root, a logarithm and a division count as one each."""
        return (
            4
            + {"reciprocal-root": 3, "logarithm": 2, "square": 1}.get(self.kind, 0)
            + {"quotient": 3, "root": 8, "steep": 9}.get(self.layer, 0)
        )


@dataclass(frozen=True)
class AlbedoFit:
    """E(parameter, mu) as a rational function. Arguments outside the fitted ranges are moved to their ends.

    `max_error`: the largest absolute error seen on the `checked` grid and around its worst point `where`, plus the bar of the
    albedo itself (`table_error`). `relative_error`: the largest error relative to the albedo, which is met where the albedo is
    small, towards grazing incidence; `rms_error`: both over the same grid. `denominator_bound`: proven lower bound of the
    denominator on the whole square, whose largest coefficient is `denominator_scale`; positive, so there is no pole.
    `clamped`: no albedo that was seen lies outside of [0, 1], and the function does not leave it either.
    """

    name: str
    formula: str
    form: str | None
    parameter: str
    parameter_range: tuple[float, float]
    cos_range: tuple[float, float]
    factor: AbstractFactor | None
    factored: bool
    variables: Variables
    surface: RationalSurface
    degree: tuple[int, int]
    max_error: float
    relative_error: float
    rms_error: float
    table_error: float
    where: Mapping[str, float]
    denominator_bound: float
    fitted: tuple[int, int]
    checked: tuple[int, int]
    clamped: bool = False

    def __call__(self, parameter: Float[ArrayLike, "..."], cos_theta: Float[ArrayLike, "..."] = 1.0) -> np.ndarray:
        """The albedo at parameters and cosines of incidence that broadcast together."""
        p = np.clip(np.asarray(parameter, float), *self.parameter_range)
        mu = np.clip(np.asarray(cos_theta, float), *self.cos_range)
        u, v = self.variables(*np.broadcast_arrays(p, mu))
        return bounded(self.surface(u, v), self.clamped)

    @property
    def coefficients(self) -> int:
        """How many coefficients it has."""
        return self.surface.coefficients

    @property
    def flops(self) -> int:
        """Floating-point operations of one evaluation, variables included."""
        return self.variables.flops + self.surface.flops


def fit_albedo(
    target: Any,
    *,
    cos_theta: tuple[float, float] | None = None,
    degree: tuple[int, int] | None = None,
    **ranges: tuple[float, float],
) -> AlbedoFit:
    """The albedo of a family of one parameter as a rational function of the parameter and cos theta. Deterministic.

    `target` and `ranges`: what `brdfcheck.check` takes, as in ``fit_albedo(Phong, n=(1, 1000))`` or ``fit_albedo("ggx")``; of
    RGB families the largest channel is fitted. `cos_theta`: the cosines of incidence, by default [0, 1]. `degree`: total
    degrees of numerator and denominator, (5, 0) is a polynomial; by default the better of `DEGREES`. Where no such function is
    free of poles, it is a polynomial of the sum of both degrees, which the result's `degree` says.

    Raises ValueError for bad ranges or degrees, an albedo that is not finite, a family that is anisotropic or does not have
    exactly one parameter; KeyError for an unknown name, TypeError for something that is not a BRDF.
    """
    if degree is not None and not _is_degree(degree):
        raise ValueError(f"degree must be two integers (numerator, denominator) from 0 to 8; got {degree!r}")
    with double_precision():
        problem = _Problem(one_parameter_family(target, cos_theta, ranges))
        return problem.fit(DEGREES if degree is None else ((degree[0], degree[1]),))


def fit_share(family: Family, part: Family, degree: tuple[int, int] | None = None) -> AlbedoFit:
    """The share of the albedo of `family` that `part` has, as `fit_albedo` fits an albedo: their quotient.

    Both are over the same parameter. Smooth where both have the same layer at grazing incidence. Raises as `fit_albedo` does.
    """

    class Share(Sampler):
        def __init__(self, family: Family, rtol: float | None):
            super().__init__(family, rtol)
            self.part = Sampler(part, rtol)

        def __call__(self, parameter: np.ndarray, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            (whole, error), (some, own) = super().__call__(parameter, mu), self.part(parameter, mu)
            share = some / whole
            return share, (own + np.abs(share) * error) / np.abs(whole)

    with double_precision():
        return _Problem(family, Share).fit(DEGREES if degree is None else (degree,))


def fit_row(family: Family, row: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], *, cheap: bool = False) -> AlbedoFit:
    """A function of the parameter of `family` alone, such as its average albedo, as `fit_albedo` fits one of two variables.

    `row`: gives values and errors (points,). `cheap`: it costs less than an albedo. Raises as `fit_albedo` does.
    """

    class Row(Sampler):
        def __call__(self, parameter: np.ndarray, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            value, error = (np.repeat(part[:, None], len(mu), axis=1) for part in row(parameter))
            return value, error

    with double_precision():
        return _Problem(replace(family, cos_theta=(1.0, 1.0)), Row, row=True, cheap=cheap).fit(_ROW_DEGREES, 1)


def _is_degree(degree: Any) -> bool:
    if not isinstance(degree, (tuple, list)) or len(degree) != 2:
        return False
    return all(isinstance(part, int) and not isinstance(part, bool) and 0 <= part <= 8 for part in degree)


class _Problem:
    """The samples of one family: those that are fitted and those that the fit is measured on."""

    def __init__(
        self,
        family: Family,
        sampler: Callable[[Family, float | None], Sampler] = Sampler,
        row: bool = False,
        cheap: bool = False,
    ):
        self.sample = sampler(family, None)
        effort = self.sample.albedo.effort
        if effort > 0:  # a fit is good to 1e-4 at best: where accuracy costs time, little of it is asked for
            self.sample = sampler(family, 1e-6)
        self.family = family
        sizes, finer, self.patch = _ROW_GRID if row and (cheap or self.sample.albedo.fast) else _GRIDS[effort]
        varies = [low < high for low, high in (self.sample.range, family.cos_theta)]
        points = [lobatto(size if many else 1) for size, many in zip(sizes, varies, strict=True)]
        self.parameter, self.mu = self._spread(points[0]), self._angles(points[1])
        self.values = self._finite(self.parameter, self.mu)[0]
        points = [np.linspace(0, 1, finer) if many else np.zeros(1) for many in varies]
        self.finer = self._spread(points[0]), self._angles(points[1])
        self.finer_values, self.finer_errors = self._finite(*self.finer)

    def _finite(self, parameter: np.ndarray, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        values, errors = self.sample(parameter, mu)
        for i, j in np.argwhere(~np.isfinite(values)):
            place = f"{self.sample.parameter}={parameter[i]:g}, cos_theta={mu[j]:g}"
            raise ValueError(f"the albedo of {self.family.name} is not finite at {place}")
        return values, errors

    def _spread(self, t: np.ndarray) -> np.ndarray:
        low, high = self.sample.range
        if low < 0 or high <= 10:
            return low + (high - low) * t
        return np.clip(np.expm1(np.log1p(low) + t * (np.log1p(high) - np.log1p(low))), low, high)

    def _angles(self, t: np.ndarray) -> np.ndarray:
        """Denser towards grazing incidence, where the albedo has a layer."""
        low, high = self.family.cos_theta
        return low + (high - low) * (t**2 if low < 0.1 else t)

    def candidates(self) -> list[Variables]:
        """The pairs of variables that are worth a trial on these ranges, scaled to the square."""
        low, high = self.sample.range
        root = "reciprocal-root"
        if low >= 0 and high > 10:
            kinds = [(root, 1.0, "none"), (root, 1.0, "quotient"), (root, 4.0, "none"), ("logarithm", 0.0, "none")]
        elif low > 0:
            layers = ("none", "root", "steep") if self.sample.parameter == "roughness" else ("none", "root")
            kinds = [(kind, 0.0, layer) for kind in ("itself", "square") for layer in layers]
        else:
            kinds = [("itself", 0.0, "none")]
        if self.mu.size == 1:  # a layer would be the parameter in disguise
            kinds = [kind for kind in kinds if kind[2] == "none"]
        return [_scaled(Variables(*kind), self.sample.range, self.family.cos_theta) for kind in kinds]

    def fit(self, degrees: tuple[tuple[int, int], ...], most: int | None = None) -> AlbedoFit:
        """The best of all variables (or so many of them) and `degrees`, with its error."""
        # All trials on a quarter of the points, the most promising ones on all.
        few = 2 if self.values.size > _FEW else 1
        trials = []
        for variables, degree in product(self.candidates()[:most], degrees):
            trial = self._approximation(variables, degree, few)
            trials.append((trial.error, len(trials), variables, degree, trial))
        best: tuple[float, Variables, RationalSurface, tuple[int, int]] | None = None
        for rank, (*_, variables, degree, trial) in enumerate(sorted(trials, key=lambda item: item[:2])):
            if best is not None and rank >= _PROMISING:
                break
            found = self._approximation(variables, degree, 1, trial)
            if (best is None or found.error < best[0]) and lower_bound(found.surface.denominator) > 0:
                best = found.error, variables, found.surface, degree
        if best is None:  # all of them have poles, which polynomials have not
            return self.fit(tuple((up + down, 0) for up, down in degrees), most)
        return self._measured(*best[1:])

    def _approximation(
        self, variables: Variables, degree: tuple[int, int], step: int, start: Approximation | None = None
    ) -> Approximation:
        p, mu = (axis.ravel() for axis in np.meshgrid(self.parameter[::step], self.mu[::step], indexing="ij"))
        return best_surface(*variables(p, mu), self.values[::step, ::step].ravel(), degree, start=start)

    def _measured(self, variables: Variables, surface: RationalSurface, degree: tuple[int, int]) -> AlbedoFit:
        clamped = within_one(self.finer_values, self.finer_errors)

        def residual(axes: tuple[np.ndarray, np.ndarray], values: np.ndarray) -> np.ndarray:
            return np.abs(bounded(surface(*variables(*np.meshgrid(*axes, indexing="ij"))), clamped) - values)

        error = residual(self.finer, self.finer_values)
        total = error + self.finer_errors
        i, j = np.unravel_index(np.argmax(total), total.shape)
        around = tuple(
            np.linspace(axis[max(k - 1, 0)], axis[min(k + 1, len(axis) - 1)], self.patch)
            for axis, k in zip(self.finer, (i, j), strict=True)
        )
        values, errors = self.sample(*around)
        near = residual(around, values) + errors
        k, m = np.unravel_index(np.argmax(near), near.shape)
        worst = near[k, m] >= total[i, j]
        place = (around[0][k], around[1][m]) if worst else (self.finer[0][i], self.finer[1][j])
        sample = self.sample
        return AlbedoFit(
            name=self.family.name,
            formula=formula_of(self.family),
            form=sample.form,
            parameter=sample.parameter,
            parameter_range=sample.range,
            cos_range=self.family.cos_theta,
            factor=sample.factor,
            factored=sample.factored,
            variables=variables,
            surface=surface,
            degree=degree,
            max_error=float(near[k, m] if worst else total[i, j]),
            relative_error=float(np.max(error / np.maximum(np.abs(self.finer_values), np.finfo(float).tiny))),
            rms_error=float(np.sqrt(np.mean(error**2))),
            table_error=float(np.max(self.finer_errors)),
            where={sample.parameter: float(place[0]), "cos_theta": float(place[1])},
            denominator_bound=lower_bound(surface.denominator),
            fitted=(len(self.parameter), len(self.mu)),
            checked=(len(self.finer[0]), len(self.finer[1])),
            clamped=clamped,
        )


def within_one(values: np.ndarray, errors: np.ndarray) -> bool:
    """True where none of some values lies outside of [0, 1] by more than its error and rounding."""
    return bool(np.all((values >= -errors - _ROUNDED) & (values <= 1 + errors + _ROUNDED)))


def bounded(values: np.ndarray, clamped: bool) -> np.ndarray:
    """The values, moved to the nearer end of [0, 1] where they are to be `clamped`."""
    return np.clip(values, 0, 1) if clamped else values


def lobatto(size: int) -> np.ndarray:
    """Chebyshev points on [0, 1] with both ends; 0 alone for one point."""
    return (1 - np.cos(np.pi * np.arange(size) / max(size - 1, 1))) / 2


def _scaled(variables: Variables, parameter: tuple[float, float], cosines: tuple[float, float]) -> Variables:
    """The same variables with the affine maps of their extent to [-1, 1]; both are monotonic in each argument."""
    x, y = np.array([variables.xy(np.array(p), np.array(mu)) for p, mu in product(parameter, cosines)]).T

    def affine(values: np.ndarray) -> tuple[float, float]:
        low, high = float(np.min(values)), float(np.max(values))
        return rounded((low + high) / 2), rounded(2 / (high - low)) if high > low else 1.0

    return replace(
        variables, **dict(zip(("u_centre", "u_scale", "v_centre", "v_scale"), (*affine(x), *affine(y)), strict=True))
    )
