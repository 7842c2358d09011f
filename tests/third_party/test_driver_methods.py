"""Every method of drivers from elsewhere, one by one, the error queue read after each."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.third_party.conftest import Served, command, expected_failures

CLIENTS = Path(__file__).parent / "clients"


def methods(python: Path, client: str, *words: str) -> dict[str, str | None]:
    """Run a client; return what went wrong for every method, None where nothing did."""
    done = command(python, CLIENTS / client, *words)
    assert done.returncode == 0, done.stderr[-3000:]
    return dict(json.loads(done.stdout.splitlines()[-1]))


def check(seen: dict[str, str | None], suite: str, at_least: int) -> None:
    failed = {name: words for name, words in seen.items() if words is not None}
    assert len(seen) >= at_least
    assert set(failed) == set(expected_failures(suite)), failed


@pytest.mark.parametrize(
    ("role", "driver", "at_least"),
    [("rate_source", "Agilent33220A", 45), ("power", "KeysightE3631A", 25), ("multimeter", "HP34401A", 30)],
)
def test_pymeasure(role: str, driver: str, at_least: int, pymeasure: Path, served: Served) -> None:
    seen = methods(pymeasure, "pymeasure_methods.py", driver, served.resource(role, "tcp"))
    check(seen, f"pymeasure.{driver}", at_least)


@pytest.mark.parametrize(
    ("role", "driver", "at_least"),
    [("rate_source", "Agilent33500", 96), ("power", "KeysightE36312A", 21), ("multimeter", "Keithley2000", 29)],
)
def test_pymeasure_on_successors(
    role: str, driver: str, at_least: int, pymeasure: Path, served_successors: Served
) -> None:
    seen = methods(pymeasure, "pymeasure_successors.py", driver, served_successors.resource(role, "tcp"))
    check(seen, f"pymeasure.{driver}", at_least)


def test_pymeasure_on_a_dmm6500(pymeasure: Path, served_dmm6500: Served) -> None:
    resource = served_dmm6500.resource("multimeter", "tcp")
    check(methods(pymeasure, "pymeasure_successors.py", "KeithleyDMM6500", resource), "pymeasure.KeithleyDMM6500", 22)


def test_qcodes_on_a_dmm6500(qcodes: Path, served_dmm6500: Served) -> None:
    seen = methods(qcodes, "qcodes_walk.py", "Keithley.Keithley6500", served_dmm6500.resource("multimeter", "tcp"))
    check(seen, "qcodes.Keithley.Keithley6500", 22)


def test_qcodes(qcodes: Path, served: Served) -> None:
    seen = methods(qcodes, "qcodes_methods.py", "Agilent34401A", served.resource("multimeter", "tcp"))
    check(seen, "qcodes.Agilent34401A", 12)


def test_qcodes_truevolt(qcodes: Path, served_34465a: Served) -> None:
    """Sample timer, pretrigger and time trace are left out: the simulated 34465A has no sample timer."""
    seen = methods(qcodes, "qcodes_truevolt.py", "Keysight34465A", served_34465a.resource("multimeter", "tcp"))
    check(seen, "qcodes.Keysight34465A", 52)


@pytest.mark.parametrize(
    ("role", "driver", "at_least"),
    [("rate_source", "Keysight.Keysight33522B", 48), ("multimeter", "Keithley.Keithley2000", 17)],
)
def test_qcodes_on_successors(role: str, driver: str, at_least: int, qcodes: Path, served_successors: Served) -> None:
    seen = methods(qcodes, "qcodes_walk.py", driver, served_successors.resource(role, "tcp"))
    check(seen, f"qcodes.{driver}", at_least)


@pytest.mark.parametrize(
    ("client", "driver", "role", "wire", "at_least"),
    [
        ("ivi", "agilent34401A", "multimeter", "tcp", 72),
        ("ivi", "agilentE3631A", "power", "tcp", 118),
        ("ivi", "agilentDSO7104B", "oscilloscope", "vxi11", 299),
        ("ivi", "agilentDSO7104B", "oscilloscope", "hislip", 299),
        ("kit", "Agilent33220a", "rate_source", "tcp", 39),
        ("kit", "Agilent34410a", "multimeter", "tcp", 51),
        ("kit", "HPe3631a", "power", "tcp", 33),
        ("scope", "oscope_scpi", "oscilloscope", "vxi11", 43),
        ("scope", "keyoscacquire", "oscilloscope", "tcp", 24),
        ("scope", "keyoscacquire", "oscilloscope", "hislip", 24),
        ("awg", "Agilent33220A", "rate_source", "vxi11", 81),
    ],
)
def test_libraries(  # noqa: PLR0917  # a table
    client: str, driver: str, role: str, wire: str, at_least: int, libraries: Path, served: Served
) -> None:
    seen = methods(libraries, f"{client}_methods.py", driver, served.resource(role, wire))
    check(seen, f"{client}.{driver}", at_least)


def test_python_ivi_without_a_wire(libraries: Path) -> None:
    """The same in one process, through the VISA library ``@vcfbench``."""
    seen = methods(libraries, "ivi_methods.py", "agilent34401A", "@vcfbench!GPIB0::22::INSTR")
    check(seen, "ivi.agilent34401A in one process", 72)
