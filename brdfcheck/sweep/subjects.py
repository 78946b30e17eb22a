"""What is swept: BRDFs by their names, through the one door (`brdfcheck.brdf.subject`), and rules by theirs."""

from __future__ import annotations

import functools
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

from brdfcheck.brdf.calling import directional
from brdfcheck.brdf.factors import has_engine
from brdfcheck.brdf.family import Family, NoRange
from brdfcheck.brdf.readers.base import AbstractFile, Reading
from brdfcheck.brdf.readers.specs import PREFIXES, is_file_spec, split_spec
from brdfcheck.brdf.readers.table import beside
from brdfcheck.brdf.signatures import Signature, signature_of
from brdfcheck.brdf.subject import family_of, named, no_parameter, resolve
from brdfcheck.messages import UsageError, one_line
from brdfcheck.quadrature.functions import Adaptive
from brdfcheck.quadrature.registry import RULES, engine_of
from brdfcheck.quadrature.rule import AbstractEngine, AbstractRule
from brdfcheck.runtime import double_precision


@dataclass(frozen=True)
class Source:
    """What a name stands for, before its parameters are known. `file`: where a user's BRDF is, `reading`: how it is read."""

    name: str
    value: Any
    signature: Signature
    file: Path | None
    reading: Reading | None = None

    def takes_words(self, parameter: str) -> bool:
        """False for a parameter of one of this package's BRDFs that is a number."""
        return self.file is not None or parameter in self.signature.words or parameter not in self.signature.names


@dataclass(frozen=True)
class Subject:
    """A BRDF with its static parameters set: ``build(**numbers)`` makes one member of the family.

    `template`: the structure of its lobe without numbers, None for functions, which have no engine of their own.
    """

    build: Callable[..., Any]
    template: Any


def find(name: str, folder: Path, modules: dict[str, ModuleType], places: Mapping[str, Path], reading: Reading) -> Source:
    """The BRDF called `name`. UsageError where there is none.

    `modules`: users' files loaded so far. `places`: where users' files are that are not at their path from `folder`, from which
    `reading`, how they are read, sees its folders.
    """
    file, spec = None, name
    if is_file_spec(name) and not name.startswith(PREFIXES):
        path, attribute = split_spec(name)
        file = Path(places.get(path, folder / path))
        spec = str(file) if attribute is None else f"{file}:{attribute}"
    how = None if file is None else beside(reading, folder)
    value, _ = named(spec, modules, how)
    return Source(name, directional(value), signature_of(value), None if file is None else file.resolve(), how)


def subject(source: Source, static: Mapping[str, Any], ranges: Mapping[str, tuple[float, float]]) -> Subject:
    """The BRDF with its static parameters, for numbers within `ranges`. UsageError where it does not take them."""
    words = {name: value for name, value in static.items() if isinstance(value, str | bool)}
    whole = {name: (float(value), float(value)) for name, value in static.items() if name not in words}
    bounds = {**whole, **ranges}
    with double_precision():
        family = _family(source, words, bounds)
        missing = [name for name in family.ranges if name not in bounds]
        if missing:
            raise UsageError(_needs(source, missing, missing[0] in family.switches))

        def build(**numbers: Any) -> Any:
            # What the door holds itself (a whole number, a range of no length) is not passed again.
            return family.build(**{name: numbers[name] for name in family.ranges})

        build.__name__ = source.name.rpartition(":")[2]
        try:
            shapes = {name: jax.ShapeDtypeStruct((), np.float64) for name in ranges}
            template = eqx.filter_eval_shape(build, **shapes)
        except Exception:  # the factory needs numbers, not tracers
            template = None
    return Subject(build, template.core if has_engine(template) else None)


def _family(source: Source, words: Mapping[str, Any], bounds: Mapping[str, tuple[float, float]]) -> Family:
    unknown = [name for name in words if name not in source.signature.names]
    if unknown and not source.signature.open:
        raise UsageError(no_parameter(source.name, unknown[0], source.signature.names))
    try:
        if isinstance(source.value, Family):
            target = resolve([source.name], bounds, None)[0]
        else:
            value = functools.partial(source.value, **words) if words else source.value
            target = family_of(value, source.name, bounds, None, source.reading)
    except NoRange as error:
        raise UsageError(_needs(source, error.names)) from None
    if target.finding is not None:
        raise UsageError(target.finding)
    return target.family


def _needs(source: Source, names: Any, switch: bool = False) -> str:
    axis = "[0, 1]" if switch else "{ geomspace = [0.1, 1, 10] }"
    return f"{source.name} needs an axis {', '.join(names)}, as in {names[0]} = {axis} or {names[0]} = 1"


DEFAULT = "default"
"""The rule that is the engine of the BRDF."""


def rule_of(text: str, rtol: float | None, template: Any) -> AbstractRule:
    """The rule behind "default", "name" or "name:setting". ValueError where there is none, or not with that setting.

    `rtol`: what the default aims at; `template`: of the BRDF, whose lobe has an engine or is a function.
    """
    name, colon, setting = text.partition(":")
    if text == DEFAULT:
        return (Adaptive if template is None else engine_of(template)).at(rtol)
    if name not in RULES:
        raise ValueError(f"unknown rule {name!r}; allowed: {DEFAULT}, {', '.join(RULES)}")
    kind: Any = RULES[name]
    try:
        return kind(type(kind.ladder[0])(setting)) if colon else kind()
    except (TypeError, ValueError) as error:
        example = f"{name}:{kind.ladder[-1]:g}"
        raise ValueError(f"the setting of {text!r}: {one_line(error)}; as in {example!r}") from None


@dataclass(frozen=True)
class Method:
    """How cells are computed: one by one by `rule`, or all of a chunk as a `table`.

    `cells`: of a chunk where the configuration says nothing, at least and at most; a killed sweep loses some seconds of work.
    `sample`: cells looked at to estimate a chunk's time, None for all. `batch`: cells computed together.
    """

    rule: AbstractRule
    table: bool
    cells: tuple[int, int]
    sample: int | None
    batch: int


def method(rule: AbstractRule, template: Any, *, table: bool) -> Method:
    """How a rule computes a BRDF of this structure; cells take nanoseconds, microseconds, milliseconds, or up to a second."""
    if table:
        return Method(rule, True, (20_000, 250_000), None, 1)
    if rule.on_host:
        return Method(rule, False, (1, 32), 3, 1)
    if isinstance(rule, AbstractEngine) and rule.batch > 1:
        return Method(rule, False, (1_000, 20_000), 512, rule.batch)
    return Method(rule, False, (32, 512), 4, 1)  # rules bound their memory themselves, for one cell


def turned(brdf: Callable[..., Any], azimuth: Any) -> Callable[..., Any]:
    """A function f(wi, wo) on a surface that is turned, so that what comes from azimuth 0 comes from `azimuth`."""

    def at(direction: Any) -> Any:
        x, y, z = (direction[..., i] for i in range(3))
        return jnp.stack([x * jnp.cos(azimuth) - y * jnp.sin(azimuth), x * jnp.sin(azimuth) + y * jnp.cos(azimuth), z], axis=-1)

    return lambda wi, wo: brdf(at(wi), at(wo))


def source_files(sources: Mapping[str, Source]) -> dict[str, dict[str, str]]:
    """The texts of users' files and of the neighbours that these import or include: {file: {name: text}}."""
    found: dict[str, dict[str, str]] = {}
    for source in sources.values():
        if source.file is None:
            continue
        loaded = [Path(file) for module in list(sys.modules.values()) if (file := getattr(module, "__file__", None))]
        beside = [file for file in loaded if file.suffix == ".py" and file.parent == source.file.parent]
        if isinstance(source.value, AbstractFile):
            beside = [file for file in map(Path, source.value.files) if file.parent == source.file.parent]
        # Each byte as one character: the file may be in any encoding that Python reads, and arrives as it was.
        texts = {file.name: file.read_bytes().decode("latin-1") for file in (*beside, source.file)}
        found[split_spec(source.name)[0]] = dict(sorted(texts.items()))
    return dict(sorted(found.items()))
