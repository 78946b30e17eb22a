"""The picture of the house, held against the imports: data flows one way, up."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "brdfcheck"

FLOORS = [
    {"geometry", "precision", "brdf", "family", "messages", "rational", "cores", "interruption"},
    {"lobes", "microfacet", "factors", "callables", "documents", "processes", "costs"},
    {"quadrature"},
    {"catalog", "directional", "exact_factors", "minimax"},
    {"tables", "pointwise", "rules", "peers"},
    {"verdict"},
    {"records", "user_brdf", "fit", "surfaces"},
    {
        "ladder",
        "scene",
        "lobe_error",
        "single",
        "work_precision",
        "limits",
        "stability",
        "sweep",
        "compact",
        "curves",
        "curve_files",
        "plots",
    },
    {"console", "export", "studies", "transport", "pictures"},
    {"budgets"},
    {"cli"},
    {"__main__", "__init__"},
]
# Within a floor these may be used by their neighbours: the vocabulary of the floor.
SHARED = {("geometry", "brdf")}


def floor_of(module: str) -> int:
    return next(i for i, floor in enumerate(FLOORS) if module in floor)


def imports(path: Path) -> set[str]:
    """Names of the package's own modules that a file imports, those under TYPE_CHECKING left out."""
    found: set[str] = set()

    class Visitor(ast.NodeVisitor):
        def visit_If(self, node: ast.If) -> None:
            if "TYPE_CHECKING" not in ast.unparse(node.test):
                self.generic_visit(node)

        def visit_Import(self, node: ast.Import) -> None:
            for alias in node.names:
                if alias.name.startswith("brdfcheck."):
                    found.add(alias.name.split(".")[1])

        def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
            parts = (node.module or "").split(".")
            if parts[0] == "brdfcheck":
                found.update([parts[1]] if len(parts) > 1 else [alias.name for alias in node.names])

    Visitor().visit(ast.parse(path.read_text()))
    return found


FILES = sorted(PACKAGE.rglob("*.py"))


def test_every_module_has_a_floor():
    modules = {path.relative_to(PACKAGE).parts[0].removesuffix(".py") for path in FILES}
    assert modules == set().union(*FLOORS)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_imports_go_down(path):
    module = path.relative_to(PACKAGE).parts[0].removesuffix(".py")
    if module == "__init__":
        return
    for imported in imports(path) - {module}:
        if (PACKAGE / f"{imported}.py").exists() or (PACKAGE / imported).is_dir():
            lower = floor_of(imported) < floor_of(module) or (imported, module) in SHARED
            assert lower, f"{module} imports {imported}, which is not on a floor below it"


def test_only_entry_points_change_the_precision():
    for path in FILES:
        if path.name != "precision.py":
            assert "enable_x64" not in path.read_text(), path.name


def test_importing_the_package_imports_nothing_heavy():
    import subprocess
    import sys

    code = "import sys, brdfcheck; print([m for m in ('jax', 'numpy', 'matplotlib', 'scipy', 'typer') if m in sys.modules])"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"
