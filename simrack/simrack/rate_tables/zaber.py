"""A simulated Zaber rotary stage that speaks Zaber ASCII: one device, one axis.

Grammar after zaber.serial and zaber-motion: request ``/device axis [id] command[:LRC]``, reply
``@dd a [id] OK|RJ BUSY|IDLE flag data[:LRC]``; the names of settings and the parking commands are those that
zaber-motion sends. Unverified: the factor 1.6384 of velocities, 1.6384e-4 of accelerations, the stage's microsteps and
limits, that an alert has the form ``!dd a IDLE flag``, that a message with an identifier above 99 is dropped, that NI
stays up until a movement begins at rest. The stage turns without end, so there is no ``move min`` and ``move max``;
there are no streams, triggers, sine movements, inputs and outputs, device storage and binary
packets. Nothing asks for a reference: the encoder is absolute.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, ClassVar

from msgspec import Struct

from simrack.handlers import Handlers
from simrack.motion import RateRipple
from simrack.rate_tables.axis import ServoAxis, TableErrors, TableWorld
from simrack.rate_tables.interlocked import Interlocked
from simrack.rate_tables.line import LineDevice, SerialTiming

if TYPE_CHECKING:
    import numpy as np

_TIMING = SerialTiming(baud=115200.0, processing_s=0.002)
_ALERT_POLL_S = 0.02
"""How often an axis whose end of motion is to be told is looked at, s."""
_POWER_UP_SPEED_DEG_S, _POWER_UP_ACCELERATION_DEG_S2 = 450.0, 100.0
_INDEX_DEG = 90.0
"""Distance of the positions of ``move index`` (chosen; on a device it is the setting motion.index.dist)."""
_MICROSTEPS = 64
"""Of a full step (the devices' default)."""
_LAST_IDENTIFIER = 99
_FASTEST = 2**31 - 1
"""The largest number that a setting of speed or acceleration takes (chosen; unverified)."""
_VELOCITY_UNIT = 1.6384
_ACCELERATION_UNIT = 1.6384e-4
_REQUEST = re.compile(r"/(?:\s*(\d+)(?:\s+(\d+)(?:\s+(\d+))?)?)?(?:\s*([A-Za-z].*?))?\s*")


class _Request(Struct, frozen=True):
    device: int
    axis: int
    identifier: str | None
    words: tuple[str, ...]


class StepperErrors(TableErrors, frozen=True):
    """Imperfections of a stage with a stepping motor; zero switches each off."""

    step_error_arcsec: float = 0.0
    """Angle error once in each full step, arcsec (chosen: 1 % of the rate, as such stages have; unverified)."""
    pull_out_deg_s: float = 0.0
    """Rate beyond which the motor loses its steps and stalls, deg/s; 0 never (chosen, unverified)."""

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> StepperErrors:
        """Return a specimen: the read-back as of any table, and the steps of its motor."""
        table_errors = {name: getattr(TableErrors.drawn(rng), name) for name in TableErrors.__struct_fields__}
        return cls(**table_errors, step_error_arcsec=0.2, pull_out_deg_s=600.0)


_FLAGS = {
    "FH": {"emergency_stop", "interlock", "door"},
    "FV": {"drive_fault"},
    "FR": {"over_rate"},
    "FQ": {"following_error"},
    "FS": {"stalled"},
    "FE": {"travel"},
}
"""Warning flags of firmware 7.11 and later, and what raises them; which of ours belongs to which is chosen."""


class _Rejected(Exception):
    """A command that the device refuses; the text is its reason."""


def longitudinal_redundancy(text: str) -> str:
    """Return the checksum of a message without its first character: two's complement of the byte sum, hexadecimal."""
    return f"{-sum(text.encode('latin-1')) & 0xFF:02X}"


class ZaberTable(Interlocked, LineDevice):
    """The stage; the drive is on after power-up."""

    _ACTIONS = Handlers()

    errors_class: ClassVar = StepperErrors

    def __init__(self, world: TableWorld, errors: StepperErrors, microsteps_per_deg: float = 640000.0 / 360.0) -> None:
        super().__init__(world, _TIMING, terminators=b"\r\n", longest=256)
        self._axis = ServoAxis(
            world, errors, acceleration_deg_s2=_POWER_UP_ACCELERATION_DEG_S2, pull_out_deg_s=errors.pull_out_deg_s
        )
        if errors.step_error_arcsec:
            steps_per_turn = round(microsteps_per_deg * 360.0 / _MICROSTEPS)
            world.table.add_ripple(RateRipple(errors.step_error_arcsec, steps_per_turn))
        self._axis.enable()
        self._per_deg = microsteps_per_deg
        self._settings = {
            "deviceid": 50081,
            "device.id": 50081,
            "system.serial": 12345,
            "serial": 12345,
            "version": 7.33,
            "system.axiscount": 1,
            "system.access": 1,
            "system.voltage": 48.0,
            "comm.address": 1,
            "comm.rs232.baud": 115200,
            "knob.enable": 0,
            "peripheralid": 0,
            "resolution": _MICROSTEPS,
        }
        self._was_moving = False
        self._interrupted = False
        """Whether the latest movement broke off another: NI. A stop is no movement."""
        self._alerts = False
        self._parked = False
        self._max_speed_deg_s = _POWER_UP_SPEED_DEG_S
        self._checksums = False
        self._actions: dict[str, Callable[[tuple[str, ...]], str]] = {
            **self._ACTIONS.bound(self),
            "stop": lambda _: self._stop(),
            "estop": lambda _: self._stop(),
            "home": lambda _: self._go_to(0.0),
        }

    def _advance(self) -> None:
        self._watch()
        moving = self._axis.moving()
        if self._alerts and self._was_moving and not moving:
            self._send(self._framed("!", f"01 1 IDLE {self._warning()}"))
        self._was_moving = moving

    def _own_events_s(self) -> tuple[float, ...]:
        watched = (self._clock.now() + _ALERT_POLL_S,) if self._alerts and self._was_moving else ()
        return (*self._axis.own_events_s(), *watched)

    def _answer(self, message: bytes) -> bytes | None:
        text = message.decode("latin-1")
        text, separator, given = text.partition(":")
        if separator and given.strip().upper() != longitudinal_redundancy(text[1:]):
            return None  # a damaged message is dropped without a word
        match = _REQUEST.fullmatch(text)
        if match is None:
            return None
        device, axis, identifier, command = match.groups()
        if identifier is not None and int(identifier) > _LAST_IDENTIFIER:
            return None
        request = _Request(int(device or 0), int(axis or 0), identifier, tuple((command or "").split()))
        return self._reply(request) if request.device in {0, 1} else None

    def _reply(self, request: _Request) -> bytes:
        try:
            flag, data = "OK", self._do(request)
        except _Rejected as reason:
            flag, data = "RJ", str(reason)
        number = f" {int(request.identifier):02d}" if request.identifier is not None else ""
        state = "BUSY" if self._axis.moving() else "IDLE"
        body = f"01 {request.axis}{number} {flag} {state} {self._warning()} {data}"
        return self._framed("@", body)

    def _framed(self, kind: str, body: str) -> bytes:
        check = f":{longitudinal_redundancy(body)}" if self._checksums else ""
        return f"{kind}{body}{check}\r\n".encode()

    def _do(self, request: _Request) -> str:
        if request.axis > 1:
            raise _Rejected("BADAXIS")
        if not request.words:
            return "0"
        action = self._actions.get(request.words[0])
        if action is None:
            raise _Rejected("BADCOMMAND")
        return action(request.words[1:])

    def _warning(self) -> str:
        return next(iter(self._flags()), "--")

    def _flags(self) -> list[str]:
        """Return the warning flags that are up, the gravest first."""
        axis = self._axis
        causes = {*axis.latched, *(axis.broken if axis.barred else ())}
        up = [flag for flag, why in _FLAGS.items() if causes & why]
        if not axis.enabled:
            up.append("FO")
        return [*up, "NI"] if self._interrupted else up

    @_ACTIONS.of("get")
    def _get(self, words: tuple[str, ...]) -> str:
        values = self._readings()
        if len(words) != 1 or words[0] not in values:
            raise _Rejected("BADCOMMAND")
        return values[words[0]]

    def _readings(self) -> dict[str, str]:
        return {
            **{name: str(value) for name, value in self._settings.items()},
            "pos": str(round(self._axis.position_deg() * self._per_deg)),
            "encoder.pos": str(round(self._axis.position_deg() * self._per_deg)),
            "vel": f"{self._axis.rate_deg_s() * self._per_deg * _VELOCITY_UNIT:.0f}",
            "accel": f"{self._axis.acceleration_deg_s2 * self._per_deg * _ACCELERATION_UNIT:.0f}",
            "maxspeed": f"{self._max_speed_deg_s * self._per_deg * _VELOCITY_UNIT:.0f}",
            "comm.checksum": str(int(self._checksums)),
            "comm.alert": str(int(self._alerts)),
            "parking.state": str(int(self._parked)),
            "driver.enabled": str(int(self._axis.enabled)),
            # the stage turns without end: a turn in microsteps is what a program may show as its travel
            "limit.min": "0",
            "limit.max": str(round(360.0 * self._per_deg)),
            "motion.busy": str(int(self._axis.moving())),
        }

    @_ACTIONS.of("set")
    def _set(self, words: tuple[str, ...]) -> str:
        if len(words) != 2 or words[0] not in {"accel", "maxspeed", "pos", "comm.checksum", "comm.alert"}:
            raise _Rejected("BADCOMMAND")
        value = _number(words[1])
        if words[0] == "pos":
            self._axis.set_zero(value / self._per_deg)
        elif words[0] == "comm.checksum":
            self._checksums = bool(value)
        elif words[0] == "comm.alert":
            self._alerts, self._was_moving = bool(value), self._axis.moving()
        else:
            if not 1 <= value <= _FASTEST:
                raise _Rejected("BADDATA")
            if words[0] == "accel":
                self._axis.change_acceleration(value / self._per_deg / _ACCELERATION_UNIT)
            else:
                self._max_speed_deg_s = value / self._per_deg / _VELOCITY_UNIT
        return "0"

    @_ACTIONS.of("move")
    def _move(self, words: tuple[str, ...]) -> str:
        if len(words) != 2 or words[0] not in {"vel", "abs", "rel", "index"}:
            raise _Rejected("BADCOMMAND")
        value = _number(words[1])
        if words[0] == "index":
            if not 1 <= value <= round(360.0 / _INDEX_DEG):
                raise _Rejected("BADDATA")
            return self._go_to((value - 1) * _INDEX_DEG)
        if words[0] != "vel":
            start = self._axis.position_deg() if words[0] == "rel" else 0.0
            return self._go_to(start + value / self._per_deg)
        rate = value / self._per_deg / _VELOCITY_UNIT
        self._require_driver()
        if abs(rate) > self._max_speed_deg_s:
            raise _Rejected("BADDATA")
        self._interrupted = self._axis.moving()
        self._axis.run(rate)
        return "0"

    def _go_to(self, position_deg: float) -> str:
        self._require_driver()
        self._interrupted = self._axis.moving()
        self._axis.go_to(position_deg, self._max_speed_deg_s)
        return "0"

    @_ACTIONS.of("help")
    def _help(self, words: tuple[str, ...]) -> str:
        """Return 0; the pages that a device sends behind it as ``#`` messages are not simulated."""
        del words
        return "0"

    @_ACTIONS.of("tools")
    def _tools(self, words: tuple[str, ...]) -> str:
        """Echo; park or unpark: a parked axis takes no movement. A moving one cannot be parked."""
        if words[:1] == ("echo",):
            return " ".join(words[1:]) or "0"
        if words not in {("parking", "park"), ("parking", "unpark")}:
            raise _Rejected("BADCOMMAND")
        if self._axis.moving():
            raise _Rejected("STATUSBUSY")
        self._parked = words[1] == "park"
        return "0"

    @_ACTIONS.of("system")
    def _system(self, words: tuple[str, ...]) -> str:
        """Take the settings of power-up; the axis comes to rest, and its drive is on."""
        if words != ("reset",):
            raise _Rejected("BADCOMMAND")
        self._stop()
        self._alerts = self._checksums = self._parked = self._interrupted = False
        self._max_speed_deg_s = _POWER_UP_SPEED_DEG_S
        self._axis.change_acceleration(_POWER_UP_ACCELERATION_DEG_S2)
        self._axis.enable()
        return "0"

    @_ACTIONS.of("renumber")
    def _renumber(self, words: tuple[str, ...]) -> str:
        """Take another address; here the first is the only one, for there is no chain."""
        if words not in {(), ("1",)}:
            raise _Rejected("BADDATA")
        return "0"

    def _require_driver(self) -> None:
        if self._parked:
            raise _Rejected("PARKED")
        if not self._axis.enabled:
            raise _Rejected("DRIVERDISABLED")
        self._axis.clear_latched()  # a stall is over with the next movement

    def _stop(self) -> str:
        if self._axis.enabled:
            self._axis.run(0.0)
        return "0"

    @_ACTIONS.of("driver")
    def _driver(self, words: tuple[str, ...]) -> str:
        if words not in {("enable",), ("disable",)}:
            raise _Rejected("BADCOMMAND")
        if words == ("disable",):
            self._axis.disable()
        elif not self._axis.enable():
            raise _Rejected("DRIVERDISABLED")
        return "0"

    @_ACTIONS.of("warnings")
    def _warnings(self, words: tuple[str, ...]) -> str:
        if words not in {(), ("clear",)}:
            raise _Rejected("BADCOMMAND")
        up = self._flags()
        if words:
            self._interrupted = False
        if words and self._axis.enabled:  # a driver that is off is a state, which clearing does not end
            self._axis.clear_latched()
        return " ".join([f"{len(up):02d}", *up])


def _number(text: str) -> float:
    if re.fullmatch(r"[+-]?\d+(\.\d*)?", text) is None:
        raise _Rejected("BADDATA")
    return float(text)
