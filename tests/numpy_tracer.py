"""An independent ray tracer in plain Python and numpy: one ray at a time, by recursion, with a tolerance at the start.

Bodies are dicts: center and radius, or point and normal; then color, mirror, transparency, index. Lights are dicts:
direction or position, and power (irradiance at distance 1 for a position, falling with its square). Matt surfaces only.
"""

from __future__ import annotations

import numpy as np

START = 1e-9


def meet(body, origin, travel):
    """(distance, outward normal) of the first point of the body past the start; (inf, None) for none."""
    if "center" in body:
        a, b = origin - body["center"], travel
        roots = np.roots([b @ b, 2 * a @ b, a @ a - body["radius"] ** 2])
        found = [root.real for root in roots if abs(root.imag) < 1e-12 and root.real > START]
        if not found:
            return np.inf, None
        distance = min(found)
        return distance, (origin + distance * travel - body["center"]) / body["radius"]
    normal = body["normal"] / np.linalg.norm(body["normal"])
    if travel @ normal == 0:
        return np.inf, None
    distance = (body["point"] - origin) @ normal / (travel @ normal)
    return (distance, normal) if distance > START else (np.inf, None)


def nearest(bodies, origin, travel):
    hits = [meet(body, origin, travel) for body in bodies]
    number = int(np.argmin([hit[0] for hit in hits]))
    return number, *hits[number]


def fresnel(cos_near, near, far):
    """From the two polarisations, with Snell's law by angles; 1 for total reflection."""
    sine = near / far * np.sqrt(1 - cos_near**2)
    if sine >= 1:
        return 1.0, None
    cos_far = np.cos(np.arcsin(sine))
    across = (near * cos_near - far * cos_far) / (near * cos_near + far * cos_far)
    along = (far * cos_near - near * cos_far) / (far * cos_near + near * cos_far)
    return (across**2 + along**2) / 2, cos_far


def radiance(bodies, lights, origin, travel, depth, background, shadows=True):
    number, distance, normal = nearest(bodies, origin, travel)
    if normal is None:
        return np.array(background, float) * np.ones(3)
    body, point = bodies[number], origin + distance * travel
    inside = normal @ travel > 0
    facing = -normal if inside else normal
    mirror, glass = (np.ones(3) * body.get(name, 0) for name in ("mirror", "transparency"))
    total = np.zeros(3)
    for light in lights:
        way = light["direction"] if "direction" in light else light["position"] - point
        reach = np.inf if "direction" in light else np.linalg.norm(way)
        towards = way / np.linalg.norm(way)
        power = light["power"] / (1 if "direction" in light else reach**2)
        if shadows:
            for other in bodies:
                if meet(other, point, towards)[0] < reach:
                    power = power * np.mean(other.get("transparency", 0))
        total += (1 - mirror - glass) * np.array(body.get("color", 0)) / np.pi * max(facing @ towards, 0) * power
    if depth == 0:
        return total
    cosine = -(facing @ travel)
    near, far = (body.get("index", 1), 1) if inside else (1, body.get("index", 1))
    reflectance, cos_far = fresnel(cosine, near, far)
    again = (bodies, lights)
    share = mirror + glass * reflectance
    if np.any(share > 0):
        total = total + share * radiance(*again, point, travel + 2 * cosine * facing, depth - 1, background, shadows)
    if np.any(glass > 0) and cos_far is not None:
        tangent = travel + cosine * facing
        length = np.linalg.norm(tangent)
        sine = np.sqrt(1 - cos_far**2)
        onward = -cos_far * facing + (tangent / length * sine if length > 0 else 0)
        total = total + glass * (1 - reflectance) * radiance(*again, point, onward, depth - 1, background, shadows)
    return total


def image(bodies, lights, origins, directions, depth, background=0.0, shadows=True):
    height, width = origins.shape[:2]
    rows = [
        [radiance(bodies, lights, origins[i, j], directions[i, j], depth, background, shadows) for j in range(width)]
        for i in range(height)
    ]
    return np.array(rows)
