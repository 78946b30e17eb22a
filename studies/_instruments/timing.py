"""What evaluating a formula costs: nanoseconds measured in a fused kernel."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from brdfcheck.cores import on_one_core

# Values that stay in the cache, and evaluations for each of them on one pass: of a lobe of two operations the kernel then
# measures the arithmetic, where a plain sum over 10^7 values would measure the memory.
_BLOCK = 16384
_UNROLLED = 8
# Seconds after which a function has been timed enough, once it had that many rounds.
_BUDGET = 0.5
_LEAST_ROUNDS = 5
_PARTS = 4


class Kernel(NamedTuple):
    """What `nanoseconds` times: a function of (values, *constants), elementwise, and the constants, traced numbers."""

    function: Callable[..., Any]
    constants: tuple[float, ...] = ()


class Time(NamedTuple):
    """Nanoseconds of one evaluation: of the fastest runs and of the median round, and the number of rounds."""

    best: float
    median: float
    rounds: int


def nanoseconds(kernels: Mapping[str, Kernel], evaluations: int, dtype: Any, *, rounds: int) -> dict[str, Time]:
    """The time of one evaluation of each function in `dtype`; slow ones have fewer rounds.

    The values fall evenly from 1 to a thousandth. Each function is fused into a loop that adds up its values on
    one core, and is compiled beforehand. A round takes the values in four parts, each timed by itself, and each function has
    its turn in it: so what else the machine does falls upon all of them alike, and the fastest run of each part counts.
    What the loop itself takes is included: pass the identity as a kernel to see it.
    """
    blocks = -(-evaluations // (_BLOCK * _UNROLLED * _PARTS))
    part = blocks * _BLOCK * _UNROLLED
    step = (1 - 1e-3) / (part * _PARTS)
    firsts = [jnp.asarray(1 - step * (start * part + np.arange(_BLOCK)), dtype) for start in range(_PARTS)]
    stride = jnp.asarray(step * _BLOCK, dtype)
    constants = {name: tuple(jnp.asarray(x, dtype) for x in kernel.constants) for name, kernel in kernels.items()}
    programs = {name: _program(kernel.function, blocks) for name, kernel in kernels.items()}
    for name, program in programs.items():
        program(firsts[0], stride, constants[name]).block_until_ready()
    taken: dict[str, list[list[float]]] = {name: [] for name in kernels}
    with on_one_core():
        for _ in range(rounds):
            for name, program in programs.items():
                if len(taken[name]) >= _LEAST_ROUNDS and np.sum(taken[name]) > _BUDGET:
                    continue
                times = []
                for first in firsts:
                    began = time.perf_counter()
                    program(first, stride, constants[name]).block_until_ready()
                    times.append(time.perf_counter() - began)
                taken[name].append(times)
    scale = 1e9 / (part * _PARTS)
    return {
        name: Time(scale * float(np.sum(np.min(t, 0))), scale * float(np.median(np.sum(t, 1))), len(t))
        for name, t in taken.items()
    }


def gain(kernel: Kernel, threads: int, evaluations: int, dtype: Any, *, rounds: int) -> float:
    """How much more of a function so many threads get done together than one by itself: the most that sharing out can give.

    Two cores that are one core's hyperthreads, or that others use, give less than 2.
    """
    blocks = -(-evaluations // (_BLOCK * _UNROLLED))
    program, constants = _program(kernel.function, blocks), tuple(jnp.asarray(x, dtype) for x in kernel.constants)
    first, stride = jnp.full(_BLOCK, 0.5, dtype), jnp.zeros((), dtype)

    def once(_: int = 0) -> None:
        program(first, stride, constants).block_until_ready()

    with ThreadPoolExecutor(threads) as pool:
        alone = fastest(once, rounds)
        return threads * alone / fastest(lambda: list(pool.map(once, range(threads))), rounds)


def fastest(job: Callable[[], object], rounds: int) -> float:
    """Seconds of the fastest round, after the two in which programs are compiled. `job` returns when all is done.

    A slow job has fewer rounds.
    """
    times: list[float] = []
    while len(times) < rounds + 2 and (len(times) < _LEAST_ROUNDS or sum(times[2:]) < _BUDGET):
        began = time.perf_counter()
        job()
        times.append(time.perf_counter() - began)
    return min(times[2:])


def _program(function: Callable[..., Any], blocks: int) -> Callable[..., Any]:
    def sum_of_all(first: Any, stride: Any, constants: tuple[Any, ...]) -> Any:
        def block(j: Any, sums: Any) -> Any:
            for i in range(_UNROLLED):
                sums = sums + function(first - stride * (j * _UNROLLED + i).astype(first.dtype), *constants)
            return sums

        return jnp.sum(jax.lax.fori_loop(0, blocks, block, jnp.zeros_like(first)))

    return jax.jit(sum_of_all)
