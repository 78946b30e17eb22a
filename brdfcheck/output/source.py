"""A factor and the fit of an albedo as source text: C99 in double precision, GLSL and HLSL in float.

A snippet is complete in itself: functions and a header that says where the numbers come from. Arguments outside the
fitted ranges are moved to their ends, so that nothing extrapolates. No date: the same fit gives the same bytes.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.factors import BlinnPhongExact, Constant, Factor, PhongExact, Proportional, RationalFactor
from brdfcheck.brdf.readers.base import Reading
from brdfcheck.brdf.readers.glsl.shader import Made, ShaderFile
from brdfcheck.fits.compact import AverageFit, CompactFits, CompensationFit
from brdfcheck.fits.compensation import SMALLEST
from brdfcheck.fits.rational import rows
from brdfcheck.fits.surface import AlbedoFit
from brdfcheck.messages import one_line
from brdfcheck.numerics import averaging
from brdfcheck.output import records

# What a parameter may be called in both languages, whatever the locals are.
_PLAIN_PARAMETERS = {"n", "m", "alpha", "roughness", "reflectance"}
_WIDTH = 110
# Panels and nodes in each by which functions are integrated that have edges, and points at a time.
_PANELS, _NODES, _PIECE = 48, 4, 256


@dataclass(frozen=True)
class _Language:
    real: str
    function: str
    clamp: Callable[[str, str, str], str]
    exp2: str
    logarithm: str
    preamble: str
    limits: tuple[float, float]

    def number(self, value: float) -> str:
        """A literal of the language. ValueError where its type cannot hold the value: infinite there, or 0."""
        smallest, largest = self.limits
        if value and not smallest <= abs(value) <= largest:
            raise ValueError(f"the constant {value:.3g} cannot be held by a {self.real}")
        return number(value)


def _c_clamp(value: str, low: str, high: str) -> str:
    return f"{value} < {low} ? {low} : {value} > {high} ? {high} : {value}"


# Smallest normal and largest number of single precision.
_FLOAT = (2.0**-126, (2 - 2.0**-23) * 2.0**127)
_C = _Language("double", "static inline double", _c_clamp, "exp2", "log", "#include <math.h>\n\n", (0.0, math.inf))
_GLSL = _Language("float", "float", lambda value, low, high: f"clamp({value}, {low}, {high})", "exp2", "log", "", _FLOAT)
# Of HLSL these functions differ in nothing but the word for two floats.
LANGUAGES = {"glsl": _GLSL, "hlsl": _GLSL, "h": _C}
"""The languages of `renderer_snippet`, by the endings of their files."""


def c_snippet(fit: AlbedoFit, factor: Any = None, name: str | None = None, *, command: str | None = None) -> str:
    """C99 (and C++) text: ``double NAME_factor(double n)`` in 1/sr and ``double NAME_albedo(double n, double cos_theta)``.

    `factor`: what NAME_factor is, by default the fit's own; without any there is no such function. `name`: the first part of
    the names, by default the family's, made an identifier. `command`: the command line that made it, for the header. The
    functions are ``static inline``; NaN stays NaN. Raises ValueError for a factor that has no formula here, or a number that
    the language's type cannot hold.
    """
    return _snippet(_C, fit, factor, name, command)


def glsl_snippet(fit: AlbedoFit, factor: Any = None, name: str | None = None, *, command: str | None = None) -> str:
    """GLSL text for any version, ES too: the same functions as `c_snippet`, with float for double. Raises as it does."""
    return _snippet(_GLSL, fit, factor, name, command)


def identifier(name: str) -> str:
    """`name` as the first part of an identifier of C and GLSL: no doubled underscores, no leading digit, no gl_."""
    plain = re.sub("_+", "_", re.sub(r"[^A-Za-z0-9]", "_", name)).strip("_")
    return plain if plain and not plain[0].isdigit() and not plain.startswith("gl_") else f"brdf_{plain}".rstrip("_")


def factor_text(factor: Any) -> str:
    """The factor as a formula of n for people. ValueError where it has none here."""
    return _factor_formula(factor, "n", "exp2", lambda value: f"{value:.9g}")


def _snippet(language: _Language, fit: AlbedoFit, factor: Any, name: str | None, command: str | None) -> str:
    prefix = identifier(fit.name if name is None else name)
    if factor is None and fit.factor is not None and _has_formula(fit.factor):
        factor = fit.factor
    parameter = fit.parameter if fit.parameter in _PLAIN_PARAMETERS else "parameter"
    parts = [_header(language, fit, factor, prefix, command), language.preamble]
    low, high = (number(bound) for bound in fit.parameter_range)
    clamped = f"    {parameter} = {language.clamp(parameter, low, high)};\n"
    if factor is not None:
        formula = _factor_formula(factor, parameter, language.exp2, language.number)
        signature = f"{language.function} {prefix}_factor({language.real} {parameter})"
        parts.append(f"{signature} {{\n{clamped}    return {formula};\n}}\n\n")
    parts.append(_albedo_function(language, fit, f"{prefix}_albedo"))
    return "".join(parts)


def _albedo_function(language: _Language, fit: AlbedoFit, name: str) -> str:
    """The function `name` of the parameter and cos_theta."""
    parameter = fit.parameter if fit.parameter in _PLAIN_PARAMETERS else "parameter"
    bounds = (number(bound) for bound in fit.parameter_range)
    cosines = (number(bound) for bound in fit.cos_range)
    parts = [
        f"{language.function} {name}({language.real} {parameter}, {language.real} cos_theta) {{\n",
        f"    {parameter} = {language.clamp(parameter, *bounds)};\n",
        f"    cos_theta = {language.clamp('cos_theta', *cosines)};\n",
    ]
    numerator, denominator = (_polynomial(rows(part)) for part in (fit.surface.numerator, fit.surface.denominator))
    used = set(re.findall(r"\b[uv]\b", numerator + denominator))
    parts += [f"    {language.real} {line};\n" for line in _variables(language, fit, parameter, used)]
    return "".join(parts) + _quotient(language, numerator, denominator, fit)


def _quotient(language: _Language, numerator: str, denominator: str, fit: AlbedoFit | AverageFit) -> str:
    """The end of a function whose value is p / q, or that within [0, 1]; a denominator of one coefficient is 1."""
    text, value = f"    {language.real} p = {numerator};\n", "p"
    if fit.surface.denominator.size > 1:
        text, value = text + f"    {language.real} q = {denominator};\n", "p / q"
    if fit.clamped:
        text, value = text + f"    {language.real} value = {value};\n", language.clamp("value", "0.0", "1.0")
    return text + f"    return {value};\n}}\n"


def renderer_snippet(kind: str, fits: CompactFits, name: str, *, facts: Sequence[str] = (), command: str | None = None) -> str:
    """Text in one of the `LANGUAGES`: NAME_albedo, and as far as there are fits NAME_average, NAME_dfg and NAME_compensation.

    NAME_dfg gives scale and bias of the split sum; NAME_compensation is the BRDF of Kulla and Conty.
    `facts`: lines about the target for the header. Raises ValueError where a float cannot hold a constant.
    """
    language, prefix = LANGUAGES[kind], identifier(name)
    real, pair = language.real, {"glsl": "vec2", "hlsl": "float2", "h": "void"}[kind]
    albedo, share, average = fits.albedo, fits.share, fits.average
    white = fits.white or albedo
    parameter = albedo.parameter if albedo.parameter in _PLAIN_PARAMETERS else "parameter"
    p, c = albedo.parameter_range, albedo.cos_range

    def told(fit: AlbedoFit) -> str:
        return f"off by at most {fit.max_error:.2g} on {fit.checked[0]} x {fit.checked[1]} points and around the worst"

    def clamped(fit: AlbedoFit) -> str:
        return "Within [0, 1], as all values are." if fit.clamped else "Not clamped: albedos that were seen exceed 1."

    header = [
        *facts,
        f"Fitted for {albedo.parameter} in [{p[0]:g}, {p[1]:g}] and cos_theta in [{c[0]:g}, {c[1]:g}]; arguments outside are"
        " moved to these ends. Errors include the bars of the quadrature. No denominator has a zero.",
        f"Made by: {command or 'brdfcheck.output.source.renderer_snippet'}",
        f"Versions: {', '.join(f'{package} {version}' for package, version in records.versions().items())}",
    ]
    parts = [line for text in header for line in comment(text)] + [language.preamble, "\n" if not language.preamble else ""]

    def function(words: str, text: str) -> None:
        parts.extend(comment(words))
        parts.append(text + "\n")

    function(
        f"Directional albedo E, {told(albedo)}. {clamped(albedo)}",
        _albedo_function(language, albedo, f"{prefix}_albedo"),
    )
    if average is not None:
        words = f"Average albedo 2 int E(mu) mu dmu, off by at most {average.max_error:.2g} on {average.checked} points."
        function(words, _average_function(language, average, f"{prefix}_average", parameter))
    if share is not None:
        if fits.white is not None:
            function(f"Albedo with F = 1, {told(white)}.", _albedo_function(language, white, f"{prefix}_white"))
        function(
            f"Share of the bias in the albedo with F = 1, {told(share)}.", _albedo_function(language, share, f"{prefix}_share")
        )
        e = f"{prefix}_{'albedo' if fits.white is None else 'white'}({parameter}, cos_theta)"
        s = f"{prefix}_share({parameter}, cos_theta)"
        arguments = f"{real} {parameter}, {real} cos_theta"
        words = "Split sum: with Schlick's Fresnel term the albedo is F0 scale + bias, both"
        words += f" off by at most {fits.split_sum_error:.2g}."
        if kind == "h":
            text = f"static inline void {prefix}_dfg({arguments}, double *scale, double *bias) {{\n"
            text += f"    double e = {e};\n    *bias = e * {s};\n    *scale = e - *bias;\n}}\n"
        else:
            text = f"{pair} {prefix}_dfg({arguments}) {{\n    float e = {e};\n    float b = e * {s};\n"
            text += f"    return {pair}(e - b, b);\n}}\n"
        function(words, text)
    if fits.compensation is not None:
        _compensation_functions(language, fits.compensation, prefix, parameter, function)
    return "".join(parts).rstrip("\n") + "\n"


def _compensation_functions(
    language: _Language, fit: CompensationFit, prefix: str, parameter: str, function: Callable[[str, str], None]
) -> None:
    """NAME_lost and NAME_compensation."""
    real, low = language.real, fit.albedo.parameter_range[0]
    raised = number(fit.raised)
    function(
        f"Average of what is lost where the albedo counts as {fit.raised:.2g} above its function, off by at most"
        f" {fit.lost.max_error:.2g} on {fit.lost.checked} points.",
        _average_function(language, fit.lost, f"{prefix}_lost", parameter),
    )
    lines = [f"if ({parameter} < {number(low)}) {{ return 0.0; }}"]
    for side in ("i", "o"):
        lines.append(f"{real} lost_{side} = 1.0 - {raised} - {prefix}_albedo({parameter}, cos_{side});")
        lines.append(f"lost_{side} = {language.clamp(f'lost_{side}', '0.0', '1.0')};")
    lines.append(f"{real} average = {prefix}_lost({parameter}) + {number(fit.margin)};")
    lines.append(f"average = {language.clamp('average', number(SMALLEST), '1.0')};")
    lines.append(f"return lost_i * lost_o / ({number(math.pi)} * average);")
    body = "".join(f"    {line}\n" for line in lines)
    function(
        f"Multiple scattering (Kulla and Conty 2017) in 1/sr: add it to the BRDF. The albedo of the sum is at most 1, for all"
        f" errors of the functions are on that side; it loses at most {fit.loss:.2g}. Nothing is added below {parameter} ="
        f" {low:g}. For F < 1 multiply it by Fa^2 Ea / (1 - Fa (1 - Ea)), Fa the mean of F, Ea = {prefix}_average.",
        f"{language.function} {prefix}_compensation({real} {parameter}, {real} cos_i, {real} cos_o) {{\n{body}}}\n",
    )


def read_back(text: str, name: str, parameter: str) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
    """The albedo of NAME_compensation in GLSL `text`, as a function of parameters and cosines (points,).

    The text is read by what reads shaders of users, in double precision, and integrated over the light that leaves.
    """
    given = parameter if parameter in _PLAIN_PARAMETERS else "parameter"
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


def _average_function(language: _Language, fit: AverageFit, name: str, parameter: str) -> str:
    numerator, denominator = (_polynomial(rows(part)) for part in (fit.surface.numerator, fit.surface.denominator))
    x = f"1.0 / sqrt({parameter} + 1.0)" if fit.root else parameter
    lines = f"{language.function} {name}({language.real} {parameter}) {{\n"
    lines += f"    {parameter} = {language.clamp(parameter, *(number(bound) for bound in fit.bounds))};\n"
    if re.search(r"\bv\b", numerator + denominator):
        lines += f"    {language.real} v = ({_minus(x, fit.centre)}) * {number(fit.scale)};\n"
    return lines + _quotient(language, numerator, denominator, fit)


def _variables(language: _Language, fit: AlbedoFit, parameter: str, used: set[str]) -> list[str]:
    """The lines that make u and v, as far as the polynomials use them: a compiler may refuse what is never used."""
    v = fit.variables
    x = {
        "reciprocal-root": f"1.0 / sqrt({parameter} + {number(v.shift)})",
        "logarithm": f"{language.logarithm}(1.0 + {parameter})",
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


def _factor_formula(factor: Any, n: str, exp2: str, show: Callable[[float], str]) -> str:
    if isinstance(factor, PhongExact):
        return f"({n} + {show(2.0)}) / {show(2 * math.pi)}"
    if isinstance(factor, BlinnPhongExact):
        return f"({n} + {show(2.0)}) * ({n} + {show(4.0)}) / ({show(8 * math.pi)} * ({exp2}({show(-0.5)} * {n}) + {n}))"
    if isinstance(factor, Constant):
        return show(float(factor.value))
    if isinstance(factor, Proportional):
        return f"{n} / {show(float(factor.B))}"
    if isinstance(factor, RationalFactor):
        return " / ".join(f"({_power_series(np.asarray(part), n, show)})" for part in (factor.numerator, factor.denominator))
    if isinstance(factor, Factor) or (hasattr(factor, "A") and hasattr(factor, "B")):
        A, B = float(factor.A), float(factor.B)
        return f"({n} {'-' if A < 0 else '+'} {show(abs(A))}) / {show(B)}"
    raise ValueError(f"no formula for a factor of type {type(factor).__name__}; give one with numbers A and B")


def _power_series(coefficients: np.ndarray, n: str, show: Callable[[float], str]) -> str:
    text = show(float(coefficients[-1]))
    for value in coefficients[-2::-1]:
        text = f"{show(float(value))} + {n} * ({text})"
    return text


def _header(language: _Language, fit: AlbedoFit, factor: Any, prefix: str, command: str | None) -> str:
    x, y = fit.variables.describe(fit.parameter)
    p, c = fit.parameter_range, fit.cos_range
    own = "no factor"
    if fit.factored:
        own = "with its factor"
        if fit.factor is not None:
            own += f" {factor_text(fit.factor) if _has_formula(fit.factor) else type(fit.factor).__name__}"
    versions = ", ".join(f"{package} {version}" for package, version in records.versions().items())
    lines = [
        f"{fit.name}: {fit.formula or 'no formula known'}" + (f", {fit.form} form" if fit.form else ""),
        f"Fitted for {fit.parameter} in [{p[0]:g}, {p[1]:g}] and cos_theta in [{c[0]:g}, {c[1]:g}];"
        " arguments outside are moved to these ends.",
        "",
        *([f"{prefix}_factor: what the lobe is multiplied by, in 1/sr."] if factor is not None else []),
        f"{prefix}_albedo: directional albedo E = integral of f(wi, wo) (N.wo) over all wo, wi fixed, cos_theta = N.wi;"
        f" {own}. "
        + (
            "Within [0, 1], as all albedos that were seen." if fit.clamped else "Not clamped: it exceeds 1 where the BRDF does."
        ),
        f"Largest error seen: {fit.max_error:.3g} (rms {fit.rms_error:.2g}) on {fit.checked[0]} x {fit.checked[1]} points and"
        f" around the worst one, at {', '.join(f'{key} = {value:.6g}' for key, value in fit.where.items())};"
        f" the bar of the quadrature, {fit.table_error:.1g}, is included."
        f" Relative to the albedo at most {fit.relative_error:.2g}, where the albedo is small.",
        f"Rational function of x = {x} and y = {y}, scaled to [-1, 1]: {fit.coefficients} coefficients, {fit.flops} flops."
        f" The denominator is proven to be >= {fit.denominator_bound:.3g} on the whole square: no pole.",
        f"Made by: {command or _call(fit)}",
        f"Versions: {versions}",
    ]
    return "".join(line for text in lines for line in comment(text))


def _call(fit: AlbedoFit) -> str:
    low, high = fit.parameter_range
    return f"brdfcheck.fits.surface.fit_albedo({fit.name!r}, {fit.parameter}=({low:g}, {high:g}), degree={fit.degree})"


def _has_formula(factor: Any) -> bool:
    try:
        factor_text(factor)
    except ValueError:
        return False
    return True


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
