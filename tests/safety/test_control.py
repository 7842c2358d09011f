"""Who stops, pauses and lets go on a run, in which order whatever comes, and what is told of it."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import pytest
from simrack_tests.ports import PLENTY_S

from vcfbench.clock import WallClock
from vcfbench.errors import Aborted, ConfigError, PlanError
from vcfbench.safety.control import RunControl, RunState
from vcfbench.safety.signals import StopSignals

if TYPE_CHECKING:
    from collections.abc import Callable


@pytest.fixture
def control() -> RunControl:
    return RunControl()


@pytest.fixture
def told(control: RunControl) -> list[tuple[str, str]]:
    """What listeners are told; one of them fails."""
    told: list[tuple[str, str]] = []

    def broken(_state: RunState, _by: str) -> None:
        raise ValueError("a display fell over")

    control.tell(broken)
    control.tell(lambda state, by: told.append((str(state), by)))
    return told


def when(control: RunControl, wanted: str, act: Callable[[], None]) -> None:
    control.tell(lambda state, _by: act() if state == wanted else None)


def test_a_run_begins_pauses_goes_on_and_is_over(control: RunControl, told: list[tuple[str, str]]) -> None:
    assert control.state == "beginning"
    when(control, "paused", lambda: control.go_on("Eve"))
    with control.of_run(StopSignals()):
        assert control.state == "running"
        control.go_on("nobody")  # it does go on
        control.pause("Ann")
        control.pause("Bob")  # it is about to
        assert control.pause_by == "Ann"
        assert control.wait() == "Eve"
        assert (control.pause_by, control.state) == ("", "running")
    control.pause("Ann")
    control.go_on("Ann")
    control.stop("Ann")
    assert (control.state, control.pause_by) == ("over", "")
    assert told == [("running", ""), ("pausing", "Ann"), ("paused", "Ann"), ("running", "Eve"), ("over", "")]


def test_withdrawn_pause_is_not_waited_for(control: RunControl, told: list[tuple[str, str]]) -> None:
    with control.of_run(StopSignals()):
        control.pause("Ann")
        control.go_on("Ann")
        assert control.wait() == "Ann"
    assert [state for state, _ in told] == ["running", "pausing", "running", "over"]


def test_run_not_begun_is_paused_and_continues_to_begin(control: RunControl) -> None:
    control.pause("Ann")
    assert (control.state, control.pause_by) == ("pausing", "Ann")
    control.go_on("Ann")
    assert (control.state, control.pause_by) == ("beginning", "")
    control.pause("Ann")
    with control.of_run(StopSignals()):
        assert control.state == "pausing"
    assert control.pause_by == ""


def test_stop_before_begin_acts_at_begin(control: RunControl, told: list[tuple[str, str]]) -> None:
    control.stop("Ann")
    control.stop("Bob")
    control.pause("Eve")
    signals = StopSignals()
    with control.of_run(signals), pytest.raises(Aborted, match=r"^stopped by Ann$"):
        signals.safe_point()
    assert told == [("stopping", "Ann"), ("stopping", "Bob"), ("over", "")]


@pytest.mark.parametrize("by", ["", None, 0, 3, "Ann"])
def test_a_stop_or_pause_by_anybody_is_heard(by: Any) -> None:
    stopped, paused = RunControl(), RunControl()
    stopped.stop(by)
    with pytest.raises(Aborted, match=f"stopped by {by or 'the program'}"), stopped.of_run(signals := StopSignals()):
        signals.safe_point()
    paused.pause(by)
    assert paused.pause_by == str(by or "the program")


@pytest.mark.parametrize("listener", [None, 3, "print", [print]])
def test_a_listener_that_cannot_be_called_is_refused(control: RunControl, listener: Any) -> None:
    with pytest.raises(ConfigError, match="listener: expected a function, got "):
        control.tell(listener)


def test_each_run_needs_a_control_of_its_own(control: RunControl) -> None:
    with (
        control.of_run(StopSignals()),
        pytest.raises(PlanError, match="make a RunControl for each run"),
        control.of_run(StopSignals()),
    ):
        pytest.fail("two are controlled")
    with pytest.raises(PlanError, match="make a RunControl for each run"), control.of_run(StopSignals()):
        pytest.fail("one is controlled that is over")


@pytest.mark.parametrize("what", ["go_on", "stop"])
def test_one_that_pauses_hears_at_once_in_another_thread(
    what: str, control: RunControl, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It sleeps till then."""

    class Counting(StopSignals):
        looked = 0

        def safe_point(self) -> None:
            self.looked += 1
            super().safe_point()

    monkeypatch.setattr("vcfbench.safety.control._LOOKS_S", PLENTY_S)
    clock, signals = WallClock(), Counting()
    timer = threading.Timer(0.05, getattr(control, what), ["Eve"])
    with control.of_run(signals):
        control.pause("Ann")
        timer.start()
        if what == "go_on":
            assert control.wait() == "Eve"
        else:
            with pytest.raises(Aborted, match=r"^stopped by Eve$"):
                control.wait()
    assert clock.now() < PLENTY_S
    assert signals.looked < 10
