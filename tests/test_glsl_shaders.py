"""The shaders of `studies/shader_corpus` against the formulas of their papers in numpy, by the program that `check` runs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcheck
from brdfcheck.brdf.callables import Evaluator

SHADERS = Path(brdfcheck.__file__).parent.parent / "studies" / "_instruments" / "shaders"
Vector = np.ndarray
PI = np.pi


def pairs(count: int) -> tuple[Vector, Vector]:
    """Pairs of directions above the surface, shape (count, 3) each."""
    random = np.random.default_rng(5)
    both = random.normal(size=(2, count, 3))
    both[..., 2] = np.abs(both[..., 2]) + 0.02
    return tuple(both / np.linalg.norm(both, axis=-1, keepdims=True))  # pyright: ignore[reportReturnType]


def dot(a: Vector, b: Vector) -> Vector:
    return np.sum(a * b, axis=-1)


def half(wi: Vector, wo: Vector) -> Vector:
    return (wi + wo) / np.linalg.norm(wi + wo, axis=-1, keepdims=True)


def phong(wi: Vector, wo: Vector, n: float) -> Vector:
    mirror = wi * [-1, -1, 1]
    return (n + 2) / (2 * PI) * np.maximum(dot(mirror, wo), 0) ** n


def blinn_phong(wi: Vector, wo: Vector, n: float) -> Vector:
    return (n + 8) / (8 * PI) * half(wi, wo)[:, 2] ** n


def ward(wi: Vector, wo: Vector, ax: float, ay: float) -> Vector:
    h = half(wi, wo)
    tangent = ((h[:, 0] / ax) ** 2 + (h[:, 1] / ay) ** 2) / h[:, 2] ** 2
    return np.exp(-tangent) / (4 * PI * ax * ay * np.sqrt(wi[:, 2] * wo[:, 2]))


def oren_nayar(wi: Vector, wo: Vector, sigma: float) -> Vector:
    a, b = 1 - 0.5 * sigma**2 / (sigma**2 + 0.33), 0.45 * sigma**2 / (sigma**2 + 0.09)
    ti, to = np.arccos(wi[:, 2]), np.arccos(wo[:, 2])
    phi = np.arctan2(wi[:, 1], wi[:, 0]) - np.arctan2(wo[:, 1], wo[:, 0])
    return (a + b * np.maximum(0, np.cos(phi)) * np.sin(np.maximum(ti, to)) * np.tan(np.minimum(ti, to))) / PI


def ashikhmin_shirley(wi: Vector, wo: Vector, rd: float, rs: float, nu: float, nv: float) -> Vector:
    h = half(wi, wo)
    lh = dot(wi, h)
    exponent = (nu * h[:, 0] ** 2 + nv * h[:, 1] ** 2) / (1 - h[:, 2] ** 2)
    fresnel = rs + (1 - rs) * (1 - lh) ** 5
    mirror = np.sqrt((nu + 1) * (nv + 1)) / (8 * PI) * h[:, 2] ** exponent / (lh * np.maximum(wi[:, 2], wo[:, 2])) * fresnel
    room = (1 - (1 - wi[:, 2] / 2) ** 5) * (1 - (1 - wo[:, 2] / 2) ** 5)
    return mirror + 28 * rd / (23 * PI) * (1 - rs) * room


def ggx(wi: Vector, wo: Vector, alpha: float) -> Vector:
    h = half(wi, wo)
    d = alpha**2 / (PI * (h[:, 2] ** 2 * (alpha**2 - 1) + 1) ** 2)

    def shadow(c: Vector) -> Vector:
        return (np.sqrt(1 + alpha**2 * (1 / c**2 - 1)) - 1) / 2

    return d / (4 * wi[:, 2] * wo[:, 2] * (1 + shadow(wi[:, 2]) + shadow(wo[:, 2])))


def cook_torrance(wi: Vector, wo: Vector, m: float) -> Vector:
    h = half(wi, wo)
    nh, vh = h[:, 2], dot(wo, h)
    d = np.exp(-(1 - nh**2) / (m * nh) ** 2) / (PI * m**2 * nh**4)
    g = np.minimum(1, 2 * nh * np.minimum(wi[:, 2], wo[:, 2]) / vh)
    return d * g / (4 * wi[:, 2] * wo[:, 2])


def lafortune(wi: Vector, wo: Vector, cx: float, cz: float, n: float) -> Vector:
    return (n + 2) / (2 * PI) * np.maximum(dot(wi * [cx, cx, cz], wo), 0) ** n


def eon(wi: Vector, wo: Vector, roughness: float) -> Vector:
    a = 1 / (1 + (0.5 - 2 / (3 * PI)) * roughness)
    s = dot(wi, wo) - wi[:, 2] * wo[:, 2]
    one = a / PI * (1 + roughness * np.where(s > 0, s / np.maximum(wi[:, 2], wo[:, 2]), s))

    def lost(c: Vector) -> Vector:
        u = 1 - c
        g = 0.0571085289 * u + 0.491881867 * u**2 - 0.332181442 * u**3 + 0.0714429953 * u**4
        return 1 - a * (1 + roughness * g)

    mean = a * (1 + (2 / 3 - 28 / (15 * PI)) * roughness)
    return one + np.maximum(1e-7, lost(wi[:, 2])) * np.maximum(1e-7, lost(wo[:, 2])) / (PI * np.maximum(1e-7, 1 - mean))


def principled(wi: Vector, wo: Vector, roughness: float, clearcoat: float) -> Vector:
    """The white dielectric: diffuse, highlight and clearcoat (Burley 2012), isotropic."""
    h = half(wi, wo)
    nl, nv, nh, lh = wi[:, 2], wo[:, 2], h[:, 2], dot(wi, h)
    retro = 0.5 + 2 * roughness * lh**2
    diffuse = (1 + (retro - 1) * (1 - nl) ** 5) * (1 + (retro - 1) * (1 - nv) ** 5) / PI
    a2 = roughness**4
    d = a2 / (PI * (1 + (a2 - 1) * nh**2) ** 2)
    f = 0.04 + 0.96 * (1 - lh) ** 5

    def smith(c: Vector, squared: float) -> Vector:
        return 1 / (c + np.sqrt(squared + c**2 - squared * c**2))

    coat = (1e-6 - 1) / (PI * np.log(1e-6) * (1 + (1e-6 - 1) * nh**2))
    return diffuse + smith(nl, a2) * smith(nv, a2) * f * d + 0.25 * clearcoat * smith(nl, 0.0625) * smith(nv, 0.0625) * f * coat


CASES: list[tuple[str, Callable[..., Vector], dict[str, float]]] = [
    ("lambert.brdf", lambda wi, wo: np.full(len(wi), 1 / PI), {}),
    ("phong.brdf", phong, {"n": 30.0}),
    ("blinn_phong.brdf", blinn_phong, {"n": 17.5}),
    ("ward.brdf", ward, {"ax": 0.2, "ay": 0.45}),
    ("oren_nayar.brdf", oren_nayar, {"sigma": 0.7}),
    ("ashikhmin_shirley.brdf", ashikhmin_shirley, {"rd": 0.4, "rs": 0.3, "nu": 20.0, "nv": 150.0}),
    ("ggx.brdf", ggx, {"alpha": 0.35}),
    ("cook_torrance.brdf", cook_torrance, {"m": 0.4}),
    ("minnaert.brdf", lambda wi, wo, k: (k + 1) / (2 * PI) * (wi[:, 2] * wo[:, 2]) ** (k - 1), {"k": 1.7}),
    ("lafortune.brdf", lafortune, {"cx": 0.9, "cz": 0.8, "n": 12.0}),
    ("eon.glsl", eon, {"roughness": 0.8}),
    ("principled.brdf", principled, {"roughness": 0.4, "clearcoat": 0.7}),
]
OFF = {"metallic": 0, "subsurface": 0, "specular": 0.5, "specularTint": 0, "anisotropic": 0, "sheen": 0, "sheenTint": 0.5}


def test_these_are_all() -> None:
    assert {name for name, _, _ in CASES} == {path.name for path in SHADERS.iterdir()}
    assert len(CASES) == 12


@pytest.mark.parametrize(("name", "formula", "values"), CASES, ids=[name for name, _, _ in CASES])
def test_a_shader_is_its_paper(name: str, formula: Callable[..., Vector], values: dict[str, float]) -> None:
    held = {**(OFF | {"clearcoatGloss": 1} if name == "principled.brdf" else {}), **values}
    ranges: dict[str, Any] = {key: (value, value) for key, value in held.items()}
    swept = next((key for key in values if key not in ("rd", "rs")), None)
    if swept is not None:  # one of them as an argument of the program
        ranges[swept] = (0.9 * values[swept], 1.1 * values[swept])
    family = brdfcheck.load(str(SHADERS / name), **ranges)
    start = {} if swept is None else {swept: values[swept]}
    assert list(family.ranges) == list(start)
    wi, wo = pairs(300)
    found = Evaluator(family.build, start).bind(start)(wi, wo)
    expected = formula(wi, wo, **values)
    assert found.shape == (300, 3)
    np.testing.assert_allclose(found, np.repeat(expected[:, None], 3, axis=1), rtol=2e-12, atol=1e-14)
