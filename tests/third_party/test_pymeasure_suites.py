"""PyMeasure's own suites for connected devices, from its source distribution, against a served pty or VXI-11."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path  # fixtures are annotated with it
from xml.etree import ElementTree as ET

import pytest

from tests.ports import free_port
from tests.third_party.conftest import Served, command, expected_failures, serving

RACK = Path(__file__).parents[2] / "simrack"


def outcomes(python: Path, source: Path, suite: str, address: str, report: Path) -> dict[str, bool]:
    """Run a suite; return for every test whether it passed."""
    command(
        python, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:warnings", "--rootdir", source,
        "--junit-xml", report, "--device-address", address, suite,
    )  # fmt: skip
    cases = ET.parse(report).getroot().iter("testcase")  # noqa: S314  # our own pytest wrote it
    return {str(case.get("name")): case.find("failure") is None and case.find("error") is None for case in cases}


def check(seen: dict[str, bool], suite: str, at_least: int) -> None:
    failed = {name for name, passed in seen.items() if not passed}
    assert len(seen) >= at_least
    assert failed == set(expected_failures(suite)), f"{len(seen) - len(failed)} of {len(seen)} passed"


@pytest.mark.parametrize(
    ("role", "suite", "at_least"),
    [
        ("multimeter", "hp/test_hp34401a_with_device.py", 108),
        ("power", "keysight/test_keysightE3631A_with_device.py", 34),
        ("rate_source", "keysight/test_keysight33250A_with_device.py", 6),
    ],
)
def test_suite_on_a_pty(  # noqa: PLR0917  # fixtures
    role: str, suite: str, at_least: int, pymeasure: Path, pymeasure_source: Path, served: Served, tmp_path: Path
) -> None:
    path = pymeasure_source / "tests" / "instruments" / suite
    seen = outcomes(pymeasure, path.parents[2], str(path), served.resource(role, "pty"), tmp_path / "report.xml")
    check(seen, suite, at_least)


def test_suite_of_the_dmm6500(pymeasure: Path, pymeasure_source: Path, tmp_path: Path) -> None:
    """Its author's meter has mains of 60 Hz."""
    suite = "keithley/test_keithleyDMM6500_with_device.py"
    path = pymeasure_source / "tests" / "instruments" / suite
    with serving({"multimeter": "DMM6500"}, mains_hz=60) as served:
        address = served.resource("multimeter", "vxi11")
        seen = outcomes(pymeasure, path.parents[2], str(path), address, tmp_path / "report.xml")
    check(seen, suite, 160)


@pytest.mark.parametrize(("bench", "listed"), [("served", ""), ("served_successors", " on a DSOX3024A")])
def test_suite_of_the_small_oscilloscope(  # noqa: PLR0917  # fixtures
    bench: str, listed: str, pymeasure: Path, pymeasure_source: Path, tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    """The DSOX1102G suite has its address in its text and skips itself: both lines are replaced in a copy.

    So is the list of images: PyMeasure reads byte by byte, which takes six minutes for the 2.4 MB of a bitmap.
    """
    served: Served = request.getfixturevalue(bench)
    suite = "keysight/test_keysightDSOX1102G_with_device.py"
    text = (pymeasure_source / "tests" / "instruments" / suite).read_text(encoding="utf-8")
    address = served.resource("oscilloscope", "vxi11")
    text = re.sub(r"(?m)^pytest\.skip\(.*$", "", text)
    text = re.sub(r"(?m)^(\s+RESOURCE = ).*$", lambda match: f"{match[1]}{address!r}", text)
    text = text.replace('["bmp", "bmp8bit", "png"]', '["png"]')
    copy = tmp_path / "test_dsox1102g.py"
    copy.write_text(text, encoding="utf-8")
    (tmp_path / "conftest.py").write_text(
        (pymeasure_source / "tests" / "conftest.py").read_text(encoding="utf-8"), encoding="utf-8"
    )
    check(outcomes(pymeasure, tmp_path, str(copy), address, tmp_path / "report.xml"), f"{suite}{listed}", 137)


def test_suite_of_the_33500b(
    pymeasure: Path, pymeasure_source: Path, served_successors: Served, tmp_path: Path
) -> None:
    """The suite has its address in its text and skips itself: both lines are replaced in a copy."""
    suite = "agilent/test_agilent33500_with_device.py"
    text = (pymeasure_source / "tests" / "instruments" / suite).read_text(encoding="utf-8")
    address = served_successors.resource("rate_source", "vxi11")
    text = re.sub(r"(?m)^pytest\.skip\(.*$", "", text)
    text = re.sub(r"Agilent33500\(\"[^\"]*\"\)", lambda _: f"Agilent33500({address!r})", text)
    copy = tmp_path / "test_33500.py"
    copy.write_text(text, encoding="utf-8")
    (tmp_path / "conftest.py").write_text(
        (pymeasure_source / "tests" / "conftest.py").read_text(encoding="utf-8"), encoding="utf-8"
    )
    check(outcomes(pymeasure, tmp_path, str(copy), address, tmp_path / "report.xml"), suite, 395)


def test_the_script_of_the_readme_of_the_rack(pymeasure: Path, tmp_path: Path) -> None:
    """Its ports follow the one that is asked for."""
    script, example = tmp_path / "response.py", RACK / "examples" / "rc_filter.py"
    first = free_port()
    text = (RACK / "examples" / "response.py").read_text(encoding="utf-8")
    script.write_text(text.replace("5903", str(first + 3)).replace("5904", str(first + 4)), encoding="utf-8")
    words = ["-m", "simrack", "serve", str(example), "--speed", "max", "--port", str(first)]
    with subprocess.Popen([sys.executable, *words], stdout=subprocess.PIPE, text=True, cwd=RACK) as server:  # noqa: S603
        try:
            assert "RC low-pass" in str(server.stdout and server.stdout.readline())
            done = command(pymeasure, script)
        finally:
            server.terminate()
    assert [float(line.split()[-1]) for line in done.stdout.splitlines()] == [0.998, 0.847, 0.157], done.stderr
