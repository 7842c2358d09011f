"""Speaks to an open instrument in its own words, past its driver: for consoles.

It goes through the driver's own session or line, so that deadlines, resynchronising and "one question at a time" hold
here too.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from vcfbench.drivers import replies
from vcfbench.drivers.rate_table.acl import AclDialect
from vcfbench.drivers.rate_table.driver import RateTableDriver
from vcfbench.errors import ConfigError, InstrumentError, TransportError

if TYPE_CHECKING:
    from vcfbench.drivers.rate_table.line import TableLine
    from vcfbench.drivers.session import Session
    from vcfbench.interfaces import Instrument

__all__ = ["PlainSession", "PlainTable", "plain"]

# The drivers keep their wires to themselves, and rightly so; this module is the one friend that they have.
# ruff: noqa: SLF001


def plain(instrument: Instrument, timeout_s: float) -> PlainSession | PlainTable:
    """Return the plain way to speak to `instrument`; an exchange may take `timeout_s`.

    Raises:
        ConfigError: its language is one that only its driver speaks.
    """
    driver: Any = instrument
    if not isinstance(instrument, RateTableDriver):
        return PlainSession(driver._session, timeout_s)
    if isinstance(driver._dialect, AclDialect):
        return PlainTable(driver._line, driver._dialect, timeout_s)
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
        session, deadline = self._session, self._session.deadline(self._timeout_s)
        with session.exclusive():
            session._in_step(deadline)
            session._dirty = True  # until the exchange is whole
            try:
                session._say(message, deadline)
                answer = bytearray(session._received)
                session._received = b""
                ended = False
                while not _whole(answer, ended=ended):
                    more, ended = session._wire.receive(deadline)
                    answer += more
            except TransportError as error:
                raise session._failed(error, message, deadline)  # noqa: B904 - the same error, now knowing where
            session._dirty = False
        return bytes(answer).removesuffix(b"\n").removesuffix(b"\r")

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
        """Send a message that asks nothing; raises InstrumentError with what the table says against it."""
        self._dialect._command(self._line, message, self._line.deadline(self._timeout_s))

    def ask(self, message: str) -> bytes:
        """Send a message and return its answer."""
        return self._dialect._ask(self._line, message, self._line.deadline(self._timeout_s)).encode("ascii")

    def clear(self) -> None:
        """Forget what has come unasked; tables know no device clear."""
        self._line.take_unasked()


def _whole(answer: bytearray, *, ended: bool) -> bool:
    """Tell whether an answer is complete: a block by its count, a line by its newline, either by END."""
    if ended or not answer:
        return ended
    if answer[:1] != b"#":
        return b"\n" in answer
    try:
        lengths = replies.block_length(answer)
    except (TransportError, InstrumentError):  # a line that begins like a block
        return b"\n" in answer
    return lengths is not None and len(answer) > sum(lengths)
