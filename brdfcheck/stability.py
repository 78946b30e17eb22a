"""Where methods hold, lose digits, lie or break: rules over a matrix of lobes, exponents, angles, precisions and modes.

The references come from elsewhere (`read_references`): ball arithmetic and slope-space integrals, none of the rules.
"""

from __future__ import annotations

import csv
import enum
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.directional import albedo
from brdfcheck.factors import AbstractFactor, BlinnPhongExact, Normalized, PhongExact
from brdfcheck.family import Family
from brdfcheck.lobes import BinomialPower, BlinnPhong, KuijkBlake, Lyon, Phong, Schlick
from brdfcheck.microfacet import GGX, CookTorrance
from brdfcheck.quadrature.rule import AbstractRule
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
    "binomial8": lambda n: BinomialPower(n, 8),
    "binomial16": BinomialPower,
    "binomial16_mirror": lambda n: BinomialPower(n, form="mirror"),
    "binomial16_unclamped": lambda n: BinomialPower(n, clamped=False),
    "binomial16_mirror_unclamped": lambda n: BinomialPower(n, form="mirror", clamped=False),
    "cook-torrance": CookTorrance,
    "beckmann-smith": lambda m: CookTorrance(m, masking="smith-separable"),
    "beckmann-smith-correlated": lambda m: CookTorrance(m, masking="smith-correlated"),
    "ggx": GGX,
}
MICROFACETS = ("cook-torrance", "beckmann-smith", "beckmann-smith-correlated", "ggx")


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
_GRADIENT_HOLDS = 1e-3


@dataclass(frozen=True)
class Reference:
    """The albedo of a lobe at its parameters (rows) and cosines of incidence (columns), and how far it may be off."""

    lobe: str
    parameters: np.ndarray
    cosines: np.ndarray
    albedo: np.ndarray
    radius: np.ndarray


def read_references(path: str | Path) -> dict[str, Reference]:
    """The references of a CSV file with columns lobe, n, cos_theta, albedo, radius: a full grid for each lobe.

    ValueError where a lobe's grid has holes.
    """
    cells: dict[str, dict[tuple[float, float], tuple[float, float]]] = {}
    with open(path, newline="", encoding="utf-8") as source:
        for row in csv.DictReader(source):
            place = (float(row["n"]), float(row["cos_theta"]))
            cells.setdefault(row["lobe"], {})[place] = (float(row["albedo"]), float(row["radius"]))
    found = {}
    for lobe, values in cells.items():
        parameters = np.array(sorted({n for n, _ in values}))
        cosines = np.array(sorted({mu for _, mu in values}, reverse=True))
        missing = [(n, mu) for n in parameters for mu in cosines if (n, mu) not in values]
        if missing:
            raise ValueError(f"{path}: {lobe} has no albedo at n={missing[0][0]:g}, cos_theta={missing[0][1]:g}")
        grid = np.array([[values[n, mu] for mu in cosines] for n in parameters])
        found[lobe] = Reference(lobe, parameters, cosines, grid[..., 0], grid[..., 1])
    return found


@dataclass(frozen=True)
class Result:
    """What a method says over a lobe's grid: values and claimed absolute errors, both (parameter, cos_theta)."""

    value: np.ndarray
    claimed: np.ndarray


Method = Callable[[Any, Any], tuple[Any, Any]]
"""(BRDF, cosines (cos_theta,)) -> (values, claimed errors), both (cos_theta,)."""


def production(brdf: Any, cos_theta: Any) -> tuple[Any, Any]:
    """The package's own rule: `brdfcheck.albedo`."""
    answer = albedo(brdf, cos_theta)
    return answer.value, answer.error


def of_rule(rule: AbstractRule, seed: int = 0) -> Method:
    """A rule of the registry as a method; rules with chance in them get the key of that seed."""

    def method(brdf: Any, cos_theta: Any) -> tuple[Any, Any]:
        answer = rule(brdf, cos_theta, key=jax.random.key(seed) if rule.random else None)
        return answer.value, answer.error

    return method


def run(method: Method, lobe: str, parameters: np.ndarray, cosines: np.ndarray, dtype: Any, *, jit: bool = True) -> Result:
    """A method over a lobe's grid in one precision; `jit=False` dispatches operation by operation."""
    build = LOBES[lobe]
    mu = jnp.asarray(cosines, dtype)

    def row(parameter: Any) -> tuple[Any, Any]:
        # All numbers of the BRDF in this precision: one wide one would make the whole computation wide.
        return method(jax.tree.map(lambda leaf: leaf.astype(dtype), build(parameter)), mu)

    values = jnp.asarray(parameters, dtype)
    if jit:
        value, claimed = _rows(row, values)
    else:
        with jax.disable_jit():
            rows = [row(one) for one in values]
        value, claimed = (np.stack([np.asarray(part) for part in column]) for column in zip(*rows, strict=True))
    return Result(np.asarray(value, float), np.asarray(claimed, float))


@eqx.filter_jit
def _rows(row: Callable[[Any], tuple[Any, Any]], values: Any) -> tuple[Any, Any]:
    return jax.lax.map(row, values)


def outcomes(result: Result, reference: Reference, dtype: Any) -> np.ndarray:
    """An `Outcome` for each cell.

    BREAKS: not finite, or wrong by half. LIES: wrong by more than the claimed error and the reference's. LOSES_DIGITS: wrong by
    more than the precision should give. An overflow of the precision itself counts as holding where it is reported as inf.
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
    # What no float of this precision can hold is no failure of a method that says so.
    too_large = np.abs(exact) > float(limits.max) / 1e4
    too_small = np.abs(exact) < float(limits.tiny) * 1e4
    found[(too_large & ~np.isnan(result.value)) | too_small] = Outcome.HOLDS
    return found


@dataclass(frozen=True)
class Gradients:
    """Derivatives over a lobe's grid: of a method by differentiation, of the production rule by central differences."""

    automatic: np.ndarray
    difference: np.ndarray
    scale: np.ndarray

    @property
    def deviation(self) -> np.ndarray:
        """Their difference relative to the larger of the derivative and E over the argument."""
        with np.errstate(all="ignore"):
            return np.abs(self.automatic - self.difference) / np.maximum(np.abs(self.difference), self.scale)


def gradient_in_parameter(lobe: str, parameters: np.ndarray, cosines: np.ndarray, method: Method = production) -> Gradients:
    """dE/dn (or dE/dm) of a method, times the parameter, in float64; the differences are those of the production rule."""
    build = LOBES[lobe]

    def by(method: Method) -> Callable[[Any, Any], Any]:
        return lambda logarithm, mu: method(build(jnp.exp(logarithm)), mu[None])[0][0]

    return _gradients(by(method), by(production), np.log(parameters), cosines, 1e-4, 0)


def gradient_in_angle(lobe: str, parameters: np.ndarray, angles: np.ndarray, method: Method = production) -> Gradients:
    """dE/dtheta of a method at angles of incidence in radians, in float64; differences as in `gradient_in_parameter`."""
    build = LOBES[lobe]

    def by(method: Method) -> Callable[[Any, Any], Any]:
        return lambda parameter, angle: method(build(parameter), jnp.cos(angle)[None])[0][0]

    return _gradients(by(method), by(production), parameters, angles, 1e-5, 1)


def _gradients(
    one: Callable[[Any, Any], Any],
    trusted: Callable[[Any, Any], Any],
    first: np.ndarray,
    second: np.ndarray,
    step: float,
    which: int,
) -> Gradients:
    a, b = (jnp.asarray(part, float) for part in (first, second))

    def grid(function: Callable[[Any, Any], Any]) -> Callable[..., np.ndarray]:
        rows = jax.jit(lambda a, b: jax.lax.map(lambda a: jax.vmap(lambda b: function(a, b))(b), a))
        return lambda shift=0.0: np.asarray(rows(a + shift, b) if which == 0 else rows(a, b + shift))

    shifted = grid(trusted)
    here, *around = (shifted(by * step) for by in (0, -1, -2, -4, 1, 2))
    # Two steps, extrapolated: the difference quotient is then good to step^4.
    narrow, wide = ((around[k + 3] - around[k]) / (2 * (k + 1) * step) for k in (0, 1))
    difference = (4 * narrow - wide) / 3
    if which == 1:  # nothing lies beyond 90 degrees: backwards from there
        near, far = ((3 * here - 4 * around[k] + around[k + 1]) / (2 * (k + 1) * step) for k in (0, 1))
        difference = np.where(np.asarray(second) > np.pi / 2 - 2 * step, (4 * near - far) / 3, difference)
    return Gradients(grid(jax.grad(one, argnums=which))(), difference, np.abs(here))


def gradients_of(reference: Reference, method: Method = production) -> dict[str, Gradients]:
    """Both derivatives of a method over the grid of a reference, by what is varied: "n" (or the slope m) and "theta"."""
    axes = reference.parameters, reference.cosines
    return {
        "n": gradient_in_parameter(reference.lobe, *axes, method),
        "theta": gradient_in_angle(reference.lobe, axes[0], np.arccos(axes[1]), method),
    }


def gradient_outcomes(gradients: Gradients) -> np.ndarray:
    """An `Outcome` for each derivative: up to 1e-3 off it holds (a kink within the step of a difference spoils that much)."""
    deviation = gradients.deviation
    found = np.where(deviation > _GRADIENT_HOLDS, Outcome.LOSES_DIGITS, Outcome.HOLDS)
    known = np.isfinite(gradients.difference)
    return np.where(~np.isfinite(gradients.automatic) | (known & (deviation > _BROKEN)), Outcome.BREAKS, found)


def false_verdicts(count: int, seed: int = 1) -> dict[str, int]:
    """Verdicts of `check` on `count` random factors within 1e-6 of the exact one (Phong, Blinn-Phong; random exponent ranges).

    Such a factor (n+2)/(2 pi) (1 + e) conserves if and only if e <= the tolerance, whatever the range. UNDECIDED is counted
    apart and is not false, where |e - tolerance| is within the error bar.
    """
    random = np.random.default_rng(seed)
    false = undecided = 0
    for _ in range(count):
        excess = float(random.choice([-1, 1]) * 10 ** random.uniform(-12, -6))
        low = float(10 ** random.uniform(0, 3))
        high = float(low * 10 ** random.uniform(0, 2))
        family, factor = (Phong, PhongExact()) if random.random() < 0.5 else (BlinnPhong, BlinnPhongExact())
        scaled = _Excess(factor, 1 + excess)
        report = check_family(
            Family("random factor", lambda n, family=family, scaled=scaled: Normalized(family(n), scaled), {"n": (low, high)}),
            intervals=False,
        )
        wanted = Verdict.VIOLATES if excess > TOLERANCE else Verdict.CONSERVES
        undecided += report.verdict is Verdict.UNDECIDED
        false += report.verdict not in (wanted, Verdict.UNDECIDED)
    return {"factors": count, "false": false, "undecided": undecided}


class _Excess(AbstractFactor):
    """A factor times a number near 1."""

    factor: AbstractFactor
    times: float = eqx.field(static=True)

    def __call__(self, n: Any) -> Any:
        return self.times * self.factor(n)


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
        "generic adaptive code misses the Beckmann needle at grazing incidence (.0056 for .9137, claimed to 9e-9)",
        "no sample ever lands on the needle",
        "seed panels at the mirror direction; the half-vector rule",
    ),
    (
        "Monte Carlo: relative deviation of one cosine sample 1.5 (n = 10), 16 (n = 1000)",
        "few samples meet the lobe",
        "importance sampling, or no chance at all",
    ),
)
"""What fails where the production rule holds: (what, cause, remedy); shown by the tests."""
