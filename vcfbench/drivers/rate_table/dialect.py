"""The seam between the rate-table driver and the languages that tables speak."""

import math
from collections.abc import Callable
from typing import Final, Literal, Protocol

from msgspec import Struct

from vcfbench.clock import Deadline
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.drivers.serial_wire import Link
from vcfbench.errors import InstrumentError
from vcfbench.interfaces import Identity
from vcfbench.models import find_language, profile_reader, resolve

MIDDLE: Final = 0.1
"""Part of the travel, either side of its middle, within which a table stands when a run begins (ours)."""

Header = Literal["none", "u32le2", "u32be2", "auto"]
"""Header of a reply of ACL on a byte stream: nothing, or error code and length as two 32-bit words."""


class TableSettings(Struct, frozen=True):
    """Settings of a rate table in addition to its resource; a dialect is made from them.

    The limits are the highest demands, magnitudes; infinite, as without limits here, leaves the table's own.
    `reply_header` is that before replies, `steps_per_deg` the stage's microsteps per degree.
    """

    max_rate_deg_s: float = math.inf
    max_acceleration_deg_s2: float = math.inf
    timeout_s: float = 2.0
    axis: int = 1
    axis_sign: Literal[1, -1] = 1
    baud_rate: int | None = None
    reply_header: Header = "auto"
    steps_per_deg: float | None = None
    rest_tolerance_deg_s: float = 0.05
    found_deg_s: float = 0.0
    """Rate at which whoever had it before may have left it turning."""
    port: str | None = None
    """Address that is opened instead of the resource, which messages name all the same."""
    upon_connecting: Callable[[TableLine, "TableDialect"], None] | None = None
    """Called with the open line and its language before anything is asked."""


class TableDialect(Protocol):
    r"""One axis of one kind of table, in that table's own sign convention, deg, deg/s, deg/s2.

    Commands (nothing returned) are sent once. Questions may be asked again by the driver. Every method raises a
    TransportError when the line fails and an InstrumentError when the table refuses. What has a body here holds for
    languages that know no more; they inherit it. Messages go by ``line.ask(self, b"POS?\r\n", deadline)`` and
    ``line.command``, which keep questions and answers in step.
    """

    typed_line_end: bytes | None = None
    """Line end that a person types; None where messages cannot be typed."""

    @property
    def rate_quantum_deg_s(self) -> float:
        """Step of the commanded rate."""

    @property
    def gap_s(self) -> float:
        """Gap that the table needs between two messages, s."""
        return 0.0

    @property
    def own_time_s(self) -> float:
        """Time of one making safe for the language itself, s: its pauses, and the spans over which rates are read."""
        return 0.0

    def stop_words(self, acceleration_deg_s2: float | None) -> tuple[bytes, ...]:
        """Return the messages that bring the table to rest from any state, with its servo closed.

        They are sent without looking at any answer, more than once, and maybe amid another message: what ends a torn
        one goes first. With an acceleration the table is told to stop first as it is, then with that one.
        """

    def shutdown_words(self) -> tuple[bytes, ...]:
        """Return the further messages if rest cannot be proved; none if they would let the table coast."""
        return ()

    def realised_deg_s(self, rate_deg_s: float) -> float:
        """Return the rate that is sent for `rate_deg_s`: the nearest multiple of the table's step."""
        return round(rate_deg_s / self.rate_quantum_deg_s) * self.rate_quantum_deg_s

    def refusal(self, rate_deg_s: float, acceleration_deg_s2: float) -> str | None:
        """Return the reason that a motion cannot be demanded, or None."""
        del rate_deg_s, acceleration_deg_s2
        return None

    def identify(self, line: TableLine, deadline: Deadline) -> Identity:
        """Ask for the identity; also learns the framing where it is not configured."""

    def resync(self, line: TableLine, deadline: Deadline) -> None:
        """Get answers and queries into step after a failed exchange, by default by silence."""
        line.drain(deadline)

    def may_come_unasked(self, data: bytes) -> bool:
        """Return True if bytes that came between two exchanges leave them in step; empty lines do."""
        return not data.strip()

    def claim(self, line: TableLine, deadline: Deadline) -> None:
        """Take remote control for this program alone."""
        del line, deadline

    def release(self, line: TableLine, deadline: Deadline) -> None:
        """Give remote control back."""
        del line, deadline

    def set_limits(self, line: TableLine, limits: TableSettings, deadline: Deadline) -> None:
        """Send the table its limits and its over-rate trip; the driver checks them too."""
        del line, limits, deadline

    def close_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Zero the demand, select rate mode, close the servo."""

    @property
    def travel_deg(self) -> tuple[float, float] | None:
        """Ends of travel; None for a table that turns without end."""
        return None

    def go_to(self, line: TableLine, angle_deg: float, rate_deg_s: float, deadline: Deadline) -> None:
        """Begin to turn to an angle; InstrumentError where the language has no word for it."""
        raise InstrumentError("the known part of this language has no move to an angle", **line.where)

    def hold(self, line: TableLine, deadline: Deadline) -> None:
        """Leave rate mode: the rate becomes zero."""

    def open_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Open the servo in the table's own orderly way; refused (InterlockError) where it would coast."""

    def demand_rate(self, line: TableLine, rate_deg_s: float, acceleration_deg_s2: float, deadline: Deadline) -> None:
        """Ramp to a rate; an infinite acceleration keeps the table's present one. Commanding rate 0 may be repeated."""

    def servo_closed(self, line: TableLine, deadline: Deadline) -> bool:
        """Return True if the servo holds the axis."""

    def stands(self, line: TableLine, deadline: Deadline) -> bool:
        """Return True if an independent flag of the table reports rest, or if the table has no such flag."""
        del line, deadline
        return True

    @property
    def judges_rate_by(self) -> str:
        """Substitute for a flag of the table, in words."""
        return ""

    def at_rate(self, line: TableLine, deadline: Deadline) -> bool:
        """Return True if the demanded rate is reached."""

    def rate_deg_s(self, line: TableLine, deadline: Deadline) -> float:
        """Read the rate."""

    def angle_deg(self, line: TableLine, deadline: Deadline) -> float:
        """Read the angle."""

    def fault(self, line: TableLine, deadline: Deadline) -> str | None:
        """Return the latched fault in words."""
        return None

    def clear_fault(self, line: TableLine, deadline: Deadline) -> None:
        """Clear a latched fault."""
        raise InstrumentError("the known part of this language cannot clear a fault", **line.where)

    def check_errors(self, line: TableLine, deadline: Deadline) -> None:
        """Raise InstrumentError with the table's refusals since last asked."""
        del line, deadline


def spoken(name: str, settings: TableSettings) -> tuple[TableDialect, Link]:
    """Return the dialect `name` for an axis, and the line that it is spoken on.

    Raises:
        ConfigError: there is none of that name, its profile is wrong, or something that it needs is not told.
    """
    row = find_language(name)
    if row is not None and row.dialect is not None:
        return resolve(row.dialect)(settings), Link(baud=row.baud_rate)
    of_profile: tuple[TableDialect, Link] = profile_reader().spoken(name, settings.axis)
    return of_profile


def decimal(value: float, digits: int = 6) -> str:
    """Return `value` with at most so many decimals and no exponent; never a negative zero."""
    return f"{value + 0.0:.{digits}f}".rstrip("0").rstrip(".")
