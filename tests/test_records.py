"""Files: strict JSON, valid JUnit XML, annotations, and writing as a whole or not at all."""

from __future__ import annotations

import dataclasses
import json
import math
import os
import stat
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shared import strict_json

from brdfcheck.output import records
from brdfcheck.verdict import Report, Verdict
from brdfcheck.verdict.parts import SideChecks, Witness

SIDE = SideChecks(
    0.5,
    -0.1,
    2,
    10,
    False,
    False,
    Witness((3.0,), (0.6, 0.0, 0.8), (0.0, 0.0, 1.0), 0.25, 0.5),
    Witness((3.0,), (0.0, 0.6, 0.8), (0.0, 0.0, 1.0), -0.1),
    Witness((1.0,), (0.0, 0.0, 1.0), (0.0, 0.0, 1.0), math.nan),
)
REPORT = Report(
    name="mine.py:lobe",
    verdict=Verdict.VIOLATES,
    albedo=1.25,
    error=1e-12,
    parameters={"n": 3.0},
    cos_theta=0.5,
    azimuth=0.0,
    tolerance=1e-9,
    ranges={"n": (1.0, 10.0)},
    above=((2.0, 4.0),),
    side=SIDE,
    engine="zonal",
    anisotropic=False,
    evaluations=1234,
    seconds=0.5,
    findings=("negative: the smallest value seen is -0.1 / sr",),
    notes=("a note",),
    basis="search",
    points=12_288,
    climbs=42,
    settled=True,
    width={"n": 1e-4, "angle": 0.25, "cell": 0.02},
    channel=1,
    channels=3,
    effort="thorough",
)
UNBOUNDED = dataclasses.replace(
    REPORT,
    albedo=math.inf,
    error=math.inf,
    unbounded="towards grazing incidence",
    settled=False,
    width={},
    channel=None,
    channels=1,
    side=dataclasses.replace(SIDE, unequal=None, lowest=None, broken=None),
)
BROKEN = dataclasses.replace(
    REPORT,
    name="broken",
    verdict=Verdict.UNDECIDED,
    albedo=math.nan,
    error=math.inf,
    cos_theta=math.nan,
    parameters={},
    above=None,
    side=None,
    findings=('raised \x00\x1b[31m <tag> & "quotes" ]]> \ud800',),
)


def read_back(value: Any) -> Any:
    """What JSON has as "NaN" and "Infinity" is a number again, wherever it stands."""
    if isinstance(value, dict):
        return {key: read_back(part) for key, part in value.items()}
    if isinstance(value, list):
        return tuple(map(read_back, value))
    return float(value) if value in ("NaN", "Infinity", "-Infinity") else value


@pytest.mark.parametrize("report", [REPORT, BROKEN, UNBOUNDED], ids=["report", "broken", "unbounded"])
def test_a_report_survives_strict_json(report: Report) -> None:
    text = records.to_json(records.to_json_object(report))
    back = read_back(strict_json(text))
    fields = dataclasses.asdict(report) | {"verdict": report.verdict.name}
    for name in set(fields) - {"side"}:
        assert repr(back[name]) == repr(fields[name])
    if report.side is not None:
        side = dataclasses.asdict(report.side)
        assert repr({name: back["side"][name] for name in side}) == repr(side)


def test_json_holds_every_field_of_a_report() -> None:
    record = records.to_json_object(REPORT)
    assert set(record) >= {field.name for field in dataclasses.fields(Report)}
    assert set(record["side"]) == {field.name for field in dataclasses.fields(SideChecks)} | {"passed"}
    for name in ("unequal", "lowest", "broken"):
        assert set(record["side"][name]) == {field.name for field in dataclasses.fields(Witness)}
    assert record["verdict"] == "VIOLATES"
    assert record["angle_degrees"] == pytest.approx(60)


def test_what_has_no_form_in_json_is_refused() -> None:
    with pytest.raises(TypeError, match="object has no form in JSON"):
        records.plain({"a": [object()]})
    assert records.plain({"a": np.float32(0.5), 2: (np.arange(3), True, None, Verdict.CONSERVES)}) == {
        "a": 0.5,
        "2": [[0, 1, 2], True, None, "CONSERVES"],
    }


@given(st.floats())
def test_numbers_come_back_from_json(value: float) -> None:
    text = json.dumps(records.number(value), allow_nan=False)
    back = float(json.loads(text))
    assert back == value or (math.isnan(back) and math.isnan(value))


def test_a_document_states_schema_versions_settings_and_device() -> None:
    record = records.document("check", [records.to_json_object(REPORT)], settings={"rtol": None}, summary={"violate": 1})
    assert (record["schema"], record["schema_version"]) == (records.SCHEMA, records.SCHEMA_VERSION)
    assert {"brdfcheck", "jax", "numpy", "python"} <= set(record["versions"])
    assert record["device"]["platform"] in ("cpu", "gpu", "cuda", "tpu", "METAL")
    assert record["settings"] == {"rtol": None}
    strict_json(records.to_json(record))


def test_junit_xml_is_valid_whatever_a_finding_holds() -> None:
    good = dataclasses.replace(REPORT, name="good", verdict=Verdict.CONSERVES, findings=())
    messages = ["bad <&>", "broken \x00 \x1b", "fine"]
    text = records.to_junit([REPORT, BROKEN, good], messages, seconds=1.5, classnames=["user", "user", "catalog"])
    root = ElementTree.fromstring(text.encode())
    assert root.tag == "testsuites"
    suite = root.find("testsuite")
    assert suite is not None
    assert (suite.get("tests"), suite.get("failures"), suite.get("errors")) == ("3", "1", "1")
    cases = {case.get("name"): case for case in suite.findall("testcase")}
    failure = cases["mine.py:lobe"].find("failure")
    assert failure is not None
    assert (failure.get("type"), failure.get("message")) == ("VIOLATES", "bad <&>")
    assert cases["broken"].find("error") is not None
    assert cases["good"].find("failure") is None


@given(st.text())
def test_any_text_becomes_xml(text: str) -> None:
    element = ElementTree.Element("a")
    element.text = records.xml_text(text)
    ElementTree.fromstring(ElementTree.tostring(element, encoding="utf-8"))


def test_github_lines_are_escaped() -> None:
    line = records.github_error("a: b, c", "50% of\nlines", file="x,y.py", line=3)
    assert line == "::error file=x%2Cy.py,line=3,title=a%3A b%2C c::50%25 of%0Alines"
    assert records.github_error("t", "m") == "::error title=t::m"


def test_files_are_written_whole(tmp_path: Path) -> None:
    path = tmp_path / "out.json"
    records.write_atomically(path, "first")
    path.chmod(0o640)
    records.write_atomically(str(path), "second\n")
    assert path.read_text() == "second\n"
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert os.listdir(tmp_path) == ["out.json"]


def test_a_failed_write_leaves_nothing_new(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "out.json"
    path.write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full)
    with pytest.raises(OSError, match="No space left"):
        records.write_atomically(path, "new")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["out.json"]


def test_a_link_keeps_pointing_to_its_file(tmp_path: Path) -> None:
    (tmp_path / "real.json").write_text("old")
    (tmp_path / "link.json").symlink_to(tmp_path / "real.json")
    records.write_atomically(tmp_path / "link.json", "new")
    assert (tmp_path / "link.json").is_symlink()
    assert (tmp_path / "real.json").read_text() == "new"


def test_devices_are_written_to_not_replaced() -> None:
    assert records.refuse_output(os.devnull) is None
    records.write_atomically(os.devnull, "text")
    assert stat.S_ISCHR(os.stat(os.devnull).st_mode)


def test_outputs_are_refused_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    for path, reason in (
        ("", "empty"),
        (str(tmp_path), "folder"),
        (f"{tmp_path}/new/", "folder"),
        (f"{tmp_path}/missing/out.json", "does not exist"),
        (f"{tmp_path}/file/out.json", "not a folder"),
        (f"{tmp_path}/{'x' * 300}", "too long"),
    ):
        assert reason in (records.refuse_output(path) or "accepted"), path
    for path in ("new.json", "file", "dangling"):
        assert records.refuse_output(str(tmp_path / path)) is None
    assert sorted(os.listdir(tmp_path)) == ["dangling", "file"]


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_read_only_places_are_refused(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    try:
        assert records.refuse_output(str(tmp_path / "out.json")) is not None
    finally:
        tmp_path.chmod(0o700)
