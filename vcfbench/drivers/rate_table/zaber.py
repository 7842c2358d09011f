"""Zaber ASCII: rotary stages used as rate tables.

Grammar after zaber.serial and zaber-motion: request ``/device axis id command:LRC``, reply ``@dd a id OK|RJ BUSY|IDLE
flag data[:LRC]``. Unverified, general knowledge only: the factor 1.6384 of velocities and 1.6384e-4 of accelerations,
the setting ``vel`` for the present velocity, ``system.serial``.
"""

import math
import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Self

from msgspec import Struct

from vcfbench.clock import Deadline
from vcfbench.drivers import replies
from vcfbench.drivers.rate_table.dialect import AxisSettings, SteadyRate, TableDialect, TableLimits, require_rest
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.errors import ConfigError, DeadlineExceeded, FramingError, InstrumentError, LimitError
from vcfbench.interfaces import Identity

_VELOCITY = 1.6384
"""Data units of velocity per microstep/s (unverified)."""
_ACCELERATION = 1.6384e-4
"""Data units of acceleration per microstep/s2 (unverified)."""

_REPLY = re.compile(
    r"@(?P<device>\d{1,2}) (?P<axis>\d{1,2})(?: (?P<id>\d{1,2}))? (?P<verdict>OK|RJ) (?P<state>BUSY|IDLE) "
    r"(?P<warning>--|[A-Z0-9]{2}) (?P<data>[^:]*)(?::(?P<check>[0-9A-Fa-f]{2}))?"
)
_UNASKED = "#!"
"""First characters of info and alert messages, which may come at any time."""

_REASONS: Mapping[str, str] = MappingProxyType(
    {
        "AGAIN": "cannot be done right now",
        "BADAXIS": "no such axis",
        "BADCOMMAND": "unknown command or setting",
        "BADDATA": "value out of range or malformed",
        "BADMESSAGEID": "bad message id",
        "DEVICEONLY": "a command for the device, not for an axis",
        "DRIVERDISABLED": "the driver is disabled",
        "FULL": "no room left",
        "NOACCESS": "not allowed at this access level",
        "PARKED": "the axis is parked",
        "STATUSBUSY": "the axis moves",
    }
)
"""Words for the reasons of a rejection (BADCOMMAND, BADDATA seen in the clients' sources; the others unverified)."""

_FAULTS: Mapping[str, str] = MappingProxyType(
    {
        "FD": "driver disabled by itself",
        "FH": "hardware emergency stop",
        "FS": "stalled",
        "FE": "limit error",
        "NC": "under manual control",
    }
)
"""Warning flags that forbid motion. FO (driver switched off), WR and WH (no reference) and NI (interrupted) do not."""


_NUMBER = replies.NumberForm("a plain decimal number", re.compile(r"-?[0-9]+(?:\.[0-9]+)?"))
"""Data have no sign but minus, and no exponent."""


class ZaberReply(Struct, frozen=True):
    """A reply, taken apart: message number (None when it has none), verdict, state, warning flag, data."""

    number: int | None
    accepted: bool
    busy: bool
    warning: str
    data: str


def lrc(text: str) -> str:
    """Return the checksum of the text after the first character: two's complement of the byte sum, two hex digits."""
    return f"{-sum(text.encode('ascii')) % 256:02X}"


def frame_request(device: int, axis: int, number: int, command: str) -> bytes:
    """Return a request as sent, its number and checksum included."""
    body = f"{device} {axis} {number:02d}{' ' if command else ''}{command}"
    return f"/{body}:{lrc(body)}\n".encode("ascii")


def parse_reply(text: str) -> ZaberReply:
    """Take a reply apart; raises FramingError when it is none or its checksum is wrong."""
    found = _REPLY.fullmatch(text)
    if found is None:
        raise FramingError(f"expected a reply of a Zaber device, came {text[:60]!r}")
    if found["check"] is not None and found["check"].upper() != lrc(text[1:-3]):
        raise FramingError(f"a reply with a wrong checksum came, {text[:60]!r}")
    number = None if found["id"] is None else int(found["id"])
    return ZaberReply(number, found["verdict"] == "OK", found["state"] == "BUSY", found["warning"], found["data"])


class ZaberDialect(TableDialect):
    """One axis of a Zaber device; every request is numbered, so that a late reply is known as one.

    Settings that it writes (``accel``, ``maxspeed``) stay in the device. A disabled driver lets the stage coast; a
    serial port has one owner, and the knob shows in the warning flag NC. A refusal comes in the reply.
    """

    typed_line_end = b"\n"

    def __init__(self, steps_per_deg: float, axis: int = 1, device: int = 1) -> None:
        self.steps_per_deg = steps_per_deg
        self.axis = axis
        self.device = device
        self._number = -1
        self._steady = SteadyRate()

    @classmethod
    def for_axis(cls, settings: AxisSettings) -> Self:
        """Return the dialect of one axis; raises ConfigError without the stage's microsteps per degree."""
        if settings.steps_per_deg is None:
            raise ConfigError("rate_table.steps_per_deg: expected the stage's microsteps per degree, came nothing")
        return cls(settings.steps_per_deg, settings.axis)

    @property
    def rate_quantum_deg_s(self) -> float:
        """One data unit of velocity: older firmware takes whole numbers only."""
        return 1.0 / (self.steps_per_deg * _VELOCITY)

    def identify(self, line: TableLine, deadline: Deadline) -> Identity:
        """Ask for device number, serial number and firmware version."""
        number = self._setting(line, "deviceid", deadline, axis=0)
        try:
            serial = self._setting(line, "system.serial", deadline, axis=0)
        except InstrumentError:
            serial = ""
        return Identity("Zaber", f"device {number}", serial, self._setting(line, "version", deadline, axis=0))

    def resync(self, line: TableLine, deadline: Deadline) -> None:
        """Drop received bytes: a late reply carries another number."""
        line.take_unasked()
        line.dirty = False

    def stop_words(self, acceleration_deg_s2: float | None) -> tuple[bytes, ...]:
        """Send ``stop``; the line end before it ends a torn request. Without a number, so that no reply is mistaken."""
        stop = self._unnumbered("stop")
        if acceleration_deg_s2 is None or not math.isfinite(acceleration_deg_s2):
            return (b"\n" + stop,)
        units = max(1, math.floor(acceleration_deg_s2 * self.steps_per_deg * _ACCELERATION))
        return b"\n" + stop, self._unnumbered(f"set accel {units}"), stop

    def _unnumbered(self, command: str) -> bytes:
        body = f"{self.device} {self.axis} {command}"
        return f"/{body}:{lrc(body)}\n".encode("ascii")

    def set_limits(self, line: TableLine, limits: TableLimits, deadline: Deadline) -> None:
        """Set the highest speed of the axis."""
        if math.isfinite(limits.max_rate_deg_s):
            self._ask(line, f"set maxspeed {math.ceil(self._speed(limits.max_rate_deg_s))}", deadline)

    def close_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Stop, then enable the driver."""
        self._steady.demand(0.0)
        self._ask(line, "stop", deadline)
        self._ask(line, "driver enable", deadline)

    def hold(self, line: TableLine, deadline: Deadline) -> None:
        """Stop; there is no other mode."""
        self._ask(line, "stop", deadline)

    def open_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Disable the driver; refused (InterlockError) while the stage turns."""
        require_rest(line, self.rate_deg_s(line, deadline))
        self._ask(line, "driver disable", deadline)

    def demand_rate(self, line: TableLine, rate_deg_s: float, acceleration_deg_s2: float, deadline: Deadline) -> None:
        """Set the acceleration, then run at a velocity; rate 0 is ``stop``."""
        speed = round(self._speed(rate_deg_s))
        if math.isfinite(acceleration_deg_s2):
            # The whole number that is not above the demand; 0 would mean infinite
            units = math.floor(acceleration_deg_s2 * self.steps_per_deg * _ACCELERATION)
            if units < 1:
                least = 1.0 / (self.steps_per_deg * _ACCELERATION)
                raise LimitError(
                    f"an acceleration of {acceleration_deg_s2:g} deg/s2 is below the {least:.3g} deg/s2 that the stage "
                    "can be told, nothing was sent",
                    **line.where,
                )
            self._ask(line, f"set accel {units}", deadline)
        self._steady.demand(speed * self.rate_quantum_deg_s)
        self._ask(line, f"move vel {speed}" if speed else "stop", deadline)

    def _speed(self, rate_deg_s: float) -> float:
        return rate_deg_s * self.steps_per_deg * _VELOCITY

    def servo_closed(self, line: TableLine, deadline: Deadline) -> bool:
        """Ask whether the driver is enabled."""
        return replies.boolean(self._setting(line, "driver.enabled", deadline))

    def at_rate(self, line: TableLine, deadline: Deadline) -> bool:
        """Tell from readings of the velocity: BUSY and IDLE only say whether it turns."""
        return self._steady.reached(self.rate_deg_s(line, deadline))

    def rate_deg_s(self, line: TableLine, deadline: Deadline) -> float:
        """Read the velocity (the setting's name is unverified)."""
        return replies.number(self._setting(line, "vel", deadline), _NUMBER) * self.rate_quantum_deg_s

    def angle_deg(self, line: TableLine, deadline: Deadline) -> float:
        """Read the position, microsteps from the reference."""
        return replies.number(self._setting(line, "pos", deadline), _NUMBER) / self.steps_per_deg

    def fault(self, line: TableLine, deadline: Deadline) -> str | None:
        """Name the warnings that forbid motion."""
        flags = self._ask(line, "warnings", deadline).data.split()[1:]
        return ", ".join(f"{_FAULTS[flag]} ({flag})" for flag in flags if flag in _FAULTS) or None

    def clear_fault(self, line: TableLine, deadline: Deadline) -> None:
        """Clear the warnings that can be cleared."""
        self._ask(line, "warnings clear", deadline)

    # Exchanges

    def _setting(self, line: TableLine, name: str, deadline: Deadline, *, axis: int | None = None) -> str:
        return self._ask(line, f"get {name}", deadline, axis=axis).data

    def _ask(self, line: TableLine, command: str, deadline: Deadline, *, axis: int | None = None) -> ZaberReply:
        with line.exchange(command, deadline):
            self._number = (self._number + 1) % 100
            line.take_unasked()
            line.send(frame_request(self.device, self.axis if axis is None else axis, self._number, command), deadline)
            reply: ZaberReply | None = None
            while reply is None or reply.number != self._number:  # others come late, from requests given up
                if reply is not None and deadline.expired():
                    raise DeadlineExceeded("no answer that belongs to the request")
                text = replies.text(line.take_line(deadline))
                reply = reply if not text or text[0] in _UNASKED else parse_reply(text)
        if not reply.accepted:
            words = f"{reply.data}: {_REASONS[reply.data]}" if reply.data in _REASONS else reply.data
            raise InstrumentError(f"rejected ({words})", words=reply.data, command=command, **line.where)
        return reply
