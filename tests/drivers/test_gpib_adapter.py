"""Instruments behind a GPIB adapter, simrack's, over a socket and over a serial line."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from contextlib import ExitStack, suppress
from typing import TYPE_CHECKING, Any

import pytest
from simrack.models import MODELS
from simrack.serve import Control
from simrack.serve.raw import has_ptys
from simrack_tests.ports import PLENTY_S
from simrack_tests.test_rack import serving

from tests.cells import few
from vcfbench.bench.bench import open_bench
from vcfbench.bench.make_safe import MadeSafe, safe_bench
from vcfbench.clock import Deadline, WallClock, sleep
from vcfbench.drivers import gpib_adapter
from vcfbench.drivers.gpib_adapter import occupied, open_behind
from vcfbench.drivers.registry import open_instrument
from vcfbench.drivers.wire import behind
from vcfbench.errors import ConnectFailed, DeadlineExceeded, LinkLost, TransportError
from vcfbench.safety.lock import InUse, instrument_locks
from vcfbench.station.discovery import discover, stanza
from vcfbench.testing.kit.write import use_within_limits

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from simrack.serve import BenchServer

CLOCK = WallClock()
RACK = {"34401A": 22, "E3631A": 5, "DSO7104B": 7}
WIRES = few(["tcp", "pty"], "tcp") if has_ptys() else ["tcp"]


def adapter_of(server: BenchServer, wire: str) -> str:
    place = str(server.wires["gpib"].as_json()[wire])
    if wire == "pty":
        return f"PRLGX-ASRL0::{place.removeprefix('ASRL').removesuffix('::INSTR')}::INTFC"
    return f"PRLGX-TCPIP0::127.0.0.1::{place.split('::')[2]}::INTFC"


@pytest.fixture(scope="module")
def server() -> Iterator[BenchServer]:
    with serving(*(f"{model}:gpib{address}" for model, address in RACK.items())) as server:
        yield server


@pytest.fixture(params=WIRES)
def adapter(server: BenchServer, request: pytest.FixtureRequest) -> Iterator[str]:
    yield adapter_of(server, request.param)
    assert not {each for each in gpib_adapter._adapters.values() if not each.closed}


class Opened(ExitStack):
    """Instruments that are closed at the end."""

    def __init__(self, adapter: str) -> None:
        super().__init__()
        self._library = f"{adapter}@py"

    def __getitem__(self, model: str) -> Any:
        resource = f"GPIB0::{RACK[model]}::INSTR"
        opened = open_instrument(model, model, resource, library=self._library, clock=CLOCK, settings={})
        self.callback(opened.close)
        return opened


def test_two_instruments_are_asked_while_one_measures(adapter: str) -> None:
    with Opened(adapter) as bench:
        meter, supply = bench["34401A"], bench["E3631A"]
        meter.configure_dc_voltage(10.0, 10.0)
        meter.begin_reading()
        supply.configure_output("P6V", 1.0, 0.05)
        supply.enable_outputs()
        assert supply.measure_voltage_v("P6V") == pytest.approx(1.0, abs=1e-6)
        assert meter.begun_reading_v() == pytest.approx(0.0, abs=1e-6)
        assert supply.command_safe().sent
        assert supply.make_safe(Deadline.after(CLOCK, PLENTY_S)).safe
        supply.check_errors()
        meter.check_errors()


def test_a_burst_and_a_waveform_come_whole(adapter: str) -> None:
    with Opened(adapter) as bench:
        meter, scope = bench["34401A"], bench["DSO7104B"]
        meter.configure_dc_voltage(10.0, 1.0)
        meter.start_sampling(100, 0.05)
        assert len(meter.sampled_voltages_v()) == 100
        scope.acquire(1)
        assert scope.waveform(1, 10_000).voltage_v.shape == (10_000,)
        scope.check_errors()


def test_bytes_that_the_adapter_would_take_for_itself_arrive(adapter: str) -> None:
    with Opened(adapter) as bench:
        session = bench["34401A"]._session
        session.write('DISP:TEXT "++addr 5"')
        assert session.query("DISP:TEXT?") == '"++addr 5"'
        session._wire.send(b"DISP:TEXT?\r\n", Deadline.after(CLOCK, PLENTY_S))
        assert session._wire.receive(Deadline.after(CLOCK, PLENTY_S)) == (b'"++addr 5"\n', True)


def test_a_deadline_is_kept_and_a_late_answer_is_nobodys(adapter: str) -> None:
    with Opened(adapter) as bench:
        meter, supply = bench["34401A"], bench["E3631A"]
        began_s = CLOCK.now()
        with pytest.raises(DeadlineExceeded, match=r"no answer|the time is up"):
            supply._session._wire.receive(Deadline.after(CLOCK, 0.3))
        assert 0.2 < CLOCK.now() - began_s < 0.3 + PLENTY_S
        assert meter._session.query("*IDN?").startswith("HEWLETT-PACKARD,34401A")
        supply._session.clear()
        assert supply.identify().model == "E3631A"


def test_safe_word_is_sent_while_another_instrument_is_read(adapter: str) -> None:
    with Opened(adapter) as bench:
        meter, supply = bench["34401A"], bench["E3631A"]
        supply.configure_output("P6V", 1.0, 0.05)
        supply.enable_outputs()

        def wait() -> None:
            with pytest.raises(DeadlineExceeded):
                meter._session._wire.receive(Deadline.after(CLOCK, 0.6))

        waiting = threading.Thread(target=wait)
        waiting.start()
        began_s = CLOCK.now()
        assert supply.command_safe().sent
        assert CLOCK.now() - began_s < 0.4
        assert supply.outputs_enabled() is False
        waiting.join()


def test_polls_find_instruments_that_request_service(adapter: str) -> None:
    limit = Deadline.after(CLOCK, PLENTY_S)
    assert occupied(adapter, limit) == sorted(RACK.values())
    with Opened(adapter) as bench:
        session = bench["E3631A"]._session
        session.send("*CLS;*ESE 32;*SRE 32", "WHAT")
        assert [session._wire.status_byte(limit) for _ in range(2)] == [96, 32]
        session.send("*SRE 0;*ESE 0;*CLS")


def test_the_connection_is_shared_and_made_anew(adapter: str) -> None:
    with Opened(adapter) as bench:
        meter, supply = bench["34401A"], bench["E3631A"]
        assert meter._session._wire._adapter is supply._session._wire._adapter
        meter._session._wire._adapter.give_up()
        for each in (meter, supply):
            with pytest.raises(LinkLost, match="adapter is closed"):
                each.identify()
        assert supply.command_safe().sent
        meter._session.revive()
        assert meter.identify().model == "34401A"


def test_who_is_no_adapter_or_no_address_is_refused() -> None:
    with serving("34401A:tcp") as server:
        port = str(server.wires["34401A"].as_json()["tcp"]).split("::")[2]
        limit = Deadline.after(CLOCK, 0.5)
        with pytest.raises(ConnectFailed, match=r"no GPIB adapter answers there"):
            open_behind(f"PRLGX-TCPIP0::127.0.0.1::{port}::INTFC", "GPIB0::22::INSTR", limit)
    with pytest.raises(ConnectFailed, match="is no address behind"):
        open_behind("PRLGX-TCPIP0::127.0.0.1::INTFC", "GPIB0::meter::INSTR", limit)
    with pytest.raises(ConnectFailed, match="is no adapter"):
        open_behind("PRLGX-GPIB0::127.0.0.1::INTFC", "GPIB0::1", limit)


@pytest.mark.parametrize(
    ("resource", "library", "found"),
    [
        ("GPIB0::22::INSTR", "@py", (None, "@py")),
        ("GPIB::22", "PRLGX-TCPIP::meter.lab::1234::INTFC@py", ("PRLGX-TCPIP::meter.lab::1234::INTFC", "@py")),
        (
            "GPIB1::22",
            "PRLGX-TCPIP::a::INTFC,PRLGX-ASRL1::/dev/ttyUSB0::INTFC",
            ("PRLGX-ASRL1::/dev/ttyUSB0::INTFC", "@py"),
        ),
        ("GPIB2::22", "PRLGX-TCPIP::a::INTFC@ivi", (None, "@ivi")),
        ("TCPIP0::a::INSTR", "PRLGX-TCPIP::a::INTFC@py", (None, "@py")),
        ("GPIB0::22", "/usr/lib/libvisa.so", (None, "/usr/lib/libvisa.so")),
    ],
)
def test_the_library_names_the_adapters(resource: str, library: str, found: tuple[str | None, str]) -> None:
    assert behind(resource, library) == found


@pytest.mark.exhaustive
def test_what_is_behind_it_is_discovered_by_its_name(server: BenchServer) -> None:
    library = f"{adapter_of(server, 'tcp')}@py"
    found = discover(library)
    models = {each.resource: each.model for each in found.resources if each.resource.startswith("GPIB0")}
    assert models == {f"GPIB0::{address}::INSTR": model for model, address in RACK.items()}
    assert f'visa_library = "{library}"' in stanza(found)


BENCH = """name = "behind"
visa_library = "{library}"
power = {{ model = "E3631A", resource = "GPIB0::5::INSTR" }}
multimeter = {{ model = "34401A", resource = "GPIB0::22::INSTR" }}
[limits]
max_rate_deg_s = 100
max_acceleration_deg_s2 = 50
max_v_vc_v = 5
min_rail_v = 0.5
max_rail_v = 10.5
max_rail_current_a = 0.2
[site]
latitude_deg = 48
mains_hz = 50
"""


def test_one_program_has_an_adapter_and_all_behind_it(server: BenchServer, tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(BENCH.format(library=f"{adapter_of(server, 'tcp')}@py"))
    port = adapter_of(server, "tcp").split("::")[2]
    with open_bench(tmp_path / "bench.toml") as bench:
        assert bench.multimeter.identify().model == "34401A"
        with pytest.raises(InUse), instrument_locks("other", {"x": f"TCPIP0::localhost::{port}::SOCKET"}):
            pass


@pytest.mark.exhaustive
@pytest.mark.parametrize("wire", ["tcp", "pty"])
@pytest.mark.parametrize("model", list(MODELS))
def test_every_driver_does_behind_it_what_it_does_elsewhere(model: str, wire: str) -> None:
    with serving(f"{model}:gpib9") as server:
        library = f"{adapter_of(server, wire)}@py"
        driver: Any = open_instrument("x", model, "GPIB0::9::INSTR", library=library, clock=CLOCK, settings={})
        use_within_limits(driver, MODELS[model].kind)
        assert driver.make_safe(Deadline.after(CLOCK, PLENTY_S)).safe
        driver.check_errors()
        driver.close()


PROGRAM = """
import sys, time
from vcfbench.bench.bench import open_bench
with open_bench(sys.argv[1]) as bench:
    bench.power.configure_output("P25V", 5.0, 0.05)
    bench.power.enable_outputs()
    print("on", flush=True)
    while True:
        bench.multimeter.read_voltage_v()
        bench.power.measure_voltage_v("P25V")
"""


def made_safe(bench: Path) -> MadeSafe | None:
    with suppress(InUse):
        return safe_bench(bench)
    return None


@pytest.mark.exhaustive
@pytest.mark.skipif(sys.platform == "win32", reason="SIGKILL")
@pytest.mark.parametrize("number", range(int(os.environ.get("VCFBENCH_KILLS", "4"))))
@pytest.mark.parametrize("wire", ["tcp", "pty"])
def test_a_killed_program_leaves_nothing_on(tmp_path: Path, wire: str, number: int) -> None:
    models = ("34401A:gpib22", "E3631A:gpib5")
    words = [sys.executable, "-m", "simrack", "serve", *models]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as served:  # noqa: S603
        assert served.stdout is not None
        try:
            lines = [served.stdout.readline().split() for _ in range(5)]
            port, place = lines[3][2].split("::")[2], lines[3][3].removeprefix("ASRL").removesuffix("::INSTR")
            name = f"PRLGX-TCPIP0::127.0.0.1::{port}::INTFC" if wire == "tcp" else f"PRLGX-ASRL0::{place}::INTFC"
            (tmp_path / "bench.toml").write_text(BENCH.format(library=f"{name}@py"))
            program = [sys.executable, "-c", PROGRAM, str(tmp_path / "bench.toml")]
            with Control(int(lines[4][1])) as control, subprocess.Popen(program, stdout=subprocess.PIPE) as run:  # noqa: S603
                assert run.stdout is not None
                assert run.stdout.readline() == b"on\n"
                sleep(CLOCK, 0.05 * number)
                os.kill(run.pid, signal.SIGKILL)
                run.wait()
                until_s = CLOCK.now() + 10.0
                while abs(control.request("get", name="node.rail_positive")) > 0.5 and CLOCK.now() < until_s:
                    sleep(CLOCK, 0.02)
                assert abs(control.request("get", name="node.rail_positive")) <= 0.5
            while (made := made_safe(tmp_path / "bench.toml")) is None and CLOCK.now() < until_s:
                sleep(CLOCK, 0.1)  # its watchdog still has the bench
            assert made is not None
            assert all(each.safe for each in made.reports)
        finally:
            served.terminate()


@pytest.mark.parametrize("kind", few(["silent", "disconnect", "garbled", "truncated", "half_open"], "disconnect"))
def test_adapter_failure_leaves_all_off_and_reconnects(kind: str) -> None:
    with (
        serving("34401A:gpib22", "E3631A:gpib5") as server,
        Control(server.control.port) as control,
        Opened(adapter_of(server, "tcp")) as bench,
    ):
        meter, supply = bench["34401A"], bench["E3631A"]
        supply.configure_output("P6V", 1.0, 0.05)
        supply.enable_outputs()
        control.request("fault", instrument="gpib", kind=kind)
        with suppress(TransportError):
            meter._session.query("*IDN?", Deadline.after(CLOCK, 0.4))
        supply.command_safe()
        control.request("clear_faults")
        assert supply.make_safe(Deadline.after(CLOCK, PLENTY_S)).safe
        assert control.request("get", name="rail.E3631A.output_1.voltage_v") == pytest.approx(0.0, abs=0.01)
