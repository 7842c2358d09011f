"""A GPIB adapter with instruments behind it, in the language of Prologix: a device like any other, on any byte stream.

Sources: Prologix GPIB-USB Controller User Manual, 15 Sep 2009 and 19 Apr 2011, sections 6 to 8; the command reference
of AR488, which follows it. A line that begins with ``++`` is for the adapter, any other goes to the instrument at the
present address, its CR or LF replaced by what ``++eos`` says; ESC takes the next byte as it is. A read ends by EOI, by
a character, or ``++read_tmo_ms`` after the last character (or after it began), whatever the instrument is about.

Unverified: that ``++read_tmo_ms`` counts from the last character (from memory), the settings when it is switched on,
what answers a setting that is out of range (as an unknown word here), and that nothing answers a poll of an address
where nobody is. Not simulated: its device mode, in which it passes nothing on; secondary addresses are kept and lead
nowhere.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Mapping

from msgspec import Struct

from simrack.clock import Clock
from simrack.device import Device
from simrack.handlers import Handlers
from simrack.scpi import ScpiTwin

_ESCAPE, _ENDS = 27, b"\r\n"
_EOS = (b"\r\n", b"\r", b"\n", b"")
_ADDRESS = re.compile(r"([12]?\d|30)( (9[6-9]|1[01]\d|12[0-6]))?")
_UNKNOWN = "Unrecognized command"
_VERSION = "Prologix GPIB-ETHERNET Controller version 01.06.06.00"
_LIMITS: Mapping[str, tuple[int, int]] = {
    **dict.fromkeys(("auto", "eoi", "eot_enable", "mode", "savecfg", "lon"), (0, 1)),
    "eos": (0, 3),
    "eot_char": (0, 255),
    "read_tmo_ms": (1, 3000),
    "status": (0, 255),
}
_SWITCHED_ON = {**dict.fromkeys(_LIMITS, 0), "eoi": 1, "mode": 1, "read_tmo_ms": 1200, "savecfg": 1}
_WORDS = Handlers()


class _Reading(Struct):
    """A read under way: from whom, up to which character (None: END counts, if `by_end`), and when it is given up."""

    device: Device | None
    by_end: bool
    character: int | None
    until_s: float


class GpibAdapter:
    """A Prologix adapter and the instruments on its bus.

    Args:
        devices: the instruments by primary address.
        clock: bench time.
    """

    by_visa = True
    """Whether programs know it by a VISA resource name."""

    def __init__(self, devices: Mapping[int, Device], clock: Clock) -> None:
        self._devices, self._clock = devices, clock
        self._said = bytearray()
        self._escaped: list[bool] = []
        self._taken = False
        """Whether the byte before was ESC."""
        self._lines: deque[tuple[bytes, bool]] = deque()
        self._output = bytearray()
        self._reading: _Reading | None = None
        self._settings, self._address = dict(_SWITCHED_ON), str(min(devices, default=0))

    # --- the seam: simrack.device.Device ------------------------------------------------------------------

    def write(self, data: bytes, *, end: bool = False) -> None:
        """Take bytes from the host; a line acts when its end comes, after what is under way."""
        del end
        for byte in data:
            if not self._taken and byte == _ESCAPE:
                self._taken = True
            elif not self._taken and byte in _ENDS:
                if self._said:
                    self._lines.append((bytes(self._said), not any(self._escaped[:2])))
                self._said.clear()
                self._escaped.clear()
            else:
                self._said.append(byte)
                self._escaped.append(self._taken)
                self._taken = False
        self._advance()

    def read(self, limit: int) -> tuple[bytes, bool]:
        """Return at most `limit` bytes for the host; a byte stream has no END."""
        self._advance()
        part = bytes(self._output[:limit])
        del self._output[:limit]
        return part, bool(part) and not self._output and self._reading is None

    def wake_at(self) -> float | None:
        """Return when the read under way may go on, or is given up."""
        self._advance()
        if self._reading is None:
            return None
        wake_s = None if self._reading.device is None else self._reading.device.wake_at()
        later = wake_s is not None and self._clock.now() < wake_s < self._reading.until_s
        return wake_s if later else self._reading.until_s

    def clear(self) -> None:
        """Forget what is under way; settings stay."""
        self._said.clear()
        self._escaped.clear()
        self._lines.clear()
        self._output.clear()
        self._reading = None

    def status_byte(self) -> int:
        """Return 0: the adapter itself is not polled."""
        return 0

    def trigger(self) -> None:
        """Do nothing: the adapter itself is not triggered."""

    # --- the bus ------------------------------------------------------------------------------------------

    @property
    def _device(self) -> Device | None:
        """The instrument at the present address."""
        return self._at(self._address)

    def _at(self, address: str) -> Device | None:
        return self._devices.get(int(address)) if address.isdigit() else None

    def _advance(self) -> None:
        while True:
            if self._reading is not None and not self._read_on(self._reading):
                return
            self._reading = None
            if not self._lines:
                return
            line, plain = self._lines.popleft()
            if plain and line.startswith(b"++"):
                self._command(line[2:].decode("latin-1"))
            elif self._settings["mode"] and self._device is not None:
                self._device.write(line + _EOS[self._settings["eos"]], end=bool(self._settings["eoi"]))
                if self._settings["auto"]:
                    self._begin_reading(by_end=True)

    def _begin_reading(self, *, by_end: bool, character: int | None = None) -> None:
        until_s = self._clock.now() + self._settings["read_tmo_ms"] / 1e3
        self._reading = _Reading(self._device, by_end, character, until_s)

    def _read_on(self, reading: _Reading) -> bool:
        """Pass on what has come; tell whether the read is over."""
        while reading.device is not None:
            part, end = reading.device.read(1 if reading.character is not None else 1 << 16)
            if not part:
                break
            self._output += part
            reading.until_s = self._clock.now() + self._settings["read_tmo_ms"] / 1e3
            if end and self._settings["eot_enable"]:
                self._output.append(self._settings["eot_char"])
            if (end and reading.by_end) or part[-1] == reading.character:
                return True
        return self._clock.now() >= reading.until_s

    # --- its own words ------------------------------------------------------------------------------------

    def _command(self, line: str) -> None:
        name, *words = line.split() or [""]
        if name in _LIMITS:
            answer = self._setting(name, words)
        elif name in _WORDS:
            answer = getattr(self, _WORDS[name])(words)
        else:
            answer = _UNKNOWN
        if answer is not None:
            self._output += answer.encode("latin-1") + b"\r\n"

    def _setting(self, name: str, words: list[str]) -> str | None:
        low, high = _LIMITS[name]
        if not words:
            return str(self._settings[name])
        if not (words[0].isdigit() and low <= int(words[0]) <= high):
            return _UNKNOWN
        self._settings[name] = int(words[0])
        return None

    @_WORDS.of("addr")
    def _choose(self, words: list[str]) -> str | None:
        if not words:
            return self._address
        if not _ADDRESS.fullmatch(address := " ".join(words)):
            return _UNKNOWN
        self._address = address
        return None

    @_WORDS.of("read")
    def _read(self, words: list[str]) -> str | None:
        until = words[0] if words else ""
        if until not in {"", "eoi"} and not (until.isdigit() and int(until) <= 255):
            return _UNKNOWN
        self._begin_reading(by_end=until == "eoi", character=int(until) if until.isdigit() else None)
        return None

    @_WORDS.of("clr")
    def _clear(self, _words: list[str]) -> None:
        if self._device is not None:
            self._device.clear()

    @_WORDS.of("trg")
    def _trigger(self, words: list[str]) -> None:
        for device in [self._at(each) for each in words] or [self._device]:
            if device is not None:
                device.trigger()

    @_WORDS.of("spoll")
    def _poll(self, words: list[str]) -> str | None:
        device = self._at(words[0]) if words else self._device
        return None if device is None else str(device.status_byte())

    @_WORDS.of("srq")
    def _requested(self, _words: list[str]) -> str:
        pulled = (each.requests_service() for each in self._devices.values() if isinstance(each, ScpiTwin))
        return str(int(any([*pulled])))

    @_WORDS.of("ver")
    def _version(self, _words: list[str]) -> str:
        return _VERSION

    @_WORDS.of("rst")
    def _restart(self, _words: list[str]) -> None:
        self.clear()
        self._settings = dict(_SWITCHED_ON)

    @_WORDS.of("ifc", "llo", "loc")
    def _accept(self, _words: list[str]) -> None:
        """Do nothing: the simulated front panels have no keys to lock, and nobody else talks on the bus."""
