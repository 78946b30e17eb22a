"""Every kind of subject through every command: what `check` finds, all find, or say in one line why they cannot."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray
from measured import ggx, merl_bytes, rgl_bytes, write
from shared import Run

from brdfcheck.cli import ExitCode

FILES = {
    "mine.py": """
import math, brdfcheck
import jax.numpy as jnp

def arrays(wi, wo, k):
    return k * wi[..., 2] * wo[..., 2]

def with_normal(wi, wo, N, k):
    return k * jnp.sum(N * wi, axis=-1) * jnp.sum(N * wo, axis=-1)

def pair(wi, wo, k):
    return k * wi[2] * wo[2] if wo[2] > 0 else 0.0

def loop(wi, wo, k):
    return math.fabs(k) * float(wi[2]) * float(wo[2])

class Matt:
    def __init__(self, k):
        self.k = k
    def eval(self, wi, wo):
        return self.k * wi[2] * wo[2]

@brdfcheck.bsdf
def paper(wi, wo, k):
    return jnp.where(wi[..., 2] * wo[..., 2] < 0, k, 1 - k) / math.pi
""",
    "a.brdf": """analytic
::begin parameters
float k 0 1 0.5
bool half_ 0
::end parameters
::begin shader
vec3 BRDF(vec3 L, vec3 V, vec3 N, vec3 X, vec3 Y) { return vec3(half_ ? 0.5 * k : k) * dot(N, L) * dot(N, V); }
::end shader
""",
    "a.glsl": "uniform float k; vec3 shade(vec3 N, vec3 L, vec3 V) { return vec3(k * dot(N, L) * dot(N, V)); }",
    "a.hlsl": "float shade(float3 L, float3 V, float k) { return k * L.z * V.z; }",
    "a.slang": "struct Matt { float k; float eval(float3 L, float3 V) { return k * L.z * V.z; } };",
    "a.mtlx": """<?xml version="1.0"?>
<materialx version="1.39">
  <open_pbr_surface name="gold" type="surfaceshader">
    <input name="base_metalness" type="float" value="1.0" /><input name="base_color" type="color3" value="1, 0.8, 0.3" />
  </open_pbr_surface>
</materialx>
""",
    "s.xml": """<scene version="3.0.0"><bsdf type="twosided" id="metal"><bsdf type="roughconductor">
  <string name="distribution" value="ggx"/><string name="material" value="none"/><float name="alpha" value="0.25"/>
</bsdf></bsdf></scene>""",
}
OUR = 0.5 * np.pi / 3  # k (N.L)(N.V) at k = 0.5 and cosine 0.5
# Subject, what is held, the albedo at cosine 0.5 where it is known, the package that it needs, and whether it takes seconds.
KINDS: dict[str, tuple[str, dict[str, float], float | None, str, bool]] = {
    "lobe": ("blinn-phong", {"n": 10}, None, "", True),
    "dielectric": ("rough-dielectric-ggx", {"alpha": 0.4, "eta": 1.5, "below": 0}, None, "", True),
    "thin sheet": ("thin-sheet", {"index": 1.5, "clear": 1, "below": 0}, 1, "", True),
    "arrays": ("mine.py:arrays", {"k": 0.5}, OUR, "", True),
    "normal": ("mine.py:with_normal", {"k": 0.5}, OUR, "", True),
    "pair": ("mine.py:pair", {"k": 0.5}, OUR, "", True),
    "loop": ("mine.py:loop", {"k": 0.5}, OUR, "", True),
    "object": ("mine.py:Matt", {"k": 0.5}, OUR, "", True),
    "bsdf": ("mine.py:paper", {"k": 0.25, "below": 1}, 1, "", False),
    "brdf": ("a.brdf", {"k": 0.5, "half_": 0}, OUR, "", True),
    "glsl": ("a.glsl:shade", {"k": 0.5}, OUR, "", True),
    "hlsl": ("a.hlsl:shade", {"k": 0.5}, OUR, "", True),
    "slang": ("a.slang:Matt.eval", {"this.k": 0.5}, OUR, "", True),
    "mtlx": ("a.mtlx:gold", {"specular_roughness": 0.5}, None, "MaterialX", True),
    "materialx": ("materialx:open_pbr_surface", {"specular_roughness": 0.5}, None, "MaterialX", True),
    "mitsuba": ("mitsuba:principled", {"roughness": 0.5}, None, "mitsuba", True),
    "mitsuba glass": ("mitsuba:roughdielectric", {"alpha": 0.3, "below": 0}, None, "mitsuba", True),
    "mitsuba file": ("mitsuba:s.xml#metal", {"brdf_0.alpha": 0.3}, None, "mitsuba", True),
    "merl": ("ggx.binary", {}, None, "", True),
    "rgl": ("ggx.bsdf", {}, None, "", True),
}
_PARAMETERS = [pytest.param(kind, marks=pytest.mark.slow if slow else (), id=kind) for kind, (*_, slow) in KINDS.items()]


@pytest.mark.parametrize("kind", _PARAMETERS)
def test_all_commands_take_it_and_agree(run: Run, here: Path, kind: str) -> None:
    spec, held, truth, package, _ = KINDS[kind]
    if package and importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed")
    for name, text in FILES.items():
        (here / name).write_text(text)
    if spec == "ggx.binary":
        write(here, spec, merl_bytes(ggx(0.5)))
    if spec == "ggx.bsdf":
        write(here, spec, rgl_bytes(0.4, np.linspace(0, 1.45, 7), size=12, finer=24))
    over = [word for name, value in held.items() for word in ("--over", f"{name}={value:g}")]
    at_half, json_to = ("--cos-theta", "0.5"), ("--json", "-")

    def found(*words: str, codes: tuple[int, ...] = (ExitCode.PASSED,)) -> str:
        code, out, err = run(*words)
        assert code in codes, (words, code, out, err)
        assert "Traceback" not in err
        if code == ExitCode.USAGE_ERROR:
            assert err.count("\n") == 1
            assert spec in err  # whose fault it is
        return out

    def document(*words: str, **options: Any) -> Any:
        return json.loads(found(*words, *json_to, **options))["results"][0]

    either = (ExitCode.PASSED, ExitCode.FAILED)
    report = document("check", spec, *over, *at_half, "--effort", "quick", codes=either)
    albedo, bar = float(report["albedo"]), float(report["error"]) + 2e-5
    if truth is not None:
        assert albedo == pytest.approx(truth, abs=bar)
    curve = document("plot", "albedo-vs-angle", spec, *over, *at_half, "-o", "a.svg")
    assert max(map(float, curve["albedo"])) == pytest.approx(albedo, abs=bar)
    axes = "".join(f"{json.dumps(name)} = {value}\n" for name, value in held.items())
    (here / "config.toml").write_text(f"brdf = {json.dumps(spec)}\n[axes]\n{axes}cos_theta = 0.5\n")
    found("sweep", "config.toml", "--out", "store.zarr")
    assert float(xarray.open_zarr("store.zarr").albedo.max()) == pytest.approx(albedo, abs=bar)
    found("table", spec, *over, "--cos-theta", "0.5:1", "--nodes", "ends", "--size", "2x2", "--rtol", "1e-3", "-o", "t.csv")
    lit = [word for name, value in held.items() if name != "below" for word in ("--set", f"{name}={value:g}")]
    for shape, of in (("sphere", lit), ("furnace", lit if kind == "mitsuba glass" else over)):  # lit from above
        if shape == "sphere" and kind == "mitsuba glass":
            assert "not under lights" in run("render", shape, "--brdf", spec, *of, "-o", "x.png")[2]
            continue
        found("render", shape, "--brdf", spec, *of, "--size", "8", "--quality", "draft", "-o", f"{shape}.png")
        assert (here / f"{shape}.png").stat().st_size > 50
    found("view", spec, *over, *at_half, "--effort", "quick", "--no-open", "-o", "page.html", codes=either)
    assert spec.encode() in (here / "page.html").read_bytes()
    # Proofs, and one constant as a factor, are for what reflects; tables and plug-ins are not proved.
    found("certify", spec, *over, *at_half, "--seconds", "0.5", codes=(*either, ExitCode.USAGE_ERROR))
    if "n" not in held:
        fit = run("fit", spec, *over, "--json", "fit.json")
        assert fit[0] in ((ExitCode.USAGE_ERROR,) if "below" in held else either), fit  # what is not reciprocal has a finding
        assert ("transmits" in fit[2]) == ("below" in held)
        if "below" not in held:
            assert "is one constant: there is no range of n" in run("plot", "factor", "fit.json", "-o", "b.svg")[2]
