"""Speed against accuracy: what a rule costs and how wrong it is, measured against a reference from elsewhere.

A measurement knows nothing of plots, and the reference is handed in: it is never made by a contender.
"""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from _instruments.peers import AbstractPeer
from brdfcheck.cores import on_one_core
from brdfcheck.quadrature.rule import MESSAGES, AbstractRule, RuleKind

# Albedos of a batch, and the evaluations of one beside which the cost of a call is nothing.
BATCH, _MANY = 64, 2**15
# Budgets after which a peer that compiles nothing is not run a second time.
_MUCH = 10
_RUNS = 5


@dataclass(frozen=True)
class Case:
    """An integral to be done: a BRDF, an incidence, and its albedo from an independent method.

    `parameter` is the lobe's exponent or slope, for the record; the numbers of the BRDF set the precision.
    """

    name: str
    lobe: str
    brdf: Any
    parameter: float
    cos_theta: float
    reference: float

    @property
    def dtype(self) -> np.dtype:
        """The precision of the BRDF's numbers."""
        return np.result_type(*(leaf.dtype for leaf in jax.tree.leaves(eqx.filter(self.brdf, eqx.is_array))))


def single(case: Case) -> Case:
    """The same case in float32."""
    narrow = jax.tree.map(lambda leaf: leaf.astype(jnp.float32) if eqx.is_array(leaf) else leaf, case.brdf)
    return dataclasses.replace(case, name=f"{case.name}, float32", brdf=narrow)


def measure(rule: AbstractRule, case: Case, *, repeats: int = 5, budget: float = 2.0) -> dict[str, Any]:
    """Run a rule on a case. `repeats`: of the timing; a rule with chance in it runs `_RUNS` times, with other keys.

    No more repeats are begun once `budget` seconds are spent, but one always is: `warm_seconds` never holds what the first
    call compiles. A peer that compiles nothing and took ten times the budget is not run again. Errors of the rule pass through.

    A record: ``error`` is |value - reference| / reference; of a rule with chance in it, that of the middle one of its runs.
    ``claimed`` is what the rule says of itself, also relative (NaN where it says nothing). ``evaluations`` of the BRDF for one
    albedo. Seconds: ``warm``, the fastest repeat, on one core; ``batched``, of each of `BATCH` in one call, the fastest of
    three, where the rule is a program and evaluates so little that the call counts, else the same; ``compile``, what the first
    call, on all cores, took beyond ``warm``. ``parameter`` is the exponent n, or the slope m of a microfacet lobe.
    """
    mu = jnp.asarray(case.cos_theta, case.dtype)
    cosines = jnp.full(BATCH, mu)

    def program(seed: int) -> Callable[[Any], Any]:
        key = jax.random.key(seed) if rule.random else None
        if rule.on_host:
            return lambda count: rule(case.brdf, mu, key=key)
        # Each albedo of a batch has its own samples; the first is that of a call by itself.
        keys = None if key is None else jnp.concatenate([key[None], jax.random.split(key, BATCH - 1)])
        return lambda count: _call(rule, case.brdf, cosines, keys, count)

    run = program(0)
    first, answer = _timed(run)
    warm, spent = math.inf, 0.0
    # Rules on the host are timed a second time, once: some compile too, and what the first call took must not pass for the time
    # of an albedo. Where a peer that compiles nothing took very long, that was it.
    repeats = 1 if rule.on_host else max(repeats, 1)
    if isinstance(rule, AbstractPeer) and not rule.compiles and first > _MUCH * budget:
        warm, repeats = first, 0
    with on_one_core():
        for _ in range(repeats):
            seconds, answer = _timed(run)
            warm, spent = min(warm, seconds), spent + seconds
            if spent > budget:
                break
        batched = warm
        if not rule.on_host and int(answer.evaluations) < _MANY:
            batched = min(_timed(run, BATCH)[0] for _ in range(3)) / BATCH
    answers = [answer, *(_timed(program(seed))[1] for seed in range(1, _RUNS if rule.random else 1))]
    values = np.array([float(part.value) for part in answers])
    errors = np.abs(values - case.reference) / abs(case.reference)
    middle = int(np.argsort(np.where(np.isnan(errors), np.inf, errors))[len(errors) // 2])
    chosen = answers[middle]
    claimed = float(chosen.error) / abs(case.reference)
    seconds = {"warm": warm, "batched": batched, "compile": max(first - warm, 0.0)}
    return {
        "case": case.name,
        "rule": rule.name,
        "family": rule.family,
        "setting": rule.setting,
        "lobe": case.lobe,
        "parameter": case.parameter,
        "cos_theta": case.cos_theta,
        "value": float(values[middle]),
        "reference": case.reference,
        "error": float(errors[middle]),
        "claimed": claimed if math.isfinite(claimed) else math.nan,
        "evaluations": int(chosen.evaluations),
        **{f"{name}_seconds": float(f"{value:.4g}") for name, value in seconds.items()},
        "status": MESSAGES[int(chosen.status)],
        "dtype": str(case.dtype),
        "device": f"{jax.devices()[0].platform} {jax.devices()[0].device_kind}",
    }


@eqx.filter_jit
def _call(rule: AbstractRule, brdf: Any, cosines: Any, keys: Any, count: Any) -> Any:
    """The albedo at the first `count` cosines, one after another, and the answer at the last of them.

    One program for a call by itself and for a batch, as compiling takes longer than running.
    """

    def once(number: Any, _: Any = None) -> Any:
        return rule(brdf, cosines[number], key=None if keys is None else keys[number])

    nothing = jax.tree.map(lambda part: jnp.zeros(part.shape, part.dtype), jax.eval_shape(once, 0))
    return jax.lax.fori_loop(0, count, once, nothing)


def _timed(program: Callable[..., Any], count: int = 1) -> tuple[float, Any]:
    turns = jnp.asarray(count)
    began = time.perf_counter()
    answer = jax.block_until_ready(program(turns))
    return time.perf_counter() - began, answer


def measure_all(
    rules: Iterable[RuleKind], case: Case, *, most_seconds: float = 1.0, settings: int | None = None
) -> list[dict[str, Any]]:
    """Every rule that takes the case, through its ladder of settings until one albedo takes longer than `most_seconds`.

    `settings`: only so many of each ladder, evenly. A setting that raises ends its ladder.
    """
    found = []
    for constructor in rules:
        ladder: Sequence[Any] = constructor.ladder
        if settings is not None and len(ladder) > settings:
            ladder = [ladder[round(place)] for place in np.linspace(0, len(ladder) - 1, settings)]
        for setting in ladder:
            rule = constructor(setting)
            if not rule.takes(case.brdf, jnp.asarray(case.cos_theta)):
                break
            try:
                point = measure(rule, case, repeats=3, budget=most_seconds)
            except ValueError:  # more than a peer takes on this machine
                break
            found.append(point)
            if point["warm_seconds"] > most_seconds:
                break
    return found
