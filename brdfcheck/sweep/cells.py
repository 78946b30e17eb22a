"""One cell of a sweep as a function of its numbers: what the chunks' programs are made of, and how many channels it has."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.brdf.base import AbstractBRDF
from brdfcheck.brdf.callables import Evaluator, Finding
from brdfcheck.brdf.factors import peel
from brdfcheck.messages import one_line
from brdfcheck.quadrature.registry import engine_of
from brdfcheck.runtime import double_precision
from brdfcheck.sweep.config import ANGLES
from brdfcheck.sweep.subjects import of_type

if TYPE_CHECKING:  # a plan asks for the channels of its cells while it is made
    from brdfcheck.sweep.plan import Plan

CELL = "cell index"
"""The name under which a rule that draws at random is given the number of its cell."""


def evaluator(plan: Plan, combination: tuple[int, ...]) -> Evaluator:
    """Engine 3's view of the BRDF at these static parameters. UsageError where it cannot be evaluated."""
    subject, middle = plan.subject(combination), {}
    for name in plan.numeric:
        if name not in ANGLES:
            values = plan.values(name)
            middle[name] = float(values.min() + values.max()) / 2
    try:
        with double_precision():
            return Evaluator(_named(subject.build, subject.name), middle)
    except Finding as error:
        raise plan.config.fail("brdf", one_line(error)) from None


def channels(plan: Plan, combination: tuple[int, ...]) -> int | None:
    """How many channels the BRDF has at these static parameters; None where it gives one number."""
    with double_precision():
        if plan.engine(combination) != "adaptive":
            numbers = [name for name in plan.numeric if name != "azimuth"]
            function = of_cell(plan, combination)
            shapes = {name: jax.ShapeDtypeStruct((), dtype_of(plan, combination)) for name in numbers}
            if plan.engine(combination) == "rule":
                shapes[CELL] = jax.ShapeDtypeStruct((), np.int64)
            try:
                shape = jax.eval_shape(lambda numbers: function(numbers)[0], shapes).shape
            except Exception as error:
                settings = plan.settings(combination)
                if plan.engine(combination) != "rule":
                    raise
                text = f"{settings['brdf']} cannot be traced by JAX, which the rule {settings['rule']!r} needs"
                raise plan.config.fail("rule", f"{text} ({type(error).__name__})") from None
        else:
            wi = np.array([[0.6, 0.0, 0.8]])
            values = {name: float(plan.values(name)[0]) for name in plan.numeric if name not in ANGLES}
            try:
                shape = evaluator(plan, combination).bind(values)(wi, wi).shape[1:]
            except Finding as error:
                raise plan.config.fail("brdf", one_line(error)) from None
    return shape[0] if shape else None


def _named(build: Callable[..., Any], name: str) -> Callable[..., Any]:
    def built(**numbers: Any) -> Any:
        return build(**numbers)

    built.__name__ = name
    return built


def dtype_of(plan: Plan, combination: tuple[int, ...]) -> np.dtype:
    """The precision of the cells at these static parameters."""
    return np.dtype(plan.settings(combination)["precision"])


def of_cell(plan: Plan, combination: tuple[int, ...]) -> Callable:
    """A function of a cell's numbers, by axis, that gives (albedo, error, evaluations), by the engine of these parameters."""
    subject, settings = plan.subject(combination), plan.settings(combination)
    dtype, rtol = dtype_of(plan, combination), settings.get("rtol")

    if plan.engine(combination) == "rule":
        return _by_rule(plan, combination)

    def cell(numbers: dict[str, Any]) -> tuple[Any, Any, Any]:
        parameters = {name: value for name, value in numbers.items() if name not in ANGLES}
        mu = numbers["cos_theta"]
        core, scale = peel(of_type(subject.build(**parameters), dtype))
        found = engine_of(core).at(rtol).integrate(core, mu)
        factor = scale(mu)
        return found.value * factor, found.error * jnp.abs(factor), jnp.asarray(found.evaluations)

    return cell


def _by_rule(plan: Plan, combination: tuple[int, ...]) -> Callable:
    subject, dtype = plan.subject(combination), dtype_of(plan, combination)
    rule = plan.rule(plan.settings(combination)["rule"])

    def cell(numbers: dict[str, Any]) -> tuple[Any, Any, Any]:
        parameters = {name: value for name, value in numbers.items() if name not in (*ANGLES, CELL)}
        brdf = subject.build(**parameters)
        index = numbers[CELL]
        key = jax.random.key(plan.config.seed)
        for part in (index >> 32, index & 0xFFFFFFFF):
            key = jax.random.fold_in(key, part.astype(jnp.uint32))
        brdf = of_type(brdf, dtype) if isinstance(brdf, AbstractBRDF) else brdf
        found = rule(brdf, numbers["cos_theta"], key=key if rule.random else None)
        return found.value, found.error, found.evaluations

    return cell
