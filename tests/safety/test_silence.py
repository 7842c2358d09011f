"""A watchdog that is silent is noticed and keeps nobody waiting; who works at an idle bench may be silent."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from typing import TYPE_CHECKING, Any

import pytest
from simrack_tests.ports import PLENTY_S, eventually

import vcfbench
from vcfbench.clock import WallClock, sleep
from vcfbench.drivers.calls import Calls
from vcfbench.safety import watchdog
from vcfbench.safety.watchdog import SILENT_S, Watchdog

if TYPE_CHECKING:
    from collections.abc import Iterator

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pipes that do not block came with Python 3.12 there")


class Piped:
    """A watchdog process at the other ends of two pipes; `answers` is how many beats it answers, for it may stop."""

    pid = 4711

    def __init__(self, *_: Any, **__: Any) -> None:
        self.hears, said = os.pipe()
        answered, self.answers_to = os.pipe()
        self.stdin, self.stdout = open(said, "wb", 0), open(answered, "rb", 0)  # noqa: SIM115, PTH123
        self.killed = False
        os.write(self.answers_to, b"ready\n")

    def kill(self) -> None:
        self.killed = True

    def wait(self, timeout: float | None = None) -> int:
        if timeout is not None and not self.killed:
            raise subprocess.TimeoutExpired("watchdog", timeout or 0.0)
        return -9


class Watched:
    """A program whose watchdog is `process`; `said` is why it was to end."""

    def __init__(self, calls: Calls, silent_s: float = SILENT_S) -> None:
        self.said: list[str] = []
        self.dog = Watchdog(vcfbench.load_bench("paper"), self.said.append, calls, self.said.append, silent_s)
        self.process: Any = self.dog._process


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Watched]]:
    monkeypatch.setattr("subprocess.Popen", Piped)
    monkeypatch.setattr(watchdog, "BEAT_S", 0.01)
    monkeypatch.setattr(watchdog, "_LEAVING_S", 0.01)
    made: list[Watched] = []
    yield made
    for each in made:
        each.dog.leave(safe=True)
        for number in (each.process.hears, each.process.answers_to):
            os.close(number)


def test_full_pipe_does_not_block_and_is_reported_once(quick: list[Watched]) -> None:
    quick.append(program := Watched(Calls()))
    program.dog.require_ready()
    done = threading.Event()

    def steps() -> None:
        for _ in range(200):
            program.dog.step("x" * 5000, 5.0)  # four times what a pipe takes
        program.dog.making_safe(5.0)
        done.set()

    threading.Thread(target=steps, daemon=True).start()
    assert done.wait(PLENTY_S)
    eventually(lambda: program.dog.lost)
    sleep(WallClock(), 0.3)
    assert program.said == ["the silence of the watchdog for 0.12 s"]
    said = os.read(program.process.hears, 1 << 20)
    assert said.endswith(b"\n")  # a line is in it as a whole or not at all
    program.dog.leave(safe=True)
    assert program.process.killed


def test_a_watchdog_that_answers_each_beat_is_not_silent(quick: list[Watched]) -> None:
    quick.append(program := Watched(Calls()))
    program.dog.require_ready()
    for _ in range(40):
        os.write(program.process.answers_to, b"heard\n")
        sleep(WallClock(), 0.01)
    assert (program.dog.lost, program.said) == (False, [])


def test_bench_of_silent_watchdog_goes_to_another(quick: list[Watched]) -> None:
    quick.append(program := Watched(Calls()))
    program.dog.require_ready()
    eventually(lambda: program.dog.lost)
    program.dog.leave(safe=False)
    program.dog.lost = False
    assert program.process.killed
    assert program.dog._process is not program.process
    other: Any = program.dog._process
    heard = os.read(other.hears, 1 << 20)
    assert heard.startswith(b"owner ")
    assert heard.endswith(b"left live\n")


@pytest.mark.parametrize(
    ("silent_s", "spoken", "word"),
    [(SILENT_S, "", b"beat "), (10.0, "", b"idle "), (10.0, "multimeter", b"idle "), (10.0, "rate_table", b"beat ")],
)
def test_script_may_be_silent_before_first_actuator(
    quick: list[Watched], silent_s: float, spoken: str, word: bytes
) -> None:
    calls = Calls()
    calls.spoken |= {spoken}
    quick.append(program := Watched(calls, silent_s))
    sleep(WallClock(), 0.1)
    said = os.read(program.process.hears, 1 << 20).splitlines()
    assert (b"silent 10.0" in said) == (silent_s == 10.0)
    assert said[-1] == word


@pytest.mark.parametrize(("slept_s", "ends"), [(5.0, 0), (60.0, 1)])
def test_a_computer_that_slept_ends_what_drives_something(
    slept_s: float, ends: int, quick: list[Watched], monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [100.0]
    monkeypatch.setattr(watchdog, "uptime_s", lambda: now_s[0])
    quick.append(program := Watched(Calls()))
    sleep(WallClock(), 0.05)
    now_s[0] += slept_s
    sleep(WallClock(), 0.1)
    assert program.said == ["what stopped this program, or the whole computer, for 60 s"] * ends
