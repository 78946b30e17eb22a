"""What users write as f(wi, wo): methods of objects, the directions in the other order, angles; one pair at a time, or many.

`directional` makes a function of two directions of them all, by the names of their arguments. `traced_one_by_one` and
`called_one_by_one` make one for arrays of directions of a function that takes one pair.
"""

from __future__ import annotations

import functools
import inspect
import math
import re
from collections.abc import Callable, Collection, Iterable
from types import CodeType, FunctionType, ModuleType
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.base import AbstractBRDF, AbstractBSDF
from brdfcheck.brdf.blame import Finding
from brdfcheck.brdf.branches import by_branches

_METHODS = ("eval", "f")
_NAMES = {
    "i": ("wi", "w_i", "omega_i", "incoming", "light", "l"),
    "o": ("wo", "w_o", "omega_o", "outgoing", "view", "v"),
}
DIRECTIONS = {name: role for role, names in _NAMES.items() for name in names}
"""Names under which people pass the two directions: "i" to the light, "o" to the viewer. Lower case."""
NORMALS = "N, Ng, Ns, normal or nrm"
"""Names under which people pass the surface normal, for messages."""
_TANGENTS = (("X", "Y"), ("tangent", "bitangent"))
_OF_ANGLES = {
    "i": ("i", "in", "inc", "incident", "incoming", "l", "light"),
    "o": ("o", "out", "outgoing", "r", "refl", "reflected", "v", "view"),
    "h": ("h", "half"),
    "d": ("d", "diff", "difference"),
}
_ROLES = {name: role for role, names in _OF_ANGLES.items() for name in names}
_ANGLE = re.compile(r"(theta|phi|θ|φ)_?(\w+)")
_NUMBER = re.compile(rf"(cos_?(theta|θ)?|mu|μ|theta|phi|θ|φ)_?(\d|{'|'.join(_ROLES)})?|[hlnv]_?dot_?[hlnv]|n[hlv]|[lv]h")
ANGLES = "(theta_i, phi_i, theta_o, phi_o), (theta_h, theta_d, phi_d)"
"""Signatures in angles, for messages: any two or more of these names, and of phi_h, are recognised."""


def name_of(function: object) -> str:
    """A short name for messages: of a lobe with its factor, both."""
    lobe, factor = getattr(function, "lobe", None), getattr(function, "factor", None)
    if lobe is not None and factor is not None:
        return f"{name_of(lobe)} times {name_of(factor)}"
    name = getattr(function, "__name__", None)
    # What has been taken apart and put together again by JAX may hold a placeholder there.
    return name if isinstance(name, str) else type(function).__name__


def angle_of(name: str) -> str | None:
    """The angle that an argument is by its name: "theta_i" for ``thetaIn``; None for anything else."""
    found = _ANGLE.fullmatch(name.lower())
    if found is None or found[2] not in _ROLES:
        return None
    return f"{'theta' if found[1] in ('theta', 'θ') else 'phi'}_{_ROLES[found[2]]}"


def is_number(name: str) -> bool:
    """True for the names of angles and cosines, which no direction has: ``theta``, ``cos_i``, ``NdotL``."""
    return _NUMBER.fullmatch(name.lower()) is not None


def is_normal(name: str) -> bool:
    """True for one of `NORMALS`: an exponent is n."""
    return name in ("N", "Ng", "Ns") or name.lower() in ("normal", "nrm")


def directional(value: Any, parameters: Collection[str] = ()) -> Any:
    """f(wi, wo, **parameters) of what a user hands over; what is that already, or has no such form, as it is.

    Objects that are not callable, but have a method `eval` or `f`, stand for that. Arguments called like `ANGLES` are angles in
    radians: theta from the normal, phi from the x axis, in (-pi, pi]; h the half vector, d the light relative to it
    (Rusinkiewicz 1998). phi_d alone, without theta_d, is nobody's name. f(wo, wi) and f(alpha, wi, wo) get their directions
    where they are named. Beside two directions called so, an argument of `NORMALS` gets (0, 0, 1), but where its name is one of
    the `parameters`, and X and Y beside that get the axes along the surface; the function that is returned then has the names
    of the normal as `given_normal`, and `is_number`, true where it takes them for numbers.
    """
    if isinstance(value, (AbstractBRDF, AbstractBSDF, type)):
        return value
    if not callable(value):
        return next((directional(way, parameters) for name in _METHODS if callable(way := getattr(value, name, None))), value)
    if type(value) is FunctionType and not vars(value) and _as_it_is(value.__code__, frozenset(parameters)):
        return value
    try:
        signature = inspect.signature(value)
    except (TypeError, ValueError):
        return value
    given = {item.name: item for item in signature.parameters.values() if item.kind is item.POSITIONAL_OR_KEYWORD}
    angles = _angles_of(given)
    if angles:
        return _of_angles(value, angles, signature)
    pair, normals, tangents = ([given[name] for name in part] for part in _vectors_of(given, parameters))
    if not pair:
        return value
    light, viewer = pair
    if normals:
        return _with_normal(value, light, viewer, normals, tangents, signature)
    if pair == list(given.values())[:2]:
        return value
    return _renamed(value, lambda wi, wo, **rest: value(**{light.name: wi, viewer.name: wo}, **rest), signature, pair)


@functools.lru_cache(maxsize=64)
def _as_it_is(code: CodeType, parameters: Collection[str]) -> bool:
    """True where a function of this code is f(wi, wo): a factory makes one for each value of its parameters."""
    names = code.co_varnames[code.co_posonlyargcount : code.co_argcount]
    pair, normals, _ = _vectors_of(names, parameters)
    return not _angles_of(names) and (not pair or (not normals and pair == list(names[:2])))


def geometry(names: Iterable[str]) -> set[str]:
    """Which arguments, by their names, are directions or what goes with them; none where the function is no BRDF by them."""
    names = list(names)
    directions, normals, tangents = _vectors_of(names)
    return {*_angles_of(names), *directions, *(normals if directions else ()), *(tangents if directions else ())}


def _angles_of(names: Iterable[str]) -> dict[str, str]:
    """The angle that each argument is; none where they do not make two directions."""
    angles = {name: angle for name in names if (angle := angle_of(name))}
    kinds = set(angles.values())
    return angles if len(kinds) == len(angles) >= 2 and ("theta_d" in kinds or "phi_d" not in kinds) else {}


def _vectors_of(names: Iterable[str], parameters: Collection[str] = ()) -> tuple[list[str], list[str], list[str]]:
    """The directions to the light and to the viewer (none where no two names are theirs), the normals, and the axes along the
    surface.
    """
    names = list(names)
    free = [name for name in names if name not in parameters]
    normals = [name for name in free if is_normal(name)]
    # As BRDF Explorer has them: f(L, V, N, X, Y).
    tangents = next(([x, y] for x, y in _TANGENTS if normals and x in free and y in free), [])
    first = [name for name in names if name not in normals and name not in tangents][:2]
    named = [name for name in free if name not in ("l", "v") and name.lower() in DIRECTIONS]
    ways = ({DIRECTIONS.get(name.lower()): name for name in two} for two in (first, named) if len(two) == 2)
    return next(([way["i"], way["o"]] for way in ways if way.keys() == {"i", "o"}), []), normals, tangents


def _renamed(value: Any, brdf: Any, signature: inspect.Signature, gone: list[inspect.Parameter]) -> Any:
    """`brdf`, which stands for `value`, with wi and wo in place of the arguments that are `gone`."""
    names = {item.name for item in gone}
    found: Any = functools.wraps(value)(brdf)
    found.__name__ = name_of(value)
    directions = [inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD) for name in ("wi", "wo")]
    # None of those that are left is given by its place.
    rest = [
        item.replace(kind=item.KEYWORD_ONLY) if item.kind is item.POSITIONAL_OR_KEYWORD else item
        for item in signature.parameters.values()
        if item.name not in names
    ]
    found.__signature__ = signature.replace(parameters=[*directions, *sorted(rest, key=lambda item: item.kind)])
    return found


def _with_normal(
    value: Any,
    i: inspect.Parameter,
    o: inspect.Parameter,
    normals: list[inspect.Parameter],
    tangents: list[inspect.Parameter],
    signature: inspect.Signature,
) -> Any:
    def brdf(wi: Any, wo: Any, axis: tuple[int, int, int] = (0, 0, 1), **parameters: Any) -> Any:
        form: Any = jnp if isinstance(wi, jax.Array) else np
        axes = {item.name: axis for item in normals} | dict(
            zip((item.name for item in tangents), ((1, 0, 0), (0, 1, 0)), strict=False)
        )
        frame = {name: form.zeros_like(wi) + form.asarray(axis, wi.dtype) for name, axis in axes.items()}
        return value(**{i.name: wi, o.name: wo}, **frame, **parameters)

    def towards_normal(wi: Any, wo: Any, **parameters: Any) -> Any:
        return brdf(wi, wo, **parameters)

    def is_number(**parameters: float) -> bool:
        pair = np.array([0.48, 0.36, 0.8]), np.array([-0.6, 0.0, 0.8])
        try:
            up, aside = (np.asarray(brdf(*pair, axis, **parameters)) for axis in ((0, 0, 1), (1, 0, 0)))
        except Exception:  # whatever a user's code raises: it is told where the function is evaluated
            return False
        # What takes the components one by one answers in their order.
        return up.shape == (3,) and not np.all(up == up[0]) and bool(np.allclose(up, np.roll(aside, -1)))

    found = _renamed(value, towards_normal, signature, [i, o, *normals, *tangents])
    found.given_normal, found.is_number = tuple(item.name for item in normals), is_number
    return found


def _of_angles(value: Any, angles: dict[str, str], signature: inspect.Signature) -> Any:
    def brdf(wi: Any, wo: Any, **parameters: Any) -> Any:
        found = _angles(wi, wo, frozenset(angles.values()))
        return value(**{name: found[angle] for name, angle in angles.items()}, **parameters)

    return _renamed(value, brdf, signature, [signature.parameters[name] for name in angles])


def _module_of(*arrays: Any) -> ModuleType:
    """What computes with these directions: math for one pair in numpy, numpy for many, jax.numpy for what JAX made."""
    if any(isinstance(array, jax.Array) for array in arrays):
        return jnp
    return math if all(array.ndim == 1 for array in arrays) else np


def _angles(wi: Any, wo: Any, wanted: frozenset[str]) -> dict[str, Any]:
    """The angles of directions (..., 3) in radians, shape (...); floats for one pair in numpy."""
    form: Any = _module_of(wi, wo)
    i, o = (part.tolist() if form is math else [part[..., axis] for axis in range(3)] for part in (wi, wo))
    found = {}
    for role, direction in (("i", i), ("o", o)):
        if not wanted.isdisjoint((f"theta_{role}", f"phi_{role}")):
            found |= _polar(form, role, *direction)
    if not wanted.isdisjoint(("theta_h", "phi_h", "theta_d", "phi_d")):
        half, apart = ([a + sign * b for a, b in zip(i, o, strict=True)] for sign in (1, -1))
        found |= _polar(form, "h", *half)
        # Half the angle between unit vectors, to all digits. The light less the view, seen from the half vector, is
        # turned by half a turn where the two change places, and its azimuth is that of the light.
        lengths = (form.hypot(form.hypot(x, y), z) for x, y, z in (apart, half))
        found["theta_d"] = form.atan2(*lengths)
        (x, y, z), theta, phi = apart, found["theta_h"], found["phi_h"]
        across, along = form.cos(phi) * y - form.sin(phi) * x, form.cos(phi) * x + form.sin(phi) * y
        found["phi_d"] = form.atan2(across, form.cos(theta) * along - form.sin(theta) * z)
    return found


def _polar(form: Any, role: str, x: Any, y: Any, z: Any) -> dict[str, Any]:
    # Near the normal a cosine has lost the angle.
    return {f"theta_{role}": form.atan2(form.hypot(x, y), z), f"phi_{role}": form.atan2(y, x)}


def over_cosine(brdf: Any) -> Any:
    """The BRDF of a function that returns the BRDF times N.wi: its values divided by that, 0 where no light falls."""
    brdf = directional(brdf)
    if isinstance(brdf, AbstractBRDF):
        from brdfcheck.brdf.factors import PerCosine

        return PerCosine(brdf)
    if not callable(brdf):  # whoever calls it says so
        return brdf

    def divided(wi: Any, wo: Any) -> Any:
        value, cosine = brdf(wi, wo), wi[..., 2]
        if isinstance(wi, jax.Array) or isinstance(value, jax.Array):
            value, form = jnp.asarray(value), jnp
        else:
            value, form = np.asarray(value), np
        cosine = cosine[..., None] if value.ndim > cosine.ndim else cosine
        return form.where(cosine > 0, value / form.where(cosine > 0, cosine, 1.0), 0.0)

    divided.__name__ = name_of(brdf)
    return divided


# --- one pair at a time ---


def traced_one_by_one(function: Callable[..., Any]) -> Callable[..., Any]:
    """f for arrays of directions (..., 3) of one that takes a pair of directions (3,), by jax.vmap."""
    chosen = by_branches(function)

    def brdf(wi: Any, wo: Any) -> Any:
        wi, wo = jnp.broadcast_arrays(wi, wo)
        values = jax.vmap(chosen)(wi.reshape(-1, 3), wo.reshape(-1, 3))
        return values.reshape(wi.shape[:-1] + values.shape[1:])

    return brdf


def called_one_by_one(function: Callable[..., Any], channels: int | None = None) -> Callable[..., Any]:
    """The same by a call for each pair, with numpy arrays (3,). `channels`: of its answers; a plain number stands for all.

    Raises Finding where an answer is no number, or not so many.
    """
    tail = () if channels is None else (channels,)

    def brdf(wi: Any, wo: Any) -> np.ndarray:
        wi, wo = np.broadcast_arrays(wi, wo)
        shape, pairs = wi.shape[:-1], (wi.reshape(-1, 3), wo.reshape(-1, 3))
        values = [function(i, o) for i, o in zip(*pairs, strict=True)]
        try:
            found = np.asarray(values)
        except ValueError:  # they differ in their shapes
            found = np.empty(0)
        if found.shape != (len(values), *tail) or found.dtype.kind not in "biufc":
            found = np.array([_filled(function, value, tail, i, o) for value, i, o in zip(values, *pairs, strict=True)])
        return found.reshape(shape + tail)

    return brdf


def _filled(function: Any, value: Any, tail: tuple[int, ...], i: np.ndarray, o: np.ndarray) -> np.ndarray:
    found = answer_of(function, value, i, o)
    if found.shape not in ((), tail):
        raise Finding(f"{name_of(function)} returned shape {found.shape} for one pair of directions, {tail} for others")
    return np.broadcast_to(found, tail)


def answers_one_by_one(function: Callable[..., Any], wi: np.ndarray, wo: np.ndarray) -> list[np.ndarray]:
    """What a function of one pair says of each pair of directions (pairs, 3), as arrays of no or one axis. Raises Finding."""
    return [answer_of(function, function(i.copy(), o.copy()), i, o) for i, o in zip(wi, wo, strict=True)]


def answer_of(function: Any, value: Any, i: np.ndarray, o: np.ndarray) -> np.ndarray:
    """The answer for one pair of directions as an array of no or one axis. Finding where it is no number, or numbers."""
    try:
        found = np.asarray(value)
    except (TypeError, ValueError):
        found = np.asarray(None)
    if found.ndim > 1 or found.size == 0 or found.dtype.kind not in "biufc":
        what = f"shape {found.shape}" if found.dtype.kind in "biufc" else type(value).__name__.replace("NoneType", "None")
        directions = ", ".join(f"{name}=({', '.join(f'{x:.4g}' for x in one)})" for name, one in (("wi", i), ("wo", o)))
        advice = ": is there a way through it without a return?" if value is None else ", not a number"
        raise Finding(f"{name_of(function)} returned {what} for {directions}{advice}")
    return found
