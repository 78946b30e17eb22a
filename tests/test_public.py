"""The public names: all there, all documented, nothing imported before it is used."""

from __future__ import annotations

import ast
import importlib
from pathlib import Path

import pytest
from shared import python

import brdfcheck

PACKAGES = ("brdfcheck", "brdfcheck.brdf", "brdfcheck.quadrature", "brdfcheck.transport")
NAMES = [(package, name) for package in PACKAGES for name in importlib.import_module(package).__all__]


def test_every_public_name_is_there():
    for package, name in NAMES:
        assert getattr(importlib.import_module(package), name) is not None, (package, name)
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        brdfcheck.nothing  # noqa: B018


def test_submodules_are_attributes_and_lobes_have_their_short_names():
    code = """if True:
        import brdfcheck
        from brdfcheck.lobes import Phong
        from brdfcheck.microfacet import GGX
        assert brdfcheck.lobes.Phong(10).n == 10
        assert brdfcheck.lobes.Phong is Phong is brdfcheck.Phong is brdfcheck.brdf.lobes.Phong
        assert brdfcheck.microfacet.GGX is GGX
        assert brdfcheck.catalog is brdfcheck.brdf.catalog
        assert brdfcheck.verdict.check is brdfcheck.check
        assert {"check", "load", "lobes", "Phong"} <= set(dir(brdfcheck)) & set(brdfcheck.__all__)
        try:
            brdfcheck.phong
        except AttributeError as error:
            assert str(error) == "module 'brdfcheck' has no attribute 'phong'"
    """
    assert python("-c", code)[0] == 0


def test_whatever_the_api_page_shows_says_what_it_is():
    """Module-level functions and classes of every module, also of those without `__all__`."""
    package = Path(brdfcheck.__file__).parent
    silent = []
    for path in sorted(package.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        public = [
            node for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef)) and not node.name.startswith("_")
        ]
        silent += [
            f"{path.relative_to(package)}: {getattr(node, 'name', '')}"
            for node in [tree, *public]
            if not ast.get_docstring(node)
        ]
    assert silent == []
