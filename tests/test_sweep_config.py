"""Configurations of a sweep: what they mean, and one clear line for everything that can be wrong with them."""

from __future__ import annotations

import re

import numpy as np
import pytest

import brdfcheck
from brdfcheck.messages import UsageError
from brdfcheck.sweep import Plan, parse, read_config

GOOD = {"brdf": "phong", "axes": {"n": [1, 10], "cos_theta": {"linspace": [0.5, 1, 3]}}}


def test_axes_by_linspace_geomspace_list_and_value(tmp_path):
    (tmp_path / "c.toml").write_text("""
brdf = "BinomialPower"
rule = "exact-azimuth"
precision = ["float32", "float64"]
[axes]
n = { geomspace = [1, 1000, 4] }
k = [8, 16]
form = "mirror"
"cos theta" = { linspace = [0, 1, 5] }
[chunks]
cos_theta = 2
""")
    plan = Plan(read_config(tmp_path / "c.toml"))
    assert [axis.name for axis in plan.dimensions] == ["precision", "n", "k", "cos_theta"]
    assert plan.shape == (2, 4, 2, 5)
    assert plan.grid[2:] == (2, 3)
    _, n, k, mu = plan.dimensions
    np.testing.assert_allclose(n.values, [1, 10, 100, 1000], rtol=1e-15)
    np.testing.assert_array_equal(mu.values, [0, 0.25, 0.5, 0.75, 1])
    assert k.values.dtype == np.int64
    assert [axis.name for axis in plan.held] == ["brdf", "rule", "form"]
    assert plan.program(plan.chunk(plan.chunks - 1)).settings == {
        "brdf": "BinomialPower", "rule": "zonal", "precision": "float64", "k": 16, "form": "mirror",
    }  # fmt: skip


def test_a_document_is_read_back_as_it_was():
    config = parse({**GOOD, "rtol": [1e-6, 1e-9], "chunks": {"n": 1}})
    assert parse(config.document()).document() == config.document()


BAD = [
    ({"axes": GOOD["axes"]}, "brdf: is missing"),
    ({"brdf": "phong"}, "axes.cos_theta: is missing, as in"),
    ({"brdf": "phong", "axes": {"cos_theta": 1.0}}, "phong needs an axis n, as in n = { geomspace"),
    ({**GOOD, "axes": {**GOOD["axes"], "precision": "float32"}}, "axes.precision: belongs above [axes]"),
    ({**GOOD, "axes": {**GOOD["axes"], "cos theta": 1}}, "axes.cos theta: is given twice"),
    ({**GOOD, "brdf": "fong"}, "did you mean"),
    ({**GOOD, "brdf": ["phong", "phong"]}, "'phong' is given twice"),
    ({**GOOD, "brdf": 3}, "must be a name"),
    ({**GOOD, "brdf": "missing.py:f"}, "there is no file"),
    ({**GOOD, "rule": "simpson"}, "unknown rule 'simpson'; allowed: default, "),
    ({**GOOD, "rule": "half-vector"}, "phong does not fit the rule 'half-vector', which needs "),
    ({**GOOD, "rule": "gauss-product:many"}, "the setting of 'gauss-product:many'"),
    ({**GOOD, "rule": "adaptive:7"}, "tolerance must be a number between 0 and 1"),
    ({**GOOD, "precision": "float16"}, "unknown precision 'float16'"),
    ({**GOOD, "rtol": 0}, "rtol: must lie above 0"),
    ({**GOOD, "rtol": "tiny"}, "must hold numbers"),
    ({**GOOD, "rtol": 1e-6, "rule": "zonal"}, "rtol: is for the rule 'default'; others have a setting, as in adaptive:1e-6"),
    ({**GOOD, "chunks": {"q": 2}}, "there is no such axis"),
    ({**GOOD, "precision": ["float32", "float64"], "chunks": {"precision": 2}}, "chunks.precision: must be 1"),
]
BAD_AXES = [
    ({"q": [1.0]}, "phong has no parameter 'q'; its parameters: n"),
    ({"k": [2]}, "phong has no parameter 'k'; its parameters: n"),
    ({"albedo": [1.0]}, "the store uses the name 'albedo' itself"),
    ({"n": []}, "axes.n: must have at least one entry; got []"),
    ({"n": {"list": []}}, "axes.n.list: must have at least one entry; got []"),
    ({"n": {"linspace": [1, 2, 0]}}, "axes.n.linspace[2]: must be at least 1; got 0"),
    ({"n": {"linspace": [1, 2, True]}}, "axes.n.linspace[2]: must be a whole number; got True"),
    ({"n": {"linspace": [1, 2, 10**12]}}, "axes.n.linspace[2]: must be at most 10000000; got 1000000000000"),
    ({"n": {"linspace": [-1e308, 1e308, 5]}}, "axes.n: the values must be finite"),
    ({"n": {"linspace": [1, float("inf"), 3]}}, "axes.n.linspace[1]: must be finite; got inf"),
    ({"n": {"linspace": [2, 2, 3]}}, "axes.n: 2 is given twice"),
    ({"n": {"geomspace": [0, 10, 3]}}, "axes.n.geomspace[0]: must be above 0; got 0"),
    ({"n": {"linspace": [0, 1, 3], "list": [1]}}, "must have exactly one of linspace, geomspace, list, values"),
    ({"n": {}}, "must have exactly one of"),
    ({"n": [1.0, float("nan")]}, "axes.n[1]: the values must be finite; got nan"),
    ({"n": [1, 10**400]}, "axes.n[1]: the values must be finite; got 1000"),
    ({"n": [1.0, True]}, "must hold numbers; got True"),
    ({"n": [1.0, [2.0]]}, "must hold numbers"),
    ({"n": "a"}, "axes.n: must hold numbers; got 'a'"),
    ({"n": [3, 3]}, "axes.n: 3 is given twice"),
    ({"n": [1, 2.5, 2.5]}, "axes.n: 2.5 is given twice"),
    ({"n": [-1.0]}, "n must be finite and >= 0; got -1"),
    ({"cos_theta": [0.5, 1.5]}, "axes.cos_theta: must lie in [0, 1]; got 1.5"),
    ({"cos_theta": [-0.1]}, "must lie in [0, 1]; got -0.1"),
    ({"cos_theta": [0.5, 1, 0.5]}, "axes.cos_theta: 0.5 is given twice"),
    ({"cos_theta": ["steep"]}, "must hold numbers"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("document", "message"), [*BAD, *(({**GOOD, "axes": {**GOOD["axes"], **axes}}, text) for axes, text in BAD_AXES)]
)
def test_what_is_wrong_is_said_in_one_line(document, message, tmp_path):
    with pytest.raises(UsageError) as error:
        Plan(parse(document, folder=tmp_path, label="c.toml"))
    assert str(error.value).startswith("c.toml: ")
    assert message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("brdf", "axes", "message"),
    [
        ("binomial-power-half", {"k": [3]}, "k must be a positive even integer; got 3"),
        ("BinomialPower", {"k": {"linspace": [2, 4, 4]}}, "axes.k: must be whole numbers"),
        ("BinomialPower", {"form": ["upside-down"]}, "form must be one of mirror, half"),
        ("Lyon", {"w": [40]}, "w must be an integer from 1 to 16; got 40"),
        ("BinomialPower", {"gloss": "high"}, "BinomialPower has no parameter 'gloss'; its parameters: n, k, form, clamped"),
        (["phong", "lambert"], {}, "lambert has no parameter 'n'; its parameters: reflectance"),
        ("Phong", {"n": [True]}, "axes.n: must hold numbers; got True"),
        ("binomial-power-half", {"k": ["8"]}, "axes.k: must hold numbers; got '8'"),
        ("BinomialPower", {"k": [8, 16, 8]}, "axes.k: 8 is given twice"),
    ],
)
def test_parameters_a_lobe_refuses(brdf, axes, message):
    with pytest.raises(UsageError, match=re.escape(message)):
        Plan(parse({"brdf": brdf, "axes": {**GOOD["axes"], **axes}}))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b"brdf = ", "is not TOML"),
        (b"brdf = 'phong'\nbrdf = 'ggx'", "is not TOML"),
        (b"\xff\xfe\x00", "is not a text file in UTF-8"),
        (b"", "brdf: is missing"),
        (b"brdf = 'phong'\n[axes]\nn = [1, nan]\ncos_theta = 1", "axes.n[1]: the values must be finite; got nan"),
        (b"brdf = 'phong'\nn = [1]\n", "unknown key 'n'; allowed: brdf, rule, precision, rtol, seed, axes, chunks"),
    ],
)
def test_files_that_are_no_configuration(text, message, tmp_path):
    (tmp_path / "c.toml").write_bytes(text)
    with pytest.raises(UsageError) as error:
        read_config(tmp_path / "c.toml")
    assert message in str(error.value)


def test_files_that_are_not_there(tmp_path):
    with pytest.raises(UsageError, match="there is no file"):
        read_config(tmp_path / "c.toml")
    with pytest.raises(UsageError, match="is a folder"):
        read_config(tmp_path)


USER = """
import numpy as np
import jax.numpy as jnp
from brdfcheck import Phong

def glossy(n, ks=0.5, sheen: int = 1):
    def f(wi, wo):
        return ks * sheen * wo[..., 2] ** n
    return f

def lobe(n):
    return Phong(n)

def raises(wi, wo):
    raise RuntimeError("no such thing")

def plain(wi, wo, n):
    return wo[..., 2] ** n

number = 3
"""


@pytest.mark.parametrize(
    ("name", "axes", "message"),
    [
        ("mine.py:glossy", {"n": [1.0], "q": [1.0]}, "has no parameter 'q'; its parameters: n, ks, sheen"),
        ("mine.py:plain", {"n": [1.0], "q": "low"}, "mine.py:plain has no parameter 'q'; its parameters: n"),
        ("mine.py:glossy", {}, "mine.py:glossy needs an axis n, as in n = {"),
        ("mine.py:glossy", {"n": [1.0], "sheen": [1.5]}, "axes.sheen: must be whole numbers; got 1.5"),
        ("mine.py:nothing", {}, "has no object 'nothing'"),
        ("mine.py:number", {}, "is not callable"),
        ("mine.py:raises", {}, "RuntimeError: no such thing"),
        ("broken.py:f", {}, "SyntaxError"),
    ],
)
def test_users_brdfs_that_do_not_fit(name, axes, message, tmp_path):
    (tmp_path / "mine.py").write_text(USER)
    (tmp_path / "broken.py").write_text("def f(:\n")
    with pytest.raises(UsageError) as error:
        Plan(parse({"brdf": name, "axes": {"cos_theta": [0.5], **axes}}, folder=tmp_path))
    assert message in str(error.value)


def test_users_brdfs_are_found_beside_the_configuration(tmp_path):
    (tmp_path / "mine.py").write_text(USER)
    for name, on_host in (("mine.py:glossy", True), ("mine.py:lobe", False), ("mine.py:plain", True)):
        plan = Plan(parse({"brdf": name, "axes": GOOD["axes"]}, folder=tmp_path))
        program = plan.program(plan.chunk(0))
        assert (program.rule.on_host, program.table) == (on_host, not on_host)
        assert list(plan.document()["files"]["mine.py"]) == ["mine.py"]


def test_the_one_door_takes_what_a_sweep_takes():
    """Classes by their names, and whole numbers of the lobe of a catalogue entry; and refuses it in the same words."""
    wi, wo = np.array([0.6, 0.0, 0.8]), np.array([-0.5, 0.0, np.sqrt(0.75)])
    lobe = brdfcheck.load("BinomialPower", n=(3, 30), k=(4, 4)).build(n=20.0)
    assert lobe(wi, wo) == brdfcheck.BinomialPower(20.0, 4)(wi, wo)
    family = brdfcheck.load("binomial-power-half", k=(4, 4))
    assert (family.ranges, family.held) == ({"n": (1.0, 1000.0)}, {"k": 4})
    np.testing.assert_allclose(family.build(n=20.0)(wi, wo), lobe(wi, wo) * (20 + 7.2427) / 26.1702, rtol=1e-12)
    for bounds in ((2, 8), (2.5, 2.5)):
        with pytest.raises(UsageError, match=r"binomial-power-half: k is a whole number: give one, as in --over k=2; got 2"):
            brdfcheck.load("binomial-power-half", k=bounds)
    for name, parameter, value in (("binomial-power-half", "q", 2), ("binomial-power-half", "k", 3), ("Lyon", "w", 40)):
        with pytest.raises(UsageError) as door:
            brdfcheck.load(name, n=(1, 10), **{parameter: (value, value)})
        with pytest.raises(UsageError) as sweep:
            Plan(parse({"brdf": name, "axes": {**GOOD["axes"], parameter: [value]}}))
        assert str(sweep.value) == f"config: axes: {door.value}"
