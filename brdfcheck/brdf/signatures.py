"""Which parameters a BRDF has, whatever it is: a family, a class, a function, a factory, a file."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from brdfcheck.brdf.calling import DIRECTIONS, directional
from brdfcheck.brdf.readers.base import AbstractFile

if TYPE_CHECKING:
    from brdfcheck.brdf.family import Family


@dataclass(frozen=True)
class Signature:
    """The parameters of a callable, or of a family of the catalogue.

    `integers`: those that are whole numbers; `whole`: those whose default is one, which may run over a range all the same;
    `words`: those whose default is a text or a truth value. `open`: it takes any keyword, or cannot say what it takes.
    """

    required: tuple[str, ...]
    names: tuple[str, ...]
    integers: frozenset[str]
    whole: frozenset[str]
    words: frozenset[str]
    open: bool


def signature_of(value: Any, ranged: Collection[str] = ()) -> Signature:
    """The parameters of a family, a class, a function or a factory, its directions or angles as wi and wo.

    `ranged`: names that have a range, so that none of them is the normal.
    """
    from brdfcheck.brdf.family import Family

    value = directional(value, ranged)
    if isinstance(value, AbstractFile):
        return Signature(value.required, value.names, value.whole, value.whole, frozenset(), False)
    if isinstance(value, Family):
        whole = frozenset(_whole_fields(value))
        return Signature(tuple(value.ranges), (*value.ranges, *sorted(whole)), whole, whole, frozenset(), False)
    try:
        parameters = list(inspect.signature(value).parameters.values())
    except (TypeError, ValueError):
        return Signature((), (), frozenset(), frozenset(), frozenset(), True)
    variadic = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    named = [parameter for parameter in parameters if parameter.kind not in variadic]
    return Signature(
        tuple(parameter.name for parameter in named if parameter.default is parameter.empty),
        tuple(parameter.name for parameter in named),
        frozenset(parameter.name for parameter in named if parameter.annotation in (int, "int")),
        frozenset(parameter.name for parameter in named if type(parameter.default) is int),
        frozenset(parameter.name for parameter in named if isinstance(parameter.default, (str, bool))),
        len(named) < len(parameters),
    )


def no_parameter(name: str, parameter: str, known: Iterable[str]) -> str:
    """What is said of a parameter that a BRDF does not have."""
    known, (whole, _, component) = tuple(known), parameter.rpartition(".")
    if component and whole in known:
        return f"{name}: {whole} is a number: give one, or a range LO:HI, and no list"
    names = ", ".join(key for key in known if key not in DIRECTIONS) or "none"
    return f"{name} has no parameter {parameter!r}; its parameters: {names}"


def arguments_of(core: Any) -> dict[str, Any]:
    """What a lobe was built from: the arguments of its constructor that it keeps under their names."""
    return {name: getattr(core, name) for name in inspect.signature(type(core)).parameters if hasattr(core, name)}


def _whole_fields(family: Family) -> list[str]:
    """The whole numbers that the lobe of a family is built from, such as the k of the binomial power."""
    import jax

    from brdfcheck.brdf.base import AbstractBRDF, structure_of

    built = structure_of(family.build, **{name: jax.ShapeDtypeStruct((), "float32") for name in family.ranges})
    given = arguments_of(built.core) if isinstance(built, AbstractBRDF) else {}
    return [name for name, value in given.items() if type(value) is int]


def takes_directions(function: Callable[..., Any], parameters: Mapping[str, float]) -> bool:
    """False for a factory, to which two directions are two parameters that have no range yet.

    It returns a function of them, or they reach an argument that has its value already.
    """
    import numpy as np

    try:
        return not callable(function(np.array([[0.6, 0.0, 0.8]]), np.array([[0.0, 0.6, 0.8]]), **parameters))
    except TypeError as error:
        return "multiple values for argument" not in str(error)
    except (Exception, SystemExit):
        return True
