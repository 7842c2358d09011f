"""A stop that comes from another thread, such as that of the page."""

from __future__ import annotations

import signal
import threading

import pytest

from vcfbench.bench.signals import ControlClock, StopSignals
from vcfbench.clock import WallClock
from vcfbench.errors import Aborted


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


def test_where_no_signal_is_watched_it_changes_nothing() -> None:
    signals = StopSignals()
    signals.stop("the page")
    signals.safe_point()


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
