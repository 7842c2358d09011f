"""The profiler of the ACUTROL3000: how the axis follows the demand of the present mode within the limits."""

from __future__ import annotations

import math

from msgspec import Struct

from simrack.clock import Clock
from simrack.handlers import Handlers
from simrack.motion import Swing
from simrack.rate_tables.acl import language
from simrack.rate_tables.acl.drive import POLL_S, AclDrive
from simrack.rate_tables.acl.limits import UNLIMITED_DEG, AclLimits, AxisLimits, Demand
from simrack.s_curve import braking_deg

_INTERVAL_MS = 1.0
"""Interval between demands, if none is given (TM-8004-C 4.7.7)."""


class TrackTest:
    """Waits for the next demand; the first one after the mode starts the test."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._interval_s = _INTERVAL_MS / 1e3
        self.due_s: float | None = None
        """When the next demand must have come; None is no test."""

    def select(self, interval_ms: float) -> None:
        """Take the interval between demands, ms; 0 is no test."""
        self._interval_s = interval_ms / 1e3

    def stop(self) -> None:
        """Wait for no demand."""
        self.due_s = None

    def take(self) -> None:
        """Note that a demand has come, and begin to wait for the next."""
        self.due_s = self._clock.now() + self._interval_s if self._interval_s else None

    def missed(self) -> bool:
        """Return True once if the due demand has not come."""
        if self.due_s is None or self._clock.now() < self.due_s:
            return False
        self.due_s = None
        return True


def interval_ms(text: str | None) -> float:
    """Return the interval that an argument of the mode names, ms; 0 is no test."""
    value = _INTERVAL_MS if text is None else language.number(text)
    if not 0.0 <= value <= 65535.0:
        raise language.Refusal(language.OUT_OF_RANGE)
    return value


_SETTLE_S = 0.15
"""Pause for the rate loop before a turning axis that was stopped begins to oscillate (chosen)."""


class OscillatorSetup(Struct, frozen=True):
    """Configure:Oscillator (TM-8004-C 4.2.19). Power-on values are chosen; a frequency is taken at once, not slewed."""

    enabled: str = "Disable"
    amplitude_slew: float = 10.0
    frequency_slew: float = 1.0
    amplitude_of: str = "Position"
    frequency_mode: str = "Linear"


class Oscillator:
    """Oscillates about the present angle, by the demanded magnitude, frequency and phase."""

    _QUERIES = Handlers()
    _COMMANDS = Handlers()

    def __init__(self, drive: AclDrive, limits: AclLimits, demand: Demand) -> None:
        self._drive = drive
        self._clock = drive.clock
        self._motion = drive.motion
        self._limits = limits
        self._demand = demand
        self._setup = OscillatorSetup()
        self._swing: Swing | None = None
        self._swing_s = 0.0
        self.due_s: float | None = None
        """When an axis that is being stopped begins to oscillate."""

    def start(self) -> None:
        """Oscillate about the present position; a turning axis is stopped first, for it would have no centre."""
        if not self._motion.oscillating and self._motion.profile_rate_deg_s():
            self._motion.demand_rate(0.0, *self._limits.of("Synthesis").ramps)
            self.due_s = self._motion.complete_s + _SETTLE_S
        else:
            self._begin()

    def cancel(self) -> None:
        """Do not begin to oscillate; an oscillation that has begun is not touched."""
        self.due_s = None

    def advance(self) -> None:
        """Begin to oscillate if it is time; an axis that was shut down meanwhile does not."""
        if self.due_s is not None and self._clock.now() >= self.due_s:
            self.due_s = None
            if self._drive.follows:
                self._begin()

    def peak_deg_s(self) -> float:
        """Return the largest rate of the oscillation, deg/s."""
        return 0.0 if self._swing is None else abs(self._swing.to_deg) * 2 * math.pi * self._swing.frequency_hz

    def _begin(self) -> None:
        now, going = self._clock.now(), self._swing if self._motion.oscillating else None
        magnitude, frequency, phase = self._demand.oscillator
        if not frequency:
            # Stand still: a sinusoid of frequency 0 is a constant
            self._swing = None
            self._motion.demand_rate(0.0, *self._limits.of("Synthesis").ramps)
            return
        slew = self._setup.amplitude_slew / self._per_degree(frequency)
        present, phase_rad = (0.0, math.radians(phase)) if going is None else _state_of(going, now - self._swing_s)
        # Demanded amplitude within the limits of SYNTHESIS mode, deg
        limits, turning = self._limits.of("Synthesis"), 2 * math.pi * frequency
        most = min(limits.rate_deg_s / turning, limits.acceleration_deg_s2 / turning**2)
        amplitude = max(-most, min(most, magnitude / self._per_degree(frequency)))
        self._swing = Swing(present, amplitude, slew, frequency, phase_rad)
        self._swing_s = now
        self._motion.oscillate(self._swing)

    def _per_degree(self, frequency_hz: float) -> float:
        """Return the share of a degree of amplitude in the regulated state."""
        power = {"Position": 0, "Rate": 1, "Acceleration": 2}[self._setup.amplitude_of]
        return (2 * math.pi * frequency_hz) ** power

    def commands(self) -> dict[str, language.Action]:
        """Return the commands that configure it."""
        return self._COMMANDS.bound(self)

    def queries(self) -> dict[str, language.Query]:
        """Return the queries of its configuration."""
        return self._QUERIES.bound(self)

    @_COMMANDS.of("Configure:Oscillator")
    def _configure(self, arguments: language.Arguments) -> None:
        axis, enabled, amplitude, frequency, amplitude_of, frequency_mode = language.counted(arguments, 6)
        language.check_axis((axis,))
        slews = language.number(amplitude), language.number(frequency)
        if min(slews) <= 0.0:
            raise language.Refusal(language.OUT_OF_RANGE)
        state = language.word(amplitude_of, ("Position", "Rate", "Acceleration"))
        mode = language.word(frequency_mode, ("Linear", "Logarithmic"))
        self._setup = OscillatorSetup(language.word(enabled, ("Enable", "Disable")), *slews, state, mode)

    @_QUERIES.of("Configure:Oscillator")
    def _ask_setup(self, arguments: language.Arguments) -> str:
        language.check_axis(arguments, everything=False)
        setup = self._setup
        slews = language.decimal(setup.amplitude_slew), language.decimal(setup.frequency_slew)
        return ",".join((setup.enabled, *slews, setup.amplitude_of, setup.frequency_mode))


def _state_of(swing: Swing, elapsed_s: float) -> tuple[float, float]:
    """Return amplitude (deg) and phase (rad) that an oscillation has reached."""
    share = min(elapsed_s / swing.lasts_s, 1.0) if swing.lasts_s else 1.0
    reached = swing.from_deg + share * (swing.to_deg - swing.from_deg)
    return reached, swing.phase_rad + 2 * math.pi * swing.frequency_hz * elapsed_s


_RATE_MODES = frozenset({"Rate", "Arate"})
_TRACK_REACH_S = 0.1
"""In TRACK mode with a demanded rate the lag in position is made up within this time (chosen)."""


class Profiler:
    """Turns the demand into motion, mode by mode; :meth:`advance` does everything due on the way."""

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
        """Return True if the present mode follows a demanded rate."""
        return self.mode in _RATE_MODES

    # --- what the mode makes of the demand --------------------------------------------------------------------

    def select(self, mode: str) -> None:
        """Select another mode, which uses the present demand."""
        self.mode = mode
        self.track_test.stop()
        self.follow()

    def follow(self) -> None:
        """Apply the demand of the present mode to the profiler; a limit of zero inhibits every change."""
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
        """Do everything due: brake for an end of travel, end TRACK mode, go on with a move, begin to oscillate."""
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
