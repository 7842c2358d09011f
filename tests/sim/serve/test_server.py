"""The whole simulated bench on its wires, and the commands that serve and control it."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
import pyvisa
import serial
from simrack.serve import (
    MAX_SPEED,
    BenchServer,
    Control,
    RemoteClock,
    ServedBench,
    ServedClock,
    ServerSettings,
)
from simrack_tests.cells import few
from simrack_tests.serve.lamp import ALL, IDENTITY, Lamp, served_lamp, serving
from simrack_tests.serve.test_raw import Wire
from typer.testing import CliRunner

from tests import warm
from vcfbench.cli.sim import app
from vcfbench.clock import VirtualClock, sleep
from vcfbench.procedures.bench_file import load_bench
from vcfbench.sim.builder import SimulatedBench

if TYPE_CHECKING:
    from collections.abc import Iterator

HAS_PTYS = hasattr(os, "openpty")
needs_ptys = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no pseudo-terminals")


@contextmanager
def paper_bench(speed: float) -> Iterator[Any]:
    clock = ServedClock(speed)
    built = SimulatedBench.build(load_bench(None), 0, clock)
    with serving(dict(built.devices), clock, world=built.world) as served:
        yield served


@contextmanager
def command(*arguments: str) -> Iterator[Any]:
    with warm.running(["vcfbench", "sim", "serve", *arguments], Path.cwd()) as process:
        yield process


@pytest.fixture(scope="module")
def described() -> Iterator[tuple[Any, dict[str, Any]]]:
    with command("--json", "--speed", "max") as process:
        yield process, json.loads(process.stdout.readline())


def test_the_first_line_says_where_everything_is(described: tuple[Any, dict[str, Any]]) -> None:
    instruments = described[1]["instruments"]
    assert {role: wires["model"] for role, wires in instruments.items()} == {
        "power": "E3631A",
        "rate_source": "33220A",
        "multimeter": "34401A",
        "oscilloscope": "DSO7104B",
        "rate_table": "acl",
    }
    offered = {
        role: {kind for kind, where in wires.items() if where is not None} for role, wires in instruments.items()
    }
    serial_line = {"model", "tcp", "pty"} if HAS_PTYS else {"model", "tcp"}
    assert offered == {
        "power": serial_line,
        "rate_source": {"model", "tcp", "vxi11"},
        "multimeter": serial_line,
        "oscilloscope": {"model", "tcp", "vxi11"},
        "rate_table": serial_line,
    }


def test_every_instrument_answers_everywhere(described: tuple[Any, dict[str, Any]]) -> None:
    manager = pyvisa.ResourceManager("@py")
    for role, wires in described[1]["instruments"].items():
        for kind in {"tcp", "vxi11", "hislip", "pty"} & set(wires):
            if wires[kind] is None or role == "rate_table":
                continue
            instrument: Any = manager.open_resource(wires[kind], read_termination="\n", write_termination="\n")
            assert wires["model"] in instrument.query("*IDN?"), (role, kind)
            instrument.close()
    for where in (described[1]["instruments"]["rate_table"]["tcp"], described[1]["instruments"]["rate_table"]["pty"]):
        if where is not None:
            with serial.serial_for_url(where, timeout=5.0) as port:
                port.write(b"*IDN?\n")
                header = port.read(8)
                assert b"Acutronic" in port.read(int.from_bytes(header[4:], "little"))
    manager.close()


def test_reading_sees_world_set_over_another_wire(described: tuple[Any, dict[str, Any]]) -> None:
    instruments = described[1]["instruments"]
    manager = pyvisa.ResourceManager("@py")
    supply: Any = manager.open_resource(instruments["power"]["tcp"], read_termination="\n", write_termination="\n")
    supply.write("APPL P25V,10,0.5")
    supply.write("APPL N25V,-10,0.5")
    supply.write("OUTP ON")
    assert float(supply.query("MEAS:VOLT? P25V")) == pytest.approx(10.0, abs=0.1)
    supply.close()
    manager.close()
    with Control(described[1]["control"]["port"]) as control:
        assert control.request("get", name="rail.positive.voltage_v") == pytest.approx(10.0, abs=0.1)


def test_ctl_talks_to_it(described: tuple[Any, dict[str, Any]]) -> None:
    port = str(described[1]["control"]["port"])
    asked = CliRunner().invoke(app, ["ctl", "--port", port, "status"])
    assert asked.exit_code == 0, asked.output
    assert json.loads(asked.stdout)["speed"] == "max"
    turned = CliRunner().invoke(app, ["ctl", "--port", port, "set", "applied_rate_deg_s", "5"])
    assert turned.exit_code == 0, turned.output


def test_fault_fields_are_command_line_arguments(described: tuple[Any, dict[str, Any]]) -> None:
    port = str(described[1]["control"]["port"])

    def ctl(*words: str) -> Any:
        done = CliRunner().invoke(app, ["ctl", "--port", port, *words])
        assert done.exit_code == 0, (words, done.output, done.exception)
        return json.loads(done.stdout)

    ctl("fault", "multimeter", "late", "5", "delay_s=3", "at_s=1e6", "count=1")
    ctl("fault", "multimeter", "error", "number=-350", "at_s=1e6")
    ctl("fault", "multimeter", "identity", "identity=ACME,1,2,3", "at_s=1e6")
    ctl("fault", "multimeter", "offset", "offset=0.5", "drift_s=1e-3", "at_s=1e6")
    ctl("fault", "power", "current_limit", "load_ohm=2", "at_s=1e6")
    ctl("fault", "multimeter", "silent", "count=1")
    ctl("fault", "instrument=power", "kind=current_limit", "duration_s=5")
    faults = {role: state["faults"] for role, state in ctl("status")["instruments"].items()}
    assert (faults["multimeter"], faults["power"]) == (["silent"], ["current_limit"])
    ctl("clear_faults")
    ctl("set", "name=ambient_c", "value=35")
    assert ctl("get", "ambient_c") == 35
    assert ctl("reset") == 0.0
    assert ctl("get", "ambient_c") != 35
    refused = CliRunner().invoke(app, ["ctl", "--port", port, "fault", "multimeter", "late", "lateness=3"])
    assert "lateness" in str(refused.exception)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows knows no SIGTERM")
@pytest.mark.parametrize("number", few([signal.SIGTERM, signal.SIGINT], signal.SIGTERM))
def test_it_serves_until_it_is_told_to_stop(number: signal.Signals) -> None:
    with command("--speed", "10", "--offer", "rate_source:hislip") as process:
        lines = [process.stdout.readline() for _ in range(7)]
        assert "hislip0," in lines[2]
        assert "vcfbench sim ctl --port" in lines[6]
        process.send_signal(number)
        assert process.wait(10) == 0


@pytest.mark.parametrize(
    "arguments",
    [
        ["--speed", "fast"],
        ["--speed", "0"],
        ["--ports", "many"],
        ["--offer", "rate_source"],
        ["--offer", "toaster:tcp"],
        ["--offer", "rate_source:smoke"],
        ["--faults", "nowhere.toml"],
    ],
)
def test_what_cannot_be_served_is_a_usage_error(arguments: list[str]) -> None:
    refused = CliRunner().invoke(app, ["serve", *arguments])
    assert getattr(refused.exception, "exit_code", None) == 2


def exchanges(ask: Any) -> list[str]:
    """Switch the bench on and take some readings, with a wait of bench time between."""
    return [
        ask("power", "APPL P25V,10,0.5;:APPL N25V,-10,0.5;:OUTP ON;*OPC?"),
        ask(None, 8.0),
        ask("rate_source", "APPL:DC DEF,DEF,0.5;*OPC?"),
        ask("multimeter", "CONF:VOLT:DC 10;:SAMP:COUN 3;:READ?"),
        ask(None, 2.0),
        ask("multimeter", "READ?"),
        ask("power", "MEAS:CURR? P25V"),
        ask("rate_source", "VOLT:OFFS?"),
        ask("multimeter", "SYST:ERR?"),
    ]


def test_lockstep_bench_gives_the_same_digits() -> None:
    clock = VirtualClock()
    alone = SimulatedBench.build(load_bench(None), 0, clock)

    def ask_alone(role: str | None, message: Any) -> str:
        if role is None:
            sleep(alone.clock, message)
            return ""
        device = alone.devices[role]
        device.write(message.encode() + b"\n")
        while True:
            data, end = device.read(4096)
            if end:
                return data.decode().strip()
            wake = device.wake_at()
            assert wake is not None
            alone.clock.sleep_until(wake)

    expected = exchanges(ask_alone)
    manager = pyvisa.ResourceManager("@py")
    with paper_bench(MAX_SPEED) as served, Control(served.server.control.port) as control:
        remote = RemoteClock(control)
        opened: dict[str, Any] = {}

        def ask_served(role: str | None, message: Any) -> str:
            if role is None:
                sleep(remote, message)
                return ""
            if role not in opened:
                opened[role] = manager.open_resource(
                    served.resource("tcp", role), read_termination="\n", write_termination="\n"
                )
            return str(opened[role].query(message))

        got = exchanges(ask_served)
        for instrument in opened.values():
            instrument.close()
    manager.close()
    assert got == expected


def four_free_ports() -> int:
    """Return the first of four successive ports below those that the system gives to clients."""
    for base in range(21000, 30000, 4):
        with ExitStack() as probes, suppress(OSError):
            for port in range(base, base + 4):
                probes.enter_context(socket.create_server(("127.0.0.1", port)))
            return base
    raise AssertionError("no ports are free")


def test_ports_count_up_from_a_base() -> None:
    base = four_free_ports()
    with served_lamp(settings=ServerSettings(base_port=base, offers={"lamp": ALL})) as served:
        assert served.server.control.port == base
        assert [served.port(kind) for kind in ("tcp", "vxi11", "hislip")] == [base + 1, base + 2, base + 3]


@pytest.mark.parametrize("host", ["0.0.0.0", "::1", "::"])  # noqa: S104
def test_resource_strings_name_an_address_that_clients_can_use(host: str) -> None:
    clock = ServedClock()
    bench = ServedBench(None, {"lamp": Lamp(clock)}, {"lamp": "lamp"})  # type: ignore[arg-type]  # not looked at
    try:
        server = BenchServer(bench, clock, ServerSettings(host=host, offers={"lamp": ALL}))
    except OSError:
        pytest.skip("this machine has no such address")
    with server:
        resource = str(server.wires["lamp"].tcp)
        address, port = resource.removeprefix("TCPIP0::").removesuffix("::SOCKET").rsplit("::", 1)
        named = address.strip("[]")
        assert (address == named) == (":" not in host)
        assert named not in {"0.0.0.0", "::", ""}  # noqa: S104
        socket.create_connection((named, int(port)), timeout=5.0).close()


def test_busy_port_releases_opened_ports() -> None:
    with served_lamp() as served:
        clock = ServedClock()
        bench = ServedBench(None, {"lamp": Lamp(clock)}, {"lamp": "lamp"})  # type: ignore[arg-type]  # not looked at
        with pytest.raises(OSError, match="in use"):
            BenchServer(bench, clock, ServerSettings(base_port=served.server.control.port))


@needs_ptys
def test_serial_instrument_is_remote_until_sent_to_local() -> None:
    with paper_bench(MAX_SPEED) as served:
        where = served.resource("pty", "power").removeprefix("ASRL").removesuffix("::INSTR")
        with serial.Serial(where, timeout=5.0) as port:
            for before, setting in ((b"", b"+5.00000000E+00"), (b"SYST:LOC\n", b"+5.00000000E+00")):
                port.write(before + b"VOLT 5\nVOLT?;:SYST:ERR?\n")
                volts, error = port.read_until(b"\n").split(b";")
                assert volts == setting
                assert error.startswith(b"+550" if before else b"+0")


def test_a_client_of_the_control_port_loads_no_numerics() -> None:
    code = "import sys, simrack.serve; print(sorted({'numpy', 'scipy', 'pyvisa', 'serial'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert done.stdout.strip() == "[]"


class BrittleLamp(Lamp):
    def reset(self) -> None:
        raise ZeroDivisionError


def test_a_mistake_in_one_instrument_ends_that_connection_only(capfd: pytest.CaptureFixture[str]) -> None:
    clock = ServedClock()
    with serving({"lamp": BrittleLamp(clock)}, clock) as served:
        good, bad = Wire(served.port("tcp")), Wire(served.port("tcp"))
        good.ask(b"*IDN?\n")
        assert bad.ask(b"*RST\n") == b""
        assert good.ask(b"*IDN?\n") == IDENTITY
        good.close()
        bad.close()
    assert "ZeroDivisionError" in capfd.readouterr().err
