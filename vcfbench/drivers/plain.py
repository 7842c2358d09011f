"""Speaks to an open instrument in its own words, past its driver: for consoles.

It goes through the driver's own session or line, so that deadlines, resynchronising and "one question at a time" hold
here too.
"""

from contextlib import suppress
from typing import Any

from vcfbench.drivers.rate_table.acl import AclDialect
from vcfbench.drivers.rate_table.driver import RateTableDriver
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.drivers.scpi_instrument import ScpiInstrument
from vcfbench.drivers.session import Session
from vcfbench.errors import ConfigError, DeadlineExceeded
from vcfbench.interfaces import Instrument

_COMMAND_S = 0.5
"""Longest time after which a table that answers commands at all begins to answer one, s."""

_SILENCE_S = 0.2


def plain(instrument: Instrument, timeout_s: float) -> "PlainSession | PlainTable | PlainLine":
    """Return the plain way to speak to `instrument`; an exchange may take `timeout_s`.

    Raises:
        ConfigError: its language is one that only its driver speaks.
    """
    if isinstance(instrument, ScpiInstrument):
        return PlainSession(instrument.session, timeout_s)
    if isinstance(instrument, RateTableDriver):
        dialect, line = instrument.dialect, instrument.line
        if isinstance(dialect, AclDialect):
            return PlainTable(line, timeout_s, dialect)
        terminator: bytes | None = getattr(dialect, "typed_line_end", None)  # frames of bytes cannot be typed
        if terminator is not None:
            return PlainLine(line, timeout_s, terminator)
    raise ConfigError(f"{instrument.name} speaks a language that cannot be typed", instrument=instrument.name)


class Plain:
    """An open instrument; an exchange may take `timeout_s`."""

    def __init__(self, conversation: Any, timeout_s: float) -> None:
        self._conversation = conversation
        self._timeout_s = timeout_s

    @property
    def closed(self) -> bool:
        """Tell whether the connection is gone."""
        return bool(self._conversation.closed)

    def _deadline(self) -> Any:
        return self._conversation.deadline(self._timeout_s)


class PlainSession(Plain):
    """A SCPI instrument."""

    _conversation: Session

    def tell(self, message: str) -> None:
        """Send a message that asks nothing."""
        self._conversation.send(message, deadline=self._deadline())

    def ask(self, message: str) -> bytes:
        """Send a message and return its answer as it came, a line or a definite-length block, without its newline."""
        return self._conversation.query_raw(message, self._deadline())


class PlainLine(Plain):
    """A rate table whose language does not tell which message is answered: everything that comes is shown."""

    _conversation: TableLine

    def __init__(self, line: TableLine, timeout_s: float, terminator: bytes) -> None:
        super().__init__(line, timeout_s)
        self._terminator = terminator

    def tell(self, message: str) -> None:
        """Send a message, and drop any answer."""
        self.ask(message)

    def ask(self, message: str) -> bytes:
        """Send a message and return all until the line falls silent, lines separated by blanks; or nothing."""
        line = self._conversation
        with line.exchange(message, line.deadline(0.0)):
            line.take_unasked()
            line.dirty = True  # the dialect finds its place again before it asks anything itself
            line.send(message.encode("ascii") + self._terminator, self._deadline())
            lines: list[bytes] = []
            wait_s = self._timeout_s if "?" in message else min(_COMMAND_S, self._timeout_s)
            with suppress(DeadlineExceeded):
                while True:
                    lines.append(line.take_line(line.deadline(wait_s)))
                    wait_s = _SILENCE_S
            rest = line.take_unasked()
            return b" ".join(part for part in (*lines, rest) if part.strip())


class PlainTable(Plain):
    """A rate table that speaks ACL."""

    def __init__(self, line: TableLine, timeout_s: float, dialect: AclDialect) -> None:
        super().__init__(line, timeout_s)
        self._dialect = dialect

    def tell(self, message: str) -> None:
        """Send a message that asks nothing; raises InstrumentError with the table's refusal."""
        self._dialect.command(self._conversation, message, self._deadline())

    def ask(self, message: str) -> bytes:
        """Send a message and return its answer."""
        return self._dialect.ask(self._conversation, message, self._deadline()).encode("ascii")
