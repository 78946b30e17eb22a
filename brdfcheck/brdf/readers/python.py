"""BRDFs from Python files: ``path/to/file.py:object``."""

from __future__ import annotations

import ast
import contextlib
import inspect
import itertools
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

from brdfcheck.brdf.calling import directional
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.readers.specs import split_spec
from brdfcheck.folders import readable
from brdfcheck.messages import UsageError, one_line

_count = itertools.count(1)


def _printable(path: str) -> str:
    """The path without the surrogates that stand for bytes of no encoding, with which JAX names no function."""
    return path.encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


def load_module(path_text: str) -> ModuleType:
    """The user's file as a module with a name of its own, which can import its neighbours. UsageError if that fails."""
    path = Path(path_text)
    with readable(path_text, "a Python file, as in mine.py:brdf"):
        path = path.resolve()
        source = path.read_bytes()
        if b"\0" in source:
            raise UsageError(f"cannot import {path_text}: it is not text in UTF-8: it holds zero bytes")
    module = ModuleType(f"_brdfcheck_user_{next(_count)}_{path.stem}")
    module.__file__, module.__package__ = str(path), ""
    sys.modules[module.__name__] = module
    try:
        with _importable(path.parent):
            # Compiled each time: a cached file would be stale where two edits fall within one second.
            exec(compile(source, _printable(str(path)), "exec", dont_inherit=True), vars(module))
    except (Exception, SystemExit) as error:
        del sys.modules[module.__name__]
        raise UsageError(f"cannot import {path_text}: {_import_trouble(error, path)}") from None
    return module


class _Failed(ModuleType):
    """Stands for a file that could not be loaded; `error` says why."""

    def __init__(self, error: UsageError):
        super().__init__("failed")
        self.error = error


def _once(path: str, modules: dict[str, ModuleType]) -> ModuleType:
    """The module of a file, which is run once however many of its objects are named, also where that fails. UsageError."""
    if path not in modules:
        try:
            modules[path] = load_module(path)
        except UsageError as error:
            modules[path] = _Failed(error)
    found = modules[path]
    if isinstance(found, _Failed):
        raise found.error.with_traceback(None)
    return found


_last_folder: Path | None = None


@contextlib.contextmanager
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
        line = "" if error.lineno is None else f"line {error.lineno}: "
        return f"{where}{line}{type(error).__name__}: {one_line(error.msg)}"
    frames = traceback.walk_tb(error.__traceback__)
    lines = [line for frame, line in frames if frame.f_code.co_filename == _printable(str(path))]
    at = f"line {lines[-1]}: " if lines else ""
    if isinstance(error, SystemExit):
        return f"{at}it calls sys.exit({'' if error.code is None else one_line(repr(error.code))}) while being imported"
    return f"{at}{type(error).__name__}: {one_line(error)}"


def offered(path: str, modules: dict[str, ModuleType]) -> list[str]:
    """All that a Python file offers as BRDFs, as specs: its public callables, of ``__all__`` where it has that. UsageError."""
    if not path.lower().endswith(".py"):
        raise UsageError(f"{path}:*: only Python files are taken whole; name the function, as in {path}:NAME")
    names = _offers(_once(path, modules))
    if not names:
        raise UsageError(f"{path}:*: it defines no public callable")
    return [f"{path}:{name}" for name in names]


def _offers(module: ModuleType) -> list[str]:
    """The public callables of a module that it defines itself, and what it made of ours: BRDFs and families.

    Of a module with ``__all__`` only what that names.
    """
    listed = getattr(module, "__all__", None)
    from brdfcheck.brdf.base import AbstractBRDF, AbstractBSDF

    found = []
    for name, value in vars(module).items():
        if name.startswith("_") or (listed is not None and name not in listed):
            continue
        own = getattr(value, "__module__", None) == module.__name__ or isinstance(value, (AbstractBRDF, AbstractBSDF, Family))
        if own and (callable(directional(value)) or isinstance(value, Family)):
            found.append(name)
    return found


def load_object(spec: str, modules: dict[str, ModuleType] | None = None) -> tuple[Any, str]:
    """The object behind ``file.py:object`` and its full spec. `modules`: files loaded so far, which load only once.

    Without ``:object`` the file must define exactly one public callable. UsageError where there is no such thing.
    """
    modules = {} if modules is None else modules
    path, name = split_spec(spec)
    if not path.lower().endswith(".py"):
        raise UsageError(f"{spec!r}: a BRDF of your own is given as path/to/file.py:object")
    module = _once(path, modules)
    offers = _offers(module)
    choices = f"it offers {', '.join(offers)}" if offers else "it defines no public callable"
    if not name:
        if len(offers) != 1:
            raise UsageError(f"{path}: say which object of the file is the BRDF, as in {path}:NAME; {choices}")
        name = offers[0]
    value: Any = module
    for part in name.split("."):
        if not hasattr(value, part):
            raise UsageError(f"{path} has no object {name!r}; {choices}")
        value = getattr(value, part)
    if not callable(directional(value)) and not isinstance(value, Family):
        kind = type(value).__name__
        raise UsageError(f"{path}:{name} is not callable ({kind}); give a BRDF f(wi, wo), a class or a factory; {choices}")
    return value, f"{path}:{name}"


def line_of(value: Any, spec: str = "") -> int | None:
    """The line at which something is defined; of an object in a file (`spec`) the line of that file which gives it its name.

    That is where one looks for it, also where it was made by a call, decorated, or imported. None where it is not known.
    """
    path, name = split_spec(spec)
    if name and path.endswith(".py"):
        with contextlib.suppress(OSError, SyntaxError, ValueError):
            return _named_at(ast.parse(Path(path).read_bytes()).body, name.split("."))
    try:
        return inspect.getsourcelines(value)[1] or None
    except (OSError, TypeError):
        return None


def _named_at(body: list[ast.stmt], names: list[str]) -> int | None:
    """The line of the last statement that binds ``names[0]``, and within a class the others; also under ``if`` or ``try``."""
    found = None
    for statement in body:
        inside = [part for key in ("body", "orelse", "handlers", "finalbody") for part in getattr(statement, key, [])]
        if isinstance(statement, ast.FunctionDef | ast.ClassDef):
            if statement.name == names[0]:
                deeper = _named_at(statement.body, names[1:]) if isinstance(statement, ast.ClassDef) and names[1:] else None
                found = deeper or statement.lineno
        elif isinstance(statement, ast.Import | ast.ImportFrom):
            if names[0] in [alias.asname or alias.name for alias in statement.names]:
                found = statement.lineno
        elif inside:
            found = _named_at(inside, names) or found
        elif isinstance(statement, ast.Assign | ast.AnnAssign | ast.AugAssign):
            targets = statement.targets if isinstance(statement, ast.Assign) else [statement.target]
            if any(isinstance(node, ast.Name) and node.id == names[0] for target in targets for node in ast.walk(target)):
                found = statement.lineno
    return found
