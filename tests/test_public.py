"""The public names: all there, all documented, nothing imported before it is used."""

from __future__ import annotations

import importlib
import inspect
import subprocess
import sys

import pytest

PACKAGES = ("brdfcheck", "brdfcheck.quadrature", "brdfcheck.transport")
NAMES = [(package, name) for package in PACKAGES for name in importlib.import_module(package).__all__]


@pytest.mark.parametrize(("package", "name"), NAMES, ids=lambda part: part)
def test_every_public_name_says_what_it_is(package, name):
    found = getattr(importlib.import_module(package), name)
    text = inspect.getdoc(found)
    if inspect.isclass(found) or inspect.isroutine(found) or inspect.ismodule(found):
        assert text
        assert len(text) > 20
        assert text != inspect.getdoc(object)
        # A dataclass without a docstring shows its signature instead.
        assert not text.startswith(f"{name}(")


def test_parameters_of_public_functions_are_named_or_typed():
    for package, name in NAMES:
        found = getattr(importlib.import_module(package), name)
        if inspect.isfunction(found):
            for parameter in inspect.signature(found).parameters.values():
                assert parameter.annotation is not inspect.Parameter.empty, (package, name, parameter.name)


def test_importing_the_package_imports_no_jax():
    code = "import sys, brdfcheck, brdfcheck.transport; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
