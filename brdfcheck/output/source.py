"""A factor and the fits of albedos as source text: C99 in double precision, GLSL and HLSL in float.

A text is complete in itself: functions, and comments that say where the numbers come from. Arguments outside the fitted
ranges are moved to their ends, so that nothing extrapolates. No date: the same fit gives the same bytes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.factors import AbstractFactor
from brdfcheck.brdf.readers.base import Reading
from brdfcheck.brdf.readers.glsl.shader import Made, ShaderFile
from brdfcheck.fits.compact import CompactFits, CompensationFit
from brdfcheck.fits.compensation import SMALLEST
from brdfcheck.fits.rational import rows
from brdfcheck.fits.surface import AlbedoFit
from brdfcheck.messages import one_line
from brdfcheck.numerics import averaging
from brdfcheck.output import records
from brdfcheck.output.text import describe

# What a parameter may be called in both languages, whatever the locals are.
_PLAIN_PARAMETERS = {"n", "m", "alpha", "roughness", "reflectance"}
_WIDTH = 110
# Panels and nodes in each by which functions are integrated that have edges, and points at a time.
_PANELS, _NODES, _PIECE = 48, 4, 256


@dataclass(frozen=True)
class _Language:
    """`pair`: the type of two numbers; C has none, and its functions are ``static inline``."""

    real: str
    pair: str
    limits: tuple[float, float]

    @property
    def is_c(self) -> bool:
        return not self.pair

    def function(self, words: str, name: str, arguments: Sequence[str], lines: Sequence[str], *, kind: str = "") -> str:
        """A function of real `arguments`, by default to a real, under a comment of `words`."""
        signature = ", ".join(f"{self.real} {argument}" for argument in arguments)
        body = "".join(f"    {line};\n" for line in lines)
        start = f"{'static inline ' * self.is_c}{kind or self.real} {name}"
        return f"{''.join(comment(words))}{start}({signature}) {{\n{body}}}\n\n"

    def clamp(self, value: str, low: str, high: str) -> str:
        in_c = f"{value} < {low} ? {low} : {value} > {high} ? {high} : {value}"
        return in_c if self.is_c else f"clamp({value}, {low}, {high})"

    def number(self, value: float) -> str:
        """A literal of the language. ValueError where its type cannot hold the value: infinite there, or 0."""
        smallest, largest = self.limits
        if value and not smallest <= abs(value) <= largest:
            raise ValueError(f"the constant {value:.3g} cannot be held by a {self.real}")
        return number(value)


# Smallest normal and largest number of single precision.
_FLOAT = (2.0**-126, (2 - 2.0**-23) * 2.0**127)
_C = _Language("double", "", (0.0, math.inf))
LANGUAGES = {"glsl": _Language("float", "vec2", _FLOAT), "hlsl": _Language("float", "float2", _FLOAT), "c": _C, "h": _C}
"""The languages of `source_text`: GLSL for any version, ES too, and C99, which is C++ as well."""


def source_text(
    kind: str,
    fits: CompactFits,
    name: str | None = None,
    *,
    factor: AbstractFactor | None = None,
    facts: Sequence[str] | None = None,
    command: str | None = None,
) -> str:
    """Text in one of the `LANGUAGES`: NAME_albedo of the parameter and cos theta, and what else there is.

    NAME_factor, where a `factor` is given, in 1/sr; as far as there are fits NAME_average, NAME_dfg (scale and bias of the
    split sum) and NAME_compensation (the BRDF of Kulla and Conty). NaN stays NaN. `name`: by default that of the fit, made an
    identifier. `facts`: lines about the target for the header, by default its formula. `command`: the command line that made
    it. Raises ValueError for a factor that has no formula, or a number that the language's type cannot hold.
    """
    language, albedo = LANGUAGES[kind], fits.albedo
    prefix = identifier(albedo.name if name is None else name)
    if facts is None:
        facts = [f"{albedo.name}: {albedo.formula or 'no formula known'}" + (f", {albedo.form} form" if albedo.form else "")]
    p, c = albedo.parameter_range, albedo.cos_range
    header = [
        *facts,
        f"Fitted for {albedo.parameter} in [{p[0]:g}, {p[1]:g}] and cos_theta in [{c[0]:g}, {c[1]:g}]; arguments outside are"
        " moved to these ends.",
        f"Made by: {command or 'brdfcheck.output.source.source_text'}",
        f"Versions: {', '.join(f'{package} {version}' for package, version in records.versions().items())}",
    ]
    parts = [line for text in header for line in comment(text)]
    parts.append("#include <math.h>\n\n" if language.is_c else "\n")
    if factor is not None:
        parts.append(_factor(language, albedo, factor, f"{prefix}_factor"))
    return "".join([*parts, *_functions(language, fits, prefix)]).rstrip("\n") + "\n"


def identifier(name: str) -> str:
    """`name` as the first part of an identifier of C and GLSL: no doubled underscores, no leading digit, no gl_."""
    plain = re.sub("_+", "_", re.sub(r"[^A-Za-z0-9]", "_", name)).strip("_")
    return plain if plain and not plain[0].isdigit() and not plain.startswith("gl_") else f"brdf_{plain}".rstrip("_")


def _word(parameter: str) -> str:
    return parameter if parameter in _PLAIN_PARAMETERS else "parameter"


def _factor(language: _Language, fit: AlbedoFit, factor: AbstractFactor, name: str) -> str:
    word = _word(fit.parameter)
    formula = factor.formula(language.number, word)
    if formula is None:
        raise ValueError(f"no formula for a factor of type {type(factor).__name__}")
    lines = [_within(language, word, fit.parameter_range), f"return {formula}"]
    return language.function("What the lobe is multiplied by, in 1/sr.", name, [word], lines)


def _functions(language: _Language, fits: CompactFits, prefix: str) -> Iterator[str]:
    """The functions of all fits that there are."""
    albedo, white, share, average = fits.albedo, fits.white or fits.albedo, fits.share, fits.average
    own = "no factor"
    if albedo.factored:
        own = "with its factor" + ("" if albedo.factor is None else f" {describe(albedo.factor, 9)}")
    what = "Directional albedo E = integral of f(wi, wo) (N.wo) over all wo, wi fixed, cos_theta = N.wi"
    yield _fitted(language, albedo, f"{prefix}_albedo", f"{what}; {own}")
    if average is not None:
        yield _fitted(language, average, f"{prefix}_average", "Average albedo 2 int E(mu) mu dmu", angle=False)
    if share is not None:
        if fits.white is not None:
            yield _fitted(language, white, f"{prefix}_white", "Albedo with F = 1")
        yield _fitted(language, share, f"{prefix}_share", "Share of the bias in the albedo with F = 1")
        arguments = [_word(albedo.parameter), "cos_theta"]
        called = f"({', '.join(arguments)})"
        lines = [f"{language.real} e = {prefix}_{'albedo' if fits.white is None else 'white'}{called}"]
        lines.append(f"{language.real} b = e * {prefix}_share{called}")
        if language.is_c:
            arguments += ["*scale", "*bias"]
            lines += ["*scale = e - b", "*bias = b"]
        else:
            lines.append(f"return {language.pair}(e - b, b)")
        words = "Split sum: with Schlick's Fresnel term the albedo is F0 scale + bias, both"
        words += f" off by at most {fits.split_sum_error:.2g}."
        yield language.function(words, f"{prefix}_dfg", arguments, lines, kind=language.pair or "void")
    if fits.compensation is not None:
        yield from _compensation(language, fits.compensation, prefix)


def _fitted(language: _Language, fit: AlbedoFit, name: str, what: str, *, angle: bool = True) -> str:
    """A function that was fitted, of the parameter and, with an `angle`, cos theta; all about it in its comment."""
    x, y = fit.variables.describe(fit.parameter)
    points, of = (f"{fit.checked[0]} x {fit.checked[1]}", f"x = {x} and y = {y}") if angle else (fit.checked[0], f"x = {x}")
    bounds = "Within [0, 1], as all values that were seen." if fit.clamped else "Not clamped: values that were seen exceed 1."
    places = list(fit.where.items())[: 1 + angle]
    relative = f"; relative to the value at most {fit.relative_error:.2g}" if fit.relative_error < 1 else ""
    words = (
        f"{what}. {bounds} Off by at most {fit.max_error:.3g} (rms {fit.rms_error:.2g}) on {points} points and around the worst"
        f" one, at {', '.join(f'{key} = {value:.6g}' for key, value in places)}; the bar of the quadrature,"
        f" {fit.table_error:.1g}, is included{relative}."
        f" Rational function of {of}, scaled to [-1, 1]: {fit.coefficients} coefficients, {fit.flops} flops; the denominator is"
        f" proven to be >= {fit.denominator_bound:.3g} everywhere: no pole."
    )
    word = _word(fit.parameter)
    lines = [_within(language, word, fit.parameter_range)]
    if angle:
        lines.append(_within(language, "cos_theta", fit.cos_range))
    numerator, denominator = (_polynomial(rows(part)) for part in (fit.surface.numerator, fit.surface.denominator))
    used = set(re.findall(r"\b[uv]\b", numerator + denominator))
    lines += [f"{language.real} {line}" for line in _variables(fit, word, used)]
    lines.append(f"{language.real} p = {numerator}")
    value = "p"
    if fit.surface.denominator.size > 1:  # one coefficient is 1
        lines.append(f"{language.real} q = {denominator}")
        value = "p / q"
    if fit.clamped:
        lines.append(f"{language.real} value = {value}")
        value = language.clamp("value", "0.0", "1.0")
    return language.function(words, name, [word, "cos_theta"] if angle else [word], [*lines, f"return {value}"])


def _within(language: _Language, argument: str, bounds: tuple[float, float]) -> str:
    return f"{argument} = {language.clamp(argument, *map(number, bounds))}"


def _compensation(language: _Language, fit: CompensationFit, prefix: str) -> Iterator[str]:
    """NAME_lost and NAME_compensation."""
    real, word, low, raised = language.real, _word(fit.albedo.parameter), fit.albedo.parameter_range[0], number(fit.raised)
    lost = f"Average of what is lost where the albedo counts as {fit.raised:.2g} above its function"
    yield _fitted(language, fit.lost, f"{prefix}_lost", lost, angle=False)
    lines = []
    for side in ("i", "o"):
        lines.append(f"{real} lost_{side} = 1.0 - {raised} - {prefix}_albedo({word}, cos_{side})")
        lines.append(f"lost_{side} = {language.clamp(f'lost_{side}', '0.0', '1.0')}")
    lines.append(f"{real} average = {prefix}_lost({word}) + {number(fit.margin)}")
    lines.append(f"average = {language.clamp('average', number(SMALLEST), '1.0')}")
    lines.append(f"return {word} < {number(low)} ? 0.0 : lost_i * lost_o / ({number(math.pi)} * average)")
    words = (
        f"Multiple scattering (Kulla and Conty 2017) in 1/sr: add it to the BRDF. The albedo of the sum is at most 1, for all"
        f" errors of the functions are on that side; it loses at most {fit.loss:.2g}. Nothing is added below {word} ="
        f" {low:g}. For F < 1 multiply it by Fa^2 Ea / (1 - Fa (1 - Ea)), Fa the mean of F, Ea = {prefix}_average."
    )
    yield language.function(words, f"{prefix}_compensation", [word, "cos_i", "cos_o"], lines)


def read_back(text: str, name: str, parameter: str) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """The albedo of NAME_compensation in GLSL `text`, as a function of parameters and cosines (points,).

    The text is read by what reads shaders of users, in double precision, and integrated over the light that leaves.
    """
    given = _word(parameter)
    function = f"{identifier(name)}_compensation"
    asked = f"float asked(vec3 L, vec3 V, float {given}) {{ return {function}({given}, L.z, V.z); }}\n"
    made = Made(f"{text}\n{asked}", (), function)
    shader = ShaderFile(function, "asked", Reading(), made).family({given: (0.0, 1.0)}, None, lambda *_, **__: "")
    leaving, share = averaging(_NODES, _PANELS)

    def directions(mu: Any) -> Any:
        return jnp.stack([jnp.sqrt(1 - mu * mu), 0 * mu, mu], axis=-1)

    @jax.jit
    def added(values: Any, cosines: Any) -> Any:
        wo = directions(jnp.asarray(leaving))
        return jax.vmap(lambda value, mu: shader.build(**{given: value})(directions(mu), wo) @ (np.pi * share))(values, cosines)

    def everywhere(values: np.ndarray, cosines: np.ndarray) -> np.ndarray:
        # In pieces of one length: for another one a program is compiled.
        padding = (0, -len(values) % _PIECE)
        pieces = (np.pad(part, padding, mode="edge").reshape(-1, _PIECE) for part in (values, cosines))
        found = [np.asarray(added(*piece)) for piece in zip(*pieces, strict=True)]
        return np.concatenate([np.zeros(0), *found])[: len(values)]

    return everywhere


def _variables(fit: AlbedoFit, parameter: str, used: set[str]) -> list[str]:
    """The lines that make u and v, as far as the polynomials use them: a compiler may refuse what is never used."""
    v = fit.variables
    x = {
        "reciprocal-root": f"1.0 / sqrt({parameter} + {number(v.shift)})",
        "logarithm": f"log(1.0 + {parameter})",
        "square": f"{parameter} * {parameter}",
    }.get(v.kind, parameter)
    s = "x" if v.kind == "reciprocal-root" else parameter
    y = {
        "quotient": f"cos_theta / (cos_theta + 2.0 * {s})",
        "root": f"cos_theta * sqrt((1.0 + {s} * {s}) / (cos_theta * cos_theta + {s} * {s}))",
        "steep": f"cos_theta * sqrt((1.0 + {s} * {s} * {s} * {s}) / (cos_theta * cos_theta + {s} * {s} * {s} * {s}))",
    }.get(v.layer, "cos_theta")
    lines = []
    if "u" in used or ("v" in used and re.search(r"\bx\b", y)):
        lines.append(f"x = {x}")
    if "u" in used:
        lines.append(f"u = ({_minus('x', v.u_centre)}) * {number(v.u_scale)}")
    if "v" in used:
        lines.append(f"v = ({_minus(y, v.v_centre)}) * {number(v.v_scale)}")
    return lines


def _minus(term: str, value: float) -> str:
    return f"{term} {'+' if value < 0 else '-'} {number(abs(value))}"


def number(value: float) -> str:
    """A decimal literal of both languages that reads back as the same double."""
    text = repr(float(value))
    return text if "." in text or "e" in text else f"{text}.0"


def _polynomial(table: list[list[float]]) -> str:
    """Horner in v within Horner in u, one power of u a line."""
    inner = []
    for row in table:
        text = number(row[-1])
        for depth, value in enumerate(row[-2::-1]):
            text = f"{number(value)} + v * {text if depth == 0 else f'({text})'}"
        inner.append(text)
    text = inner[-1]
    for line in inner[-2::-1]:
        text = f"{line}\n        + u * ({text})"
    return text


def comment(text: str) -> list[str]:
    """`text` as comment lines of both languages; nothing in it can end the comment or continue into the code."""
    plain = one_line(text).encode("ascii", "replace").decode().replace("\\", "/").replace("?", ".")
    lines, line = [], "//"
    for word in plain.split(" "):
        if len(line) + 1 + len(word) > _WIDTH and line != "//":
            lines.append(line)
            line = "//"
        line += f" {word}" if word else ""
    return [f"{line}\n" for line in [*lines, line]]
