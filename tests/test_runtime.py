"""Where compiled programs are kept, which options they are compiled with, and that only entry points change the precision."""

from __future__ import annotations

import os
import warnings
from pathlib import Path

import jax
import pytest
from shared import python

from brdfcheck.folders import cache_folder
from brdfcheck.runtime import use_compilation_cache

_OPTIONS = (
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
    "jax_persistent_cache_min_entry_size_bytes",
)


@pytest.fixture
def settings_of_jax():
    """The settings before the test, put back after it."""
    before = {name: getattr(jax.config, name) for name in _OPTIONS}
    yield before
    for name, value in before.items():
        jax.config.update(name, value)


def test_the_folder_is_named_by_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BRDFCHECK_CACHE", "/some/where")
    monkeypatch.setenv("XDG_CACHE_HOME", "/cache")
    assert cache_folder() == Path("/some/where")
    monkeypatch.setenv("BRDFCHECK_CACHE", "")
    assert cache_folder() == Path("/cache/brdfcheck")
    monkeypatch.delenv("BRDFCHECK_CACHE")
    assert cache_folder() == Path("/cache/brdfcheck")
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", "/home/somebody")
    assert cache_folder() == Path("/home/somebody/.cache/brdfcheck")


def test_the_cache_keeps_quick_programs_too(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, settings_of_jax) -> None:
    folder = tmp_path / "deep" / "cache"
    monkeypatch.setenv("BRDFCHECK_CACHE", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 1.0)
    use_compilation_cache()
    assert folder.is_dir()
    assert jax.config.jax_compilation_cache_dir == str(folder)  # pyright: ignore[reportAttributeAccessIssue]
    assert jax.config.jax_persistent_cache_min_compile_time_secs == 0  # pyright: ignore[reportAttributeAccessIssue]
    assert jax.config.jax_persistent_cache_min_entry_size_bytes == -1  # pyright: ignore[reportAttributeAccessIssue]
    # A damaged entry costs a compilation; a warning about it would be an error in a test.
    warnings.warn("Error reading persistent compilation cache entry for 'jit_f'", UserWarning, stacklevel=1)
    with pytest.raises(UserWarning, match="something else"):
        warnings.warn("something else", UserWarning, stacklevel=1)


def test_without_a_folder_there_is_no_cache_and_no_error(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, settings_of_jax
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("BRDFCHECK_CACHE", str(tmp_path / "file" / "cache"))
    use_compilation_cache()
    assert jax.config.jax_compilation_cache_dir == settings_of_jax["jax_compilation_cache_dir"]  # pyright: ignore
    monkeypatch.setenv("BRDFCHECK_CACHE", str(tmp_path / "locked"))
    monkeypatch.setattr(os, "access", lambda *_: False)
    use_compilation_cache()
    assert jax.config.jax_compilation_cache_dir == settings_of_jax["jax_compilation_cache_dir"]  # pyright: ignore


def test_importing_the_package_leaves_single_precision_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    code = """if True:
        import brdfcheck, jax
        from brdfcheck import Phong, catalog, verdict
        assert Phong(2.0).n.dtype == 'float32', Phong(2.0).n.dtype
        assert jax.config.jax_compilation_cache_dir is None
        brdfcheck.use_x64()
        assert Phong(2.0).n.dtype == 'float64'
    """
    for name in [name for name in os.environ if name.startswith("JAX_")]:
        monkeypatch.delenv(name)
    assert python("-c", code)[::2] == (0, "")
