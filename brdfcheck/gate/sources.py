"""On which files a verdict depends, found without running any of them; or why that cannot be told.

A verdict may be kept only where it is sure to come out the same again. So a Python file counts with the modules that it imports
from its own folder, and everything else that it uses must be known to depend on nothing but what is installed. A file that
imports anything else, opens files, or asks for the time or random numbers, is in doubt. So is what is read by a program whose
files are not known here.
"""

from __future__ import annotations

import ast
import hashlib
import os
import re
from collections.abc import Iterable, Iterator
from pathlib import Path

from brdfcheck.brdf.readers.specs import is_file_spec, split_spec

PURE = frozenset((
    "__future__", "abc", "brdfcheck", "cmath", "collections", "dataclasses", "decimal", "enum", "equinox", "fractions",
    "functools", "itertools", "jax", "jaxtyping", "math", "numbers", "numpy", "operator", "scipy", "typing",
    "typing_extensions",
))  # fmt: skip
"""Packages whose answers depend on nothing but their version and what they are given."""
# Names of Python, and in those packages, by which a file reaches beyond itself, or changes what others do.
_BUILTINS = frozenset((
    "__builtins__", "__import__", "__loader__", "__spec__", "breakpoint", "compile", "delattr", "eval", "exec", "getattr",
    "globals", "hash", "id", "input", "open", "setattr", "vars",
))  # fmt: skip
_REACHING = frozenset((
    "DataSource", "__builtins__", "__dict__", "__getattr__", "__globals__", "__subclasses__", "_sys", "albedo_table",
    "as_family", "as_target", "assert_conserves", "attrgetter", "budget", "budgets", "catalog", "certify", "check", "cli",
    "config", "ctypeslib", "datasets", "documents", "environ", "f2py", "factor_ladder", "ffi", "fit_factor", "folders",
    "fromfile", "fromregex", "gate", "genfromtxt", "io", "io_callback", "lib", "load", "load_file", "loadtxt", "memmap",
    "methodcaller", "misc", "open", "open_memmap", "os", "output", "pure_callback", "random", "readers", "register",
    "render", "resolve", "scene", "seterr", "sweep", "sys", "testing", "tree_deserialise_leaves",
))  # fmt: skip
# Endings of files of which the includes are all that they read.
_SHADERS = frozenset((".brdf", ".frag", ".fs", ".glsl", ".glslf", ".hlsl", ".slang"))
_INCLUDE = re.compile(r"^[ \t]*#[ \t]*include[ \t]*([\"<])([^\">\n]+)[\">]")


class Doubt(Exception):
    """It cannot be told what a verdict depends on; the message says why."""


class Tampering(Doubt):
    """A file may change what others in its process find, too."""


def sources(names: Iterable[str], folders: Iterable[str] = ()) -> dict[str, Path]:
    """The files behind the names of BRDFs, each under the name by which it is found; `folders`: where includes may be.

    Doubt where that cannot be told.
    """
    found: dict[str, Path] = {}
    for name in names:
        if name.startswith("mitsuba:"):
            raise Doubt("it is a plug-in of Mitsuba, whose files are not known")
        path = Path(split_spec(name)[0])
        suffix = path.suffix.lower()
        if name.startswith("materialx:") or suffix == ".mtlx":
            if any(variable.startswith("MATERIALX_") for variable in os.environ):
                raise Doubt("the environment says where MaterialX looks for more")
            if suffix == ".mtlx" and "include" in _text(path).lower():
                raise Doubt(f"{path} includes other documents")
        if name.startswith("materialx:") or not is_file_spec(name):
            continue
        if suffix == ".py":
            found |= _python(path)
        elif suffix in _SHADERS:
            found |= _shader(path, [Path(folder) for folder in folders])
        elif suffix in (".mtlx", ".binary", ".bsdf"):
            found[path.name] = path
        else:
            raise Doubt(f"{path} is of a kind whose files are not known")
    return found


def watched(names: Iterable[str], folders: Iterable[str] = ()) -> set[Path]:
    """The files that may change a verdict, as far as they can be told: those of `sources`, or the BRDF's own."""
    found: set[Path] = set()
    for name in names:
        try:
            found |= set(sources([name], folders).values())
        except Doubt:
            path = Path(split_spec(name.removeprefix("mitsuba:"))[0].partition("#")[0])
            found |= {path, *path.parent.glob("*.py")} if path.suffix == ".py" else {path}
    return found


def digest(found: dict[str, Path]) -> list[tuple[str, str]]:
    """The contents of files, as a list that is the same where these are. Doubt where one cannot be read."""
    try:
        return [(name, hashlib.sha256(path.read_bytes()).hexdigest()) for name, path in sorted(found.items())]
    except OSError as error:
        raise Doubt(f"a file cannot be read: {error}") from None


def _text(path: Path) -> str:
    try:
        return path.read_bytes().decode("utf-8", "replace")
    except OSError as error:
        raise Doubt(f"{path} cannot be read: {error}") from None


# --- Python ---


def _python(path: Path) -> dict[str, Path]:
    """A Python file and the modules of its folder that it imports, themselves or by each other."""
    found = {path.name: path}
    waiting = [path]
    while waiting:
        file = waiting.pop()
        for name, other in _imported(file, path.parent):
            if name not in found:
                found[name] = other
                waiting.append(other)
    return found


def _imported(file: Path, root: Path) -> Iterator[tuple[str, Path]]:
    """The modules in `root` that a file imports: their paths in it. Doubt where the file reaches further."""
    try:
        tree = ast.parse(_text(file))
    except (SyntaxError, ValueError, RecursionError):
        raise Doubt(f"{file} is not Python") from None
    nodes = list(ast.walk(tree))
    # ``from numpy import *`` brings its names without naming them; so does a neighbour that has it.
    starred = any(alias.name == "*" for node in nodes if isinstance(node, ast.ImportFrom) for alias in node.names)
    for node in nodes:
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield from _beside(alias.name.split("."), root, root, file)
                _refuse(alias.name.split("."), file)
        elif isinstance(node, ast.ImportFrom):
            base = root if node.level == 0 else file.parents[node.level - 1]
            module = node.module.split(".") if node.module else []
            _refuse([*module, *(alias.name for alias in node.names)], file)
            for alias in node.names:
                yield from _beside([*module, alias.name], base, root, file)
        elif isinstance(node, ast.Attribute):
            own = isinstance(node.value, ast.Name) and node.value.id == "self"
            if not (own or isinstance(node.ctx, ast.Load)):
                raise Tampering(f"{file} sets {node.attr} of something that others may use")
            _refuse([node.attr], file)
        elif isinstance(node, ast.Name) and node.id in _BUILTINS:
            raise Doubt(f"{file} uses {node.id}")
        elif starred and isinstance(node, ast.Name):
            _refuse([node.id], file)


def _beside(parts: list[str], base: Path, root: Path, file: Path) -> Iterator[tuple[str, Path]]:
    """The files that an import of ``a.b.c`` runs where ``a`` is in `base`. Doubt where it is neither there nor pure."""
    here = base
    for index, part in enumerate(parts):
        module, package = here / f"{part}.py", here / part / "__init__.py"
        if module.is_file() or package.is_file():
            # Both are looked at: one of them runs.
            for one in (module, package):
                if one.is_file():
                    yield one.relative_to(root).as_posix() if one.is_relative_to(root) else str(one), one
        elif not (here / part).is_dir():
            if index == 0 and base == root and parts[0] not in PURE:
                raise Doubt(f"{file} imports {parts[0]}, which is not beside it")
            return
        here = here / part


def _refuse(names: list[str], file: Path) -> None:
    reaching = next((name for name in names if name in _REACHING), None)
    if reaching is not None:
        raise Doubt(f"{file} uses {reaching}")


# --- shaders ---


def _shader(path: Path, folders: list[Path]) -> dict[str, Path]:
    """A shader and all that its includes may name, whatever macros say: of each name every file in any of the folders."""
    found: dict[str, Path] = {path.name: path}
    waiting, seen = [path], [path.parent]
    while waiting:
        file = waiting.pop()
        for line in re.sub(r"\\\r?\n", "", _text(file)).splitlines():
            if "include" not in line or "#" not in line:
                continue
            matched = _INCLUDE.match(line)
            if matched is None:
                raise Doubt(f"{file} has an include that depends on macros")
            candidates = [folder / matched[2] for folder in (*seen, *folders)]
            here = [one for one in candidates if one.is_file()]
            if not here:
                raise Doubt(f"{file} includes {matched[2]}, which is not there")
            for one in here:
                key = f"{matched[2]} {candidates.index(one)}"
                if key not in found:
                    found[key] = one
                    waiting.append(one)
                    if one.parent not in seen:
                        seen.append(one.parent)
                        # A folder that comes late may hold what an earlier include names.
                        waiting += [other for other in found.values() if other not in waiting]
    return found
