"""A shader file as a family of BRDFs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.family import Family
from brdfcheck.brdf.readers.base import AbstractFile, Reading
from brdfcheck.brdf.readers.glsl import analytic
from brdfcheck.brdf.readers.glsl.dialect import GLSL, HLSL
from brdfcheck.brdf.readers.glsl.errors import mistake
from brdfcheck.brdf.readers.glsl.kinds import FLOAT, Opaque, Type, kind_of
from brdfcheck.brdf.readers.glsl.knobs import Knob, Settings, at_path, fields_of, missing, names_of, placed, settle
from brdfcheck.brdf.readers.glsl.preprocessor import preprocess, read_text
from brdfcheck.brdf.readers.glsl.program import Program
from brdfcheck.brdf.readers.glsl.roles import VEC3, find, roles_of
from brdfcheck.brdf.readers.glsl.scopes import Routine
from brdfcheck.runtime import STRAIGHT_LINE, double_precision

_FRAME = {"N": (0.0, 0.0, 1.0), "X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0)}


@dataclass(frozen=True)
class _Compiled:
    """A program with the function that is the BRDF, and its parameters. `roles`: of its arguments, None for a parameter."""

    program: Program
    routine: Routine
    roles: tuple[str | None, ...]
    knobs: list[Knob]
    per_cosine: bool


@dataclass(frozen=True, eq=False)
class ShaderBRDF:
    """f(wi, wo) of a shader, with numbers for its parameters: wi is L, to the light; wo is V, to the viewer."""

    compiled: _Compiled
    settings: Settings
    numbers: Mapping[str, Any]

    def __call__(self, wi: Any, wo: Any) -> Any:
        compiled, routine = self.compiled, self.compiled.routine
        wi, wo = jnp.broadcast_arrays(jnp.asarray(wi, float), jnp.asarray(wo, float))
        shape = wi.shape[:-1]
        directions = {role: tuple(map(np.float64, vector)) for role, vector in _FRAME.items()}
        directions |= {role: tuple(array[..., i] for i in range(3)) for role, array in (("L", wi), ("V", wo))}
        uniforms = {item.slot: item.start for item in compiled.program.uniforms.values()}
        arguments: list[Any] = [kind.zero() for kind in routine.types]
        for place, role in enumerate(compiled.roles):
            if role is not None:
                arguments[place] = directions[role]
        for knob in compiled.knobs:
            where, index, path = knob.key
            owner: Any = uniforms if where == "uniform" else arguments
            owner[index] = placed(owner[index], path, self.settings.values(knob, self.numbers))
        found, _ = compiled.program.run(routine, arguments, uniforms, shape)
        channels = [jnp.broadcast_to(jnp.asarray(leaf, wi.dtype), shape) for leaf in jax.tree.leaves(found)]
        if compiled.per_cosine:
            lit = wi[..., 2] > 0
            cosine = jnp.where(lit, wi[..., 2], 1.0)
            channels = [jnp.where(lit, channel / cosine, 0.0) for channel in channels]
        if routine.result == FLOAT:
            return channels[0]
        return jnp.stack(channels, axis=-1)


@dataclass(frozen=True)
class Made:
    """A shader that another reader makes, of GLSL: its text, its parameters, and what it is called in reports."""

    text: str
    parameters: tuple[Knob, ...]
    spec: str


class ShaderFile(AbstractFile):
    """A shader file that has been read and compiled. `names`, `required`, `whole`: of its parameters. Raises ShaderError.

    `function`: the one that is the BRDF, None where the file has to tell. `made`: the shader, where it is in no file.
    """

    def __init__(self, path: str, function: str | None, reading: Reading, made: Made | None = None):
        self.path, self.reading = path, reading
        text = read_text(path) if made is None else made.text
        suffix = Path(path).suffix.lower() if made is None else ""
        self._analytic = suffix == ".brdf"
        self._dialect = HLSL if suffix in (".hlsl", ".slang") else GLSL
        self._declared, self._text = analytic.split(text, path) if self._analytic else ([], text)
        if made is not None:
            self._declared = list(made.parameters)
        self._function = function or ("BRDF" if self._analytic else None)
        self._plain = self._compile({}, ())
        self.function = self._plain.routine.name
        self.line = self._plain.program.source.position(self._plain.routine.node.at).line
        self.files = self._plain.program.source.files
        self._numbers = {
            name: value for name, value in self._plain.program.source.numbers.items() if name not in reading.defines
        }
        knobs, whole_file = self._plain.knobs, self._analytic and self.function == "BRDF"
        self.spec = made.spec if made is not None else path if whole_file else f"{path}:{self.function}"
        # Parameters, their components, and macros that are numbers.
        self.names = (*names_of(knobs), *self._numbers)
        self.required = tuple(missing(knobs))
        self.whole = frozenset(knob.name for knob in knobs if kind_of(knob.type) in ("int", "uint"))

    def family(
        self, ranges: Mapping[str, Any], cos_theta: tuple[float, float] | None, no_parameter: Callable[..., str]
    ) -> Family:
        """The family over these ranges. UsageError where they do not belong to it."""
        own = set(names_of(self._plain.knobs))
        macros = {name: tuple(ranges[name]) for name in ranges if name in self._numbers and name not in own}
        held = {name: low for name, (low, high) in macros.items() if low == high}
        compiled = self._plain
        if macros:
            words = {name: _written(value, isinstance(self._numbers[name], int)) for name, value in held.items()}
            compiled = self._compile(words, tuple(name for name in macros if name not in held))
        rest = {name: bounds for name, bounds in ranges.items() if name not in held}
        settings = settle(compiled.knobs, rest, self.spec, no_parameter)
        settings.shown |= held

        def build(**numbers: Any) -> ShaderBRDF:
            return ShaderBRDF(compiled, settings, numbers)

        build.__name__ = self.function
        build.compiler_options = STRAIGHT_LINE  # pyright: ignore[reportFunctionMemberAccess]
        cosines = (0.0, 1.0) if cos_theta is None else cos_theta
        family = Family(
            self.spec,
            build,
            settings.ranges,
            cosines,
            settings.shown,
            switches=frozenset(settings.switches),
            defaults=settings.defaults,
        )
        self._try(family)
        return family

    def _try(self, family: Family) -> None:
        """Trace it once, which compiles nothing: what goes wrong on the way has a place in the file."""
        with double_precision():
            numbers = {name: jax.ShapeDtypeStruct((), np.float64) for name in family.ranges}
            direction = jax.ShapeDtypeStruct((2, 3), np.float64)
            jax.eval_shape(lambda numbers, wi, wo: family.build(**numbers)(wi, wo), numbers, direction, direction)

    def _compile(self, held: Mapping[str, str], swept: tuple[str, ...]) -> _Compiled:
        reading = self.reading
        source = preprocess(self._text, self.path, defines={**reading.defines, **held}, folders=reading.folders, swept=swept)
        given: dict[str, Type] = {item.name: item.type for item in self._declared} | dict.fromkeys(swept, FLOAT)
        program = Program(source, self._dialect, given)
        routine = find(program, self._function, self.path)
        at = routine.node.at
        if routine.result not in (FLOAT, VEC3):
            raise program.mistake(at, f"{routine.name}() returns {routine.result}; a BRDF returns float or vec3")
        roles = roles_of(routine, reading.arguments, program, by_place=self._analytic and len(routine.types) == 5)
        if not {"L", "V"} <= set(roles):
            raise program.mistake(
                at,
                f"which arguments of {routine.name}({routine.signature}) are the light and the view direction?"
                " Name them in order, as in --args L,V,N",
            )
        program.compile(routine)
        knobs = [*self._uniforms(program), *self._arguments(program, routine, roles)]
        return _Compiled(program, routine, tuple(roles), knobs, reading.per_cosine)

    def _uniforms(self, program: Program) -> list[Knob]:
        declared = {item.name: item for item in self._declared}
        knobs: list[Knob] = []
        for uniform in program.uniforms.values():
            if uniform.name in declared:
                knobs.append(replace(declared[uniform.name], key=("uniform", uniform.slot, ())))
            elif not isinstance(uniform.type, Opaque):
                idle = uniform.slot not in program.used
                parts = fields_of(uniform.type, uniform.name)
                if parts is None and uniform.default is None and not idle:
                    what = f"the uniform {uniform.name!r} is a {uniform.type}"
                    raise mistake(uniform.position, f"{what}: only numbers, vectors and structs of them can be given")
                for name, kind, path in parts or ():
                    start = None if uniform.default is None else at_path(uniform.default, path)
                    default = None if start is None else tuple(map(float, jax.tree.leaves(start)))
                    knobs.append(Knob(name, kind, None, default, None, idle, ("uniform", uniform.slot, path)))
        return knobs

    def _arguments(self, program: Program, routine: Routine, roles: list[str | None]) -> list[Knob]:
        knobs: list[Knob] = []
        for place, (role, kind, way, node) in enumerate(
            zip(roles, routine.types, routine.ways, routine.node.parameters, strict=True)
        ):
            if role is not None or way == "out" or isinstance(kind, Opaque):
                continue
            name = node.name or f"argument{place + 1}"
            if name in program.uniforms:
                name = f"{routine.name}_{name}"
            parts = fields_of(kind, name)
            if parts is None:
                what = f"the argument {node.name!r} is a {kind}"
                raise program.mistake(node.at, f"{what}: only directions, numbers, vectors and structs of them can be given")
            knobs += [Knob(part, inner, key=("argument", place, path)) for part, inner, path in parts]
        return knobs


def _written(value: float, whole: bool) -> str:
    """A number as a macro: as a whole one where the file has one."""
    return repr(int(value)) if whole and value == int(value) else f"({value!r})"
