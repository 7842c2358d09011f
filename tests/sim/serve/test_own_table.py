"""A table of somebody else's: the twin and the profile of the documentation, in process and on a served bench."""

from __future__ import annotations

import re
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from textwrap import dedent
from types import ModuleType
from typing import TYPE_CHECKING, Any

import pytest
import serial
from simrack.serve import MAX_SPEED, ServedClock, ServerSettings
from simrack_tests.serve.lamp import serving

from vcfbench import models
from vcfbench.bench.bench import open_bench
from vcfbench.clock import Deadline, sleep
from vcfbench.models import TableLanguage
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.sim.builder import SimulatedBench
from vcfbench.station.file import embedded_text
from vcfbench.testing import serve_simulated

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.station.description import BenchDescription

DOCS = Path(__file__).parents[3] / "docs"
WIRES = ["tcp", pytest.param("pty", marks=pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals"))]


def block(document: str, containing: str) -> str:
    text = (DOCS / document).read_text(encoding="utf-8")
    return next(
        body for body in re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL) if containing in body
    )


@pytest.fixture(autouse=True)
def acme(monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    """Install the package of the documentation; return its class."""
    module: Any = ModuleType("acme_table_of_the_docs")
    exec(block("adding-an-instrument.md", "class AcmeTable"), module.__dict__)  # noqa: S102
    module.LANGUAGE = TableLanguage("acme", twin=module.AcmeTable)
    monkeypatch.setitem(sys.modules, module.__name__, module)
    point = EntryPoint("acme", f"{module.__name__}:LANGUAGE", "vcfbench.models")
    others = models.entry_points
    monkeypatch.setattr(models, "entry_points", lambda group: [point] if group == point.group else others(group=group))
    models._installed.cache_clear()
    yield module.AcmeTable
    models._installed.cache_clear()


@pytest.fixture(params=[1, 2])
def bench(request: pytest.FixtureRequest, tmp_path: Path) -> BenchDescription:
    documented = re.search(r'parse_profile\(\s*"""\n(.*?)"""', block("rate-tables.md", "first_axis = 0"), re.DOTALL)
    assert documented is not None
    profile = tmp_path / "acme.toml"
    profile.write_text(dedent(documented[1]).replace("\\\\", "\\"), encoding="utf-8")
    table = f'dialect = "{profile.as_posix()}"\naxis = {request.param}'
    return parse_bench(embedded_text("ideal").replace('dialect = "acl"', table), "bench")


def turned(table: Any, clock: Any) -> float:
    """Turn the table, wait until it says that it does, make it safe; return the rate read."""
    table.enable()
    table.set_rate(20.0, 100.0)
    within = Deadline.after(clock, 30.0)
    while not table.at_rate():
        assert not within.expired()
        sleep(clock, 0.1)
    rate_deg_s = table.rate_deg_s()
    assert table.fault() is None
    assert table.make_safe(Deadline.after(clock, 20.0)).safe
    return float(rate_deg_s)


@pytest.mark.exhaustive
def test_it_is_turned_in_process(bench: BenchDescription) -> None:
    with open_bench(bench) as opened:
        assert turned(opened.rate_table, opened.clock) == pytest.approx(20.0, rel=1e-4)


@pytest.mark.parametrize("wire", WIRES)
def test_it_joins_a_served_world(bench: BenchDescription, wire: str) -> None:
    with serve_simulated(bench) as lab:
        serial_port = serial.serial_for_url(lab.resource("rate_table", wire), 19200, timeout=5.0)
        axis = bench.rate_table.axis - 1 if bench.rate_table else 0
        with serial_port as port:
            port.write(f"A{axis}J10\r".encode())
            assert port.read_until(b"\r") == b"OK\r"
            lab.ask("advance", seconds=5.0)
            assert lab.ask("get", name="applied_rate_deg_s") == pytest.approx(10.0, abs=1e-3)
            port.write(f"A{axis}S\rA{1 - axis}S\r".encode())
            assert port.read_until(b"\r") + port.read_until(b"\r") == b"0020\r?\r"
            lab.ask("set", name="rate_table.interlock.door", value=True)
            port.write(f"A{axis}S\r".encode())
            assert port.read_until(b"\r") == b"0030\r"


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")
def test_its_real_line_has_the_speed_that_it_says(acme: Any) -> None:
    clock = ServedClock(MAX_SPEED)
    world = SimulatedBench.build(parse_bench(embedded_text("ideal"), "bench"), 0, clock).world
    table = acme(world, acme.errors_class.none())
    with serving({"table": table}, clock, ServerSettings(rs232="real")) as served:
        where = served.resource("pty", "table")
        with serial.Serial(where, 9600, timeout=0.2) as port:
            port.write(b"A0P\r")
            assert port.read(9) != b"0.00000\r"
        with serial.Serial(where, 19200, timeout=5.0) as port:
            port.write(b"\rA0P\r")
            assert port.read_until(b"0.00000\r").endswith(b"0.00000\r")
