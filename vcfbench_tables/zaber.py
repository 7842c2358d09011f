"""Zaber ASCII: rotary stages used as rate tables.

Grammar after zaber.serial and zaber-motion: request ``/device axis id command:LRC``, reply ``@dd a id OK|RJ BUSY|IDLE
flag data[:LRC]``. Unverified, general knowledge only: the factor 1.6384 of velocities and 1.6384e-4 of accelerations,
the setting ``vel`` for the present velocity, ``system.serial``.
"""

import math
import re
from collections.abc import Mapping
from types import MappingProxyType

from vcfbench.clock import Deadline
from vcfbench.drivers import replies
from vcfbench.drivers.rate_table.dialect import TableDialect, TableSettings
from vcfbench.drivers.rate_table.line import TableLine
from vcfbench.errors import ConfigError, DeadlineExceeded, FramingError, InstrumentError, LimitError
from vcfbench.interfaces import Identity
from vcfbench_tables.messages import Frame, checksum, frame_text
from vcfbench_tables.readings import SteadyRate, require_rest

_VELOCITY = 1.6384
"""Data units of velocity per microstep/s (unverified)."""
_ACCELERATION = 1.6384e-4
"""Data units of acceleration per microstep/s2 (unverified)."""

_REQUEST = Frame(start="/", checksum="lrc_hex", checksum_mark=":")
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
        "FB": "current or bus fault",
        "FC": "inrush current",
        "FD": "driver disabled by itself",
        "FE": "limit error",
        "FF": "critical system error",
        "FH": "hardware emergency stop",
        "FM": "motor too warm",
        "FN": "peripheral not supported",
        "FQ": "encoder",
        "FR": "overdrive",
        "FS": "stalled",
        "FV": "supply voltage out of range",
        "FZ": "peripheral inactive",
        "NC": "under manual control",
    }
)
"""Words of flags (zaber-motion, warning_flags.py). FD is told to firmware 7.10; later the cause is."""
_DRIVER_OFF = "FO"
"""Of the flags that begin with F the only one that is no fault; WR and WH (no reference) and NI (interrupted) forbid
nothing."""


_NUMBER = replies.NumberForm("a plain decimal number", re.compile(r"-?[0-9]+(?:\.[0-9]+)?"))
"""Data have no sign but minus, and no exponent."""


def frame_request(axis: int, number: int | None, command: str) -> bytes:
    """Return a request to the one device as sent; without a number no reply to it is taken for another's."""
    words = (f"1 {axis}", "" if number is None else f"{number:02d}", command)
    return frame_text(_REQUEST, " ".join(filter(None, words)), "\n")


def parse_reply(text: str) -> re.Match[str]:
    """Take a reply apart; raises FramingError when it is none or its checksum is wrong."""
    found = _REPLY.fullmatch(text)
    if found is None:
        raise FramingError(f"expected a reply of a Zaber device, got {text[:60]!r}")
    if (check := found["check"]) and check.upper().encode("ascii") != checksum("lrc_hex", text[1:-3].encode("ascii")):
        raise FramingError(f"a reply with a wrong checksum came, {text[:60]!r}")
    return found


class ZaberDialect(TableDialect):
    """One axis of a Zaber device; every request is numbered, so that a late reply is known as one.

    Settings that it writes (``accel``, ``maxspeed``) stay in the device. A disabled driver lets the stage coast; a
    serial port has one owner, and the knob shows in the warning flag NC. A refusal comes in the reply.

    Raises:
        ConfigError: the settings do not tell the stage's microsteps per degree.
    """

    typed_line_end = b"\n"

    def __init__(self, settings: TableSettings) -> None:
        if settings.steps_per_deg is None:
            raise ConfigError("rate_table.steps_per_deg: give the stage's microsteps per degree")
        self.steps_per_deg = settings.steps_per_deg
        self.axis = settings.axis
        self._number = -1
        self._steady = SteadyRate()

    @property
    def rate_quantum_deg_s(self) -> float:
        """One data unit of velocity: older firmware takes whole numbers only."""
        return 1.0 / (self.steps_per_deg * _VELOCITY)

    def identify(self, line: TableLine, deadline: Deadline) -> Identity:
        """Ask for device number, serial number and firmware version."""
        try:
            number = self._setting(line, "deviceid", deadline, axis=0)
        except InstrumentError:  # firmware 7 may know the new name only
            number = self._setting(line, "device.id", deadline, axis=0)
        try:
            serial = self._setting(line, "system.serial", deadline, axis=0)
        except InstrumentError:
            serial = ""
        return Identity("Zaber", f"device {number}", serial, self._setting(line, "version", deadline, axis=0))

    def may_come_unasked(self, data: bytes) -> bool:
        """Return True for a whole line (an alert or a late reply), False for half a line."""
        return data.endswith((b"\n", b"\r"))

    def stop_words(self, acceleration_deg_s2: float | None) -> tuple[bytes, ...]:
        """Send ``stop``; the line end before it ends a torn request. Without a number, so that no reply is mistaken."""
        stop = frame_request(self.axis, None, "stop")
        if acceleration_deg_s2 is None or not math.isfinite(acceleration_deg_s2):
            return (b"\n" + stop,)
        units = max(1, math.floor(acceleration_deg_s2 * self.steps_per_deg * _ACCELERATION))
        return b"\n" + stop, frame_request(self.axis, None, f"set accel {units}"), stop

    def set_limits(self, line: TableLine, limits: TableSettings, deadline: Deadline) -> None:
        """Set the highest speed of the axis."""
        if math.isfinite(limits.max_rate_deg_s):
            self._ask(line, f"set maxspeed {math.ceil(self._speed(limits.max_rate_deg_s))}", deadline)

    def close_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Stop, then enable the driver."""
        self._steady.demand(0.0)
        self._ask(line, "stop", deadline)
        self._ask(line, "driver enable", deadline)

    def hold(self, line: TableLine, deadline: Deadline) -> None:
        """Stop; a Zaber stage has no other mode to leave."""
        self._ask(line, "stop", deadline)

    def open_servo(self, line: TableLine, deadline: Deadline) -> None:
        """Disable the driver; refused (InterlockError) while the stage turns."""
        require_rest(line, self.rate_deg_s(line, deadline))
        self._ask(line, "driver disable", deadline)

    def demand_rate(self, line: TableLine, rate_deg_s: float, acceleration_deg_s2: float, deadline: Deadline) -> None:
        """Set the acceleration, then run at a velocity; rate 0 is ``stop``."""
        speed = round(self._speed(rate_deg_s))
        if math.isfinite(acceleration_deg_s2):
            if why := self.refusal(rate_deg_s, acceleration_deg_s2):
                raise LimitError(f"{why}, nothing was sent", **line.where)
            self._ask(line, f"set accel {self._table_acceleration(acceleration_deg_s2)}", deadline)
        self._steady.demand(speed * self.rate_quantum_deg_s)
        self._ask(line, f"move vel {speed}" if speed else "stop", deadline)

    def refusal(self, rate_deg_s: float, acceleration_deg_s2: float) -> str | None:
        """Return that an acceleration is below the least."""
        if not math.isfinite(acceleration_deg_s2) or self._table_acceleration(acceleration_deg_s2) >= 1:
            return None
        least = 1.0 / (self.steps_per_deg * _ACCELERATION)
        return (
            f"an acceleration of {acceleration_deg_s2:g} deg/s2 is below the {least:.3g} deg/s2 that the stage accepts"
        )

    def _table_acceleration(self, acceleration_deg_s2: float) -> int:
        """Return the whole number that is not above the demand; 0 would mean infinite."""
        return math.floor(acceleration_deg_s2 * self.steps_per_deg * _ACCELERATION)

    def _speed(self, rate_deg_s: float) -> float:
        return rate_deg_s * self.steps_per_deg * _VELOCITY

    def servo_closed(self, line: TableLine, deadline: Deadline) -> bool:
        """Query if the driver is enabled."""
        return replies.boolean(self._setting(line, "driver.enabled", deadline))

    def at_rate(self, line: TableLine, deadline: Deadline) -> bool:
        """Return True by readings of the velocity, because BUSY and IDLE only report motion."""
        return self._steady.reached(self.rate_deg_s(line, deadline))

    def rate_deg_s(self, line: TableLine, deadline: Deadline) -> float:
        """Read the velocity (the setting's name is unverified)."""
        return replies.number(self._setting(line, "vel", deadline), _NUMBER) * self.rate_quantum_deg_s

    def angle_deg(self, line: TableLine, deadline: Deadline) -> float:
        """Read the position, microsteps from the reference."""
        return replies.number(self._setting(line, "pos", deadline), _NUMBER) / self.steps_per_deg

    def fault(self, line: TableLine, deadline: Deadline) -> str | None:
        """Name the warnings that forbid motion."""
        flags = self._ask(line, "warnings", deadline).split()[1:]
        faults = [flag for flag in flags if flag in _FAULTS or (flag[:1] == "F" and flag != _DRIVER_OFF)]
        return ", ".join(f"{_FAULTS.get(flag, 'fault')} ({flag})" for flag in faults) or None

    def clear_fault(self, line: TableLine, deadline: Deadline) -> None:
        """Clear the warnings that can be cleared."""
        self._ask(line, "warnings clear", deadline)

    # Exchanges

    def _setting(self, line: TableLine, name: str, deadline: Deadline, *, axis: int | None = None) -> str:
        return self._ask(line, f"get {name}", deadline, axis=axis)

    def _ask(self, line: TableLine, command: str, deadline: Deadline, *, axis: int | None = None) -> str:
        """Put a request and return the data of its reply; raises InstrumentError when it is rejected."""
        self._number = (self._number + 1) % 100
        message = frame_request(self.axis if axis is None else axis, self._number, command)
        return line.exchanged(self, message, deadline, lambda limit: self._data(line, limit), shown=command)

    def _data(self, line: TableLine, deadline: Deadline) -> str:
        reply: re.Match[str] | None = None
        while reply is None or int(reply["id"] or -1) != self._number:  # others come late, from requests given up
            if reply is not None and deadline.expired():
                raise DeadlineExceeded("no answer that belongs to the request")
            text = line.take_text(deadline)
            reply = reply if text[0] in _UNASKED else parse_reply(text)
        data = reply["data"]
        if reply["verdict"] == "RJ":
            words = f"{data}: {_REASONS[data]}" if data in _REASONS else data
            raise InstrumentError(f"rejected ({words})", words=data, **line.where)
        return data
