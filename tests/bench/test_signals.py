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
