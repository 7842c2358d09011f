"""The example programs of the manuals, as strangers would write them: PyVISA or a plain socket, and no driver of ours.

Chapters 34401A user's guide 4 and 6, 33220A user's guide 6, E3631A user's guide 3 and 7, 6000/7000 series programmer's
guide "Programming Examples". The programs are told in our own words; settings that the guides leave open are chosen.
Every answer is held to its form, every value to the physics on the wires; the error queue is empty at the end.

The generator is on V_Vc, where the multimeter and channel 1 of the oscilloscope are; channel 4 and the outputs P25V and
N25V of the supply are on the rails.
"""

from __future__ import annotations

import math
import re
import socket
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import pytest
import pyvisa
from msgspec import structs
from pyvisa.constants import ControlFlow, EventMechanism, EventType, StopBits
from simrack.serve.adjust import adjustments_of
from simrack_tests.cells import few
from simrack_tests.ports import BUSY_S

from vcfbench.clock import VirtualClock
from vcfbench.sim.builder import SimulatedBench
from vcfbench.testing.benches import serve_simulated, simulated

if TYPE_CHECKING:
    from collections.abc import Iterator

    from numpy.typing import NDArray

    from vcfbench.station.description import BenchDescription
    from vcfbench.testing.benches import ServedLab

ROLES = ("power", "rate_source", "multimeter", "oscilloscope")

METER = r"[+-]\d\.\d{8}E[+-]\d\d"
SUPPLY = r"[+-]\d\.\d{8}E[+-]\d\d"
GENERATOR = r"[+-]\d\.\d{13}E[+-]\d\d"
SCOPE = r"[+-]\d\.\d{8}E[+-]\d{3}"
"""Numbers as each of them writes them (34401A p. 110; 33250A's power-on dump; recordings of 6000-series units)."""

WAV_PREAMBLE = rf"\+0,\+0,\+\d+,\+1,{SCOPE},{SCOPE},\+0,{SCOPE},{SCOPE},\+128"


def bench() -> BenchDescription:
    """Return the bench without imperfections, wired as said above."""
    plain = simulated("ideal")
    channels = structs.replace(plain.wiring.oscilloscope, channel_1="v_vc", channel_4="rail_positive")
    return structs.replace(plain, wiring=structs.replace(plain.wiring, multimeter="v_vc", oscilloscope=channels))


# ------------------------------------------------------------------------------------------------ the two controllers


class Instrument(Protocol):
    """What a program has of an instrument."""

    def write(self, message: str, data: bytes = b"") -> None: ...

    def ask(self, message: str) -> str: ...

    def block(self, message: str) -> bytes: ...

    def trigger(self) -> None: ...

    def requests_service(self) -> bool: ...

    def await_service(self) -> None: ...


class OnVisa:
    """An instrument on GPIB or USB, through PyVISA."""

    def __init__(self, resource: Any) -> None:
        self._resource = resource
        resource.timeout = 120_000
        resource.enable_event(EventType.service_request, EventMechanism.queue)

    def write(self, message: str, data: bytes = b"") -> None:
        self._resource.write_raw(message.encode() + data + b"\n")

    def ask(self, message: str) -> str:
        self.write(message)
        return str(self._resource.read_raw().decode("ascii").removesuffix("\n"))

    def block(self, message: str) -> bytes:
        self.write(message)
        return content(self._resource.read_raw())

    def trigger(self) -> None:
        self._resource.assert_trigger()

    def requests_service(self) -> bool:
        return bool(self._resource.read_stb() & 64)

    def await_service(self) -> None:
        assert not self._resource.wait_on_event(EventType.service_request, 120_000).timed_out


class OnSocket:
    """An instrument on a raw socket: no trigger, no serial poll but those that are messages."""

    def __init__(self, name: str) -> None:
        _, host, port, _ = name.split("::")
        self.line = socket.create_connection((host, int(port)), 20.0)
        self._file = self.line.makefile("rb")

    def close(self) -> None:
        self._file.close()
        self.line.close()

    def write(self, message: str, data: bytes = b"") -> None:
        self.line.sendall(message.encode() + data + b"\n")

    def ask(self, message: str) -> str:
        self.write(message)
        answer = self._file.readline().decode("ascii")
        assert answer.endswith("\n"), answer
        return answer.removesuffix("\n")

    def block(self, message: str) -> bytes:
        self.write(message)
        head = self._file.read(2)
        digits = self._file.read(int(head[1:]))
        return content(head + digits + self._file.read(int(digits) + 1))

    def trigger(self) -> None:
        self.write("*TRG")

    def requests_service(self) -> bool:
        return bool(int(self.ask("*STB?")) & 64)

    def await_service(self) -> None:
        for _ in range(10_000):
            if self.requests_service():
                return
        raise AssertionError("no service was requested")


def content(message: bytes) -> bytes:
    """Return the data of a definite-length block that is a whole message: its header counts, one newline ends it."""
    assert message[:1] == b"#"
    header = 2 + int(message[1:2])
    count = int(message[2:header])
    assert len(message) == header + count + 1
    assert message.endswith(b"\n")
    return message[header:-1]


@dataclass(frozen=True, slots=True)
class InProcess:
    """The bench behind ``@vcfbench``, on virtual time."""

    built: SimulatedBench

    def wait(self, seconds: float) -> None:
        clock = self.built.clock
        clock.sleep_until(clock.now() + seconds)

    def now(self) -> float:
        return self.built.clock.now()

    def put(self, name: str, value: Any) -> None:
        write = adjustments_of(self.built.world, self.built.devices)[name].write
        assert write is not None
        write(value)

    def value(self, name: str) -> float:
        return float(adjustments_of(self.built.world, self.built.devices)[name].read())


@dataclass(frozen=True, slots=True)
class OverSockets:
    """The bench behind the server, whose time jumps to what is waited for."""

    served: ServedLab

    def wait(self, seconds: float) -> None:
        self.served.ask("advance", seconds=seconds)

    def now(self) -> float:
        return float(self.served.ask("now"))

    def put(self, name: str, value: Any) -> None:
        self.served.ask("set", name=name, value=value)

    def value(self, name: str) -> float:
        return float(self.served.ask("get", name=name))


@dataclass(frozen=True, slots=True)
class Rack:
    """The four instruments, and what is behind them."""

    power: Instrument
    rate_source: Instrument
    multimeter: Instrument
    oscilloscope: Instrument
    behind: InProcess | OverSockets

    def wait(self, seconds: float) -> None:
        """Wait as a program does, with its own clock."""
        self.behind.wait(seconds)


@contextmanager
def in_process() -> Iterator[Rack]:
    description = bench()
    built = SimulatedBench.build(description, 0, VirtualClock())
    with built.registered() as handle, ExitStack() as stack:
        manager = pyvisa.ResourceManager(f"{handle}@vcfbench")
        stack.callback(manager.close)
        opened = {role: manager.open_resource(getattr(description, role).resource) for role in ROLES}
        yield Rack(**{role: OnVisa(resource) for role, resource in opened.items()}, behind=InProcess(built))


@contextmanager
def over_sockets() -> Iterator[Rack]:
    with serve_simulated(bench(), seed=0) as served, ExitStack() as stack:
        opened = {role: OnSocket(served.resource(role)) for role in ROLES}
        for line in opened.values():
            stack.callback(line.close)
        yield Rack(**opened, behind=OverSockets(served))


@pytest.fixture(params=few([in_process, over_sockets], over_sockets), ids=["@vcfbench", "socket"])
def rack(request: pytest.FixtureRequest) -> Iterator[Rack]:
    with request.param() as made:
        yield made
        for role in ROLES:
            assert getattr(made, role).ask("SYST:ERR?") == '+0,"No error"', role


# ------------------------------------------------------------------------------------------------ what programs share


def say(instrument: Instrument, program: str) -> None:
    """Send a program's lines, one message each."""
    for line in program.strip().splitlines():
        instrument.write(line.strip())


def number(text: str, form: str) -> float:
    """Return a number that is written as its instrument writes numbers."""
    assert re.fullmatch(form, text), text
    return float(text)


def numbers(text: str, form: str, separator: str = ",") -> list[float]:
    return [number(part, form) for part in text.split(separator)]


def play(rack: Rack, program: str) -> None:
    """Put something on V_Vc, the output open-circuited, and let it settle."""
    say(rack.rate_source, f"*RST\n*CLS\nOUTP:LOAD INF\n{program}\nOUTP ON")
    assert rack.rate_source.ask("*OPC?") == "1"
    rack.wait(2.0)


def digitize(rack: Rack, span_s: float, range_v: float, points: int = 1000) -> tuple[NDArray[np.float64], float]:
    """Take one record of channel 1 as the oscilloscope's guide does; return volts and the time between them, s."""
    scope = rack.oscilloscope
    say(
        scope,
        f""":CHAN1:RANG {range_v:g};OFFS 0
        :TIM:RANG {span_s:g}
        :TRIG:SWE AUTO
        :ACQ:TYPE NORM
        :DIG CHAN1
        :WAV:SOUR CHAN1;FORM BYTE;POIN:MODE {"NORM" if points <= 1000 else "RAW"}
        :WAV:POIN {points}""",
    )
    return record(scope, points)


def record(scope: Instrument, points: int) -> tuple[NDArray[np.float64], float]:
    """Download a BYTE record and convert it with its preamble: V = (code - yref) yinc + yorig."""
    preamble = scope.ask(":WAV:PRE?")
    assert re.fullmatch(WAV_PREAMBLE, preamble), preamble
    fields = [float(field) for field in preamble.split(",")]
    data = scope.block(":WAV:DATA?")
    assert len(data) == fields[2] == points
    codes = np.frombuffer(data, np.uint8).astype(np.float64)
    return (codes - fields[9]) * fields[7] + fields[8], fields[4]


def crossings(volts: NDArray[np.float64]) -> int:
    """Count the rising passages through zero."""
    return int(((volts[:-1] < 0.0) & (volts[1:] >= 0.0)).sum())


# ------------------------------------------------------------------------------------------------ 34401A


def test_34401a_measure_for_a_single_measurement(rack: Rack) -> None:
    """Chapter 6, p. 186, "Using MEASure?": ac current, one ampere, microamperes; nothing is in the current input."""
    meter = rack.multimeter
    say(meter, "*RST\n*CLS")
    assert abs(number(meter.ask("MEAS:CURR:AC? 1A,0.001MA"), METER)) < 1e-3


def test_34401a_configure_then_read(rack: Rack) -> None:
    """Chapter 4, p. 107: CONFigure leaves room for changes before READ? triggers."""
    play(rack, "FUNC DC\nVOLT:OFFS 2.5")
    meter = rack.multimeter
    say(meter, "*RST\n*CLS\nCONF:VOLT:DC 10,0.003\nSAMP:COUN 3")
    assert numbers(meter.ask("READ?"), METER) == pytest.approx([2.5] * 3, abs=3e-3)
    assert meter.ask("CONF?").startswith('"VOLT +1.00000000E+01,+')


def test_34401a_dbm_of_four_readings(rack: Rack) -> None:
    """Chapter 6, p. 187, "Using CONFigure with a math operation": dBm into 50 ohm of an ac voltage."""
    play(rack, "FUNC SIN\nFREQ 1000\nVOLT:UNIT VRMS\nVOLT 0.5")
    meter = rack.multimeter
    say(
        meter,
        """*RST
        *CLS
        CALC:DBM:REF 50
        CONF:VOLT:AC 1,0.001
        DET:BAND 200
        TRIG:COUN 4
        TRIG:SOUR IMM
        CALC:FUNC DBM
        CALC:STAT ON""",
    )
    readings = numbers(meter.ask("READ?"), METER)
    assert readings == pytest.approx([10.0 * math.log10(0.5**2 / 50.0 / 1e-3)] * 4, abs=0.02)


def test_34401a_statistics_when_service_is_requested(rack: Rack) -> None:
    """Chapter 6, p. 188, "Using the status registers": 100 readings, *OPC requests service, then their statistics."""
    play(rack, "FUNC DC\nVOLT:OFFS -1.25")
    meter = rack.multimeter
    say(meter, "*RST\n*CLS\n*ESE 1\n*SRE 32")
    assert meter.ask("*OPC?") == "1"
    say(
        meter,
        """CONF:VOLT:DC 10
        VOLT:DC:NPLC 1
        TRIG:COUN 100
        CALC:FUNC AVER;STAT ON
        INIT
        *OPC""",
    )
    meter.await_service()
    average_v, least_v, most_v = numbers(meter.ask("CALC:AVER:AVER?;MIN?;MAX?"), METER, ";")
    assert least_v <= average_v <= most_v
    assert (least_v, most_v) == pytest.approx((-1.25, -1.25), abs=1e-3)
    assert number(meter.ask("CALC:AVER:COUN?"), METER) == 100
    assert meter.ask("*ESR?") == "+1"
    assert meter.ask("DATA:POIN?") == "+100"


def test_34401a_readings_by_bus_trigger_from_memory(rack: Rack) -> None:
    """Chapters 3 and 4, p. 75 and 116: two triggers of five samples go to memory; FETCh? may be repeated."""
    play(rack, "FUNC DC\nVOLT:OFFS 4")
    meter = rack.multimeter
    say(meter, "*RST\n*CLS\nCONF:VOLT:DC 10,0.003\nTRIG:SOUR BUS\nSAMP:COUN 5\nTRIG:COUN 2\nINIT")
    for _ in range(2):
        rack.wait(1.0)
        meter.trigger()
    rack.wait(1.0)
    assert meter.ask("DATA:POIN?") == "+10"
    first = meter.ask("FETC?")
    assert numbers(first, METER) == pytest.approx([4.0] * 10, abs=3e-3)
    assert meter.ask("FETC?") == first


def test_34401a_limits_set_the_questionable_register(rack: Rack) -> None:
    """Chapter 3, p. 67 and 136: a reading above the limit sets bit 12, and bit 3 of the status byte if enabled."""
    play(rack, "FUNC DC\nVOLT:OFFS 3")
    meter = rack.multimeter
    say(meter, "*RST\n*CLS\nCONF:VOLT:DC 10\nCALC:FUNC LIM\nCALC:STAT ON")
    say(meter, "CALC:LIM:LOW -1\nCALC:LIM:UPP 1\nSTAT:QUES:ENAB 6144\n*SRE 8")
    assert number(meter.ask("READ?"), METER) == pytest.approx(3.0, abs=1e-3)
    assert meter.requests_service()
    assert int(meter.ask("*STB?")) & 8
    assert meter.ask("STAT:QUES?") == "+4096"
    say(meter, "CALC:LIM:LOW 5;UPP 6")
    assert number(meter.ask("READ?"), METER) == pytest.approx(3.0, abs=1e-3)
    assert meter.ask("STAT:QUES?") == "+2048"


def test_34401a_frequency_and_period(rack: Rack) -> None:
    """Chapter 4, p. 106: the other functions of MEASure?."""
    play(rack, "FUNC SIN\nFREQ 2500\nVOLT 2")
    meter = rack.multimeter
    say(meter, "*RST\n*CLS")
    assert number(meter.ask("MEAS:FREQ?"), METER) == pytest.approx(2500.0, rel=1e-4)
    assert number(meter.ask("MEAS:PER?"), METER) == pytest.approx(4e-4, rel=1e-4)
    assert number(meter.ask("MEAS:VOLT:AC? DEF,DEF"), METER) == pytest.approx(1.0 / math.sqrt(2.0), rel=1e-3)


@contextmanager
def serial_port_in_process() -> Iterator[Any]:
    plain = bench()
    description = structs.replace(plain, multimeter=structs.replace(plain.multimeter, resource="ASRL1::INSTR"))
    with SimulatedBench.build(description, 0, VirtualClock()).registered() as handle:
        manager = pyvisa.ResourceManager(f"{handle}@vcfbench")
        with manager.open_resource("ASRL1::INSTR", flow_control=ControlFlow.dtr_dsr, stop_bits=StopBits.two) as port:
            yield port
        manager.close()


@contextmanager
def pseudo_terminal() -> Iterator[Any]:
    with serve_simulated(bench(), seed=0) as served:
        if served.wires["multimeter"].pty is None:
            pytest.skip("there are no pseudo-terminals here")
        manager = pyvisa.ResourceManager("@py")
        with manager.open_resource(served.resource("multimeter", "pty")) as port:
            yield port
        manager.close()


@pytest.mark.parametrize("opened", [serial_port_in_process, pseudo_terminal])
def test_34401a_over_rs232(opened: Any) -> None:
    """Chapter 6, p. 192, "RS-232 operation": remote first, who it is, a beep and a text, four readings at 4.5 digits.

    Answers end with carriage return and newline (p. 150).
    """
    with opened() as port:
        port.timeout = 20_000

        def ask(message: str) -> str:
            port.write_raw(message.encode() + b"\n")
            answer = port.read_raw().decode("ascii")
            assert answer.endswith("\r\n"), answer
            return str(answer.removesuffix("\r\n"))

        port.write_raw(b":SYST:REM\n")
        assert re.fullmatch(r"HEWLETT-PACKARD,34401A,0,\d+-\d+-\d+", ask("*IDN?"))
        assert ask(":SYST:VERS?") == "1991.0"
        port.write_raw(b":SYST:BEEP;:DISP:TEXT '34401A'\n")
        assert ask(":DISP:TEXT?") == '"34401A"'
        port.write_raw(b":CONF:VOLT:DC 10,0.1;:SAMP:COUN 4\n")
        assert numbers(ask(":READ?"), METER) == pytest.approx([0.0] * 4, abs=5e-3)
        assert ask(":SYST:ERR?") == '+0,"No error"'


# ------------------------------------------------------------------------------------------------ 33220A


def test_33220a_a_simple_sine(rack: Rack) -> None:
    """Chapter 6, the first program: into 50 ohm, so that an open circuit has twice the voltage."""
    generator = rack.rate_source
    say(generator, "*RST\n*CLS\nFUNC SIN\nOUTP:LOAD 50\nFREQ 2500\nVOLT 1.2\nVOLT:OFFS 0.4\nOUTP ON")
    answers = numbers(generator.ask("FREQ?;VOLT?;VOLT:OFFS?;:OUTP:LOAD?"), GENERATOR, ";")
    assert answers == pytest.approx([2500.0, 1.2, 0.4, 50.0])
    applied = generator.ask("APPL?")
    assert re.fullmatch(rf'"SIN {GENERATOR},{GENERATOR},{GENERATOR}"', applied)
    rack.wait(2.0)
    volts, _ = digitize(rack, 2e-3, 8.0)  # five whole periods
    assert np.ptp(volts) == pytest.approx(2.4, abs=0.08)
    assert volts.mean() == pytest.approx(0.8, abs=0.02)


def test_33220a_amplitude_modulation(rack: Rack) -> None:
    """The envelope is (A / 2)(1 + m sin): of 10 V into an open circuit at 80 % there are 1 to 9 V from peak to peak."""
    generator = rack.rate_source
    say(
        generator,
        """*RST
        *CLS
        OUTP:LOAD 50
        FUNC SIN;:FREQ 5000;:VOLT 5;:VOLT:OFFS 0
        AM:INT:FUNC SIN
        AM:INT:FREQ 200
        AM:DEPT 80
        AM:STAT ON
        OUTP ON""",
    )
    assert generator.ask("AM:STAT?;SOUR?;INT:FUNC?") == "1;INT;SIN"
    assert number(generator.ask("AM:DEPT?"), GENERATOR) == 80.0
    rack.wait(2.0)
    volts, _ = digitize(rack, 10e-3, 12.0, 10_000)  # two periods of the modulation, 50 of the carrier
    envelope_v = np.abs(volts).reshape(50, 200).max(axis=1)  # each the peak of one carrier period
    assert envelope_v.max() == pytest.approx(4.5, abs=0.1)
    assert envelope_v.min() == pytest.approx(0.5, abs=0.15)
    assert crossings(volts) == pytest.approx(50, abs=1)


def test_33220a_frequency_shift_keying(rack: Rack) -> None:
    """Half of every period of the rate is the carrier, the other half the hop frequency."""
    play(rack, "FUNC SIN\nFREQ 500\nVOLT 4\nFSK:SOUR INT\nFSK:FREQ 1500\nFSK:INT:RATE 10\nFSK:STAT ON")
    generator = rack.rate_source
    assert numbers(generator.ask("FSK:FREQ?;INT:RATE?"), GENERATOR, ";") == [1500.0, 10.0]
    volts, step_s = digitize(rack, 100e-3, 8.0, 100_000)
    assert crossings(volts) == pytest.approx(0.05 * 500 + 0.05 * 1500, abs=2)
    rising = np.flatnonzero((volts[:-1] < 0.0) & (volts[1:] >= 0.0))
    frequencies = 1.0 / (np.diff(rising) * step_s)
    assert np.percentile(frequencies, 10) == pytest.approx(500.0, rel=0.03)
    assert np.percentile(frequencies, 90) == pytest.approx(1500.0, rel=0.03)


@pytest.mark.exhaustive
def test_33220a_linear_sweep(rack: Rack) -> None:
    """A sweep of one second from 100 Hz to 20 kHz has the mean of both as its number of periods."""
    play(rack, "FUNC SIN\nVOLT 2\nFREQ:STAR 100\nFREQ:STOP 20000\nSWE:SPAC LIN\nSWE:TIME 1\nSWE:STAT ON")
    generator = rack.rate_source
    assert generator.ask("SWE:SPAC?;STAT?") == "LIN;1"
    assert numbers(generator.ask("FREQ:STAR?;STOP?;CENT?;SPAN?"), GENERATOR, ";") == [100.0, 20e3, 10_050.0, 19_900.0]
    volts, _ = digitize(rack, 1.0, 4.0, 200_000)
    assert crossings(volts) == pytest.approx(10_050, rel=3e-3)


def test_33220a_a_triggered_sweep_is_waited_for(rack: Rack) -> None:
    """*TRG;*WAI, then *OPC?: the answer comes when the sweep has ended; the next program line may rely on it."""
    play(rack, "FUNC SIN\nVOLT 2\nFREQ:STAR 100\nFREQ:STOP 1000\nSWE:TIME 2\nTRIG:SOUR BUS\nSWE:STAT ON")
    begin_s = rack.behind.now()
    rack.rate_source.write("*TRG;*WAI")
    assert rack.rate_source.ask("*OPC?") == "1"
    assert 1.99 < rack.behind.now() - begin_s < 2.0 + BUSY_S


def test_33220a_pulse_whose_edges_change_while_it_runs(rack: Rack) -> None:
    """Ten edge times from 10 ns on, from 10 to 90 %, seen on the screen one after the other."""
    generator, scope = rack.rate_source, rack.oscilloscope
    say(
        generator,
        """*RST
        *CLS
        FUNC PULS
        OUTP:LOAD INF
        VOLT:LOW 0
        VOLT:HIGH 0.75
        PULS:PER 1E-3
        FUNC:PULS:WIDT 1E-4
        FUNC:PULS:TRAN 1E-8
        OUTP ON""",
    )
    say(scope, "*RST\n*CLS\n:CHAN1:SCAL 0.125;OFFS 0.375\n:TRIG:LEV 0.375\n:TIM:SCAL 20E-9")
    for tenth in range(10):
        edge_s = 10e-9 + tenth * 10e-9
        generator.write(f"FUNC:PULS:TRAN {edge_s:.3g}")
        assert number(generator.ask("FUNC:PULS:TRAN?"), GENERATOR) == pytest.approx(edge_s)
        rack.wait(0.3)
        scope.write(":DIG CHAN1")
        assert number(scope.ask(":MEAS:RIS? CHAN1"), SCOPE) == pytest.approx(edge_s, rel=0.08)
    assert numbers(generator.ask("PULS:PER?;:FUNC:PULS:WIDT?"), GENERATOR, ";") == pytest.approx([1e-3, 1e-4])


@pytest.mark.exhaustive
def test_33220a_pulse_width_modulation(rack: Rack) -> None:
    """A duty cycle of 35 % that swings by 15 % twice a second."""
    play(
        rack,
        """FUNC PULS
        FREQ 5000
        VOLT 2
        FUNC:PULS:DCYC 35
        PWM:INT:FUNC TRI
        PWM:INT:FREQ 2
        PWM:DEV:DCYC 15
        PWM:SOUR INT
        PWM:STAT ON""",
    )
    say(rack.oscilloscope, "*RST\n*CLS\n:CHAN1:SCAL 0.5\n:TIM:SCAL 50E-6")
    duties = []
    # a busy machine takes them when it can, and one that is slow may miss either end for a while
    while len(duties) < 24 or (len(duties) < 200 and not (min(duties) < 22.0 and max(duties) > 48.0)):
        rack.wait(0.0213)
        rack.oscilloscope.write(":DIG CHAN1")
        duties.append(number(rack.oscilloscope.ask(":MEAS:DUTY? CHAN1"), SCOPE))
    assert min(duties) == pytest.approx(20.0, abs=2.5)
    assert max(duties) == pytest.approx(50.0, abs=2.5)


def pulse_of_4000_points() -> NDArray[np.float64]:
    """Return a pulse: 200 points up, 400 at the top, 200 down, the rest at the bottom."""
    points = np.zeros(4000)
    points[:200] = np.arange(200) / 200.0
    points[200:600] = 1.0
    points[600:800] = 1.0 - np.arange(200) / 200.0
    return points


def check_arbitrary(rack: Rack) -> None:
    volts, _ = digitize(rack, 1e-3, 12.0)  # one period
    assert volts.max() == pytest.approx(5.0, abs=0.1)
    assert volts.min() == pytest.approx(0.0, abs=0.1)
    assert volts.mean() == pytest.approx(5.0 * pulse_of_4000_points().mean(), abs=0.05)


def test_33220a_arbitrary_waveform_as_a_list(rack: Rack) -> None:
    """The download in ASCII: points to VOLATILE, a copy under a name, and that name selected."""
    generator = rack.rate_source
    say(generator, "*RST\n*CLS")
    generator.write("DATA VOLATILE," + ",".join(f"{point:.3f}" for point in pulse_of_4000_points()))
    say(generator, "DATA:COPY PULSE1,VOLATILE\nFUNC:USER PULSE1\nFUNC USER")
    say(generator, "OUTP:LOAD 50\nFREQ 1000\nVOLT 5\nOUTP ON")
    assert generator.ask("FUNC?;FUNC:USER?") == "USER;PULSE1"
    assert generator.ask("DATA:ATTR:POIN? PULSE1") == "+4000"
    assert '"PULSE1"' in generator.ask("DATA:CAT?").split(",")
    rack.wait(2.0)
    check_arbitrary(rack)


@pytest.mark.parametrize(("order", "dtype"), [("NORM", ">i2"), ("SWAP", "<i2")])
def test_33220a_arbitrary_waveform_as_a_block(rack: Rack, order: str, dtype: str) -> None:
    """The download in binary: two bytes a point, 8191 the top, the high byte first or last."""
    generator = rack.rate_source
    codes = np.rint(8191 * pulse_of_4000_points()).astype(dtype).tobytes()
    say(generator, f"*RST\n*CLS\nFORM:BORD {order}")
    generator.write("DATA:DAC VOLATILE, ", f"#{len(str(len(codes)))}{len(codes)}".encode() + codes)
    say(generator, "FUNC:USER VOLATILE\nFUNC USER\nOUTP:LOAD 50\nFREQ 1000\nVOLT 5\nOUTP ON")
    assert generator.ask("DATA:ATTR:POIN?") == "+4000"
    rack.wait(2.0)
    check_arbitrary(rack)


def test_33220a_states_are_stored_and_recalled(rack: Rack) -> None:
    """*SAV and *RCL 1 to 4, and names for them."""
    play(rack, "APPL:SQU 1500,3,0.5")
    generator = rack.rate_source
    before = generator.ask("APPL?")
    say(generator, "*SAV 1\nMEM:STAT:NAME 1,MY_SQUARE\n*RST")
    assert generator.ask("APPL?") == '"SIN +1.0000000000000E+03,+1.0000000000000E-01,+0.0000000000000E+00"'
    generator.write("*RCL 1")
    assert generator.ask("APPL?") == before == '"SQU +1.5000000000000E+03,+3.0000000000000E+00,+5.0000000000000E-01"'
    assert generator.ask("OUTP?;:MEM:STAT:VAL? 1") == "1;1"
    rack.wait(2.0)
    volts, _ = digitize(rack, 2e-3, 8.0)
    assert (volts.max(), volts.min()) == pytest.approx((2.0, -1.0), abs=0.07)


def test_33220a_service_when_a_burst_is_complete(rack: Rack) -> None:
    """The status registers: *OPC after a triggered burst requests service when its last period is out."""
    play(rack, "FUNC SIN\nFREQ 1000\nVOLT 2\nBURS:MODE TRIG\nBURS:NCYC 3000\nTRIG:SOUR BUS\nBURS:STAT ON")
    generator = rack.rate_source
    say(generator, "*CLS\n*ESE 1\n*SRE 32")
    generator.trigger()
    generator.write("*OPC")
    assert not generator.requests_service()
    rack.wait(2.9)
    assert not generator.requests_service()
    rack.wait(0.2)
    assert generator.requests_service()
    assert generator.ask("*ESR?") == "+1"
    assert generator.ask("*OPC?") == "1"


# ------------------------------------------------------------------------------------------------ E3631A


def test_e3631a_three_outputs_with_apply(rack: Rack) -> None:
    """Chapter 3, p. 84: APPLy sets voltage and current limit of each output, one switch puts all of them on."""
    supply = rack.power
    say(supply, "*RST\n*CLS\nAPPL P6V,5.0,1.0\nAPPL P25V,10.0,0.5\nAPPL N25V,-10.0,0.2\nOUTP ON")
    rack.wait(2.0)
    assert supply.ask("APPL? P6V") == '"5.000000,1.000000"'
    assert supply.ask("APPL?") == '"-10.000000,0.200000"'
    assert supply.ask("INST?;:INST:NSEL?;:OUTP?") == "N25V;3;1"
    read = [number(supply.ask(f"MEAS:VOLT? {output}"), SUPPLY) for output in ("P6V", "P25V", "N25V")]
    assert read == pytest.approx([5.0, 10.0, -10.0], abs=2e-3)
    assert rack.behind.value("rail.positive.voltage_v") == pytest.approx(10.0, abs=2e-3)
    assert rack.behind.value("rail.negative.voltage_v") == pytest.approx(-10.0, abs=2e-3)
    assert number(supply.ask("MEAS:CURR? P25V"), SUPPLY) == pytest.approx(
        rack.behind.value("rail.positive.current_a"), abs=2e-4
    )
    say(rack.oscilloscope, "*RST\n*CLS\n:CHAN4:DISP 1;SCAL 5\n:DIG CHAN4")
    assert number(rack.oscilloscope.ask(":MEAS:VAV? CHAN4"), SCOPE) == pytest.approx(10.0, abs=0.2)  # 8 bits of 40 V


def currents_a(rack: Rack) -> list[float]:
    """Step P25V from 0 to 0.8 V and read the current of each step."""
    supply, found = rack.power, []
    say(supply, "*RST\n*CLS\nINST P25V\nCURR 0.03\nVOLT 0\nOUTP ON")
    for tenths in range(9):
        supply.write(f"VOLT {tenths / 10:g}")
        rack.wait(0.5)
        found.append(number(supply.ask("MEAS:CURR? P25V"), SUPPLY))
    return found


def test_e3631a_voltage_steps_and_the_current_of_each(rack: Rack) -> None:
    """Chapter 7, the characterisation of a diode: step by step a voltage, then its current; here 47 ohm more or less.

    Then a level that needs more than the limit: the current stays, and the output says that it is in constant current.
    """
    supply = rack.power
    before_a = currents_a(rack)
    rack.behind.put("rail.positive.load_ohm", 47.0)
    more_a = np.subtract(currents_a(rack), before_a)
    assert more_a == pytest.approx([tenths / 10 / 47.0 for tenths in range(9)], abs=2e-4)
    assert re.fullmatch(r"\+?2", supply.ask("STAT:QUES:INST:ISUM2:COND?"))
    supply.write("VOLT 2")
    rack.wait(0.5)
    assert number(supply.ask("MEAS:CURR?"), SUPPLY) == pytest.approx(0.03, abs=2e-4)
    conductance_s = 1.0 / 47.0 + before_a[8] / 0.8
    assert number(supply.ask("MEAS:VOLT?"), SUPPLY) == pytest.approx(0.03 / conductance_s, rel=0.02)
    assert re.fullmatch(r"\+?1", supply.ask("STAT:QUES:INST:ISUM2:COND?"))
    supply.write("OUTP OFF")
    assert supply.ask("OUTP?") == "0"


def test_e3631a_tracking(rack: Rack) -> None:
    """Chapter 3, p. 57 and 91: N25V takes the level of P25V when tracking begins, then either moves the other."""
    supply = rack.power
    say(supply, "*RST\n*CLS\nAPPL P25V,5,0.5\nAPPL N25V,-3,0.5\nOUTP ON\nOUTP:TRAC ON")
    assert supply.ask("OUTP:TRAC?") == "1"
    assert number(supply.ask("INST N25V;:VOLT?"), SUPPLY) == -5.0
    say(supply, "INST P25V;:VOLT 8")
    rack.wait(2.0)
    assert number(supply.ask("MEAS:VOLT? N25V"), SUPPLY) == pytest.approx(-8.0, abs=2e-3)
    say(supply, "INST N25V;:VOLT -6")
    rack.wait(2.0)
    assert number(supply.ask("MEAS:VOLT? P25V"), SUPPLY) == pytest.approx(6.0, abs=2e-3)
    supply.write("OUTP:TRAC OFF")


def test_e3631a_bus_trigger_after_a_delay(rack: Rack) -> None:
    """Chapter 3, p. 96: pending levels go to the output so many seconds after the trigger."""
    supply = rack.power
    say(supply, "*RST\n*CLS\nINST P25V\nVOLT 2\nOUTP ON\nVOLT:TRIG 12;:CURR:TRIG 0.6\nTRIG:SOUR BUS\nTRIG:DEL 30\nINIT")
    rack.wait(1.0)
    supply.trigger()
    rack.wait(20.0)
    assert numbers(supply.ask("VOLT?;CURR?;:TRIG:DEL?"), SUPPLY, ";") == [2.0, 1.0, 30.0]
    rack.wait(15.0)
    assert numbers(supply.ask("VOLT?;CURR?;:MEAS:VOLT?"), SUPPLY, ";") == pytest.approx([12.0, 0.6, 12.0], abs=2e-3)


def test_e3631a_coupled_outputs_change_at_one_trigger(rack: Rack) -> None:
    """Chapter 4, p. 88: a trigger is obeyed by all the outputs that are coupled."""
    supply = rack.power
    say(supply, "*RST\n*CLS\nINST:COUP P6V,P25V\nTRIG:SOUR IMM\nINST P6V;:VOLT:TRIG 3\nINST P25V;:VOLT:TRIG 7\nINIT")
    assert supply.ask("INST:COUP?") == "P6V,P25V"
    assert number(supply.ask("VOLT?"), SUPPLY) == 7.0
    assert number(supply.ask("INST P6V;:VOLT?"), SUPPLY) == 3.0


def test_e3631a_states_are_stored_and_recalled(rack: Rack) -> None:
    """Chapter 3, p. 62: levels, switch and selection come back; a place that was never used is the reset state."""
    supply = rack.power
    say(supply, "*RST\n*CLS\nAPPL P25V,7.5,0.25\nOUTP ON\n*SAV 2\n*RST")
    assert supply.ask("APPL? P25V") == '"0.000000,1.000000"'
    assert supply.ask("OUTP?") == "0"
    supply.write("*RCL 2")
    rack.wait(2.0)
    assert supply.ask("INST?;:OUTP?;:APPL?") == 'P25V;1;"7.500000,0.250000"'
    assert rack.behind.value("rail.positive.voltage_v") == pytest.approx(7.5, abs=2e-3)
    supply.write("*RCL 3")
    assert supply.ask("INST?;:OUTP?;:APPL? P25V") == 'P6V;0;"0.000000,1.000000"'


# ------------------------------------------------------------------------------------------------ DSO7104B


class Checking:
    """The guide's own way to talk: the error queue is read after every command and every query."""

    def __init__(self, scope: Instrument) -> None:
        self._scope = scope

    def do(self, command: str, data: bytes = b"") -> None:
        self._scope.write(command, data)
        assert self._scope.ask(":SYSTem:ERRor?") == '+0,"No error"', command

    def ask(self, question: str) -> str:
        answer = self._scope.ask(question)
        assert self._scope.ask(":SYSTem:ERRor?") == '+0,"No error"', question
        return answer

    def block(self, question: str) -> bytes:
        answer = self._scope.block(question)
        assert self._scope.ask(":SYSTem:ERRor?") == '+0,"No error"', question
        return answer


def initialize(scope: Checking) -> None:
    scope.do("*CLS")
    assert scope.ask("*IDN?").startswith("AGILENT TECHNOLOGIES,DSO7104B,MY")
    scope.do("*RST")


def capture(scope: Checking) -> bytes:
    """Set up by :AUToscale, set the trigger, save the set-up, change it all and bring it back, and digitise."""
    scope.do(":AUToscale")
    scope.do(":TRIGger:MODE EDGE")
    assert scope.ask(":TRIGger:MODE?") == "EDGE"
    scope.do(":TRIGger:EDGE:SOURce CHANnel1")
    assert scope.ask(":TRIGger:EDGE:SOURce?") == "CHAN1"
    scope.do(":TRIGger:EDGE:LEVel 0.5")
    assert number(scope.ask(":TRIGger:EDGE:LEVel?"), r"[+-]\d\.\d+E[+-]\d{2,3}") == pytest.approx(0.5, abs=0.02)
    scope.do(":TRIGger:EDGE:SLOPe POSitive")
    assert scope.ask(":TRIGger:EDGE:SLOPe?") == "POS"
    setup = scope.block(":SYSTem:SETup?")
    scope.do(":CHANnel1:SCALe 0.05")
    scope.do(":CHANnel1:OFFSet -1.5")
    scope.do(":TIMebase:SCALe 0.002")
    scope.do(":TIMebase:POSition 0.0")
    scope.do(":ACQuire:TYPE PEAK")
    return setup


def test_dso7104b_the_guides_program(rack: Rack) -> None:
    """Initialise, capture, analyse: a sine of 2.5 kHz and 2 V from peak to peak, 0.5 V above ground."""
    play(rack, "FUNC SIN\nFREQ 2500\nVOLT 2\nVOLT:OFFS 0.5")
    scope = Checking(rack.oscilloscope)
    initialize(scope)
    setup = capture(scope)
    scope.do(":SYSTem:SETup ", f"#8{len(setup):08d}".encode() + setup)
    assert scope.ask(":ACQuire:TYPE?") == "NORM"
    assert float(scope.ask(":CHANnel1:SCALe?")) > 0.1
    assert float(scope.ask(":TIMebase:SCALe?")) == pytest.approx(200e-6, rel=0.8)
    scope.do(":DIGitize CHANnel1")
    scope.do(":MEASure:SOURce CHANnel1")
    assert scope.ask(":MEASure:SOURce?") in {"CHAN1", "CHAN1,NONE", "CHAN1,CHAN1", "CHAN1,CHAN2"}
    scope.do(":MEASure:FREQuency")
    assert number(scope.ask(":MEASure:FREQuency?"), SCOPE) == pytest.approx(2500.0, rel=0.01)
    scope.do(":MEASure:VAMPlitude")
    assert number(scope.ask(":MEASure:VAMPlitude?"), SCOPE) == pytest.approx(2.0, rel=0.05)
    check_picture(scope)
    check_download(scope)


def check_picture(scope: Checking) -> None:
    scope.do(":HARDcopy:INKSaver OFF")
    picture = scope.block(":DISPlay:DATA? PNG,SCReen,COLor")
    assert picture.startswith(b"\x89PNG\r\n\x1a\n")
    assert picture.endswith(b"IEND\xaeB`\x82")


def check_download(scope: Checking) -> None:
    """Points, source and format, then the six numbers of the preamble one by one, the data, and volts of them."""
    scope.do(":WAVeform:POINts:MODE RAW")
    scope.do(":WAVeform:POINts 10240")
    scope.do(":WAVeform:SOURce CHANnel1")
    scope.do(":WAVeform:FORMat BYTE")
    assert scope.ask(":WAVeform:FORMat?") == "BYTE"
    assert re.fullmatch(WAV_PREAMBLE, scope.ask(":WAVeform:PREamble?"))
    step_s, begin_s, step_v, origin_v = (
        number(scope.ask(f":WAVeform:{name}?"), SCOPE) for name in ("XINCrement", "XORigin", "YINCrement", "YORigin")
    )
    zero = float(scope.ask(":WAVeform:YREFerence?"))
    codes = np.frombuffer(scope.block(":WAVeform:DATA?"), np.uint8).astype(np.float64)
    assert codes.size == int(scope.ask(":WAVeform:POINts?"))
    times_s = begin_s + step_s * np.arange(codes.size)
    volts = (codes - zero) * step_v + origin_v
    at_trigger_v = float(np.interp(0.0, times_s, volts))
    assert at_trigger_v == pytest.approx(0.5, abs=0.05)
    phase = np.arcsin(np.clip((at_trigger_v - 0.5), -1.0, 1.0))
    assert volts == pytest.approx(0.5 + np.sin(2.0 * np.pi * 2500.0 * times_s + phase), abs=0.08)


def test_dso7104b_averages(rack: Rack) -> None:
    """:ACQuire:TYPE AVERage with a count of triggers; the preamble tells type 2 and the count."""
    play(rack, "FUNC SIN\nFREQ 2500\nVOLT 2")
    scope = rack.oscilloscope
    say(scope, "*RST\n*CLS\n:CHAN1:SCAL 0.5\n:TIM:SCAL 1E-4\n:WAV:FORM BYTE;POIN 1000")
    say(scope, ":ACQ:TYPE AVER\n:ACQ:COUN 64\n:ACQ:COMP 100\n:DIG CHAN1")
    assert scope.ask("*OPC?") == "1"
    assert scope.ask(":ACQ:TYPE?;COUN?;COMP?") == "AVER;+64;+100"
    preamble = scope.ask(":WAV:PRE?").split(",")
    assert preamble[:4] == ["+0", "+2", "+1000", "+64"]
    codes = np.frombuffer(scope.block(":WAV:DATA?"), np.uint8).astype(np.float64)
    volts = (codes - float(preamble[9])) * float(preamble[7]) + float(preamble[8])
    times_s = float(preamble[5]) + float(preamble[4]) * np.arange(1000)
    assert volts == pytest.approx(np.sin(2.0 * np.pi * 2500.0 * times_s), abs=0.05)
