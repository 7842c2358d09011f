"""Values into structs by several threads at once."""

from __future__ import annotations

import subprocess
import sys
from threading import Event, Thread
from typing import Any

import pytest
from msgspec import Struct

from vcfbench.typed import decoder_of, typed

AT_ONCE = """
import sys, threading
from vcfbench.procedures.bench_file import parse_bench
from vcfbench.station.file import embedded_text
sys.setswitchinterval(1e-6)
barrier = threading.Barrier(4)
def work():
    barrier.wait()
    parse_bench(embedded_text("paper"), "paper")
threads = [threading.Thread(target=work) for _ in range(4)]
for each in threads: each.start()
for each in threads: each.join()
"""


class _Held(Struct):
    """Its making takes as long as the test wants."""

    begun: Any
    go_on: Any

    def __post_init__(self) -> None:
        self.begun.set()
        self.go_on.wait(10.0)


class _Other(Struct):
    number: int


def test_one_thread_at_a_time() -> None:
    begun, go_on, made = Event(), Event(), Event()

    def other() -> None:
        typed({"number": 1}, _Other)
        decoder_of(_Other)
        made.set()

    first = Thread(target=typed, args=({"begun": begun, "go_on": go_on}, _Held))
    first.start()
    assert begun.wait(10.0)
    second = Thread(target=other)
    second.start()
    assert not made.wait(0.05)
    go_on.set()
    assert made.wait(10.0)
    first.join()
    second.join()


@pytest.mark.exhaustive
def test_four_threads_read_bench_file_at_once() -> None:
    """Without care for it msgspec ends the interpreter by a signal, more often than not."""
    subprocess.run([sys.executable, "-c", AT_ONCE], check=True, timeout=60)  # noqa: S603
