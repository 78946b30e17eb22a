"""Tables of renderers, read however they lie."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from _instruments import published
from brdfcheck import GGX, albedo
from brdfcheck.messages import UsageError


@pytest.mark.slow  # an instrument of studies
def test_a_table_is_read_however_it_lies(tmp_path: Path) -> None:
    true = published.exact(8, "ends", True, "smith-separable", 1.0)
    lost = np.rint((1 - true.T) * 65535).astype(int)
    body = ", ".join(map(str, lost.ravel()))
    (tmp_path / "data.h").write_text(
        f"/* 3 tables */\nstatic const int n[2] = {{ 4, 4 }};\nint lost[64] = {{ // {{\n{body} }};\n"
    )
    found = published.of_file(f"{tmp_path}/data.h#lost")
    assert found["largest"] <= 0.51 / 65535
    assert found["off"] == [0, 0, 0, 0]
    assert found["reading"] == "nodes at ends, roughness, across, smith-separable, 1 - E"
    wrong = published.exact(8, "centres", True, "smith-correlated", 1.0)[::-1].copy()
    wrong[2, 5] += 0.02
    np.save(tmp_path / "E.npy", wrong)
    found = published.of_file(f"{tmp_path}/E.npy")
    assert (found["off"], round(found["largest"], 9)) == ([1, 1, 1, 0], 0.02)
    assert (found["roughness"], found["cos_theta"]) == (5.5 / 8, 5.5 / 8)


@pytest.mark.slow  # an instrument of studies
def test_filaments_method_converges_and_its_rows_lie_a_texel_off() -> None:
    mu = np.array([0.1, 0.9])
    exact = np.array([float(albedo(GGX(0.5), cosine).value) for cosine in mu])
    few, many = (np.abs(published._by_half_vectors(0.5, mu, count) - exact) for count in (2**7, 2**14))
    assert np.all(many < 1e-4)
    assert np.max(few) > 10 * np.max(many)
    own, texels = published.sampled(16, 4096)
    assert own["largest"] < 0.01
    assert texels["largest"] > 5 * own["largest"]


@pytest.mark.parametrize(
    ("text", "spec", "said"),
    [
        ("1, 2, 3", "a.h", "a.h holds no square table of numbers"),
        ("float a[64] = {" + "0.5f, " * 64 + "};", "a.h#b", "holds no square table of numbers called b"),
        ("", "b.h", "there is no file"),
    ],
)
def test_a_file_without_a_table_is_one_line(tmp_path: Path, text: str, spec: str, said: str) -> None:
    (tmp_path / "a.h").write_text(text)
    with pytest.raises(UsageError, match=said):
        published.square_table(f"{tmp_path}/{spec}")
