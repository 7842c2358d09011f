"""SCPI error numbers, their standard words, and the error queue.

Source: SCPI-99 volume 2 chapter 21; 34401A User's Guide p. 173-182; E3631A User's Guide p. 139-146.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from types import MappingProxyType

ERROR_WORDS = MappingProxyType(
    {
        -101: "Invalid character",
        -102: "Syntax error",
        -103: "Invalid separator",
        -104: "Data type error",
        -105: "GET not allowed",
        -108: "Parameter not allowed",
        -109: "Missing parameter",
        -112: "Program mnemonic too long",
        -113: "Undefined header",
        -114: "Header suffix out of range",
        -120: "Numeric data error",
        -121: "Invalid character in number",
        -123: "Exponent too large",
        -124: "Too many digits",
        -128: "Numeric data not allowed",
        -130: "Suffix error",
        -131: "Invalid suffix",
        -134: "Suffix too long",
        -138: "Suffix not allowed",
        -141: "Invalid character data",
        -144: "Character data too long",
        -148: "Character data not allowed",
        -151: "Invalid string data",
        -158: "String data not allowed",
        -161: "Invalid block data",
        -168: "Block data not allowed",
        -171: "Invalid expression",
        -178: "Expression data not allowed",
        -211: "Trigger ignored",
        -213: "Init ignored",
        -214: "Trigger deadlock",
        -221: "Settings conflict",
        -222: "Data out of range",
        -223: "Too much data",
        -224: "Illegal parameter value",
        -230: "Data stale",
        -241: "Hardware missing",
        -252: "Missing media",
        -330: "Self-test failed",
        -350: "Queue overflow",
        -410: "Query INTERRUPTED",
        -420: "Query UNTERMINATED",
        -430: "Query DEADLOCKED",
        -440: "Query UNTERMINATED after indefinite response",
        511: "RS-232 framing error",
        512: "RS-232 overrun error",
        513: "RS-232 parity error",
        514: "Command allowed only with RS-232",
        521: "Input buffer overflow",
        522: "Output buffer overflow",
        531: "Insufficient memory",
        532: "Cannot achieve requested resolution",
        540: "Cannot use overload as math reference",
        550: "Command not allowed in local",
        702: "Cal secured",
        703: "Invalid secure code",
        704: "Secure code too long",
        705: "Cal aborted",
        706: "Cal value out of range",
        707: "Cal signal measurement out of range",
        708: "Cal signal frequency out of range",
        709: "No cal for this function or range",
        710: "Full scale correction out of range",
        720: "Cal DCV offset out of range",
        721: "Cal DCI offset out of range",
        722: "Cal RES offset out of range",
        723: "Cal FRES offset out of range",
        800: "P25V and N25V coupled by track system",
        801: "P25V and N25V coupled by trigger subsystem",
    }
)
"""Words of every error number used here; a model's dialect may word some differently."""


class ScpiError(Exception):
    """An instrument refuses; `number` is SCPI's, `words` replace the standard ones when given."""

    def __init__(self, number: int, words: str | None = None) -> None:
        super().__init__(number, words)
        self.number = number
        self.words = words


def esr_bit(number: int) -> int:
    """Return the bit of the standard event status register that error `number` sets (34401A guide p. 173)."""
    if -199 <= number <= -100:
        return 32
    if -299 <= number <= -200:
        return 16
    if -499 <= number <= -400:
        return 4
    return 8


class ErrorQueue:
    """First in, first out; on overflow the newest entry becomes -350 and later errors are lost.

    Args:
        depth: entries held.
        words: words that differ from :data:`ERROR_WORDS` on this model, by number.
        suffix: what follows the words of an error (its number, and when it happened), nothing on most models.
    """

    __slots__ = ("_depth", "_entries", "_suffix", "_words")

    def __init__(self, depth: int, words: dict[int, str], suffix: Callable[[int, float], str]) -> None:
        self._suffix = suffix
        self._depth = depth
        self._entries: deque[tuple[int, str]] = deque()
        self._words = {**ERROR_WORDS, **words}

    def __len__(self) -> int:
        return len(self._entries)

    def push(self, error: ScpiError, instant_s: float) -> None:
        """Append `error`, which has happened at `instant_s`."""
        if len(self._entries) >= self._depth:
            self._entries[-1] = (-350, self._words[-350] + self._suffix(-350, instant_s))
            return
        words = error.words if error.words is not None else self._words.get(error.number, "")
        self._entries.append((error.number, words + self._suffix(error.number, instant_s)))

    def pop(self) -> tuple[int, str]:
        """Take the oldest entry, `(0, "No error")` when there is none."""
        return self._entries.popleft() if self._entries else (0, "No error" + self._suffix(0, 0.0))

    def clear(self) -> None:
        """Forget everything."""
        self._entries.clear()
