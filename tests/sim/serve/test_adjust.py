"""What is changed from outside is seen on the instruments' wires: physics, not words; and a reset undoes it.

One bench serves all of these tests, put back to its first state before each.
"""

from __future__ import annotations

import math
import struct
from typing import TYPE_CHECKING

import pytest
from simrack_tests.serve.test_raw import Wire

from vcfbench.testing import serve_simulated

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.testing import ServedLab


@pytest.fixture(scope="module")
def started() -> Iterator[ServedLab]:
    with serve_simulated("ideal") as lab:
        yield lab


@pytest.fixture
def lab(started: ServedLab) -> Iterator[ServedLab]:
    started.reset()
    yield started
    started.ask("speed", value="max")


class TableWire(Wire):
    """A plain socket to a table that says error and length, two 32-bit words, before each reply."""

    def line(self) -> bytes:
        _, length = struct.unpack("<II", self.file.read(8))
        return self.file.read(length)


class Wired:
    """Plain sockets to every instrument."""

    def __init__(self, lab: ServedLab) -> None:
        def port(role: str) -> int:
            return int(lab.resource(role).removesuffix("::SOCKET").rpartition(":")[2])

        self.lab = lab
        self.power, self.meter, self.scope = (Wire(port(role)) for role in ("power", "multimeter", "oscilloscope"))
        self.table = TableWire(port("rate_table"))

    def switch_on(self, volts: float = 10.0, limit_a: float = 0.5) -> None:
        setting = f"APPL P25V,{volts},{limit_a};:APPL N25V,-{volts},{limit_a};:OUTP ON;*OPC?\n"
        assert self.power.ask(setting.encode()) == b"1\n"
        self.lab.ask("advance", seconds=5.0)

    def supply(self) -> tuple[float, float, int]:
        """Return voltage and current of the positive output, and its condition (1 constant current, 2 voltage)."""
        asked = b"MEAS:VOLT? P25V;:MEAS:CURR? P25V;:STAT:QUES:INST:ISUM2:COND?\n"
        volts, amps, condition = self.power.ask(asked).split(b";")
        return float(volts), float(amps), int(condition)

    def reading(self) -> float:
        return float(self.meter.ask(b"READ?\n"))

    def close(self) -> None:
        for wire in (self.power, self.meter, self.scope, self.table):
            wire.close()


@pytest.fixture
def wired(lab: ServedLab) -> Iterator[Wired]:
    made = Wired(lab)
    yield made
    made.close()


def test_excessive_load_drives_the_supply_into_its_limit(lab: ServedLab, wired: Wired) -> None:
    wired.switch_on()
    volts, pcb_a, condition = wired.supply()
    assert (volts, condition) == (pytest.approx(10.0, abs=0.01), 2)
    lab.ask("set", name="rail.positive.load_ohm", value=47.0)
    volts, amps, condition = wired.supply()
    assert (volts, amps, condition) == (pytest.approx(10.0, abs=0.01), pytest.approx(10 / 47 + pcb_a, abs=1e-3), 2)
    lab.ask("set", name="rail.positive.load_ohm", value=2.0)
    volts, amps, condition = wired.supply()
    assert (amps, condition) == (pytest.approx(0.5, abs=1e-3), 1)
    assert 2.0 * (0.5 - pcb_a) <= volts <= 2.0 * 0.5 + 1e-3
    lab.ask("set", name="rail.positive.load_ohm", value=None)
    assert wired.supply()[0] == pytest.approx(10.0, abs=0.01)


@pytest.mark.exhaustive
def test_a_short_circuit_is_as_short_as_is_said(lab: ServedLab, wired: Wired) -> None:
    wired.switch_on(limit_a=0.2)
    lab.fault("power", "current_limit", load_ohm=0.5, duration_s=10.0)
    volts, amps, condition = wired.supply()
    assert (amps, condition) == (pytest.approx(0.2, abs=1e-3), 1)
    assert volts == pytest.approx(0.2 * 0.5, abs=5e-3)
    assert lab.ask("get", name="rail.positive.voltage_v") == pytest.approx(volts, abs=5e-3)
    lab.ask("advance", seconds=10.0)
    assert wired.supply()[0] == pytest.approx(10.0, abs=0.01)


def test_the_multimeter_reads_the_node_that_its_leads_are_on(lab: ServedLab, wired: Wired) -> None:
    wired.switch_on(volts=8.0)
    lab.ask("set", name="multimeter.input.node", value="rail_positive")
    assert wired.reading() == pytest.approx(8.0, abs=0.01)
    lab.ask("set", name="multimeter.input.reversed", value=True)
    assert wired.reading() == pytest.approx(-8.0, abs=0.01)
    lab.ask("set", name="multimeter.input.node", value="rail_negative")
    assert wired.reading() == pytest.approx(8.0, abs=0.01)
    lab.ask("set", name="multimeter.input.node", value=None)
    assert wired.reading() == pytest.approx(0.0, abs=1e-6)


def test_a_probe_sees_the_node_that_it_is_on(lab: ServedLab, wired: Wired) -> None:
    wired.switch_on(volts=9.0)
    lab.ask("set", name="oscilloscope.channel_4.node", value="rail_negative")
    wired.scope.send(b"*RST;:CHAN1:DISP 0;:CHAN4:DISP 1;:CHAN4:RANG 40;:DIG CHAN4\n")
    assert float(wired.scope.ask(b":MEAS:VAV? CHAN4\n")) == pytest.approx(-9.0, abs=0.4)  # a division is 5 V
    lab.ask("set", name="oscilloscope.channel_4.reversed", value=True)
    wired.scope.send(b":DIG CHAN4\n")
    assert float(wired.scope.ask(b":MEAS:VAV? CHAN4\n")) == pytest.approx(9.0, abs=0.4)


def test_readings_are_off_and_drift(lab: ServedLab, wired: Wired) -> None:
    lab.ask("set", name="multimeter.input.node", value=None)
    wired.meter.ask(b"CONF:VOLT:DC 10;:READ?\n")
    lab.ask("pause")
    begun_s = lab.ask("now")
    lab.fault("multimeter", "offset", offset=0.5, drift_s=0.01)
    lab.ask("resume")
    lab.ask("advance", seconds=100.0)
    earliest_s = lab.ask("now") - begun_s
    read_v = wired.reading()  # while time goes on with the wall clock
    assert 0.5 + 0.01 * earliest_s - 1e-6 <= read_v <= 0.5 + 0.01 * (lab.ask("now") - begun_s) + 1e-6
    lab.ask("clear_faults")
    assert wired.reading() == pytest.approx(0.0, abs=1e-6)


def test_the_gyroscope_follows_the_air(lab: ServedLab) -> None:
    lab.ask("pause")
    lab.ask("set", name="ambient_c", value=40.0)
    tau_s = lab.ask("get", name="parameter.thermal.time_constant_s")
    for taus in (1, 2):
        lab.ask("advance", seconds=tau_s)
        assert lab.ask("get", name="temperature_c") == pytest.approx(40.0 - 20.0 * math.exp(-taus), abs=1e-6)


def test_a_rate_is_applied_whatever_the_table_is_told(lab: ServedLab, wired: Wired) -> None:
    wired.switch_on()
    lab.ask("advance", seconds=10.0)
    still_v = wired.reading()
    lab.ask("pause")
    before_deg = lab.ask("get", name="angle_deg")
    lab.ask("set", name="applied_rate_deg_s", value=25.0)
    lab.ask("advance", seconds=10.0)
    assert lab.ask("get", name="angle_deg") - before_deg == pytest.approx(250.0, abs=0.5)  # the servo lags by 10 ms
    lab.ask("resume")
    scale_factor_v_deg_s = -0.012542052  # of the ideal gyroscope
    assert wired.reading() - still_v == pytest.approx(25.0 * scale_factor_v_deg_s, rel=1e-3)


def closed(lab: ServedLab, wired: Wired) -> None:
    """Switch the table's servo on at rest."""
    assert wired.table.ask(b":Limit:Vtrip R,1,110\n").strip() == b"OK"
    wired.table.ask(b":Demand:Rate 1,0;:Mode:Rate 1\n")
    wired.table.ask(b":Interlock:Close 1\n")
    lab.ask("advance", seconds=5.0)
    assert wired.table.ask(b":Interlock? 1\n").strip() == b"Close"


def test_a_table_that_is_turned_too_fast_trips(lab: ServedLab, wired: Wired) -> None:
    closed(lab, wired)
    lab.ask("set", name="applied_rate_deg_s", value=90.0)
    lab.ask("advance", seconds=1.0)
    assert wired.table.ask(b":Interlock? 1\n").strip() == b"Close"
    lab.ask("set", name="applied_rate_deg_s", value=200.0)
    for _ in range(2):
        lab.ask("advance", seconds=1.0)
        assert wired.table.ask(b":Interlock? 1\n").strip() == b"Fault"
    lab.ask("advance", seconds=10.0)
    assert float(wired.table.ask(b":Read:Rate? 1\n")) == pytest.approx(0.0, abs=1e-3)


def test_the_interlock_drops_a_turning_table(lab: ServedLab, wired: Wired) -> None:
    closed(lab, wired)
    wired.table.ask(b":Demand:Rate 1,50\n")
    lab.ask("advance", seconds=10.0)
    assert lab.ask("get", name="applied_rate_deg_s") == pytest.approx(50.0, rel=1e-3)
    lab.fault("rate_table", "interlock")
    assert wired.table.ask(b":Interlock? 1\n").strip() == b"Fault"
    rates = []
    for _ in range(3):
        lab.ask("advance", seconds=60.0)
        rates.append(abs(lab.ask("get", name="applied_rate_deg_s")))
    assert rates[2] < 50.0 / 2


def test_supply_without_mains_drops_rails(lab: ServedLab, wired: Wired) -> None:
    wired.switch_on()
    lab.ask("set", name="multimeter.input.node", value="rail_positive")
    assert wired.reading() == pytest.approx(10.0, abs=0.01)
    lab.fault("power", "power_cycle", duration_s=30.0)
    lab.ask("advance", seconds=5.0)
    assert wired.reading() == pytest.approx(0.0, abs=1e-3)
    assert wired.power.line() == b""
    lab.ask("advance", seconds=30.0)
    again = Wired(lab)
    assert again.power.ask(b"OUTP?;:VOLT?\n").startswith(b"0;+0")
    again.close()


def test_time_passes_as_it_is_told(lab: ServedLab, wired: Wired) -> None:
    lab.ask("pause")
    paused_s = lab.ask("now")
    wired.meter.send(b"CONF:VOLT:DC 10;:SAMP:COUN 5;:VOLT:NPLC 100;:READ?\n")
    assert wired.meter.silent(0.03)
    assert lab.ask("now") == paused_s
    lab.ask("advance", seconds=30.0)
    assert len(wired.meter.line().split(b",")) == 5
    lab.ask("speed", value=1000)
    lab.ask("resume")
    wired.meter.send(b"READ?\n")
    assert len(wired.meter.line().split(b",")) == 5
    assert lab.ask("now") - paused_s > 40.0


def test_reset_repeats_readings_of_a_seed_and_no_others() -> None:
    with serve_simulated("paper", seed=3) as lab:
        seen = [readings(lab, seed) for seed in (None, 4, None, 3)]
    assert seen[0] == seen[2] == seen[3]
    assert seen[1] != seen[0]


def readings(lab: ServedLab, seed: int | None) -> bytes:
    """Put the bench back, lead its time, take readings."""
    lab.reset(seed)
    with lab.control() as leader:
        leader.request("lead")
        wired = Wired(lab)
        wired.power.ask(b"APPL P25V,10,0.5;:APPL N25V,-10,0.5;:OUTP ON;*OPC?\n")
        leader.request("sleep_until", instant_s=20.0)
        said = wired.meter.ask(b"CONF:VOLT:DC 10;:SAMP:COUN 3;:READ?\n")
        wired.close()
    return said
