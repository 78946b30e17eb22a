"""Floors and targets: what is counted, what is said of a record."""

from __future__ import annotations

import numpy as np
import pytest

from _instruments import limits

pytestmark = pytest.mark.slow  # an instrument of studies
TIMES = {"multiply-add": 0.1, "division": 0.5, "exp": 1.0}


def record(**changes):
    path = {"path": "table of phong", "cells": 90_000, "exps": 30.0, "one_core": 30.0, "all_cores": 16.0}
    metal = {"path": "metal", "cells": 1024, "error": 5e-10, "one_core": 60_000.0, "all_cores": 32_000.0}
    summary = {"gain": 1.95, "peer": {"seconds": 2.6, "error": 6.9e-9}, "accelerator": []}
    return {"results": [path, metal], "settings": {"cores": 2}, "summary": {**summary, **changes}}


def test_targets_are_met_or_missed():
    assert [row[2] for row in limits.targets(record())] == ["met", "met", "met"]
    assert [row[2] for row in limits.targets(record(gain=2.2))] == ["met", "missed", "met"]
    assert [row[2] for row in limits.targets(record(peer={"seconds": 1.0, "error": 6.9e-9}))] == ["met", "met", "missed"]
    close = record(peer={"seconds": 2.6, "error": 1e-9})  # no setting has a tenth of that error
    assert limits.targets(close)[-1][1:] == ("1/0", "missed")
    slow = record()
    slow["results"][0]["exps"] = 41.0
    assert limits.targets(slow)[0][1:] == ("41", "missed")


def test_floors():
    assert limits.unit("phong", TIMES) == 1.0
    assert limits.unit("schlick-mirror", TIMES) == 0.5
    assert limits.unit("binomial-power-half", TIMES) == pytest.approx(0.6)  # four squarings, no exp
    found = limits.zonal("binomial-power-half", np.geomspace(1, 50, 20), np.array([0.3, 0.9]), TIMES, 1)
    assert found["floor"] == pytest.approx(0.6 * found["evaluations"])
    assert found["exps"] == found["one_core"]
    metal = limits.facets("metal", limits.METAL, np.array([0.2, 0.6]), 1.0, 1, 1e-4)
    assert metal["floor"] == metal["evaluations"] > 1000
    assert "error" not in metal
