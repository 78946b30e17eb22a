"""Where methods hold, lose digits, lie or break: rules over a matrix of lobes, exponents, angles, precisions and modes.

The references, derivatives included, come from elsewhere (`read_references`): ball arithmetic and slope-space integrals,
none of the rules.
"""

from __future__ import annotations

import contextlib
import csv
import enum
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.directional import albedo
from brdfcheck.exact_factors import exact_factor
from brdfcheck.factors import AbstractFactor, Normalized
from brdfcheck.family import Family
from brdfcheck.lobes import BinomialPower, BlinnPhong, KuijkBlake, Lyon, Phong, Schlick
from brdfcheck.microfacet import GGX, CookTorrance
from brdfcheck.quadrature.rule import NOT_KNOWN, AbstractRule
from brdfcheck.verdict import TOLERANCE, Verdict, check_family

# The names of the references, and what builds the lobe from its exponent or slope.
LOBES: Mapping[str, Callable[[Any], Any]] = {
    "phong": Phong,
    "blinn": BlinnPhong,
    "schlick": Schlick,
    "schlick_half": lambda n: Schlick(n, "half"),
    "kb": KuijkBlake,
    "kb_half": lambda n: KuijkBlake(n, "half"),
    "lyon1": lambda n: Lyon(n, 1),
    "lyon1_mirror": lambda n: Lyon(n, 1, "mirror"),
    "lyon2": lambda n: Lyon(n, 2),
    "lyon2_mirror": lambda n: Lyon(n, 2, "mirror"),
    "lyon3": lambda n: Lyon(n, 3),
    "lyon3_mirror": lambda n: Lyon(n, 3, "mirror"),
    "lyon4_mirror": lambda n: Lyon(n, 4, "mirror"),
    "lyon5": lambda n: Lyon(n, 5),
    "lyon5_mirror": lambda n: Lyon(n, 5, "mirror"),
    "lyon6": lambda n: Lyon(n, 6),
    "lyon6_mirror": lambda n: Lyon(n, 6, "mirror"),
    "binomial4": lambda n: BinomialPower(n, 4),
    "binomial8": lambda n: BinomialPower(n, 8),
    "binomial8_mirror": lambda n: BinomialPower(n, 8, "mirror"),
    "binomial8_unclamped": lambda n: BinomialPower(n, 8, clamped=False),
    "binomial8_mirror_unclamped": lambda n: BinomialPower(n, 8, "mirror", clamped=False),
    "binomial16": BinomialPower,
    "binomial16_mirror": lambda n: BinomialPower(n, form="mirror"),
    "binomial16_unclamped": lambda n: BinomialPower(n, clamped=False),
    "binomial16_mirror_unclamped": lambda n: BinomialPower(n, form="mirror", clamped=False),
    "binomial32": lambda n: BinomialPower(n, 32),
    "binomial64": lambda n: BinomialPower(n, 64),
    "cook-torrance": CookTorrance,
    "beckmann-smith": lambda m: CookTorrance(m, masking="smith-separable"),
    "beckmann-smith-correlated": lambda m: CookTorrance(m, masking="smith-correlated"),
    "ggx": GGX,
}
MICROFACETS = ("cook-torrance", "beckmann-smith", "beckmann-smith-correlated", "ggx")
# One lobe of each kind: power, tail, kinks in both forms, a rebound, masking with and without kinks, facets with a tail.
KINDS = ("phong", "schlick", "kb_half", "lyon1_mirror", "binomial16_unclamped", "cook-torrance", "ggx")


def label(lobe: str) -> str:
    """The name of a reference as a figure shows it: "Lyon w = 1, mirror"."""
    fixed = {
        "phong": "Phong",
        "blinn": "Blinn-Phong",
        "cook-torrance": "Cook-Torrance",
        "beckmann-smith": "Beckmann-Smith",
        "beckmann-smith-correlated": "Beckmann-Smith, correlated",
        "ggx": "GGX",
    }
    if lobe in fixed:
        return fixed[lobe]
    family, *rest = lobe.split("_")
    name, digits = family.rstrip("0123456789"), family.lstrip("abcdefghijklmnopqrstuvwxyz")
    built: Any = LOBES[lobe](1.0)
    called = {"schlick": "Schlick", "kb": "Kuijk-Blake", "lyon": f"Lyon w = {digits}", "binomial": f"binomial k = {digits}"}
    return ", ".join((called[name], built.form, *(["unclamped"] if "unclamped" in rest else [])))


class Outcome(enum.IntEnum):
    """What became of one albedo, from good to bad."""

    HOLDS = 0
    LOSES_DIGITS = 1
    LIES = 2
    BREAKS = 3


# Relative errors up to which a result holds: what each precision should give.
HOLDS = {"float64": 1e-8, "float32": 1e-4}
# From this relative error on the result has nothing to do with the albedo.
_BROKEN = 0.5
# The same for derivatives.
GRADIENT_HOLDS = {"float64": 1e-3, "float32": 1e-2}
NOT_ASKED = -1
"""In place of an `Outcome`: a rule without a formula there, or a derivative that no number of the precision can hold."""


@dataclass(frozen=True)
class Reference:
    """The albedo of a lobe at its parameters (rows) and cosines of incidence (columns), and how far it may be off.

    `slopes`: its derivatives, by what is varied: "n" for n dE/dn (or m dE/dm), "theta" for dE/dtheta, to 1e-6 of the larger of
    themselves and E. At 90 degrees it is that from below; of microfacets the one that `quadrature.half_vector` defines, in
    float32 under the name "theta, float32".
    """

    lobe: str
    parameters: np.ndarray
    cosines: np.ndarray
    albedo: np.ndarray
    radius: np.ndarray
    slopes: Mapping[str, np.ndarray]

    def slope(self, by: str, dtype: Any) -> np.ndarray:
        """The derivative by "n" or "theta" as it is defined in a precision."""
        return self.slopes.get(f"{by}, {np.dtype(dtype).name}", self.slopes[by])


def read_references(path: str | Path) -> dict[str, Reference]:
    """The references of a CSV file: a full grid for each lobe.

    Its columns: lobe, n, cos_theta, albedo, radius, by_logarithm, by_angle, by_angle_float32. ValueError where a lobe's grid
    has holes.
    """
    numbers = ("albedo", "radius", "by_logarithm", "by_angle", "by_angle_float32")
    cells: dict[str, dict[tuple[float, float], list[float]]] = {}
    with open(path, newline="", encoding="utf-8") as source:
        for row in csv.DictReader(source):
            place = (float(row["n"]), float(row["cos_theta"]))
            cells.setdefault(row["lobe"], {})[place] = [float(row[name]) for name in numbers]
    found = {}
    for lobe, values in cells.items():
        parameters = np.array(sorted({n for n, _ in values}))
        cosines = np.array(sorted({mu for _, mu in values}, reverse=True))
        missing = [(n, mu) for n in parameters for mu in cosines if (n, mu) not in values]
        if missing:
            raise ValueError(f"{path}: {lobe} has no albedo at n={missing[0][0]:g}, cos_theta={missing[0][1]:g}")
        grid = np.array([[values[n, mu] for mu in cosines] for n in parameters])
        slopes = {"n": grid[..., 2], "theta": grid[..., 3], "theta, float32": grid[..., 4]}
        found[lobe] = Reference(lobe, parameters, cosines, grid[..., 0], grid[..., 1], slopes)
    return found


@dataclass(frozen=True)
class Result:
    """What a method says over a lobe's grid: values and claimed absolute errors, both (parameter, cos_theta).

    `known`: False where it says that it knows nothing (a closed form that does not exist).
    """

    value: np.ndarray
    claimed: np.ndarray
    known: np.ndarray


Method = Callable[[Any, Any], tuple[Any, Any, Any]]
"""(BRDF, cosines (cos_theta,)) -> (values, claimed errors, known), all (cos_theta,)."""


def production(brdf: Any, cos_theta: Any) -> tuple[Any, Any, Any]:
    """The package's own rule: `brdfcheck.albedo`."""
    answer = albedo(brdf, cos_theta)
    return answer.value, answer.error, jnp.ones(answer.value.shape, bool)


def of_rule(rule: AbstractRule, seed: int = 0) -> Method:
    """A rule of the registry as a method; rules with chance in them get the key of that seed."""

    def method(brdf: Any, cos_theta: Any) -> tuple[Any, Any, Any]:
        answer = rule(brdf, cos_theta, key=jax.random.key(seed) if rule.random else None)
        return answer.value, answer.error, answer.status != NOT_KNOWN

    return method


Mode = Literal["jit", "eager", "host"]


def run(method: Method, lobe: str, parameters: np.ndarray, cosines: np.ndarray, dtype: Any, *, mode: Mode = "jit") -> Result:
    """A method over a lobe's grid in one precision.

    `mode`: one compiled program; "eager", operation by operation; "host", for rules that call programs of their own.
    """
    build = LOBES[lobe]
    mu = jnp.asarray(cosines, dtype)

    def row(parameter: Any, mu: Any) -> tuple[Any, Any, Any]:
        # All numbers of the BRDF in this precision: one wide one would make the whole computation wide.
        return method(jax.tree.map(lambda leaf: leaf.astype(dtype), build(parameter)), mu)

    values = jnp.asarray(parameters, dtype)
    if mode == "jit":
        found = _rows(row, values, mu)
    else:
        with jax.disable_jit() if mode == "eager" else contextlib.nullcontext():
            rows = [row(one, mu) for one in values]
        found = (np.stack([np.asarray(part) for part in column]) for column in zip(*rows, strict=True))
    value, claimed, known = found
    return Result(np.asarray(value, float), np.asarray(claimed, float), np.asarray(known))


@eqx.filter_jit
def _rows(row: Callable[[Any, Any], tuple[Any, Any, Any]], values: Any, mu: Any) -> tuple[Any, Any, Any]:
    return jax.lax.map(lambda one: row(one, mu), values)


def outcomes(result: Result, reference: Reference, dtype: Any) -> np.ndarray:
    """An `Outcome` for each cell, or `NOT_ASKED`.

    BREAKS: not finite, or wrong by half. LIES: wrong by more than the claimed error and the reference's. LOSES_DIGITS: wrong by
    more than the precision should give. What no float of this precision can hold counts as holding where it is reported as inf
    of unknown error, and what is smaller than all its floats where nothing but a number as small is reported.
    """
    limits = jnp.finfo(dtype)
    exact, slack = reference.albedo, reference.radius
    with np.errstate(all="ignore"):
        error = np.abs(result.value - exact)
        relative = (error - slack) / np.abs(exact)
        claims = np.isfinite(result.claimed)
        found = np.full(exact.shape, Outcome.HOLDS, int)
        found[relative > HOLDS[np.dtype(dtype).name]] = Outcome.LOSES_DIGITS
        found[claims & (error > result.claimed + slack + float(limits.tiny))] = Outcome.LIES
        found[~np.isfinite(result.value) | (relative > _BROKEN)] = Outcome.BREAKS
        overflow = (exact > float(limits.max) / 1e4) & np.isposinf(result.value) & np.isposinf(result.claimed)
        underflow = (np.abs(exact) < float(limits.tiny) * 1e4) & (np.abs(result.value) < float(limits.tiny) * 2e4)
    found[overflow | underflow] = Outcome.HOLDS
    return np.where(result.known, found, NOT_ASKED)


@dataclass(frozen=True)
class Gradients:
    """A derivative over a lobe's grid: of a method by differentiation, the reference's, and E, all (parameter, cos_theta)."""

    automatic: np.ndarray
    exact: np.ndarray
    scale: np.ndarray

    @property
    def deviation(self) -> np.ndarray:
        """Their difference relative to the larger of the exact one and E."""
        with np.errstate(all="ignore"):
            return np.abs(self.automatic - self.exact) / np.maximum(np.abs(self.exact), np.abs(self.scale))


def gradients_of(reference: Reference, method: Method = production, dtype: Any = np.float64) -> dict[str, Gradients]:
    """Both derivatives of a method over the grid of a reference, by what is varied: "n" (or the slope m) and "theta"."""
    build = LOBES[reference.lobe]

    def one(parameter: Any, mu: Any) -> Any:
        return method(jax.tree.map(lambda leaf: leaf.astype(dtype), build(parameter)), mu[None])[0][0]

    grid = _gradient_rows(
        jax.grad(one, argnums=(0, 1)), jnp.asarray(reference.parameters, dtype), jnp.asarray(reference.cosines, dtype)
    )
    by_parameter, by_cosine = (np.asarray(part, float) for part in grid)
    # Through cosines: in float32 the cosine of 90 degrees would be negative.
    sine = np.sqrt((1 - reference.cosines) * (1 + reference.cosines))
    automatic = {"n": by_parameter * reference.parameters[:, None], "theta": -sine * by_cosine}
    return {by: Gradients(part, reference.slope(by, dtype), reference.albedo) for by, part in automatic.items()}


@eqx.filter_jit
def _gradient_rows(gradient: Callable[[Any, Any], tuple[Any, Any]], parameters: Any, cosines: Any) -> tuple[Any, Any]:
    return jax.lax.map(lambda a: jax.vmap(lambda b: gradient(a, b))(cosines), parameters)


def gradient_outcomes(gradients: Gradients, dtype: Any = np.float64) -> np.ndarray:
    """An `Outcome` for each derivative, or `NOT_ASKED` where E or the derivative does not fit into the precision."""
    deviation, limits = gradients.deviation, jnp.finfo(dtype)
    found = np.where(deviation > GRADIENT_HOLDS[np.dtype(dtype).name], Outcome.LOSES_DIGITS, Outcome.HOLDS)
    found = np.where(~np.isfinite(gradients.automatic) | (deviation > _BROKEN), Outcome.BREAKS, found)
    size = np.maximum(np.abs(gradients.exact), np.abs(gradients.scale))
    # Reverse mode carries squares of what it differentiates.
    fits = (size < float(limits.max) ** 0.5) & (np.abs(gradients.scale) > float(limits.tiny) * 1e4)
    return np.where(fits, found, NOT_ASKED)


# Lobes with an exact factor whose albedo is largest at normal incidence (the references say so).
_EXACT = tuple(name for name in LOBES if name not in MICROFACETS and "unclamped" not in name and name != "schlick_half")


def false_verdicts(count: int, seed: int = 1) -> dict[str, int]:
    """Verdicts of `check` on `count` random factors within 1e-6 of the exact one: random lobes, random exponent ranges.

    Such a factor, the exact one times 1 + e, conserves if and only if e <= the tolerance, whatever the range: these lobes are
    worst at normal incidence. UNDECIDED is counted apart and is not false, where |e - tolerance| is within the error bar.
    """
    random = np.random.default_rng(seed)
    factors = {name: exact_factor(LOBES[name](1.0)) for name in _EXACT}
    false = undecided = 0
    for _ in range(count):
        excess = float(random.choice([-1, 1]) * 10 ** random.uniform(-12, -6))
        low = float(10 ** random.uniform(0, 3))
        high = float(low * 10 ** random.uniform(0, 2))
        lobe = _EXACT[int(random.integers(len(_EXACT)))]
        build, factor = LOBES[lobe], _Excess(factors[lobe], 1 + excess)
        family = Family("random factor", lambda n, b=build, factor=factor: Normalized(b(n), factor), {"n": (low, high)})
        report = check_family(family, intervals=bool(random.random() < 0.1))
        wanted = Verdict.VIOLATES if excess > TOLERANCE else Verdict.CONSERVES
        undecided += report.verdict is Verdict.UNDECIDED
        false += report.verdict not in (wanted, Verdict.UNDECIDED)
    return {"factors": count, "false": false, "undecided": undecided}


def matrix_verdicts(references: Sequence[Reference], seed: int = 1, every: int = 1) -> dict[str, int]:
    """Verdicts of `check` in every cell of the references, one angle each: on the line at 1, and on one close to the albedo.

    `every`: only every so many cells.
    The second line is off by a random relative 1e-12 to 1e-6, above or below; where that is less than the radius of the
    reference, any verdict will do. {"cells", "false", "undecided"}, two verdicts a cell.
    """
    random = np.random.default_rng(seed)
    false = undecided = cells = 0
    for reference in references:
        name, build = "m" if reference.lobe in MICROFACETS else "n", LOBES[reference.lobe]
        for (i, j), exact in list(np.ndenumerate(reference.albedo))[::every]:
            parameter, mu = float(reference.parameters[i]), float(reference.cosines[j])
            family = Family("cell", lambda b=build, **values: b(*values.values()), {name: (parameter, parameter)}, (mu, mu))
            near = exact * (1 + float(random.choice([-1, 1]) * 10 ** random.uniform(-12, -6))) - 1
            for tolerance in (TOLERANCE, near):
                verdict = check_family(family, tolerance=tolerance, intervals=False).verdict
                wanted = Verdict.VIOLATES if exact > 1 + tolerance else Verdict.CONSERVES
                known = abs(exact - 1 - tolerance) > reference.radius[i, j] + 4e-16 * exact
                cells += 1
                undecided += verdict is Verdict.UNDECIDED
                false += bool(known and verdict not in (wanted, Verdict.UNDECIDED))
    return {"cells": cells, "false": false, "undecided": undecided}


class _Excess(AbstractFactor):
    """A factor times a number near 1."""

    factor: Any
    times: Any

    def __call__(self, n: Any) -> Any:
        return self.times * _compiled(self.factor, n)


@eqx.filter_jit
def _compiled(factor: AbstractFactor, n: Any) -> Any:
    """A factor as one program for all who check it: exact ones are dozens of operations."""
    return factor(n)


KNOWN_FAILURES = (
    (
        "fixed 32 x 64 product rule at 45 degrees loses 2 % (n = 1000), 97 % (10^4), 100 % (10^5)",
        "the lobe falls between the nodes, and nothing in the sum says so",
        "integrate in the lobe's own angle; exact azimuth",
    ),
    (
        "float32 c^n is 0 beyond 65.3 degrees (n = 100), 23.6 (1000), 7.6 (10^4)",
        "XLA on CPU flushes subnormal numbers",
        "harmless in a sum; compare logarithms where ratios matter",
    ),
    (
        "pow(c, n) in float32 loses n 2^-25",
        "the rounding of c, not of the power",
        "exp(n log1p(-versine)) with the versine from half angles",
    ),
    (
        "float32 1 + (n/k)(c - 1) is off by 21 % at n = 10^7",
        "1 - c has no digits left where c was formed first",
        "the chord form of Lyon, or the versine",
    ),
    (
        "Schlick's lobe needs 20, 60, 184 Gauss nodes for n = 10, 100, 1000",
        "a pole at c = n/(n-1), next to the interval",
        "nodes graded like sinh towards the pole",
    ),
    (
        "64-point Gauss in u = c^(n+1) finds 1.0000059 for an exactly normalised Phong lobe",
        "the warp has a singularity at u = 0",
        "an error bar from a second rule; exact azimuth",
    ),
    (
        "float32 acos(cos 1e-4) = 0, acos(1 + 1.2e-7) = NaN, gradient -inf at 1",
        "acos is ill-conditioned at 1",
        "atan2, or 2 asin(sqrt(versine/2))",
    ),
    (
        "an even power without max(0, .) rises again past its first zero; an odd one is NaN at 15.5",
        "the base turns negative",
        "clamp before the power",
    ),
    (
        "generic adaptive code misses the Beckmann needle (m = cos theta = 1/64): off by over 0.9 of .9137, and claims 1e-8",
        "no sample ever lands on the needle",
        "seed panels at the mirror direction; the half-vector rule",
    ),
    (
        "Monte Carlo: relative deviation of one cosine sample 1.5 (n = 10), 16 (n = 1000)",
        "few samples meet the lobe",
        "importance sampling, or no chance at all",
    ),
    (
        "the 32 x 64 product rule: dE/dtheta of Phong and GGX breaks in 30 of 152 cells, in 13 of which the value does not",
        "the samples do not move with the lobe and the horizon: the derivative of the error is not small",
        "the zonal and half-vector rules: nodes follow lobe, kinks and horizon",
    ),
    (
        "dE/dtheta of GGX at 90 degrees has no limit: it grows like log(cos theta)",
        "the tail of the distribution falls like tan^-4: facets down to cos(theta) count",
        "the derivative at the cosine 6.4e-6 is given there and below, in either precision",
    ),
    (
        "float32: dE/dtheta at 90 degrees is that at the cosine 6.4e-6, 0.9 % from the limit at m = 0.001",
        "kinks are lost in rounding closer to 90 degrees",
        "float64, where the cosine is 1.8e-12",
    ),
    (
        "the unclamped binomial power overflows float32 (k = 16, n = 10^5): value and error bar are inf",
        "the rebound reaches (n/k)^k",
        "clamp; or float64",
    ),
    (
        "float32: dE/dtheta of the unclamped power (mirror form, k = 16) is off by up to 2 %",
        "the rebound multiplies the rounding of cosines near 90 degrees by k, and the derivative is a difference",
        "clamp; or float64",
    ),
    (
        "float32: facets with a slope below 1e-18 have the value NaN and the error bar inf",
        "the peak of the distribution, 1/(pi m^2), is above the largest float32",
        "float64, or a mirror",
    ),
    (
        "float32: a factor within 1e-6 of the exact one is UNDECIDED",
        "error bars are 4e-6 or more",
        "brdfcheck.use_x64()",
    ),
)
"""What fails where the production rule holds: (what, cause, remedy); shown by the tests."""
