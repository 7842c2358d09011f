"""A simulated supply and multimeter on serial ports of the bench file: RS-232 as it is, in process."""

from __future__ import annotations

from typing import Any

import pytest
import pyvisa

from vcfbench.bench.bench import open_bench
from vcfbench.bench.file import embedded_text, parse_bench
from vcfbench.bench.simulated import SimulatedBench
from vcfbench.clock import VirtualClock

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


@pytest.mark.parametrize("settings", ["", EVEN])
def test_our_drivers_work_over_it(settings: str) -> None:
    with open_bench(parse_bench(ON_SERIAL_PORTS + settings, "serial")) as bench:
        bench.power.configure_output("P25V", 10.0, 0.1)
        bench.power.enable_outputs()
        assert bench.power.measure_voltage_v("P25V") == pytest.approx(10.0, abs=0.05)
        bench.multimeter.configure_dc_voltage(10.0, 1)
        assert abs(bench.multimeter.read_voltage_v()) < 10.0
