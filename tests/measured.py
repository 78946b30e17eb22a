"""Writers of measured files from BRDFs that are known: MERL's `.binary` and RGL's `.bsdf`, after the published formats."""

from __future__ import annotations

import functools
import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np

MERL = (90, 90, 180)
BRDF = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""(cos theta_h, wi (..., 3), wo (..., 3)) are enough for all of ours: f(wi, wo) -> (...,) in 1/sr."""


# --- BRDFs ---


def lambert(reflectance: float) -> BRDF:
    return lambda wi, wo: np.full(wi.shape[:-1], reflectance / np.pi)


def _lambda(cosine: np.ndarray, alpha: float) -> np.ndarray:
    tangent = np.sqrt(np.maximum(1 - cosine**2, 0)) / np.maximum(cosine, 1e-9)
    return (np.sqrt(1 + (alpha * tangent) ** 2) - 1) / 2


def _facets(cosine: np.ndarray, alpha: float) -> np.ndarray:
    return alpha**2 / (np.pi * (cosine**2 * (alpha**2 - 1) + 1) ** 2)


def ggx(alpha: float) -> BRDF:
    """GGX with Smith's height-correlated masking, F = 1. Below the horizon that of a direction just above it."""

    def f(wi: np.ndarray, wo: np.ndarray) -> np.ndarray:
        half = wi + wo
        half = half / np.linalg.norm(half, axis=-1, keepdims=True)
        ci, co = (np.maximum(part[..., 2], 1e-3) for part in (wi, wo))
        return _facets(half[..., 2], alpha) / ((1 + _lambda(ci, alpha) + _lambda(co, alpha)) * 4 * ci * co)

    return f


def ggx_albedo(alpha: float, cos_theta: float) -> float:
    """The albedo of `ggx`: the midpoint rule over the half vector, exact to six digits for alpha from 0.02 on."""
    x, turn = (np.arange(4000) + 0.5) / 4000, (np.arange(400) + 0.5) / 400 * np.pi
    half = (np.pi / 2 * x**2)[:, None]
    sine = np.sqrt(1 - cos_theta**2)
    meets = sine * np.sin(half) * np.cos(turn) + cos_theta * np.cos(half)
    co = 2 * meets * np.cos(half) - cos_theta
    lit = (meets > 0) & (co > 0)
    masking = 1 / (1 + _lambda(np.array(cos_theta), alpha) + _lambda(np.maximum(co, 1e-9), alpha))
    value = np.where(lit, _facets(np.cos(half), alpha) * masking * meets / cos_theta, 0)
    solid = np.sin(half) * np.pi * x[:, None] / 4000 * np.pi / 400 * 2
    return float(np.sum(value * solid))


# --- MERL ---


@functools.cache
def merl_directions() -> tuple[np.ndarray, np.ndarray]:
    """wi and wo in the middle of each bin, (90, 90, 180, 3) both; the half vector lies over the x axis."""
    h, d, p = ((np.arange(size) + 0.5) / size for size in MERL)
    h, d, p = np.broadcast_arrays((np.pi / 2 * h**2)[:, None, None], (np.pi / 2 * d)[:, None], np.pi * p)
    x, y, z = np.sin(d) * np.cos(p), np.sin(d) * np.sin(p), np.cos(d)
    wi, wo = (
        np.stack([np.cos(h) * sign * x + np.sin(h) * z, sign * y, np.cos(h) * z - np.sin(h) * sign * x], axis=-1)
        for sign in (1, -1)
    )
    return wi, wo


def merl_bytes(f: BRDF, tint: tuple[float, float, float] = (1, 1, 1), no_data: Callable | None = None) -> bytes:
    """`f` times a colour as a MERL file. `no_data`: (wi, wo) -> where the file has none, a negative number."""
    wi, wo = merl_directions()
    values = f(wi, wo)[..., None] * np.array(tint) / (np.array([1, 1.15, 1.66]) / 1500)
    if no_data is not None:
        values[no_data(wi, wo)] = -1
    return np.array(MERL, "<i4").tobytes() + np.moveaxis(values, -1, 0).astype("<f8").tobytes()


# --- RGL ---


def tensor_file(arrays: dict[str, np.ndarray]) -> bytes:
    """Arrays as a tensor file."""
    kinds = {"uint8": 1, "float32": 10, "float64": 11}
    heads = [(name.encode(), array) for name, array in arrays.items()]
    size = 18 + sum(2 + len(name) + 2 + 1 + 8 + 8 * array.ndim for name, array in heads)
    head, body = [b"tensor_file\0", struct.pack("<BBI", 1, 0, len(heads))], b""
    for name, array in heads:
        body += b"\0" * (-(size + len(body)) % 8)
        head.append(struct.pack(f"<H{len(name)}sHBQ", len(name), name, array.ndim, kinds[array.dtype.name], size + len(body)))
        head.append(struct.pack(f"<{array.ndim}Q", *array.shape))
        body += array.tobytes()
    return b"".join(head) + body


def _bisected(rises: Callable[[np.ndarray], np.ndarray], goal: np.ndarray) -> np.ndarray:
    """Where a rising function of [0, 1] reaches `goal`."""
    low, high = np.zeros_like(goal), np.ones_like(goal)
    for _ in range(32):  # the values in a file have 24 bits
        middle = (low + high) / 2
        below = rises(middle) < goal
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return (low + high) / 2


class _Density:
    """A bilinear density on the unit square, of rows along y, by summing what lies before a point."""

    def __init__(self, table: np.ndarray):
        self.table = table

    def row(self, y: np.ndarray) -> np.ndarray:
        """The density along the row at each y, (points, columns)."""
        place = np.clip(y * (len(self.table) - 1), 0, len(self.table) - 1)
        low = np.minimum(place.astype(int), len(self.table) - 2)
        part = (place - low)[:, None]
        return self.table[low] * (1 - part) + self.table[low + 1] * part

    @staticmethod
    def before(values: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """The integral from 0 to each x of piecewise linear functions, (points, nodes) by their values at even nodes."""
        count = values.shape[1] - 1
        whole = np.concatenate([np.zeros((len(values), 1)), np.cumsum(values[:, 1:] + values[:, :-1], axis=1) / 2], axis=1)
        each = np.arange(len(values))

        def integral(x: np.ndarray) -> np.ndarray:
            place = np.clip(x * count, 0, count)
            low = np.minimum(place.astype(int), count - 1)
            part, left, right = place - low, values[each, low], values[each, low + 1]
            return (whole[each, low] + part * (left + part / 2 * (right - left))) / count

        return integral

    def point(self, s: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The points (x, y) that even numbers (s, t) draw."""
        totals = self.before(self.table)(np.ones(len(self.table)))
        below = self.before(np.broadcast_to(totals, (len(t), len(totals))))
        y = _bisected(below, t * below(np.ones(len(t))))
        left = self.before(self.row(y))
        return _bisected(left, s * left(np.ones(len(s)))), y


def rgl_arrays(
    alpha: float,
    theta_i: np.ndarray,
    phi_i: np.ndarray | None = None,
    size: int = 32,
    finer: int = 64,
    colours: tuple[float, ...] = (1.0, 1.0, 1.0),
    *,
    jacobian: bool = True,
) -> dict[str, np.ndarray]:
    """GGX (F = 1) times colours as the arrays of an RGL file; with `phi_i` as an anisotropic one (that is isotropic).

    `size`: rows and columns of the values, `finer`: of the facets and their density.
    """
    turns = np.zeros(1) if phi_i is None else phi_i
    x, y = np.linspace(0, 1, finer), np.linspace(0, 1, finer)
    theta, phi = np.pi / 2 * x**2, (2 * y - 1)[:, None] * np.pi
    ndf = np.broadcast_to(_facets(np.cos(theta), alpha), (finer, finer))
    sigma = np.broadcast_to(np.cos(theta) * (1 + _lambda(np.cos(theta), alpha)), (finer, finer))
    sigma = np.maximum(sigma, alpha / 2 * np.sin(theta))
    vndf = np.zeros((len(turns), len(theta_i), finer, finer))
    values = np.zeros((len(turns), len(theta_i), size, size))
    s, t = (part.ravel() for part in np.meshgrid(np.linspace(0, 1, size), np.linspace(0, 1, size), indexing="xy"))
    for (a, turn), (b, tilt) in ((first, second) for first in enumerate(turns) for second in enumerate(theta_i)):
        own = turn if phi_i is not None and len(phi_i) > 2 else 0.0

        def meets(theta: np.ndarray, phi: np.ndarray, tilt: float = tilt, own: float = own) -> np.ndarray:
            return np.sin(tilt) * np.sin(theta) * np.cos(phi - own) + np.cos(tilt) * np.cos(theta)

        area = np.cos(tilt) * (1 + _lambda(np.cos(tilt), alpha))
        visible = _facets(np.cos(theta), alpha) * np.maximum(meets(theta, phi), 0) / area
        vndf[a, b] = visible * np.sin(theta) * np.pi * x * 2 * np.pi
        u, v = _Density(vndf[a, b].astype(np.float32).astype(float)).point(s, t)
        tm, pm = np.pi / 2 * u**2, (2 * v - 1) * np.pi
        co = 2 * meets(tm, pm) * np.cos(tm) - np.cos(tilt)
        own_lambda = _lambda(np.cos(tilt), alpha)
        masked = (1 + own_lambda) / (1 + own_lambda + _lambda(np.maximum(co, 1e-9), alpha))
        if not jacobian:  # f cos theta_o itself
            masked = masked * _facets(np.cos(tm), alpha) / (4 * area)
        values[a, b] = np.where((co > 0) & (meets(tm, pm) > 0), masked, 0).reshape(size, size)
    name = "rgb" if len(colours) == 3 else "spectra"
    arrays = {
        "description": np.frombuffer(b"written by a test", np.uint8),
        "phi_i": turns,
        "theta_i": theta_i,
        "ndf": ndf,
        "sigma": sigma,
        "vndf": vndf,
        "luminance": values,
        name: values[:, :, None] * np.array(colours)[:, None, None],
        "jacobian": np.array([jacobian], np.uint8),
    }
    if name == "spectra":
        arrays["wavelengths"] = np.linspace(400, 700, len(colours))
    return {name: array if array.dtype == np.uint8 else array.astype(np.float32) for name, array in arrays.items()}


def rgl_bytes(*given: object, **options: object) -> bytes:
    """`rgl_arrays` as a file."""
    return tensor_file(rgl_arrays(*given, **options))  # type: ignore[arg-type]


def write(folder: Path, name: str, content: bytes) -> str:
    """A file in a folder; its path."""
    path = folder / name
    path.write_bytes(content)
    return str(path)
