"""The DMM6500 digitises, and goes through the blocks of a trigger model."""

from __future__ import annotations

import numpy as np
import pytest
from simrack.instruments.hp34401a import MeterErrors
from simrack.instruments.keithley import KeithleyDMM6500Twin

from simrack_tests.instruments.conversation import Conversation
from simrack_tests.instruments.fake_world import FakeWorld


class Bench:
    def __init__(self) -> None:
        self.world = FakeWorld()
        self.world.offset_v = 1.0
        self.meter = KeithleyDMM6500Twin(self.world, errors=MeterErrors.none())  # type: ignore[arg-type]
        self.world.clock.attend(self.meter)
        self.talk = Conversation(self.meter, self.world.clock)

    def numbers(self, query: str) -> list[float]:
        return [float(each) for each in (self.talk.ask(query) or "").split(",")]


@pytest.fixture
def bench() -> Bench:
    return Bench()


def test_samples_are_the_voltage_at_their_rate(bench: Bench) -> None:
    bench.world.amplitude_v, bench.world.frequency_hz = 0.5, 100.0
    bench.talk.write('DIG:FUNC "VOLTage";:DIG:VOLT:SRAT 20000;:DIG:COUN 400')
    [last] = bench.numbers("READ:DIG?")
    pairs = np.reshape(bench.numbers('TRAC:DATA? 1,400,"defbuffer1",READ,REL'), (400, 2))
    assert np.diff(pairs[1:-1, 1]) == pytest.approx([50e-6] * 397, abs=2e-6)
    times_s = bench.meter.stored[0][1] + pairs[:-1, 1]
    assert pairs[:-1, 0] == pytest.approx(1.0 + 0.5 * np.sin(200.0 * np.pi * times_s), abs=1e-3)
    assert last == pytest.approx(pairs[-1, 0])
    assert bench.talk.ask("FUNC?;:DIG:FUNC?") == "NONE;VOLT"


def test_the_buffer_keeps_the_last_samples_or_the_first(bench: Bench) -> None:
    bench.talk.write('TRAC:POIN 50;:DIG:FUNC "VOLT";:DIG:COUN 9000;:TRAC:TRIG:DIG')
    assert bench.talk.ask("TRAC:ACT?") == "50"
    assert bench.meter.stored[-1][1] - bench.meter.stored[0][1] == pytest.approx(49e-6, abs=1e-6)
    bench.talk.write("TRAC:FILL:MODE ONCE;:TRAC:CLE;:TRAC:TRIG:DIG")
    assert bench.talk.ask("TRAC:ACT?") == "50"


@pytest.mark.parametrize(
    ("message", "error"),
    [
        ("READ:DIG?", -221),
        ('DIG:FUNC "VOLT";:READ?', -221),
        ('DIG:FUNC "RES"', -224),
        ("DIG:VOLT:SRAT 999", -222),
        ("DIG:VOLT:SRAT 10000;APER 2E-4", -221),
        ('DIG:FUNC "VOLT";:TRAC:POIN 7E6;:DIG:COUN 5E6;:TRAC:TRIG:DIG', -225),
        ('TRIG:BLOC:MDIG 1,"nobody\'s"', -224),
        ('TRIG:BLOC:MDIG 1,"defbuffer1",INF', -222),
        ("INIT", -221),
        ("TRIG:BLOC:DEL:CONS 1,9;:TRIG:BLOC:NOP 2;:INIT;INIT", -213),
    ],
)
def test_what_cannot_be_is_refused(message: str, error: int, bench: Bench) -> None:
    bench.talk.write(message)
    bench.talk.settle()
    assert int((bench.talk.ask("SYST:ERR?") or "").partition(",")[0]) == error
    assert bench.talk.ask("*OPC?") == "1"


@pytest.mark.parametrize(("words", "kind"), [("REAL", "<f8"), ("SREAL", "<f4"), ("REAL;:FORM:BORD NORM", ">f8")])
def test_readings_may_be_binary(words: str, kind: str, bench: Bench) -> None:
    bench.talk.write(f"COUN 3;:TRAC:TRIG;:FORM {words}")
    answer = (bench.talk.ask('TRAC:DATA? 1,3,"defbuffer1",READ,REL') or "").encode("latin-1")
    assert answer[:2] == b"#0"
    assert np.frombuffer(answer[2:], kind).reshape(3, 2)[:, 0] == pytest.approx([1.0] * 3)
    bench.talk.write('FETC? "defbuffer1",UNIT')
    assert (bench.talk.ask("SYST:ERR?") or "").startswith("1133,")


def test_nothing_is_wired_to_the_current_input(bench: Bench) -> None:
    bench.talk.write("DIG:CURR:RANG 50E-6")
    assert bench.talk.ask("DIG:CURR:RANG?") == "0.0001"
    assert bench.numbers("MEAS:DIG:CURR?") == [0.0]


def test_the_blocks_of_a_model_are_gone_through(bench: Bench) -> None:
    bench.talk.write('TRIG:LOAD "Empty";:TRIG:BLOC:BUFF:CLE 1;:TRIG:BLOC:MDIG 2,"defbuffer1",3')
    bench.talk.write("TRIG:BLOC:DEL:CONS 3,0.5")
    bench.talk.write("TRIG:BLOC:BRAN:COUN 4,4,2")
    assert (bench.talk.ask("TRIG:BLOC:LIST?") or "").splitlines()[1:3] == [
        "2) MEASURE_DIGITIZE BUFFER: defbuffer1 COUNT: 3",
        "3) DELAY_CONSTANT DELAY: 0.500000000",
    ]
    bench.talk.write("INIT")
    assert bench.talk.ask("TRIG:STAT?") == "RUNNING;RUNNING;2"
    assert bench.talk.ask("*OPC?;:TRIG:STAT?;:TRAC:ACT?") == "1;IDLE;IDLE;4;12"
    times_s = np.reshape([instant_s for _, instant_s in bench.meter.stored], (4, 3))
    assert bench.talk.ask("INIT;*OPC?;:TRIG:STAT?;:TRAC:ACT?") == "1;IDLE;IDLE;4;12"
    assert bench.meter.stored[0][1] > times_s[-1, -1]
    assert np.diff(times_s[:, 0]) == pytest.approx([0.5 + 3 * (times_s[0, 1] - times_s[0, 0])] * 3, abs=1e-3)


@pytest.mark.parametrize("event", ["COMM", "EXT"])
def test_a_block_waits_for_its_event(event: str, bench: Bench) -> None:
    bench.talk.write(f"TRIG:BLOC:WAIT 1,{event};:TRIG:BLOC:MDIG 2;:INIT")
    assert bench.talk.ask("TRIG:STAT?") == "WAITING;WAITING;1"
    bench.talk.write("*TRG") if event == "COMM" else bench.meter.external_trigger()
    assert bench.talk.ask("*OPC?;:TRAC:ACT?") == "1;1"


@pytest.mark.parametrize("end", ["ABOR", "*RST", None])
def test_a_model_without_end_is_ended(end: str | None, bench: Bench) -> None:
    bench.talk.write("TRIG:BLOC:MDIG 1;:TRIG:BLOC:BRAN:ALW 2,1;:INIT")
    bench.world.clock.sleep_until(1.0)
    assert int(bench.talk.ask("TRAC:ACT?") or 0) > 10
    bench.talk.write(end) if end else bench.meter.clear()
    assert (bench.talk.ask("*OPC?;:TRIG:STAT?") or "").startswith("1;IDLE")
