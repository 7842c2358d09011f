"""The rate-table driver: limits, sign, proof of rest, and the order of things; the words are the dialect's."""

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Literal, TypeVar

from msgspec import Struct

from vcfbench import errors
from vcfbench.clock import Deadline, sleep
from vcfbench.drivers.conversation import OverWire
from vcfbench.drivers.rate_table.dialect import MIDDLE, TableDialect, TableSettings
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.drivers.replies import LINE_SPEED
from vcfbench.drivers.scpi_instrument import safely
from vcfbench.interfaces import Identity, SafeReport, UnprovedCommand

_T = TypeVar("_T")

_POLL_S = 0.1
_POLLS_AT_REST = 3
"""At rest means: so many readings in a row below the tolerance, and the same angle at the first and the last."""

_SERVO_S = 10.0
"""Longest time to close or open the servo, s."""

_WINDING_DEG_S = 30.0
"""Rate at which a table is turned back to the middle of its travel, at most."""

_LONGEST_WINDING_S = 45.0
"""No longer than a step may take unasked."""

_WIND_BACK = "turn the table to the middle of its travel"
_ARRIVED_DEG = 0.1

_STOP_ATTEMPTS = 3

_SHARES = (0.5, 0.5, 1.0)
"""The first attempt to prove rest has half of the time: on a good line the ramp is all that takes any."""

_BRAKING_S = 3.0
"""Within this time a table comes to rest that is told so blind, as far as its limits allow."""


class _Ramp(Struct, frozen=True):
    """Last command to the table: from at most one rate to another, deg/s, with an acceleration, since an instant."""

    from_deg_s: float
    to_deg_s: float
    acceleration_deg_s2: float
    since_s: float

    def fastest_deg_s(self, now_s: float) -> float:
        """Return the highest possible rate now, independent of read-backs."""
        passed_s = now_s - self.since_s
        return max(self.to_deg_s, self.from_deg_s - (self.acceleration_deg_s2 * passed_s if passed_s > 0.0 else 0.0))


class RateTableDriver(OverWire):
    """One axis of a rate table.

    Rates and angles are counter-clockwise positive seen from above, if `axis_sign` is chosen so: it is -1 for a table
    whose own sign is the other. A table goes on turning when nobody speaks to it, so an independent hard-wired
    emergency stop is part of every bench. `line` is the line to the table, `dialect` the language that it speaks.
    """

    def __init__(self, line: TableLine, dialect: TableDialect, settings: TableSettings) -> None:
        super().__init__(line)
        self.line = line
        self.dialect = dialect
        self._limits = settings
        self._sign = settings.axis_sign
        self._rest_tolerance_deg_s = settings.rest_tolerance_deg_s
        self._enabled = False
        self._claimed = False
        self._stop_acceleration_deg_s2 = settings.max_acceleration_deg_s2
        self._demanded_deg_s = 0.0
        self._fastest_deg_s = 0.0  # that it may be turning at, as far as is known
        self._acceleration_commanded = False
        self._ramp = _Ramp(settings.found_deg_s, settings.found_deg_s, math.inf, self.clock.now())
        try:
            self._ask(dialect.identify)
        except errors.DeadlineExceeded as silent:
            silent.hint = silent.hint or (LINE_SPEED if line.on_port else None)
            raise

    @property
    def own_time_s(self) -> float:
        """Time of one making safe for the table's language, beyond time-outs and ramps, s."""
        return self.dialect.own_time_s

    def identify(self) -> Identity:
        """Ask for the identity."""
        return self._ask(self.dialect.identify)

    def check_errors(self) -> None:
        """Raise InstrumentError with the table's refusals since last asked."""
        self._ask(self.dialect.check_errors)

    def enable(self) -> None:
        """Zero the demand, then close the servo; raises InterlockError when a fault forbids it or the table turns."""
        self._command(self.dialect.claim)
        self._claimed = True
        fault = self.fault()
        if fault is not None:
            raise self._interlock(fault, "remove the cause, then clear the fault")
        self._require_rest("it was found turning at {rate:g} deg/s, another program may be commanding it")
        self.dialect.set_limits(self.line, self._limits, self.line.deadline())
        self._command(self.dialect.close_servo)
        if not self._wait_for_servo(self.line.deadline(_SERVO_S), "closed"):
            raise self._interlock(self.fault() or "the servo did not close")
        self._ramp = _Ramp(0.0, 0.0, math.inf, self.clock.now())
        self._wind_back()
        self._enabled = True

    def _wind_back(self) -> None:
        """Turn a table that stands away from the middle of its travel back to it: a run goes both ways."""
        if self.dialect.travel_deg is None:
            return
        low_deg, high_deg = self.dialect.travel_deg
        middle_deg, angle_deg = (low_deg + high_deg) / 2.0, self._ask(self.dialect.angle_deg)
        away_deg, rate_deg_s = abs(angle_deg - middle_deg), min(_WINDING_DEG_S, self._limits.max_rate_deg_s)
        if away_deg <= MIDDLE * (high_deg - low_deg) / 2.0:
            return
        found = f"it stands at {self._sign * angle_deg:+.1f} deg, away from the middle of its travel"
        if (needed_s := away_deg / rate_deg_s) > _LONGEST_WINDING_S:
            raise self._interlock(f"{found}; at {rate_deg_s:g} deg/s winding back takes {needed_s:.0f} s", _WIND_BACK)
        arrival = Deadline.after(self.clock, needed_s + _SERVO_S)
        self.dialect.go_to(self.line, middle_deg, rate_deg_s, self.line.deadline())
        while abs(self._ask(self.dialect.angle_deg) - middle_deg) > _ARRIVED_DEG:
            if (fault := self.fault()) or arrival.expired():
                said = fault or f"it did not come there in {arrival.elapsed():.3g} s"
                raise self._interlock(f"{found}; told to wind back: {said}", _WIND_BACK)
            sleep(self.clock, _POLL_S)
        if not self._wait_for_rest(self.line.deadline(_SERVO_S)):
            raise self._interlock("wound back, it did not come to rest", _WIND_BACK)

    def disable(self) -> None:
        """Open the servo; InterlockError while the table turns, or was commanded to."""
        if self._ramp.to_deg_s:
            raise self._interlock(f"it was told {self._demanded_deg_s:g} deg/s, stop it before it is disabled")
        while self._ramp.fastest_deg_s(self.clock.now()) > 0.0:
            sleep(self.clock, _POLL_S)
        try:
            self._require_rest("it still turns at {rate:g} deg/s, stop it before it is disabled")
        except errors.InterlockError:  # a servo that settles may cross the tolerance more than once
            if not self._wait_for_rest(self.line.deadline(_SERVO_S)):
                raise
        self._enabled = False
        self._command(self.dialect.hold)
        self._command(self.dialect.open_servo)
        if not self._wait_for_servo(self.line.deadline(_SERVO_S), "open"):
            raise self._interlock("the servo did not open")

    def set_rate(self, rate_deg_s: float, acceleration_deg_s2: float) -> None:
        """Ramp to `rate_deg_s` with at most `acceleration_deg_s2`; `realised_deg_s` of it is sent.

        Returns at once, but for a table that must come to rest first (`esp` reversing, `ruya`): then when it has.
        """
        self._require_limits(rate_deg_s, acceleration_deg_s2)
        if not self._enabled:  # a demand now would be waiting for the servo, and be executed when it closes
            raise self._interlock("the servo is open, nothing was sent")
        self._stop_acceleration_deg_s2 = acceleration_deg_s2
        self._acceleration_commanded = True
        self._demand(rate_deg_s, acceleration_deg_s2, self.line.deadline())

    def _require_limits(self, rate_deg_s: float, acceleration_deg_s2: float) -> None:
        if not abs(rate_deg_s) <= self._limits.max_rate_deg_s:
            what = f"a rate of {rate_deg_s:g} deg/s is not within its limit of {self._limits.max_rate_deg_s:g} deg/s"
            raise errors.LimitError(f"{what}, nothing was sent", **self.line.where)
        highest = self._limits.max_acceleration_deg_s2
        # A table whose acceleration limit is zero could not be stopped any more.
        if not 0.0 < acceleration_deg_s2 <= highest or not math.isfinite(acceleration_deg_s2):
            what = f"an acceleration of {acceleration_deg_s2:g} deg/s2 is not within its limit of {highest:g} deg/s2"
            raise errors.LimitError(f"{what}, nothing was sent", **self.line.where)

    def _demand(self, rate_deg_s: float, acceleration_deg_s2: float, deadline: Deadline) -> None:
        self._demanded_deg_s = rate_deg_s
        self._fastest_deg_s = max(abs(rate_deg_s), self._fastest_deg_s)
        braking_deg_s2 = acceleration_deg_s2 if math.isfinite(acceleration_deg_s2) else self._stop_acceleration_deg_s2
        from_deg_s = max(abs(rate_deg_s), self._ramp.fastest_deg_s(self.clock.now()))
        self._ramp = _Ramp(from_deg_s, from_deg_s, braking_deg_s2, self.clock.now())  # it may hear this, or not
        with self.line.exchange(None, deadline):
            self.dialect.demand_rate(self.line, self._sign * rate_deg_s, acceleration_deg_s2, deadline)
        self._ramp = _Ramp(from_deg_s, abs(rate_deg_s), braking_deg_s2, self.clock.now())

    def realised_deg_s(self, rate_deg_s: float) -> float:
        """Return the rate that is sent for `rate_deg_s`, because the table takes rates in steps."""
        return self._sign * self.dialect.realised_deg_s(self._sign * rate_deg_s)

    @property
    def judges_rate_by(self) -> str:
        """Substitute for a flag of the table that it is at its rate."""
        return self.dialect.judges_rate_by

    def at_rate(self) -> bool:
        """Return True if the table says that the demanded rate is reached."""
        return self._ask(self.dialect.at_rate)

    def rate_deg_s(self) -> float:
        """Read back the rate; InterlockError at an end of the table's travel."""
        rate_deg_s = self._rate_deg_s(None)
        if self._demanded_deg_s and abs(rate_deg_s) < self._rest_tolerance_deg_s and self.dialect.travel_deg:
            end_deg = self.dialect.travel_deg[1 if self._sign * self._demanded_deg_s > 0.0 else 0]
            if abs(self._ask(self.dialect.angle_deg) - end_deg) < _ARRIVED_DEG:
                what = f"told to turn at {self._demanded_deg_s:+g} deg/s, it stands at the end of its travel"
                raise self._interlock(
                    f"{what}, {self._sign * end_deg:+.1f} deg", "lower rates or shorter windows need less travel"
                )
        return rate_deg_s

    def _rate_deg_s(self, within: Deadline | None) -> float:
        rate_deg_s = self._sign * self._ask(self.dialect.rate_deg_s, within) + 0.0
        self.line.note_read(f"{rate_deg_s:.4g} deg/s")
        self._fastest_deg_s = max(abs(rate_deg_s), abs(self._demanded_deg_s))
        return rate_deg_s

    def angle_deg(self) -> float:
        """Read back the angle."""
        return self._sign * self._ask(self.dialect.angle_deg) + 0.0

    def fault(self) -> str | None:
        """Return the latched fault or interlock in words, or None."""
        return self._ask(self.dialect.fault)

    def clear_fault(self) -> None:
        """Clear a latched fault; only when a person has seen to its cause."""
        self._command(self.dialect.clear_fault)

    def stop(self, acceleration_deg_s2: float) -> None:
        """Ramp to rest, servo kept. Repeated until the table has taken it, for rate 0 may be asked for twice."""
        self._require_limits(0.0, acceleration_deg_s2)
        self._stop_within(acceleration_deg_s2, self.line.deadline(_STOP_ATTEMPTS * self.line.timeout_s))

    def _stop_within(self, acceleration_deg_s2: float, deadline: Deadline) -> None:
        for left in range(_STOP_ATTEMPTS, 0, -1):
            try:
                self._demand(0.0, acceleration_deg_s2, Deadline.after(self.clock, deadline.remaining() / left))
            except (errors.DeadlineExceeded, errors.FramingError, errors.InstrumentError):
                if left == 1:
                    raise
            else:
                return

    def close(self) -> None:
        """Give remote control and the connection back."""
        if self._claimed and not self.line.closed:
            self._claimed = False
            with suppress(
                errors.TransportError, errors.InstrumentError
            ):  # a lockout that stays is taken off at the panel
                self._command(self.dialect.release)
        self.line.close()

    # Safe state

    def command_safe(self) -> UnprovedCommand:
        """Send the stop command, without waiting for an answer; return the last read-back."""
        sent = self.line.say_blind(self._stop_words(), self.dialect.gap_s)
        return self.line.unproved("to stop", sent=sent)

    def _stop_words(self) -> tuple[bytes, ...]:
        """Return the words that stop it; with more acceleration than it has, within the limit, where that is slow."""
        needed_deg_s2 = self._fastest_deg_s / _BRAKING_S
        quick = self._acceleration_commanded and needed_deg_s2 <= self._stop_acceleration_deg_s2
        if quick or self._fastest_deg_s < self._rest_tolerance_deg_s:
            return self.dialect.stop_words(None)
        fast_deg_s2 = max(needed_deg_s2, self._stop_acceleration_deg_s2)
        return self.dialect.stop_words(min(fast_deg_s2, self._limits.max_acceleration_deg_s2))

    def make_safe(self, deadline: Deadline) -> SafeReport:
        """Rate 0, wait for rest by read-back, then servo open and remote control given back.

        The words that stop it go out before anything is asked. When rest cannot be proved they go out once more, and
        after them the table's own shutdown, where that is one that brakes.
        """
        self._enabled = False
        report = safely(self, self._prove_at_rest, deadline, shares=_SHARES)
        shutdown = () if report.safe else self.dialect.shutdown_words()
        if shutdown:
            self.line.say_blind(shutdown, self.dialect.gap_s)
        return report

    def _prove_at_rest(self, deadline: Deadline) -> str:
        self.line.revive(deadline, self._stop_words(), self.dialect.gap_s)
        with suppress(
            errors.DeadlineExceeded, errors.FramingError, errors.InstrumentError
        ):  # it counts what is read back next
            acceleration_deg_s2 = self._braking_deg_s2(self._share(deadline, 0.5))
            self._stop_within(acceleration_deg_s2, self._share(deadline, 0.2))
        if not self._wait_for_rest(self._share(deadline, 0.8)):
            # End with the table's own orderly shutdown, when it does not obey: still not to be called safe
            self.line.say_blind(self.dialect.shutdown_words(), self.dialect.gap_s)
            raise errors.MeasurementError(
                f"rate and angle do not both show a table at rest, last rate {self.rate_deg_s():g} deg/s",
                hint="use the hard-wired emergency stop",
                **self.line.where,
            )
        self.dialect.hold(self.line, deadline)
        self.dialect.open_servo(self.line, deadline)
        if not self._wait_for_servo(deadline, "open"):
            raise errors.InstrumentError("at rest, but the servo did not open", **self.line.where)
        self.dialect.release(self.line, deadline)
        self._claimed = False
        return f"at rest (rate and way below {self._rest_tolerance_deg_s:g} deg/s), servo open"

    def _braking_deg_s2(self, deadline: Deadline) -> float:
        """Return the acceleration last used, or more, within the limit, when that would take longer than there is."""
        try:
            rate_deg_s = max(abs(self._rate_deg_s(deadline)), self._ramp.fastest_deg_s(self.clock.now()))
        except (errors.DeadlineExceeded, errors.FramingError):
            return self._stop_acceleration_deg_s2
        needed_deg_s2 = rate_deg_s / max(deadline.remaining(), _POLL_S)
        return min(max(self._stop_acceleration_deg_s2, needed_deg_s2), self._limits.max_acceleration_deg_s2)

    def _share(self, deadline: Deadline, part: float) -> Deadline:
        return Deadline.after(self.clock, deadline.remaining() * part)

    def _wait_for_rest(self, deadline: Deadline) -> bool:
        """Wait for rest by the rate and, for that may have failed, by the angle, the table's own flag and time.

        Nothing that is read counts before the ramp from what the table was told can be over.
        """
        quiet, allowed_deg_s, angle_deg, at_s = 0, self._rest_tolerance_deg_s, 0.0, 0.0
        while quiet < _POLLS_AT_REST:
            if deadline.expired():
                return False
            rate_deg_s, now_s = self._rate_deg_s(deadline), self.clock.now()
            quiet = quiet + 1 if max(abs(rate_deg_s), self._ramp.fastest_deg_s(now_s)) < allowed_deg_s else 0
            if quiet == 1:
                angle_deg, at_s = self._ask(self.dialect.angle_deg, deadline), now_s
            elif quiet == _POLLS_AT_REST:
                way_deg = (self._ask(self.dialect.angle_deg, deadline) - angle_deg + 180.0) % 360.0 - 180.0
                still = abs(way_deg) < allowed_deg_s * (now_s - at_s) and self._ask(self.dialect.stands, deadline)
                quiet = quiet if still else 0
            sleep(self.clock, _POLL_S)
        return True

    def _wait_for_servo(self, deadline: Deadline, wanted: Literal["closed", "open"]) -> bool:
        while self._ask(self.dialect.servo_closed, deadline) is not (wanted == "closed"):
            if deadline.remaining() <= _POLL_S:
                return False
            sleep(self.clock, _POLL_S)
        return True

    # Exchanges

    def _require_rest(self, words: str) -> None:
        for _ in range(_POLLS_AT_REST):
            rate_deg_s = self.rate_deg_s()
            if not abs(rate_deg_s) < self._rest_tolerance_deg_s:
                raise self._interlock(words.format(rate=rate_deg_s))

    def _interlock(self, what: str, hint: str | None = None) -> errors.InterlockError:
        return self._error(errors.InterlockError, what, hint=hint)

    def _command(self, command: Callable[[TableLine, Deadline], None]) -> None:
        """Give a command once: whether a lost acknowledgement means a lost command cannot be known."""
        deadline = self.line.deadline()
        with self.line.exchange(None, deadline):
            command(self.line, deadline)

    def _ask(self, question: Callable[[TableLine, Deadline], _T], within: Deadline | None = None) -> _T:
        """Ask, and once more if the answer was late or garbled."""
        with suppress(errors.DeadlineExceeded, errors.FramingError):
            return self._ask_once(question, within)
        return self._ask_once(question, within)

    def _ask_once(self, question: Callable[[TableLine, Deadline], _T], within: Deadline | None) -> _T:
        deadline = self.line.deadline() if within is None else within.within(self.line.timeout_s)
        with self.line.exchange(None, deadline):
            return question(self.line, deadline)
