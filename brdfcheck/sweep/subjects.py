"""From the name of a BRDF in a configuration to something that builds it from numbers: catalogue, classes, users' files."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import inspect
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf import catalog, lobes, microfacet
from brdfcheck.brdf.base import AbstractBRDF, AbstractZonalLobe
from brdfcheck.brdf.factors import Normalized, PerCosine, has_engine, peel
from brdfcheck.brdf.family import corners
from brdfcheck.brdf.readers.python import is_file_spec, load_object, split_spec
from brdfcheck.brdf.subject import family_of
from brdfcheck.messages import UsageError, one_line
from brdfcheck.runtime import double_precision

CLASSES: Mapping[str, Callable[..., Any]] = {
    cls.__name__: cls
    for cls in (
        lobes.BinomialPower,
        lobes.BlinnPhong,
        lobes.KuijkBlake,
        lobes.Lambert,
        lobes.Lyon,
        lobes.Phong,
        lobes.Schlick,
        microfacet.CookTorrance,
        microfacet.GGX,
    )
}


@dataclass(frozen=True)
class Subject:
    """A BRDF with its static parameters set: ``build(**numbers)`` makes one member of the family.

    `engine`: "zonal", "half-vector" or "adaptive". `template`: its structure without numbers (None for functions).
    """

    name: str
    build: Callable[..., Any]
    engine: str
    template: Any


@dataclass(frozen=True)
class Source:
    """What a name stands for, before its parameters are known. `file`: where a user's BRDF is defined.

    `integers`: parameters that are part of the BRDF's structure, so that each value needs a program of its own;
    `whole`: those that are so where they are given as whole numbers; `numbers`: those that words cannot be.
    """

    name: str
    value: Any
    kind: str  # "catalog", "class" or "user"
    integers: frozenset[str] = frozenset()
    whole: frozenset[str] = frozenset()
    numbers: frozenset[str] = frozenset()
    file: Path | None = None


def find(name: str, folder: Path, modules: dict[str, ModuleType], places: Mapping[str, Path]) -> Source:
    """The BRDF called `name`. UsageError where there is none.

    `modules`: users' files loaded so far. `places`: where users' files are that are not at their path from `folder`.
    """
    if name in catalog.names():
        family = catalog.entry(name).family
        fields = frozenset(_whole_fields(family))
        return Source(name, family, "catalog", fields, fields, fields | frozenset(family.ranges))
    if name in CLASSES:
        parameters = inspect.signature(CLASSES[name]).parameters.values()
        numbers = frozenset(part.name for part in parameters if not isinstance(part.default, (str, bool)))
        return Source(name, CLASSES[name], "class", *_whole_parameters(CLASSES[name]), numbers)
    if not is_file_spec(name):
        try:
            catalog.entry(name)
        except KeyError as error:
            raise UsageError(f"{error.args[0]}; classes: {', '.join(CLASSES)}") from None
    path, attribute = split_spec(name)
    absolute = str(places.get(path, folder / path))
    value, _ = load_object(absolute if attribute is None else f"{absolute}:{attribute}", modules)
    return Source(name, value, "user", *_whole_parameters(value), file=Path(absolute).resolve())


def _whole_fields(family: Any) -> list[str]:
    """Whole-number fields of a catalogue entry's lobe, such as the k of the binomial power: they may be swept, too."""
    shape = eqx.filter_eval_shape(family.build, **{name: jax.ShapeDtypeStruct((), np.float32) for name in family.ranges})
    core = peel(shape)[0]
    return [part.name for part in dataclasses.fields(core) if type(getattr(core, part.name)) is int]


def _whole_parameters(value: Callable[..., Any]) -> tuple[frozenset[str], frozenset[str]]:
    try:
        parameters = inspect.signature(value).parameters.values()
    except (TypeError, ValueError):
        return frozenset(), frozenset()
    declared = frozenset(parameter.name for parameter in parameters if parameter.annotation in (int, "int"))
    return declared, declared | frozenset(parameter.name for parameter in parameters if type(parameter.default) is int)


def subject(source: Source, static: Mapping[str, Any], ranges: Mapping[str, tuple[float, float]]) -> Subject:
    """The BRDF with its static parameters, for numbers within `ranges`. UsageError where it does not take them."""
    make = {"catalog": _from_catalog, "class": _from_class, "user": _from_user}[source.kind]
    build = make(source, static, ranges)
    with double_precision():
        _try_corners(source, build, static, ranges)
        template = _template(build, ranges)
    if template is None:
        return Subject(source.name, build, "adaptive", None)
    engine = "zonal" if isinstance(peel(template)[0], AbstractZonalLobe) else "half-vector"
    return Subject(source.name, build, engine, template)


def _template(build: Callable[..., Any], ranges: Mapping[str, Any]) -> Any:
    try:
        brdf = eqx.filter_eval_shape(build, **{name: jax.ShapeDtypeStruct((), np.float64) for name in ranges})
    except Exception:  # the factory needs numbers, not tracers: engine 3
        return None
    return brdf if has_engine(brdf) else None


def _from_catalog(source: Source, static: Mapping[str, Any], ranges: Mapping[str, Any]) -> Callable[..., Any]:
    family = source.value
    _check_names(source, tuple(family.ranges), tuple(family.ranges), static, ranges)

    def build(**numbers: Any) -> Any:
        return _with_fields(family.build(**numbers), static)

    return build


def _with_fields(brdf: Any, fields: Mapping[str, Any]) -> Any:
    """The BRDF with other static fields in the lobe inside its wrappers."""
    if not fields:
        return brdf
    if isinstance(brdf, Normalized):
        return Normalized(_with_fields(brdf.lobe, fields), brdf.factor)
    if isinstance(brdf, PerCosine):
        return PerCosine(_with_fields(brdf.base, fields))
    return dataclasses.replace(brdf, **fields)


def _from_class(source: Source, static: Mapping[str, Any], ranges: Mapping[str, Any]) -> Callable[..., Any]:
    parameters = inspect.signature(source.value).parameters
    required = tuple(name for name, parameter in parameters.items() if parameter.default is parameter.empty)
    _check_names(source, tuple(parameters), required, static, ranges)
    return functools.partial(source.value, **static)


def _check_names(
    source: Source, known: tuple[str, ...], required: tuple[str, ...], static: Mapping[str, Any], ranges: Mapping[str, Any]
) -> None:
    allowed = (*known, *sorted(source.integers - set(known)))
    for name in (*static, *ranges):
        if name not in allowed:
            raise UsageError(f"unknown axis {name!r}: {source.name} takes {', '.join(allowed)}, and any BRDF cos_theta")
    for name in required:
        if name not in static and name not in ranges:
            raise UsageError(f"{source.name} needs an axis {name!r}, as in {name} = {{ geomspace = [0.1, 1, 10] }}")


def _from_user(source: Source, static: Mapping[str, Any], ranges: Mapping[str, tuple[float, float]]) -> Callable[..., Any]:
    numbers = {name: value for name, value in static.items() if isinstance(value, int) and not isinstance(value, bool)}
    words = {name: value for name, value in static.items() if name not in numbers}
    for name in words:
        if name not in _takes(source.value, name):
            raise UsageError(f"unknown axis {name!r}: {source.name} has no such parameter")
    value = functools.partial(source.value, **words) if words else source.value
    bounds = {**{name: (float(value), float(value)) for name, value in numbers.items()}, **ranges}
    try:
        target = family_of(value, source.name, bounds, None)
    except UsageError as error:
        text = str(error).split(": --over")[0].replace("must be given a range", "must be an axis or a held value")
        raise UsageError(text.replace("has no parameter", "unknown axis: it has no parameter")) from None
    family, held = target.family, target.family.held

    def build(**given: Any) -> Any:
        # What `family_of` holds itself (a range of no length) is not passed again.
        return family.build(**{name: value for name, value in given.items() if name not in held})

    build.__name__ = family.build.__name__
    return build


def _takes(function: Callable[..., Any], name: str) -> tuple[str, ...]:
    """The names of a callable's parameters, and `name` too where it takes any keyword."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return (name,)
    names = tuple(parameter.name for parameter in parameters)
    return (*names, name) if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters) else names


def _try_corners(
    source: Source, build: Callable[..., Any], static: Mapping[str, Any], ranges: Mapping[str, tuple[float, float]]
) -> None:
    """A lobe's own checks see numbers here, and tracers later."""
    for corner in corners(ranges.values(), 64):
        numbers = dict(zip(ranges, corner, strict=True))
        try:
            brdf = build(**numbers)
        except (Exception, SystemExit) as error:
            text = f"{type(error).__name__}: {one_line(error)}" if source.kind == "user" else one_line(error)
            raise UsageError(f"{source.name}{_at({**static, **numbers})}: {text}") from None
        if not callable(brdf):
            raise UsageError(f"{source.name} returned {type(brdf).__name__}, which is not a function f(wi, wo)")


def _at(parameters: Mapping[str, Any]) -> str:
    shown = ", ".join(
        f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}" for name, value in parameters.items()
    )
    return f" at {shown}" if shown else ""


def of_type(brdf: AbstractBRDF, dtype: Any) -> Any:
    """The BRDF with its numbers in the type `dtype`, so that a rule runs in one precision throughout."""
    return jax.tree.map(lambda leaf: leaf.astype(dtype) if jnp.issubdtype(jnp.result_type(leaf), jnp.floating) else leaf, brdf)


def source_files(sources: Mapping[str, Source]) -> dict[str, dict[str, str]]:
    """The texts of users' files and of the neighbours that they import: {file in the configuration: {name: text}}."""
    found: dict[str, dict[str, str]] = {}
    for source in sources.values():
        if source.file is None:
            continue
        texts = {source.file.name: _text(source.file)}
        for module in list(sys.modules.values()):
            file = getattr(module, "__file__", None)
            if file and file.endswith(".py") and Path(file).parent == source.file.parent and Path(file) != source.file:
                texts[Path(file).name] = _text(Path(file))
        found[split_spec(source.name)[0]] = dict(sorted(texts.items()))
    return dict(sorted(found.items()))


def _text(path: Path) -> str:
    # Each byte as one character: the file may be in any encoding that Python reads, and arrives as it was.
    return path.read_bytes().decode("latin-1")


def digest(text: str) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(text.encode()).hexdigest()
