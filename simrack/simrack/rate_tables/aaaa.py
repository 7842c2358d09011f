"""A simulated three-axis table that speaks cyclic binary frames which begin with ``AA AA``.

Recovered from a public client: a command is 21 bytes, three times control, position and speed, and the byte sum; a
status 23 bytes, five times position and status, and the byte sum. Positions are 24 bits, little-endian, sign and
magnitude, 1e-4 deg; speeds 16 bits, 0.01 deg/s. There is no rate run: a run is a move towards a position far away, and
the largest that can be said, +-838.8607 deg, is the end of travel. Unverified: the period of the status, that it comes
unasked, the acceleration, that positions do not wrap, whether ``AB`` and ``80`` heed position and speed (here not),
what raises the alarm bit (here an interlock, the over-rate trip, following error, an end of travel; ``AB`` ends it).
"""

from __future__ import annotations

from typing import ClassVar

from simrack.rate_tables.axis import ServoAxis, TableErrors, TableWorld
from simrack.rate_tables.line import SerialTiming
from simrack.rate_tables.stream import FrameDevice, StatusStream, StreamErrors, Streaming

__all__ = ["AaaaTable", "StreamErrors"]

_TIMING = SerialTiming(baud=38400.0, processing_s=0.001)
_HEADER = b"\xaa\xaa"
_CLOSE, _OPEN, _STOP, _MOVE = 0xAB, 0xAC, 0x80, 0x81
_CLOSED, _MOVING, _ALARM = 1, 2, 0x80
_PER_DEG = 1e4
_LARGEST = 0x7FFFFF
_TRAVEL_DEG = _LARGEST / _PER_DEG + 0.5
"""Where the switches of the ends of travel are taken to be: a little beyond the last position that can be said."""


class AaaaTable(Streaming, FrameDevice):
    """The table: loops open after switching on. One axis turns, the others stay at zero."""

    most_unread: ClassVar = 178

    def __init__(self, world: TableWorld, errors: TableErrors, *, axis: int = 1, noise_seed: int = 0) -> None:
        super().__init__(world, _TIMING, header=_HEADER, length=21)
        self._axis = ServoAxis(world, errors, acceleration_deg_s2=100.0, travel_deg=_TRAVEL_DEG)
        self._slot = axis - 1
        self._stream = StatusStream(world.clock, errors, noise_seed)

    def _intact(self, frame: bytes) -> bool:
        return sum(frame[:-1]) & 0xFF == frame[-1]

    def _status(self) -> bytes:
        flags = (_CLOSED if self._axis.enabled else 0) | (_MOVING if self._axis.moving() else 0)
        flags |= _ALARM if self._axis.latched or self._axis.barred else 0
        slots = [b"\0\0\0\0"] * 5
        slots[self._slot] = _sign_magnitude(self._axis.position_deg()) + bytes([flags])
        body = _HEADER + b"".join(slots)
        return body + bytes([sum(body) & 0xFF])

    def _answer(self, message: bytes) -> bytes | None:
        at = 2 + 6 * self._slot
        control, position, speed = message[at], message[at + 1 : at + 4], message[at + 4 : at + 6]
        if control == _CLOSE:
            self._axis.enable()
        elif control == _OPEN:
            self._axis.disable()
        elif control == _STOP and self._axis.enabled:
            self._axis.run(0.0)
        elif control == _MOVE and self._axis.enabled and any(speed):
            self._axis.go_to(_degrees(position), int.from_bytes(speed, "little") / 100.0)
        return None


def _sign_magnitude(angle_deg: float) -> bytes:
    magnitude = min(round(abs(angle_deg) * _PER_DEG), _LARGEST)
    return (magnitude | (0x800000 if angle_deg < 0.0 and magnitude else 0)).to_bytes(3, "little")


def _degrees(position: bytes) -> float:
    word = int.from_bytes(position, "little")
    return (-1.0 if word & 0x800000 else 1.0) * (word & _LARGEST) / _PER_DEG
