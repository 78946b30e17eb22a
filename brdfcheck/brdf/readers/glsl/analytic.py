"""``.brdf`` files, as BRDF Explorer reads them: a block of parameters and a block of GLSL."""

from __future__ import annotations

import math

from brdfcheck.brdf.readers.glsl.errors import Position, did_you_mean, mistake
from brdfcheck.brdf.readers.glsl.kinds import BOOL, FLOAT, Vector
from brdfcheck.brdf.readers.glsl.knobs import Knob
from brdfcheck.brdf.readers.glsl.operators import BUILTIN_TYPES, RESERVED

_FORMS = "float NAME MIN MAX DEFAULT, bool NAME 0|1, color NAME R G B"
_SECTIONS = ("parameters", "shader")


def split(text: str, path: str) -> tuple[list[Knob], str]:
    """The parameters of a file, and its shader, at the lines where it stands in the file. ShaderError for what is wrong."""
    lines = text.split("\n")
    begun: dict[str, int] = {}
    section, first = "", True
    parameters: list[Knob] = []
    shader = [""] * len(lines)
    for number, line in enumerate(lines, start=1):
        words = line.split("//")[0].split("#")[0].split()
        at = Position(path, number, len(line) - len(line.lstrip()) + 1)
        if words and words[0] in ("::begin", "::end"):
            section = _marked(words, section, begun, at)
        elif section == "shader":
            shader[number - 1] = line
        elif section == "parameters" and words:
            parameters.append(_parameter(words, line, {item.name for item in parameters}, at))
        elif words and first:
            if words != ["analytic"]:
                raise mistake(at, f"a .brdf file begins with 'analytic'; got {line.strip()[:40]!r}")
            first = False
        elif words and not section:
            raise mistake(at, f"expected '::begin parameters' or '::begin shader'; got {line.strip()[:40]!r}")
    if section:
        raise mistake(Position(path, begun[section], 1), f"'::begin {section}' has no '::end {section}'")
    if first:
        raise mistake(Position(path, 1, 1), "a .brdf file begins with 'analytic'")
    if "shader" not in begun:
        raise mistake(Position(path, 0, 0), "the file has no '::begin shader'")
    return parameters, "\n".join(shader)


def _marked(words: list[str], section: str, begun: dict[str, int], at: Position) -> str:
    """The section after a mark."""
    mark, name = words[0], words[1] if len(words) == 2 else ""
    if name not in _SECTIONS:
        raise mistake(at, f"expected '{mark} parameters' or '{mark} shader'{did_you_mean(name, _SECTIONS)}")
    if mark == "::end":
        if section != name:
            opened = f"'::begin {section}' is open" if section else "nothing is open"
            raise mistake(at, f"'::end {name}' ends nothing: {opened}")
        return ""
    if section:
        raise mistake(Position(at.file, begun[section], 1), f"'::begin {section}' has no '::end {section}'")
    if name in begun:
        raise mistake(at, f"there are two '::begin {name}'")
    begun[name] = at.line
    return name


def _parameter(words: list[str], line: str, known: set[str], at: Position) -> Knob:
    kind, rest = words[0], words[1:]
    counts = {"float": 4, "bool": 2, "color": 4}
    if kind not in counts:
        raise mistake(at, f"a parameter is written {_FORMS}; got {line.strip()[:60]!r}")
    form = next(form for form in _FORMS.split(", ") if form.startswith(kind))
    if len(rest) != counts[kind]:
        raise mistake(at, f"a parameter is written {form}; got {line.strip()[:60]!r}")
    name = rest[0]
    if not (name.isascii() and name.isidentifier()) or name in RESERVED | BUILTIN_TYPES:
        raise mistake(at, f"{name!r} is no name of a parameter")
    if name in known:
        raise mistake(at, f"there are two parameters {name!r}")
    numbers = tuple(_number(word, name, line, at) for word in rest[1:])
    if kind == "bool":
        if numbers[0] not in (0, 1):
            raise mistake(at, f"parameter {name!r}: a bool is 0 or 1; got {rest[1]}")
        return Knob(name, BOOL, (0.0, 1.0), numbers)
    if kind == "color":
        return Knob(name, Vector("float", 3), None, numbers, (1.0,) * 3)
    low, high, default = numbers
    if low > high:
        raise mistake(at, f"parameter {name!r}: MIN must not exceed MAX; got {low:g} > {high:g}")
    return Knob(name, FLOAT, (low, high), (default,))


def _number(word: str, name: str, line: str, at: Position) -> float:
    try:
        value = float(word.rstrip("fF"))
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise mistake(at._replace(column=line.find(word) + 1), f"parameter {name!r}: {word!r} is no finite number")
    return value
