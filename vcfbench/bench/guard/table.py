"""Guard of a rate table (ACL after manual TM-8004-C, section 4)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

from vcfbench.bench.guard.message import Unreadable, quantity, read_message
from vcfbench.bench.guard.rules import BeyondLimit, at_most
from vcfbench.models import find_language

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from vcfbench.bench.description import Limits, RateTableRole
    from vcfbench.bench.guard.message import MessagePart
    from vcfbench.bench.guard.rules import Ask, Rules

_NUMBER: Mapping[str, float] = MappingProxyType({"": 1.0})
_TRIP_MARGIN = 1.1
"""As the driver sets it: the trip lies a tenth above the highest rate."""

_HARMLESS = frozenset(
    {
        *("READ:POSITION", "READ:RATE", "READ:ACCELERATION", "READ:VECTOR", "MODE:OFF", "INTERLOCK:OPEN"),
        *("INTERLOCK:RESET", "UTILITY:LOCKOUT", "UTILITY:REMOTELOCKOUT", "STATUS:MSGCLR", "*CLS", "*SRE", "*ESE"),
    }
)
_RESTING_MODES = ("R", "RATE", "O", "OFF", "ABORT")


def table_rules(table: RateTableRole, limits: Limits) -> Rules:
    """Return the rules of the table's dialect."""
    if table.dialect == "acl":
        return AclRules(table.axis, limits)
    return reads_and_stops(table.dialect)


def reads_and_stops(dialect: str) -> ReadsAndStops:
    """Return the rules of a dialect whose motion commands cannot be judged.

    In those rates are in units of the stage, which the bench file does not know.
    """
    row = find_language(dialect)
    pattern = None if row is None else row.reads_and_stops
    return ReadsAndStops(None if pattern is None else re.compile(pattern, re.IGNORECASE))


@dataclass(slots=True)
class _State:
    """Motion of the table if it were let go, in its own sign."""

    rate_deg_s: float
    acceleration_deg_s2: float
    mode: str

    @classmethod
    def asked(cls, ask: Ask, axis: int) -> _State:
        """Ask the table."""
        return cls(
            float(ask(f":Demand:Rate? {axis}")),
            float(ask(f":Limit:Acceleration? R,{axis}").split(",")[-1]),
            ask(f":Mode? {axis}").strip().upper(),
        )


class AclRules:
    """Rates and accelerations within the bench's, on the bench's axis; only rate mode; full words only.

    ACL's short forms are not unique, and a position, a synthesis or another axis moves as it was set up elsewhere.
    """

    def __init__(self, axis: int, limits: Limits) -> None:
        self._axis = axis
        self._limits = limits
        self._rules: dict[str, Callable[[_State, MessagePart], None]] = {
            "DEMAND:RATE": self._demand,
            "MODE:RATE": self._rate_mode,
            "INTERLOCK:CLOSE": self._close,
            "LIMIT:RATE": self._limit_rate,
            "LIMIT:ACCELERATION": self._limit_acceleration,
            "LIMIT:JERK": self._limit_jerk,
            "LIMIT:VTRIP": self._limit_trip,
        }

    def judge(self, message: str, ask: Ask) -> None:
        """Raise Beyond or Unreadable when `message` may not be sent."""
        state: _State | None = None
        for part in read_message(message):
            if part.query or part.path in _HARMLESS:
                continue
            rule = self._rules.get(part.path)
            if rule is None:
                raise Unreadable(f"{part.path} is none of the commands that can be judged, written in full words")
            state = state or _State.asked(ask, self._axis)
            rule(state, part)

    def _demand(self, state: _State, part: MessagePart) -> None:
        part.require(2)
        self._own(part.arguments[0])
        state.rate_deg_s = quantity(part.arguments[1], _NUMBER)
        self._require_ready(state)

    def _rate_mode(self, state: _State, part: MessagePart) -> None:
        part.require(1)
        self._own(part.arguments[0])
        state.mode = "RATE"
        self._require_ready(state)

    def _close(self, state: _State, part: MessagePart) -> None:
        """Check the motion as soon as the servo is closed: a stale demand would be executed at once."""
        part.require(1)
        self._own(part.arguments[0])
        if state.mode not in _RESTING_MODES:
            raise Unreadable(f"the table is in mode {state.mode}, select rate mode first")
        self._require_ready(state)

    def _limit_rate(self, _state: _State, part: MessagePart) -> None:
        at_most("rate limit", self._limited(part), self._limits.of("max_rate_deg_s"), "deg/s")

    def _limit_acceleration(self, state: _State, part: MessagePart) -> None:
        value = self._limited(part)
        self._require_acceleration(value)
        if part.argument(0) in {"R", "RATE"}:
            state.acceleration_deg_s2 = value

    def _limit_jerk(self, _state: _State, part: MessagePart) -> None:
        if not self._limited(part) > 0.0:
            raise BeyondLimit("a table whose jerk is 0 could not be stopped")

    def _limit_trip(self, _state: _State, part: MessagePart) -> None:
        at_most("over-rate trip", self._limited(part), _TRIP_MARGIN * self._limits.of("max_rate_deg_s"), "deg/s")

    def _limited(self, part: MessagePart) -> float:
        """Return the value of ``mode,axis,value``."""
        part.require(3)
        self._own(part.arguments[1])
        return quantity(part.arguments[2], _NUMBER)

    def _own(self, axis: str) -> None:
        if axis != str(self._axis):
            raise BeyondLimit(f"axis {axis} is not the bench's, which is {self._axis}")

    def _require_ready(self, state: _State) -> None:
        at_most("rate", state.rate_deg_s, self._limits.of("max_rate_deg_s"), "deg/s")
        self._require_acceleration(state.acceleration_deg_s2)

    def _require_acceleration(self, value: float) -> None:
        at_most("acceleration limit of the table", value, self._limits.of("max_acceleration_deg_s2"), "deg/s^2")
        if not value > 0.0:  # ACL manual: it inhibits every change of rate, stopping included
            raise BeyondLimit("a table whose acceleration is 0 could not be stopped")


class ReadsAndStops:
    """Rules of a dialect whose motion commands cannot be judged: reading and stopping alone, or nothing at all."""

    def __init__(self, allowed: re.Pattern[str] | None) -> None:
        self._allowed = allowed

    def judge(self, message: str, ask: Ask) -> None:
        """Raise Unreadable when `message` may not be sent."""
        del ask
        text = message.strip()  # a carriage return within would end one message and begin another
        if self._allowed is None or not text.isprintable() or not self._allowed.fullmatch(text):
            raise Unreadable("of this table's dialect only what reads or stops is understood")
