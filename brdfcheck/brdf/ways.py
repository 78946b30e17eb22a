"""How a user's function is called: with arrays of directions or one pair at a time, while JAX traces it or by plain Python.

Nothing is guessed: the first way counts that gives a number, or numbers, for each direction.
"""

from __future__ import annotations

import contextlib
import inspect
import logging
import threading
from collections.abc import Callable, Iterator, Mapping
from types import CellType, CodeType, FunctionType
from typing import Any, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer

from brdfcheck.brdf.blame import INDEXING, Finding, of_arrays, told
from brdfcheck.brdf.calling import answers_one_by_one, called_one_by_one, directional, name_of, traced_one_by_one
from brdfcheck.numerics import unit_vectors
from brdfcheck.runtime import double_precision

_log = logging.getLogger("brdfcheck")

_MOST_CHANNELS = 256
# The ways in which a function may be called, in the order in which they are tried: by plain Python (else while JAX traces it),
# and for one pair of directions at a time (else for arrays of them).
_WAYS = ((False, False), (True, False), (False, True), (True, True))
_SAMPLES = 24
_ONE_PAIR = "takes one pair of directions"
# What code has that looks at how an array lies in memory.
_LAYOUT = {"reshape", "ravel", "view", "resize", "data", "ctypes", "strides", "as_strided", "frombuffer", "flags"}


class Caller:
    """A family of BRDFs, ``build(**parameters) -> f(wi, wo)``, and the way in which its functions are called.

    `slow`: by plain Python, with numpy arrays; `single`: for one pair of directions at a time, by jax.vmap or by a call each.
    `channels`: the last axis of the answers (None for one number a direction), `dtype`: their type.

    Raises Finding where no way gives a number, or numbers, for each direction.
    """

    def __init__(self, build: Callable[..., Any], parameters: Mapping[str, float]):
        self.name, self.names = name_of(build), tuple(parameters)
        self.slow = self.single = False
        self._build = build
        self._local = threading.local()
        self._tail: int | None = None  # the channels of one pair, where each is a call
        self._order: Literal["C", "F"] = "C"
        place = np.array(list(parameters.values()), float)
        shapes = self._choose(place)
        checked = [self.shape_of(shape, count) for shape, count in zip(shapes, (1, 2, 3), strict=True)]
        if len({channels for channels in checked if channels is not None}) > 1:
            raise Finding(
                f"{self.name} returned shape {shapes[1].shape} for 2 directions and {shapes[2].shape} for 3: the number of"
                " channels follows the number of directions, as where every wi meets every wo; for wi.wo of each pair write"
                " sum(wi * wo, axis=-1)"
            )
        self.channels = next((channels for channels in checked if channels is not None), None)
        if self.channels is not None and self.channels > _MOST_CHANNELS:
            raise Finding(f"{self.name} returned {self.channels} channels; at most {_MOST_CHANNELS} are looked at")
        self.dtype = shapes[1].dtype if jnp.issubdtype(shapes[1].dtype, jnp.floating) else np.dtype(float)
        if self.slow and not self.single and self._takes_columns(place):
            self._order = "F"
        if self.slow:
            how = "called for each pair of directions" if self.single else "evaluated with numpy"
            _log.warning("%s cannot be traced by JAX: %s, which is slower", self.name, how)

    @property
    def note(self) -> str | None:
        """How the function is called where that is not the usual way, and what another way of writing it gains."""
        if self.slow and self.single:
            return (
                f"{_ONE_PAIR}, and JAX cannot trace it: called for each pair. Written for arrays of directions (wi[..., 2] for"
                " wi[2], jnp.where for if, jnp.sqrt for math.sqrt) it is evaluated some 100 times as fast, at more points"
            )
        if self.slow:
            return "JAX cannot trace this function: evaluated with numpy, which is slower"
        if self.single:
            return f"{_ONE_PAIR}: called through jax.vmap, which is as fast as a version for arrays of directions"
        return None

    def _choose(self, place: np.ndarray) -> list[Any]:
        """Settle how the function is called: answers (arrays, or their shapes) for one, two and three directions.

        Raises the Finding of arrays of directions where no way works, or that of one pair where it is about more than that.
        """
        of_many: Finding | None = None
        of_one: Finding | None = None
        # One number for all directions: a constant, at this place or everywhere, or a sum over all of them.
        of_all: list[tuple[bool, Any]] = []
        constant = False
        for self.slow, self.single in _WAYS:
            if self.slow and self.single and constant:
                break
            try:
                answers = self._answers(place)
            except Finding as finding:
                of_one, of_many = (finding, of_many) if self.single else (of_one, of_many or finding)
            except Exception:  # whatever tracing throws: some functions need numbers where JAX shows them tracers
                continue
            else:
                if self.single or any(answer.shape for answer in answers):
                    return answers
                constant = not self._depends(place)
                if constant and not self.slow:
                    return answers
                of_all.append((self.slow, answers))
        if of_all:
            (self.slow, answers), self.single = of_all[0], False
            return answers
        assert of_many is not None
        assert of_one is not None
        many, one = of_many.__cause__, of_one.__cause__
        about_arrays = many is None or of_arrays(many)
        raise of_one if about_arrays and (many is not None if one is None else not of_arrays(one)) else of_many

    def _answers(self, place: np.ndarray) -> list[Any]:
        """What the present way of calling the function gives; Finding, or whatever tracing throws, where that is none."""
        if not self.slow:  # only tracing tells whether a function can be traced, and it compiles nothing
            answers = [self._traced(count, place) for count in (1, 2, 3)]
        else:
            if self.single:
                shapes = {answer.shape for answer in self._one_by_one(place)} - {()}
                if len(shapes) > 1:
                    raise Finding(f"{self.name} returned shapes {' and '.join(map(str, shapes))} for single pairs")
                self._tail = next((shape[0] for shape in shapes), None)
            answers = [self.called(place, *sample(count)) for count in (1, 2, 3)]
        for answer, count in zip(answers, (1, 2, 3), strict=True):
            self.shape_of(answer, count)
        if self.single and not self.slow and self._misread(place):
            raise Finding("while JAX traces it, it has other values")
        return answers

    def _one_by_one(self, place: np.ndarray) -> list[np.ndarray]:
        """Plain answers for some pairs of directions."""
        with calm():
            return self._guarded(place, lambda: answers_one_by_one(self._directional(place), *sample()))

    def _misread(self, place: np.ndarray) -> bool:
        """True where a function of one pair, called plainly, has other values than by jax.vmap."""
        try:
            plain = np.array([answer.astype(float) for answer in self._one_by_one(place)])
        except Finding as finding:
            if finding.__cause__ is None:  # it returned something, but no number
                raise
            # Some need arrays of JAX; but JAX itself takes an index that is out of bounds for the last one.
            return not isinstance(finding.__cause__, (AttributeError, TypeError))
        except ValueError:  # a number for some, for others several
            return False
        with calm():
            traced = np.asarray(self.brdf(place)(*map(jnp.asarray, sample())))
            rounding = max(1e-7, 1e4 * float(jnp.finfo(traced.dtype).eps) if traced.dtype.kind == "f" else 0.0)
        return not np.allclose(traced, plain, rtol=rounding, atol=rounding * 1e-9, equal_nan=True)

    def _depends(self, place: np.ndarray) -> bool:
        """True where one number for all directions is not the same number for each of them."""
        wi, wo = sample(3)
        try:
            first, *rest = (self.called(place, wi[i : i + 1], wo[i : i + 1]) for i in range(3))
        except Finding:
            return False
        return not all(np.array_equal(first, other, equal_nan=True) for other in rest)

    def brdf(self, parameters: Any) -> Callable[..., Any]:
        """The function for arrays of directions (..., 3)."""
        function = self._directional(parameters)
        if not self.single:
            return function
        return called_one_by_one(function, self._tail) if self.slow else traced_one_by_one(function)

    def _directional(self, parameters: Any) -> Callable[..., Any]:
        """f(wi, wo) as the user wrote it."""
        try:
            brdf = directional(self._build(**dict(zip(self.names, parameters, strict=True))))
        except Exception as error:
            if any(isinstance(value, Tracer) for value in parameters):
                raise
            shown = self._shown(parameters) or "()"
            raise Finding(f"{self.name}{shown} raised {told(error)}") from error
        if not callable(brdf):
            kind = "a number or an array" if hasattr(brdf, "dtype") else type(brdf).__name__
            raise Finding(f"{self.name} returned {kind}, which is not a function f(wi, wo)")
        return brdf

    def _shown(self, parameters: Any) -> str:
        """The parameters of a call, for messages; nothing where there are none."""
        values = ", ".join(f"{key}={float(value):g}" for key, value in zip(self.names, parameters, strict=True))
        return f"({values})" if values else ""

    def _traced(self, count: int, place: np.ndarray) -> Any:
        brdf = None if self.names else self.brdf(())
        wi, _ = sample(count)

        def values(parameters: Any, wi: Any, wo: Any) -> Any:
            return (brdf or self.brdf(parameters))(wi, wo)

        with calm():
            parameters = tuple(jax.ShapeDtypeStruct((), np.float64) for _ in place)
            direction = jax.ShapeDtypeStruct(wi.shape, np.float64)
            found = jax.eval_shape(values, parameters, direction, direction)
        if not hasattr(found, "shape"):
            advice = " (numpy.asarray makes one of a list)" if isinstance(found, (list, tuple)) else ""
            raise Finding(f"{self.name} returned {type(found).__name__}, not an array of numbers{advice}")
        return found

    def called(self, parameters: np.ndarray, wi: np.ndarray, wo: np.ndarray, *, own: bool = False) -> np.ndarray:
        """One call of the plain function. It gets arrays of its own: it may write to them.

        `own`: these are, and they lie in memory component by component; the call is within `calm`.
        """
        pairs = [part if own and self._order == "F" else np.array(part, order=self._order) for part in (wi, wo)]
        with contextlib.nullcontext() if own else calm():
            result = self._guarded(parameters, lambda: self._bound(parameters)(*pairs))
        try:
            return np.array(result)  # it may be room that the function writes to again
        except Exception as error:
            raise Finding(f"{self.name} returned {type(result).__name__}, not an array of numbers") from error

    def _takes_columns(self, place: np.ndarray) -> bool:
        """True where the function has the same values for arrays that lie in memory component by component.

        Sums over the three components are five times as fast then. Not of a function that may look at how they lie (compiled
        ones do, and who writes to a flattened view), as far as its code can be seen.
        """
        pairs = sample(3)
        values = self.called(place, *pairs)
        if not _of_components(self._bound(place)):
            return False
        self._order = "F"
        try:
            return np.array_equal(values, self.called(place, *pairs), equal_nan=True)
        except (Finding, TypeError):
            return False
        finally:
            self._order = "C"

    def _guarded(self, parameters: np.ndarray, call: Callable[[], Any]) -> Any:
        """What a call of the plain function gives; what it raises is a Finding."""
        try:
            return call()
        except Finding:
            raise
        except Exception as error:
            raise Finding(f"{self.name}{self._shown(parameters)} raised {told(error)}") from error

    def _bound(self, parameters: np.ndarray) -> Callable[..., Any]:
        key = (self.single, self._tail, *map(float, parameters))
        if getattr(self._local, "key", None) != key:
            self._local.brdf = self.brdf(key[2:])
            self._local.key = key
        return self._local.brdf

    def shape_of(self, values: Any, count: int) -> int | None:
        """The channels of an answer for `count` directions; Finding where it is none."""
        dtype, shape = np.dtype(values.dtype), values.shape
        if dtype.kind == "c":
            raise Finding(f"{self.name} returned complex values ({dtype})")
        if dtype.kind not in "biuf" and not jnp.issubdtype(dtype, jnp.floating):
            raise Finding(f"{self.name} returned values of type {dtype}, not numbers")
        if shape == () or (len(shape) == 1 and shape[0] == count):
            return None
        if len(shape) == 2 and shape[0] == count and shape[1] > 0:
            return shape[1]
        raise Finding(
            f"{self.name} returned shape {shape} for directions of shape ({count}, 3); expected ({count},) or"
            f" ({count}, channels): {INDEXING}"
        )


@contextlib.contextmanager
def calm() -> Iterator[None]:
    """Within it users' functions compute in float64, and numpy does not warn."""
    with np.errstate(all="ignore"), double_precision():
        yield


def _of_components(function: Any) -> bool:
    """True where Python code is all that a function is, and neither it nor what it calls by name looks at how arrays lie."""
    left, looked = [function], set()
    while left:
        one = inspect.unwrap(left.pop())
        one = getattr(one, "__func__", one)
        if not isinstance(one, FunctionType):
            return False
        if one.__code__ in looked:
            continue
        codes = [one.__code__]
        held = [cell.cell_contents for cell in one.__closure__ or () if cell != CellType()]
        while codes:
            code = codes.pop()
            looked.add(code)
            if _LAYOUT & {*code.co_names}:
                return False
            codes += [part for part in code.co_consts if isinstance(part, CodeType)]
            held += [one.__globals__[name] for name in code.co_names if name in one.__globals__]
        left += [part for part in held if callable(part) and not isinstance(part, (type, np.ufunc)) and not _of_numpy(part)]
    return True


def _of_numpy(function: Any) -> bool:
    return (getattr(function, "__module__", None) or "").partition(".")[0] in ("numpy", "math")


def sample(count: int = _SAMPLES) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of directions, no two alike, shape (count, 3) each; at most `_SAMPLES`."""
    random = np.random.default_rng(11)
    cosine, azimuth = random.uniform(0.3, 0.95, (2, _SAMPLES)), random.uniform(0, 2 * np.pi, (2, _SAMPLES))
    # Some are near the mirror direction, where a sharp lobe is not zero.
    cosine[1, ::3], azimuth[1, ::3] = cosine[0, ::3] * 1.01, azimuth[0, ::3] + np.pi + 0.01
    wi, wo = unit_vectors(cosine, azimuth)
    return wi[:count], wo[:count]
