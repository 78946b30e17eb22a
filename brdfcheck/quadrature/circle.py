r"""Boxes cut along the circle of the directions that are as high as the light, where max(N.L, N.V) has its kink.

Across a kink a product rule gains little by smaller boxes: an albedo of Oren-Nayar's to 4e-10 takes 3 million evaluations,
and 80,000 where no box is crossed. The circle leaves the seeds of the light and of the mirror direction across the plane of
incidence and meets b = theta above the normal; with the elevation e in the plane (sin e = cos t) it is

    sin e cos b = sin h,  h the elevation of the light.

A box that it crosses is cut along it. A piece is *bent*: one of its coordinates runs from a straight edge of the box (0) to the
circle (1). So nodes and probes lie close to the circle wherever it runs: what is narrow there is seen, such as the ring in wo
that a reciprocal BRDF has for each angle at which it is high, and the strip between the circle of grazing light and the
horizon.
"""

from __future__ import annotations

import numpy as np

# Of a box's sides: the length of circle inside it that is worth a cut.
_WORTH = 1e-4


def _of_light(cosine: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sine of the polar angle and elevation of the light."""
    sine = np.sqrt((1 - cosine) * (1 + cosine))
    return sine, np.arctan2(cosine, sine)


def _elevation(sine: np.ndarray, cosine: np.ndarray, across: np.ndarray) -> np.ndarray:
    """How much higher than the light the circle stands in the plane at the angle `across` (b): theta from b = theta on."""
    y = np.minimum(np.sin(across), sine)
    root = np.sqrt((sine - y) * (sine + y))
    return np.arctan2(cosine * y * y, (sine + root) * (sine * root + cosine * cosine))


def _reach(sine: np.ndarray, cosine: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    """The angle b at which the circle stands at an elevation in the plane; 0 for those below the light's."""
    above = np.sin(elevation - np.arctan2(cosine, sine)) * np.sin(elevation + np.arctan2(cosine, sine))
    return np.arctan2(np.sqrt(np.maximum(above, 0)), cosine)


def along(patch: np.ndarray, across: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of boxes that are bent along the plane: the edge (boxes, 1), and how far from it the circle is at angles across it."""
    height, rise, edge, cosine = (patch[:, i, None] for i in (1, 2, 7, 8))
    sine, light = _of_light(cosine)
    return edge, rise * (light - height + _elevation(sine, cosine, across)) - edge


def across(patch: np.ndarray, along: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same of boxes that are bent across it, at offsets along it."""
    height, rise, edge, cosine = (patch[:, i, None] for i in (1, 2, 7, 8))
    sine, _ = _of_light(cosine)
    return edge, _reach(sine, cosine, height + rise * along) - edge


def beside(patch: np.ndarray, radius: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same of triangles, at distances from their apex: in v."""
    edge, cosine = patch[:, 7, None], patch[:, 8, None]
    sine, _ = _of_light(cosine)
    return edge, np.sqrt(_elevation(sine, cosine, radius) / radius) - edge


def crossed(low: np.ndarray, size: np.ndarray, patch: np.ndarray) -> np.ndarray:
    """True for boxes, none of them bent, that the circle crosses."""
    height, rise, kind, cosine = (patch[:, i] for i in (1, 2, 4, 8))
    start, end, bottom, top = _inside(low, size, patch)
    plain = (kind == 0) & (start < end) & (bottom < top)
    plain &= (end - start) / size[:, 0] + (top - bottom) / size[:, 1] > _WORTH
    # The triangles beside the light and the mirror direction, on the side of the normal: crossed from end to end.
    return plain | ((kind == 2) & (height == _of_light(cosine)[1]) & (rise > 0))


def _inside(low: np.ndarray, size: np.ndarray, patch: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Between which elevations, start and end, and which angles across, bottom and top, the circle runs in plain boxes."""
    height, rise, cosine = patch[:, 1], patch[:, 2], patch[:, 8]
    sine, light = _of_light(cosine)
    high = low + size
    first, last = np.sort(height + rise * np.stack([low[:, 0], high[:, 0]]), axis=0)
    start = np.maximum(first, light + _elevation(sine, cosine, low[:, 1]))
    end = np.minimum(last, light + _elevation(sine, cosine, high[:, 1]))
    bottom, top = (np.clip(_reach(sine, cosine, e), low[:, 1], high[:, 1]) for e in (start, end))
    return start, end, bottom, top


def cut(low: np.ndarray, size: np.ndarray, patch: np.ndarray) -> np.ndarray:
    """The pieces of boxes that are all `crossed`: a row of low (2), size (2) and patch for each."""
    ends = np.stack(_inside(low, size, patch), axis=1)
    sides = np.clip(np.sort(patch[:, 2:3] * (ends[:, :2] - patch[:, 1:2]), axis=1), low[:, :1], (low + size)[:, :1])
    rows: list[tuple[float, ...]] = []
    for (a0, b0), (a1, b1), (start, end, bottom, top), (left, right), part in zip(
        *(column.tolist() for column in (low, low + size, ends, sides, patch)), strict=True
    ):

        def piece(first: tuple[float, float], second: tuple[float, float], bend: int = 0, edge: float = 0.0, part=part) -> None:
            rows.append((first[0], second[0], first[1] - first[0], second[1] - second[0], *part[:6], bend, edge, part[8]))

        if part[4] == 2:
            piece((a0, a1), (0, 1), 2, 0.0)
            piece((a0, a1), (0, 1), -2, 1.0)
        elif end - start < top - bottom:
            for pair in ((b0, bottom), (top, b1)):
                if pair[0] < pair[1]:
                    piece((a0, a1), pair)
            piece((0, 1), (bottom, top), 1, a0)
            piece((0, 1), (bottom, top), -1, a1)
        else:
            for pair in ((a0, left), (right, a1)):
                if pair[0] < pair[1]:
                    piece(pair, (b0, b1))
            piece((left, right), (0, 1), 2, b0)
            piece((left, right), (0, 1), -2, b1)
    return np.array(rows).reshape(-1, 4 + patch.shape[1])
