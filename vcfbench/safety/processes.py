"""Identity of a process: its number alone may have been given again."""

from __future__ import annotations

import os
import signal
from contextlib import suppress
from pathlib import Path
from typing import Final

_START: Final = 18
"""Place of the clock tick at which it started, after its state in ``/proc/PID/stat`` (proc(5), field 22)."""


_FLAGS: Final = 6
"""Place of its flags there (field 9), and the one of a process that exits (PF_EXITING, linux/sched.h)."""
_EXITING: Final = 0x4


def mark_of(pid: int) -> str | None:
    """Return a mark that distinguishes process `pid` from a later one of its number; None after its end.

    Where the system does not tell when a process started (no ``/proc``) all have the same mark.
    """
    try:
        state, *rest = Path(f"/proc/{pid}/stat").read_text("utf-8", "replace").rpartition(") ")[2].split()
        return None if state in {"Z", "X"} else rest[_START]
    except OSError:
        if Path("/proc/self/stat").exists():
            return None
    with suppress(OSError):  # on Windows asking would end it
        if os.name == "posix":
            os.kill(pid, 0)
        return ""
    return None


def dying(pid: int) -> bool:
    """Return True if process `pid` is ending, and the system still closes its files.

    Where the system does not tell, one that lives may be.
    """
    with suppress(OSError, ValueError, IndexError):
        flags = int(Path(f"/proc/{pid}/stat").read_text("utf-8", "replace").rpartition(") ")[2].split()[_FLAGS])
        return bool(flags & _EXITING)
    return not Path("/proc/self/stat").exists()


def end(pid: int, mark: str | None, number: int) -> bool:
    """Send signal `number` to process `pid` if it is still the one of this `mark`; return True if it was.

    Raises:
        OSError: it belongs to another user.
    """
    if mark is None or mark_of(pid) != mark:
        return False
    with suppress(ProcessLookupError):
        os.kill(pid, number)
        return True
    return False


KILL: Final = getattr(signal, "SIGKILL", signal.SIGTERM)
"""Signal that no program can put off."""
