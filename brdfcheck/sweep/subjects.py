"""What is swept: BRDFs by their names, through the one door (`brdfcheck.brdf.subject`)."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import equinox as eqx
import jax
import numpy as np

from brdfcheck.brdf.calling import directional
from brdfcheck.brdf.factors import has_engine
from brdfcheck.brdf.family import Family, NoRange
from brdfcheck.brdf.readers.base import AbstractFile, Reading
from brdfcheck.brdf.readers.specs import PREFIXES, is_file_spec, split_spec
from brdfcheck.brdf.readers.table import beside
from brdfcheck.brdf.signatures import Signature, no_parameter, signature_of
from brdfcheck.brdf.subject import as_target, family_of, named
from brdfcheck.messages import UsageError
from brdfcheck.runtime import double_precision
from brdfcheck.sweep.config import ANGLES


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


def subject(
    source: Source, static: Mapping[str, Any], ranges: Mapping[str, tuple[float, float]]
) -> tuple[Callable[..., Any], Any]:
    """The BRDF with its static parameters, for numbers within `ranges`. UsageError where it does not take them.

    What makes one member of the family of these numbers, and the structure of its lobe without numbers: None for functions.
    """
    # To a shader true and false are 1 and 0.
    kinds = str if isinstance(source.value, AbstractFile) else str | bool
    words = {name: value for name, value in static.items() if isinstance(value, kinds)}
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
    return build, template.core if has_engine(template) else None


def _family(source: Source, words: Mapping[str, Any], bounds: Mapping[str, tuple[float, float]]) -> Family:
    unknown = [name for name in words if name not in source.signature.names]
    if unknown and not source.signature.open:
        raise UsageError(no_parameter(source.name, unknown[0], source.signature.names))
    if words and isinstance(source.value, (AbstractFile, Family)):
        name, word = next(iter(words.items()))
        raise UsageError(f"{source.name}: {name} takes numbers; got {word!r}")
    try:
        if isinstance(source.value, Family):
            target = as_target(replace(source.value, name=source.name), bounds)
        else:
            value = functools.partial(source.value, **words) if words else source.value
            target = family_of(value, source.name, bounds, None, source.reading)
    except NoRange as error:
        raise UsageError(_needs(source, error.names)) from None
    if target.finding is not None:
        raise UsageError(target.finding)
    return target.family


def _needs(source: Source, names: Any, switch: bool = False) -> str:
    if taken := [name for name in names if name in ANGLES]:
        return f"{source.name}: the axis {taken[0]} is that of incidence; rename the parameter"
    axis = "[0, 1]" if switch else "{ geomspace = [0.1, 1, 10] }"
    return f"{source.name} needs an axis {', '.join(names)}, as in {names[0]} = {axis} or {names[0]} = 1"


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
