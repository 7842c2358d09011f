"""Fixtures for tests of drivers: what a test sees, reset between tests, one server a worker."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[1] / "docs" / "pytest.md"
TESTS = """
import pytest, pyvisa

@pytest.fixture(scope="session")
def dmm(simrack_server):
    manager = pyvisa.ResourceManager("@py")
    dmm = manager.open_resource(simrack_server.place("dmm", "tcp"), timeout=30_000)
    dmm.read_termination = dmm.write_termination = "\\n"
    yield dmm
    manager.close()

def test_reads(simrack, dmm):
    assert "inst0" in simrack["gen"]
    simrack.set("node.input", 1.25)
    assert float(dmm.query("MEAS:VOLT:DC?")) == pytest.approx(1.25, abs=1e-4)
    dmm.write("CONF:RES")
    simrack.fault("dmm", "identity", identity="A,B,C,D")
    assert dmm.query("*IDN?") == "A,B,C,D"

def test_is_as_new_on_the_same_connection(simrack, dmm):
    assert simrack.get("node.input") == 0.0
    assert dmm.query("FUNC?") == '"VOLT"'
    assert "34401A" in dmm.query("*IDN?")

def test_names_what_there_is(simrack):
    with pytest.raises(KeyError, match="only dmm, gen"):
        simrack["scope"]
    with pytest.raises(KeyError, match="not on 'hislip'"):
        simrack.place("dmm", "hislip")
"""


def ran(folder: Path, tests: str, *options: str) -> str:
    (folder / "pytest.ini").write_text("[pytest]\nsimrack = dmm=34401A gen=33220A\n")
    (folder / "test_driver.py").write_text(tests)
    words = [sys.executable, "-m", "pytest", "-q", "-p", "simrack.pytest_plugin", *options]
    alone = {**os.environ, "PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1"}
    return subprocess.run(words, cwd=folder, env=alone, capture_output=True, text=True, check=False).stdout  # noqa: S603


def test_rack_is_served_and_reset_between_tests(tmp_path: Path) -> None:
    assert "3 passed" in ran(tmp_path, TESTS)


@pytest.mark.exhaustive
def test_each_worker_has_a_server_of_its_own(tmp_path: Path) -> None:
    said = ran(tmp_path, TESTS + TESTS.replace("def test_", "def test_again_"), "-p", "xdist.plugin", "-n", "2")
    assert "6 passed" in said


def test_the_tests_of_the_page_pass(tmp_path: Path) -> None:
    pytest.importorskip("pymeasure")
    (tests,) = re.findall(r"^```python ci\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    assert "2 passed" in ran(tmp_path, tests)
