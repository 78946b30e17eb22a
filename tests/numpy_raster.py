"""An independent renderer in plain numpy, float64: every pixel against every face, straight from the definitions.

Nothing of the package is used: rays are cut with the planes of the faces, weights are solved for, shading is written out.
"""

from __future__ import annotations

import numpy as np
from numpy_shader import normalised


def camera_rays(eye, target, up, size, *, half_height=None, field_of_view=None):
    """Origins and directions, shape (height, width, 3), of an orthographic (half_height) or a perspective camera."""
    height, width = size
    eye, target, up = (np.asarray(part, float) for part in (eye, target, up))
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross(up, back) / np.linalg.norm(np.cross(up, back))
    above = np.cross(back, right)
    half = half_height if field_of_view is None else np.tan(np.radians(field_of_view) / 2)
    column, row = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
    offset = (2 * column - width)[..., None] * half / height * right + (height - 2 * row)[..., None] * half / height * above
    if field_of_view is None:
        return eye + offset, np.broadcast_to(-back, offset.shape)
    direction = offset - back
    return np.broadcast_to(eye, offset.shape), direction / np.linalg.norm(direction, axis=-1, keepdims=True)


def seen(vertices, faces, origins, directions, *, cull=True):
    """(face or -1, weights (..., 3), margin): the nearest face on each ray; the margin is how close the ray is to any edge."""
    shape = origins.shape[:-1]
    nearest, margin = np.full(shape, np.inf), np.full(shape, np.inf)
    face, weights = np.full(shape, -1), np.zeros((*shape, 3))
    for number, corners in enumerate(vertices[faces]):
        a, b, c = corners
        normal = np.cross(b - a, c - a)
        facing = directions @ normal
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = ((a - origins) @ normal) / facing
            hit = origins + distance[..., None] * directions
        # Weights by least squares in the plane of the face.
        basis = np.linalg.pinv(np.stack([b - a, c - a], axis=1))
        u, v = np.moveaxis((hit - a) @ basis.T, -1, 0)
        w = np.stack([1 - u - v, u, v], axis=-1)
        good = (facing < 0 if cull else facing != 0) & (distance > 0)
        margin = np.where(good, np.minimum(margin, np.abs(w.min(axis=-1))), margin)
        take = good & (w.min(axis=-1) >= 0) & (distance < nearest)
        nearest, face = np.where(take, distance, nearest), np.where(take, number, face)
        weights = np.where(take[..., None], w, weights)
    return face, weights, margin


def averaged_normals(vertices, faces, *, by_area):
    """Vertex normals by a plain loop over faces and their vertices."""
    total = np.zeros_like(vertices)
    for face in faces:
        a, b, c = vertices[face]
        normal = np.cross(b - a, c - a)
        for vertex in face:
            total[vertex] += normal if by_area else normal / np.linalg.norm(normal)
    return normalised(total)


def blinn(normal, view, light, color, gloss, n):
    """color max(0, N.L) + gloss max(0, N.H)^n where the light is above: rows of unit vectors in, rgb out."""
    light = normalised(np.asarray(light, float))
    lit = normal @ light
    half = normalised(view + light)
    highlight = np.maximum(np.sum(normal * half, axis=-1), 0) ** n
    return np.where(lit[..., None] > 0, np.maximum(lit, 0)[..., None] * color + gloss * highlight[..., None], 0.0)


def image(vertices, faces, normals, origins, directions, shader, shading, *, cull=True, background=0.0):
    """(rgb (height, width, 3), margin) with shader(point, normal, view): flat, gouraud or phong."""
    face, weights, margin = seen(vertices, faces, origins, directions, cull=cull)
    corners = faces[np.maximum(face, 0)]
    backwards = -directions[0, 0]
    perspective = not np.array_equal(directions[0, 0], directions[-1, -1])

    def view(point):
        return normalised(origins[0, 0] - point) if perspective else np.broadcast_to(backwards, point.shape)

    if shading == "flat":
        centre = vertices[faces].mean(axis=1)
        a, b, c = vertices[faces].transpose(1, 0, 2)
        rgb = shader(centre, normalised(np.cross(b - a, c - a)), view(centre))[np.maximum(face, 0)]
    elif shading == "gouraud":
        rgb = np.einsum("hwk,hwkc->hwc", weights, shader(vertices, normals, view(vertices))[corners])
    else:
        point = np.einsum("hwk,hwkc->hwc", weights, vertices[corners])
        blended = np.einsum("hwk,hwkc->hwc", weights, normals[corners])
        length = np.linalg.norm(blended, axis=-1, keepdims=True)
        rgb = shader(point, blended / np.where(length > 0, length, 1), view(point))
    return np.where((face >= 0)[..., None], rgb, background), margin
