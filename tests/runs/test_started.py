"""Waiting for a run in a thread: for any time, broken off and begun again, or refused as no time."""

from __future__ import annotations

import math
import os
import signal
from threading import Event, Timer
from typing import TYPE_CHECKING, Any

import pytest
from simrack_tests.ports import PLENTY_S

import vcfbench
from vcfbench.errors import ConfigError
from vcfbench.runs.started import StartedRun

if TYPE_CHECKING:
    from collections.abc import Iterator

QUICK = {"rates_deg_s": [10, 0, -10], "samples": 3}


@pytest.fixture
def may_end() -> Iterator[Event]:
    """Until it is set, the run goes on."""
    event = Event()
    yield event
    event.set()


@pytest.fixture
def started(may_end: Event) -> StartedRun:
    def conduct(control: StartedRun) -> vcfbench.Run:
        may_end.wait(PLENTY_S)
        return vcfbench.run("turntable", seed=3, settings=QUICK, runs=None, control=control)

    return StartedRun(conduct)


@pytest.mark.parametrize("timeout_s", [-1, 0, 0.01])
def test_a_run_that_goes_on_is_a_timeout(started: StartedRun, may_end: Event, timeout_s: float) -> None:
    with pytest.raises(TimeoutError):
        started.result(timeout_s)
    may_end.set()
    assert started.result(PLENTY_S).status == "complete"


@pytest.mark.parametrize("timeout_s", [True, "1", math.nan, [1]])
def test_what_is_no_time_is_refused(started: StartedRun, may_end: Event, timeout_s: Any) -> None:
    with pytest.raises(ConfigError, match="timeout_s: expected a number or None, got "):
        started.result(timeout_s)
    may_end.set()
    assert started.result(PLENTY_S).status == "complete"


@pytest.mark.skipif(os.name != "posix", reason="sends a signal to itself")
@pytest.mark.parametrize("timeout_s", [None, 1e30, math.inf, PLENTY_S])
def test_a_wait_broken_off_can_be_repeated(started: StartedRun, may_end: Event, timeout_s: float | None) -> None:
    Timer(0.1, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    with pytest.raises(KeyboardInterrupt):
        started.result(timeout_s)
    may_end.set()
    assert started.result(timeout_s).status == "complete"
