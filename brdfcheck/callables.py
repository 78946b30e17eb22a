"""Any function f(wi, wo) as something that can be evaluated on many directions at once: JAX where it can be traced.

What is wrong with a user's function is a `Finding` about that function: it raises, returns the wrong shape, or is not
real. NaN, infinite and negative values are passed on; they are judged where they are integrated.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import numpy as np

from brdfcheck.precision import double_precision

_log = logging.getLogger("brdfcheck")

# Rows of directions a compiled program takes; requests are padded to the next size, so few programs are compiled.
_SIZES = (1024, 8192, 32768, 131072)


class Finding(ValueError):
    """Something wrong with a user's BRDF that keeps it from being integrated. The message says what."""


def name_of(function: object) -> str:
    """A short name for messages: of a lobe with its factor, both."""
    lobe, factor = getattr(function, "lobe", None), getattr(function, "factor", None)
    if lobe is not None and factor is not None:
        return f"{name_of(lobe)} times {name_of(factor)}"
    return getattr(function, "__name__", type(function).__name__)


def _checked(result: Any, rows: int, name: str) -> np.ndarray:
    try:
        values = np.asarray(result)
    except Exception as error:
        raise Finding(f"{name} returned {type(result).__name__}, not an array of numbers") from error
    if values.shape == () and rows != 1:
        values = np.broadcast_to(values, (rows,))
    if np.iscomplexobj(values):
        raise Finding(f"{name} returned complex values ({values.dtype})")
    if not (np.issubdtype(values.dtype, np.number) or values.dtype == bool):
        raise Finding(f"{name} returned values of type {values.dtype}, not numbers")
    if values.ndim not in (1, 2) or values.shape[0] != rows or values.shape[-1] == 0:
        raise Finding(
            f"{name} returned shape {values.shape} for directions of shape ({rows}, 3); expected ({rows},) or"
            f" ({rows}, channels). Index the last axis: wi[..., 2], not wi[2]"
        )
    # The type of the answers is kept: it says how far they are rounded.
    return values if np.issubdtype(values.dtype, np.floating) else values.astype(float)


def constant(brdf: Callable[..., Any]) -> Callable[[], Callable[..., Any]]:
    """A family of one, which messages call by the name of `brdf`."""

    def build() -> Callable[..., Any]:
        return brdf

    build.__name__ = name_of(brdf)
    return build


class Evaluator:
    """A family of BRDFs, ``build(**parameters) -> f(wi, wo)``, evaluated on arrays of directions.

    Three paths, tried in this order on a few directions: one JAX program for all parameters; one JAX program for each
    set of parameters; plain Python with numpy arrays, which `slow` reports and a log message announces.
    """

    def __init__(self, build: Callable[..., Any], parameters: Mapping[str, float]):
        self._build = build
        self._name = name_of(build)
        self._programs: dict[tuple[float, ...], Callable] = {}
        self.slow = False
        self._shared: Callable | None = None
        wi = np.array([[0.6, 0.0, 0.8], [0.0, 0.0, 1.0]])
        wo = np.array([[0.0, 0.6, 0.8], [0.48, 0.6, 0.64]])
        shared = eqx.filter_jit(lambda values, wi, wo: build(**values)(wi, wo))
        try:
            self._run(lambda wi, wo: shared(_arrays(parameters), wi, wo), wi, wo)
            self._shared = shared
            return
        except Finding:
            raise
        except Exception:  # whatever tracing throws: some functions need numbers where JAX shows them tracers
            pass
        brdf = self._built(parameters)
        try:
            self._run(eqx.filter_jit(brdf), wi, wo)
            return
        except Finding:
            raise
        except Exception:
            self.slow = True
        try:
            self._run(brdf, wi, wo)
        except Finding:
            raise
        except Exception as error:
            raise Finding(f"{self._name} raised {type(error).__name__}: {error}") from error
        _log.warning("%s cannot be traced by JAX: evaluated with numpy, which is slower", self._name)

    def _built(self, parameters: Mapping[str, float]) -> Callable:
        try:
            brdf = self._build(**parameters)
        except Exception as error:
            shown = ", ".join(f"{key}={value:g}" for key, value in parameters.items())
            raise Finding(f"{self._name}({shown}) raised {type(error).__name__}: {error}") from error
        if not callable(brdf):
            raise Finding(f"{self._name} returned {type(brdf).__name__}, which is not a function f(wi, wo)")
        return brdf

    def _run(self, function: Callable, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        with np.errstate(all="ignore"), double_precision():
            return _checked(function(wi, wo), len(wo), self._name)

    def bind(self, parameters: Mapping[str, float]) -> Callable[[np.ndarray, np.ndarray], np.ndarray]:
        """f for these parameters: (wi, wo) of shape (k, 3) each, float64 -> values of shape (k,) or (k, channels).

        The function raises Finding where the BRDF raises or returns something that is not a number for each direction.
        """
        if self._shared is not None:
            values, shared = _arrays(parameters), self._shared
            return lambda wi, wo: self._padded(lambda a, b: shared(values, a, b), wi, wo)
        key = tuple(parameters.values())
        if key not in self._programs:
            brdf = self._built(parameters)
            self._programs = {key: brdf if self.slow else eqx.filter_jit(brdf)}  # keep the latest only
        program = self._programs[key]
        if self.slow:
            return lambda wi, wo: self._guarded(program, wi, wo)
        return lambda wi, wo: self._padded(program, wi, wo)

    def _padded(self, program: Callable, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        rows = len(wo)
        size = next((size for size in _SIZES if size >= rows), rows)
        padding = ((0, size - rows), (0, 0))
        result = self._guarded(program, np.pad(wi, padding, mode="edge"), np.pad(wo, padding, mode="edge"))
        return result[:rows]

    def _guarded(self, program: Callable, wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        try:
            return self._run(program, wi, wo)
        except Finding:
            raise
        except Exception as error:
            raise Finding(f"{self._name} raised {type(error).__name__}: {error}") from error


def _arrays(parameters: Mapping[str, float]) -> dict[str, np.ndarray]:
    return {key: np.asarray(value, float) for key, value in parameters.items()}
