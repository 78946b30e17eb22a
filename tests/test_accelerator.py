"""Batches on an accelerator run without change and give the numbers of the CPU; skipped where there is none."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from brdfcheck import GGX, BlinnPhong, KuijkBlake, Lyon, albedo_table


def devices() -> list[jax.Device]:
    return [device for device in jax.devices() if device.platform != "cpu"]


@pytest.mark.gpu
@pytest.mark.skipif(not devices(), reason="no accelerator")
@pytest.mark.parametrize(("dtype", "tolerance"), [(jnp.float64, 1e-11), (jnp.float32, 1e-4)], ids=["float64", "float32"])
@pytest.mark.parametrize("family", [BlinnPhong, lambda n: Lyon(n, 2), KuijkBlake, lambda n: GGX(1 / (1 + n))])
def test_tables(family, dtype, tolerance):
    n, mu = np.geomspace(1, 300, 70), jnp.linspace(0.05, 1, 12, dtype=dtype)
    with jax.default_device(devices()[0]):
        there = albedo_table(family, n, mu)
    with jax.default_device(jax.devices("cpu")[0]):
        here = albedo_table(family, n, mu)
    assert there.value.dtype == dtype
    np.testing.assert_allclose(there.value, here.value, rtol=tolerance)
