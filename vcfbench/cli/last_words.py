"""Messages of a watchdog process that can load no more code: its package was moved, files are used up."""

from __future__ import annotations

import os
import sys

TYPE_CHECKING = False  # as in vcfbench/__init__.py
if TYPE_CHECKING:
    from collections.abc import Mapping


def not_safe(said: Mapping[bytes, bytes], error: BaseException) -> str:
    """Return the message for a bench that could not be made safe because of `error`; `said` has its actuators."""
    drives = said.get(b"owner", b"").partition(b" ")[2].decode().strip('"')
    raised = " ".join([f"{type(error).__name__}:", *str(error).split()]).rstrip(":")
    return f"NOT SAFE: {drives}: {raised}; make it safe by hand before anything else"


def say(words: str) -> None:
    """Say `words` on stderr."""
    if sys.stderr is not None:  # else another file may have its number
        write(2, f"vcfbench watchdog: {words}\n".encode())


def write(number: int, data: bytes) -> None:
    """Write to a stream that may have no reader: a program that is stopped as it begins waits no longer for this."""
    try:  # noqa: SIM105  # contextlib takes as long to load as all else here
        os.write(number, data)
    except OSError:
        pass
