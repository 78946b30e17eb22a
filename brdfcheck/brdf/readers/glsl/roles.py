"""Which function of a shader is the BRDF, and what each of its arguments is: a direction, or a parameter."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator

from brdfcheck.brdf.readers.glsl import syntax
from brdfcheck.brdf.readers.glsl.errors import Position, did_you_mean, mistake
from brdfcheck.brdf.readers.glsl.kinds import FLOAT, Vector
from brdfcheck.brdf.readers.glsl.program import Program
from brdfcheck.brdf.readers.glsl.scopes import Routine
from brdfcheck.messages import UsageError

ROLES = ("L", "V", "N", "X", "Y")
"""To the light, to the viewer, the normal, and the two directions along the surface."""
VEC3 = Vector("float", 3)
_NAMES = {
    "L": "l wi i light lightdir lightdirection lightvector tolight incoming incident incidentdir dirlight ldir lvec win omegai"
    " omegain surfacetolight lightvec wl",
    "V": "v wo o view viewdir viewdirection viewvector viewer toviewer eye toeye eyedir camera tocamera outgoing outgoingdir"
    " vdir vvec wout omegao omegaout surfacetoview viewvec wv eyevec e",
    "N": "n normal norm nrm surfacenormal shadingnormal ns worldnormal normaldir",
    "X": "x tangent t tangentx xdir tangentdir",
    "Y": "y bitangent binormal b tangenty ydir bitangentdir",
}
_ROLE_OF = {name: role for role, names in _NAMES.items() for name in names.split()}


def role_of(parameter: syntax.Parameter) -> str | None:
    """What a direction is by its name; None where that does not tell."""
    name = parameter.name
    # Which space it is in: "normalWS".
    plain = re.sub(r"[^a-z]", "", re.sub(r"_?[WVOT]S$", "", name).lower())
    for prefix in ("", "u", "in", "v", "world", "vec"):
        if plain.startswith(prefix) and plain[len(prefix) :] in _ROLE_OF:
            return _ROLE_OF[plain[len(prefix) :]]
    return None


def roles_of(routine: Routine, asked: tuple[str, ...], program: Program, *, by_place: bool) -> list[str | None]:
    """The role of each argument, None for a parameter. `asked`: what the user says; `by_place`: L, V, N, X, Y in this order."""
    parameters = routine.node.parameters
    if asked:
        if len(asked) != len(parameters):
            raise UsageError(
                f"--args names {len(asked)} arguments; {routine.name}({routine.signature}) takes {len(parameters)}"
            )
        found: list[str | None] = [word if word in ROLES else None for word in asked]
        for role, kind, parameter in zip(found, routine.types, parameters, strict=True):
            if role is not None and kind != VEC3:
                raise UsageError(f"--args: {role} is a vec3; the argument {parameter.name!r} of {routine.name}() is {kind}")
    elif by_place:
        found = [*ROLES]
    else:
        found = named_roles(routine)
    for role in ROLES:
        if found.count(role) > 1:
            names = " and ".join(repr(item.name) for item, its in zip(parameters, found, strict=True) if its == role)
            raise program.mistake(
                routine.node.at, f"{routine.name}(): both {names} look like {role}; say which is which by --args"
            )
    return found


def named_roles(routine: Routine) -> list[str | None]:
    """The roles that the arguments have by their names. Where two look alike, the one that is called L, V, N, X or Y has it."""
    parameters = routine.node.parameters
    found = [
        role_of(parameter) if kind == VEC3 and way == "in" else None
        for parameter, kind, way in zip(parameters, routine.types, routine.ways, strict=True)
    ]
    for role in ROLES:
        exact = [place for place, its in enumerate(found) if its == role and parameters[place].name.upper() == role]
        if found.count(role) > 1 and len(exact) == 1:
            found = [its if its != role or place == exact[0] else None for place, its in enumerate(found)]
    return found


def is_brdf(routine: Routine) -> bool:
    """True where the arguments look like those of a BRDF."""
    roles = named_roles(routine)
    return roles.count("L") == roles.count("V") == 1


def find(program: Program, name: str | None, path: str) -> Routine:
    """The function that is meant. ShaderError where there is none, or more than one."""
    defined = list(program.definitions())
    names = list(dict.fromkeys(routine.name for routine in defined))
    if name is not None:
        found = list(program.definitions(name))
        if not found:
            near = did_you_mean(name, names)
            has = f"; the file has {', '.join(repr(item) for item in names[:12])}" if names else "; the file has no functions"
            raise mistake(Position(path, 0, 0), f"there is no function {name!r}{near or has}")
        likely = [routine for routine in found if is_brdf(routine)] or found
        if len(likely) > 1:
            raise program.mistake(likely[1].node.at, f"{len(likely)} functions are called {name!r}: rename one of them")
        return likely[0]
    likely = [routine for routine in defined if is_brdf(routine) and routine.result in (FLOAT, VEC3)]
    if len(likely) > 1:
        called = {call for routine in likely for call in _called(routine.body)}
        likely = [routine for routine in likely if routine.name not in called] or likely
    if not likely and len(defined) == 1:
        return defined[0]
    if not likely:
        offers = f"the file has {', '.join(names[:12])}" if names else "the file has no functions"
        raise mistake(
            Position(path, 0, 0), f"no function takes a light and a view direction: name one, as in {path}:NAME; {offers}"
        )
    if len(likely) > 1:
        shown = ", ".join(repr(routine.name) for routine in likely[:-1]) + f" and {likely[-1].name!r}"
        count = {2: "two"}.get(len(likely), str(len(likely)))
        raise mistake(
            Position(path, 0, 0),
            f"{count} functions could be the BRDF, {shown}: name one, as in {path}:{likely[0].name}",
        )
    return likely[0]


def _called(node: object) -> Iterator[str]:
    """The names of all functions that are called in a part of the syntax tree."""
    waiting = [node]
    while waiting:
        now = waiting.pop()
        if isinstance(now, syntax.Call):
            yield now.name
        if isinstance(now, list):
            waiting += now
        elif dataclasses.is_dataclass(now) and not isinstance(now, type):
            waiting += [getattr(now, field.name) for field in dataclasses.fields(now)]
