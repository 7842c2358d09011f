"""The program's side of the watchdog process: started before an output goes on, and fed with signs of life.

The process itself is `vcfbench.cli.watchdog`. It knows the bench's description and has no connection to an instrument.
When the pipe from the program breaks without a word, when its beats stop, or a step takes longer than it may, it ends
what is left of the program and makes the bench safe. It answers each beat: one that is stopped or starved is found out,
and its full pipe keeps nobody waiting.
"""

from __future__ import annotations

import json
import math
import os
import signal
import subprocess
import sys
import threading
from contextlib import ExitStack, contextmanager, suppress
from typing import TYPE_CHECKING, Any, Final

from msgspec import to_builtins

from vcfbench.clock import start_thread, uptime_s
from vcfbench.errors import BenchError
from vcfbench.files import kept_from_forks
from vcfbench.safety.processes import mark_of
from vcfbench.safety.roles import driving_roles

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    from vcfbench.drivers.calls import Calls
    from vcfbench.station.description import BenchDescription

BEAT_S: Final = 0.25
"""From one sign of life to the next, wall time."""
_OVERDUE_BEATS: Final = 8
"""Beats, one after the other, at which a call should have returned: then it never will."""
_UNANSWERED_BEATS: Final = 12
"""Beats, one after the other, that it may leave without an answer: 3 s."""
_STOPPED_S: Final = 5.0
"""By so much longer than it may be silent a program was stopped, and with it the watchdog that would have ended it."""
_LONGEST_WORDS: Final = 2000
"""A line that fits into the pipe as a whole or not at all (4096 bytes, pipe(7))."""
SILENT_S: Final = 2.0
"""For how long a run may give no sign of life."""
_MAIN: Final = "import sys; sys.path[:] = sys.argv[1:]; from vcfbench.cli.watchdog import main; main()"
_STARTING_S: Final = 10.0
_LEAVING_S: Final = 2.0


class Watchdog:
    """The watchdog of one open bench; `lost` is called once, with why, if it dies before the run or falls silent.

    `calls` are those on the wires of the bench: one that never returns is a program that hangs. `stopped` is called,
    with why, where the program and the watchdog were stopped, or the computer slept. A program may give no sign of life
    for `silent_s`; a longer time than a run's is a script's, whose silence counts once something that drives was told
    anything.

    Raises:
        BenchError: it did not start.
    """

    def __init__(
        self,
        description: BenchDescription,
        lost: Callable[[str], None],
        calls: Calls,
        stopped: Callable[[str], None],
        silent_s: float = SILENT_S,
    ) -> None:
        self._lost = lost
        self._stopped = stopped
        self._silent_s = silent_s
        self.lost = False
        """Whether it died before the run, or fell silent."""
        self._unanswered = -math.inf  # until it is ready
        self._description = description
        self._driving = {role.name for role in driving_roles(description)}
        self._calls: Calls | None = calls
        self._over = threading.Event()
        self._writing = threading.Lock()
        self._start()
        threading.Thread(target=self._beat, name="watchdog beat", daemon=True).start()

    def _start(self) -> None:
        with _signals_blocked():  # what is meant for the program: that leaves its bench, and then the watchdog
            self._process = subprocess.Popen(  # noqa: S603  # this Python, this package, without what `site` takes
                [sys.executable, "-S", "-P", "-c", _MAIN, *map(os.path.abspath, sys.path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                bufsize=0,
                start_new_session=True,  # what ends the terminal does not end it
            )
        assert self._process.stdin is not None  # noqa: S101  # it was asked for
        self._pipe = self._process.stdin
        self._alone = ExitStack()  # a forked process that has the pipe would seem to live on
        self._alone.enter_context(kept_from_forks(self._pipe.fileno()))
        owner, bench = os.getpid(), self._description
        drives = [f"{role.name} at {getattr(bench, role.name).resource}" for role in driving_roles(bench)]
        self._tell(f"owner {owner}", ", ".join(drives))  # for words where not even JSON can be loaded
        if self._silent_s != SILENT_S:
            self._tell("silent", self._silent_s)
        charge = {"owner": owner, "mark": mark_of(owner), "by_hand": bench.by_hand, "bench": to_builtins(bench)}
        self._tell("bench", charge)
        with suppress(OSError, AttributeError):  # Windows' pipes have it since Python 3.12
            os.set_blocking(self._pipe.fileno(), False)  # from now on: what comes first is what it begins with

    def require_ready(self) -> None:
        """Wait until it watches; BenchError if it does not come to that."""
        assert self._process.stdout is not None  # noqa: S101  # it was asked for
        said, ready, heard = self._process.stdout, list[bytes](), threading.Event()

        def listen() -> None:
            with suppress(OSError, ValueError):  # it was let go
                while ready[-1:] != [b""]:
                    ready[1:] = [said.readline()]
                    self._unanswered = 0
                    heard.set()

        threading.Thread(target=listen, name="watchdog answers", daemon=True).start()
        heard.wait(_STARTING_S)
        if ready[:1] != [b"ready\n"]:
            self._process.kill()
            raise BenchError("the watchdog did not start, so the bench would not be made safe if this program died")

    def keep_in(self, journal: Path) -> None:
        """Name the journal in which it writes down its actions."""
        self._tell("journal", str(journal.absolute()))

    def step(self, words: str, longest_s: float | None) -> None:
        """Send the present step and its longest duration, wall time; None is unlimited."""
        self._tell(f"step {math.inf if longest_s is None else longest_s}", words[:_LONGEST_WORDS])

    def making_safe(self, longest_s: float) -> None:
        """Say that the bench is being made safe: each instrument in a thread of its own, and one may hang."""
        self._calls = None
        self.step("making safe", longest_s)

    @property
    def number(self) -> int:
        """Number of its process."""
        return self._process.pid

    def leave(self, *, safe: bool) -> None:
        """End the watchdog; an unproved bench is left to it, or to another if it was lost."""
        self._over.set()
        if self.lost and not safe:
            self._process.kill()
            self._close()
            with suppress(OSError, MemoryError):
                self._start()
        self._tell(f"left {'safe' if safe else 'live'}")
        self._close()
        if not safe:
            with suppress(RuntimeError, MemoryError):
                start_thread(self._process.wait)
            return
        try:
            self._process.wait(_LEAVING_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _close(self) -> None:
        self._alone.close()
        for pipe in (self._pipe, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()

    def _tell(self, kind: str, value: Any = None) -> None:
        with suppress(OSError, ValueError):  # that it has died, the beat finds out
            self._put(kind if value is None else f"{kind} {json.dumps(value)}")

    def _put(self, line: str) -> None:
        with self._writing, suppress(BlockingIOError):  # one that does not read is found out by its silence
            os.write(self._pipe.fileno(), line.encode() + b"\n")

    def _beat(self) -> None:
        overdue, beat_s = 0, uptime_s()
        while not self._over.wait(BEAT_S):
            idle = self._silent_s > SILENT_S and self._calls is not None and not self._calls.spoken & self._driving
            before_s, beat_s = beat_s, uptime_s()
            if beat_s - before_s > self._silent_s + _STOPPED_S and not idle:
                self._stopped(f"what stopped this program, or the whole computer, for {beat_s - before_s:.0f} s")
            call = None if self._calls is None else self._calls.overdue()
            overdue = 0 if call is None else overdue + 1
            word = "overdue" if overdue >= _OVERDUE_BEATS else "late" if overdue >= _OVERDUE_BEATS // 2 else "beat"
            word = "idle" if idle and not call else word
            try:
                self._put(f"{word} {call or ''}")
            except (OSError, ValueError):
                if not self._over.is_set():
                    self._lose("the death of the watchdog")
                return
            self._unanswered += 1
            if self._unanswered >= _UNANSWERED_BEATS and not self.lost:
                self._lose(f"the silence of the watchdog for {_UNANSWERED_BEATS * BEAT_S:g} s")

    def _lose(self, why: str) -> None:
        self.lost = True
        self._lost(why)


@contextmanager
def _signals_blocked() -> Iterator[None]:
    """Let a process that is started meanwhile hear no signal that means a program; this one hears them afterwards."""
    if not hasattr(signal, "pthread_sigmask"):  # Windows
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT, signal.SIGTERM, signal.SIGHUP})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
