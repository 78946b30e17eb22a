"""A family of one parameter on a grid: the quadrature's albedo, which tables and fits are made of."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float

from brdfcheck.brdf import catalog
from brdfcheck.brdf.base import core_of
from brdfcheck.brdf.factors import AbstractFactor, Normalized, PerCosine
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.subject import as_family
from brdfcheck.quadrature.pointwise import PointwiseAlbedo
from brdfcheck.quadrature.samples import bars
from brdfcheck.runtime import double_precision


@dataclass(frozen=True)
class AlbedoGrid:
    """The albedo of a family on a grid: `values` and `errors` have the shape (parameter, cos_theta); never clamped."""

    family: Family
    parameter: str
    nodes: Float[np.ndarray, " parameter"]
    cos_theta: Float[np.ndarray, " cos_theta"]
    values: Float[np.ndarray, "parameter cos_theta"]
    errors: Float[np.ndarray, "parameter cos_theta"]
    engine: str
    form: str | None
    factor: AbstractFactor | None
    factored: bool
    placement: str


def formula_of(family: Family) -> str:
    """The catalogue's formula of a family, with a note where its factor was replaced; empty for what it does not hold."""
    entry = next((entry for entry in catalog.entries() if entry.name == family.name), None)
    if entry is None:
        return ""
    if entry.family.build is family.build:
        return entry.formula
    return f"{entry.formula}, its factor replaced by the one named below"


def one_parameter_family(target: Any, cos_theta: tuple[float, float] | None, ranges: dict[str, tuple[float, float]]) -> Family:
    """What `brdfcheck.check` takes, as a family of exactly one parameter.

    Raises ValueError for bad ranges or parameters other than one; KeyError and TypeError as `check` does.
    """
    family = as_family(target, ranges, cos_theta)
    if len(family.ranges) != 1:
        raise ValueError(
            f"{family.name} has {len(family.ranges)} parameters ({', '.join(family.ranges) or 'none'}); exactly one is needed"
        )
    return family


class Sampler:
    """The albedo of a family at any points, and what the family is made of."""

    def __init__(self, family: Family, rtol: float | None):
        self.family = family
        ((self.parameter, bounds),) = family.ranges.items()
        self.range = float(bounds[0]), float(bounds[1])
        if self.range[0] < 0 and self.parameter == "n":
            raise ValueError(f"n must be >= 0; got {self.range[0]:g}")
        first, last = (family.build(**{self.parameter: bound}) for bound in bounds)
        self.albedo = PointwiseAlbedo(family)
        if self.albedo.anisotropic:
            raise ValueError(f"{family.name} is anisotropic: its albedo is not a function of {self.parameter} and cos_theta")
        self.rtol = rtol
        self.factor = _constant_factor(first, last)
        self.factored = isinstance(_under_cosine(first), Normalized)
        self.form = getattr(core_of(first), "form", None) if self.albedo.fast else None

    def __call__(self, parameter: np.ndarray, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values and errors on the grid of two axes, shape (parameter, mu)."""
        pairs = np.array(list(product(parameter, mu)))
        value, error = self.at(pairs[:, 0], pairs[:, 1])
        shape = (len(parameter), len(mu))
        return value.reshape(shape), error.reshape(shape)

    def at(self, parameter: np.ndarray, mu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Values and errors at points (points,)."""
        value, error = self.albedo(parameter[:, None], mu, np.zeros(len(mu)), rtol=self.rtol)
        return value, error + bars(self.albedo, mu, np.zeros(len(mu))).max(axis=1)

    def grid(self, nodes: np.ndarray, mu: np.ndarray, values: np.ndarray, errors: np.ndarray, placement: str) -> AlbedoGrid:
        """Values and errors on the grid of two axes with what the family is made of; `placement`: where the nodes lie."""
        return AlbedoGrid(
            self.family, self.parameter, nodes, mu, values, errors, self.albedo.engine_name, self.form, self.factor,
            self.factored, placement,
        )  # fmt: skip


def _under_cosine(brdf: Any) -> Any:
    return _under_cosine(brdf.base) if isinstance(brdf, PerCosine) else brdf


def _constant_factor(first: Any, last: Any) -> AbstractFactor | None:
    """The factor around a lobe where it is the same for the whole range, else None."""
    first, last = _under_cosine(first), _under_cosine(last)
    if not (isinstance(first, Normalized) and isinstance(last, Normalized)):
        return None
    fields = [
        [np.asarray(getattr(brdf.factor, name)).tolist() for name in brdf.factor.__dataclass_fields__] for brdf in (first, last)
    ]
    return first.factor if type(first.factor) is type(last.factor) and fields[0] == fields[1] else None


def spaced(low: float, high: float, position: np.ndarray) -> tuple[np.ndarray, str]:
    """Numbers at `position` in [0, 1] of a parameter's range, and the rule in words.

    Geometric where the range spans a factor above 10, geometric in 1 + p from 0 on, else evenly.
    """
    if low > 0 and high > 10 * low and high > 2:
        return low * (high / low) ** position, f"{low:g} * ({high:g}/{low:g})^t"
    if low >= 0 and high > 10:
        ratio = (1 + high) / (1 + low)
        return (1 + low) * ratio**position - 1, f"(1+{low:g}) ((1+{high:g})/(1+{low:g}))^t - 1"
    return low + position * (high - low), f"{low:g} + t ({high:g} - {low:g})"


def tabulate(
    target: Any,
    *,
    count: tuple[int, int] = (64, 64),
    cos_theta: tuple[float, float] | None = None,
    **ranges: tuple[float, float],
) -> AlbedoGrid:
    """The quadrature's albedo on a grid of `count` (parameter, cos_theta) nodes, with the factor, never clamped.

    `target`, `cos_theta`, `ranges` as for `fit_albedo`. Node k of N is at t = (k + 1/2)/N, as the texels of a texture lie.
    cos_theta runs evenly in t; a parameter that spans more than a factor of 10 geometrically. RGB families: the largest
    channel. Raises as `fit_albedo` does, and ValueError for counts below 2.
    """
    if len(count) != 2 or any(isinstance(size, bool) or not isinstance(size, (int, np.integer)) or size < 2 for size in count):
        raise ValueError(f"count must be two integers >= 2; got {count!r}")
    with double_precision():
        family = one_parameter_family(target, cos_theta, ranges)
        sampler = Sampler(family, None)
        single = sampler.range[0] == sampler.range[1]  # then one row says all
        t = [(np.arange(size) + 0.5) / size for size in (1 if single else count[0], count[1])]
        nodes, rule = spaced(*sampler.range, t[0])
        low, high = family.cos_theta
        mu = low + (high - low) * t[1]
        words = f"node k of N at t = (k + 1/2)/N; {sampler.parameter} = {rule}; cos_theta = {low:g} + t ({high:g} - {low:g})"
        return sampler.grid(nodes, mu, *sampler(nodes, mu), words)
