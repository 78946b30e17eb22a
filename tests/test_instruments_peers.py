"""Other people's integrators: the same signature, a message where they are missing, honest statuses, known failures."""

from __future__ import annotations

import jax
import numpy as np
import pytest

from _instruments.peers import PEERS, mitsuba_peer, peer
from brdfcheck.brdf.lobes import BlinnPhong
from brdfcheck.brdf.microfacet import GGX, CookTorrance
from brdfcheck.quadrature import rule as rules
from brdfcheck.quadrature.albedo import albedo

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("default")]  # what peers say while they are imported is theirs
KEY = jax.random.key(3)
OTHERS = [name for name in PEERS if not name.startswith("scipy")]
NEEDLE = CookTorrance(1 / 64, masking="smith-separable")


def _available(name: str):
    message = PEERS[name].missing()
    if message is not None:
        pytest.skip(message)
    return PEERS[name]


def test_registry():
    assert {found.package for found in PEERS.values()} == {"scipy", "quadax", "torchquad", "mitsuba"}
    for name, found in PEERS.items():
        assert found.name == name
        assert [found(setting).setting for setting in found.ladder] == list(found.ladder)


@pytest.mark.parametrize("name", OTHERS)
def test_a_missing_package_is_named(name, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda package: None)
    message = PEERS[name].missing()
    assert message == f"{PEERS[name].package} is not installed: pip install 'brdfcheck[peers]'"


@pytest.mark.parametrize("name", [name for name in PEERS if name.startswith("scipy")])
def test_scipy(name):
    rule = _available(name)(1e-4)
    lobe = BlinnPhong(10.0)
    found = rule(lobe, 0.7)
    expected = float(albedo(lobe, 0.7).value)
    assert float(found.value) == pytest.approx(expected, rel=1e-6)
    assert abs(float(found.value) - expected) <= float(found.error) + 1e-12
    assert int(found.status) == rules.OK
    # The needle is missed with a small claimed error: the reason why this package exists.
    missed = rule(NEEDLE, 1 / 64)
    assert abs(float(missed.value) - float(albedo(NEEDLE, 1 / 64).value)) > 0.9
    assert float(missed.error) < 1e-3


def test_scipy_evaluations_are_counted_and_bounded(monkeypatch):
    rows: list[int] = []

    def function(wi, wo):
        wo = np.array(wo)  # numpy: every call is seen
        rows.append(len(wo))
        return np.where(wo[..., 0] > 0.123, 1.0, 0.0)

    found = PEERS["scipy-cubature"](1e-2)(function, 0.5)
    assert sum(count for count in rows if count > 3) == int(found.evaluations)
    monkeypatch.setattr(peer, "MAX_EVALUATIONS", 500)
    for name in ("scipy-quad", "scipy-dblquad", "scipy-cubature"):
        stopped = PEERS[name](1e-8)(function, 0.5)
        assert int(stopped.status) in (rules.NOT_REACHED, rules.NOT_FINITE)
        assert np.isinf(stopped.error)
        assert int(stopped.evaluations) <= 500


@pytest.mark.peers
@pytest.mark.parametrize("name", [name for name in OTHERS if name != "mitsuba"])
def test_other_integrators(name):
    made = _available(name)
    rule = made(1e-6) if made.ladder[0] < 1 else made(64)
    lobe = BlinnPhong(10.0)
    found = rule(lobe, 0.7)
    assert float(found.value) == pytest.approx(float(albedo(lobe, 0.7).value), rel=1e-6)
    assert int(found.evaluations) > 500
    missed = rule(NEEDLE, 1 / 64)
    assert abs(float(missed.value) - float(albedo(NEEDLE, 1 / 64).value)) > 0.9


@pytest.mark.peers
def test_mitsuba():
    rule = _available("mitsuba")(2**12)
    metal = CookTorrance(0.4, masking="smith-separable")
    found, again = rule(metal, 0.5, key=KEY), rule(metal, 0.5, key=KEY)
    assert found.value == again.value
    # Its Beckmann masking is a rational fit, good to about 1 %.
    assert float(found.value) == pytest.approx(float(albedo(metal, 0.5).value), abs=0.01 + 4 * float(found.error))
    assert mitsuba_peer.variant()[0] in ("llvm_ad_rgb", "scalar_rgb")


def test_mitsuba_takes_what_it_can_compare():
    rule = PEERS["mitsuba"]()
    assert rule.takes(CookTorrance(0.4, masking="smith-separable"))
    assert rule.takes(GGX(0.4, masking="smith-separable"))
    for other in (BlinnPhong(3.0), CookTorrance(0.4), CookTorrance(0.4, 0.5, masking="smith-separable"), GGX(0.4)):
        assert not rule.takes(other)
    with pytest.raises(ValueError, match="draws at random"):
        rule(CookTorrance(0.4, masking="smith-separable"), 0.5)
