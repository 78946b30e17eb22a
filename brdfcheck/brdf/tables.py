"""BRDFs that are known at samples only, as measured ones are: what they tell about themselves, and look-up in a grid."""

from __future__ import annotations

import abc
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from brdfcheck.brdf.base import AbstractBRDF

Bracket = list[tuple[Array, Array | None]]
"""The samples beside a place on an axis: (index, weight) each; the weight None stands for 1."""


@dataclass(frozen=True)
class Samples:
    """What a table rests on: `layout` in words; `missing` of the `count` samples that a light and a viewer above the surface
    can meet have no data, most of them `where`. `guess`: what such samples are in `AbstractTable.filled`. `channels`: what the
    channels are called, nothing for R, G and B.
    """

    layout: str
    count: int
    missing: int = 0
    where: str = ""
    guess: str = ""
    channels: tuple[str, ...] = ()

    def of(self, channels: Sequence[int]) -> Samples:
        """The same of some channels."""
        return replace(self, channels=tuple(self.channels[channel] for channel in channels) if self.channels else ())


class AbstractTable(AbstractBRDF):
    """A BRDF between samples: linear there, or (`nearest`) equal to the nearest of them. Samples without data count as 0.

    Which of the two is right nobody knows: their difference is the error bar of a value, and of an albedo. `values` has the
    channels last.
    """

    values: eqx.AbstractVar[Float[Array | np.ndarray, "entries channels"]]
    nearest: eqx.AbstractVar[bool]
    samples: eqx.AbstractVar[Samples]

    def by_nearest(self) -> Self:
        """The same table by the nearest sample."""
        return replace(self, nearest=True)

    def of_channels(self, channels: Sequence[int]) -> Self:
        """The table of some of its channels."""
        return replace(self, values=self.values[:, np.asarray(channels)], samples=self.samples.of(channels))

    @abc.abstractmethod
    def filled(self) -> Self | None:
        """The same table with a guess in place of samples without data; None where all have data."""


def table_in(brdf: Any) -> AbstractTable | None:
    """The table in a BRDF, perhaps with factors around it; None for what holds none."""
    tables = [part for part in jax.tree.leaves(brdf, is_leaf=_is_table) if _is_table(part)]
    return tables[0] if tables else None


def reread(brdf: Any, table: AbstractTable) -> Any:
    """The BRDF with another table in place of its own."""
    return jax.tree.map(lambda part: table if _is_table(part) else part, brdf, is_leaf=_is_table)


def _is_table(part: Any) -> bool:
    return isinstance(part, AbstractTable)


def bracket(place: Array, count: int, *, nearest: bool, periodic: bool = False) -> Bracket:
    """The samples beside `place`, where sample k of `count` lies at k; beyond the ends it is the last one that counts."""

    def kept(index: Array) -> Array:
        return index % count if periodic else jnp.clip(index, 0, count - 1)

    if nearest or count == 1:
        return [(kept(jnp.floor(place + 0.5).astype(int)), None)]
    # Clipped first: numbers beyond the integers have no meaning as integers.
    place = place if periodic else jnp.clip(place, 0, count - 1)
    low = jnp.floor(place)
    part = place - low
    index = low.astype(int)
    return [(kept(index), 1 - part), (kept(index + 1), part)]


def nodes_beside(place: Array, nodes: Array, *, nearest: bool) -> Bracket:
    """`bracket` for samples at rising `nodes`, wherever these lie."""
    count = len(nodes)
    if count == 1:
        return [(jnp.zeros_like(place, int), None)]
    high = jnp.clip(jnp.searchsorted(nodes, place, method="compare_all").astype(int), 1, count - 1)
    low = high - 1
    part = jnp.clip((place - nodes[low]) / (nodes[high] - nodes[low]), 0, 1)
    if nearest:
        return [(jnp.where(part < 0.5, low, high), None)]
    return [(low, 1 - part), (high, part)]


def looked_up(values: Any, shape: Sequence[int], brackets: Sequence[Bracket], dtype: Any) -> Array:
    """The multilinear look-up in `values`, (samples, channels) or (samples,), whose samples form a grid of `shape`.

    What is negative counts as 0. The result is of the type `dtype`, that of the weights.
    """
    values = jnp.asarray(values)
    total: Any = None
    for corner in product(*brackets):
        index: Any = 0
        weight: Any = None
        for (place, part), size in zip(corner, shape, strict=True):
            index = index * size + place
            if part is not None:
                weight = part if weight is None else weight * part
        found = jnp.maximum(values.at[index].get(mode="promise_in_bounds"), 0).astype(dtype)
        if weight is not None:
            found = found * (weight if values.ndim == 1 else weight[..., None])
        total = found if total is None else total + found
    return total
