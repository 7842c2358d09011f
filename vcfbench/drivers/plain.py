"""Speaks to an open instrument in its own words, past its driver: for consoles.

It goes through the driver's own session or line, so that deadlines, resynchronising and "one question at a time" hold
here too.
"""

from contextlib import suppress
from typing import TypeAlias

from vcfbench.drivers.rate_table.acl import AclDialect
from vcfbench.drivers.rate_table.driver import RateTableDriver
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.drivers.scpi_instrument import ScpiInstrument
from vcfbench.drivers.session import Session
from vcfbench.errors import ConfigError, DeadlineExceeded, TransportError
from vcfbench.interfaces import Instrument

_COMMAND_S = 0.5
"""Longest time after which a table that answers commands at all begins to answer one, s."""

_SILENCE_S = 0.2


Plain: TypeAlias = "PlainSession | PlainTable | PlainLine"


def plain(instrument: Instrument, timeout_s: float) -> Plain:
    """Return the plain way to speak to `instrument`; an exchange may take `timeout_s`.

    Raises:
        ConfigError: its language is one that only its driver speaks.
    """
    if isinstance(instrument, ScpiInstrument):
        return PlainSession(instrument.session, timeout_s)
    if isinstance(instrument, RateTableDriver):
        dialect, line = instrument.dialect, instrument.line
        if isinstance(dialect, AclDialect):
            return PlainTable(line, dialect, timeout_s)
        terminator: bytes | None = getattr(dialect, "typed_line_end", None)  # frames of bytes cannot be typed
        if terminator is not None:
            return PlainLine(line, terminator, timeout_s)
    raise ConfigError(f"{instrument.name} speaks a language that cannot be typed", instrument=instrument.name)


class PlainSession:
    """A SCPI instrument."""

    def __init__(self, session: Session, timeout_s: float) -> None:
        self._session = session
        self._timeout_s = timeout_s

    @property
    def closed(self) -> bool:
        """Tell whether the connection is gone."""
        return self._session.closed

    def tell(self, message: str) -> None:
        """Send a message that asks nothing."""
        self._session.send(message, deadline=self._session.deadline(self._timeout_s))

    def ask(self, message: str) -> bytes:
        """Send a message and return its answer as it came, a line or a definite-length block, without its newline."""
        return self._session.query_raw(message, self._session.deadline(self._timeout_s))

    def clear(self) -> None:
        """Do a device clear."""
        self._session.clear()


class PlainTable:
    """A rate table that speaks ACL."""

    def __init__(self, line: TableLine, dialect: AclDialect, timeout_s: float) -> None:
        self._line = line
        self._dialect = dialect
        self._timeout_s = timeout_s

    @property
    def closed(self) -> bool:
        """Tell whether the connection is gone."""
        return self._line.closed

    def tell(self, message: str) -> None:
        """Send a message that asks nothing; raises InstrumentError with the table's refusal."""
        self._dialect.command(self._line, message, self._line.deadline(self._timeout_s))

    def ask(self, message: str) -> bytes:
        """Send a message and return its answer."""
        return self._dialect.ask(self._line, message, self._line.deadline(self._timeout_s)).encode("ascii")

    def clear(self) -> None:
        """Drop unasked bytes; tables know no device clear."""
        self._line.take_unasked()


class PlainLine:
    """A rate table whose language does not tell which message is answered: everything that comes is shown."""

    def __init__(self, line: TableLine, terminator: bytes, timeout_s: float) -> None:
        self._line = line
        self._terminator = terminator
        self._timeout_s = timeout_s

    @property
    def closed(self) -> bool:
        """Tell whether the connection is gone."""
        return self._line.closed

    def tell(self, message: str) -> None:
        """Send a message, and drop any answer."""
        self.ask(message)

    def ask(self, message: str) -> bytes:
        """Send a message and return all until the line falls silent, lines separated by blanks; or nothing."""
        line = self._line
        with line.exclusive():
            try:
                line.take_unasked()
                line.dirty = True  # the dialect finds its place again before it asks anything itself
                line.send(message.encode("ascii") + self._terminator, line.deadline(self._timeout_s))
                lines: list[bytes] = []
                wait_s = self._timeout_s if "?" in message else min(_COMMAND_S, self._timeout_s)
                with suppress(DeadlineExceeded):
                    while True:
                        lines.append(self._line.take_line(self._line.deadline(wait_s)))
                        wait_s = _SILENCE_S
                rest = self._line.take_unasked()
                return b" ".join(part for part in (*lines, rest) if part.strip())
            except TransportError as error:
                raise line.locate(error, message, line.deadline(0.0))  # noqa: B904 - the same error, now knowing where

    def clear(self) -> None:
        """Drop unasked bytes; tables know no device clear."""
        self._line.take_unasked()
