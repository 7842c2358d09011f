"""A table language in TOML: one axis, driven by a :class:`~vcfbench_tables.profile.Profile`.

What every dialect owes holds here whatever a profile says: nothing that is not finite or not within limits is sent,
stopping is repeated and questions are, commands are not; what does not parse is an error and never a zero; the servo
of a turning table is not opened.
"""

import math
import re
from collections.abc import Mapping
from contextlib import suppress
from functools import partial

from vcfbench import errors
from vcfbench.clock import Deadline, sleep
from vcfbench.drivers.rate_table.dialect import TableDialect
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.interfaces import Identity
from vcfbench_tables import messages
from vcfbench_tables.language import QUESTIONS, STREAM, Profile, Step
from vcfbench_tables.profile_replies import ProfileReplies, Received
from vcfbench_tables.readings import REST_DEG_S, SteadyRate, require_rest, turned_deg_s

Values = Mapping[str, messages.Value]
"""Values of the names in templates."""

_SPAN_S = 0.25
"""Over how long the angle is watched where a profile says nothing of the rate."""

_READINGS = 8
"""Rates that are read in one making safe, beside those that it waits for rest with."""


class ConfigurableDialect(TableDialect):
    """One axis of a table with the language of `profile`.

    Limits are checked before anything is sent. No profile tells the effect of opening the servo on a table that turns:
    it has no shutdown words.

    Raises:
        ConfigError: the profile knows no such axis.
    """

    def __init__(self, profile: Profile, axis: int = 1) -> None:
        if axis not in profile.units.axes:
            known = ", ".join(map(str, profile.units.axes))
            raise errors.ConfigError(f"rate_table.axis: expected one of {known} ({profile.title}), got {axis}")
        self.profile = profile
        self.axis = axis
        self._replies = ProfileReplies(profile, axis)
        self._steady = SteadyRate(profile.at_rate.tolerance_deg_s, profile.at_rate.relative, profile.at_rate.polls)
        self._servo = False
        self._sequence = 0

    @property
    def rate_quantum_deg_s(self) -> float:
        """Step of the commanded rate."""
        return self.profile.units.rate_quantum / self.profile.units.rate_per_deg

    # What the driver asks for

    def identify(self, line: TableLine, deadline: Deadline) -> Identity:
        """Ask for the identity; a table that has none must at least answer."""
        known = {"maker": self.profile.maker, "model": self.profile.title, "serial": "", "firmware": ""}
        if self.profile.commands.get("identify"):
            received = self.perform(line, "identify", deadline)
            known |= {key: text for key, text in (received.groups if received else {}).items() if key in known}
        else:
            self.angle_deg(line, deadline)
        return Identity(**known)

    def resync(self, line: TableLine, deadline: Deadline) -> None:
        """Drain the line, then ask something and drop all before its answer; a stream needs draining only."""
        line.take_unasked()
        if self.profile.stream is not None:
            return
        # Ask the first question that there is; anything that its answer does not push out is drained
        asked = next(filter(self.profile.commands.get, ("identify", "read_all", "read_pos")))
        for step in self.profile.commands[asked]:
            sleep(line.clock, self.gap_s)
            if step.send is not None:
                line.send(self._message(line, step.send, {}), deadline)
            if step.expect is not None:
                self._replies.await_reply(line, step.expect, deadline, out_of_order=True)
        line.drain(deadline)

    def may_come_unasked(self, data: bytes) -> bool:
        """Accept frames and whole lines: prompts, echoes, late replies; half a line would become half an answer."""
        return self.profile.binary or self.profile.stream is not None or data.endswith((b"\n", b"\r"))

    @property
    def gap_s(self) -> float:
        """Gap that the profile wants between two messages, s."""
        return self.profile.link.gap_s

    @property
    def own_time_s(self) -> float:
        """Time of one making safe for the profile's own pauses and the spans of its rate, s."""
        profile = self.profile
        names = ("set_accel", *profile.safety.stop, *profile.safety.stop, *profile.safety.close, "local")
        steps = [step for name in names for step in profile.commands.get(name, ())]
        pauses_s = sum((step.delay_s + profile.link.gap_s) * step.repeat for step in steps)
        waits_s = sum(step.timeout_s or 0.0 for step in steps if step.until is not None)
        return pauses_s + waits_s + _READINGS * self._span_s

    @property
    def _span_s(self) -> float:
        """Time over which the angle is watched for a rate."""
        rate = self.profile.fields.get("rate")
        if rate is None:
            return _SPAN_S
        return 0.0 if rate.differentiate is None else rate.span_s

    def stop_words(self, acceleration_deg_s2: float | None) -> tuple[bytes, ...]:
        """Return the profile's stop commands, after the end of a torn message; where it can, with an acceleration."""
        stop = self._words(self.profile.safety.stop, {})
        torn = messages.torn_end(self.profile.frame, self.profile.link.tx_end)
        before = (torn + stop[0], *stop[1:])
        if acceleration_deg_s2 is None or not self.profile.commands.get("set_accel"):
            return before
        commanded = self._table_acceleration(acceleration_deg_s2)
        if commanded is None:  # not one that this table can be told: it stops as it is
            return before
        return (*before, *self._words(("set_accel",), {"acc": commanded}), *stop)

    def _words(self, names: tuple[str, ...], values: Values) -> tuple[bytes, ...]:
        steps = [step for name in names for step in self.profile.commands.get(name, ()) for _ in range(step.repeat)]
        return tuple(self.message(step.send, values) for step in steps if step.send is not None)

    def claim(self, line: TableLine, deadline: Deadline) -> None:
        """Take remote control."""
        self.perform(line, "remote", deadline)

    def release(self, line: TableLine, deadline: Deadline) -> None:
        """Give remote control back."""
        self.perform(line, "local", deadline)

    def close_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Power on, stop any motion and check rest, close the servo.

        A table that refuses its stop, or whose rate is read from elsewhere, is found before it can turn.

        Raises:
            InterlockError: it does not read as at rest.
        """
        generous = self._generous(line, deadline, "power_on", *self.profile.safety.stop, "enable")
        self.perform(line, "power_on", generous)
        self._stop(line, generous)
        rate_deg_s = self.rate_deg_s(line, generous)
        if not abs(rate_deg_s) < REST_DEG_S:
            what = f"told to stop, it reads {rate_deg_s:g} deg/s; the servo was not closed"
            hint = "does it turn, or is fields.rate of its profile another number?"
            raise errors.InterlockError(what, hint=hint, **line.where)
        self.perform(line, "enable", generous)
        self._servo = True

    @property
    def travel_deg(self) -> tuple[float, float] | None:
        """Ends of travel that the profile names; None where it has no word to go to an angle."""
        units = self.profile.units
        if units.travel is None or not self.profile.commands.get("goto"):
            return None
        low, high = sorted(units.sign * end for end in units.travel)
        return low, high

    def go_to(self, line: TableLine, angle_deg: float, rate_deg_s: float, deadline: Deadline) -> None:
        """Begin to turn to an angle with the table's own acceleration."""
        position = {"position": self.profile.units.sign * angle_deg}
        self.perform(line, "goto", deadline, self.motion(line, rate_deg_s, math.inf) | position)

    def hold(self, line: TableLine, deadline: Deadline) -> None:
        """Stop; there is no other mode."""
        self._stop(line, deadline)

    def open_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Close down as the profile says; refused (InterlockError) while the table turns."""
        require_rest(line, self.rate_deg_s(line, deadline))
        generous = self._generous(line, deadline, *self.profile.safety.close)
        for name in self.profile.safety.close:
            self.perform(line, name, generous)
        self._servo = False

    def demand_rate(self, line: TableLine, rate_deg_s: float, acceleration_deg_s2: float, deadline: Deadline) -> None:
        """Load and start a rate run; rate 0 is the profile's stop.

        Where a table must be stopped before it takes another rate this returns when it was, beyond `deadline`.
        """
        values = self.motion(line, rate_deg_s, acceleration_deg_s2)
        if rate_deg_s == 0.0:
            try:
                self._set_acceleration(line, values, self._generous(line, deadline, "set_accel"))
            finally:  # whatever time that took: stopping is never what there is no time left for
                self._stop(line, line.deadline(max(deadline.remaining(), line.timeout_s)))
            return
        generous = self._generous(line, deadline, "set_accel", "load_rate", "start")
        for name in ("load_rate", "start"):
            self._require(line, name, generous)
        self._set_acceleration(line, values, generous)
        self._steady.demand(self.realised_deg_s(rate_deg_s))
        self.perform(line, "load_rate", generous, values)
        self.perform(line, "start", generous, values)

    def _set_acceleration(self, line: TableLine, values: Values, deadline: Deadline) -> None:
        if "acc" in values:
            self.perform(line, "set_accel", deadline, values)

    def _stop(self, line: TableLine, deadline: Deadline) -> None:
        self._steady.demand(0.0)
        generous = self._generous(line, deadline, *self.profile.safety.stop)
        for name in self.profile.safety.stop:
            self.perform(line, name, generous)

    def servo_closed(self, line: TableLine, deadline: Deadline) -> bool:
        """Return True if the servo is closed; by default its last commanded state."""
        return self.flag(line, "enabled", deadline) if "enabled" in self.profile.status else self._servo

    @property
    def judges_rate_by(self) -> str:
        """Readings by `[at_rate]` of a profile without such a flag."""
        wanted = "at_rate" if self._steady.demanded_deg_s else "stopped"
        return "" if wanted in self.profile.status else f"[at_rate] of its profile: {self._steady}"

    def at_rate(self, line: TableLine, deadline: Deadline) -> bool:
        """Return True by the table's own flag, else by readings of the rate."""
        wanted = "at_rate" if self._steady.demanded_deg_s else "stopped"
        if wanted in self.profile.status:
            return self.flag(line, wanted, deadline)
        return self._steady.reached(self.rate_deg_s(line, deadline))

    def stands(self, line: TableLine, deadline: Deadline) -> bool:
        """Return True by the profile's flag of rest or of motion, if it has one."""
        status = self.profile.status
        if "stopped" in status:
            return self.flag(line, "stopped", deadline)
        return "moving" not in status or not self.flag(line, "moving", deadline)

    def rate_deg_s(self, line: TableLine, deadline: Deadline) -> float:
        """Read the rate, or calculate it from the angle if the table does not report it."""
        if "rate" in self.profile.fields:
            return self.profile.units.sign * self.number(line, "rate", deadline)
        return self.profile.units.sign * self._slope(line, "position", _SPAN_S, deadline)

    def angle_deg(self, line: TableLine, deadline: Deadline) -> float:
        """Read the angle."""
        return self.profile.units.sign * self.number(line, "position", deadline)

    def fault(self, line: TableLine, deadline: Deadline) -> str | None:
        """Name the faults that the table reports; none of a table without such flags."""
        words = {"fault": "the table reports a fault", "estop": "the emergency stop is pressed"}
        known = {name: text for name, text in words.items() if name in self.profile.status}
        return ", ".join(text for name, text in known.items() if self.flag(line, name, deadline)) or None

    def clear_fault(self, line: TableLine, deadline: Deadline) -> None:
        """Clear a latched fault; raises InstrumentError when the language has no word for it."""
        if not self.profile.commands.get("clear_fault"):
            super().clear_fault(line, deadline)
        self.perform(line, "clear_fault", deadline)

    def check_errors(self, line: TableLine, deadline: Deadline) -> None:
        """Ask for refusals, where the language has a question for them."""
        profile, refusals, refused = self.profile, self.profile.refusals, []
        if refusals.query is None:
            return
        for _ in range(refusals.deepest):
            question = messages.frame_text(profile.frame, refusals.query, profile.link.tx_end)
            take = partial(messages.take_text, profile.received_frame, profile.link.rx_end, line)
            answer = line.exchanged(self, question, deadline, take)
            if re.fullmatch(refusals.good, answer):
                break
            refused.append(answer)
        if refused:
            raise errors.InstrumentError(f"refused with {'; then '.join(refused)}", words=refused[0], **line.where)

    # Readings

    def number(self, line: TableLine, name: str, deadline: Deadline) -> float:
        """Read a field of the profile, in deg or deg/s of the table's own sign."""
        spec = self.profile.fields[name]
        if spec.differentiate is not None:
            return self._slope(line, spec.differentiate, spec.span_s, deadline)
        assert spec.source is not None  # noqa: S101 - the profile was checked
        return self._replies.number(spec, self._fetch(line, spec.source, deadline))

    def _slope(self, line: TableLine, name: str, span_s: float, deadline: Deadline) -> float:
        generous = line.deadline(deadline.remaining() + span_s)
        first, started_s = self.number(line, name, generous), line.clock.now()
        sleep(line.clock, span_s)
        then = self.number(line, name, generous)
        duration_s = line.clock.now() - started_s
        endless = self.profile.fields[name].wrap == "continuous"
        return (then - first) / duration_s if endless else turned_deg_s(first, then, duration_s)

    def flag(self, line: TableLine, name: str, deadline: Deadline) -> bool:
        """Read a flag of the profile."""
        spec = self.profile.status[name]
        return self._replies.holds(spec, self._fetch(line, spec.source, deadline)) is not spec.negate

    def _fetch(self, line: TableLine, source: str, deadline: Deadline) -> Received:
        try:
            received = self._fresh(line, deadline) if source == STREAM else self.perform(line, source, deadline)
        except errors.DeadlineExceeded:
            if self.profile.safety.on_silence == "stop" and self._steady.demanded_deg_s:
                with suppress(errors.TransportError, errors.InstrumentError):  # nobody may be listening any more
                    self._stop(line, line.deadline())
            raise
        if received is None:
            raise errors.FramingError(f"{source} has no reply to read")
        return received

    def _fresh(self, line: TableLine, deadline: Deadline) -> Received:
        """Return the next status that comes: an earlier one may be old."""
        stream = self.profile.stream
        assert stream is not None  # noqa: S101 - the profile was checked
        within = deadline.within(stream.max_age_s)
        if within.expired():
            late = errors.DeadlineExceeded("there was no time left to wait for a status")
            raise line.locate(late, STREAM, deadline)
        with line.exchange(STREAM, within):
            try:
                line.take_unasked()
                return self._replies.await_reply(line, stream.reply, within, among_others=True)
            except errors.DeadlineExceeded as error:
                error.what = f"no status for {within.elapsed():.3g} s"
                raise

    # Commands

    def perform(self, line: TableLine, name: str, deadline: Deadline, values: Values | None = None) -> Received | None:
        """Do a command of the profile; one that it does not have is nothing to do. Returns the last reply expected."""
        self._require(line, name, deadline)
        received = None
        for step in self.profile.commands.get(name, ()):
            with line.exclusive():
                for _ in range(step.repeat):
                    answer = self._exchange(line, name, step, deadline, values or {})
                if step.delay_s:
                    sleep(line.clock, step.delay_s)
            if step.until is not None:
                within, sent_s = self._within(step, deadline), line.clock.now()
                while not self.flag(line, step.until, within):
                    if within.expired():
                        late = errors.DeadlineExceeded(f"the table did not come to the state {step.until!r}")
                        raise line.locate(late, step.send or step.until, within)
                    if step.resend_s is not None and line.clock.now() - sent_s >= step.resend_s:
                        self._once(line, name, step, within, values or {})
                        sent_s = line.clock.now()
                    sleep(line.clock, min(self.profile.safety.poll_s, within.remaining()))
            received = answer or received
        return received

    def _exchange(self, line: TableLine, name: str, step: Step, deadline: Deadline, values: Values) -> Received | None:
        for left in range(step.retry, -1, -1):
            share = Deadline.after(line.clock, deadline.remaining() / (left + 1))
            try:
                return self._once(line, name, step, share, values)
            except (errors.DeadlineExceeded, errors.FramingError):
                if not left:
                    raise
        return None

    def _once(self, line: TableLine, name: str, step: Step, deadline: Deadline, values: Values) -> Received | None:
        stopping = name in self.profile.safety.stop
        within = self._within(step, deadline)
        cut = self.profile.stream is not None and not self.profile.binary  # of a status that comes just now
        among_others, out_of_order = stopping or cut, stopping and line.dirty
        message = b"" if step.send is None else self._message(line, step.send, values)
        shown = message.hex(" ") if self.profile.binary else message.decode("latin-1").strip()

        def take(limit: Deadline) -> Received | None:
            # Take the echo that always comes; one that may come is known when it comes
            if message and self.profile.link.echo == "always":
                echoed = messages.take_text(messages.Frame(), self.profile.link.rx_end, line, limit)
                if echoed != message.decode("latin-1").strip():
                    raise errors.FramingError(f"expected the echo of the command, got {echoed[:60]!r}")
            return self._reply(line, step, limit, among_others=among_others, out_of_order=out_of_order)

        with line.exchange(shown or name, within):
            if message:
                received = line.exchanged(self, message, within, take, shown=shown, at_once=stopping)
            else:
                received = take(within)
            if name not in QUESTIONS or name == "home_status":
                self.check_errors(line, deadline)
        return received

    @staticmethod
    def _within(step: Step, deadline: Deadline) -> Deadline:
        return deadline if step.timeout_s is None else deadline.within(step.timeout_s)

    def _message(self, line: TableLine, template: str, values: Values) -> bytes:
        try:
            message = self.message(template, values)
        except ValueError as error:
            raise _unsent(line, f"{template!r} cannot be said ({error})") from error
        self._sequence += 1
        return message

    def message(self, template: str, values: Values | None = None) -> bytes:
        """Return the bytes that a template comes to, framed."""
        called = self.axis - 1 + self.profile.units.first_axis
        known: dict[str, messages.Value] = {"axis": called, "seq": self._sequence % 100}
        known |= {f"on_{slot}": int(slot == self.axis) for slot in range(1, 7)} | dict(values or {})
        return self.profile.message(template, known)

    def _reply(self, line: TableLine, step: Step, within: Deadline, **known: bool) -> Received | None:
        if step.expect is None:
            if self.profile.link.prompt is not None and not step.no_reply:
                self._replies.await_prompt(line, step, within)
            return None
        try:
            return self._replies.await_reply(line, step.expect, within, sent=step.send or "", **known)
        except errors.DeadlineExceeded:
            if step.optional_reply:
                return None
            raise

    # Waiting for states

    def _require(self, line: TableLine, name: str, deadline: Deadline) -> None:
        """Make sure that the requirement of a command is met: by the command that brings it about, if there is one."""
        need = self.profile.requires.get(name)
        if need is None or self.flag(line, need.flag, deadline):
            return
        if need.by is None:
            what = f"{name} needs the state {need.flag!r}, nothing was sent"
            raise errors.InterlockError(what, **line.where)
        within, sent_s = line.deadline(need.within_s), -math.inf
        while not within.expired():
            if line.clock.now() - sent_s >= need.resend_s:
                self.perform(line, need.by, within)
                sent_s = line.clock.now()
            sleep(line.clock, min(self.profile.safety.poll_s, within.remaining()))
            if self.flag(line, need.flag, line.deadline()):
                return
        late = errors.DeadlineExceeded(f"the table did not come to the state {need.flag!r}")
        raise line.locate(late, need.by, within)

    def _generous(self, line: TableLine, deadline: Deadline, *names: str) -> Deadline:
        """Return a deadline that leaves room for the pauses and waits that the profile itself prescribes."""
        steps = [step for name in names for step in self.profile.commands.get(name, ())]
        paused = sum((step.delay_s + self.profile.link.gap_s + (step.timeout_s or 0.0)) * step.repeat for step in steps)
        needs = [self.profile.requires[name].within_s for name in names if name in self.profile.requires]
        extra = paused + sum(needs)
        return line.deadline(deadline.remaining() + extra)

    # The table's own units

    def motion(self, line: TableLine, rate_deg_s: float, acceleration_deg_s2: float) -> dict[str, messages.Value]:
        """Return the values that templates of a motion command can name; raises LimitError before anything is sent."""
        if why := self.refusal(rate_deg_s, acceleration_deg_s2):
            raise _unsent(line, why)
        units, rate = self.profile.units, self._table_rate(rate_deg_s)
        values: dict[str, messages.Value] = {"rate": rate, "abs_rate": abs(rate)}
        values["dir"] = units.positive if rate >= 0.0 else units.negative
        values |= {f"rate_{slot}": rate if slot == self.axis else 0.0 for slot in range(1, 7)}
        commanded = None if acceleration_deg_s2 == math.inf else self._table_acceleration(acceleration_deg_s2)
        values |= {} if commanded is None else {"acc": commanded}
        if units.travel is not None:
            values["travel_end"] = units.travel[1 if rate >= 0.0 else 0]
        return values

    def refusal(self, rate_deg_s: float, acceleration_deg_s2: float) -> str | None:
        """Return the bound of the profile that a motion leaves."""
        units, safety = self.profile.units, self.profile.safety
        if not abs(rate_deg_s) <= safety.max_rate_deg_s:
            most = f"the {safety.max_rate_deg_s:g} deg/s of its profile"
            return f"a rate of {rate_deg_s:g} deg/s is beyond {most} (safety.max_rate_deg_s)"
        counts = "" if units.rate_per_deg == 1.0 else f", where {units.rate_per_deg:g} are 1 deg/s"
        if not abs(rate_deg_s) <= (bound := units.rate_max / units.rate_per_deg):
            most = f"the {bound:g} deg/s of its profile (units.rate_max = {units.rate_max:g}{counts})"
            return f"a rate of {rate_deg_s:g} deg/s is beyond {most}"
        if rate_deg_s and abs(self._table_rate(rate_deg_s)) < max(units.rate_min, units.rate_quantum * 0.5):
            key = "rate_min" if units.rate_min >= units.rate_quantum else "rate_quantum"
            least = getattr(units, key)
            said = f"{least / units.rate_per_deg:g} deg/s (units.{key} = {least:g}{counts})"
            return f"a rate of {rate_deg_s:g} deg/s is below the least of its profile, {said}"
        kept = not rate_deg_s or acceleration_deg_s2 == math.inf  # stopping is never refused: it stops as it is
        if kept or self._table_acceleration(acceleration_deg_s2) is not None:
            return None
        return f"an acceleration of {acceleration_deg_s2:g} deg/s2 is not one that its profile allows"

    def _table_rate(self, rate_deg_s: float) -> float:
        units = self.profile.units
        return units.sign * round(rate_deg_s * units.rate_per_deg / units.rate_quantum) * units.rate_quantum

    def _table_acceleration(self, acceleration_deg_s2: float) -> float | None:
        """Return the acceleration in the table's units, not above that demanded; None if it cannot be told that."""
        units, highest = self.profile.units, self.profile.safety.max_acceleration_deg_s2
        commanded = acceleration_deg_s2 * units.plain_per_deg * units.acceleration_factor
        if units.acceleration_quantum is not None and math.isfinite(commanded):
            commanded = math.floor(commanded / units.acceleration_quantum * (1.0 + 1e-12)) * units.acceleration_quantum
        bad = not 0.0 < acceleration_deg_s2 <= highest or not commanded > 0.0
        return None if bad or not units.acceleration_min <= commanded <= units.acceleration_max else commanded


def _unsent(line: TableLine, what: str) -> errors.LimitError:
    return errors.LimitError(f"{what}, nothing was sent", **line.where)
