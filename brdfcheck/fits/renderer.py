r"""Tables for renderers: directional albedo, its average, and the two integrals of the split sum, each cell with its error bar.

Rows run over one parameter, columns over mu = cos theta, both evenly, as the texels of a texture do. In every cell

* E(mu), the directional albedo of the target;
* $E_{avg} = 2 \int_0^1 E(\mu)\, \mu\, d\mu$, the average albedo, the same along a row;
* scale A and bias B of the split sum (Karis 2013): with Schlick's Fresnel term $F = F_0 (1 - c) + c$,
  $c = (1 - V \cdot H)^5$, the albedo is $F_0 A + B$. So B is the albedo at $F_0 = 0$, and A that at $F_0 = 1$ less B.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from brdfcheck.brdf.base import AbstractBRDF, AbstractMicrofacetLobe, core_of
from brdfcheck.brdf.callables import with_options_of
from brdfcheck.brdf.family import Family, interval
from brdfcheck.brdf.readers.base import Reading, refuse_reading
from brdfcheck.brdf.readers.specs import is_file_spec
from brdfcheck.brdf.signatures import signature_of
from brdfcheck.brdf.subject import as_target, family_of, named
from brdfcheck.fits.grids import AlbedoGrid, Sampler, formula_of
from brdfcheck.messages import UsageError, one_of
from brdfcheck.numerics import averaging
from brdfcheck.quadrature.frozen import worst_channel
from brdfcheck.quadrature.tables import albedo_table
from brdfcheck.runtime import double_precision

PLACEMENTS = ("centres", "ends")
"""Where the nodes lie: in the middles of N equal parts, as texels do, or at both ends of the range."""
ROUGHNESS = "roughness"
ROW = "row"
"""What the parameter of a target is called that has none."""
# What the perceptual roughness of renderers is the root of (Burley 2012), where the target has no parameter of that name.
_WIDTHS = ("alpha", "m")
# Gauss nodes of the average: of lobes, and of functions.
_AVERAGE = ((24, 16), (12, 8))
# The accuracy that is asked of functions where nothing is said: a float32 has no more.
_FUNCTIONS = 1e-6

Say = Callable[[int, int], object]


@dataclass(frozen=True)
class Sources:
    """The families behind a table, each over `parameter` alone (`ROW`, held at 0, where the target has none).

    `family` is the target. `white` is the same with a Fresnel term of 1: the same object where it is that already, None where
    that is not known. `bias` has Schlick's at F0 = 0, `half` what the target makes of F0 = 1/2 (None for facets of this
    package). `why`: why there is no bias. `mapping`: what the parameter is to the target, where it is not its own.
    `formula`: the catalogue's, if it is in there.
    """

    family: Family
    parameter: str
    white: Family | None = None
    bias: Family | None = None
    half: Family | None = None
    why: str = ""
    mapping: str = ""
    formula: str = ""


@dataclass(frozen=True)
class RendererTable:
    """`grid` holds E with its bars and the nodes, on the range `bounds` of the parameter, placed as `placement` says.

    `average`: E_avg and its bars, each (parameter,); None where not all cosines are looked at. `scale`, `bias`: values and
    bars, each (parameter, cos_theta); None where there is no split sum, and `why` says why.
    """

    sources: Sources
    grid: AlbedoGrid
    bounds: tuple[float, float]
    placement: str
    average: tuple[np.ndarray, np.ndarray] | None
    scale: tuple[np.ndarray, np.ndarray] | None
    bias: tuple[np.ndarray, np.ndarray] | None
    why: str

    @property
    def channels(self) -> dict[str, tuple[np.ndarray, np.ndarray]]:
        """Values and bars by name, each (parameter, cos_theta)."""
        found = {"E": (self.grid.values, self.grid.errors)}
        if self.average is not None:
            value, bar = (np.repeat(part[:, None], self.grid.values.shape[1], axis=1) for part in self.average)
            found["average"] = (value, bar)
        return found | ({} if self.scale is None or self.bias is None else {"scale": self.scale, "bias": self.bias})


def axis(low: float, high: float, count: int, placement: str) -> np.ndarray:
    """`count` nodes on [low, high] in one of the `PLACEMENTS`; one for a range of one value."""
    if low == high:
        return np.array([low])
    t = (np.arange(count) + 0.5) / count if placement == PLACEMENTS[0] else np.linspace(0, 1, count)
    return low + (high - low) * t


# --- whose table it is ---


def sources(
    target: Any,
    ranges: Mapping[str, tuple[float, float]],
    first: Callable[[float, float], float],
    reading: Reading | None = None,
    cos_theta: tuple[float, float] | None = None,
) -> tuple[Sources, tuple[float, float]]:
    """The families of a table, over its range from where there is a BRDF on; and the range.

    `target`: what `brdfcheck.check` takes; `reading`: how shader files are read; `first(low, high)`: where that is. Rows run
    over the parameter that has a range, in `ranges` or of itself; the others are held where `ranges` says, or at their
    defaults, an F0 at 1. Where a target has an alpha (or m) and no ``roughness``, this is its square root.
    UsageError where two parameters have ranges, and as `as_target` raises.
    """
    ranges = {name: interval(name, bounds) for name, bounds in ranges.items()}
    value, spec = named(target, {}, reading) if isinstance(target, str) else (target, "")
    if reading is not None:
        refuse_reading(reading, {spec: value})
    signature = signature_of(value)
    given = [name for name, (low, high) in ranges.items() if low < high]
    if len(given) > 1:
        raise UsageError(f"rows run over one parameter; {' and '.join(given)} have ranges: hold one, --over NAME=VALUE")
    inner = parameter = given[0] if given else ""
    bounds = ranges.get(parameter, (0.0, 0.0))
    asked = dict(ranges) if not given else {**ranges, parameter: (first(*bounds), bounds[1])}
    if ROUGHNESS in asked and ROUGHNESS not in signature.names and not signature.open:
        width = next((name for name in _WIDTHS if name in signature.names and name not in ranges), None)
        if width is not None:
            low, high = asked.pop(ROUGHNESS)
            if low < 0:
                raise UsageError(f"roughness must be >= 0; got {low:g}")
            asked[width] = low * low, high * high
            inner = width if given else ""
    f0: list[str] = []
    if not (inspect.isclass(value) and issubclass(value, AbstractBRDF)):  # ours have none by default, which is F = 1
        known = [name for name in signature.names if name.lower().partition(".")[0] == "f0"]
        f0 = [name for name in known if "." in name] or known
        if not any(name in asked for name in known):
            asked |= dict.fromkeys(f0, (1.0, 1.0))

    def family_at(number: float | None) -> Family:
        own = {} if number is None else dict.fromkeys(f0, (number, number))
        kept = {name: ends for name, ends in asked.items() if not own or name.lower().partition(".")[0] != "f0"}
        return _resolved(target, value, spec, {**kept, **own}, reading, cos_theta)

    family = family_at(None)
    if not given:
        free = [name for name, (low, high) in family.ranges.items() if low < high and name not in family.switches]
        if len(free) > 1:
            raise UsageError(f"{family.name} has the parameters {', '.join(free)}: say which rows run over, --over NAME=LO:HI")
        if free:
            inner = parameter = free[0]
            bounds = family.ranges[parameter]
    ends = first(*bounds), bounds[1]
    own = _over_one(family, parameter, ends, inner)
    mapping = f"{inner} = {parameter}^2" if inner != parameter else ""
    found = Sources(own, parameter or ROW, mapping=mapping, formula=formula_of(family))
    core: Any = core_of(own.build(**{found.parameter: ends[1]}))
    if isinstance(core, AbstractMicrofacetLobe) and "f0" in inspect.signature(type(core)).parameters:
        white, bias = (
            _over_one(family, parameter, ends, inner, lambda brdf, f0=f0: _with_schlick(brdf, f0)) for f0 in (None, 0.0)
        )
        return replace(found, white=own if getattr(core, "f0", None) is None else white, bias=bias), bounds
    if not f0 or inner in f0:
        why = f"{family.name} is no microfacet lobe of this package and has no parameter F0 of a Fresnel term by Schlick"
        return replace(found, why=why), bounds
    bias, half, white = (_over_one(family_at(number), parameter, ends, inner) for number in (0.0, 0.5, 1.0))
    given_f0 = [ends for name, ends in asked.items() if name.lower().partition(".")[0] == "f0"]
    is_white = all(ends == (1.0, 1.0) for ends in given_f0)
    return replace(found, white=own if is_white else white, bias=bias, half=half), bounds


def _resolved(
    target: Any,
    value: Any,
    spec: str,
    asked: dict[str, tuple[float, float]],
    reading: Reading | None,
    cos_theta: tuple[float, float] | None,
) -> Family:
    if isinstance(target, str) and not isinstance(value, Family):  # what a name stands for is loaded once
        found = family_of(value, spec, asked, cos_theta, reading if is_file_spec(spec) else None)
    else:
        found = as_target(target, asked, cos_theta, reading)
    if found.finding is not None:
        raise UsageError(found.finding)
    return found.family


def _over_one(
    family: Family,
    parameter: str,
    bounds: tuple[float, float],
    inner: str,
    changed: Callable[[Any], Any] = lambda brdf: brdf,
) -> Family:
    """A family over one parameter, which it calls `inner`, all others held; `changed`: what is made of each BRDF."""
    others = {name: family.defaults.get(name, low) for name, (low, _) in family.ranges.items() if name != inner}
    squared = inner != parameter
    running = [name for name, (low, high) in family.ranges.items() if low < high]
    silent = [f"{name} is held at {others[name]:g}" for name in running if name in others]

    def build(**own: Any) -> Any:
        (number,) = own.values()
        return changed(family.build(**others, **({inner: number * number if squared else number} if inner else {})))

    build.__name__ = getattr(family.build, "__name__", family.name)
    return replace(
        family,
        build=with_options_of(family.build, build),
        ranges={parameter or ROW: bounds},
        held={**family.held, **others},
        notes=(*family.notes, *silent),
        switches=frozenset(),
        pointwise=None,
    )


def _with_schlick(brdf: Any, f0: float | None) -> Any:
    """A BRDF made of facets with Schlick's Fresnel term at `f0`; None: with F = 1."""
    core = brdf.core
    fields = {name: getattr(core, name) for name in inspect.signature(type(core)).parameters}
    return brdf.with_core(type(core)(**{**fields, "f0": f0, "fresnel": "schlick"}))


# --- what is in it ---


def renderer_table(
    target: Any,
    ranges: Mapping[str, tuple[float, float]] | None = None,
    *,
    size: tuple[int, int] = (64, 64),
    placement: str = "centres",
    cos_theta: tuple[float, float] | None = None,
    rtol: float | None = None,
    reading: Reading | None = None,
    say: Say = lambda done, of: None,
) -> RendererTable:
    """The table of a target, `size` = (rows of the parameter, columns of cos theta).

    `target`, `ranges`, `reading`: as for `sources`, as in ``renderer_table("ggx", {"roughness": (0, 1)})``. `placement`: one of
    `PLACEMENTS`, for both axes. `rtol`: the accuracy aimed at, by default the best of a lobe's engine and 1e-6 for functions.
    `say`: called with how many rows of how many are done, where they are slow. RGB: the largest channel.

    Raises ValueError for what does not make a table: sizes below 2, an anisotropic target, an albedo that is not finite; and
    what `as_target` raises.
    """
    one_of(placement, PLACEMENTS, "placement")
    if len(size) != 2 or any(not isinstance(part, int) or part < 2 for part in size):
        raise ValueError(f"size must be two whole numbers >= 2, ROWSxCOLUMNS; got {size!r}")
    with double_precision():
        given = ranges or {}
        try:
            found, bounds = sources(target, given, lambda low, _: low, reading, cos_theta)
            exists = _exists_at_first(found.family)
        except ValueError:
            exists = False
        if not exists:  # facets of no roughness are none
            found, bounds = sources(
                target, given, lambda low, high: float(axis(low, high, size[0], placement)[0]), reading, cos_theta
            )
        family, low, high = found.family, *found.family.cos_theta
        nodes, mu = axis(bounds[0], bounds[1], size[0], placement), axis(low, high, size[1], placement)
        sampler = Sampler(family, rtol)
        engine, whole = sampler.albedo, (low, high) == (0.0, 1.0)
        rules = [averaging(count) for count in _AVERAGE[engine.effort > 1]] if whole else []
        columns = np.concatenate([mu, *(cosines for cosines, _ in rules)])
        steps = len(nodes) * (1 + (found.bias is not None) + (found.white not in (None, family)))
        begun = [0]

        def row() -> None:
            begun[0] += 1
            say(begun[0], steps)

        values, bars = cells(family, nodes, columns, rtol, row)
        words = "centres of texels" if placement == PLACEMENTS[0] else "ends included"
        rule = "t = (k + 1/2)/N" if placement == PLACEMENTS[0] else "t = k/(N - 1)"
        grid = sampler.grid(
            nodes, mu, values[:, : len(mu)], bars[:, : len(mu)],
            f"{words}: node k of N at {rule}; {found.parameter} = {bounds[0]:g} + t ({bounds[1]:g} - {bounds[0]:g});"
            f" cos_theta = {low:g} + t ({high:g} - {low:g})",
        )  # fmt: skip
        average = _average(values[:, len(mu) :], bars[:, len(mu) :], rules) if whole else None
        table = RendererTable(found, grid, bounds, placement, average, None, None, found.why)
        return _with_split_sum(table, rtol, row)


def _exists_at_first(family: Family) -> bool:
    """True where the albedo is a number at the beginning of the range, which may be in doubt where that is 0."""
    ((low, _),) = family.ranges.values()
    return low != 0 or bool(np.isfinite(Sampler(family, _FUNCTIONS).at(np.array([low]), np.array([0.5]))[0][0]))


def _with_split_sum(table: RendererTable, rtol: float | None, row: Callable[[], None]) -> RendererTable:
    found, grid = table.sources, table.grid
    if found.bias is None or found.white is None:
        return table
    white = grid.values, grid.errors
    if found.white is not found.family:
        white = cells(found.white, grid.nodes, grid.cos_theta, rtol, row)
    if found.half is not None:
        few = [np.unique(np.linspace(0, len(part) - 1, 4).astype(int)) for part in (grid.nodes, grid.cos_theta)]
        axes = grid.nodes[few[0]], grid.cos_theta[few[1]]
        between = cells(found.half, *axes, rtol, lambda: None)
        ends = cells(found.bias, *axes, rtol, lambda: None)
        own = [part[np.ix_(*few)] for part in white]
        off = np.abs(2 * between[0] - own[0] - ends[0]) / 2
        if np.any(off > between[1] + own[1] + ends[1] + 1e-9):
            words = f"its albedo is not linear in F0, as Schlick's Fresnel term makes it: off by {off.max():.2g} at F0 = 0.5"
            return replace(table, why=f"{found.family.name}: {words}")
    bias = cells(found.bias, grid.nodes, grid.cos_theta, rtol, row)
    return replace(table, scale=(white[0] - bias[0], white[1] + bias[1]), bias=bias)


def cells(
    family: Family, nodes: np.ndarray, mu: np.ndarray, rtol: float | None, row: Callable[[], None]
) -> tuple[np.ndarray, np.ndarray]:
    """Albedos and bars (nodes, mu): of lobes in one program on all cores, of functions a row at a time."""
    sampler = Sampler(family, rtol)
    if sampler.albedo.fast and nodes[0] >= 0:
        found = albedo_table(lambda value: family.build(**{sampler.parameter: value}), nodes, mu, rtol=rtol)
        value, error = np.asarray(found.value), np.asarray(found.error)
        if value.ndim > 2:
            flat = (part.reshape(-1, part.shape[-1]) for part in (value, np.broadcast_to(error, value.shape)))
            value, error = (part.reshape(len(nodes), len(mu)) for part in worst_channel(*flat)[:2])
        for _ in nodes:
            row()
    else:
        if rtol is None and not sampler.albedo.fast:
            sampler = Sampler(family, _FUNCTIONS)
        rows = []
        for node in nodes:
            rows.append(sampler(np.array([node]), mu))
            row()
        value, error = (np.concatenate(part) for part in zip(*rows, strict=True))
    for i, j in np.argwhere(~np.isfinite(value)):
        raise ValueError(f"the albedo of {family.name} is not finite at {sampler.parameter}={nodes[i]:g}, cos_theta={mu[j]:g}")
    return value, error


def average_albedo(family: Family, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """E_avg and its bars (nodes,) of a family of one parameter at these values."""
    rules = [averaging(count) for count in _AVERAGE[Sampler(family, None).albedo.effort > 1]]
    return _average(*cells(family, nodes, np.concatenate([mu for mu, _ in rules]), None, lambda: None), rules)


def _average(values: np.ndarray, bars: np.ndarray, rules: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    """From the values at the nodes of both rules, beside each other; the bar holds their difference and that of the values."""
    (_, weights), (_, few) = rules
    split = len(weights)
    fine, coarse = values[:, :split] @ weights, values[:, split:] @ few
    return fine, np.abs(fine - coarse) + bars[:, :split] @ weights
