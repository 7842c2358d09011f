"""A stream that cannot hold up its writer."""

import os
from contextlib import suppress
from queue import SimpleQueue
from threading import Thread
from typing import Final, TextIO

_PARTING_S: Final = 0.5  # Longest time of a stream for one text when all else is done, s


class Outlet:
    """A stream whose texts a separate thread writes to a terminal or pipe.

    A terminal may stand still (Ctrl-S, a pager that waits for its reader) or go away (closed window, broken pipe). The
    table turns meanwhile, so nobody may wait for it: what cannot be written is lost, and nothing is raised.
    """

    def __init__(self, stream: TextIO) -> None:
        self._stream = stream
        self._pending: SimpleQueue[str | None] = SimpleQueue()
        self._writer = Thread(target=self._run, name="display", daemon=True)
        self._lost = False
        self.encoding = getattr(stream, "encoding", None) or "utf-8"

    @property
    def behind(self) -> bool:
        """Return True if something is still waiting to be written."""
        return not self._pending.empty()

    def open(self) -> None:
        """Begin to write."""
        self._writer.start()

    def write(self, text: str) -> int:
        """Take `text`, to be written when the stream takes it."""
        if not self._lost:
            self._pending.put(text)
        return len(text)

    def flush(self) -> None:
        """Do nothing: a thread writes the texts."""

    def isatty(self) -> bool:
        """Return True if there is a terminal behind it."""
        try:
            return self._stream.isatty()
        except (OSError, ValueError):
            return False

    def close(self) -> None:
        """Write the rest, as long as the stream goes on taking it."""
        self._pending.put(None)
        left = self._pending.qsize() + 1
        while self._writer.is_alive() and self._pending.qsize() < left:
            left = self._pending.qsize()
            self._writer.join(_PARTING_S)
        self._lost = True

    def _run(self) -> None:
        with suppress(OSError, ValueError):  # ValueError: the stream was closed
            while not self._lost and (text := self._pending.get()) is not None:
                try:
                    number = self._stream.fileno()
                except (OSError, ValueError, AttributeError):
                    self._stream.write(text)
                    self._stream.flush()
                    continue
                # past the stream's own buffer: a thread that hangs there would hold its lock against everybody
                data = text.encode(self.encoding, "replace")
                while data and not self._lost:
                    data = data[os.write(number, data) :]
        self._lost = True
