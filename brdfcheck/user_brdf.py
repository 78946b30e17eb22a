"""From the words of a command line to families of BRDFs: catalogue names, ``file.py:object``, ``NAME=LO:HI``.

What is wrong with the words is a `UsageError`, in one line that names the value and what is allowed. What is wrong with
a user's BRDF, once it has been found, is not: that is a finding about the BRDF, kept in `Target.finding`.
"""

from __future__ import annotations

import importlib.util
import inspect
import itertools
import math
import os
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib.machinery import SourceFileLoader
from pathlib import Path
from types import ModuleType
from typing import Any

from brdfcheck.messages import UsageError, one_line

Range = tuple[float, float]

_count = itertools.count(1)
# Names under which people pass the two directions; anything else that has no default is a parameter.
_DIRECTIONS = frozenset(("wi", "wo", "w_i", "w_o", "omega_i", "omega_o", "incoming", "outgoing", "light", "view", "l", "v"))
# Exponents and roughnesses are never directions.
_PARAMETERS = frozenset({"n", "m", "k", "alpha", "roughness"})


@dataclass(frozen=True)
class Target:
    """Something to check: a family, and what the command line knows about it.

    `fixed`: parameters held at one value inside ``family.build``. `finding`: what already went wrong with it, in words.
    `file`, `line`: where a user's BRDF is defined (None for the catalogue).
    """

    family: Any
    fixed: Mapping[str, float] = field(default_factory=dict)
    finding: str | None = None
    file: str | None = None
    line: int | None = None


# --- numbers and ranges ---


def parse_number(text: str, what: str) -> float:
    """A finite number. UsageError, starting with `what`, otherwise."""
    try:
        value = float(text)
    except ValueError:
        raise UsageError(f"{what}: {text.strip()!r} is not a number") from None
    if not math.isfinite(value):
        raise UsageError(f"{what}: must be finite; got {text.strip()}")
    return value


def parse_range(text: str, what: str) -> Range:
    """``LO:HI``, or ``V`` for V:V. UsageError, starting with `what`, otherwise."""
    parts = text.split(":")
    if len(parts) > 2 or not all(part.strip() for part in parts):
        raise UsageError(f"{what}: must be LO:HI or a single value; got {text!r}")
    low, high = parse_number(parts[0], what), parse_number(parts[-1], what)
    if low > high:
        raise UsageError(f"{what}: LO must not exceed HI; got {low:g} > {high:g}")
    return low, high


def parse_over(options: Iterable[str]) -> dict[str, Range]:
    """The values of ``--over``: NAME=LO:HI or NAME=V each. UsageError for anything else and for a name given twice."""
    ranges: dict[str, Range] = {}
    for option in options:
        name, equals, bounds = option.partition("=")
        name = name.strip()
        if not equals or not name.isidentifier():
            raise UsageError(f"--over {one_line(option)!r}: must be NAME=LO:HI or NAME=VALUE, as in --over n=1:1000")
        if name in ranges:
            raise UsageError(f"--over {one_line(option)}: the parameter {name!r} is given twice")
        ranges[name] = parse_range(bounds, f"--over {one_line(option)}")
    return ranges


def parse_cosines(text: str | None) -> Range | None:
    """The value of ``--cos-theta``: LO:HI within 0:1."""
    if text is None:
        return None
    low, high = parse_range(text, f"--cos-theta {one_line(text)}")
    if low < 0 or high > 1:
        raise UsageError(f"--cos-theta {one_line(text)}: must lie within 0:1")
    return low, high


# --- files ---


class _SourceLoader(SourceFileLoader):
    """Compiles the source each time: a cached file would be stale where two edits fall within one second."""

    def get_code(self, fullname: str) -> Any:
        return self.source_to_code(self.get_data(self.path), self.path)


def split_spec(spec: str) -> tuple[str, str | None]:
    """``path/to/file.py:object`` -> (path, object); the object is None where only a file is given."""
    path, colon, name = spec.rpartition(":")
    if not colon or name.endswith(".py") or "/" in name:
        return spec, None
    return path, name


def is_file_spec(name: str) -> bool:
    """True for what looks like ``file.py:object`` or a path rather than a catalogue name."""
    return ":" in name or name.endswith(".py") or "/" in name or os.sep in name


def load_module(path_text: str) -> ModuleType:
    """The user's file as a module with a name of its own, which can import its neighbours. UsageError if that fails."""
    path = Path(path_text)
    try:
        if path.is_dir():
            raise UsageError(f"{path_text} is a folder; give a Python file, as in mine.py:brdf")
        if not path.exists():
            raise UsageError(f"there is no file {path_text!r}")
        path = path.resolve()
        path.read_bytes()
    except (OSError, ValueError) as error:
        raise UsageError(f"cannot read {path_text!r}: {getattr(error, 'strerror', None) or one_line(error)}") from None
    name = f"_brdfcheck_user_{next(_count)}_{path.stem}"
    loader = _SourceLoader(name, str(path))
    spec = importlib.util.spec_from_file_location(name, path, loader=loader)
    assert spec is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        with _importable(path.parent):
            loader.exec_module(module)
    except (Exception, SystemExit) as error:
        del sys.modules[name]
        raise UsageError(f"cannot import {path_text}: {_import_trouble(error, path)}") from None
    return module


_last_folder: Path | None = None


@contextmanager
def _importable(folder: Path) -> Iterator[None]:
    """`folder` at the head of the search path within the block, and at its end afterwards: for imports in functions."""
    global _last_folder
    if _last_folder is not None and folder != _last_folder:
        # A helper.py beside another user's file must not answer for the helper.py beside this one.
        for name, module in list(sys.modules.items()):
            file = getattr(module, "__file__", None)
            if file and not name.startswith("_brdfcheck_user_") and Path(file).parent == _last_folder:
                del sys.modules[name]
        sys.path[:] = [entry for entry in sys.path if entry != str(_last_folder)]
    fresh = str(folder) not in sys.path
    sys.path.insert(0, str(folder))
    try:
        yield
    finally:
        if str(folder) in sys.path:
            sys.path.remove(str(folder))
        if fresh:
            sys.path.append(str(folder))
            _last_folder = folder


def _import_trouble(error: BaseException, path: Path) -> str:
    if isinstance(error, SyntaxError):
        where = "" if error.filename in (None, str(path)) else f"{error.filename} "
        return f"{where}line {error.lineno}: {type(error).__name__}: {one_line(error.msg)}"
    line = None
    traceback = error.__traceback__
    while traceback is not None:
        if traceback.tb_frame.f_code.co_filename == str(path):
            line = traceback.tb_lineno
        traceback = traceback.tb_next
    at = "" if line is None else f"line {line}: "
    if isinstance(error, SystemExit):
        return f"{at}it calls sys.exit({'' if error.code is None else one_line(repr(error.code))}) while being imported"
    return f"{at}{type(error).__name__}: {one_line(error)}"


def _offers(module: ModuleType) -> list[str]:
    """The public callables of a module that it defines itself (or, failing that, BRDFs that it made of ours)."""
    from brdfcheck.brdf import AbstractBRDF

    found = []
    for name, value in vars(module).items():
        if name.startswith("_") or not callable(value):
            continue
        if getattr(value, "__module__", None) == module.__name__ or isinstance(value, AbstractBRDF):
            found.append(name)
    return found


def load_object(spec: str, modules: dict[str, ModuleType] | None = None) -> tuple[Any, str]:
    """The object behind ``file.py:object`` and its full spec. `modules`: files loaded so far, which load only once.

    Without ``:object`` the file must define exactly one public callable. UsageError where there is no such thing.
    """
    modules = {} if modules is None else modules
    path, name = split_spec(spec)
    if not path.endswith(".py"):
        raise UsageError(f"{spec!r}: a BRDF of your own is given as path/to/file.py:object")
    if path not in modules:
        modules[path] = load_module(path)
    module = modules[path]
    offers = _offers(module)
    choices = f"it offers {', '.join(offers)}" if offers else "it defines no public callable"
    if not name:
        if len(offers) != 1:
            raise UsageError(f"{spec}: say which object of the file is the BRDF, as in {path}:NAME; {choices}")
        name = offers[0]
    value: Any = module
    for part in name.split("."):
        if not hasattr(value, part):
            raise UsageError(f"{path} has no object {name!r}; {choices}")
        value = getattr(value, part)
    if not callable(value):
        kind = type(value).__name__
        raise UsageError(f"{path}:{name} is not callable ({kind}); give a BRDF f(wi, wo), a class or a factory; {choices}")
    return value, f"{path}:{name}"


# --- from objects to families ---


@dataclass(frozen=True)
class _Signature:
    """The arguments of a callable.

    `integers`: those declared int; `whole`: those whose default is one, which may run over a range all the same.
    `open`: it takes any keyword, or cannot say what it takes.
    """

    required: tuple[str, ...]
    names: tuple[str, ...]
    integers: frozenset[str]
    whole: frozenset[str]
    open: bool


def _signature(function: Callable[..., Any]) -> _Signature:
    try:
        parameters = list(inspect.signature(function).parameters.values())
    except (TypeError, ValueError):
        return _Signature((), (), frozenset(), frozenset(), True)
    variadic = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)
    named = [parameter for parameter in parameters if parameter.kind not in variadic]
    return _Signature(
        tuple(parameter.name for parameter in named if parameter.default is parameter.empty),
        tuple(parameter.name for parameter in named),
        frozenset(parameter.name for parameter in named if parameter.annotation in (int, "int")),
        frozenset(parameter.name for parameter in named if type(parameter.default) is int),
        len(named) < len(parameters),
    )


def _returns_a_function(function: Callable[..., Any], parameters: Mapping[str, float]) -> bool:
    """True where two directions give a function: then it is a factory whose two parameters have no range yet."""
    import numpy as np

    try:
        return callable(function(np.array([[0.6, 0.0, 0.8]]), np.array([[0.0, 0.6, 0.8]]), **parameters))
    except (Exception, SystemExit):
        return False


def family_of(value: Any, spec: str, ranges: Mapping[str, Range], cos_theta: Range | None) -> Target:
    """A user's object as a `Target`: a BRDF, a function f(wi, wo), perhaps with parameters, a class, or a factory.

    UsageError for parameters that have no range or do not exist, and where a lobe of this package refuses their values.
    """
    from brdfcheck.brdf import AbstractBRDF
    from brdfcheck.family import Family

    signature = _signature(value)
    unknown = [name for name in ranges if name not in signature.names]
    if isinstance(value, AbstractBRDF) and ranges:
        kind = type(value).__name__
        raise UsageError(f"{spec} is one {kind}, so {next(iter(ranges))} cannot run over a range; give its class or a factory")
    if unknown and not signature.open:
        takes = ", ".join(name for name in signature.names if name not in _DIRECTIONS) or "no parameters"
        raise UsageError(f"{spec} has no parameter {unknown[0]!r}; it takes {takes}")
    for name in signature.integers & set(ranges):
        low, high = ranges[name]
        if low != high or low != int(low):
            raise UsageError(f"{spec}: {name} is a whole number: give one, as in --over {name}=2; got {low:g}:{high:g}")
    # Where a whole number is meant it is passed as one: it may be a size, or choose a formula.
    fixed = {
        name: int(low)
        for name, (low, high) in ranges.items()
        if name in signature.integers | signature.whole and low == high == int(low)
    }
    swept = {name: bounds for name, bounds in ranges.items() if name not in fixed}
    missing = [name for name in signature.required if name not in ranges]
    is_function = not inspect.isclass(value) and (
        isinstance(value, AbstractBRDF) or (signature.open and not signature.names and not ranges)
    )
    if not is_function and not inspect.isclass(value) and len(missing) >= 2:
        named_so = all(name.lower() in _DIRECTIONS for name in missing[:2])
        if len(missing) == 2 and not set(missing) & _PARAMETERS:
            middle = {name: (low + high) / 2 for name, (low, high) in swept.items()}
            is_function = named_so or not _returns_a_function(value, {**middle, **fixed})
        elif named_so:
            missing = missing[2:]
    if not is_function and missing:
        plural = "parameters" if len(missing) > 1 else "parameter"
        example = " ".join(f"--over {name}=LO:HI" for name in missing)
        raise UsageError(f"{spec}: the {plural} {', '.join(missing)} must be given a range: {example}")

    build = _builder(value, fixed, is_function=is_function, bound=bool(ranges))
    build.__name__ = spec.rpartition(":")[2]
    file = split_spec(spec)[0]
    family = Family(spec, build, swept, (0.0, 1.0) if cos_theta is None else cos_theta)
    return Target(family, fixed, _refusal(family, fixed, user=True), file, _line_of(value))


def _builder(value: Callable[..., Any], fixed: Mapping[str, float], *, is_function: bool, bound: bool) -> Callable[..., Any]:
    """What makes a BRDF of swept parameters. `bound`: the parameters go to f(wi, wo, **parameters) itself."""

    def from_factory(**parameters: Any) -> Any:
        return value(**parameters, **fixed)

    def from_function(**parameters: Any) -> Any:
        def brdf(wi: Any, wo: Any) -> Any:
            return value(wi, wo, **parameters, **fixed)

        return brdf

    def as_it_is() -> Any:
        return value

    if not is_function:
        return from_factory
    return from_function if bound else as_it_is


def _line_of(value: Any) -> int | None:
    try:
        return inspect.getsourcelines(value)[1] or None
    except (OSError, TypeError):
        return None


def _refusal(family: Any, fixed: Mapping[str, float], *, user: bool) -> str | None:
    """UsageError where one of this package's classes refuses a corner of the box; the finding where a user's code raises."""
    from brdfcheck.family import refusal

    refused = refusal(family)
    if refused is None:
        return None
    error = refused.error
    shown = ", ".join(f"{name}={value:g}" for name, value in {**refused.parameters, **fixed}.items())
    if shown and isinstance(error, (TypeError, ValueError)) and (refused.ours or not user):
        raise UsageError(f"{family.name} at {shown}: {one_line(error)}") from None
    if not user:
        raise error
    return f"{family.build.__name__}({shown}) raised {type(error).__name__}: {one_line(error)}"


def catalog_target(name: str, ranges: Mapping[str, Range], cos_theta: Range | None) -> Target:
    """A catalogue entry with the given ranges in place of its own. UsageError for a name it does not have."""
    from brdfcheck import catalog
    from brdfcheck.family import Family

    try:
        family = catalog.entry(name).family
    except KeyError as error:
        raise UsageError(error.args[0]) from None
    known = {parameter: bounds for parameter, bounds in ranges.items() if parameter in family.ranges}
    family = Family(name, family.build, {**family.ranges, **known}, family.cos_theta if cos_theta is None else cos_theta)
    if known:
        _refusal(family, {}, user=False)
    return Target(family)


def resolve(names: Iterable[str], ranges: Mapping[str, Range], cos_theta: Range | None) -> list[Target]:
    """The targets behind catalogue names and ``file.py:object``; each range must belong to at least one of them.

    A user's file is imported here, once, however many of its objects are named. Raises UsageError.
    """
    from brdfcheck import catalog

    modules: dict[str, ModuleType] = {}
    targets: list[Target] = []
    names = list(dict.fromkeys(names))
    known_ranges: set[str] = set()
    waiting: list[tuple[int, Any, str]] = []
    for name in names:
        if name in catalog.names() or not is_file_spec(name):
            targets.append(catalog_target(name, ranges, cos_theta))
            known_ranges |= set(targets[-1].family.ranges)
        else:
            waiting.append((len(targets), *load_object(name, modules)))
            targets.append(Target(None))
    for index, value, spec in waiting:
        # A range that belongs to another BRDF of the command is no mistake of this one.
        own = _signature(value)
        others = known_ranges.union(*(_signature(other).names for _, other, _ in waiting if other is not value))
        mine = {key: bounds for key, bounds in ranges.items() if key in own.names or own.open or key not in others}
        targets[index] = family_of(value, spec, mine, cos_theta)
    for parameter in ranges:
        if not waiting and parameter not in known_ranges:
            subject = names[0] if len(names) == 1 else "none of the BRDFs"
            has = f"has a parameter {parameter!r}" if len(names) > 1 else f"has no parameter {parameter!r}"
            allowed = ", ".join(sorted(known_ranges)) or "none"
            raise UsageError(f"{subject} {has}; allowed with --over: {allowed}")
    return targets
