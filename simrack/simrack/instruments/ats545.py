"""Simulated Temptronic ATS-545: its air is the air around the gyroscope.

Words after single pages of the TP04300 manual and what PyMeasure's driver of the ATS-545 sends and expects; written
apart from the driver. The air ramps, arrives, and is held; the gyroscope follows with its own time constant.
Unverified: all times, the errors of refused commands, the answer to *IDN?. The world knows air from -55 to 125 degC:
settings less than 3 K within that are refused here, though a real one goes further.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, ClassVar

from msgspec import Struct, field

from simrack import scpi
from simrack.adjustment import Adjustment
from simrack.scpi import Limits as Range
from simrack.world import World

if TYPE_CHECKING:
    import numpy as np

ROWS = scpi.Rows()

_FASTEST_K_S = 18.0
"""-55 to 125 degC in about 10 s, as the maker says of an unloaded nozzle."""
_ROOM_S = 60.0
"""Time constant with which the air around the device comes back to the room's when the flow is off; made up."""
_TICK_S = 1.0
_FINEST_K = 0.5
"""The air moves in steps no larger; the gyroscope's own time constant smooths them."""
_COLDEST_C, _HOTTEST_C = -52.0, 122.0
"""What the world knows, less what a specimen may be off."""
_NO_SENSOR_C = 500.0
_LOCAL = re.compile(rb"%(?:RM|GL|LL)\r?\n?")
"""Remote and local on RS-232; taken everywhere, because drivers send them everywhere."""


class AirStreamErrors(Struct, frozen=True):
    """Imperfections of one specimen."""

    air_offset_k: float
    """The air is warmer than it is read, K."""
    device_offset_k: float
    """The device's sensor reads too much, K."""

    @classmethod
    def none(cls) -> AirStreamErrors:
        """Return an ideal specimen."""
        return cls(0.0, 0.0)

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> AirStreamErrors:
        """Return a specimen whose 1 K of accuracy is two standard deviations."""
        return cls(*(float(each) for each in rng.normal(0.0, 0.5, 2)))


class _Setpoint(Struct):
    """One of the three of the operator's screen."""

    temperature_c: float
    window_k: float = 1.0
    soak_s: float = 30.0
    ramp_k_min: float = 9999.0


def _setpoints() -> list[_Setpoint]:
    return [_Setpoint(85.0), _Setpoint(25.0), _Setpoint(-40.0)]


class _Settings(Struct):
    """Settings beside the setpoints."""

    number: int = 1
    low_c: float = _COLDEST_C
    high_c: float = _HOTTEST_C
    numbers: dict[str, float] = field(
        default_factory=lambda: {"TTIM": 9999.0, "DUTC": 100.0, "ADMD": 50.0, "LRNM": 0.0, "CYCC": 1.0}
    )
    device_mode: bool = False
    sensor: int = 0


class TemptronicATS545Twin(scpi.ScpiTwin):
    """The stream of air.

    Args:
        world: whose air it heats and cools.
        errors: imperfections of this specimen.
        interface: "gpib" or "rs232".
        model: what it calls itself.
    """

    errors_class: ClassVar = AirStreamErrors

    def __init__(
        self, world: World, *, errors: AirStreamErrors, interface: str = "gpib", model: str = "ATS-545"
    ) -> None:
        self._world, self._errors, self._model = world, errors, model
        self._clock = world.clock
        self._room_c = self._air_c = world.ambient_c()
        self._moved_s = self._clock.now()
        self._inside_since_s: float | None = None
        self.flow = False
        self.head_down = True
        self.faults = 0
        self.settings, self.setpoints = _Settings(), _setpoints()
        kinds = {"gpib": scpi.GPIB, "rs232": scpi.RS232}
        self.engine = scpi.ScpiEngine(self, _TABLE, self._clock, dialect=_DIALECT, interface=kinds[interface])

    def write(self, data: bytes, *, end: bool = False) -> None:
        """Take bytes; changes between panel and remote control make no difference here."""
        rest = _LOCAL.sub(b"", data)
        if rest or not data:
            self.engine.write(rest, end=end)

    def identity(self) -> str:
        """Return the identity; of the real one only the maker's name is known."""
        return f"Temptronic,{self._model},0,1.0"

    def reset(self) -> None:
        """RSTO: the operator's screen, no flow, limits as they were made."""
        self.service()
        self.flow = False
        self.settings, self.setpoints = _Settings(), _setpoints()
        self._inside_since_s = None

    @property
    def setpoint(self) -> _Setpoint:
        """The setpoint in use."""
        return self.setpoints[self.settings.number]

    # --- the air ------------------------------------------------------------------------------------------

    def service(self) -> None:
        """Bring the air up to now; the world learns of it."""
        now = self._clock.now()
        passed, self._moved_s = now - self._moved_s, now
        if not self.flow and self._air_c == self._room_c:
            self._room_c = self._air_c = self._world.ambient_c()  # the room may have changed; it is not ours
        elif passed > 0.0:
            self._air_c = self._after(passed)
            true_c = self._air_c + (self._errors.air_offset_k if self.flow else 0.0)
            if abs(true_c - self._world.ambient_c()) > 1e-9:
                self._world.set_ambient_c(true_c)
        controlled_c = self._device_c() if self.settings.device_mode and self.settings.sensor else self._air_c
        if not self.flow or abs(controlled_c - self.setpoint.temperature_c) > self.setpoint.window_k:
            self._inside_since_s = None
        elif self._inside_since_s is None:
            self._inside_since_s = now

    def _after(self, passed_s: float) -> float:
        if not self.flow:
            left = (self._air_c - self._room_c) * math.exp(-passed_s / _ROOM_S)
            return self._room_c + (left if abs(left) > 0.01 else 0.0)
        most = passed_s * self._speed_k_s()
        to_go = self.setpoint.temperature_c - self._air_c
        return self._air_c + math.copysign(min(abs(to_go), most), to_go)

    def _speed_k_s(self) -> float:
        return min(_FASTEST_K_S, self.setpoint.ramp_k_min / 60.0) or _FASTEST_K_S

    def _device_c(self) -> float:
        return self._world.glance_temperature_c() + self._errors.device_offset_k

    def next_event_s(self) -> float | None:
        """Return when the air has gone a step further, or the device may have come within the window."""
        goal = self.setpoint.temperature_c if self.flow else self._room_c
        if abs(self._air_c - goal) > 1e-9:
            step_s = _FINEST_K / self._speed_k_s() if self.flow else _TICK_S
            return self._moved_s + min(step_s, _TICK_S)
        waiting = self.flow and self.settings.device_mode and self._inside_since_s is None
        return self._moved_s + _TICK_S if waiting else None

    # --- what is asked ------------------------------------------------------------------------------------

    def set_flow(self, value: float) -> None:
        """FLOW: with the head up nothing comes out."""
        self.service()
        if value and not self.head_down:
            raise scpi.ScpiError(-221)
        self.flow, self._inside_since_s = bool(value), None
        self.service()

    def select(self, number: float) -> None:
        """SETN."""
        self.service()
        self.settings.number, self._inside_since_s = int(number), None

    def set_temperature(self, temperature_c: float) -> None:
        """SETP: beyond the limits of the air it is refused."""
        self.service()
        if not self.settings.low_c <= temperature_c <= self.settings.high_c:
            raise scpi.ScpiError(-222)
        if not _COLDEST_C <= temperature_c <= _HOTTEST_C:
            raise scpi.ScpiError(-222)
        self.setpoint.temperature_c, self._inside_since_s = round(temperature_c, 1), None
        self.service()

    def condition(self) -> int:
        """TECR?: at temperature when it has been within the window for the soak time."""
        self.service()
        since = self._inside_since_s
        settled = since is not None and self._clock.now() - since >= self.setpoint.soak_s - 1e-9
        return 1 if settled else 2

    def auxiliary(self) -> int:
        """AUXC?: manual, ready, flow, sense mode, head."""
        device, up = self.settings.device_mode, not self.head_down
        return (1 << 8) | (1 << 6) | (self.flow << 5) | (device << 4) | (up << 2)

    def air_c(self) -> float:
        """TMPA?."""
        self.service()
        return self._air_c

    def sensed_c(self) -> float:
        """TMPD?: temperature of the sensor at the device; an overrange value without one."""
        return self._device_c() if self.settings.sensor else _NO_SENSOR_C

    def temperature_c(self) -> float:
        """TEMP?: the controlled temperature."""
        self.service()
        return self.sensed_c() if self.settings.device_mode else self._air_c

    def adjustments(self) -> Iterable[Adjustment]:
        """Return the adjustments by hand: the head, the sensor's plug is chosen by DSNS, faults."""

        def move(value: Any) -> None:
            self.head_down = bool(value)
            if not value:
                self.set_flow(0.0)

        def fail(value: Any) -> None:
            self.faults = int(value)

        yield Adjustment("head_down", "", "whether the head is on the device", lambda: self.head_down, move)
        yield Adjustment("faults", "", "bits of EROR?", lambda: self.faults, fail)


def _one_decimal(value: float) -> str:
    return f"{value:.1f}"


def _whole(value: float) -> str:
    return str(int(value))


def _of_setpoint(pattern: str, name: str, low: float, high: float) -> scpi.Command:
    def write(stream: TemptronicATS545Twin, value: float) -> None:
        stream.service()
        setattr(stream.setpoint, name, value)
        stream.service()

    def read(stream: TemptronicATS545Twin) -> float:
        return float(getattr(stream.setpoint, name))

    return scpi.Command(
        pattern, (_number(low, high),), do=write, query=read, query_parameters=(), reply=_one_decimal, reads=True
    )


def _of_settings(pattern: str, name: str, low: float, high: float) -> scpi.Command:
    def write(stream: TemptronicATS545Twin, value: float) -> None:
        kind = type(getattr(stream.settings, name))
        setattr(stream.settings, name, kind(value))

    def read(stream: TemptronicATS545Twin) -> float:
        return float(getattr(stream.settings, name))

    reply = _one_decimal if name.endswith("_c") else _whole
    return scpi.Command(
        pattern, (_number(low, high),), do=write, query=read, query_parameters=(), reply=reply, reads=True
    )


def _kept(pattern: str, low: float, high: float) -> scpi.Command:
    """Return a setting that is kept and changes nothing here."""

    def write(stream: TemptronicATS545Twin, value: float) -> None:
        stream.settings.numbers[pattern] = value

    def read(stream: TemptronicATS545Twin) -> float:
        return stream.settings.numbers[pattern]

    return scpi.Command(
        pattern, (_number(low, high),), do=write, query=read, query_parameters=(), reply=_whole, reads=True
    )


def _number(low: float, high: float) -> scpi.Number:
    return scpi.Number(limits=Range(low, high, low), named=False)


def _move_head(stream: TemptronicATS545Twin, value: float) -> None:
    stream.head_down = bool(value)
    if not value:
        stream.set_flow(0.0)


@ROWS.do("CLER")
def _clear_faults(stream: TemptronicATS545Twin) -> None:
    stream.faults = 0


def _asked(pattern: str, query: Callable[[TemptronicATS545Twin], float], reply: Callable[[float], str]) -> scpi.Command:
    return scpi.Command(pattern, query=query, reply=reply)


_TABLE = scpi.CommandTable(
    *ROWS,
    *(each for each in scpi.COMMON_COMMANDS if each.pattern != "SYSTem:ERRor"),
    scpi.Command("FLOW", (_number(0, 1),), do=TemptronicATS545Twin.set_flow),
    scpi.Command(
        "HEAD",
        (_number(0, 1),),
        do=_move_head,
        query=lambda stream: int(stream.head_down),
        query_parameters=(),
        reads=True,
    ),
    scpi.Command(
        "SETN",
        (_number(0, 2),),
        do=TemptronicATS545Twin.select,
        query=lambda stream: stream.settings.number,
        query_parameters=(),
        reads=True,
    ),
    scpi.Command(
        "SETP",
        (_number(-99.9, 225.0),),
        do=TemptronicATS545Twin.set_temperature,
        query=lambda stream: stream.setpoint.temperature_c,
        query_parameters=(),
        reply=_one_decimal,
        reads=True,
    ),
    _of_setpoint("WNDW", "window_k", 0.1, 9.9),
    _of_setpoint("SOAK", "soak_s", 0.0, 9999.0),
    _of_setpoint("RAMP", "ramp_k_min", 0.0, 9999.0),
    _of_settings("LLIM", "low_c", -99.0, 25.0),
    _of_settings("ULIM", "high_c", 25.0, 225.0),
    _of_settings("DUTM", "device_mode", 0, 1),
    _of_settings("DSNS", "sensor", 0, 4),
    _kept("TTIM", 0, 9999),
    _kept("DUTC", 20, 500),
    _kept("ADMD", 10, 300),
    _kept("LRNM", 0, 1),
    _kept("CYCC", 0, 9999),
    scpi.Command("RSTO", do=TemptronicATS545Twin.reset),
    _asked("TEMP", TemptronicATS545Twin.temperature_c, _one_decimal),
    _asked("TMPA", TemptronicATS545Twin.air_c, _one_decimal),
    _asked("TMPD", TemptronicATS545Twin.sensed_c, _one_decimal),
    _asked("SETD", lambda stream: stream.setpoint.temperature_c, _one_decimal),
    _asked("TECR", TemptronicATS545Twin.condition, _whole),
    _asked("TESR", TemptronicATS545Twin.condition, _whole),
    _asked("AUXC", TemptronicATS545Twin.auxiliary, _whole),
    _asked("EROR", lambda stream: stream.faults, _whole),
    _asked("FLWR", lambda stream: 18.0 if stream.flow else 0.0, _one_decimal),
    _asked("FLRL", lambda stream: 8.5 if stream.flow else 0.0, _one_decimal),
    _asked("WHAT", lambda _stream: 10, _whole),
)
_DIALECT = scpi.Dialect(integer=_whole)
