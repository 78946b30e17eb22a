"""A first list of a project's BRDFs, from the files in its folder. Python files are read and not run."""

from __future__ import annotations

import ast
import functools
import inspect
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from brdfcheck.brdf.readers.specs import SUFFIXES
from brdfcheck.messages import UsageError, one_line, written

# Folders that hold nothing of the project's own, and files that are tests.
_FOREIGN = frozenset(("__pycache__", "build", "dist", "node_modules", "site-packages", "venv"))
_MOST = 500
# Methods that make an object a BRDF.
_METHODS = ("eval", "f")


@dataclass(frozen=True)
class Found:
    """A BRDF in a file: its ranges as far as they are known, the parameters without one, remarks. Without `target` none."""

    file: str
    target: str | None
    over: dict[str, tuple[float, float]]
    missing: tuple[str, ...] = ()
    remark: str = ""


def files(folder: Path) -> list[Path]:
    """The files below a folder that may hold BRDFs, as seen from it; those of other projects in it and tests left out."""
    found: list[Path] = []
    for place, folders, names in os.walk(folder):
        folders[:] = sorted(name for name in folders if not (name.startswith(".") or name in _FOREIGN))
        if (Path(place) / "pyvenv.cfg").exists():
            folders.clear()
            continue
        for name in sorted(names):
            test = name.startswith(("test_", "conftest", "setup.")) or name.endswith("_test.py")
            if name.lower().endswith(SUFFIXES) and not name.startswith(".") and not test:
                found.append((Path(place) / name).relative_to(folder))
    return found[:_MOST]


def found(folder: Path) -> Iterator[Found]:
    """What the files below a folder offer."""
    for path in files(folder):
        if path.suffix == ".py":
            yield from _python(folder / path, path.as_posix())
        else:
            yield _read(folder, path.as_posix())


def _read(folder: Path, name: str) -> Found:
    """A shader, a document or a table: read as it will be when it is checked."""
    import contextlib

    from brdfcheck.brdf.family import NoRange
    from brdfcheck.brdf.subject import as_target

    with contextlib.chdir(folder):
        try:
            family = as_target(name).family
        except NoRange as error:
            return Found(name, name, {}, error.names)
        except UsageError as error:
            return Found(name, None, {}, remark=one_line(error))
    ranges = ", ".join(f"{key}={written(low)}:{written(high)}" for key, (low, high) in family.ranges.items())
    return Found(name, family.name, {}, remark=f"over the ranges of the file: {ranges}" if ranges else "")


@functools.cache
def _makers() -> set[str]:
    """The names in this package of what makes BRDFs."""
    from brdfcheck.brdf import factors, lobes, microfacet, mixtures, transmission
    from brdfcheck.brdf.base import AbstractBRDF, AbstractBSDF

    rooms = (factors, lobes, microfacet, mixtures, transmission)
    every = [(name, value) for room in rooms for name, value in vars(room).items() if inspect.isclass(value)]
    return {"load", "bsdf", "Family"} | {name for name, value in every if issubclass(value, (AbstractBRDF, AbstractBSDF))}


def _python(path: Path, name: str) -> Iterator[Found]:
    """What in a Python file looks like a BRDF: public functions and classes by their arguments, or because they make such, or
    ours; and what is made of ours.
    """
    from brdfcheck.brdf.calling import geometry
    from brdfcheck.brdf.subject import USUAL_RANGES

    try:
        body = ast.parse(path.read_bytes()).body
    except (OSError, SyntaxError, ValueError, RecursionError) as error:
        yield Found(name, None, {}, remark=f"{type(error).__name__}: {one_line(error)}")
        return

    imports = [node for node in body if isinstance(node, ast.Import | ast.ImportFrom)]
    # What names of this package are called in the file, and under which it is imported itself.
    ours = {
        alias.asname or alias.name: alias.name.rpartition(".")[2]
        for node in imports
        for alias in node.names
        if (getattr(node, "module", None) or alias.name).partition(".")[0] == "brdfcheck"
    }

    def is_ours(value: ast.expr | None) -> bool:
        """True for ``Phong(10)``, ``brdfcheck.lobes.Phong(10)``, ``brdfcheck.load(...)``."""
        called = value.func if isinstance(value, ast.Call) else None
        root, name = called, getattr(called, "attr", None)
        while isinstance(root, ast.Attribute):
            root = root.value
        return isinstance(root, ast.Name) and root.id in ours and (name or ours[root.id]) in _makers()

    def makes_ours(function: ast.FunctionDef) -> bool:
        return any(is_ours(part.value) for part in ast.walk(function) if isinstance(part, ast.Return))

    def directions(function: ast.FunctionDef | ast.Lambda, skip: int = 0) -> set[str]:
        return geometry(argument.arg for argument in function.args.args[skip:])

    def parameters(function: ast.FunctionDef, skip: int) -> list[str]:
        own = function.args.args
        required = own[: len(own) - len(function.args.defaults)]
        keywords = [
            part for part, default in zip(function.args.kwonlyargs, function.args.kw_defaults, strict=True) if not default
        ]
        return [argument.arg for argument in (*required[skip:], *keywords)]

    for node in body:
        needed: list[str] | None = None
        if isinstance(node, ast.Assign) and is_ours(node.value):
            targets = [target.id for target in node.targets if isinstance(target, ast.Name)]
            yield from (Found(name, f"{name}:{target}", {}) for target in targets if not target.startswith("_"))
        elif isinstance(node, ast.FunctionDef):
            inner = [part for part in ast.walk(node) if isinstance(part, ast.FunctionDef | ast.Lambda) and part is not node]
            if directions(node):
                needed = [name for name in parameters(node, 0) if name not in directions(node)]
            elif any(map(directions, inner)) or makes_ours(node):
                needed = parameters(node, 0)
        elif isinstance(node, ast.ClassDef):
            methods = {part.name: part for part in node.body if isinstance(part, ast.FunctionDef)}
            if any(directions(methods[method], 1) for method in (*_METHODS, "__call__") if method in methods):
                needed = parameters(methods["__init__"], 1) if "__init__" in methods else []
        if needed is not None and not node.name.startswith("_"):  # pyright: ignore[reportAttributeAccessIssue]
            known = {key: USUAL_RANGES[key] for key in needed if key in USUAL_RANGES}
            rest = tuple(key for key in needed if key not in known)
            remark = "usual ranges: say what yours are" if known else ""
            yield Found(name, f"{name}:{node.name}", known, rest, remark)  # pyright: ignore[reportAttributeAccessIssue]


def draft(subjects: list[Found], prefix: str) -> str:
    """The text of the project's file; `prefix`: "tool.brdfcheck." in a pyproject.toml, else nothing."""
    lines = ["# What `brdfcheck check` verifies when it is given no names, and pytest as tests."]
    lines += [f"[{prefix.rstrip('.')}]"] if prefix else []
    lines += ['effort = "normal"    # "quick" before a commit, "thorough" before a release', ""]
    for subject in subjects:
        if subject.target is None:
            continue
        mark = "# " if subject.missing else ""
        if subject.missing:
            lines.append(f"# Replace LO and HI by the range of {', '.join(subject.missing)}, and uncomment:")
        lines.append(f"{mark}[[{prefix}subjects]]")
        told = f"    # {subject.remark}" if subject.remark else ""
        over = {key: f"[{written(low)}, {written(high)}]" for key, (low, high) in subject.over.items()}
        over |= dict.fromkeys(subject.missing, "[LO, HI]")
        if over:
            lines.append(f"{mark}target = {json.dumps(subject.target, ensure_ascii=False)}")
            pairs = ", ".join(f"{_key(key)} = {value}" for key, value in over.items())
            lines.append(f"{mark}over = {{ {pairs} }}{told}")
        else:
            lines.append(f"{mark}target = {json.dumps(subject.target, ensure_ascii=False)}{told}")
        lines.append("")
    lines.append(
        '# A violation that is accepted: expect = { violates = 1.05, reason = "..." }, or brdfcheck check --update-baseline.'
    )
    lines += [
        f"# Left out: {subject.file}: {subject.remark.removeprefix(f'{subject.file}: ')}"
        for subject in subjects
        if subject.target is None
    ]
    return "\n".join(lines) + "\n"


def _key(name: str) -> str:
    return name if name.replace("_", "").isalnum() and name.isascii() else json.dumps(name, ensure_ascii=False)
