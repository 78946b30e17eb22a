"""Shaders in tests: a few lines of GLSL as a function of directions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck import load

FRAME = "vec3 f(vec3 L, vec3 V, vec3 N)"
# Directions with numbers that are easy to work with: L = (0.6, 0, 0.8), V = (0, 0.28, 0.96).
LIGHT = np.array([[0.6, 0.0, 0.8]])
VIEW = np.array([[0.0, 0.28, 0.96]])


def write(folder: Path, text: str, name: str = "shader.glsl") -> str:
    """A file with this text."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    return str(path)


def family(folder: Path, text: str, name: str = "shader.glsl", **options: Any) -> Any:
    """The family of the function f of a shader."""
    return load(f"{write(folder, text, name)}:f", **options)


def folded(folder: Path, text: str, name: str = "shader.glsl", **options: Any) -> np.ndarray:
    """f of a shader at LIGHT and VIEW, where the parameter `one` is 1 and known to be."""
    return np.asarray(family(folder, text, name, one=(1.0, 1.0), **options).build()(LIGHT, VIEW))[0]


def traced(folder: Path, texts: Mapping[str, str], name: str = "shader.glsl", **options: Any) -> dict[str, np.ndarray]:
    """The same of many shaders, where JAX traces `one`: in one program, which compiles in a third of the time."""
    builds = {key: family(folder, text, name, one=(0.0, 2.0), **options).build for key, text in texts.items()}
    run = jax.jit(lambda one, wi, wo: {key: build(one=one)(wi, wo) for key, build in builds.items()})
    return {key: np.asarray(values)[0] for key, values in run(jnp.asarray(1.0), LIGHT, VIEW).items()}
