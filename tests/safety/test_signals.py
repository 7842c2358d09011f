"""What signals do to an open bench, and a stop that comes from another thread, such as that of the page."""

from __future__ import annotations

import signal
import socket
import threading
from contextlib import nullcontext

import pytest
from simrack.attendance import AttendedClock
from simrack_tests.ports import PLENTY_S

from vcfbench.clock import VirtualClock, WallClock
from vcfbench.errors import Aborted, BenchError, ConfigError, NotSafe
from vcfbench.safety.signals import ControlClock, LeaveNow, StopSignals


@pytest.mark.parametrize("system", ["posix", "Windows"])
def test_it_wakes_who_waits_and_says_who_wanted_it(system: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A warm-up may be half an hour long: nobody shall wait for its end."""
    if system == "Windows":  # it has signals, and sends none to a thread
        monkeypatch.delattr("signal.pthread_kill", raising=False)
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


@pytest.mark.parametrize("simulated", [False, True])
def test_command_stops_at_once_after_wait_in_it(*, simulated: bool) -> None:
    """A person's command waits and asks in turn; a stop shall not wait for an answer that does not come."""
    went_on: list[str] = []
    clock = AttendedClock(VirtualClock() if simulated else WallClock())

    def command(signals: StopSignals) -> None:
        signals.wait(clock, 0.0)
        signal.raise_signal(signal.SIGINT)
        went_on.append("to the next safe point")

    with StopSignals() as signals:
        clock.asleep = signals.asleep if simulated else nullcontext()
        with pytest.raises(Aborted, match=r"^stopped by SIGINT$"):
            signals.attend(lambda: command(signals))
    assert went_on == []


@pytest.mark.parametrize(("pace", "instants_s"), [(1.0, [10.1, 10.2, 10.25]), (2.0, [10.2, 10.25]), (None, [10.25])])
def test_wait_checks_for_its_end_ten_times_a_second(pace: float | None, instants_s: list[float]) -> None:
    class Noting(VirtualClock):
        def sleep_until(self, instant_s: float) -> None:
            waited.append(round(instant_s, 6))
            assert len(waited) < 10
            super().sleep_until(instant_s)

    waited: list[float] = []
    clock = Noting()
    VirtualClock.sleep_until(clock, 10.0)
    if pace is not None:
        clock.pace = pace  # type: ignore[attr-defined]
    StopSignals().wait(clock, 10.25)
    assert waited == instants_s


def test_undivided_work_ends_before_second_signal_acts() -> None:
    done: list[str] = []

    def write(signals: StopSignals) -> None:
        with signals.undivided():
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            done.append("all of it")

    with StopSignals() as signals:
        with pytest.raises(Aborted, match=r"^stopped by SIGINT$"):
            write(signals)
        signal.raise_signal(signal.SIGINT)  # once is enough: the unwinding has begun
    assert done == ["all of it"]


def test_what_is_undivided_within_something_undivided_ends_with_that() -> None:
    done: list[str] = []

    def write(signals: StopSignals) -> None:
        with signals.undivided():
            with signals.undivided():
                signal.raise_signal(signal.SIGINT)
                signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
            done.append("the rest")

    with StopSignals() as signals, pytest.raises(Aborted, match=r"^stopped by SIGINT$"):
        write(signals)
    assert done == ["the rest"]


def test_what_a_stopped_run_writes_is_not_broken_off() -> None:
    with StopSignals() as signals:
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(Aborted, match=r"^stopped by SIGTERM$"):
            signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGTERM)
        with signals.undivided():
            signal.raise_signal(signal.SIGTERM)


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


def test_second_signal_leaves_the_unwinding_alone() -> None:
    with StopSignals() as signals:
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(Aborted):
            signals.safe_point()
        signal.raise_signal(signal.SIGINT)


def test_while_the_bench_is_made_safe_it_holds_nothing_up() -> None:
    with StopSignals() as signals:
        signals.unwind()
        with signals.undivided():
            signal.raise_signal(signal.SIGINT)
            signal.raise_signal(signal.SIGINT)
        signals.safe_point()


@pytest.mark.parametrize("before", [1, 2, 3, 4])
def test_the_third_signal_of_all_ends_the_making_safe_once(before: int) -> None:
    """Those that come before it begins end nothing. One more keeps nothing from being told to stop."""
    with StopSignals() as signals:
        signal.raise_signal(signal.SIGINT)
        signals.unwind()
        for _ in range(before - 1):
            signal.raise_signal(signal.SIGINT)
        signals.allow_end()
        if before == 1:
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(LeaveNow):
            signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        signals.close()


def test_when_all_is_over_signals_change_nothing() -> None:
    with StopSignals() as signals:
        signals.allow_end()
        signals.close()
        for _ in range(4):
            signal.raise_signal(signal.SIGINT)
        signals.safe_point()


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="Windows has no SIGHUP")
def test_handlers_are_restored_and_ignored_signals_stay_ignored() -> None:
    """``nohup vcfbench run ...`` goes on when its terminal is closed."""
    watched, hangup = (signal.SIGINT, signal.SIGTERM), signal.signal(signal.SIGHUP, signal.SIG_IGN)
    before = [signal.getsignal(each) for each in watched]
    try:
        with StopSignals() as signals:
            assert not {signal.getsignal(each) for each in watched} & {*before}
            assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, hangup)
    assert [signal.getsignal(each) for each in watched] == before
    signals.stop("the page")  # too late for a signal
    with pytest.raises(Aborted, match=r"^stopped by the page$"):
        signals.safe_point()


def test_stop_without_watched_signals_counts_as_first() -> None:
    signals = StopSignals()
    with signals.undivided():
        signals.stop("the page")
    with pytest.raises(Aborted, match=r"^stopped by the page$"):
        signals.safe_point()


def test_a_stop_wakes_who_waits_for_a_person() -> None:
    ours, theirs = socket.socketpair()
    with StopSignals() as signals, ours, theirs:
        timer = threading.Timer(0.1, signals.stop, ["the page"])
        late = threading.Timer(PLENTY_S, theirs.send, [b"an answer"])
        timer.start()
        late.start()
        with pytest.raises(Aborted, match=r"^stopped by the page$"):
            signals.attend(lambda: ours.recv(1))
        assert late.is_alive()
        late.cancel()


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


def test_handled_stop_is_not_counted_again() -> None:
    """Whoever resumes a stopped run where he catches its error learns what went wrong then."""
    later = BenchError("the wire broke")
    later.__context__ = Aborted("stopped by SIGINT")
    assert Aborted.behind(later) is None


def test_stop_does_not_interrupt_simulated_device() -> None:
    """It left a world that was half worked out, and a bench that could not be proved safe."""
    done = []

    class Busy:
        def wake_at(self) -> float | None:
            if len(done) == 1:
                signal.raise_signal(signal.SIGTERM)
            done.append(clock.now())
            return 0.5

    clock = AttendedClock(VirtualClock(), [Busy()])
    with StopSignals() as signals:
        clock.asleep = signals.asleep
        with pytest.raises(Aborted, match="SIGTERM"):
            ControlClock(clock, signals).sleep_until(1.0)
    assert done == [0.0, 0.5]


@pytest.mark.parametrize("simulated", [False, True])
def test_after_a_signal_no_wait_begins(*, simulated: bool) -> None:
    clock = AttendedClock(VirtualClock())
    with StopSignals() as signals:
        clock.asleep = signals.asleep if simulated else nullcontext()
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(Aborted, match="SIGINT"):
            ControlClock(clock, signals).sleep_until(100.0)
    assert clock.now() == 0.0


def test_shorter_wait_leaves_longer_wait_interruptible() -> None:
    signals = StopSignals()

    def wait_of_a_device() -> bool:
        with signals.asleep:
            pass
        return signals.break_off_from_now(possible=True)

    assert signals.attend(wait_of_a_device)


def test_signal_breaks_off_only_what_may_break() -> None:
    signals = StopSignals()
    signals.stop("the page")
    assert not signals.break_off_from_now(possible=False)
    with pytest.raises(Aborted, match="the page"):
        signals.break_off_from_now(possible=True)


def test_wait_of_simulated_instrument_is_not_interrupted() -> None:
    clock = AttendedClock(VirtualClock())
    with StopSignals() as signals:
        clock.asleep = signals.asleep
        ControlClock(clock, signals).sleep_until(1.0)
        with signals.asleep:
            signal.raise_signal(signal.SIGTERM)
        with pytest.raises(Aborted, match="SIGTERM"):
            signals.safe_point()


def test_clock_of_resumed_run_includes_earlier_time() -> None:
    clock = VirtualClock()
    control = ControlClock(clock, StopSignals(), 100.0)
    control.sleep_until(102.5)
    assert (control.now(), clock.now()) == (102.5, 2.5)
