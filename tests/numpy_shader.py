"""An independent shader in plain vectorised numpy: vectors (..., 3), textbook formulas, nothing of the package.

Lights are dictionaries with the OpenGL names: `direction`, or `position` with attenuations and perhaps a spot.
"""

from __future__ import annotations

import numpy as np


def normalised(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def dots(a, b):
    return np.sum(a * b, axis=-1)


def positive(x):
    return np.maximum(x, 0)


def sphere(size, half_height=1.05, dtype=np.float64):
    """(hit, normals) of the unit sphere seen along -z; the normals of what is missed are the view."""
    height, width = size
    x = (np.arange(width) + 0.5 - width / 2) * 2 * half_height / height
    y = (height / 2 - np.arange(height) - 0.5) * 2 * half_height / height
    x, y = np.meshgrid(x.astype(dtype), y.astype(dtype))
    square = 1 - x**2 - y**2
    hit = square > 0
    normals = np.stack([x, y, np.sqrt(positive(square))], axis=-1)
    return hit, np.where(hit[..., None], normals, np.array([0, 0, 1], dtype))


def light_at(light, points):
    """(direction to the light, irradiance (..., 3)) at the points."""
    dtype = points.dtype
    color = np.broadcast_to(np.asarray(light.get("intensity", 1.0), dtype), (3,))
    if "direction" in light:
        return np.broadcast_to(normalised(np.asarray(light["direction"], dtype)), points.shape), np.ones_like(points) * color
    way = np.asarray(light["position"], dtype) - points
    d = np.linalg.norm(way, axis=-1, keepdims=True)
    fall = 1 / (light.get("constant", 1) + light.get("linear", 0) * d + light.get("quadratic", 0) * d**2)
    if light.get("cutoff", 180) < 180:
        axis = normalised(np.asarray(light["spot_direction"], dtype))
        cosine = -dots(way / d, axis)[..., None]
        cone = cosine >= np.cos(np.radians(light["cutoff"]))
        fall = fall * np.where(cone & (cosine > 0), positive(cosine) ** light.get("exponent", 0), 0)
    return way / d, (fall * color).astype(dtype)


def surface(normals, points, view, lights, kd, ks, n, factor):
    """Lambert kd plus Blinn-Phong ks with its factor: reflected radiance (..., 3)."""
    total = np.zeros_like(normals)
    kd, ks = (np.asarray(k, normals.dtype) for k in (kd, ks))
    for light in lights:
        direction, irradiance = light_at(light, points)
        half = normalised(direction + view)
        cosine = positive(dots(normals, direction))[..., None]
        power = positive(dots(normals, half))[..., None] ** normals.dtype.type(n)
        total += irradiance * cosine * (kd / normals.dtype.type(np.pi) + ks * normals.dtype.type(factor) * power)
    return total


def mirrored(normals, direction):
    return 2 * dots(normals, direction)[..., None] * normals - direction


def highlight(normals, points, view, lights, base, d, w, n, behind=None, t_h=1.0, t_p=0.0):
    """(4), or (6) and (8) where there is something behind."""
    shares = [light_at(light, points) for light in lights]
    lit = sum(positive(dots(normals, direction))[..., None] * a for direction, a in shares)
    color = (d + (1 - d) * lit) * np.asarray(base)
    if behind is not None:
        t = (t_h * (1 - np.clip(dots(normals, view), 0, 1)) ** t_p)[..., None]
        color = (1 - t) * np.asarray(behind) + t * color
    for direction, a in shares:
        power = positive(dots(mirrored(normals, direction), view))[..., None] ** n
        color = color + w * a * power * (1 - color)
    return color


def metal(normals, points, view, lights, base, d, lobes, form):
    """(12), (15) or (16), `lobes` a list of pairs for each light."""
    total = np.full_like(normals, d)
    for light, pairs in zip(lights, lobes, strict=True):
        direction, a = light_at(light, points)
        half = normalised(direction + view)
        nh, nv, nl = (dots(normals, other) for other in (half, view, direction))
        if form == "facets":
            angle = np.arccos(np.clip(nh, -1, 1))
            density = sum(w * np.exp(-((np.tan(angle) / m) ** 2)) / (m**2 * np.cos(angle) ** 4) for w, m in pairs)
            vh = dots(view, half)
            masked = positive(np.minimum(1, np.minimum(2 * nh * nv / vh, 2 * nh * nl / vh)))
            value = density * masked / nv
        elif form == "half":
            value = sum(w * positive(nh) ** n for w, n in pairs)
        else:
            value = sum(w * positive(dots(mirrored(normals, direction), view)) ** n for w, n in pairs)
        total += a * value[..., None]
    return total * np.asarray(base)


def polygon_irradiance(vertices, point, normal, count=400):
    """The irradiance by a parallelogram of radiance 1, by brute force: midpoints, none below the horizon."""
    a, b, c = (np.asarray(vertices[i], float) for i in (0, 1, 3))
    s = (np.arange(count) + 0.5) / count
    u, v = np.meshgrid(s, s)
    spots = a + u[..., None] * (b - a) + v[..., None] * (c - a)
    area = np.cross(b - a, c - a) / count**2
    way = spots - point
    square = dots(way, way)
    return np.sum(positive(dots(way, np.asarray(normal))) * np.abs(dots(way, area)) / square**2)


def tight_sphere(size, lights, kd, ks, n, factor, half_height=1.05):
    """The image (3, height, width) of `surface` on the unit sphere under distant lights as fast as numpy does it, in float32.

    View and lights are the same in all pixels, so half vectors are too: all N.L and N.H are one matrix product and all
    colours another, nothing is normalised in a pixel, and the power is exp(n log x). The background is black.
    """
    height, width = size
    x = ((np.arange(width, dtype=np.float32) + 0.5 - width / 2) * 2 * half_height / height).astype(np.float32)
    y = ((height / 2 - 0.5 - np.arange(height, dtype=np.float32)) * 2 * half_height / height).astype(np.float32)
    square = 1 - x**2 - y[:, None] ** 2
    normals = np.empty((3, *size), np.float32)
    normals[0], normals[1], normals[2] = x, y[:, None], np.sqrt(positive(square))
    directions = np.stack([normalised(np.asarray(light["direction"], np.float32)) for light in lights])
    halves = normalised(directions + np.array([0, 0, 1], np.float32))
    terms = np.concatenate([directions, halves]) @ normals.reshape(3, -1)
    count = len(lights)
    np.maximum(terms, np.float32(1e-30), out=terms)
    terms[:count] *= (square > 0).ravel()
    terms[count:] = np.exp(np.float32(n) * np.log(terms[count:])) * terms[:count]
    colors = np.stack([np.broadcast_to(np.asarray(light["intensity"], np.float32), (3,)) for light in lights], axis=1)
    matt = colors * (np.asarray(kd, np.float32) / np.float32(np.pi))[:, None]
    return (np.concatenate([matt, colors * np.float32(ks * factor)], axis=1) @ terms).reshape(3, *size)
