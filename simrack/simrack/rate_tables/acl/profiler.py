"""The profiler of the ACUTROL3000: how the axis follows the demand of the present mode within the limits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from simrack.rate_tables.acl.drive import POLL_S
from simrack.rate_tables.acl.limits import UNLIMITED_DEG
from simrack.rate_tables.acl.tracking import TrackTest
from simrack.s_curve import braking_deg

if TYPE_CHECKING:
    from simrack.rate_tables.acl.demand import Demand
    from simrack.rate_tables.acl.drive import AclDrive
    from simrack.rate_tables.acl.limits import AclLimits, AxisLimits
    from simrack.rate_tables.acl.oscillator import Oscillator

_RATE_MODES = frozenset({"Rate", "Arate"})
_TRACK_REACH_S = 0.1
"""In TRACK mode with a demanded rate the lag in position is made up within this time (chosen)."""


class Profiler:
    """Turns the demand into motion, mode by mode; what happens on the way comes by :meth:`advance`."""

    def __init__(self, drive: AclDrive, limits: AclLimits, demand: Demand, oscillator: Oscillator) -> None:
        self._drive = drive
        self._motion = drive.motion
        self._moves = drive.moves
        self._clock = drive.clock
        self._limits = limits
        self._demand = demand
        self._oscillator = oscillator
        self.mode = "Off"
        self.track_test = TrackTest(drive.clock)
        self.at_end = 0
        """1 or -1 at the high or low end of travel, to which the present demand has brought the axis; else 0."""

    @property
    def limits(self) -> AxisLimits:
        """Return the limits of the present mode."""
        return self._limits.of(self.mode)

    @property
    def regulates_rate(self) -> bool:
        """Tell whether the present mode follows a demanded rate."""
        return self.mode in _RATE_MODES

    # --- what the mode makes of the demand --------------------------------------------------------------------

    def select(self, mode: str) -> None:
        """Take another mode, which uses the demand that stands."""
        self.mode = mode
        self.track_test.stop()
        self.follow()

    def follow(self) -> None:
        """Let the profiler act on the demand of the present mode; a limit of zero inhibits every change."""
        limits = self.limits
        if not self._drive.follows or limits.inhibits:
            return
        self._moves.cancel()
        self._oscillator.cancel()
        if self.mode == "Synthesis":
            self._oscillator.start()
        elif self.mode == "Track":
            self._track(limits)
        elif self.mode == "Position" and limits.rate_deg_s > 0.0:
            self._go_to_target(limits)
        else:
            self._motion.demand_rate(self.profiled_rate_deg_s(), *limits.ramps)

    def leave_end(self) -> None:
        """Forget the end of travel, unless the demanded rate goes on towards it."""
        if self._demand.rate_deg_s * self.at_end <= 0.0:
            self.at_end = 0

    def profiled_rate_deg_s(self) -> float:
        """Return the demanded rate as far as mode, limits and ends of travel leave it, deg/s."""
        if not self.regulates_rate or self._demand.rate_deg_s * self.at_end > 0.0:
            return 0.0
        limit = self.limits.rate_deg_s
        return max(-limit, min(limit, self._drive.axis.in_steps_deg_s(self._demand.rate_deg_s)))

    def _track(self, limits: AxisLimits) -> None:
        """Go to the demanded state; the real profile is time-optimal, this one makes up its lag in a set time."""
        rate = self._demand.rate_deg_s
        if rate == 0.0 and limits.rate_deg_s > 0.0:
            self._go_to_target(limits)
            return
        wanted = rate + (self._nearest_target_deg() - self._drive.axis.angle_deg()) / _TRACK_REACH_S
        wanted = max(-limits.rate_deg_s, min(limits.rate_deg_s, wanted))
        self._motion.demand_rate(wanted, *limits.ramps)

    def _go_to_target(self, limits: AxisLimits) -> None:
        self._moves.start(self._nearest_target_deg(), limits.rate_deg_s, *limits.ramps)

    def _nearest_target_deg(self) -> float:
        """Return the accumulated angle nearest to the present one that shows the demanded position (shortest path)."""
        present = self._drive.axis.angle_deg()
        target = present + math.remainder(self._demand.position_deg - present, 360.0)
        return max(self._limits.overall.low_deg, min(self._limits.overall.high_deg, target))

    # --- what the profile is doing ----------------------------------------------------------------------------

    def goal_deg_s(self) -> float:
        """Return the rate that the profile goes to."""
        if self._drive.aborting:
            return 0.0
        return self._moves.goal_deg_s if self._moves.active else self.profiled_rate_deg_s()

    def ramp_direction(self) -> int:
        """Return 1 or -1 while the profiled rate grows or shrinks, else 0."""
        if not self._motion.servo_closed or self._motion.profile_complete():
            return 0
        return 1 if self.goal_deg_s() > self._motion.profile_rate_deg_s() else -1

    def acceleration_deg_s2(self) -> float:
        """Return the profiled acceleration now, deg/s2; the real controller estimates it from the encoder."""
        return self._motion.profile_acceleration_deg_s2() if self.ramp_direction() else 0.0

    # --- what happens on the way ------------------------------------------------------------------------------

    def advance(self) -> None:
        """Do what is due: brake for an end of travel, end TRACK mode, go on with a move, begin to oscillate."""
        self._stop_at_end()
        if self.track_test.missed():
            self.mode = "Off"  # TM-8004-C 4.7.7
            self.follow()
        self._moves.advance()
        self._oscillator.advance()

    def due_s(self) -> tuple[float | None, ...]:
        """Return when something is due, each None if it is not."""
        return self._moves.due_s, self._oscillator.due_s, self.track_test.due_s, self._end_due_s()

    def _stop_at_end(self) -> None:
        """Stop a run at the end of travel: the command processor does not go beyond a position limit."""
        if not self._motion.servo_closed or self._moves.active or not self.regulates_rate:
            return
        rate = self._motion.profile_rate_deg_s()
        if rate * self._motion.goal_deg_s() > 0.0 and self._left_deg(rate) <= 0.0:
            self.at_end = 1 if rate > 0.0 else -1
            self._motion.demand_rate(0.0, *self.limits.ramps)

    def _end_due_s(self) -> float | None:
        """Return when a rate run must begin to brake before an end of travel, if there is one."""
        rate = self._motion.profile_rate_deg_s() or self._motion.goal_deg_s() if self._motion.servo_closed else 0.0
        if not rate or math.isinf(left_deg := self._left_deg(rate)):
            return None
        fastest = max(abs(rate), abs(self.goal_deg_s()))
        # while it speeds up, what it needs to brake grows about as fast as it turns, twice that with a limited jerk
        return self._clock.now() + max(left_deg / fastest / (2.0 if math.isinf(self.limits.ramps[1]) else 4.0), POLL_S)

    def _left_deg(self, rate_deg_s: float) -> float:
        """Return the way left until the axis must brake for the end that it turns to, deg; inf where there is none."""
        end = self._limits.overall.high_deg if rate_deg_s > 0.0 else self._limits.overall.low_deg
        if abs(end) >= UNLIMITED_DEG or self.limits.inhibits:
            return math.inf
        most_deg_s2, jerk_deg_s3 = self.limits.ramps
        growing_deg_s2 = self._motion.profile_acceleration_deg_s2()
        braked_deg = braking_deg(rate_deg_s, growing_deg_s2, most_deg_s2=most_deg_s2, jerk_deg_s3=jerk_deg_s3)
        left_deg = (end - self._drive.axis.angle_deg()) * math.copysign(1.0, rate_deg_s)
        return left_deg - abs(braked_deg) - abs(rate_deg_s) * POLL_S
