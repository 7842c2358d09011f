"""Every method of drivers from elsewhere, one by one, the error queue read after each."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.third_party.conftest import Served, command, expected_failures, serving

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


def test_pymeasure_on_a_dmm6500(pymeasure: Path) -> None:
    with serving({"multimeter": "DMM6500"}) as served:
        resource = served.resource("multimeter", "tcp")
        seen = methods(pymeasure, "pymeasure_successors.py", "KeithleyDMM6500", resource)
    check(seen, "pymeasure.KeithleyDMM6500", 22)


def test_qcodes(qcodes: Path, served: Served) -> None:
    seen = methods(qcodes, "qcodes_methods.py", "Agilent34401A", served.resource("multimeter", "tcp"))
    check(seen, "qcodes.Agilent34401A", 12)


def test_qcodes_truevolt(qcodes: Path) -> None:
    with serving({"multimeter": "34465A"}) as served:
        seen = methods(qcodes, "qcodes_truevolt.py", "Keysight34465A", served.resource("multimeter", "tcp"))
    check(seen, "qcodes.Keysight34465A", 52)


@pytest.mark.parametrize(
    ("library", "drivers"),
    [
        (
            "pymeasure",
            [
                ("power", "E3631A", "keysight.KeysightE3631A", 19),
                ("rate_source", "33220A", "agilent.Agilent33220A", 23),
                ("multimeter", "34401A", "hp.HP34401A", 32),
                ("oscilloscope", "DSO7104B", "keysight.KeysightDSOX1102G", 16),
            ],
        ),
        (
            "pymeasure",
            [
                ("power", "E36312A", "keysight.KeysightE36312A", 17),
                ("rate_source", "33522B", "agilent.agilent33500.Agilent33500", 79),
                ("multimeter", "DMM6500", "keithley.KeithleyDMM6500", 80),
                ("oscilloscope", "DSOX3024A", "keysight.KeysightDSOX1102G", 16),
            ],
        ),
        (
            "pymeasure",
            [
                ("rate_source", "33521B", "agilent.Agilent33521A", 43),
                ("multimeter", "34461A", "agilent.Agilent34410A", 8),
                ("oscilloscope", "MSOX3104T", "keysight.KeysightDSOX1102G", 16),
            ],
        ),
        (
            "pymeasure",
            [
                ("rate_source", "33622A", "agilent.agilent33500.Agilent33500", 79),
                ("multimeter", "2000", "keithley.Keithley2000", 51),
                ("oscilloscope", "DSOX4104A", "keysight.KeysightDSOX1102G", 16),
            ],
        ),
        (
            "qcodes",
            [
                ("rate_source", "33511B", "Keysight.Keysight33511B", 25),
                ("multimeter", "34461A", "Keysight.Keysight34461A", 29),
            ],
        ),
        (
            "qcodes",
            [
                ("rate_source", "33512B", "Keysight.Keysight33512B", 48),
                ("multimeter", "34465A", "Keysight.Keysight34465A", 32),
            ],
        ),
        (
            "qcodes",
            [
                ("rate_source", "33522B", "Keysight.Keysight33522B", 48),
                ("multimeter", "2000", "Keithley.Keithley2000", 17),
            ],
        ),
        (
            "qcodes",
            [
                ("rate_source", "33611A", "Keysight.Keysight33611A", 25),
                ("multimeter", "34401A", "agilent.Agilent34401A", 10),
            ],
        ),
        (
            "qcodes",
            [
                ("rate_source", "33622A", "Keysight.Keysight33622A", 48),
                ("multimeter", "DMM6500", "Keithley.Keithley6500", 22),
            ],
        ),
    ],
)
def test_everything_that_can_be_set(
    library: str, drivers: list[tuple[str, str, str, int]], request: pytest.FixtureRequest
) -> None:
    """All of a library's drivers on one bench: every property or parameter is asked, and set to what it answered."""
    python: Path = request.getfixturevalue(library)
    with serving({role: model for role, model, *_ in drivers}) as served:
        words = [f"{driver}={served.resource(role, 'tcp')}" for role, _, driver, _ in drivers]
        done = command(python, CLIENTS / f"{library}_walk.py", *words)
    assert done.returncode == 0, done.stderr[-3000:]
    seen = json.loads(done.stdout.splitlines()[-1])
    for _, model, driver, at_least in drivers:
        check(seen[driver], f"{library}.{driver} on {model}", at_least)


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
