"""What takes the server long: it goes on in slices, the others are answered in between, and bench time waits for it."""

from __future__ import annotations

import select
from typing import TYPE_CHECKING, Any

import pytest
import pyvisa
from simrack.instruments.dso7104b import Dso7104BTwin, ScopeErrors
from simrack.serve import Control, RemoteClock, ServedClock, ServerSettings
from simrack_tests.serve.lamp import ALL, IDENTITY, MOST_SLICES, Lamp, served_lamp, serving
from simrack_tests.serve.test_raw import Wire, wires

from vcfbench.clock import VirtualClock
from vcfbench.sim.gyro.design import paper_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from collections.abc import Iterator

    from simrack_tests.serve.lamp import Served


@pytest.fixture
def served() -> Iterator[Served]:
    """A thinker, which thinks until the lamp beside it has been asked for three readings of its level."""
    clock = ServedClock(1e6)
    devices = {"thinker": Lamp(clock), "lamp": Lamp(clock)}
    devices["thinker"].thought = lambda: devices["lamp"].readings >= 3
    with serving(devices, clock, ServerSettings(offers=dict.fromkeys(devices, ALL))) as running:
        yield running


@pytest.mark.parametrize("kind", ["tcp", "vxi11", "hislip"])
def test_others_are_answered_while_something_long_is_worked_out(served: Served, kind: str) -> None:
    manager = pyvisa.ResourceManager("@py")
    resource: Any = manager.open_resource(served.resource(kind, "thinker"), timeout=30_000)
    other = Wire(served.port("tcp"))
    try:
        resource.write_termination = resource.read_termination = "\n"
        resource.write("THINK?")
        for _ in range(3):
            assert other.ask(b"READ?\n")
        assert 0 < int(resource.read()) < MOST_SLICES
        assert resource.query("*IDN?") == IDENTITY.decode().strip()
    finally:
        other.close()
        resource.close()


def test_who_asks_the_busy_one_waits_for_its_turn(served: Served) -> None:
    with wires(served, 1) as (lamp,):
        thinker, second = (Wire(served.port("tcp", "thinker")) for _ in range(2))
        try:
            thinker.send(b"THINK?;COUNT?\n")
            second.send(b"*IDN?\n")
            assert second.silent()
            for _ in range(3):
                lamp.ask(b"READ?\n")
            slices, count = thinker.line().split(b";")
            assert int(slices) > 0
            assert int(count) == 0
            assert second.line() == IDENTITY
        finally:
            thinker.close()
            second.close()


def test_who_asks_may_leave_and_a_device_clear_ends_it(served: Served) -> None:
    thinker = Wire(served.port("tcp", "thinker"))
    thinker.send(b"THINK?\n")
    thinker.reset()
    with wires(served, 1) as (lamp,):
        for _ in range(3):
            lamp.ask(b"READ?\n")
    again = Wire(served.port("tcp", "thinker"))
    assert again.ask(b"*IDN?\n") == IDENTITY
    again.close()


def test_a_question_is_answered_before_the_next_slice_whoever_works() -> None:
    clock = ServedClock(1e6)
    devices = {role: Lamp(clock) for role in ("one", "two", "lamp")}
    with serving(devices, clock, ServerSettings(offers=dict.fromkeys(devices, ALL))) as running:
        other, *thinkers = made = [Wire(running.port("tcp", role)) for role in ("lamp", "one", "two")]
        asked = late = 0

        def thought() -> bool:
            """In each slice, once both think: see whether what was asked in the one before is answered; ask again."""
            nonlocal asked, late
            if not (devices["one"].slices and devices["two"].slices):
                return False
            if asked and not select.select([other.socket], [], [], 0)[0]:
                late += 1
                return False
            assert not asked or other.line() == IDENTITY
            asked += 1
            other.send(b"*IDN?\n")
            return asked > 100

        devices["one"].thought = devices["two"].thought = thought
        try:
            for each in thinkers:
                each.send(b"THINK?\n")
            assert all(each.line() for each in thinkers)
            assert late < 20
        finally:
            for each in made:
                each.close()


def test_time_that_is_led_waits_for_what_is_worked_out() -> None:
    with served_lamp() as served, wires(served) as (wire,), Control(served.server.control.port) as control:
        clock = RemoteClock(control)
        served.lamp.thought = lambda: served.lamp.slices >= 500
        wire.send(b"THINK?;TIME?\n")
        clock.sleep_until(50.0)
        slices, instant = wire.line().split(b";")
        assert int(slices) == 500
        assert float(instant) < 50.0


@pytest.mark.exhaustive
def test_sliced_waveform_has_bytes_of_whole() -> None:
    """Of the oscilloscope: the answer at once, and the one that is worked out slice by slice."""
    said = []
    for sliced in (False, True):
        clock = VirtualClock()
        world = World(clock, paper_bench(), 0)
        world.set_rail("positive", 10.0)
        world.set_rail("negative", -10.0)
        clock.sleep_until(2.0)
        scope = Dso7104BTwin(world, {1: "drive"}, ScopeErrors.none())
        if sliced:
            scope.engine.hand_over = lambda: None
        for line in (
            b"*RST;:CHAN1:DISP 1;:TIM:RANG 0.02;:DIG CHAN1\n",
            b":WAV:SOUR CHAN1;:WAV:POIN:MODE MAX;:WAV:POIN 100000\n",
        ):
            scope.write(line)
            while (due := scope.wake_at()) is not None and due > clock.now():
                clock.sleep_until(due)
        for form in (b"BYTE", b"WORD", b"ASC"):
            scope.write(b":WAV:FORM " + form + b";DATA?\n")
            slices = 0
            while scope.engine.working:
                assert scope.read(1) == (b"", False)
                scope.engine.work()
                slices += 1
            assert (slices > 2) is sliced
            said.append(scope.read(1 << 24))
    assert said[:3] == said[3:]
