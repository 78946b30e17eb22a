"""Sums of BRDFs: their values, their certificates, and what is no proof."""

from __future__ import annotations

import json
import math

import jax.numpy as jnp
import numpy as np
import pytest
from numpy_shader import normalised
from shared import replaced

import brdfcheck
from brdfcheck.messages import UsageError
from brdfcheck.proof import Certificate, Rejected, certify, verify


def phong(n):
    return brdfcheck.Normalized(brdfcheck.Phong(n), brdfcheck.PhongExact())


def layered(n, m):
    return brdfcheck.Mixture([brdfcheck.Lambert(0.9), phong(n), brdfcheck.CookTorrance(m)], [0.3, 0.5, 0.2])


def varnish(n, f0):
    coat = brdfcheck.Normalized(brdfcheck.BlinnPhong(n), brdfcheck.Factor(7.8025, 26.716))
    return brdfcheck.FresnelBlend(coat, brdfcheck.Lambert(1.0), f0)


UPWARDS = normalised(np.random.default_rng(2).normal(size=(2, 50, 3)))
UPWARDS[..., 2] = np.abs(UPWARDS[..., 2])
WI, WO = UPWARDS


def test_a_mixture_is_the_sum_of_its_parts():
    found = layered(7.0, 0.3)(WI, WO)
    parts = [brdfcheck.Lambert(0.9), phong(7.0), brdfcheck.CookTorrance(0.3)]
    assert np.allclose(found, sum(w * part(WI, WO) for w, part in zip((0.3, 0.5, 0.2), parts, strict=True)), rtol=1e-6)


def test_a_fresnel_blend_is_reciprocal_and_all_diffuse_or_all_coat_at_its_ends():
    blend = varnish(9.0, 0.2)
    assert np.allclose(blend(WI, WO), blend(WO, WI), rtol=1e-6)
    assert np.allclose(varnish(9.0, 1.0)(WI, WO), blend.coat(WI, WO), rtol=1e-5)
    up = jnp.array([[0.0, 0.0, 1.0]])
    assert np.allclose(varnish(9.0, 0.0)(up, up), 1 / np.pi)
    grazing = jnp.array([[1.0, 0.0, 0.0]])
    assert np.allclose(varnish(9.0, 0.0)(grazing, up), 0.0)


@pytest.mark.parametrize(
    ("family", "ranges", "theorem"),
    [
        (layered, {"n": (0, math.inf), "m": (0.1, 1)}, "mixture"),
        (varnish, {"n": (1, 1000), "f0": (0, 1)}, "Fresnel blend"),
    ],
)
def test_sums_are_proved_by_their_parts(family, ranges, theorem):
    proof = certify(family, **ranges)
    assert proof
    assert proof.record["theorems"] == [theorem]
    verify(proof)
    record = json.loads(proof.to_json())
    mixture = theorem == "mixture"
    for path, value in (
        (("lobe", "kind"), "sum"), (("parts", 0, "verdict"), "VIOLATES"), (("range", "n"), ["0", "1001"]),
        (("parts", 1, "range"), {"n": ["1", "2"]}), (("statement",), "It conserves."), (("parts",), record["parts"][:1]),
        (("lobe", "weights" if mixture else "f0"), ["0.4", "0.5", "0.2"] if mixture else "2"),
    ):  # fmt: skip
        with pytest.raises(Rejected):
            verify(Certificate(replaced(record, path, value)))


def test_weights_may_be_parameters():
    """What is proved of the parts holds at each value of the weights, which are largest at a corner of their box."""

    def blend(n, kd, ks):
        return brdfcheck.Mixture([brdfcheck.Lambert(1.0), phong(n), phong(3.0)], [kd, ks * (0.9 - kd), 0.1])

    proof = certify(blend, n=(1, math.inf), kd=(0, 0.9), ks=(0, 1))
    assert proof.record["lobe"]["weights"] == [{"kd": "1"}, {"kd*ks": "-1", "ks": "0.9"}, "0.1"]
    assert "(-kd*ks + 0.9*ks) [" in proof.statement
    record = json.loads(proof.to_json())
    verify(Certificate(record))
    for first in ({"kd": "1.1"}, {"kd": "-1"}, {"kd*kd": "1"}, {"n": "1"}, {"z": "0.1"}, {"kd": "1e0"}, ["kd"], {}):
        with pytest.raises(Rejected):
            verify(
                Certificate({**record, "lobe": {"kind": "mixture", "weights": [first, *proof.record["lobe"]["weights"][1:]]}})
            )
    with pytest.raises(UsageError, match="add up to at most 1"):
        certify(blend, seconds=0, n=(1, 9), kd=(0, 0.9), ks=(0, 1.001))


def test_mixtures_of_one_member():
    assert certify(brdfcheck.Mixture([brdfcheck.Lambert(1.0), phong(3.0)], [0.5, 0.5]))


@pytest.mark.parametrize(
    ("family", "message"),
    [
        (lambda n: brdfcheck.Mixture([brdfcheck.Lambert(0.1), phong(n)], [0.6, 0.5]), "add up to at most 1; got 0.6, 0.5"),
        (lambda n: brdfcheck.Mixture([brdfcheck.Lambert(0.1), phong(n)], [-0.1, 0.5]), "must be >= 0"),
        (lambda n: brdfcheck.Mixture([brdfcheck.Lambert(1.1), phong(n)], [0.1, 0.1]), "a part does not conserve"),
        (lambda n: brdfcheck.Mixture([brdfcheck.Lambert(0.1), phong(n)], [n, 0.1]), "at most 1; got n, 0.1"),
        (lambda n: brdfcheck.Mixture([brdfcheck.Lambert(0.1), phong(n)], [n * n, 0.1]), "the weight holds a power"),
        (lambda n: brdfcheck.Mixture([brdfcheck.Lambert(0.1), phong(n)], [1 / n, 0.1]), "a weight is no polynomial"),
        (
            lambda n: brdfcheck.Mixture([brdfcheck.Lambert(0.1), phong(2 * n)], [0.1, 0.1]),
            "part 2 of .* does not go into Phong",
        ),
        (lambda n: brdfcheck.FresnelBlend(phong(n), brdfcheck.Lambert(1.0), 1.5), "f0 must be from 0 to 1"),
        (
            lambda n: brdfcheck.FresnelBlend(phong(3), brdfcheck.Lambert(1.0), 0.1 * n),
            "f0 does not go into FresnelBlend as it is",
        ),
    ],
)
def test_premises_are_checked(family, message):
    with pytest.raises(UsageError, match=message):
        certify(family, seconds=0, n=(2, 3))


def test_where_no_theorem_holds_boxes_may_tell():
    bright = certify(lambda n: brdfcheck.Mixture([brdfcheck.Lambert(0.9), phong(n)], [0.6, 0.5]), n=(2, 3))
    assert float(bright.record["point"]["albedo at least"]) > 1.02


def test_bad_parts():
    with pytest.raises(TypeError, match="a part must be a BRDF of this package; got function"):
        brdfcheck.Mixture([lambda wi, wo: 0.1], [1.0])  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueError, match="a weight for each part; got 1 parts"):
        brdfcheck.Mixture([brdfcheck.Lambert()], [0.5, 0.5])
