"""Racks: the desk of four that see each other, any others, a circuit of one's own."""

from __future__ import annotations

import json
import math
import re
import socket
import subprocess
import sys
from contextlib import contextmanager
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any

import pytest
import pyvisa
from simrack.attendance import AttendedClock
from simrack.cli import app
from simrack.clock import VirtualClock
from simrack.models import RACK
from simrack.plan import DESK, circuit_in, plan_of
from simrack.rack import Rack, served
from simrack.serve import BenchServer, Control, ServedClock, ServerSettings
from simrack.serve.raw import has_ptys
from simrack.sources import Drive
from simrack.wired import WiredWorld
from typer.testing import CliRunner

from simrack_tests.cells import few
from simrack_tests.ports import free_port

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
        found = {place.name: manager.open_resource(place.resource) for place in DESK}
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
    assert float(capsys.readouterr().out) == pytest.approx(math.sqrt(0.5), rel=1e-3)


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
    with pytest.raises(ValueError, match=r"none\.py: expected CIRCUIT = .*, got int"):
        circuit_in(tmp_path / "none.py")


def test_the_command_serves_them_all() -> None:
    mapper = free_port()
    words = [sys.executable, "-m", "simrack", "serve", str(EXAMPLE), "--speed", "max", "--json"]
    words += ["--port-mapper", str(mapper)]
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
            socket.create_connection(("127.0.0.1", mapper), timeout=30).close()
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


# --- any models, on any wires -------------------------------------------------------------------------------------

MEASURED = {
    "supply": "MEAS:VOLT?",
    "generator": "VOLT?",
    "multimeter": "MEAS:VOLT:DC?",
    "oscilloscope": ":MEAS:VAV?",
    "chamber": "TEMP?",
}
SPEAKING = [name for name, model in RACK.items() if model.kind != "rate table"]
WIRES = ("tcp", "vxi11", "hislip", *(["pty"] if has_ptys() else []))
_COMMAND_ERROR, _REQUESTED = 32, 64


@contextmanager
def serving(*words: str) -> Iterator[BenchServer]:
    clock, plan = ServedClock(math.inf), plan_of(words)
    with BenchServer(served(clock, plan), clock, ServerSettings(only=plan.wires_asked_for())) as server:
        thread = Thread(target=server.run)
        thread.start()
        try:
            yield server
        finally:
            server.stop()
            thread.join(30)


def ask_all(name: str, ask: Callable[[str], str], clear: Callable[[], None], poll: Callable[[], int]) -> None:
    """Ask a model what each must answer: who it is, a measured value, an error, a device clear, a service request."""
    kind = RACK[name].kind
    assert re.findall(r"\d{3,}", name)[0] in ask("*IDN?")
    assert math.isfinite(float(ask(MEASURED[kind])))
    clear()
    assert ask("*CLS;*ESE 32;*SRE 32;*OPC?").strip().lstrip("+") == "1"
    assert not poll() & _REQUESTED
    ask("NOSUCH:WORD 1")
    assert poll() & (_REQUESTED | _COMMAND_ERROR) == _REQUESTED | _COMMAND_ERROR
    assert int(ask("*ESR?")) & _COMMAND_ERROR
    assert kind == "chamber" or "-113" in ask("SYST:ERR?")  # the chamber has no queue


@pytest.mark.parametrize("wire", few(WIRES, "tcp"))
def test_model_works_on_every_wire(wire: str) -> None:
    manager = pyvisa.ResourceManager("@py")
    with serving(*(f"{name}:{wire}" for name in SPEAKING)) as server:
        for name, wires in server.wires.items():
            (place,) = wires.places
            resource: Any = manager.open_resource(place, timeout=30_000)
            resource.read_termination = resource.write_termination = "\n"
            by_poll = wire == "vxi11"  # on HiSLIP PyVISA-py takes a request for the answer to what it sends next

            def ask(said: str, resource: Any = resource) -> str:
                return str(resource.query(said)) if "?" in said else str(resource.write(said))

            def poll(resource: Any = resource, by_poll: bool = by_poll) -> int:  # noqa: FBT001
                return int(resource.read_stb() if by_poll else resource.query("*STB?"))

            ask_all(name, ask, resource.clear if wire in {"vxi11", "hislip"} else lambda: None, poll)
            resource.close()
    manager.close()


@pytest.mark.exhaustive
def test_model_works_behind_adapter_and_in_process() -> None:
    words = [f"{name}:gpib{address}" for address, name in enumerate(SPEAKING[:31])]
    with serving(*words) as server:
        wire = socket.create_connection(("127.0.0.1", int((server.wires["gpib"].tcp or "").split("::")[2])), timeout=30)
        lines = wire.makefile("rw", newline="\n")

        def ask(said: str) -> str:
            lines.write(f"{said}\n" + "++read eoi\n" * ("?" in said))
            lines.flush()
            return lines.readline() if "?" in said or said.startswith("++spoll") else ""

        ask("++read_tmo_ms 3000")
        for address, name in enumerate(SPEAKING[:31]):
            ask(f"++addr {address}")
            ask_all(name, ask, lambda: ask("++clr") and None, lambda: int(ask("++spoll")))
        lines.close()
        wire.close()
    manager = pyvisa.ResourceManager(f"?speed=max&models={','.join(words)}@simrack")
    for address, name in enumerate(SPEAKING[:31]):
        resource: Any = manager.open_resource(f"GPIB0::{address}::INSTR", timeout=30_000)
        said = lambda words, resource=resource: resource.query(words) if "?" in words else resource.write(words)  # noqa: E731
        ask_all(name, said, resource.clear, resource.read_stb)
    manager.close()


def test_tables_are_served_by_their_language() -> None:
    with serving("Zaber:tcp") as server:
        host, port = str(server.wires["Zaber"].tcp).removeprefix("socket://").split(":")
        with socket.create_connection((host, int(port)), timeout=30) as wire:
            wire.sendall(b"/1 get version\n")
            assert wire.makefile().readline() == "@01 0 OK IDLE -- 7.33\n"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("34402A",), "unknown model '34402A'; expected one of E3631A"),
        (("34461A:gpib",), "34461A can be on tcp, vxi11, hislip, pty, or gpib0 to gpib30 alone, not on 'gpib'"),
        (("ACL:vxi11",), "ACL can be on tcp, pty, not on 'vxi11'"),
        (("a=34461A", "a=2000"), "two instruments are called 'a'"),
        (("34461A:",), "got '34461A:'"),
    ],
)
def test_words_that_name_no_instrument_are_refused(words: tuple[str, ...], said: str) -> None:
    with pytest.raises(ValueError, match=re.escape(said)):
        plan_of(words)


def test_each_table_turns_a_shaft_of_its_own() -> None:
    rack = Rack.build(VirtualClock(), plan_of(["ESP", "ATL", "ESP"]))
    rack.devices["ESP-2"].write(b"1MO;1VA20;1MV+\r")
    rack.world.clock.sleep_until(5.0)
    for name, rate in (("ESP", 0.0), ("ESP-2", 20.0)):
        rack.devices[name].write(b"1TV\r")
        rack.world.clock.sleep_until(rack.world.clock.now() + 1.0)
        assert abs(float(rack.devices[name].read(100)[0])) == pytest.approx(rate, abs=0.01)
    assert rack.world.table.rate_deg_s() == 0.0


def test_every_output_and_input_is_on_a_node() -> None:
    plan = plan_of(["33522B", "33522B", "E36312A", "34461A", "34461A", "DSOX3024A"])
    assert [place.name for place in plan.places[:2]] == ["33522B", "33522B-2"]
    assert plan.places[1].terminals == {"output_1": "33522B-2.output_1", "output_2": "33522B-2.output_2"}
    rack = Rack.build(VirtualClock(), plan)
    _, second, supply, meter, *_ = rack.devices.values()
    second.write(b"APPL:DC DEF,DEF,1;:OUTP2:LOAD INF;:SOUR2:APPL:DC DEF,DEF,2\n")
    supply.write(b"VOLT 3,(@1);:OUTP ON,(@1);:VOLT 5,(@3);:OUTP ON,(@3)\n")
    rack.world.clock.sleep_until(5.0)
    for node, volts in (
        *(("33522B-2.output_1", 2.0), ("33522B-2.output_2", 2.0)),
        *(("rail_E36312A.output_1", 3.0), ("rail_negative", -5.0)),
    ):
        rack.world.leads["34461A"].connect("input", node)
        meter.write(b"MEAS:VOLT:DC?\n")
        rack.world.clock.sleep_until(rack.world.clock.now() + 2.0)
        assert float(meter.read(100)[0]) == pytest.approx(volts, abs=1e-4), node


def test_models_in_process_have_network_names_and_attributes() -> None:
    manager = pyvisa.ResourceManager("?speed=max&models=34461A,dmm=34465A:hislip,34401A,ESP@simrack")
    assert manager.list_resources("?*") == (
        *("TCPIP0::34461A::inst0::INSTR", "TCPIP0::dmm::hislip0::INSTR", "GPIB0::3::INSTR", "ASRL4::INSTR"),
    )
    meter: Any = manager.open_resource("TCPIP0::34461A::inst0::INSTR")
    attributes = pyvisa.constants.ResourceAttribute
    assert meter.get_visa_attribute(attributes.tcpip_address) == "34461A"
    assert meter.get_visa_attribute(attributes.tcpip_device_name) == "inst0"
    assert "34461A" in meter.query("*IDN?")
    assert meter.get_visa_attribute(attributes.tcpip_hostname) == "34461A"
    assert meter.get_visa_attribute(attributes.resource_manager_session) == manager.session
    hislip: Any = manager.open_resource("TCPIP0::dmm::hislip0::INSTR")
    hislips = (meter, hislip)
    assert [each.get_visa_attribute(attributes.tcpip_is_hislip) for each in hislips] == [False, True]
    manager.close()
    with pytest.raises(OSError, match="expected speed and models"):
        pyvisa.ResourceManager("?sped=max@simrack")


def test_a_usb_instrument_says_maker_and_model() -> None:
    manager = pyvisa.ResourceManager("?speed=max@simrack")
    generator: Any = manager.open_resource(next(place.resource for place in DESK if place.name == "generator"))
    assert (generator.manufacturer_name, generator.model_name) == ("Agilent Technologies", "33220A")
    assert generator.is_4882_compliant
    manager.close()


def test_the_command_lists_its_models_and_its_version() -> None:
    listed = CliRunner().invoke(app, ["models"]).stdout.splitlines()
    assert [line.split()[0] for line in listed] == list(RACK)
    assert CliRunner().invoke(app, ["--version"]).stdout.startswith("simrack ")


def test_an_instrument_is_found_by_its_name_in_any_case() -> None:
    manager = pyvisa.ResourceManager("@py")
    with serving("DSOX3024A:vxi11") as server:
        for name in ("DSOX3024A", "dsox3024a"):
            scope: Any = manager.open_resource(server.wires["DSOX3024A"].places[0].replace("inst0", name))
            assert "3024A" in scope.query("*IDN?")
            scope.close()
    manager.close()


def test_instruments_have_serial_numbers_of_their_own() -> None:
    """But for those of models that answer 0, which is none."""
    words = [name for name, each in RACK.items() if each.kind not in {"rate table", "adapter"}]
    rack = Rack.build(VirtualClock(), plan_of([*words, *words]))
    for device in rack.devices.values():
        device.write(b"*IDN?\n")
    rack.world.clock.sleep_until(1.0)
    identities = [device.read(200)[0].decode().split(",") for device in rack.devices.values()]
    numbers = [each[2] for each in identities if each[2] != "0"]
    assert len(numbers) == len({*numbers}) == 2 * len({*words} - {"34401A", "E3631A", "ATS-545"})
    alone = Rack.build(VirtualClock(), plan_of(["34465A"])).devices["34465A"]
    alone.write(b"*IDN?\n")
    assert alone.read(200)[0].split(b",")[2] == b"MY54500001"
