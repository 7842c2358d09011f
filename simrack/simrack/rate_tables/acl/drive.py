"""The drive of the ACUTROL3000's axis: closed after a delay, opened in order by the ABORT profile, or dropped."""

from __future__ import annotations

from simrack.rate_tables.acl.limits import AclLimits
from simrack.rate_tables.axis import PositionMoves, TableAxis, TableErrors, TableWorld

POLL_S = 0.002
"""How often the measured rate is looked at when it decides what happens next."""
NORMAL_UNSERVO_BIT, SOFTWARE_ABORT_BIT, HARDWARE_ABORT_BIT = 5, 6, 7
"""Of A1STATE: why the servo is open (TM-8004-C appendix B)."""

_ENABLE_DELAY_S = 0.2
"""Interlock:Close to servoed: a configured parameter on the real unit; clients leave 0.25 s (unverified)."""
_AT_REST_DEG_S = 0.02
"""Measured rate at which an orderly shutdown opens the servo."""
_HELD_DEG_S2 = 1e4
"""How fast an axis that something holds comes to rest (chosen)."""


class AclDrive:
    """Servo of the axis with its read-back, and its ways to shut down.

    `motion` is the true one, `axis` the measured one, `moves` the move to a position that is under way.
    """

    def __init__(self, world: TableWorld, errors: TableErrors, limits: AclLimits) -> None:
        self.clock = world.clock
        self.motion = world.table
        self.axis = TableAxis(world, errors)
        self.moves = PositionMoves(world, self.axis)
        self._limits = limits
        self.closing_at_s: float | None = None
        """When the servo closes, if it is about to."""
        self.aborting = False
        """Whether the axis is on its way to rest, to open the servo there."""
        self.locked = False
        """Whether the axis comes to rest against what holds it, until the servo opens."""
        self.unservo_bit = 0
        """Bit of A1STATE that says why the servo is open; 0 before it was closed first."""

    @property
    def servoed(self) -> bool:
        """Return True if the servo holds the axis."""
        return self.motion.servo_closed

    @property
    def servoed_or_closing(self) -> bool:
        """Return True if the servo holds the axis or is about to."""
        return self.servoed or self.closing_at_s is not None

    @property
    def follows(self) -> bool:
        """Return True if the axis takes demands."""
        return self.servoed and not self.aborting and not self.locked

    def at_rest(self) -> bool:
        """Return True if the measured rate is one of rest."""
        return abs(self.axis.rate_deg_s()) <= _AT_REST_DEG_S

    def close(self) -> None:
        """Close the servo after the delay of the power amplifier."""
        self.locked = False
        self.unservo_bit = 0
        self.closing_at_s = self.clock.now() + _ENABLE_DELAY_S

    def close_when_due(self) -> bool:
        """Close the servo if it is time; return True if it was."""
        if self.closing_at_s is None or self.clock.now() < self.closing_at_s:
            return False
        self.closing_at_s = None
        self.motion.close_servo()
        return True

    def abort(self, reason_bit: int) -> None:
        """Ramp to rest by the ABORT profile, then open the servo; `reason_bit` of A1STATE says why."""
        self.aborting = True
        self.moves.cancel()
        self.unservo_bit = reason_bit
        limits = self._limits.of("Abort")
        if not limits.inhibits:
            self.motion.demand_rate(0.0, *limits.ramps)

    def finish_abort(self) -> None:
        """Open the servo once the ABORT profile has brought the axis to rest."""
        if self.aborting and self.motion.profile_complete() and self.at_rest():
            self.aborting = False
            self.motion.open_servo()

    def abort_ends_s(self) -> float | None:
        """Return the end of the ABORT profile, or None."""
        if not self.aborting or self._limits.of("Abort").inhibits:
            return None
        return max(self.motion.complete_s, self.clock.now() + POLL_S)

    def drop(self) -> None:
        """Open the servo at once; the table coasts."""
        self.closing_at_s = None
        self._give_up()
        self.motion.open_servo()

    def lock(self) -> None:
        """Come to rest against an obstacle; the servo stays closed until then."""
        self._give_up()
        self.locked = True
        self.motion.demand_rate(0.0, _HELD_DEG_S2)

    def _give_up(self) -> None:
        self.aborting = False
        self.unservo_bit = HARDWARE_ABORT_BIT
        self.moves.cancel()
