"""The watchdog process counts turns, and knows by what it hears, or no longer hears, whether its program lives."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import threading
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

from vcfbench.cli import left_live, watchdog
from vcfbench.cli.watchdog import SILENT_TURNS, Watch, main
from vcfbench.safety.watchdog import _MAIN

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

BENCH = b"bench {}"
MAIN = [sys.executable, "-S", "-P", "-c", _MAIN]


class Turns:
    """The threads and the lock of a watch, whose turns pass at once; `said` has what is heard in each.

    After the last turn the program's pipe is broken.
    """

    def __init__(self, *said: bytes) -> None:
        self.said = list(said)
        self.passed = 0
        self.released = 0
        self.held = False
        self.watch: Watch | None = None
        self.started: list[Callable[[], object]] = []

    def allocate_lock(self) -> Turns:
        return self

    def start_new_thread(self, act: Callable[[], object], _none: tuple[()]) -> None:
        self.started.append(act)

    def acquire(self, timeout: float | None = None) -> bool:
        if timeout is None:
            self.held = True
            return True
        assert self.held  # else nobody would be waited for
        assert timeout == watchdog.TURN_S
        if self.passed == len(self.said):
            return True
        assert self.watch is not None
        for line in filter(None, self.said[self.passed].split(b"\n")):
            kind, _, words = line.partition(b" ")
            self.watch._hear(kind, words)
        self.passed += 1
        return False

    def release(self) -> None:
        self.released += 1


@pytest.fixture
def ended(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The programs that were ended, and the benches that were made safe, with the reason."""
    done: list[str] = []

    def make_safe(said: Mapping[bytes, bytes], why: str) -> int:
        done.append(f"{said[b'bench'].decode()} safe: {why}")
        return 5

    def end_owner(said: Mapping[bytes, bytes]) -> None:
        done.append(f"{said[b'bench'].decode()} ended")

    acting = SimpleNamespace(end_owner=end_owner, make_safe=make_safe)
    monkeypatch.setattr(watchdog, "loaded", lambda: acting)
    return done


def watched(monkeypatch: pytest.MonkeyPatch, *said: bytes) -> tuple[str | None, Turns]:
    turns = Turns(*said)
    monkeypatch.setattr(watchdog, "_thread", turns)
    turns.watch = Watch()
    return turns.watch.until_it_ends(), turns


@pytest.mark.parametrize(
    ("last", "why"),
    [
        ((b"beat ", b"left safe"), None),
        ((b"beat ", b"left live"), "the program did not make its bench safe"),
        ((b"beat ",), "the program died"),
    ],
)
def test_a_program_that_lives_leaves_its_bench_or_dies(
    last: tuple[bytes, ...], why: str | None, ended: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    waiting = [b""] * 3 * SILENT_TURNS  # a program may be slow to begin
    assert watched(monkeypatch, *waiting, BENCH, *last)[0] == why
    assert ended == []


def test_a_program_that_is_silent_hangs_and_is_ended(ended: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    pause = [b""] * (SILENT_TURNS - 1)
    why, turns = watched(monkeypatch, BENCH, *pause[1:], b"beat ", *pause, b"too late")
    assert why == "the program did not respond for 2 s and was ended"
    assert turns.passed == 2 * SILENT_TURNS - 1
    assert ended == ["{} ended"]


def test_step_beyond_its_time_counts_as_hung(ended: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    beats = [b"beat "] * 50
    why, turns = watched(monkeypatch, BENCH, b'step inf "wait"', *beats, b'step 0.2 "ramp"', *beats)
    assert why == "its step took longer than allowed and was ended"
    assert turns.passed == 2 + 50 + 1 + 2
    assert turns.watch is not None
    assert turns.watch.said[b"step"] == b'"ramp"'
    assert ended == ["{} ended"]


def test_a_call_that_never_returned_is_named(ended: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    why, _ = watched(monkeypatch, BENCH, b"overdue power: receiving")
    assert why == "a call never returned (power: receiving) and was ended"
    assert ended == ["{} ended"]


@pytest.mark.parametrize(
    ("said", "prepared"),
    [
        ([b"beat "] * 40, 0),
        ([b"late "] * 9, 1),
        ([*[b""] * 8, b"beat "], 0),
        ([*[b""] * 9, b"beat ", *[b""] * 15], 1),
    ],
)
def test_acting_code_is_loaded_once_before_need(
    said: list[bytes], prepared: int, ended: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It takes as long as an instrument to be told; while all is well nothing is loaded."""
    assert ended == []
    _, turns = watched(monkeypatch, BENCH, *said)
    assert turns.started[1:] == [watchdog._prepare] * prepared


def test_hanging_program_is_ended_even_if_nothing_loads(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """And only if it is the one that started the watchdog: another may have its number."""

    def gone() -> None:
        raise MemoryError

    def no_thread(_turns: Turns, act: Callable[[], object], _none: tuple[()]) -> None:
        threads.append(act)
        if len(threads) > 1:
            raise RuntimeError("can't start new thread")

    killed: list[tuple[int, int]] = []
    monkeypatch.setattr(watchdog, "loaded", gone)
    monkeypatch.setattr(Turns, "start_new_thread", no_thread)
    monkeypatch.setattr("os.kill", lambda pid, number: killed.append((pid, number)))
    for parent in (1, 4711):
        threads: list[Callable[[], object]] = []
        monkeypatch.setattr("os.getppid", lambda: parent)  # noqa: B023
        why, _ = watched(monkeypatch, b'owner 4711 "power at COM1"', BENCH, *[b""] * SILENT_TURNS)
        assert why == "the program did not respond for 2 s and was ended"
        assert killed == ([] if parent == 1 else [(4711, 9)])
        assert threads[1:] == [watchdog._prepare]
        threads[1]()  # a thread that raises would write a traceback
    assert capfd.readouterr().err == ""


def test_watchdog_reports_ready_after_bench_description(
    ended: list[str], monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    watched(monkeypatch, b"beat ", b'step 1.0 "x"', b"left safe")
    assert capfd.readouterr().out == ""
    watched(monkeypatch, BENCH, b"beat ", b"left safe")
    assert capfd.readouterr().out == "ready\nheard\n"  # each beat is answered
    assert ended == []


@pytest.mark.skipif(sys.platform == "win32", reason="pipes break differently there")
def test_program_that_leaves_at_once_is_not_dead() -> None:
    reader, writer = os.pipe()
    os.close(reader)
    said = b'bench {"owner": 0, "mark": null, "bench": {}}\nbeat \nleft safe\n'
    done = subprocess.run([*MAIN, *sys.path], input=said, stdout=writer, stderr=subprocess.PIPE, check=False)  # noqa: S603
    os.close(writer)
    assert (done.returncode, done.stderr) == (0, b"")


@pytest.mark.parametrize(
    ("came", "heard"),
    [
        (b"bench {}\nbeat \nleft sa", {b"bench": b"{}", b"beat": b""}),  # torn
        (b'bench {}\nstep 1.5 "a b"\nleft live\nleft safe\n', {b"bench": b"{}", b"step": b'"a b"', b"left": b"live"}),
        (b"bench {}\noverdue power: sending\nbeat \n", {b"bench": b"{}", b"overdue": b"power: sending"}),
    ],
)
def test_whole_lines_are_heard_until_exit_or_overdue_call(
    came: bytes, heard: dict[bytes, bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    turns = Turns()
    monkeypatch.setattr(watchdog, "_thread", turns)
    monkeypatch.setattr("sys.stdin", SimpleNamespace(buffer=io.BytesIO(came)))
    watch = Watch()
    (listen,) = turns.started
    listen()
    assert (watch.said, turns.released) == (heard, 1)


@pytest.mark.parametrize(
    ("said", "code", "done"),
    [
        ((BENCH, b"left safe"), 0, []),
        ((BENCH, b"beat "), 5, ["{} safe: the program died"]),
        ((b"",), 0, []),  # it died before it had a bench
    ],
)
def test_its_code_is_that_of_the_bench(
    said: tuple[bytes, ...], code: int, done: list[str], ended: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert code_of(monkeypatch, *said) == code
    assert ended == done


@pytest.mark.parametrize("closed", [False, True])
def test_bench_that_cannot_be_made_safe_is_reported(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], *, closed: bool
) -> None:
    def gone() -> None:
        raise ModuleNotFoundError("No module named 'vcfbench.cli.left_live'")

    monkeypatch.setattr(watchdog, "loaded", gone)
    monkeypatch.setattr("sys.stderr", None if closed else sys.stderr)
    assert code_of(monkeypatch, b'owner 4711 "rate_table at COM3, power at COM1"', BENCH) == 5
    assert capfd.readouterr().err == (
        ""
        if closed
        else "vcfbench watchdog: the program died; NOT SAFE: rate_table at COM3, power at COM1: ModuleNotFoundError: "
        "No module named 'vcfbench.cli.left_live'; make it safe by hand before anything else\n"
    )


def code_of(monkeypatch: pytest.MonkeyPatch, *said: bytes) -> int:
    turns = Turns(*said)
    monkeypatch.setattr(watchdog, "_thread", turns)
    made = Watch()
    turns.watch = made
    monkeypatch.setattr(watchdog, "Watch", lambda: made)
    monkeypatch.setattr("os._exit", lambda code: pytest.exit(f"{code}"))
    with pytest.raises(pytest.exit.Exception) as caught:
        main()
    return int(caught.value.msg)


def test_safe_code_is_loaded_by_one_thread_at_a_time() -> None:
    """The second would take away what the first has put in numpy's place."""
    second = threading.Thread(target=watchdog.loaded, daemon=True)
    with watchdog._LOADING:
        second.start()
        second.join(0.2)
        assert second.is_alive()
    second.join(60.0)
    assert not second.is_alive()
    assert watchdog.loaded() is left_live
