"""Protection of the ACUTROL3000's axis: interlocks, the over-rate trip, the tracking error.

Source: TM-9385A (interlocks), TM-8004-C appendix B (the bits that tell of them).
"""

from __future__ import annotations

import math

from simrack.rate_tables.acl.drive import POLL_S, SOFTWARE_ABORT_BIT, AclDrive
from simrack.rate_tables.acl.limits import AclLimits
from simrack.rate_tables.acl.profiler import Oscillator
from simrack.rate_tables.acl.status import AclStatus

_LAZY_POLL_S = 0.05
"""How often the measured rate is looked at when it decides what happens next, at constant rate."""
_SOFT_ABORT_BIT, _RATE_TRIP_BIT, _TRACKING_BIT = 0, 1, 2
_INTERLOCK_BITS = {"drive_fault": 6, "door": 7, "emergency_stop": 8, "interlock": 9}
"""Power-amplifier acknowledgement, inputs 1 and 2 (what they are wired to is the installation's), front panel."""


class Protection:
    """Interlocks and faults of the axis, and their effect on its drive.

    `wired` tells whether the table has interlocks.
    """

    def __init__(
        self, drive: AclDrive, oscillator: Oscillator, limits: AclLimits, status: AclStatus, *, wired: bool
    ) -> None:
        self._drive = drive
        self._motion = drive.motion
        self._clock = drive.clock
        self._oscillator = oscillator
        self._limits = limits
        self._status = status
        self._wired = wired
        self.jammed = False
        """Whether something holds the axis."""
        self.faults = 0
        """Bits of A1SWFLT, latched."""
        self._broken = 0
        self._latched = 0

    # --- as it stands -----------------------------------------------------------------------------------------

    @property
    def interlocks(self) -> int:
        """Return the bits of the interlocks that are broken or have shut the axis down."""
        return self._latched | self._broken

    @property
    def tripped(self) -> bool:
        """Return True if anything that is latched has shut the axis down."""
        return bool(self.faults or self._latched)

    @property
    def faulted(self) -> bool:
        """Return True if anything bars the servo from closing."""
        return bool(self.faults or self.interlocks)

    def broken(self) -> list[str]:
        """Return the interlocks that are broken now, by the names that they have on any table."""
        return [cause for cause, bit in _INTERLOCK_BITS.items() if self._broken >> bit & 1]

    def shut_down_by(self) -> list[str]:
        """Return the causes that have shut the axis down, by the names that they have on any table."""
        causes = [cause for cause, bit in _INTERLOCK_BITS.items() if self._latched >> bit & 1]
        trips = {_RATE_TRIP_BIT: "over_rate", _TRACKING_BIT: "following_error"}
        return causes + [cause for bit, cause in trips.items() if self.faults >> bit & 1]

    def set_interlock(self, cause: str | int, *, faulty: bool) -> None:
        """Break or restore an interlock: by the name that it has on any table, or bit 0...15 of ours.

        Raises:
            ValueError: there is none of that name.
        """
        if isinstance(cause, str) and cause not in _INTERLOCK_BITS:
            raise ValueError(f"an interlock is one of {', '.join(_INTERLOCK_BITS)}, not {cause!r}")
        mask = (1 << (_INTERLOCK_BITS[cause] if isinstance(cause, str) else cause)) if self._wired else 0
        self._broken = self._broken | mask if faulty else self._broken & ~mask

    def reset(self) -> None:
        """Forget the causes of a shutdown."""
        self.faults = 0
        self._latched = 0

    # --- what happens by itself -------------------------------------------------------------------------------

    def advance(self) -> None:
        """Shut the axis down if anything calls for it."""
        self._check_interlocks()
        self._check_rate()
        if not self._motion.servo_closed:
            return
        if self._lost():
            if self._drive.at_rest():
                self._motion.open_servo()
        elif self.jammed and self._motion.profile_rate_deg_s() and self._motion.goal_deg_s():
            self.faults |= 1 << _TRACKING_BIT
            self._status.fault("TRACKING ERROR FAULT")
            self._drive.lock()

    def due_s(self) -> tuple[float | None, ...]:
        """Return the next instants to check, each None without one."""
        return self._trip_due_s(), self._held_due_s()

    def _check_interlocks(self) -> None:
        if not self._broken or not self._drive.servoed_or_closing:  # tested only while servoed (TM-9385A)
            return
        self._latched |= self._broken
        self._drive.drop()
        self._status.fault("HARDWARE INTERLOCK")

    def _check_rate(self) -> None:
        if not self._motion.servo_closed or self.faults & (1 << _RATE_TRIP_BIT) or not self._may_trip():
            return
        if abs(self._drive.axis.rate_deg_s()) > self._limits.overall.trip_deg_s:
            self.faults |= 1 << _RATE_TRIP_BIT | 1 << _SOFT_ABORT_BIT
            self._status.fault("MAXIMUM RATE FAULT")
            self._drive.abort(SOFTWARE_ABORT_BIT)

    def _may_trip(self) -> bool:
        """True if the rate may be near the trip: no overshoot, ripple or flutter makes up for half of it."""
        far_deg_s, motion = 0.5 * self._limits.overall.trip_deg_s, self._motion
        return motion.oscillating or max(abs(motion.goal_deg_s()), abs(motion.profile_rate_deg_s())) > far_deg_s

    def _lost(self) -> bool:
        """Return True if the tracking error has tripped."""
        return bool(self.faults >> _TRACKING_BIT & 1)

    def _trip_due_s(self) -> float | None:
        """Return when the rate may trip: the crossing of a ramp beyond the trip, whoever commanded it, then polls."""
        trip = self._limits.overall.trip_deg_s
        if not self._motion.servo_closed or self.faults >> _RATE_TRIP_BIT & 1:
            return None
        if self._motion.oscillating and self._oscillator.peak_deg_s() > trip:
            return self._clock.now() + POLL_S
        beyond_s = self._motion.beyond_s(trip)
        return None if beyond_s == math.inf else max(beyond_s, self._clock.now() + POLL_S)

    def _held_due_s(self) -> float | None:
        if not self._motion.servo_closed or not (self.jammed or self._lost()):
            return None
        return self._clock.now() + _LAZY_POLL_S
