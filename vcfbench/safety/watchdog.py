"""The watchdog process, seen from the program that it watches: started before an output goes on, told that this lives.

The process itself is `vcfbench.cli.watchdog`. It knows the bench's description and has no connection to an instrument.
When the pipe from the program breaks without a word, when its beats stop, or a step takes longer than it may, it ends
what is left of the program and makes the bench safe.
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

from vcfbench.clock import start_thread
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
_MAIN: Final = "import sys; sys.path[:] = sys.argv[1:]; from vcfbench.cli.watchdog import main; main()"
_STARTING_S: Final = 10.0
_LEAVING_S: Final = 2.0


class Watchdog:
    """The watchdog of one open bench; `lost` is called once if it dies before the run.

    `calls` are those on the wires of the bench: one that never returns is a program that hangs.

    Raises:
        BenchError: it did not start.
    """

    def __init__(self, description: BenchDescription, lost: Callable[[], None], calls: Calls) -> None:
        self._lost = lost
        self.lost = False
        """Whether it died before the run."""
        self._calls: Calls | None = calls
        self._over = threading.Event()
        self._writing = threading.Lock()
        with _signals_blocked():  # what is meant for the program: that leaves its bench, and then the watchdog
            self._process = subprocess.Popen(  # noqa: S603  # this Python, this package, without what `site` takes
                [sys.executable, "-S", "-P", "-c", _MAIN, *map(os.path.abspath, sys.path)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                start_new_session=True,  # what ends the terminal does not end it
            )
        assert self._process.stdin is not None  # noqa: S101  # it was asked for
        self._pipe = self._process.stdin
        self._alone = ExitStack()  # a forked process that has the pipe would seem to live on
        self._alone.enter_context(kept_from_forks(self._pipe.fileno()))
        owner = os.getpid()
        drives = [f"{role.name} at {getattr(description, role.name).resource}" for role in driving_roles(description)]
        self._tell(f"owner {owner}", ", ".join(drives))  # for words where not even JSON can be loaded
        self._tell("bench", {"owner": owner, "mark": mark_of(owner), "bench": to_builtins(description)})
        threading.Thread(target=self._beat, name="watchdog beat", daemon=True).start()

    def require_ready(self) -> None:
        """Wait until it watches; BenchError if it does not come to that."""
        assert self._process.stdout is not None  # noqa: S101  # it was asked for
        said, ready = self._process.stdout, list[bytes]()
        reader = threading.Thread(target=lambda: ready.append(said.readline()), daemon=True)
        reader.start()
        reader.join(_STARTING_S)
        if ready != [b"ready\n"]:
            self._process.kill()
            raise BenchError("the watchdog did not start: nobody would make the bench safe if this program died")

    def keep_in(self, journal: Path) -> None:
        """Name the journal in which it writes down its actions."""
        self._tell("journal", str(journal.absolute()))

    def step(self, words: str, longest_s: float | None) -> None:
        """Tell the step under way and the longest that it may take, wall time; None is any time."""
        self._tell(f"step {math.inf if longest_s is None else longest_s}", words)

    def making_safe(self, longest_s: float) -> None:
        """Say that the bench is being made safe: each instrument in a thread of its own, and one may hang."""
        self._calls = None
        self.step("making safe", longest_s)

    def leave(self, *, safe: bool) -> None:
        """Let it go; a bench that is not proved safe is left to it, which can do no worse."""
        self._over.set()
        self._tell(f"left {'safe' if safe else 'live'}")
        self._alone.close()
        for pipe in (self._pipe, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()
        if not safe:
            with suppress(RuntimeError, MemoryError):
                start_thread(self._process.wait)
            return
        try:
            self._process.wait(_LEAVING_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _tell(self, kind: str, value: Any = None) -> None:
        with suppress(OSError, ValueError):  # that it has died, the beat finds out
            self._put(kind if value is None else f"{kind} {json.dumps(value)}")

    def _put(self, line: str) -> None:
        with self._writing:
            self._pipe.write(line.encode() + b"\n")
            self._pipe.flush()

    def _beat(self) -> None:
        overdue = 0
        while not self._over.wait(BEAT_S):
            call = None if self._calls is None else self._calls.overdue()
            overdue = 0 if call is None else overdue + 1
            word = "overdue" if overdue >= _OVERDUE_BEATS else "late" if overdue >= _OVERDUE_BEATS // 2 else "beat"
            try:
                self._put(f"{word} {call or ''}")
            except (OSError, ValueError):
                if not self._over.is_set():
                    self.lost = True
                    self._lost()
                return


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
