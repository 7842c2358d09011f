"""A stop that comes from another thread, such as that of the page."""

from __future__ import annotations

import signal
import threading

import pytest
from simrack.attendance import AttendedClock

from vcfbench.clock import VirtualClock, WallClock
from vcfbench.errors import Aborted, BenchError, ConfigError, NotSafe
from vcfbench.safety.signals import ControlClock, StopSignals


def test_it_wakes_who_waits_and_says_who_wanted_it() -> None:
    """A warm-up may be half an hour long: nobody shall wait for its end."""
    clock = WallClock()
    with StopSignals() as signals:
        timer = threading.Timer(0.2, signals.stop, ["the page"])
        timer.start()
        with pytest.raises(Aborted, match=r"^stopped by the page$"):
            ControlClock(clock, signals).sleep_until(60.0)
        timer.join()
    assert clock.now() < 30.0


def test_a_signal_after_it_has_its_own_name() -> None:
    with StopSignals() as signals:
        timer = threading.Timer(0.0, signals.stop, ["the page"])
        timer.start()
        timer.join()
        with pytest.raises(Aborted, match=r"^stopped by SIGINT$"):
            signal.raise_signal(signal.SIGINT)


def test_where_no_signal_is_watched_each_wait_looks_for_it() -> None:
    signals, clock = StopSignals(), WallClock()
    timer = threading.Timer(0.05, signals.stop, ["the page"])
    timer.start()
    with pytest.raises(Aborted, match=r"^stopped by the page$"):
        ControlClock(clock, signals).sleep_until(60.0)
    timer.join()
    assert clock.now() < 30.0


def test_what_is_attended_is_stopped_at_once_also_after_a_wait_in_it() -> None:
    """A person's command waits and asks in turn; a stop shall not wait for an answer that does not come."""
    went_on: list[str] = []

    def command(signals: StopSignals) -> None:
        signals.wait(WallClock(), 0.0)
        signal.raise_signal(signal.SIGINT)
        went_on.append("to the next safe point")

    with StopSignals() as signals, pytest.raises(Aborted, match=r"^stopped by SIGINT$"):
        signals.attend(lambda: command(signals))
    assert went_on == []


def test_what_is_undivided_is_done_before_the_second_signal_stops_the_bench() -> None:
    done: list[str] = []

    def write(signals: StopSignals) -> None:
        with signals.undivided():
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            done.append("all of it")

    with StopSignals() as signals, pytest.raises(Aborted, match=r"^stopped by SIGINT$"):
        write(signals)
    assert done == ["all of it"]


def test_the_first_signal_waits_for_a_safe_point_there_too() -> None:
    with StopSignals() as signals:
        with signals.undivided():
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(Aborted):
            signals.safe_point()


def test_an_error_in_it_is_not_lost() -> None:
    def write(signals: StopSignals) -> None:
        with signals.undivided():
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            raise BenchError("the disk is full")

    with StopSignals() as signals:
        with pytest.raises(BenchError, match="the disk is full"):
            write(signals)
        with pytest.raises(Aborted):
            signals.safe_point()


def test_while_the_bench_is_made_safe_it_holds_nothing_up() -> None:
    with StopSignals() as signals:
        signals.unwind()
        with signals.undivided():
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)


def test_a_stop_that_came_out_as_something_else_is_found() -> None:
    stop, unsafe = Aborted("stopped by SIGTERM"), NotSafe("NOT SAFE: table")
    late = ConfigError("the simulated 34401A cannot be loaded")
    late.__cause__ = stop
    assert Aborted.behind(late) is stop
    assert Aborted.behind(stop) is stop
    unsafe.__cause__ = stop
    assert Aborted.behind(unsafe) is None
    round_about, other = BenchError("a"), BenchError("b")
    round_about.__cause__, other.__cause__ = other, round_about
    assert Aborted.behind(round_about) is None


def test_a_stop_that_was_dealt_with_before_is_none_of_an_error() -> None:
    """Whoever resumes a stopped run where he catches its error learns what went wrong then."""
    later = BenchError("the wire broke")
    later.__context__ = Aborted("stopped by SIGINT")
    assert Aborted.behind(later) is None


def test_a_stop_does_not_come_amid_what_a_simulated_device_does() -> None:
    """It left a world that was half worked out, and a bench that could not be proved safe."""
    done = []

    class Busy:
        def wake_at(self) -> float | None:
            if not done:
                signal.raise_signal(signal.SIGTERM)
            done.append(True)
            return None

    clock = AttendedClock(VirtualClock(), [Busy()])
    with StopSignals() as signals:
        clock.asleep = signals.asleep
        with pytest.raises(Aborted, match="SIGTERM"):
            ControlClock(clock, signals).sleep_until(1.0)
    assert done
