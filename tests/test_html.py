"""The page of a report: what it says, that it holds all it needs, and that its script does what it should."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import os
import re
import shutil
import subprocess
from math import nan
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import brdfcheck
from brdfcheck.brdf import catalog
from brdfcheck.brdf.family import Family
from brdfcheck.brdf.subject import load
from brdfcheck.cli.output import has_display
from brdfcheck.fits.slices import AZIMUTH, Axis, Slices, slices
from brdfcheck.output.html import Entry, heading, page
from brdfcheck.output.html.tables import NO_VALUE, encoded, squeezed, table_object
from brdfcheck.sweep.pages import sweep_page
from brdfcheck.verdict import Report, Verdict
from brdfcheck.verdict.parts import Check, SideChecks, Witness

NODE = shutil.which("node")
HOSTILE = "</script><script>alert(\"1\")</script><b title='x'>&"
UNEQUAL = Witness((3.0,), (0.6, 0.0, 0.8), (0.0, 0.0, 1.0), 0.25, 0.5)
SIDE = SideChecks(0.5, 0.1, 0, 10, False, True, unequal=UNEQUAL)


def report(name: str, **more: Any) -> Report:
    usual: dict[str, Any] = {
        "verdict": Verdict.VIOLATES,
        "ranges": {"n": (1.0, 1000.0)},
        "albedo": 1.0016005217,
        "error": 1e-14,
        "least": 1.0016,
        "parameters": {"n": 17.8512},
        "cos_theta": 1.0,
        "basis": "search",
        "points": 100,
        "settled": True,
    }
    return Report(name=name, **{**usual, **more})


@pytest.fixture(scope="module")
def published() -> Slices:
    """A violation of 0.16 % in a small part of the range."""
    return slices(catalog.entry("binomial-power-published").family, {"n": 17.8512}, 1.0, cells=3072)


@pytest.fixture(scope="module")
def text(published: Slices) -> str:
    failed = Check("reciprocal", 0.5, False, "not reciprocal at <this> pair")
    entries = [
        Entry("good", None, report("good", verdict=Verdict.CONSERVES, albedo=0.5, least=0.5, basis="theorem")),
        Entry(HOSTILE, published, report(HOSTILE, side=SIDE, checks=(failed,), findings=(failed.words,), notes=(HOSTILE,))),
        Entry("bare", None, report("bare", verdict=Verdict.UNDECIDED, albedo=nan, cos_theta=nan, basis="none")),
    ]
    return page(entries, heading=heading([entry.report for entry in entries if entry.report is not None]), lines=["a line"])


# --- slices ---


def test_slices_hold_the_albedo_and_the_place(published: Slices) -> None:
    rows, angles, table = published.rows, published.angles, published.tables[()][0]
    assert table.shape == (48, 64)
    assert rows.values[rows.at] == 17.8512
    assert angles.values[angles.at] == 0
    assert (rows.values[0], rows.values[-1], angles.values[-1]) == (1, 1000, 90)
    assert np.all(np.diff(rows.values) > 0)
    assert table[rows.at, angles.at] == table.max() == pytest.approx(1.0016005216, abs=1e-9)
    family = catalog.entry("binomial-power-published").family
    for row, angle in ((0, 5), (20, 40), (47, 63)):
        mu = float(np.clip(np.cos(np.radians(angles.values[angle])), 0, 1))
        found = brdfcheck.albedo(family.build(n=float(rows.values[row])), mu)
        assert table[row, angle] == pytest.approx(float(found.value), abs=1e-7)
    assert published.errors[()] < 1e-6


def test_slices_of_many_parameters_move_one_at_a_time() -> None:
    def build(**parameters: Any) -> Any:
        return lambda wi, wo: sum(parameters.values()) / np.pi + 0 * wi[..., 2] * wo[..., 2]

    names = "abcdef"
    family = Family("sum", build, {name: (0.0, 1.0 if name < "e" else 2.0) for name in names}, switches=frozenset("f"))
    place = dict.fromkeys(names, 0.25) | {"f": 2.0}
    found = slices(family, place, 0.5, cells=3000)
    assert found.rows.name == "a"
    assert [axis.name for axis in found.others] == list("bcdef")
    assert list(found.others[-1].values) == [0, 2]
    middle = tuple(axis.at for axis in found.others)
    assert sum(table.size for table in found.tables.values()) < 4000
    assert all(sum(i != j for i, j in zip(key, middle, strict=True)) <= 1 for key in found.tables)
    assert {len({key[k] for key in found.tables}) for k in range(4)} == {3}
    for key, table in found.tables.items():
        held = sum(float(axis.values[index]) for axis, index in zip(found.others, key, strict=True))
        assert table[0] == pytest.approx(np.broadcast_to((found.rows.values + held)[:, None], table[0].shape), rel=2e-3)


def test_slices_of_an_anisotropic_function_turn() -> None:
    def brdf(wi: Any, wo: Any) -> Any:
        return (1 + 0.5 * wi[..., 0] * wo[..., 0] + 0.3 * wi[..., 0] ** 2) / np.pi

    found = slices(load(brdf), {}, 0.5, 1.0)
    assert found.rows.name == AZIMUTH
    assert found.rows.values[found.rows.at] == pytest.approx(np.degrees(1.0))
    theta, phi = np.radians(found.angles.values[40]), np.radians(found.rows.values)
    expected = 1 + 0.3 * (np.sin(theta) * np.cos(phi)) ** 2
    assert found.tables[()][0, :, 40] == pytest.approx(expected, abs=1e-3)


def test_codes_keep_small_excesses_and_poles() -> None:
    table = np.array([[0.0, 1.0, 1.0001], [1e6, np.nan, np.inf]])
    low, high = (float(bound) for bound in squeezed([0.0, 1e6]))
    codes = np.frombuffer(base64.b64decode(encoded(table, low, high)), "<u2").reshape(table.shape)
    assert np.array_equal(codes == NO_VALUE, ~np.isfinite(table))
    back = 1 + np.sinh(low + (high - low) * codes / (NO_VALUE - 1)) / 10
    assert back[0] == pytest.approx(table[0], abs=2e-4)
    assert back[0, 1:] == pytest.approx(table[0, 1:], abs=2e-5)
    assert back[1, 0] == pytest.approx(1e6, rel=2e-4)


def test_channels_that_agree_are_one(published: Slices) -> None:
    table = published.tables[()]

    def channels(*tables: np.ndarray) -> list[str]:
        return table_object(Slices(published.angles, published.rows, (), {(): np.concatenate(tables)}, {(): 0.0}), 0)[
            "channels"
        ]

    assert channels(table, table, table) == ["E"]
    assert channels(table, table, 0.9 * table) == ["red", "green", "blue"]


# --- what a page says ---


def test_a_page_says_what_was_found(text: str) -> None:
    assert "1 of 3 BRDFs does not conserve energy, 1 is undecided" in text
    for words in ("1.0016005217", "n=17.8512", "VIOLATES", "UNDECIDED", "CONSERVES", "search, 100 points", "a line"):
        assert words in text
    assert "not reciprocal at &lt;this&gt; pair" in text
    assert 'aria-label="wi at 36.9 degrees from the normal; wo at 0 degrees from the normal"' in text
    assert text.count("<article") == 3


def test_names_cannot_break_out(text: str) -> None:
    assert HOSTILE not in text
    assert html.escape(HOSTILE) in text
    assert text.count("<script") == text.count("</script>") == 2
    assert "alert(&quot;1&quot;)" in text


def test_a_page_runs_its_own_script_and_nothing_else(text: str) -> None:
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text)
    said = html.unescape(policy[1])
    for tag, kind in (("script", "script"), ("style", "style")):
        (inside,) = re.findall(rf"<{tag}>(.*?)</{tag}>", text, re.S)
        digest = base64.b64encode(hashlib.sha256(inside.encode()).digest()).decode()
        assert f"{kind}-src 'sha256-{digest}'" in said
    assert said.startswith("default-src 'none'; ")
    assert "unsafe" not in said
    # Nothing is loaded, and nothing is written that the policy would refuse.
    assert not re.findall(r"""\s(?:src|style|on\w+)=["']""", re.sub(r"<script.*?</script>", "", text, flags=re.S))
    assert not re.findall(r"https?://|url\(|@import|fetch\(|XMLHttpRequest|import\(|innerHTML|eval\(", text)


def test_headings() -> None:
    good = report("a", verdict=Verdict.CONSERVES, albedo=0.9, least=0.9)
    assert heading([good]) == "a conserves energy"
    assert heading([good, good]) == "All 2 BRDFs conserve energy"
    assert heading([report("a")]) == "a does not conserve energy"
    flawed = report("a", verdict=Verdict.CONSERVES, albedo=0.9, least=0.9, findings=("negative",))
    assert heading([flawed]) == "a conserves energy, but has defects"
    assert heading([report("a", known="a reason"), good]) == "1 of 2 BRDFs does not conserve energy"
    assert heading([report("a"), report("b"), flawed]) == "2 of 3 BRDFs do not conserve energy, 1 has other defects"


# --- the command line ---


def test_check_and_view_write_a_page(run: Any, here: Path) -> None:
    out = run.failed("view", "binomial-power-published", "blinn-phong-6", "--effort", "quick", "--no-open", "-o", "page.html")
    assert f"page.html: open it in a browser: {(here / 'page.html').as_uri()}" in out
    text = (here / "page.html").read_text()
    assert len(text.encode()) < 300_000
    assert "1 of 2 BRDFs does not conserve energy" in text
    assert '<li class="pill CONSERVES">1 conserves energy</li><li class="pill VIOLATES">1 violates it</li>' in text
    assert "brdfcheck check blinn-phong-6 --effort quick" in text
    (data,) = re.findall(r'<script type="application/json" id="data">(.*?)</script>', text, re.S)
    assert [entry["rows"]["name"] for entry in json.loads(data)] == ["n", "n"]


def test_a_page_of_what_cannot_be_evaluated(run: Any, here: Path) -> None:
    (here / "mine.py").write_text("def broken(wi, wo):\n    raise RuntimeError('<no>')\n")
    run.failed("check", "mine.py:broken", "--html", "page.html")
    text = (here / "page.html").read_text()
    assert "RuntimeError: &lt;no&gt;" in text
    assert "mine.py:broken is undecided" in text


def test_a_browser_is_opened_where_there_is_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert not has_display()
    monkeypatch.setenv("DISPLAY", ":0")
    assert has_display()


@pytest.mark.slow
def test_sweep_writes_a_page(run: Any, here: Path) -> None:
    (here / "config.toml").write_text(
        'brdf = ["phong-pdf", "binomial-power-published"]\n[axes]\nn = { geomspace = [1, 1000, 60] }\n'
        "cos_theta = { linspace = [0.1, 1, 5] }\n"
    )
    run.passed("sweep", "config.toml", "--out", "store", "--html", "page.html")
    text = (here / "page.html").read_text()
    entries = json.loads(re.findall(r'id="data">(.*?)</script>', text, re.S)[0])
    assert [len(entry["rows"]["values"]) for entry in entries] == [48, 48]
    assert [len(entry["angles"]["values"]) for entry in entries] == [5, 5]
    assert entries[1]["angles"]["values"] == sorted(entries[1]["angles"]["values"])
    import xarray

    with xarray.open_zarr(here / "store", chunks=None) as store:
        albedo = store["albedo"].sel(brdf="binomial-power-published")
        largest, where = float(albedo.max()), int(albedo.argmax(...)["n"])
    assert f"{largest:.10g}" in text
    at = entries[1]["rows"]["at"]
    assert entries[1]["rows"]["values"][at] == pytest.approx(float(albedo["n"][where]))
    codes = np.frombuffer(base64.b64decode(entries[1]["tables"][""][0]), "<u2").reshape(48, 5)
    values = 1 + np.sinh(entries[1]["low"] + (entries[1]["high"] - entries[1]["low"]) * codes / (NO_VALUE - 1)) / 10
    assert values[at, entries[1]["angles"]["at"]] == pytest.approx(largest, abs=1e-5)


@pytest.mark.filterwarnings("ignore")
def test_a_page_of_a_sweep_with_bars_without_end(tmp_path: Path) -> None:
    """A bar that is infinite is a number of the page, but for what is drawn as no number anyway; channels have tables each."""
    import xarray

    shape, dims = (3, 2, 4, 2), ("n", "k", "cos_theta", "channel")
    albedo, error = np.linspace(0.1, 2.4, 48).reshape(shape), np.full(shape, 1e-3)
    albedo[0, 0, 1] = np.nan
    error[0, 0, 1] = error[2, 1, 3, 0] = np.inf
    data = xarray.Dataset(
        {"albedo": (dims, albedo), "error": (dims, error)},
        {"n": [1.0, 10.0, 100.0], "k": [4, 8], "cos_theta": [0.4, 0.1, 1.0, 0.7]},
    )
    data.to_zarr(tmp_path / "s", consolidated=False, zarr_format=3)
    (entry,) = json.loads(re.findall(r'id="data">(.*?)</script>', sweep_page(tmp_path / "s"), re.DOTALL)[0])
    assert entry["errors"] == {"0": 1e-3, "1": 1e300}
    span = entry["high"] - entry["low"]
    for k, tables in entry["tables"].items():
        codes = np.stack([np.frombuffer(base64.b64decode(table), "<u2").reshape(3, 4) for table in tables], axis=-1)
        values = np.where(codes == NO_VALUE, np.nan, 1 + np.sinh(entry["low"] + span * (codes / (NO_VALUE - 1))) / 10)
        np.testing.assert_allclose(values, albedo[:, int(k)][:, [2, 3, 0, 1]], atol=1e-4)


# --- the script ---


def in_node(text: str, folder: Path, asked: list[str]) -> dict[str, Any]:
    """What happens on a page, and what expressions are in its script."""
    path = folder / "page.html"
    path.write_text(text, encoding="utf-8")
    command = [str(NODE), str(Path(__file__).with_name("dom.js")), str(path)]
    done = subprocess.run(command, input=json.dumps(asked), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.skipif(NODE is None, reason="node is not installed: the script of a page is not run")
def test_the_script(published: Slices, text: str, tmp_path: Path) -> None:
    object_ = table_object(published, 1e-9)
    ramp = [0.2 * column + 0.1 * row for row in range(3) for column in range(11)]
    scale = "{low: 0, high: 2, limit: 1}"
    middle = 4 * (20 * 40 + 20)
    rows = "{values: [0, 1, 2], position: [0, 0.5, 1]}"
    columns = json.dumps({"values": list(range(11)), "position": [k / 10 for k in range(11)]})
    asked = [
        f"decode({json.dumps(object_['tables'][''][0])}, {object_['low']}, {object_['high']})",
        "[locate([0, 1, 4], -1), locate([0, 1, 4], 2.5), locate([0, 1, 4], 9), locate([3], 3)]",
        f"contour({ramp}, 11, 1.05)",
        "contour([0, 0, 0, 0], 2, 1)",
        "[between(NaN, 2, 1), between(1, NaN, 0), between(1, 2, 0.25)]",
        f"[colour(1, {scale}), colour(1.01, {scale}), colour(NaN, {scale})]",
        'sortedOrder(["3", "", "-1", "Infinity", "b", "a"], false)',
        "ticks(0, 1, 4)",
        "axisTicks({name: 'angle', values: [0, 90], position: [0, 1]}, 6)",
        "axisTicks({name: 'n', values: [1, 10, 100, 1000], position: [0, 1/3, 2/3, 1]}, 4)",
        "Array.from(spherePixels(40, {values: [0, 90]}, [[1, 1]], 1.001, true)).filter((_, i) => i % 4 < 3)",
        f"Array.from(spherePixels(40, {{values: [0, 90]}}, [[1.1, 1.1]], 1.001, true)).slice({middle}, {middle + 3})",
        f"Array.from(heatPixels({ramp}, {rows}, {columns}, {scale}, 22, 30))",
        "[extent(Float64Array.from([3, 1, NaN, 2])), extent(Float64Array.from([...Array(99).keys(), 1e9])), extent([NaN])]",
        "sliceFor({tables: {'0,0': 1, '1,0': 1, '0,1': 1}, others: [{at: 0}, {at: 0}]}, [1, 1], 1)",
    ]
    found = in_node(text, tmp_path, asked)
    answers = found["answers"]
    assert np.array(answers[0]).reshape(48, 64) == pytest.approx(published.tables[()][0], abs=3e-5)
    assert answers[1] == [[0, 0], [1, 0.5], [1, 1], [0, 0]]
    for x0, y0, x1, y1 in answers[2]:  # the line 0.2 x + 0.1 y = 1.05
        assert (0.2 * x0 + 0.1 * y0, 0.2 * x1 + 0.1 * y1) == (pytest.approx(1.05), pytest.approx(1.05))
    assert {y for _, y0, _, y1 in answers[2] for y in (y0, y1)} >= {0, 1, 2}
    assert answers[3] == []
    assert answers[4] == [2, 1, 1.25]
    assert answers[5][0] == [240, 246, 240]
    assert answers[5][1][0] > 240 > answers[5][1][2] + 80
    assert answers[5][2] == [128, 128, 128]
    assert answers[6] == [2, 0, 3, 1, 5, 4]
    assert answers[7] == [0, 0.5, 1]
    assert answers[8] == [0, 15, 30, 45, 60, 75, 90]
    assert answers[9] == [1, 5, 10, 50, 100, 500, 1000]
    assert len(set(answers[10])) == 1, "a surface with E = 1 can be seen in the furnace"
    assert answers[11][0] > 200 > answers[11][1] + 80
    heat = np.array(answers[12]).reshape(30, 22, 4)
    gain = 0.2 * 10 * (np.arange(22) + 0.5) / 22 + 0.1 * 2 * (1 - (np.arange(30)[:, None] + 0.5) / 30) > 1
    assert np.array_equal(heat[..., 0] - heat[..., 2] > 40, gain), "warm above 1, cold up to it"
    assert np.all(heat[..., 3] == 255)
    assert answers[13][0] == {"least": 1, "high": 3, "cut": False}
    assert answers[13][1] == {"least": 0, "high": 2 * 94, "cut": True}, "a pole"
    assert answers[13][2] == {"least": 0, "high": 1, "cut": False}
    assert answers[14] == ["0,1", [0, 1]]
    # The page: it opens on what fails, at the largest albedo; sliders, pointer and keys move it; the table sorts; all is drawn
    # for the printer.
    assert found["ready"] == "ready"
    assert found["readout"] == found["home"] == "n = 17.851, angle 0.0\u00b0: E = 1.0016"
    assert [step["name"] for step in found["steps"]] == ["n", "angle"]
    assert all(step["readout"] != found["readout"] and step["back"] for step in found["steps"])
    assert found["steps"][0]["sphere"]
    assert found["pointer"].startswith("n = 1000, angle 90.0\u00b0: E = 0.")
    assert found["keyboard"].startswith("n = 1000, angle 81.0\u00b0")
    by_albedo = next(sort for sort in found["sorted"] if sort["head"] == "Largest albedo")
    assert by_albedo["rising"][0] == "good"
    assert by_albedo["rising"][-1] == "bare", "what has no albedo comes last"
    assert by_albedo["aria"] == "descending"
    assert found["drawn"] == 1
    assert {"0\u00b0", "45\u00b0", "90\u00b0", "1000"} <= set(found["texts"])


@pytest.mark.slow
@pytest.mark.skipif(NODE is None, reason="node is not installed: the script of a page is not run")
def test_the_script_with_channels_and_parameters_that_stand_still(tmp_path: Path) -> None:
    def axis(name: str, values: list[float], at: int) -> Axis:
        return Axis(name, np.array(values), np.linspace(0, 1, len(values)), at)

    def table(key: tuple[int, ...]) -> np.ndarray:
        base = 0.1 * key[0] + 0.01 * key[1] + np.linspace(0, 0.5, 6).reshape(2, 3)
        return np.stack([base, base + 0.1, base + 0.2])

    keys = [(1, 0), (0, 0), (2, 0), (1, 1)]  # one parameter at a time
    others = axis("k", [1.0, 2.0, 3.0], 1), axis("on", [0.0, 1.0], 0)
    held = Slices(
        axis("angle", [0.0, 45.0, 90.0], 2),
        axis("n", [1.0, 9.0], 0),
        others,
        {key: table(key) for key in keys},
        dict.fromkeys(keys, 0.0),
    )
    written = page([Entry("many", held, report("many"))], heading="x")
    found = in_node(written, tmp_path, [])
    assert "<dd>red 0.7000, green 0.8000, blue 0.9000</dd>" in written
    assert found["readout"] == "n = 1, k = 2, on = 0, angle 90.0\u00b0: E = 0.5000"
    assert found["options"] == ["largest of the channels", "red", "green", "blue"]
    moved = {step["name"]: step["readout"] for step in found["steps"]}
    assert moved["k"] == "n = 1, k = 1, on = 0, angle 90.0\u00b0: E = 0.4000"
    assert moved["on"] == "n = 1, k = 2, on = 1, angle 90.0\u00b0: E = 0.5100"
    assert moved["n"] == "n = 9, k = 2, on = 0, angle 90.0\u00b0: E = 0.8000"
    assert all(step["back"] and (step["sphere"] or step["name"] == "angle") for step in found["steps"])
    flat = Slices(held.angles, None, (), {(): np.full((1, 1, 3), 0.5)}, {(): 0.0})
    lone = in_node(page([Entry("flat", flat, report("flat"))], heading="x"), tmp_path, [])
    assert lone["readout"] == "angle 90.0\u00b0: E = 0.5000"
    assert [step["name"] for step in lone["steps"]] == ["angle"]


# --- a browser ---


def _browser() -> str | None:
    names = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
    return os.environ.get("BRDFCHECK_CHROMIUM") or next(filter(None, map(shutil.which, names)), None)


@pytest.mark.skipif(_browser() is None, reason="Chromium is not installed: the page is not opened in a browser")
def test_in_a_browser(text: str, tmp_path: Path) -> None:
    from browser import Browser

    path = tmp_path / "page.html"
    path.write_text(text, encoding="utf-8")
    with Browser(str(_browser()), tmp_path / "profile") as browser:
        browser.open(path.as_uri())
        readout = "document.querySelector('article.open .readout').textContent"
        pixels = "document.querySelector('article.open canvas.sphere').toDataURL()"
        wait = "new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        assert browser.run(readout) == "n = 17.851, angle 0.0\u00b0: E = 1.0016"
        before = browser.run(pixels)
        browser.run(
            "(() => { const slider = document.querySelector('article.open input[type=range]');"
            f" slider.value = '1'; slider.dispatchEvent(new Event('input')); return {wait}; }})()"
        )
        assert browser.run(readout).startswith("n = 1000, angle 0.0\u00b0: E = 0.96")
        assert browser.run(pixels) != before
        # What the policy does not allow does not run, whoever writes it.
        browser.run(
            "(() => { const other = document.createElement('script'); other.textContent = 'window.hacked = 1';"
            " document.body.append(other); })()"
        )
        assert browser.run("window.hacked === undefined")
        assert browser.requests == [path.as_uri()]
        assert [line for line in browser.complaints if "Content Security Policy" not in line] == []
