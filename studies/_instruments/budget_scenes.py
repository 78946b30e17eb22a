"""Scenes of which budgets are measured: five of this project and four as others bring them."""

from __future__ import annotations

from typing import Any

import numpy as np

BASE = {"brdf": "lambert", "tint": [0.6, 0.3, 0.1]}
MATT = {"kind": "surface", "terms": [BASE]}
GLOSSY = {"kind": "surface", "terms": [BASE, {"brdf": "blinn-phong", "tint": 0.1, "n": 30}]}
SHINY = {"brdf": "cook-torrance", "tint": [0.95, 0.75, 0.4], "m": 0.12, "fresnel": "exact"}
WINDOW = {"kind": "polygon", "vertices": [[2, -1, -0.5], [2, 1, -0.5], [2, 1, 1.5], [2, -1, 1.5]], "intensity": 1.5}
LAMP = {"kind": "point", "constant_attenuation": 0, "quadratic_attenuation": 1}
SUN = {"kind": "distant", "direction": [1, 1, 1], "intensity": 3}
SKY = {"kind": "environment", "intensity": 0.7}
STEP = {"pixel": "1/255"}


def _lamps(count: int) -> list[dict[str, Any]]:
    """Lamps all around, of brightness from 1 to a thousandth."""
    ways = np.random.default_rng(30).normal((0, 0.5, 1), size=(count, 3))
    places = 20 * ways / np.linalg.norm(ways, axis=1, keepdims=True)
    return [{**LAMP, "position": place.tolist(), "intensity": 200 * 1e-3 ** (k / count)} for k, place in enumerate(places)]


# What is said of a scene, and the scene.
SCENES: dict[str, dict[str, Any]] = {
    "a matt sphere far away": {
        "size": 256, "camera": {"kind": "orthographic", "half_height": 4}, "material": MATT,
        "lights": [{**LAMP, "position": [3000, 3000, 4000], "intensity": 1e8}],
    },
    "glossy, in 16 bits": {
        "size": 256, "material": GLOSSY, "output": {"bits": 16}, "lights": [{**LAMP, "position": [3, 3, 4], "intensity": 70}],
    },
    "mirror-like metal close up": {
        "size": 256, "camera": {"kind": "orthographic", "half_height": 0.6},
        "material": {"kind": "surface", "terms": [SHINY]}, "lights": [{**LAMP, "position": [1, 1, 2.5], "intensity": 1.2}],
    },
    "translucent, 3 steps": {
        "size": 256, "background": [0.1, 0.1, 0.12], "lights": [{"kind": "distant", "direction": [1, 1, 1]}],
        "material": {"kind": "translucent", "base": [0.3, 0.6, 0.9], "behind": 0.1}, "matters": {"pixel": "3/255"},
    },
    "an icon of 32 pixels, of facets, 8 steps": {
        "size": 32, "geometry": {"kind": "icosphere", "level": 4}, "material": MATT, "lights": [SUN],
        "matters": {"pixel": "8/255", "silhouette": False},
    },
    # Those of others.
    "5,120 facets under three lights": {
        "size": 200, "matters": STEP, "geometry": {"kind": "icosphere", "level": 4, "shading": "phong"},
        "material": {"kind": "surface", "terms": [
            {"brdf": "lambert", "tint": [0.2, 0.3, 0.6]}, {"brdf": "blinn-phong", "tint": 0.3, "n": 200},
        ]},
        "lights": [
            {**LAMP, "position": [40, 30, 60], "intensity": 9000},
            {"kind": "distant", "direction": [-1, 0.2, 0.5], "intensity": 0.4}, {"kind": "ambient", "intensity": 0.1},
        ],
    },
    "a glossy ball in a room, by a window and a lamp": {
        "size": 128, "matters": STEP, "material": GLOSSY, "room": {"reflectance": 0.6, "emission": 0.8, "cells": 10},
        "lights": [{**WINDOW, "matt_only": True}, {**LAMP, "position": [3, 3, 4], "intensity": 30}],
    },
    "a matt ball under 20 lamps": {"size": 160, "matters": STEP, "material": MATT, "lights": _lamps(20)},
    "rough metal under an even sky and the sun": {
        "size": 24, "matters": STEP, "lights": [SKY, SUN],
        "material": {"kind": "surface", "terms": [{"brdf": "ggx", "tint": [0.95, 0.75, 0.4], "alpha": 0.3}]},
    },
}  # fmt: skip
