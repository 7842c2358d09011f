"""A simulated table that speaks 16-byte frames ``DD axis func data[12] check``, sum of all sixteen 0 mod 256.

Recovered from the client of a two-axis table: what that client sends and reads is known, the table's own behaviour is
not. Unverified: that polls are answered only after the connection was made, the deceleration of ``stop`` (here the
last one loaded), whether homing is needed before a rate run (here not), what the mode poll answers (here the run code).
Only one axis turns; frames for the other are taken without effect.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import ClassVar

from simrack.rate_tables.axis import ServoAxis, TableErrors, TableWorld
from simrack.rate_tables.interlocked import Interlocked
from simrack.rate_tables.line import SerialTiming
from simrack.rate_tables.stream import FrameDevice

__all__ = ["Dd16Table", "TableErrors"]

_TIMING = SerialTiming(baud=9600.0, processing_s=0.005)
_PER_DEG = 1e5
_LINK, _BOTH = 0, 3
_POSITION, _RATE, _RELATIVE = 1, 2, 3
_AT_POSITION, _AT_RATE, _STOPPED = 1, 2, 4
_HOMING_DEG_S = 20.0


class Dd16Table(Interlocked, FrameDevice):
    """The table: power off and no client connected after switching on."""

    errors_class: ClassVar = TableErrors

    def __init__(self, world: TableWorld, errors: TableErrors, *, axis: int = 1) -> None:
        super().__init__(world, _TIMING, header=b"\xdd", length=16)
        self._world = world
        self._axis = ServoAxis(world, errors, acceleration_deg_s2=100.0)
        self._number = axis
        self._connected = self._powered = False
        self._homing = 0
        self._running = 0
        self._loaded: dict[int, tuple[float, float, float]] = {}
        self._commands: dict[int, Callable[[bytes], None]] = {
            0x03: lambda _: self._power_on(),
            0x04: lambda _: self._power_off(),
            0x05: lambda _: self._close(),
            0x06: lambda _: self._idle(),
            0x07: lambda _: self._stop(),
            0x08: lambda _: self._stop(),
            0x09: lambda _: self._home(),
            0x0B: lambda data: self._load(_POSITION, *struct.unpack("<3i", data)),
            0x0C: lambda data: self._load(_RATE, 0, *struct.unpack("<2i", data[:8])),
            0x0E: lambda data: self._load(_RELATIVE, *struct.unpack("<3i", data)),
            0x10: self._run,
        }
        self._polls: dict[int, Callable[[], bytes]] = {
            0x13: self._position_and_rate,
            0x15: lambda: bytes([self._homing]),
            0x16: lambda: bytes([self._state()]),
            0x17: lambda: bytes([self._running]),
        }

    def _advance(self) -> None:
        self._watch()
        if self._homing == 1 and not self._axis.moving():
            self._homing = 2

    def _intact(self, frame: bytes) -> bool:
        return sum(frame) % 256 == 0

    def _answer(self, message: bytes) -> bytes | None:
        axis, function, data = message[1], message[2], message[3:15]
        if axis == _LINK:
            return self._link(function)
        if axis not in {self._number, _BOTH} or not self._connected:
            return None
        poll = self._polls.get(function)
        if poll is not None:
            return _frame(axis, function, poll())
        command = self._commands.get(function)
        if command is not None:
            command(data)
        return None

    def _noticed(self, _cause: str, /) -> None:
        self._running = 0  # the language has no word for what shut it down: it stands, its run is over

    def _link(self, function: int) -> bytes | None:
        if function == 0x55:
            self._connected = True
            return _frame(_LINK, 0x55, b"")
        if function == 0xAA:
            self._connected = False
        return None

    def _power_on(self) -> None:
        self._powered = True

    def _power_off(self) -> None:
        self._powered = False
        self._idle()

    def _close(self) -> None:
        if self._powered:
            self._axis.enable()

    def _idle(self) -> None:
        self._running = 0
        self._axis.disable()

    def _stop(self) -> None:
        self._running = 0
        if self._axis.enabled:
            self._axis.run(0.0)

    def _home(self) -> None:
        if self._axis.enabled and not self._axis.moving():
            self._homing = 1
            self._axis.go_to(0.0, _HOMING_DEG_S)

    def _load(self, mode: int, position: int, rate: int, acceleration: int) -> None:
        self._loaded[mode] = (position / _PER_DEG, rate / _PER_DEG, acceleration / _PER_DEG)

    def _run(self, data: bytes) -> None:
        """Run the loaded values; another kind of run must have been stopped before."""
        mode = data[0] if self._number == 1 else data[4]
        if mode not in self._loaded or not self._axis.enabled or (self._running not in {0, mode}):
            return
        position_deg, rate_deg_s, acceleration_deg_s2 = self._loaded[mode]
        if acceleration_deg_s2 <= 0.0:
            return
        self._running = mode
        self._axis.change_acceleration(acceleration_deg_s2)
        if mode == _RATE:
            self._axis.run(rate_deg_s)
        else:
            start_deg = self._axis.position_deg() if mode == _RELATIVE else 0.0
            self._axis.go_to(start_deg + position_deg, abs(rate_deg_s))

    def _position_and_rate(self) -> bytes:
        position = round((self._axis.position_deg() + 180.0) % 360.0 * _PER_DEG) - round(180.0 * _PER_DEG)
        return struct.pack("<2i", position, round(self._axis.rate_deg_s() * _PER_DEG))

    def _state(self) -> int:
        moving = self._axis.moving()
        if self._running == _RATE:
            return _AT_RATE if self._world.table.profile_complete() else 0
        done = 0 if moving else _STOPPED
        return done | (_AT_POSITION if self._running and not moving else 0)


def _frame(axis: int, function: int, data: bytes) -> bytes:
    body = bytes([0xDD, axis, function]) + data.ljust(12, b"\0")
    return body + bytes([-sum(body) % 256])
