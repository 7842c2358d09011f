"""A simulated supply and multimeter on serial ports of the bench file: RS-232 as it is, in process."""

from __future__ import annotations

import re
from typing import Any

import pytest
import pyvisa

from vcfbench.bench.bench import open_bench
from vcfbench.bench.check import check_bench
from vcfbench.clock import VirtualClock
from vcfbench.errors import DeadlineExceeded
from vcfbench.models import MODELS, Model
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.sim.builder import SimulatedBench
from vcfbench.station.file import embedded_text

ON_SERIAL_PORTS = (
    embedded_text("paper").replace("GPIB0::5::INSTR", "ASRL1::INSTR").replace("GPIB0::22::INSTR", "ASRL2::INSTR")
)
EVEN = '[multimeter.serial]\ndata_bits = 7\nparity = "even"\n'


@pytest.fixture
def bench() -> SimulatedBench:
    return SimulatedBench.build(parse_bench(ON_SERIAL_PORTS, "serial"), 0, VirtualClock())


@pytest.fixture
def opened(bench: SimulatedBench) -> Any:
    with bench.registered() as handle:
        manager = pyvisa.ResourceManager(f"{handle}@vcfbench")
        supply: Any = manager.open_resource("ASRL1::INSTR", read_termination="\r\n", write_termination="\n")
        supply.flow_control = pyvisa.constants.ControlFlow.dtr_dsr
        yield supply
        manager.close()


def test_it_is_switched_on_in_local(opened: Any) -> None:
    opened.write("VOLT 3")
    assert opened.query("SYST:ERR?").startswith("+550,")
    opened.write("SYST:REM")
    opened.write("VOLT 3")
    assert opened.query("VOLT?") == "+3.00000000E+00"
    assert opened.query("SYST:ERR?") == '+0,"No error"'


def test_bursts_of_commands_lose_nothing_with_the_handshake(opened: Any) -> None:
    opened.write("SYST:REM")
    for _ in range(40):
        opened.write("VOLT 1")
    opened.write("VOLT 2")
    opened.timeout = 10_000
    assert opened.query("VOLT?") == "+2.00000000E+00"


def test_without_it_they_do(opened: Any, bench: SimulatedBench) -> None:
    opened.flow_control = pyvisa.constants.ControlFlow.none
    opened.write("SYST:REM")
    for _ in range(40):
        opened.write("VOLT 1")
    bench.clock.sleep_until(bench.clock.now() + 10.0)
    opened.write("")  # an end for what is left of the last line that came
    assert opened.query("SYST:ERR?").startswith("+521,")


def test_a_command_acts_when_its_last_character_has_come(opened: Any, bench: SimulatedBench) -> None:
    """The supply's own 50 ms begin then, though nobody looks meanwhile."""
    opened.write("SYST:REM")
    bench.clock.sleep_until(1.0)
    command = "OUTP ON"
    opened.write(command)
    acts_s = 1.0 + len(command + "\n") * 10 / 9600 + 0.05  # as VISA sets its end: one stop bit
    supply: Any = bench.devices["power"]
    bench.clock.sleep_until(acts_s - 1e-6)
    assert not supply.output_on
    bench.clock.sleep_until(acts_s + 1e-6)
    assert supply.output_on


@pytest.mark.parametrize("settings", ["", EVEN])
def test_our_drivers_work_over_it(settings: str) -> None:
    with open_bench(parse_bench(ON_SERIAL_PORTS + settings, "serial")) as bench:
        bench.power.configure_output("P25V", 10.0, 0.1)
        bench.power.enable_outputs()
        assert bench.power.measure_voltage_v("P25V") == pytest.approx(10.0, abs=0.05)
        bench.multimeter.configure_dc_voltage(10.0, 1)
        assert abs(bench.multimeter.read_voltage_v()) < 10.0


URL = "sim://paper"
ON_A_PORT = embedded_text("paper").replace(URL, "/dev/ttyS0")


@pytest.mark.parametrize(("resource", "character_s"), [("/dev/ttyS0", 10 / 9600), ("COM3", 10 / 9600), (URL, 0.0)])
def test_table_on_port_takes_time_of_characters(resource: str, character_s: float) -> None:
    """`*IDN?` and its end at 9600 Bd, 2 ms, and the identity behind eight bytes of header."""
    text = embedded_text("paper").replace(URL, resource)
    with open_bench(parse_bench(text, "serial")) as bench:
        assert bench.rate_table is not None
        before_s = bench.clock.now()
        bench.rate_table.identify()
        answered = len("Acutronic R&D USA,Acutrol3000,0,A8800-001-01.000-a")
        taken_s = bench.clock.now() - before_s
    assert taken_s == pytest.approx(0.002 + (6 + 8 + answered) * character_s)


def test_the_table_is_turned_over_its_line() -> None:
    with open_bench(parse_bench(ON_A_PORT, "serial")) as bench:
        table = bench.rate_table
        assert table is not None
        table.enable()
        table.set_rate(50.0, 100.0)
        bench.clock.sleep_until(bench.clock.now() + 2.0)
        assert table.rate_deg_s() == pytest.approx(50.0, abs=0.01)


def test_a_table_does_not_answer_at_the_wrong_speed() -> None:
    text = ON_A_PORT.replace('dialect = "acl"', 'dialect = "acl"\nbaud_rate = 19200')
    with (
        pytest.raises(DeadlineExceeded, match=r"no answer.*baud_rate"),
        open_bench(parse_bench(text, "serial")),
    ):
        pass


def test_own_instrument_without_scpi_goes_on_a_serial_port_too() -> None:
    text = embedded_text("paper").replace("USB0::0x0957::0x0407::MY44021876::INSTR", "ASRL7::INSTR")
    bench = SimulatedBench.build(parse_bench(text, "serial"), 0, VirtualClock())
    own: Any = object()
    bench.devices["rate_source"] = own
    assert bench.visa_devices()["ASRL7::INSTR"] is own


@pytest.mark.parametrize("model", sorted({model.twin: model for model in MODELS}.values(), key=lambda row: row.name))
def test_each_model_answers_on_a_serial_port(model: Model) -> None:
    """What has none of its own is behind a converter, where an early read is no error."""
    role = model.roles[0]
    text = re.sub(rf"(?ms)^\[{role}\]\n.*?^resource = .*?$", "", embedded_text("lab"))
    text += f'\n[{role}]\nmodel = "{model.name}"\nresource = "ASRL7::INSTR"\n'
    (found,) = [each for each in check_bench(parse_bench(text, "serial")).instruments if each.role == role]
    assert not found.problem
