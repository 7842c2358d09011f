"""The desk: a supply, a generator, a meter and an oscilloscope that see each other, and a circuit of one's own."""

from __future__ import annotations

import json
import math
import re
import socket
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import pyvisa
from simrack.__main__ import app
from simrack.attendance import AttendedClock
from simrack.clock import VirtualClock
from simrack.desk import RESOURCES, circuit_in
from simrack.serve import Control
from simrack.sources import Drive
from simrack.wired import WiredWorld
from typer.testing import CliRunner

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

EXAMPLE = Path(__file__).parents[1] / "examples" / "rc_filter.py"
CORNER_HZ = 1.0 / (math.tau * 1e3 * 100e-9)


@pytest.fixture
def opened() -> Iterator[Callable[[str], dict[str, Any]]]:
    managers = []

    def opened(file: str) -> dict[str, Any]:
        manager = pyvisa.ResourceManager(f"{file}?speed=max@simrack")
        managers.append(manager)
        found = {role: manager.open_resource(name) for role, name in RESOURCES.items()}
        for each in found.values():
            each.timeout = 60_000
        return found

    yield opened
    for manager in managers:
        manager.close()


@pytest.mark.parametrize("share", [0.5, 1.0, 3.0])
def test_the_filter_takes_what_a_first_order_takes(opened: Callable[[str], dict[str, Any]], share: float) -> None:
    desk = opened(str(EXAMPLE))
    desk["generator"].write("OUTP:LOAD INF")
    desk["generator"].write(f"APPL:SIN {share * CORNER_HZ}, 2.0, 0")
    shown_v = float(desk["multimeter"].query("MEAS:VOLT:AC?"))
    assert shown_v == pytest.approx(math.sqrt(0.5) / math.hypot(1.0, share), rel=1e-4)  # 6 digits, and the ac filter


def test_a_square_loses_its_edges_and_no_mean(opened: Callable[[str], dict[str, Any]]) -> None:
    """Its rms value is sqrt(1 - tanh(x) / x) with x a quarter of a period in time constants."""
    desk = opened(str(EXAMPLE))
    desk["generator"].write("OUTP:LOAD INF")
    desk["generator"].write("APPL:SQU 1000, 2.0, 0.5")
    quarter = 0.25e-3 / 1e-4
    rms_v = math.sqrt(1.0 - math.tanh(quarter) / quarter)
    assert float(desk["multimeter"].query("MEAS:VOLT:AC?")) == pytest.approx(rms_v, rel=2e-3)
    assert float(desk["multimeter"].query("MEAS:VOLT:DC?")) == pytest.approx(0.5, abs=1e-4)


def test_the_oscilloscope_sees_both_sides(opened: Callable[[str], dict[str, Any]]) -> None:
    desk = opened(str(EXAMPLE))
    desk["generator"].write("OUTP:LOAD INF")
    desk["generator"].write(f"APPL:SIN {CORNER_HZ}, 2.0, 0")
    desk["generator"].query("*OPC?")
    for message in ("*RST", ":CHAN2:DISP ON", ":AUT"):
        desk["oscilloscope"].write(message)
    desk["oscilloscope"].query("*OPC?")
    sizes = [float(desk["oscilloscope"].query(f":MEAS:VPP? CHAN{channel}")) for channel in (1, 2)]
    assert sizes == pytest.approx([2.0, math.sqrt(2.0)], rel=0.02)  # steps of an 8-bit converter


def test_the_script_of_the_readme_runs(capsys: pytest.CaptureFixture[str]) -> None:
    readme = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    script = re.findall(r"^```python\n(import pyvisa\n.*?)^```", readme, re.MULTILINE | re.DOTALL)
    exec(compile("\n".join(script), "README.md", "exec"), {})  # noqa: S102 - our own text
    assert float(capsys.readouterr().out) == pytest.approx(2.0 * math.sqrt(0.5), rel=1e-3)  # 2 Vpp into 50 ohm


def test_a_supply_feels_its_load() -> None:
    world = WiredWorld(AttendedClock(VirtualClock()))
    world.set_load("positive", 100.0)
    assert world.rail_current_a("positive", 10.0) == pytest.approx(0.1)


def test_sources_feel_what_hangs_on_their_node() -> None:
    world = WiredWorld(AttendedClock(VirtualClock()), circuit_in(EXAMPLE))
    world.drive("input", Drive(1.0, source_ohm=50.0))
    world.load_node("somebody", "output", 1e3)
    assert world.value_v("output") == pytest.approx(0.5)
    world.load_node("somebody", "input", 50.0)
    assert world.value_v("output") == pytest.approx(0.5)


def test_a_file_without_a_circuit_is_refused(tmp_path: Path) -> None:
    (tmp_path / "none.py").write_text("CIRCUIT = 3\n")
    with pytest.raises(ValueError, match=r"none\.py: expected CIRCUIT = .*, came int"):
        circuit_in(tmp_path / "none.py")


def test_the_command_serves_them_all() -> None:
    words = [sys.executable, "-m", "simrack", "serve", str(EXAMPLE), "--speed", "max", "--json"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:  # noqa: S603
        try:
            assert server.stdout is not None
            places = json.loads(server.stdout.readline())
            names = {}
            for role, wires in places["instruments"].items():
                _, host, port, _ = wires["tcp"].split("::")
                with socket.create_connection((host, int(port)), timeout=30) as wire:
                    wire.sendall(b"*IDN?\n")
                    names[role] = wire.makefile().readline().split(",")[1]
            assert names == {role: wires["model"] for role, wires in places["instruments"].items()}
            with Control(places["control"]["port"]) as control:
                assert control.request("set", name="node.input", value=1.0) == pytest.approx(1.0)
                assert control.request("get", name="node.output") == pytest.approx(1.0)
            listed = CliRunner().invoke(app, ["ctl", str(places["control"]["port"])])
            assert "node.output" in listed.stdout
            refused = CliRunner().invoke(app, ["ctl", str(places["control"]["port"]), "nope"])
            assert (refused.exit_code, "there is no 'nope'; `ctl` lists all names" in refused.stderr) == (2, True)
        finally:
            server.terminate()
        assert server.wait(30) == 0
