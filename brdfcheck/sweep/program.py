"""What computes the cells of a sweep: for each combination of its static values a BRDF, but for its numbers, and a rule."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.base import AbstractBRDF, AbstractZonalLobe, of_type
from brdfcheck.brdf.blame import Finding
from brdfcheck.brdf.callables import Evaluator
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.tables import table_in
from brdfcheck.brdf.ways import Caller
from brdfcheck.messages import UsageError, one_line
from brdfcheck.quadrature.functions import Adaptive
from brdfcheck.quadrature.pointwise import TABULATED, PointwiseAlbedo
from brdfcheck.quadrature.registry import RULES, engine_of
from brdfcheck.quadrature.rule import AbstractEngine, AbstractRule
from brdfcheck.runtime import double_precision
from brdfcheck.sweep import subjects
from brdfcheck.sweep.config import ANGLES, CHOICES, Axis, Config
from brdfcheck.sweep.subjects import Source

DEFAULT = "default"
"""The rule that is the engine of the BRDF."""
CELL = "cell index"
"""The name under which a cell's function is given its number: where rules that draw at random begin."""
# Parts of the exponents up to which tables are made: each is compiled apart.
_PARTS = 16


class Program:
    """The cells of one combination of static values: one by one by `rule`, or all of a chunk as a `table`.

    `place`: the indices of the static values, `settings`: these by axis; `axes`: those of numbers. ``build(**numbers)`` makes
    one BRDF; `template` is the structure of its lobe, None for functions, which have no engine of their own. `dtype`: the
    precision; `tabulated`: whether the BRDF is known at samples only. UsageError where there is no such BRDF or rule, or they
    do not fit together.

    `cells`: of a chunk where the configuration says nothing, at least and at most; a killed sweep loses some seconds of work.
    `sample`: cells looked at to estimate a chunk's time, None for all. `batch`: cells computed together.
    """

    def __init__(
        self, config: Config, source: Source, place: tuple[int, ...], settings: Mapping[str, Any], axes: Mapping[str, Axis]
    ):
        self.config, self.place, self.settings, self.axes = config, place, settings, axes
        self.dtype = np.dtype(settings["precision"])
        self._values = {name: axis.values for name, axis in axes.items() if name not in ANGLES}
        static = {name: value for name, value in settings.items() if name not in CHOICES}
        try:
            self.build, self.template = subjects.subject(
                source, static, {name: (float(values.min()), float(values.max())) for name, values in self._values.items()}
            )
        except UsageError as error:
            raise config.fail("axes", str(error)) from None
        with double_precision():
            example = self.build(**{name: float(values[0]) for name, values in self._values.items()})
        table = table_in(example)
        self.tabulated = not self._values and table is not None
        self._is_function = not isinstance(example, AbstractBRDF)
        try:
            self.rule = rule_of(settings["rule"], settings.get("rtol", None if table is None else TABULATED), self.template)
        except ValueError as error:
            raise config.fail("rule", str(error)) from None
        if not self.rule.on_host and not self.rule.takes(example):
            text = f"{settings['brdf']} does not fit the rule {settings['rule']!r}, which needs {self.rule.needs}"
            raise config.fail("rule", text)
        self.table = self._makes_a_table()
        self.cells, self.sample, self.batch = self._costs()

    def _makes_a_table(self) -> bool:
        """Lobes over exponents and cosines alone, by their own engine."""
        swept = [name for name, axis in self.axes.items() if not axis.held and name != "cos_theta"]
        if not isinstance(self.template, AbstractZonalLobe) or swept != ["n"]:
            return False
        # Not for chunks that the configuration wants to be slivers: each part of the exponents would be compiled apart.
        count = len(self.axes["n"])
        few = count <= _PARTS * self.config.chunks.get("n", count)
        return few and self.rule == engine_of(self.template).at(self.settings.get("rtol"))

    def _costs(self) -> tuple[tuple[int, int], int | None, int]:
        """`cells`, `sample` and `batch`; cells take nanoseconds, up to a second, microseconds, or milliseconds."""
        if self.table:
            return (20_000, 250_000), None, 1
        if self.rule.on_host:
            return (1, 32), 3, 1
        if isinstance(self.rule, AbstractEngine) and self.rule.batch > 1:
            return (1_000, 20_000), 512, self.rule.batch
        return (32, 512), 4, 1  # rules bound their memory themselves, for one cell

    def channels(self) -> int | None:
        """How many channels the BRDF has; None where it gives one number. UsageError where it cannot be evaluated."""
        if self.rule.on_host:
            return self.evaluator().channels
        with double_precision():
            shapes: dict[str, Any] = {name: jax.ShapeDtypeStruct((), self.dtype) for name in self.axes}
            shapes[CELL] = jax.ShapeDtypeStruct((), np.int64)
            try:
                shape = jax.eval_shape(self.cell(), shapes).value.shape
            except Exception as error:
                text = f"{self.settings['brdf']} cannot be traced by JAX, which the rule {self.settings['rule']!r} needs"
                raise self.config.fail("rule", f"{text} ({type(error).__name__}: {one_line(error)})") from None
        return shape[0] if shape else None

    def cell(self) -> Callable[[dict[str, Any]], Any]:
        """A function of a cell's numbers, by axis and `CELL`, that gives the `Estimate` of the rule."""
        caller = self._caller if self._is_function else None

        def cell(numbers: dict[str, Any]) -> Any:
            brdf = self.build(**{name: numbers[name] for name in self._values})
            if isinstance(brdf, AbstractBRDF):
                brdf = of_type(brdf, self.dtype)
            elif caller is not None:
                brdf = caller.brdf([numbers[name] for name in self._values])
                brdf = _turned(brdf, numbers["azimuth"]) if "azimuth" in numbers else brdf
            key = jax.random.key(self.config.seed)
            for part in (numbers[CELL] >> 32, numbers[CELL] & 0xFFFFFFFF):
                key = jax.random.fold_in(key, part.astype(jnp.uint32))
            return self.rule(brdf, numbers["cos_theta"], key=key if self.rule.random else None)

        return cell

    def evaluator(self) -> Evaluator:
        """The BRDF as the adaptive rule sees it. UsageError where it cannot be evaluated."""
        return self._called(Evaluator)

    @functools.cached_property
    def _caller(self) -> Caller:
        """How the functions are called: with arrays of directions, or one pair at a time."""
        return self._called(Caller)

    def _called(self, kind: Any) -> Any:
        middle = {name: float(values.min() + values.max()) / 2 for name, values in self._values.items()}
        try:
            with double_precision():
                return kind(self.build, middle)
        except Finding as error:
            raise self.config.fail("brdf", one_line(error)) from error

    def samples(self) -> PointwiseAlbedo:
        """What is `tabulated`, for its error bars."""
        return PointwiseAlbedo(Family(self.settings["brdf"], self.build))


def rule_of(text: str, rtol: float | None, template: Any) -> AbstractRule:
    """The rule behind "default", "name" or "name:setting". ValueError where there is none, or not with that setting.

    `rtol`: what the default aims at; `template`: of the BRDF, whose lobe has an engine or is a function.
    """
    name, colon, setting = text.partition(":")
    if text == DEFAULT:
        return (Adaptive if template is None else engine_of(template)).at(rtol)
    if name not in RULES:
        raise ValueError(f"unknown rule {name!r}; allowed: {DEFAULT}, {', '.join(RULES)}")
    kind: Any = RULES[name]
    try:
        return kind(type(kind.ladder[0])(setting)) if colon else kind()
    except (TypeError, ValueError) as error:
        example = f"{name}:{kind.ladder[-1]:g}"
        raise ValueError(f"the setting of {text!r}: {one_line(error)}; as in {example!r}") from None


def _turned(brdf: Callable[..., Any], azimuth: Any) -> Callable[..., Any]:
    """A function f(wi, wo) on a surface that is turned, so that what comes from azimuth 0 comes from `azimuth`."""

    def at(direction: Any) -> Any:
        x, y, z = (direction[..., i] for i in range(3))
        return jnp.stack([x * jnp.cos(azimuth) - y * jnp.sin(azimuth), x * jnp.sin(azimuth) + y * jnp.cos(azimuth), z], axis=-1)

    return lambda wi, wo: brdf(at(wi), at(wo))
