"""What HLSL and Slang call otherwise than GLSL: types, functions, words."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Dialect:
    """How a language differs from GLSL. `types`, `functions`: its names for those of GLSL.

    `spread`: a scalar becomes a vector, a longer vector is cut, whole numbers and truth values mix; there are casts and lists
    in braces, and % of floats; matrices are given by rows, and * multiplies entry by entry.
    """

    name: str
    types: dict[str, str] = field(default_factory=dict)
    functions: dict[str, str] = field(default_factory=dict)
    spread: bool = False


def _shapes() -> dict[str, str]:
    found: dict[str, str] = {}
    for base, prefix in (("float", ""), ("half", ""), ("double", ""), ("real", ""), ("int", "i"), ("uint", "u"), ("bool", "b")):
        for size in (2, 3, 4):
            found[f"{base}{size}"] = f"{prefix}vec{size}"
        found[f"{base}1"] = base
    for base in ("float", "half", "double"):
        for rows in (2, 3, 4):
            for columns in (2, 3, 4):
                # A matrix is kept by rows: row r of HLSL is column r of GLSL.
                found[f"{base}{rows}x{columns}"] = f"mat{rows}x{columns}"
    found |= dict.fromkeys(("half", "double", "real", "float1", "half1", "double1", "real1", "min16float"), "float")
    # Like samplers they may be declared and passed on, and have no values.
    shapes = ("1D", "2D", "3D", "Cube", "1DArray", "2DArray", "CubeArray", "2DMS", "2DMSArray")
    resources = [f"{way}Texture{shape}" for way in ("", "RW") for shape in shapes]
    resources += [f"{way}{kind}Buffer" for way in ("", "RW") for kind in ("", "Structured", "ByteAddress")]
    found |= dict.fromkeys((*resources, "SamplerState", "SamplerComparisonState", "sampler"), "sampler2D")
    return found | {"int1": "int", "uint1": "uint", "bool1": "bool", "dword": "uint"}


GLSL = Dialect("GLSL")
HLSL = Dialect(
    "HLSL",
    types=_shapes(),
    functions={
        "lerp": "mix",
        "frac": "fract",
        "rsqrt": "inversesqrt",
        "ddx": "dFdx",
        "ddy": "dFdy",
        "atan2": "atan",
        "countbits": "bitCount",
        "reversebits": "bitfieldReverse",
    },
    spread=True,
)
