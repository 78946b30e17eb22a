"""What a user hands over, as a family of BRDFs: a name, a file or an object in one, a BRDF, a function, a class, a factory.

A name is one of the catalogue or of a class of this package.

What is wrong with the words is a `UsageError`, in one line that names the value and what is allowed. What is wrong with
a user's BRDF, once it has been found, is not: that is a finding about the BRDF, kept in `Target.finding`.
"""

from __future__ import annotations

import contextlib
import copy
import dataclasses
import inspect
import logging
import os
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, Any

from brdfcheck.brdf.blame import told
from brdfcheck.brdf.calling import ANGLES, DIRECTIONS, NORMALS, directional, is_normal, is_number, over_cosine
from brdfcheck.brdf.family import no_range, not_whole
from brdfcheck.brdf.readers.base import OPTIONS, AbstractFile, Reading, refuse_reading
from brdfcheck.brdf.readers.python import line_of, offered
from brdfcheck.brdf.readers.registry import load_file
from brdfcheck.brdf.readers.specs import is_file_spec, split_spec
from brdfcheck.brdf.signatures import arguments_of, no_parameter, signature_of, takes_directions
from brdfcheck.brdf.values import Range, Values, by_value
from brdfcheck.messages import UsageError, one_line

if TYPE_CHECKING:
    from brdfcheck.brdf.family import Family

_log = logging.getLogger("brdfcheck")

# Exponents and roughnesses are never directions.
_PARAMETERS = frozenset({"n", "m", "k", "alpha", "roughness"})
USUAL_RANGES = {"n": (1.0, 1000.0), "m": (0.05, 1.0), "alpha": (0.05, 1.0)}
"""What a parameter runs over when a class of this package is given without ranges."""


@dataclass(frozen=True)
class Target:
    """A family, and what is known of it beforehand.

    `finding`: what already went wrong with it, in words. `file`, `line`: where a user's BRDF is defined, the file as it was
    named (None where that is no file named on a command line; the line also where a file has none, as a table).
    `entry`: what the family is called without the values that its name ends with (None where it ends with none). `unread`: it
    could not be read; `finding` says why, and the family has nothing but its name.
    """

    family: Any
    finding: str | None = None
    file: str | None = None
    line: int | None = None
    entry: str | None = None
    unread: bool = False


class _Unread(dict[str, UsageError]):
    """Why names cannot be read. `others_go_on`: such a name is noted here, instead of ending everything."""

    def __init__(self, others_go_on: bool):
        super().__init__()
        self._others_go_on = others_go_on

    @contextlib.contextmanager
    def noted(self, name: str) -> Iterator[None]:
        """A UsageError within it is about this name alone."""
        try:
            yield
        except UsageError as error:
            if not self._others_go_on:
                raise
            self[name] = error


def as_target(
    value: Any,
    ranges: Mapping[str, Range] | None = None,
    cos_theta: Range | None = None,
    reading: Reading | None = None,
) -> Target:
    """Whatever somebody hands over as a `Target`: the one door, for Python and for the command line.

    `value`: a name, ``file.py:object``, a shader file (read as `reading` says) or a measured one, a `Family`, a BRDF, a
    function f(wi, wo), perhaps with parameters, a class or a factory, whose parameters run over `ranges`; or a `Target`, which
    stays what it is.
    Raises UsageError (a ValueError) for unknown names, for parameters that have no range or do not exist, and where a lobe of
    this package refuses their values; TypeError for something that is not a BRDF.
    """
    __tracebackhide__ = True  # what is wrong with the question is told by pytest at the line that asks it
    ranges = {} if ranges is None else ranges
    if isinstance(value, Target):
        return value
    try:
        if isinstance(value, str):
            modules: dict[str, ModuleType] = {}
            targets = resolve([_only(value, spread(value, modules))], ranges, cos_theta, reading, modules)
            _only(value, [target.family.name for target in targets])
            return targets[0]
        return _of_object(value, ranges, cos_theta, reading)
    except UsageError as error:
        raise error.with_traceback(None) from None  # nor does anybody else need the way to it


def _of_object(value: Any, ranges: Mapping[str, Range], cos_theta: Range | None, reading: Reading | None) -> Target:
    """`as_target` of what is no name."""
    __tracebackhide__ = True
    from brdfcheck.brdf.calling import name_of
    from brdfcheck.brdf.family import Family

    if reading is not None and (reading.for_shaders or (reading.per_cosine and isinstance(value, (Family, AbstractFile)))):
        what = OPTIONS if reading.for_shaders else "--returns"
        raise UsageError(f"{what}: a {type(value).__name__} has been read already; give the file, or the function")
    if isinstance(value, Family):
        target = family_target(value, ranges, cos_theta)
        refuse_unknown(value, value.name, ranges, target.family)
        return target
    if isinstance(value, AbstractFile):
        return family_of(value, value.spec, ranges, cos_theta)
    if not callable(directional(value)):
        raise TypeError(f"a BRDF must be callable, f(wi, wo), or a catalogue name; got {type(value).__name__}")
    return family_of(value, name_of(value), ranges, cos_theta, reading)


def as_family(value: Any, ranges: Mapping[str, Range] | None = None, cos_theta: Range | None = None) -> Family:
    """The family of `as_target`. Raises what it raises."""
    return as_target(value, ranges, cos_theta).family


def load(
    value: Any,
    *,
    cos_theta: Range | None = None,
    defines: Mapping[str, str] | None = None,
    folders: Iterable[str] = (),
    args: str | Iterable[str] = (),
    returns: str = "brdf",
    **ranges: Any,
) -> Family:
    """Anything that `brdfcheck.check` takes as a `Family`: ``load("mine.py:glossy", n=(1, 100))``, ``load("mine.brdf")``.

    `cos_theta`: the cosines of incidence, by default 0 to 1; `ranges`: closed intervals of the parameters, or for a vector of
    a shader a number for each component. `returns`: what a function returns, "brdf" or "brdf*cos", the BRDF times the cosine at
    the light. For shader files: `defines`, macros; `folders`, where includes are; `args`, the roles L, V, N, X, Y of the
    function's arguments, as in ``"L,V,N"``. Raises ValueError for unknown names, bad ranges, parameters that have none, and
    files that cannot be read; TypeError for something that is not a BRDF.
    """
    roles = args.split(",") if isinstance(args, str) and args else args
    words = {name: str(text) for name, text in (defines or {}).items()}
    return as_target(value, ranges, cos_theta, Reading(words, tuple(map(str, folders)), tuple(roles), returns)).family


def refuse_unknown(value: Any, name: str, ranges: Mapping[str, Range], family: Family) -> None:
    """UsageError where one of the ranges is for nothing that `family`, made of `value`, has."""
    for parameter in ranges:
        if parameter not in {**family.ranges, **family.held}:
            known = signature_of(value)
            if parameter in known.whole:
                raise not_whole(name, parameter, ranges[parameter])
            raise UsageError(no_parameter(name, parameter, known.names))


def family_of(
    value: Any, spec: str, ranges: Mapping[str, Range], cos_theta: Range | None, reading: Reading | None = None
) -> Target:
    """A callable, known as `spec`, as a `Target`; `reading`: what it returns. UsageError as for `as_target`."""
    from brdfcheck.brdf.base import AbstractBRDF, AbstractBSDF
    from brdfcheck.brdf.callables import constant
    from brdfcheck.brdf.factors import refuse_batched, varied
    from brdfcheck.brdf.family import Family, interval
    from brdfcheck.brdf.two_sides import BELOW, FunctionBSDF, both_sides

    if isinstance(value, AbstractFile):
        return Target(value.family(ranges, cos_theta, no_parameter), None, value.path, value.line)
    cosines = (0.0, 1.0) if cos_theta is None else cos_theta
    ranges = {name: interval(name, bounds) for name, bounds in ranges.items()}
    value = directional(value, ranges)
    signature = signature_of(value, ranges)
    normals, of_numbers = getattr(value, "given_normal", ()), getattr(value, "is_number", None)
    # Of what transmits it is the side of the light, which no BSDF has as a parameter of its own.
    sides = None if BELOW in signature.names or signature.open else ranges.pop(BELOW, None)
    file = split_spec(spec)[0] if is_file_spec(spec) else None
    if isinstance(value, (AbstractBRDF, AbstractBSDF)) and not isinstance(value, FunctionBSDF):
        refuse_batched(value)
        build = varied(value, tuple(ranges)) if ranges else constant(value)
        family = both_sides(Family(spec, _returning(build, reading), ranges, cosines), sides)
        return Target(family, _refusal(family, user=True), file, line_of(value, spec))
    if not ranges and inspect.isclass(value) and issubclass(value, (AbstractBRDF, AbstractBSDF)):
        ranges = {name: USUAL_RANGES[name] for name in signature.required if name in USUAL_RANGES}
    unknown = [name for name in ranges if name not in signature.names]
    if unknown and not signature.open:
        raise UsageError(no_parameter(spec, unknown[0], signature.names))
    for name in signature.integers & set(ranges):
        low, high = ranges[name]
        if low != high or low != int(low):
            raise not_whole(spec, name, (low, high))
    # Where a whole number is meant it is passed as one: it may be a size, or choose a formula.
    held = {
        name: int(ranges[name][0])
        for name in ranges
        if name in signature.integers | signature.whole and ranges[name][0] == ranges[name][1] == int(ranges[name][0])
    }
    swept = {name: bounds for name, bounds in ranges.items() if name not in held}
    missing = [name for name in signature.required if name not in ranges]
    is_function = not inspect.isclass(value) and signature.open and not signature.names and not ranges
    if not is_function and not inspect.isclass(value) and len(missing) >= 2:
        named_so = all(name.lower() in DIRECTIONS for name in missing[:2])
        if len(missing) == 2 and not set(missing) & _PARAMETERS and not any(map(is_number, missing)):
            middle = {name: (low + high) / 2 for name, (low, high) in swept.items()}
            is_function = named_so or takes_directions(value, {**middle, **held})
        elif named_so:
            missing = missing[2:]
    if (
        is_function
        and of_numbers is not None
        and of_numbers(**{name: (low + high) / 2 for name, (low, high) in swept.items()}, **held)
    ):
        is_function, missing = False, list(normals)
    if not is_function and missing:
        advice = "; or write f(wi, wo, ...) where these are directions" if len(missing) > 2 else ""
        if any(map(is_number, missing)):
            advice = f"; the angles of a BRDF are known by their names: {ANGLES}; or write f(wi, wo), with wi[..., 2] a cosine"
        if any(is_normal(name) for name in missing) or (missing == ["n"] and "wi" in signature.names):
            advice = f"; the normal is known by its name, {NORMALS}, beside two directions, f(wi, wo, N)"
        raise no_range(spec, missing, advice)

    build = _builder(value, held, is_function=is_function, bound=bool(ranges))
    build.__name__ = spec.rpartition(":")[2]
    # An exponent may be called so, too.
    notes = [f"{name} is given the normal (0, 0, 1): with a range it is a parameter" for name in normals]
    family = both_sides(Family(spec, _returning(build, reading), swept, cosines, held, notes=tuple(notes)), sides)
    return Target(family, _refusal(family, user=True), file, line_of(value, spec))


def _returning(build: Callable[..., Any], reading: Reading | None) -> Callable[..., Any]:
    """What builds the BRDF, where `build` makes what returns it times the cosine at the light."""
    if reading is None or not reading.per_cosine:
        return build

    def divided(**parameters: Any) -> Any:
        return over_cosine(build(**parameters))

    divided.__name__ = build.__name__
    return divided


def _builder(value: Callable[..., Any], held: Mapping[str, float], *, is_function: bool, bound: bool) -> Callable[..., Any]:
    """What makes a BRDF of swept parameters. `bound`: the parameters go to f(wi, wo, **parameters) itself."""
    from brdfcheck.brdf.two_sides import FunctionBSDF

    if not is_function:
        return lambda **parameters: value(**parameters, **held)
    if not bound:
        return lambda: value
    if isinstance(value, FunctionBSDF):
        return lambda **parameters: value.holding(**parameters, **held)

    def build(**parameters: Any) -> Any:
        def brdf(wi: Any, wo: Any) -> Any:
            return value(wi, wo, **parameters, **held)

        return brdf

    return build


def _refusal(family: Family, *, user: bool) -> str | None:
    """UsageError where one of this package's classes refuses a corner of the box; the finding where a user's code raises."""
    from brdfcheck.brdf.family import refusal

    refused = refusal(family)
    if refused is None:
        return None
    error = refused.error
    shown = ", ".join(f"{name}={value:g}" for name, value in {**refused.parameters, **family.held}.items())
    if shown and isinstance(error, (TypeError, ValueError)) and (refused.ours or not user):
        raise UsageError(f"{family.name} at {shown}: {one_line(error)}") from None
    if not user:
        raise error
    _log.debug("%s", family.name, exc_info=error)
    return f"{family.build.__name__}({shown}) raised {told(error)}"


def family_target(family: Family, ranges: Mapping[str, Range], cos_theta: Range | None) -> Target:
    """A family, as one of the catalogue, with the given ranges in place of its own. UsageError where its lobe refuses them.

    A whole number (a range of no length) may be given to one in the lobe: the k of the binomial power. What belongs to neither
    is left to other BRDFs of the command.
    """
    from brdfcheck.brdf.family import interval
    from brdfcheck.brdf.two_sides import BELOW, checked_sides

    known = {parameter: bounds for parameter, bounds in ranges.items() if parameter in family.ranges}
    others = {parameter: interval(parameter, bounds) for parameter, bounds in ranges.items() if parameter not in known}
    whole = signature_of(family).whole if others else ()
    held = {key: int(low) for key, (low, high) in others.items() if key in whole and low == high == int(low)}

    def build(**parameters: Any) -> Any:
        brdf = family.build(**parameters)
        return brdf.with_core(type(brdf.core)(**arguments_of(brdf.core) | held))

    if BELOW in known and BELOW in family.switches:
        checked_sides(family.name, known[BELOW])
    changed: dict[str, Any] = {"ranges": {**family.ranges, **known}, "held": {**family.held, **held}}
    if cos_theta is not None:
        changed["cos_theta"] = cos_theta
    made = dataclasses.replace(family, build=build if held else family.build, **changed)
    return Target(made, _refusal(made, user=True) if known or held else None)


def named(name: str, modules: dict[str, ModuleType], reading: Reading | None = None) -> tuple[Any, str]:
    """What a name stands for, and its full name: a family of the catalogue, a class of this package, what is in a user's file.

    `modules`: users' Python files loaded so far, which load only once; `reading`: how shader files are read. Raises UsageError.
    """
    from brdfcheck.brdf import catalog, lobes, microfacet, transmission
    from brdfcheck.brdf.base import AbstractBRDF, AbstractBSDF

    name = _only(name, spread(name, modules))
    if name not in catalog.names():
        found = next((part for room in (lobes, microfacet, transmission) if (part := getattr(room, name, None))), None)
        if inspect.isclass(found) and issubclass(found, (AbstractBRDF, AbstractBSDF)) and getattr(found, "__final__", False):
            return found, name
        if os.path.isdir(name):
            raise UsageError(f"{name} is a folder; give a file in it, or list its BRDFs with brdfcheck init and check the list")
        if is_file_spec(name):
            return load_file(name, Reading() if reading is None else reading, modules)
    return catalog.entry(name).family, name


def resolve(
    names: Iterable[str],
    ranges: Mapping[str, Range | Values],
    cos_theta: Range | None,
    reading: Reading | None = None,
    modules: dict[str, ModuleType] | None = None,
    *,
    others_go_on: bool = False,
) -> list[Target]:
    """The targets behind the names of BRDFs; each range must belong to at least one of them.

    A user's Python file is imported here, once, however many of its objects are named; ``file.py:*`` names all that it offers.
    Of a parameter that has several `Values` each makes a target of its own; of a vector they are the components. `reading`:
    how shader files are read; `modules`: users' Python files loaded so far, which load only once; `others_go_on`: a name that
    cannot be read becomes an `unread_target` in its place. Raises UsageError.
    """
    modules = {} if modules is None else modules
    every: dict[str, None] = {}
    unread = _Unread(others_go_on)
    for name in names:
        with unread.noted(name):
            every |= dict.fromkeys(spread(name, modules))
        every |= dict.fromkeys(unread.keys() & {name})

    def known() -> Iterator[str]:
        for name in every.keys() - unread.keys():
            with _Unread(others_go_on).noted(name):
                yield from signature_of(named(name, modules, reading)[0]).names

    return by_value(lambda one: _resolve(list(every), one, cos_theta, reading, modules, copy.copy(unread)), ranges, known())


def _only(name: str, found: Sequence[str]) -> str:
    """The one that a name stands for. UsageError where there are several, or none."""
    if len(found) != 1:
        names = f" ({', '.join(found)})" if found else ""
        raise UsageError(f"{one_line(name)} stands for {len(found)} BRDFs{names}: give one of them")
    return found[0]


def unread_target(name: str, error: UsageError) -> Target:
    """What stands for a name that cannot be read."""
    from brdfcheck.brdf.family import Family

    file = split_spec(name)[0] if is_file_spec(name) else None
    said = re.search(rf"{re.escape(file)}(?:: line |:)(\d+)\b", str(error)) if file else None
    return Target(Family(name, lambda: None), one_line(error), file, int(said[1]) if said else None, unread=True)


def spread(name: str, modules: dict[str, ModuleType]) -> list[str]:
    """The name, or for ``file.py:*`` the specs of all that the file offers."""
    path, _, last = name.rpartition(":")
    return offered(path, modules) if last == "*" and path else [name]


def _resolve(
    names: list[str],
    ranges: Mapping[str, Range],
    cos_theta: Range | None,
    reading: Reading | None,
    modules: dict[str, ModuleType],
    unread: _Unread,
) -> list[Target]:
    """`resolve` for names of one BRDF each, and ranges."""
    from brdfcheck.brdf.family import Family

    targets: dict[str, Target] = {}
    known_ranges: set[str] = set()
    waiting: list[tuple[str, Any, str]] = []
    values: dict[str, Any] = {}
    for name in names:
        if name in unread:
            continue
        with unread.noted(name):
            value, spec = named(name, modules, reading)
            values[spec] = value
            if isinstance(value, Family):
                made = family_target(value, ranges, cos_theta)
                if is_file_spec(spec):  # one that a Python file has made
                    family = dataclasses.replace(made.family, name=spec)
                    made = dataclasses.replace(made, family=family, file=split_spec(spec)[0], line=line_of(value, spec))
                targets[name] = made
                known_ranges |= {*targets[name].family.ranges, *targets[name].family.held}
            else:
                waiting.append((name, value, spec))
    # What a range or an option is for may be what could not be read.
    whole = not unread
    if reading is not None and whole:
        refuse_reading(reading, values)
    for name, value, spec in waiting:
        # A range that belongs to another BRDF of the command is no mistake of this one.
        own = signature_of(value)
        others = known_ranges.union(*(signature_of(other).names for _, other, _ in waiting if other is not value))
        mine = {key: bounds for key, bounds in ranges.items() if key in own.names or own.open or (key not in others and whole)}
        with unread.noted(name):
            targets[name] = family_of(value, spec, mine, cos_theta, reading if is_file_spec(spec) else None)
    for parameter in ranges:
        if whole and not waiting and parameter not in known_ranges:
            if len(names) == 1:
                refuse_unknown(named(names[0], modules)[0], names[0], ranges, targets[names[0]].family)
            known = ", ".join(sorted(known_ranges)) or "none"
            raise UsageError(f"none of the BRDFs has a parameter {parameter!r}; their parameters: {known}")
    return [unread_target(name, unread[name]) if name in unread else targets[name] for name in names]
