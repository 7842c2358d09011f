"""A simulated RUYA single-axis table: fixed-width ASCII, status sent unasked, no reply to anything.

Recovered from a public client. Commands ``$1<...>``, status ``$1<alarm><state><sequence><angle>``, each CR LF. Rates
are a direction digit (0 clockwise, 1 counter-clockwise) and a magnitude; motion is taken up only in state 1. The
World's angle is counter-clockwise positive; the table's is taken to be clockwise positive, as the client negates.
Unverified: the period of the status, the sign of its angle, that ``st`` decelerates as the run accelerated, that the
angle of ``$12`` is turned from where the table stands, how fast the amplitude of a sine run (``$14``) grows, that the
status says 7 from when on it is reached, that a run is refused whose rate or acceleration is beyond the table's.
"""

from __future__ import annotations

import math
import re
from enum import IntEnum
from typing import ClassVar

from simrack.rate_tables.axis import ServoAxis, TableErrors, TableWorld
from simrack.rate_tables.line import SerialTiming
from simrack.rate_tables.stream import StatusStream, StreamErrors, Streaming

__all__ = ["RuyaTable", "StreamErrors"]

_TIMING = SerialTiming(baud=115200.0, processing_s=0.001)
_RATE = re.compile(r"3([01])(\d{4})(\d{4}\.\d{4})")
_POSITION = re.compile(r"2([01])(\d{4})(\d{4}\.\d{4})(\d{3}\.\d{4})")
_TURNS = re.compile(r"5([01])(\d{4})(\d{4}\.\d{4})(\d{3}\.\d{4})(\d{2})")
_SINE = re.compile(r"4(\d{3}\.\d{4})(\d{2}\.\d{3})")
_HOMING_DEG_S = 20.0
_MOST_DEG_S, _MOST_DEG_S2 = 1000.0, 1000.0


class _State(IntEnum):
    RELEASED = 0
    HELD = 1
    HOMING = 2
    POSITION_RUN = 3
    RATE_RUN = 4
    RATE_STEADY = 5
    SINE_RUN = 6
    SINE_STEADY = 7
    STOPPING = 8
    MULTI_TURN = 9


_MOVES = (_State.HOMING, _State.POSITION_RUN, _State.MULTI_TURN)


class RuyaTable(Streaming):
    """The table: released after switching on."""

    most_unread: ClassVar = 200

    def __init__(self, world: TableWorld, errors: TableErrors, *, axis: int = 1, noise_seed: int = 0) -> None:
        super().__init__(world, _TIMING, terminators=b"\r\n", longest=64)
        self._world = world
        self._axis = ServoAxis(world, errors, acceleration_deg_s2=10.0)
        self._start = f"${axis}"
        self._state = _State.RELEASED
        self._sequence = 0
        self._stream = StatusStream(world.clock, errors, noise_seed)

    def _noticed(self, _cause: str, /) -> None:
        self._state = _State.RELEASED

    def _follow(self) -> None:
        table = self._world.table
        if self._state is _State.RATE_RUN and table.profile_complete():
            self._state = _State.RATE_STEADY
        elif self._state is _State.SINE_RUN and table.profile_complete():
            self._state = _State.SINE_STEADY
        elif (self._state is _State.STOPPING and table.profile_complete()) or (
            self._state in _MOVES and not self._axis.moving()
        ):
            self._state = _State.HELD

    def _status(self) -> bytes:
        self._sequence = (self._sequence + 1) % 100
        angle_deg = math.fmod(-self._axis.position_deg(), 360.0)
        shown = angle_deg + 720.0 if angle_deg < 0.0 else angle_deg
        alarm = int(self._axis.barred or bool(self._axis.latched))
        return f"{self._start}{alarm}{self._state:d}{self._sequence:02d}{shown + 0.0:08.4f}\r\n".encode("ascii")

    def _answer(self, message: bytes) -> bytes | None:
        text = message.decode("latin-1")
        if text.startswith(self._start):
            self._do(text[len(self._start) :])
        return None

    def _do(self, command: str) -> None:
        if command == "mo=1":
            self._hold()
        elif command == "mo=0":
            self._state = _State.RELEASED
            self._axis.disable()
        elif command == "st":
            self._stop()
        elif self._state is _State.HELD:
            self._move(command)

    def _hold(self) -> None:
        if self._state is _State.RELEASED and self._axis.enable():
            self._state = _State.STOPPING

    def _stop(self) -> None:
        if self._state not in {_State.RELEASED, _State.HELD}:
            self._axis.run(0.0)
            self._state = _State.STOPPING

    def _move(self, command: str) -> None:
        if command == "1":
            self._state = _State.HOMING
            self._axis.go_to(0.0, _HOMING_DEG_S)
        elif found := _RATE.fullmatch(command):
            self._run(*found.groups())
        elif found := _SINE.fullmatch(command):
            self._oscillate(*found.groups())
        elif found := _TURNS.fullmatch(command):
            self._turn(_State.MULTI_TURN, *found.groups())
        elif found := _POSITION.fullmatch(command):
            self._turn(_State.POSITION_RUN, *found.groups())

    def _oscillate(self, amplitude: str, frequency: str) -> None:
        amplitude_deg, turning = float(amplitude), 2.0 * math.pi * float(frequency)
        slow = amplitude_deg * turning <= _MOST_DEG_S and amplitude_deg * turning**2 <= _MOST_DEG_S2
        if amplitude_deg > 0.0 and turning > 0.0 and slow:
            self._state = _State.SINE_RUN
            self._axis.oscillate(amplitude_deg, float(frequency))

    def _accelerate(self, digits: str) -> bool:
        if not 1 <= int(digits) <= 1000:
            return False
        self._axis.change_acceleration(float(digits))
        return True

    def _run(self, direction: str, acceleration: str, speed: str) -> None:
        if self._accelerate(acceleration):
            self._state = _State.RATE_RUN
            self._axis.run(_counter_clockwise(direction) * float(speed))

    def _turn(self, state: _State, direction: str, acceleration: str, *numbers: str) -> None:
        """Turn by an angle, and whole turns if any: `numbers` are speed, angle, turns."""
        speed, angle_deg, turns = (float(each) for each in (*numbers, "0")[:3])
        if speed > 0.0 and self._accelerate(acceleration):
            self._state = state
            turned_deg = _counter_clockwise(direction) * (angle_deg + 360.0 * turns)
            self._axis.go_to(self._axis.position_deg() + turned_deg, speed)


def _counter_clockwise(direction: str) -> float:
    return 1.0 if direction == "1" else -1.0
