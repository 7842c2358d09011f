"""A bench that its program has left live is made safe by the watchdog process (`vcfbench.cli.watchdog`)."""

import json
import os
import select
import signal
import socket
import stat
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from vcfbench.cli import last_words
from vcfbench.clock import WallClock, sleep
from vcfbench.errors import ConnectFailed, NotSafe
from vcfbench.safety.processes import KILL, end

_AGAIN_S: Final = 1.0
"""From one try to the next, s."""

Said = Mapping[bytes, bytes]
"""The last words of each kind that the program said to `vcfbench.cli.watchdog`."""


def end_owner(said: Said) -> None:
    """End the program that hangs."""
    charge = json.loads(said[b"bench"])
    with suppress(OSError):
        end(charge["owner"], charge["mark"], KILL)


def make_safe(said: Said, why: str) -> int:
    """Switch off the bench that was `said`, because of `why`; return 0 if all is safe, else 5."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # meant for the program; until now they were blocked
        if (number := getattr(signal, name, None)) is not None:
            signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_SETMASK, ())
    charge = json.loads(said[b"bench"])
    where = f" in {json.loads(said[b'step'])}" if b"step" in said else ""
    code, came, found, _ = _tried(charge, said, left=b"left" in said)
    words = f"{why}{where}; {came}"
    _say(words, alarm=bool(code))
    _write(charge, said, {"why": f"{why}{where}", **found})
    _notify(charge, said, words, code or None)
    return code


def try_again(said: Said, why: str) -> int:
    """Try until all is safe, or a person ends this process, and say so each time; return 0 when all is safe."""
    for name in ("SIGINT", "SIGTERM", "SIGHUP"):  # the program has ended: now they are meant for this one
        if (number := getattr(signal, name, None)) is not None:
            signal.signal(number, signal.SIG_DFL)
    if _read_by_a_program():  # who waits for the end of the program's words is not to wait for this
        with open(os.devnull, "r+b") as nowhere:  # noqa: PTH123
            for stream in (1, 2):
                os.dup2(nowhere.fileno(), stream)
        sys.stderr = None  # an alarm goes to the terminal then, or to the system's log
    charge, tries, wall, again = json.loads(said[b"bench"]), 1, WallClock(), True
    with _listening() as signalled:
        while again:
            sleep(wall, _AGAIN_S)
            tries += 1
            code, came, found, again = _tried(charge, said, left=True)
            more = f"; it is tried again until it is safe, `kill {os.getpid()}` ends that" if again else ""
            if again and signalled():
                again, more = False, "; a signal has ended that"
            words = f"{why}; try {tries}, after {wall.now():.0f} s: {came}{more}"
            _say(words, alarm=True)
    _write(charge, said, {"why": why, "tries": tries, **found})
    _notify(charge, said, words, code or None)
    return code


@contextmanager
def _listening() -> Iterator[Callable[[], bool]]:
    """Yield what returns True once a signal has come within a try: there it is only counted, and does not end us."""
    heard, hearing = socket.socketpair()
    with heard, hearing:
        hearing.settimeout(0.0)
        signal.set_wakeup_fd(hearing.fileno())
        try:
            yield lambda: bool(select.select([heard], [], [], 0.0)[0])
        finally:
            signal.set_wakeup_fd(-1)


def _read_by_a_program() -> bool:
    with suppress(OSError):
        mode = os.fstat(2).st_mode
        return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)
    return True


def _tried(charge: dict[str, Any], said: Said, *, left: bool) -> tuple[int, str, dict[str, Any], bool]:
    """Switch the bench of a `charge` off, once; return code, words, words for the record, and True to try again.

    Not where a person who is not there would have to switch off, nor a served bench whose server has gone: of it
    nothing moves.
    """
    served = charge["bench"].get("served") is not None
    try:
        from vcfbench.bench.abandoned import safe_abandoned  # noqa: PLC0415  # what is missing of it is told of

        done, by_hand = safe_abandoned(charge, left=left), tuple(charge.get("by_hand", ()))
    except Exception as error:  # noqa: BLE001  # whatever went wrong, somebody must go and look
        found: dict[str, Any] = {"safe": None, "error": f"{type(error).__name__}: {error}"}
        return 5, last_words.not_safe(said, error), found, not (served and isinstance(error, ConnectFailed))
    failure = done.failure()
    left_to = ", ".join(sorted({str(each.owner or "another process") for each in done.left_to.values()}))
    instruments = [{"instrument": each.role, "found": each.found, "safe": each.safe, "detail": each.detail}
                   for each in done.instruments]  # fmt: skip
    unsafe = isinstance(failure, NotSafe)
    found = {"safe": not unsafe, "instruments": instruments, **({"left_to": left_to} if left_to else {})}
    came = f"instruments taken over by {left_to} were left to it" if left_to else "the bench was made safe"
    return (NotSafe.exit_code, str(failure), found, done.unsafe_beside(by_hand)) if unsafe else (0, came, found, False)


def _say(words: str, *, alarm: bool) -> None:
    try:
        from vcfbench.cli.ending import say  # noqa: PLC0415  # it takes as long to load as an instrument to be told

        say(f"vcfbench watchdog: {words}", alarm=alarm)
    except Exception:  # noqa: BLE001  # what it needs is gone: the words must reach somebody
        last_words.say(words)


def _notify(charge: dict[str, Any], said: Said, error: str, code: int | None) -> None:
    """Tell the program that the bench file names, if it names one."""
    if charge["bench"].get("notify") is not None:
        with suppress(Exception):  # the bench is what counts
            from vcfbench.runs.notified import notify_in_place_of  # noqa: PLC0415  # few stations have one

            directory = Path(json.loads(said[b"journal"])).parent if b"journal" in said else None
            notify_in_place_of(directory, charge["bench"], error, code)


def _write(charge: dict[str, Any], said: Said, values: dict[str, Any]) -> None:
    """Add a line to the journal of the run, in place of one that was torn, and sign it where the run would have."""
    if b"journal" not in said or b"left" in said:  # who lives on closes its own record
        return
    key = None
    with suppress(Exception):  # a line that is not signed says more than none
        from vcfbench.records.signing import named_key  # noqa: PLC0415  # as above

        key = named_key((charge["bench"].get("laboratory") or {}).get("signing_key"))
    with suppress(Exception):  # the bench is what counts
        from vcfbench.records.journal import append_line  # noqa: PLC0415  # few runs end so

        append_line(Path(json.loads(said[b"journal"])), {"type": "watchdog", **values}, key)
