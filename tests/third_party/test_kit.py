"""The kit at instruments that nobody here simulated: it comes to its end, and the check finds what they have not.

None of the three is a real model; each is given the identity of one.
"""

from __future__ import annotations

import subprocess
from typing import TYPE_CHECKING

import pytest

from tests.third_party.conftest import command, install
from tests.third_party.test_driver_methods import CLIENTS
from vcfbench.testing.kit.check import Seen, checked
from vcfbench.testing.kit.write import written

if TYPE_CHECKING:
    from pathlib import Path


@pytest.fixture(scope="module")
def foreign(shared: Path) -> Path:
    """Interpreter of an environment with three simulators."""
    return install(shared, "pyvisa==1.16.2", "pyvisa-py==0.8.1", "pyvisa-sim==0.7.1", "instro==1.22.0", "sinstruments")


def seen(python: Path, folder: Path, resource: str, library: str) -> Seen:
    (folder / "kit.py").write_text(written(), "utf-8")
    done = command(python, folder / "kit.py", resource, "--library", library, "--output", folder / "a.trace")
    assert done.returncode == 0, done.stderr
    (found,) = checked(folder / "a.trace")
    return found


@pytest.mark.exhaustive  # minutes: a question that gets no answer takes 2 s
@pytest.mark.parametrize(("client", "model"), [("instro_meter.py", "34401A"), ("sinstruments_meter.py", "2000")])
def test_kit_records_served_instrument_and_finds_gaps(foreign: Path, tmp_path: Path, client: str, model: str) -> None:
    words = [str(foreign), str(CLIENTS / client), *(["HEWLETT-PACKARD,34401A,0,10-5-2"] if model == "34401A" else [])]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:  # noqa: S603
        assert server.stdout is not None
        try:
            port = int(server.stdout.readline())
            found = seen(foreign, tmp_path, f"TCPIP0::127.0.0.1::{port}::SOCKET", "@py")
        finally:
            server.terminate()
            server.wait(10)
    assert found.model == model
    assert found.findings[0].status == "same"  # *IDN?
    assert found.count("form", "error", "no answer") > 50
    assert found.count("unknown") == 0


def test_one_of_pyvisa_sim_is_recorded(foreign: Path, tmp_path: Path) -> None:
    (tmp_path / "rack.yaml").write_text(_YAML)
    found = seen(foreign, tmp_path, "GPIB0::22::INSTR", f"{tmp_path / 'rack.yaml'}@sim")
    assert (found.maker, found.model) == ("HEWLETT-PACKARD", "34401A")
    by_command = {each.command: each.status for each in found.findings}
    assert (by_command["*IDN?"], by_command["VOLT:RANG?"], by_command["TRIG:SOUR?"]) == ("same", "form", "same")


_YAML = """spec: "1.1"
devices:
  meter:
    eom:
      GPIB INSTR:
        q: "\\n"
        r: "\\n"
    error: ""
    dialogues:
      - {q: "*IDN?", r: "HEWLETT-PACKARD,34401A,0,9-5-2"}
      - {q: "SYST:ERR?", r: '+0,"No error"'}
      - {q: "VOLT:RANG?", r: "10"}
      - {q: "TRIG:SOUR?", r: "IMM"}
resources:
  GPIB0::22::INSTR:
    device: meter
"""
