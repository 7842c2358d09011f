from __future__ import annotations

import os
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vcfbench.clock import Deadline, VirtualClock, WallClock
from vcfbench.drivers.trace import BEHIND, HEADER, TraceLine, escaped, traced, unescaped
from vcfbench.errors import BenchError, ConfigError, DeadlineExceeded
from vcfbench.testing import ScriptedWire, read_trace

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.clock import Clock
    from vcfbench.drivers.trace import Connect
    from vcfbench.drivers.wire import Wire


@settings(max_examples=20)
@given(st.binary())
def test_any_bytes_come_back_from_their_text(data: bytes) -> None:
    text = escaped(data)
    assert text.isascii()
    assert text == "" or text.isprintable()
    assert unescaped(text) == data


@pytest.mark.parametrize("text", ["*IDN?\\<n", "\\x4", "\\", "\t", "\\u0041", "caf\xe9"])
def test_what_is_no_escape_is_refused_without_a_warning(text: str) -> None:
    with pytest.raises(ValueError, match="has an escape sequence"):  # a warning is an error in tests
        unescaped(text)


def tapping(name: str, resource: str, clock: Clock) -> Callable[[Wire], Wire]:
    """Return a function that puts a new wire behind what stands before wires here."""

    def tapped(wire: Wire) -> Wire:
        connect: Connect = lambda _: wire  # noqa: E731
        for behind in BEHIND.get():
            connect = behind(name, resource, clock, connect)
        return connect(Deadline.after(clock, 1.0))

    return tapped


def speak(wire: ScriptedWire, clock: Clock) -> None:
    deadline = Deadline.after(clock, 1.0)
    tapped = tapping("meter", "GPIB0::22::INSTR", clock)(wire)
    tapped.clear(deadline)
    tapped.send(b"*IDN?\n", deadline)
    assert tapped.receive(deadline) == (b"a,b,c,d\n", True)
    tapped.send(b"READ?\n", deadline)
    with pytest.raises(DeadlineExceeded):
        tapped.receive(deadline)
    tapped.close()


EXCHANGE = [("*IDN?", "a,b,c,d"), ("READ?", None)]


def test_all_that_passes_is_written_with_its_time(tmp_path: Path) -> None:
    clock = VirtualClock()
    with traced(tmp_path / "x.trace"):
        speak(ScriptedWire(EXCHANGE, clock=clock), clock)
    first, *lines = (tmp_path / "x.trace").read_text("ascii").splitlines()
    assert first == HEADER
    where = "meter\tGPIB0::22::INSTR"
    assert lines == [
        f"0.000000\t{where}\topen\tgpib",
        f"0.000000\t{where}\tclear\t",
        f"0.000000\t{where}\t>\t*IDN?\\n",
        f"0.000000\t{where}\t<|\ta,b,c,d\\n",
        f"0.000000\t{where}\t>\tREAD?\\n",
        f"1.000000\t{where}\t!\tDeadlineExceeded no answer",
        f"1.000000\t{where}\tclose\t",
    ]
    assert read_trace(tmp_path / "x.trace")[3] == TraceLine(0.0, "meter", "GPIB0::22::INSTR", "<|", b"a,b,c,d\n")


def test_without_a_trace_nothing_stands_in_between() -> None:
    clock = VirtualClock()
    wire = ScriptedWire([], clock=clock)
    assert tapping("meter", "x", clock)(wire) is wire
    with traced(None):
        assert tapping("meter", "x", clock)(wire) is wire


def test_a_real_clock_has_the_time_of_day_beside_it(tmp_path: Path) -> None:
    clock = WallClock()
    with traced(tmp_path / "x.trace"):
        tapping("meter", "x", clock)(ScriptedWire([], clock=clock))
    opened = read_trace(tmp_path / "x.trace")[0].data.decode()
    assert opened.startswith("gpib 20")
    assert opened.endswith("+00:00")


def test_other_threads_are_not_traced(tmp_path: Path) -> None:
    clock = VirtualClock()
    wire = ScriptedWire([], clock=clock)
    found: list[object] = []
    with traced(tmp_path / "x.trace"):
        thread = threading.Thread(target=lambda: found.append(tapping("meter", "x", clock)(wire)))
        thread.start()
        thread.join()
    assert found == [wire]


def test_unwritable_trace_is_refused_before_opening(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"--trace .*: cannot be written: Is a directory"), traced(tmp_path):
        pytest.fail("the trace was begun")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="pipes with a name are POSIX's")
def test_a_pipe_keeps_nothing_from_beginning_or_going_on(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ConfigError, match=r"cannot be written: No such device"), traced(tmp_path / "pipe"):
        pytest.fail("nobody reads it")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    clock = VirtualClock()

    def speak_at_length() -> None:
        with traced(tmp_path / "pipe"):
            for _ in range(1000):  # more than a pipe holds
                speak(ScriptedWire(EXCHANGE, clock=clock), clock)

    try:
        with pytest.raises(BenchError, match="is not whole: write could not complete without blocking"):
            speak_at_length()
    finally:
        os.close(reader)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_a_full_disk_ends_the_trace_and_not_the_work() -> None:
    clock = VirtualClock()
    with pytest.raises(BenchError, match=r"the trace /dev/full is not whole: No space left"), traced("/dev/full"):
        speak(ScriptedWire(EXCHANGE, clock=clock), clock)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device of Linux")
def test_what_went_wrong_counts_more_than_the_trace() -> None:
    with pytest.raises(DeadlineExceeded), traced("/dev/full"):
        raise DeadlineExceeded("no answer")
