"""Triggers of the simulated 34401A, and readings that go out while others are taken."""

from __future__ import annotations

import pytest

from simrack_tests.instruments.hp34401a.bench import MeterBench, bench

READING = "+1.25000000E+00"


def fast(interface: str = "gpib") -> MeterBench:
    made = bench(interface=interface)
    made.talk.write("SYST:REM" if interface == "rs232" else "*CLS")
    made.talk.write("CONF:VOLT:DC 10;:VOLT:NPLC 0.02;:ZERO:AUTO OFF;:TRIG:DEL 0")
    made.talk.settle()
    return made


@pytest.mark.parametrize("interface", ["gpib", "rs232"])
def test_an_endless_read_streams_until_a_device_clear(interface: str) -> None:
    made = fast(interface)
    made.talk.write("TRIG:COUN INF;:READ?")
    received = b""
    for _ in range(5):
        made.world.clock.sleep_until(made.world.clock.now() + 0.1)
        data, end = made.meter.read(1 << 16)
        assert not end
        received += data
    readings = received.decode().split(",")
    assert readings.pop() == ""
    assert set(readings) == {READING}
    assert len(readings) == pytest.approx(0.48 / 1e-3, abs=3)  # 20 ms to arm; the last one is kept back
    made.meter.clear()
    assert made.meter.read(100) == (b"", False)
    made.talk.write("*CLS")
    assert made.talk.ask("TRIG:COUN?") == "+9.90000000E+37"
    assert made.meter.wake_at() is None


def test_ctrl_c_ends_an_endless_read_on_rs232() -> None:
    made = fast("rs232")
    made.talk.write("TRIG:COUN INF;:READ?")
    made.world.clock.sleep_until(made.world.clock.now() + 0.1)
    assert made.meter.read(100)[0].startswith(READING.encode())
    made.meter.write(b"\x03")
    assert made.talk.ask("TRIG:SOUR?") == "IMM"


def test_more_than_the_memory_holds_comes_through_as_one_message() -> None:
    made = fast()
    made.talk.write("SAMP:COUN 3000;:READ?")
    received, end = b"", False
    while not end:
        data, end = made.meter.read(1 << 20)
        received += data
        if not data:
            wake = made.meter.wake_at()
            assert wake is not None
            made.world.clock.sleep_until(wake)
    assert received.decode() == ",".join([READING] * 3000) + "\n"
    assert made.talk.errors() == []


@pytest.mark.parametrize("interface", ["gpib", "rs232"])
def test_queries_around_trigger_share_message(interface: str) -> None:
    made = fast(interface)
    made.talk.write("SAMP:COUN 600;COUN?;:READ?;:TRIG:COUN?")
    received, end = b"", False
    while not end:
        data, end = made.meter.read(100)
        received += data
        if not data:
            made.world.clock.sleep_until(made.world.clock.now() + 0.05)
    assert received.decode().strip() == ";".join(["+600", ",".join([READING] * 600), "+1.00000000E+00"])
    assert made.talk.errors() == []


def test_the_message_available_bit_while_readings_stream() -> None:
    """Set by the first reading that can go out (20 ms to arm, 1 ms each, the last kept back), cleared by taking it."""
    made = fast()
    made.talk.write("TRIG:COUN INF;:READ?")
    started_s = made.world.clock.now()
    seen = []
    for waited_s in (0.0, 0.021, 0.025):
        made.world.clock.sleep_until(started_s + waited_s)
        seen.append(made.meter.status_byte() & 16)
    assert seen == [0, 0, 16]
    assert made.meter.read(1000)[0].startswith(READING.encode())
    assert made.meter.status_byte() & 16 == 0


def test_small_reads_lose_nothing() -> None:
    made = fast()
    made.talk.write("SAMP:COUN 600;:READ?")
    received, end = b"", False
    while not end:
        data, end = made.meter.read(7)
        received += data
        if not data:
            made.world.clock.sleep_until(made.world.clock.now() + 0.05)
    assert received.decode() == ",".join([READING] * 600) + "\n"


def test_an_answer_before_it_in_the_message_comes_first() -> None:
    made = fast()
    made.talk.write("SAMP:COUN 600;:TRIG:SOUR?;:READ?")
    made.world.clock.sleep_until(made.world.clock.now() + 0.3)
    received, end = b"", False
    while not end:
        data, end = made.meter.read(1 << 20)
        received += data
        made.world.clock.sleep_until(made.world.clock.now() + 0.1)
    assert received.decode() == "IMM;" + ",".join([READING] * 600) + "\n"


def test_a_meter_that_nobody_reads_waits_with_a_full_buffer() -> None:
    made = fast()
    made.talk.write("TRIG:COUN INF;:READ?")
    made.world.clock.sleep_until(100.0)
    assert len(made.world.windows) == 512
    assert made.meter.wake_at() is None
    data, _ = made.meter.read(1 << 20)
    assert data.count(b",") == 511
    made.world.clock.sleep_until(101.0)
    assert len(made.world.windows) == pytest.approx(512 + 511, abs=2)


def test_up_to_the_memory_it_answers_when_it_is_through() -> None:
    made = fast()
    made.talk.write("SAMP:COUN 512;:READ?")
    made.world.clock.sleep_until(made.world.clock.now() + 0.2)
    assert made.meter.read(1 << 20) == (b"", False)
    assert (made.talk.read() or "").count(",") == 511


def test_init_refuses_more_readings_than_memory() -> None:
    made = fast()
    assert made.talk.refusals("TRIG:COUN INF;:INIT") == [531]
    made.talk.write('DATA:FEED RDG_STORE,"";:INIT')
    made.world.clock.sleep_until(made.world.clock.now() + 1.0)
    assert made.meter.triggering.sequence is not None
    made.meter.clear()
    assert made.talk.errors() == []
    assert made.talk.ask("DATA:POIN?") == "+0"


@pytest.mark.parametrize("source", ["BUS", "EXT"])
def test_triggers_times_samples(source: str) -> None:
    made = fast()
    made.talk.write(f"TRIG:SOUR {source};COUN 3;:SAMP:COUN 4;:INIT")
    for shot in range(3):
        made.world.clock.sleep_until(10.0 * (shot + 1))
        assert len(made.world.windows) == 4 * shot
        made.meter.trigger() if source == "BUS" else made.meter.external_trigger()
    assert made.talk.ask("FETC?") == ",".join([READING] * 12)
    assert made.talk.errors() == []


def test_triggers_that_come_at_the_wrong_time() -> None:
    made = fast()
    made.talk.write("TRIG:SOUR BUS;COUN 2;:VOLT:NPLC 100;:INIT")
    made.world.clock.sleep_until(10.0)
    made.talk.write("*TRG")
    made.world.clock.sleep_until(10.5)
    made.talk.write("*TRG")
    made.world.clock.sleep_until(20.0)
    made.talk.write("*TRG")
    assert made.talk.errors() == [-211]
    assert made.talk.ask("FETC?") == ",".join([READING] * 2)
