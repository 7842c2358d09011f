"""Ending of a command: the final exit code, and a message on the first stream that takes it.

A command may have lost its terminal, its reader or its disk, and signals may come as late as they like: what was found
out about the bench stands. The worst that is known wins, whatever went wrong on the way out.
"""

import errno
import io
import json
import os
import signal
import stat
import sys
from contextlib import suppress
from contextvars import ContextVar
from types import FrameType, TracebackType
from typing import Any, Final, Self, TextIO, cast

from vcfbench.errors import Aborted, BenchError, NotSafe

_WATCHED: Final = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
_SAYING_S: Final = 2.0
"""Longest time of a terminal or pipe for the last words, before they go elsewhere, s."""

JSON_DUE: Final = ContextVar("JSON_DUE", default=False)
"""True where ``--json`` was given, as long as no object was printed."""


class Stopped(BaseException):
    """A signal came while no bench was open; no error, so that nothing on the way takes it for one."""


class SignalsWithoutBench:
    """Signals while no bench is open: until the answer is given they end the command, after it they change nothing.

    While a bench is open, it watches for signals itself and gives them back to this one when it is left.
    """

    def __init__(self) -> None:
        self._answered = False
        self._watched: list[signal.Signals] = []

    def __enter__(self) -> Self:
        for name in _WATCHED:
            number = getattr(signal.Signals, name, None)
            if number is not None and signal.getsignal(number) in {signal.SIG_DFL, signal.default_int_handler}:
                signal.signal(number, self._handle)
                self._watched.append(number)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Ignore signals from now on: the interpreter gives up all handlers before it ends, and would be killed."""
        for number in self._watched:
            signal.signal(number, signal.SIG_IGN)

    def answered(self) -> None:
        """Say that the code is known: from now on signals change nothing."""
        self._answered = True

    def _handle(self, number: int, _frame: FrameType | None) -> None:
        if not self._answered:
            raise Stopped(signal.Signals(number).name)


def open_streams() -> None:
    """Put the null device where stdin, stdout or stderr is closed.

    Else the next files and sockets would get their numbers, and what the interpreter says on stderr would go into a
    journal or to an instrument.
    """
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is None:
            mode = "w" if number else "r"
            stream = open(os.devnull, mode, encoding="utf-8")  # noqa: PTH123, SIM115  # open until the process ends
            try:
                os.fstat(number)
            except OSError:
                os.dup2(stream.fileno(), number)
            setattr(sys, name, cast("TextIO", stream))


def ending_of(error: BaseException) -> tuple[str, int] | None:
    """Return words and exit code of the error that ended a command; None for a mistake of ours, which has a traceback.

    What is not safe comes before everything, wherever it is in the chain of what went wrong.
    """
    waiting, seen = [error], set[int]()  # the error, and all that led to it or that it came in the way of
    while waiting:
        each = waiting.pop()
        if isinstance(each, NotSafe):
            return str(each), NotSafe.exit_code
        if id(each) not in seen:
            seen.add(id(each))
            waiting += filter(None, (each.__cause__, each.__context__))
    match error:
        case BenchError():
            words = f"{error}; the bench was made safe" if isinstance(error, Aborted) else str(error)
            ending = words, error.exit_code
        case Stopped():
            ending = f"stopped by {error}", Aborted.exit_code
        case KeyboardInterrupt():
            ending = "stopped by the keyboard", Aborted.exit_code
        case BrokenPipeError():  # whoever read our output has left: nobody is there to be told
            ending = "", Aborted.exit_code
        case OSError():  # a full disk behind stdout; files that the user named have errors of their own
            ending = f"cannot read or write: {error.strerror}", BenchError.exit_code
        case _:
            return None
    return ending


def usage_of(error: BaseException) -> tuple[str, int] | None:
    """Return words and exit code of an error of the command line's parser; None for anything else."""
    if not (callable(getattr(error, "show", None)) and hasattr(error, "exit_code")):
        return None
    usage: Any = error
    words = io.StringIO()
    usage.show(file=words)
    return words.getvalue().rstrip("\n"), usage.exit_code


def print_error(words: str, code: int) -> None:
    """Print the error that ended a command as the one JSON object that is due on stdout."""
    if JSON_DUE.get() and words and sys.stdout is not None:
        JSON_DUE.set(False)
        try:
            sys.stdout.write(f"{json.dumps({'error': words, 'exit_code': code})}\n")
            sys.stdout.flush()
        except (OSError, ValueError):
            discard_stdout()


def say(words: str, *, alarm: bool = False) -> None:
    """Say `words` on stderr; an alarm that stderr does not take goes to the terminal, else to the system's log."""
    if _to_stderr(words) or not alarm:
        return
    if not _to_terminal(words):
        _to_system_log(words)


def _to_stderr(words: str) -> bool:
    """Return True if stderr took `words`; past its buffer, which may hold text that can never be written."""
    stream = sys.stderr
    if stream is None or getattr(stream, "name", None) == os.devnull:  # it was closed before the start
        return False
    try:
        number = stream.fileno()
    except (OSError, ValueError, AttributeError):  # no file: somebody listens in this process
        print(words, file=stream, flush=True)
        return True
    with suppress(OSError, ValueError):
        stream.flush()
    return _put(number, f"{words}\n".encode(stream.encoding or "utf-8", "backslashreplace"))


def _to_terminal(words: str) -> bool:
    try:
        number = os.open("/dev/tty", os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
    except (OSError, AttributeError):  # there is none, or this is Windows
        return False
    try:
        return _put(number, f"\r\n{words}\r\n".encode())
    finally:
        os.close(number)


def _to_system_log(words: str) -> None:
    with suppress(ImportError):  # Windows has none
        import syslog  # noqa: PLC0415

        syslog.openlog("vcfbench", syslog.LOG_PID)
        syslog.syslog(syslog.LOG_CRIT, words)


def _put(number: int, data: bytes) -> bool:
    """Write `data`; return True if it was taken, within a time short enough to wait for an exit code."""
    from vcfbench.clock import within  # noqa: PLC0415  # there where a bench was opened; else msgspec comes with it

    begun: list[bool] = []
    taken: list[bool] = []

    def write() -> None:
        begun.append(True)
        if hasattr(signal, "SIGTTOU"):  # in the background, a terminal may be set to stop who writes to it
            signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTTOU})
        rest = data
        with suppress(OSError):
            while rest:
                rest = rest[os.write(number, rest) :]
            taken.append(True)

    within(_SAYING_S, write)
    if not begun:  # the thread for it had no memory to begin with
        write()
    return bool(taken)


def terminal_gone(error: OSError) -> bool:
    """Return True if `error` is that of a closed terminal."""
    with suppress(OSError, ValueError, AttributeError):
        return error.errno == errno.EIO and stat.S_ISCHR(os.fstat(sys.stdout.fileno()).st_mode)
    return False


def discard_stdout() -> None:
    """Send the buffered rest nowhere, or the interpreter complains about it when it ends."""
    with suppress(OSError, ValueError):  # stdout need not be a file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
