"""The furnace in float32 against float64, and its sharpest lobes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from selection import few

from brdfcheck.brdf import catalog
from brdfcheck.brdf.base import AbstractZonalLobe
from brdfcheck.quadrature.albedo import albedo
from brdfcheck.scene.furnace import directional_albedo

EXPONENTS = (0.01, 1.0, 100.0, 1e4, 1e5)
NAMES = [entry.name for entry in catalog.entries() if "n" in entry.family.ranges]


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_lobes_about_an_axis_keep_four_digits_in_float32(name):
    family = catalog.entry(name).family
    low, high = family.ranges["n"]
    n = np.array([value for value in EXPONENTS if low <= value <= high])
    cosine = np.array([0.05, 0.3, 0.7, 0.99, 0.9999, 0.999999, 1.0])
    assert isinstance(family.build(n=1.0).core, AbstractZonalLobe)

    @jax.jit
    def albedo(n, mu):
        return jax.lax.map(lambda one: directional_albedo(family.build(n=one), mu), n)

    single, double = (np.asarray(albedo(jnp.asarray(n, t), jnp.asarray(cosine, t))) for t in (jnp.float32, jnp.float64))
    assert single.dtype == np.float32
    np.testing.assert_allclose(single, double, rtol=1e-4, atol=1e-4)


def test_the_integral_is_compiled_once_whatever_the_number_of_pixels():
    brdf = catalog.entry("blinn-phong").family.build(n=20.0)
    programs = [
        str(jax.make_jaxpr(lambda mu: directional_albedo(brdf, mu))(jnp.linspace(0.1, 1, count))) for count in (8, 1001)
    ]
    assert programs[0].count("atan2") == programs[1].count("atan2") > 0  # no second program for a last, smaller batch


VALIDATED = [entry.name for entry in catalog.entries() if entry.validated]


@pytest.mark.parametrize("name", few(VALIDATED, ("phong", "thin-sheet", "dielectric", "ggx")))
def test_a_furnace_shows_the_albedo(name):
    """Of what transmits from either side: what it sends out of light from there, which need not be reciprocal."""
    family = catalog.entry(name).family
    cosine = np.cos(np.radians([0.0, 30.0, 60.0, 80.0, 89.0]))
    middle = {key: (low * high) ** 0.5 if low > 0 else (low + high) / 2 for key, (low, high) in family.ranges.items()}
    for below in (0.0, 1.0) if "below" in middle else (0.0,):
        brdf = family.build(**middle | ({"below": below} if "below" in middle else {}))
        wanted = albedo(brdf, cosine).value
        np.testing.assert_allclose(directional_albedo(brdf, jnp.asarray(cosine)), wanted, rtol=0, atol=1e-5)
