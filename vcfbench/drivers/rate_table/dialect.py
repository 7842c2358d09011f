"""The seam between the rate-table driver and the languages that tables speak."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal, Protocol

from msgspec import Struct

if TYPE_CHECKING:
    from vcfbench.clock import Deadline
    from vcfbench.drivers.rate_table.line import TableLine
    from vcfbench.interfaces import Identity

Header = Literal["none", "u32le2", "u32be2", "auto"]
"""Header of a reply of ACL on a byte stream: nothing, or error code and length as two 32-bit words."""


class AxisSettings(Struct, frozen=True):
    """Settings of the axis from the bench file; a dialect takes those of its language.

    `header` is that before replies, `steps_per_deg` the stage's microsteps per degree.
    """

    axis: int = 1
    header: Header = "auto"
    steps_per_deg: float | None = None


class TableLimits(Struct, frozen=True):
    """Highest demands on the table, deg/s and deg/s2, magnitudes; infinite leaves the table's own limit."""

    max_rate_deg_s: float
    max_acceleration_deg_s2: float


class TableDialect(Protocol):
    """One axis of one kind of table, in that table's own sign convention, deg, deg/s, deg/s2.

    Commands (nothing returned) are sent once. Questions may be asked again by the driver. Every method raises a
    TransportError when the line fails and an InstrumentError when the table refuses.
    """

    @property
    def rate_quantum_deg_s(self) -> float:
        """Step of the commanded rate."""

    @property
    def gap_s(self) -> float:
        """Gap that the table needs between two messages, s."""

    @property
    def own_time_s(self) -> float:
        """Time of one making safe for the language itself, s: its pauses, and the spans over which rates are read."""

    def stop_words(self, acceleration_deg_s2: float | None) -> tuple[bytes, ...]:
        """Return the messages, as sent, that bring the table to rest with its servo closed, whatever it is doing.

        They are sent without looking at any answer, more than once, and maybe amid another message: what ends a torn
        one goes first. With an acceleration the table is told to stop first as it is, then with that one.
        """

    def shutdown_words(self) -> tuple[bytes, ...]:
        """Return the messages that are sent besides when rest cannot be proved; none where they let a table coast."""

    def realised_deg_s(self, rate_deg_s: float) -> float:
        """Return the rate that the table is really told for `rate_deg_s`: a multiple of its step."""

    def identify(self, line: TableLine, deadline: Deadline) -> Identity:
        """Ask for the identity; also learns the framing where it is not configured."""

    def resync(self, line: TableLine, deadline: Deadline) -> None:
        """Get answers and questions into step again after a failed exchange, or raise OutOfSync."""

    def claim(self, line: TableLine, deadline: Deadline) -> None:
        """Take remote control for this program alone."""

    def release(self, line: TableLine, deadline: Deadline) -> None:
        """Give remote control back."""

    def set_limits(self, line: TableLine, limits: TableLimits, deadline: Deadline) -> None:
        """Tell the table its limits and its over-rate trip."""

    def close_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Zero the demand, select rate mode, close the servo."""

    def hold(self, line: TableLine, deadline: Deadline) -> None:
        """Leave rate mode: zero rate whatever is demanded."""

    def open_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Open the servo in the table's own orderly way."""

    def demand_rate(self, line: TableLine, rate_deg_s: float, acceleration_deg_s2: float, deadline: Deadline) -> None:
        """Ramp to a rate; an infinite acceleration leaves the table's as it is. Asking for rate 0 may be repeated."""

    def servo_closed(self, line: TableLine, deadline: Deadline) -> bool:
        """Tell whether the servo holds the axis."""

    def at_rate(self, line: TableLine, deadline: Deadline) -> bool:
        """Tell whether the demanded rate is reached."""

    def rate_deg_s(self, line: TableLine, deadline: Deadline) -> float:
        """Read the rate."""

    def angle_deg(self, line: TableLine, deadline: Deadline) -> float:
        """Read the angle."""

    def fault(self, line: TableLine, deadline: Deadline) -> str | None:
        """Return the latched fault in words."""

    def clear_fault(self, line: TableLine, deadline: Deadline) -> None:
        """Clear a latched fault."""

    def check_errors(self, line: TableLine, deadline: Deadline) -> None:
        """Raise InstrumentError with the table's refusals since last asked."""
