"""What the stand-ins for the cosine power cost and how far they are from it, written as a shader has them: from the cosine.

`lobes` is made for accuracy and takes the versine; here each formula is the cheapest fair one of the cosine c, with all that
depends on the exponent alone computed beforehand, once a material. The measured error is that of the formula that is timed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import jax.numpy as jnp
import numpy as np

from _instruments import timing
from brdfcheck.brdf.base import AbstractZonalLobe
from brdfcheck.brdf.factors import BlinnPhongExact, PhongExact
from brdfcheck.brdf.lobes import BinomialPower, BlinnPhong, KuijkBlake, Lyon, Phong, Schlick
from brdfcheck.operations import operations
from brdfcheck.quadrature import albedo as directional

# The steps of an 8-bit display, and what it can show of them: below the second level a lobe counts as dark.
CODES = 255
DARK = 1 / CODES
# Abramowitz & Stegun 4.4.45: acos c = sqrt(1-c) times this, within 6.7e-5.
_ACOS = (1.5707288, -0.2121144, 0.0742610, -0.0187293)
_DIVISIONS = frozenset(("div", "rem"))
_ARITHMETIC = frozenset(("add", "sub", "mul", "neg", "max", "min", "abs", "lt", "le", "gt", "ge", "square"))


@dataclass(frozen=True)
class CosineForm:
    """One formula: `evaluate(c, *constants(n))`. `lobe(n, form)` is the lobe that it computes.

    `label` tells apart the formulas of one `kind`. `fixed`: the exponent is a whole number known to the compiler.
    """

    name: str
    kind: str
    label: str
    constants: Callable[[float], tuple[float, ...]]
    evaluate: Callable[..., Any]
    lobe: Callable[[Any, str], AbstractZonalLobe]
    fixed: bool = False

    def bound(self, n: float) -> Callable[[Any], Any]:
        """The formula with its constants as numbers: what a compiler sees of a known material."""
        constants = self.constants(n)
        return lambda c: self.evaluate(c, *constants)

    def kernel(self, n: float) -> timing.Kernel:
        """What is timed: constants are arguments, except for a power whose exponent is compiled in."""
        return timing.Kernel(self.bound(n)) if self.fixed else timing.Kernel(self.evaluate, self.constants(n))


def _power(n: Any, form: str) -> AbstractZonalLobe:
    return Phong(n) if form == "mirror" else BlinnPhong(n)


def _kuijk_blake(n: float) -> tuple[float, float, float, float]:
    p, q = (n + 5.6) / (n * (0.09 * n + 5.2)), (n + 65) / (5 * n + 31.7)
    return p, q, -1 / (p * q), 1 / (q * (q - p))


def _pieces(angle: Any, p: Any, q: Any, near: Any, far: Any) -> Any:
    rest = jnp.minimum(angle - q, 0)
    return jnp.where(angle < p, 1 + near * (angle * angle), far * (rest * rest))


def _polynomial_acos(c: Any) -> Any:
    return jnp.sqrt(1 - c) * (_ACOS[0] + c * (_ACOS[1] + c * (_ACOS[2] + c * _ACOS[3])))


def _lyon(w: int) -> CosineForm:
    def evaluate(c: Any, share: Any) -> Any:
        return jnp.maximum(1 - share * (1 - c), 0) ** 2**w

    return CosineForm(f"lyon-{w}", "Lyon", str(w), lambda n: (n / 2**w,), evaluate, lambda n, form: Lyon(n, w, form))


def _binomial(k: int) -> CosineForm:
    def evaluate(c: Any, share: Any, rest: Any) -> Any:
        return jnp.maximum(share * c + rest, 0) ** k

    constants = lambda n: (n / k, 1 - n / k)  # noqa: E731
    return CosineForm(f"binomial-{k}", "binomial power", str(k), constants, evaluate, lambda n, form: BinomialPower(n, k, form))


FORMS: tuple[CosineForm, ...] = (
    CosineForm("power", "Phong", "cⁿ", lambda n: (n,), lambda c, n: jnp.exp(n * jnp.log(c)), _power),
    CosineForm("power-fixed", "Phong", "fixed n", lambda n: (int(n),), lambda c, n: c**n, _power, fixed=True),
    CosineForm("schlick", "Schlick", "S", lambda n: (1 - n, n), lambda c, share, n: c / (share * c + n), Schlick),
    CosineForm("kuijk-blake", "Kuijk-Blake", "acos", _kuijk_blake, lambda c, *k: _pieces(jnp.arccos(c), *k), KuijkBlake),
    CosineForm(
        "kuijk-blake-poly", "Kuijk-Blake", "poly", _kuijk_blake, lambda c, *k: _pieces(_polynomial_acos(c), *k), KuijkBlake
    ),
    *(_lyon(w) for w in range(1, 7)),
    *(_binomial(k) for k in (4, 8, 16, 32, 64)),
)  # fmt: skip
# What the costs are to be held against: the loop by itself, and single operations.
REFERENCES: dict[str, timing.Kernel] = {
    "loop alone": timing.Kernel(lambda c: c),
    "multiply-add": timing.Kernel(lambda c, a, b: a * c + b, (0.7, 0.1)),
    "division": timing.Kernel(lambda c, a: a / c, (0.7,)),
    "square root": timing.Kernel(lambda c: jnp.sqrt(c)),
    "exp": timing.Kernel(lambda c: jnp.exp(c)),
    "log": timing.Kernel(lambda c: jnp.log(c)),
    "acos": timing.Kernel(lambda c: jnp.arccos(c)),
    "pow": timing.Kernel(lambda c, n: c**n, (100.0,)),
}


def flops(form: CosineForm, n: float) -> dict[str, int]:
    """Operations of one evaluation: arithmetic and comparisons, divisions, elementary functions. Choices are free."""
    found = operations(form.bound(n))
    groups = {"arithmetic": 0, "divisions": 0, "functions": 0}
    for primitive, count in found.items():
        groups["arithmetic" if primitive in _ARITHMETIC else "divisions" if primitive in _DIVISIONS else "functions"] += count
    return groups


def errors(form: CosineForm, n: float, samples: int) -> dict[str, float]:
    """How far the formula is from c^n over `samples` angles a, evenly from 0 to 90 degrees.

    `max` and `mean` (over the angles, each counting alike) are absolute. `light`: the integral of \\|g - c^n\\| over solid
    angle, as a share of that of c^n. `centre`: the largest relative error where c^n >= 1/2. `ten_percent`: the level of c^n
    down to which the relative error stays within 10 %. `falloff`: the largest error where 1/2 > c^n >= 1/255, and
    `falloff_relative`; `reach`: the last angle (degrees) with a value of 1/255, over that of c^n. `codes`: the largest
    difference after rounding to 8 bits.
    """
    angle = np.linspace(0, np.pi / 2, samples)
    c, solid = np.cos(angle), np.sin(angle)
    c[-1] = 0.0  # not 6e-17
    exact = np.exp(n * np.log1p(-2 * np.sin(angle[:-1] / 2) ** 2))
    exact = np.append(exact, 0.0)
    value = np.asarray(form.bound(n)(jnp.asarray(c)))
    error = np.abs(value - exact)
    centre, falloff = exact >= 0.5, (exact < 0.5) & (exact >= DARK)
    off = np.flatnonzero((error > 0.1 * exact) & (exact > 1e-300))
    last = [angle[np.flatnonzero(values >= DARK)[-1]] for values in (value, exact)]
    return {
        "max": float(error.max()),
        "mean": float(error.mean()),
        "light": float(np.sum(error * solid) / np.sum(exact * solid)),
        "centre": float(np.max(error[centre] / exact[centre])),
        "ten_percent": float(exact[off[0]]) if len(off) else 0.0,
        "falloff": float(error[falloff].max()),
        "falloff_relative": float(np.max(error[falloff] / exact[falloff])),
        "reach": float(last[0] / last[1]),
        "codes": float(np.max(np.abs(_codes(value) - _codes(exact)))),
    }


def _codes(value: np.ndarray) -> np.ndarray:
    return np.floor(CODES * value + 0.5)


def energies(form: CosineForm, exponents: Sequence[float]) -> dict[str, list[float]]:
    """The albedo at normal incidence with the factor that makes it 1 for c^n, by form ("mirror", "half"), one an exponent."""
    n = jnp.asarray(exponents, float)
    found = {}
    for name, factor in (("mirror", PhongExact()), ("half", BlinnPhongExact())):
        value, _, _ = directional.paired_lobes(form.lobe(n, name), np.ones(len(n)), None, len(n))
        found[name] = [float(albedo) for albedo in value * np.asarray(factor(n))]
    return found


def claims(results: Sequence[Mapping[str, Any]]) -> list[tuple[str, str, str]]:
    """What the proposal of the 16th-power lobe says of itself and of the others: (claim, measured, whether it holds).

    `results`: for each formula and exponent ``name``, ``n``, ``errors``, ``nanoseconds`` by type, ``operations``.
    """
    named = {(result["name"], result["n"]): result for result in results}
    exponents = sorted({n for _, n in named})

    def all_of(name: str, key: str) -> list[float]:
        return [named[name, n]["errors"][key] for n in exponents]

    def text(name: str, key: str, form: str = ".2g") -> str:
        return " / ".join(f"{value:{form}}" for value in all_of(name, key))

    def time(name: str, n: float = exponents[len(exponents) // 2]) -> float:
        return named[name, n]["nanoseconds"]["float32"] / named["power", n]["nanoseconds"]["float32"]

    def yes(holds: bool) -> str:
        return "yes" if holds else "no"

    fixed = ", ".join(
        f"{named['power-fixed', n]['operations']['arithmetic']} ({time('power-fixed', n):.2g})" for n in exponents
    )
    closer = [wide < narrow for wide, narrow in zip(all_of("lyon-6", "max"), all_of("lyon-3", "max"), strict=True)]
    better = [ours < other for ours, other in zip(all_of("kuijk-blake", "max"), all_of("schlick", "max"), strict=True)]
    return [
        (
            "Schlick: within 10 % in the centre",
            f"off by up to {text('schlick', 'centre')} of c^n where c^n >= 1/2; within 10 % down to"
            f" c^n = {text('schlick', 'ten_percent')}",
            yes(max(all_of("schlick", "centre")) <= 0.1),
        ),
        (
            "Schlick: falls off far too slowly",
            f"reaches 1/255 at {text('schlick', 'reach')} times the angle of c^n; the wrong light is"
            f" {text('schlick', 'light')} times that of c^n; off by {text('schlick', 'codes', '.0f')} steps of 8 bits",
            yes(min(all_of("schlick", "reach")) > 1.5),
        ),
        (
            "Schlick: much less work than the power",
            f"{time('schlick'):.2g} of its time, division and all",
            yes(time("schlick") < 0.5),
        ),
        (
            "Kuijk-Blake: the angle takes much time",
            f"{time('kuijk-blake'):.2g} times the power with a library's acos; {time('kuijk-blake-poly'):.2g} with the acos of"
            f" four coefficients, errors {text('kuijk-blake-poly', 'max')}",
            yes(time("kuijk-blake-poly") > 1) if time("kuijk-blake") < 1 else "with a library's acos",
        ),
        (
            "Kuijk-Blake: not accurate",
            f"largest error {text('kuijk-blake', 'max')}; Schlick's {text('schlick', 'max')}",
            "at large n" if better[0] and not better[-1] else yes(not any(better)),
        ),
        (
            "Lyon: w sets the accuracy, of narrow lobes only",
            f"largest error {text('lyon-3', 'max')} (w = 3), {text('lyon-6', 'max')} (w = 6): a large w tends to exp(n(c-1))",
            yes(closer[-1] and not closer[0]),
        ),
        (
            "16th power: no power function needed",
            f"{named['binomial-16', exponents[0]]['operations']['arithmetic']} operations, {time('binomial-16'):.2g} of the"
            f" power's time. But c^n itself, n whole and compiled in, takes {fixed} multiplications (time) and has no error",
            yes(time("binomial-16") < 0.5),
        ),
        (
            "16th power: exact in the centre",
            f"off by up to {text('binomial-16', 'centre')} of c^n",
            "to 2 %" if max(all_of("binomial-16", "centre")) < 0.02 else "no",
        ),
        (
            "16th power: exact in the falloff",
            f"off by up to {text('binomial-16', 'falloff')}, at its end {text('binomial-16', 'falloff_relative')} of c^n;"
            f" {text('binomial-16', 'codes', '.0f')} steps of 8 bits",
            yes(max(all_of("binomial-16", "codes")) <= 1),
        ),
    ]
