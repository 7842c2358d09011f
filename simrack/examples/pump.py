"""A pump that takes binary frames: 0xAA, length, command, data, sum; a frame that is damaged has no answer."""

from __future__ import annotations

from simrack.own import OwnBox

_BEGIN, _ASK, _SET = 0xAA, 0x01, 0x02


class Pump(OwnBox):
    """Turns as fast as it is told."""

    ends = b""
    takes_s = 0.01
    speed_rpm = 0

    def frame_size(self, begun: bytes) -> int:
        """Return how long a frame is; what does not begin one is a stray byte."""
        if begun[0] != _BEGIN:
            return 1
        return begun[1] + 3 if len(begun) > 1 else 0

    def answer(self, message: bytes) -> bytes | None:
        """Answer a whole frame whose sum is right."""
        if len(message) < 4 or sum(message[:-1]) & 0xFF != message[-1]:
            return None
        if message[2] == _SET:
            self.speed_rpm = int.from_bytes(message[3:5], "big")
        body = bytes((_BEGIN, 3, _ASK)) + self.speed_rpm.to_bytes(2, "big")
        return body + bytes((sum(body) & 0xFF,))
