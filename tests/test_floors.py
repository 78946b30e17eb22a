"""The picture of the house, held against the imports: a folder is a floor, and imports only from floors below it."""

from __future__ import annotations

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest
from shared import ROOT, python

PACKAGE = ROOT / "brdfcheck"

GROUND = {
    "geometry",
    "messages",
    "numerics",
    "runtime",
    "operations",
    "cores",
    "interruption",
    "documents",
    "folders",
    "processes",
    "names",
}
FLOORS = [
    GROUND,
    {"brdf"},
    {"proof"},
    {"quadrature"},
    {"verdict"},
    {"fits"},
    {"output"},
    {"plots"},
    {"studies", "sweep", "scene", "transport", "budgets"},
    {"gate"},
    {"cli", "pytest_plugin"},
    {"__main__", "__init__", "lobes", "microfacet"},
]
# Imports within a floor, and why.
NEIGHBOURS = {
    ("budgets", "scene"): "a budget is of the picture of a scene",
    ("budgets", "transport"): "its room is an enclosure",
    ("transport", "scene"): "a polygon sends the same light to a point as a light and as a wall",
}
FILES = sorted(PACKAGE.rglob("*.py"))


def module_of(path: Path) -> str:
    parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(path) for path in FILES}


def imports(path: Path) -> set[str]:
    """The package's own modules that a file imports, those under TYPE_CHECKING left out."""
    found: set[str] = set()

    class Visitor(ast.NodeVisitor):
        def visit_If(self, node: ast.If) -> None:
            if "TYPE_CHECKING" not in ast.unparse(node.test):
                self.generic_visit(node)

        def visit_Import(self, node: ast.Import) -> None:
            found.update(alias.name for alias in node.names if alias.name in MODULES)

        def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
            assert node.level == 0, f"{path} line {node.lineno}: imports are absolute here"
            module = node.module or ""
            if module in MODULES:
                inner = {f"{module}.{alias.name}" for alias in node.names} & MODULES
                found.update(inner)
                if len(inner) < len([alias for alias in node.names if alias.name != "__version__"]):
                    found.add(module)

    Visitor().visit(ast.parse(path.read_text()))
    return found - {module_of(path)}


def floor_of(room: str) -> int:
    return next(i for i, floor in enumerate(FLOORS) if room in floor)


def room_of(module: str) -> str:
    return [*module.split("."), "__init__"][1]


def test_every_folder_has_a_floor():
    rooms = {path.relative_to(PACKAGE).parts[0].removesuffix(".py") for path in FILES}
    assert rooms == set().union(*FLOORS)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_down(path):
    room = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    for module in imports(path):
        other = room_of(module)
        if other != room and room not in GROUND and (room, other) not in NEIGHBOURS:
            assert floor_of(other) < floor_of(room), f"{path.name} imports {module}"
        if room in GROUND:
            assert other in GROUND, f"{path.name} imports {module}"


def test_no_circle():
    graph = {module_of(path): imports(path) for path in FILES}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


def test_every_exception_is_used():
    used = {(path.relative_to(PACKAGE).parts[0], room_of(module)) for path in FILES for module in imports(path)}
    assert set(NEIGHBOURS) <= used


def defined(path: Path) -> set[str]:
    """The names that a module defines, also within an `if` or a `try`."""
    body = ast.parse(path.read_text()).body
    inner = [line for outer in body if isinstance(outer, ast.If | ast.Try) for line in ast.walk(outer)]
    found = {line.name for line in [*body, *inner] if isinstance(line, ast.FunctionDef | ast.ClassDef)}
    lines = [line for line in [*body, *inner] if isinstance(line, ast.Assign | ast.AnnAssign)]
    targets = [target for line in lines for target in (line.targets if isinstance(line, ast.Assign) else [line.target])]
    return found | {node.id for target in targets for node in ast.walk(target) if isinstance(node, ast.Name)}


def test_a_name_is_imported_from_where_it_is_defined():
    """But from a package, which offers what its modules define."""
    own = {module_of(path): defined(path) for path in FILES if path.name != "__init__.py"}
    for path in FILES:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module in own:
                passed_on = {alias.name for alias in node.names} - own[node.module] - {"*"}
                assert not passed_on, f"{path.name} imports {passed_on} from {node.module}"


def test_instruments_of_studies_stay_outside():
    for path in FILES:
        assert "_instruments" not in path.read_text(), path


def test_only_entry_points_change_the_precision():
    for path in FILES:
        if path.name != "runtime.py":
            assert "enable_x64" not in path.read_text(), path.name


def test_importing_the_package_imports_nothing_heavy():
    code = "import sys, brdfcheck; print([m for m in ('jax', 'numpy', 'matplotlib', 'scipy', 'typer') if m in sys.modules])"
    assert python("-c", code) == (0, "[]\n", "")
