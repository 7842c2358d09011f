"""Speaks to an open instrument in its own words, past its driver: for consoles.

It goes through the driver's own session or line, so that deadlines, resynchronising and "one question at a time" hold
here too.
"""

from collections.abc import Callable
from contextlib import suppress
from functools import partial

from vcfbench.drivers.conversation import Conversation
from vcfbench.drivers.rate_table.acl import AclDialect
from vcfbench.drivers.rate_table.driver import RateTableDriver
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.drivers.scpi_instrument import ScpiInstrument
from vcfbench.errors import ConfigError, DeadlineExceeded
from vcfbench.interfaces import Instrument

_COMMAND_S = 0.5
"""Longest time after which a table that answers commands at all begins to answer one, s."""

_SILENCE_S = 0.2


class Plain:
    """An open instrument: `tell` sends a command, `ask` sends a query and returns the unchanged answer."""

    def __init__(self, conversation: Conversation, tell: Callable[[str], object], ask: Callable[[str], bytes]) -> None:
        self.tell = tell
        self.ask = ask
        self._conversation = conversation

    @property
    def closed(self) -> bool:
        """Return True if the connection is gone."""
        return self._conversation.closed


class PlainLine(Plain):
    """A rate table whose language does not show which message is answered, so all received bytes are shown."""


def plain(instrument: Instrument, timeout_s: float) -> Plain:
    """Return the plain way to speak to `instrument`; an exchange may take `timeout_s`.

    Raises:
        ConfigError: its language is one that only its driver speaks.
    """
    if isinstance(instrument, ScpiInstrument):
        session = instrument.session
        return Plain(
            session,
            lambda message: session.send(message, deadline=session.deadline(timeout_s)),
            lambda message: session.query_raw(message, session.deadline(timeout_s)),
        )
    if isinstance(instrument, RateTableDriver):
        dialect, line = instrument.dialect, instrument.line
        if isinstance(dialect, AclDialect):
            return Plain(
                line,
                lambda message: dialect.command(line, message, line.deadline(timeout_s)),
                lambda message: dialect.ask(line, message, line.deadline(timeout_s)).encode("ascii"),
            )
        if dialect.typed_line_end is not None:  # frames of bytes cannot be typed
            ask = partial(_until_silence, line, dialect.typed_line_end, timeout_s)
            return PlainLine(line, ask, ask)
    raise ConfigError(f"{instrument.name} speaks a language that cannot be typed", instrument=instrument.name)


def _until_silence(line: TableLine, terminator: bytes, timeout_s: float, message: str) -> bytes:
    """Send a message and return all until the line falls silent, lines separated by blanks; or nothing."""
    with line.exchange(message, line.deadline(0.0)):
        line.take_unasked()
        line.dirty = True  # the dialect finds its place again before it asks anything itself
        line.send(message.encode("ascii") + terminator, line.deadline(timeout_s))
        lines: list[bytes] = []
        wait_s = timeout_s if "?" in message else min(_COMMAND_S, timeout_s)
        with suppress(DeadlineExceeded):
            while True:
                lines.append(line.take_line(line.deadline(wait_s)))
                wait_s = _SILENCE_S
        rest = line.take_unasked()
        return b" ".join(part for part in (*lines, rest) if part.strip())
