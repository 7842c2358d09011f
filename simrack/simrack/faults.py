"""Faults of a simulated bench: on a wire, at an instrument, at a bench time, from a script.

A script is TOML; `vcfbench sim serve --faults FILE` and the test fixtures read the same files, and know all kinds::

    seed = 0                    # of the noise; without it 0

    [[fault]]
    at_s = 10.0                 # bench time; without it from the start
    instrument = "multimeter"   # a role
    kind = "late"
    duration_s = 5.0            # bench time; without it the fault lasts until it is cleared
    delay_s = 3.0               # of the kind `late`
    count = 2                   # answers that it spoils; without it all of them

==============  ====================================================================================================
kind            what happens
==============  ====================================================================================================
silent          answers are lost
late            answers come `delay_s` (1 s) later
garbled         one byte of each answer is noise
garbage         a burst of noise comes before each answer
truncated       the second half of each answer is missing
disconnect      the connection is cut once
unreachable     the connection is cut, and there is no new one
half_open       the connection is dead and nobody says so: nothing is taken, nothing comes; a new one works
power_cycle     the mains fail: the connection is cut, and the instrument comes back (after `duration_s`) as switched on
error           `number` (-300) is in the error queue
identity        the answer to ``*IDN?`` is `identity`: somebody has exchanged the instrument
overload        the multimeter's input is beyond every range
offset          the multimeter reads `offset` too much (in the unit of the reading), and `drift_s` more every second
current_limit   a short circuit (`load_ohm`, 1 ohm) across the rails: the supply goes to its current limit
interlock       the rate table's master interlock opens: the servo drops
door            its door switch opens
emergency_stop  its emergency stop is pressed
drive_fault     its power amplifier fails
jam             something holds its axis: a servo trips on following error, a stepping motor stalls
readback_zero   the rate table's encoder reads 0 deg/s and stays at its angle, whatever the axis does
readback_stuck  it stays at the rate and the angle that it reads as the fault begins
readback_half   it reads half of the rate and of the angle since
readback_behind it reads what it should have read when it was last asked
==============  ====================================================================================================

:class:`FaultyDevice` stands around a `Device`, so that transports, drivers and procedures see what they would see of a
real fault. From `power_cycle` on they are faults of the bench, not of a wire, and act on the instrument itself.
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Mapping
from threading import Lock
from typing import Any, Literal, get_args

import msgspec
from msgspec import Struct

_ONE_AT_A_TIME = Lock()
"""msgspec works a type out when it is first asked for, and leaves it half done where another thread may take it."""

Kind = Literal[
    "silent",
    "late",
    "garbled",
    "garbage",
    "truncated",
    "disconnect",
    "unreachable",
    "half_open",
    "power_cycle",
    "error",
    "identity",
    "overload",
    "offset",
    "current_limit",
    "interlock",
    "door",
    "emergency_stop",
    "drive_fault",
    "jam",
    "readback_zero",
    "readback_stuck",
    "readback_half",
    "readback_behind",
]

_MOST = 1e9
"""Of times and offsets: thirty years, or more volts than there are; beyond, sums of floats lose what is asked for."""
AT_ONCE = frozenset({"disconnect", "error"})
"""Kinds that happen and are over."""
CUTTING = frozenset({"disconnect", "unreachable", "power_cycle"})
"""Kinds that cut the connections."""
_OF_KIND = {
    "late": ("delay_s",),
    "error": ("number",),
    "identity": ("identity",),
    "offset": ("offset", "drift_s"),
    "current_limit": ("load_ohm",),
}
"""What else there is to say of a kind."""
UNREACHABLE = frozenset({"unreachable", "power_cycle"})
"""Kinds during which there is no new connection."""


class Fault(Struct, frozen=True):
    """A fault of one instrument.

    Raises:
        ValueError: there is no such kind, a time is negative, or a quantity is none.
    """

    instrument: str
    """Its role."""
    kind: Kind
    at_s: float = 0.0
    """Bench time at which it begins."""
    duration_s: float | None = None
    """Bench time for which it lasts; None until it is cleared."""
    number: int = -300
    """Error number of the kind `error`."""
    delay_s: float = 1.0
    """Lateness of the kind `late`, bench time."""
    count: int | None = None
    """How many answers a fault of the wire spoils; None: all while it lasts."""
    identity: str = "UNKNOWN,UNKNOWN,0,0"
    """What the kind `identity` answers."""
    offset: float = 0.0
    """What the kind `offset` adds to readings, in their unit."""
    drift_s: float = 0.0
    """By how much that grows in a second of bench time."""
    load_ohm: float = 1.0
    """What lies across the rails with the kind `current_limit`."""

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise ValueError(f"a fault is one of {', '.join(get_args(Kind))}, not {self.kind!r}")
        own = _OF_KIND.get(self.kind, ())
        if self.count is not None and not (self.kind in _SPOILERS and self.count > 0):
            raise ValueError("count: expected a number of damaged answers above 0, for a fault that damages answers")
        if strange := next((name for name in _FIELDS if name not in own and getattr(self, name) != _FIELDS[name]), ""):
            raise ValueError(f"{strange} is nothing of a fault {self.kind}, which has {', '.join(own) or 'none such'}")
        if self.kind == "offset" and not (self.offset or self.drift_s):
            raise ValueError("offset or drift_s: expected one of them for a fault offset, got neither")
        if not self.load_ohm > 0:
            raise ValueError(f"a load has more than 0 ohm, not {self.load_ohm}")
        for name in ("at_s", "duration_s", "delay_s", "number", "offset", "drift_s"):
            value = getattr(self, name)
            if value is not None and not abs(value) <= _MOST:
                raise ValueError(f"{name} is at most {_MOST:g} either sign, not {value:g}")
        if self.at_s < 0 or self.delay_s < 0 or (self.duration_s is not None and self.duration_s <= 0):
            raise ValueError("a fault begins at 0 s or later, and lasts")

    def describe(self) -> str:
        """Return in words the fault, its beginning and the time for which it lasts."""
        what = "".join(f", {name} {getattr(self, name)}" for name in _OF_KIND.get(self.kind, ()))
        if self.kind in AT_ONCE:
            return f"{self.instrument}: {self.kind}{what}, once at {self.at_s:g} s of bench time"
        until = "until it is cleared" if self.duration_s is None else f"for {self.duration_s:g} s"
        answers = "" if self.count is None else f", or {self.count} answers"
        return f"{self.instrument}: {self.kind}{what}, from {self.at_s:g} s of bench time {until}{answers}"


_FIELDS = {
    name: default
    for name, default in zip(reversed(Fault.__struct_fields__), reversed(Fault.__struct_defaults__), strict=False)
    if any(name in each for each in _OF_KIND.values())
}
"""Fields of single kinds, with their defaults."""


class FaultScript(Struct, frozen=True):
    """Faults and their times; `seed` is that of the noise."""

    faults: tuple[Fault, ...]
    seed: int = 0


def script_of(table: Mapping[str, Any]) -> FaultScript:
    """Return the script of a table ``seed = 3``, ``[[fault]]``; ValueError names a wrong entry."""
    seed, entries = table.get("seed", 0), table.get("fault", [])
    if set(table) - {"seed", "fault"} or type(seed) is not int or not isinstance(entries, list):
        raise ValueError("expected only seed and [[fault]]")
    return FaultScript(tuple(_fault(entry, number) for number, entry in enumerate(entries, start=1)), seed)


def _fault(entry: Any, number: int) -> Fault:
    known = set(Fault.__struct_fields__)
    if not isinstance(entry, dict) or not {"instrument", "kind"} <= set(entry) <= known:
        others = ", ".join(sorted(known))
        raise ValueError(f"fault {number}: expected instrument and kind, and of {others} no others")
    try:
        return fault_from(entry)
    except ValueError as error:
        raise ValueError(f"fault {number}: {error}") from None


def fault_from(values: Mapping[str, Any]) -> Fault:
    """Return the fault with the given fields; raises ValueError if one is missing or wrong."""
    if unknown := set(values) - set(Fault.__struct_fields__):
        raise ValueError(f"a fault has no {min(unknown)!r}")
    if values.get("kind") not in get_args(Kind):
        raise ValueError(f"a fault is one of {', '.join(get_args(Kind))}, not {values.get('kind')!r}")
    try:
        with _ONE_AT_A_TIME:
            return msgspec.convert(dict(values), Fault)  # noqa: TID251  (one thread at a time here, too)
    except msgspec.ValidationError as error:
        raise ValueError(" ".join(str(error).replace("`", "").split())) from None


class Ongoing(Struct, eq=False):
    """A fault under way: its end, its instant, and the number of answers that it will spoil (None: all)."""

    fault: Fault
    undo: Callable[[], None]
    ends_s: float | None
    left: int | None

    @property
    def over(self) -> bool:
        """True after the last damaged answer."""
        return self.left == 0


# --- answers


def _garble(noise: random.Random, data: bytes) -> bytes:
    """Spoil one byte, not the terminator if there is another; the byte in its place is never text."""
    place = noise.randrange(max(1, len(data) - 2))
    return data[:place] + bytes([noise.randrange(0x80, 0x100)]) + data[place + 1 :]


_SPOILERS: dict[str, Callable[[random.Random, bytes], bytes]] = {
    "silent": lambda _noise, _data: b"",
    "late": lambda _, data: data,
    "garbled": _garble,
    "garbage": lambda noise, data: bytes(noise.randrange(0x80, 0x100) for _ in range(noise.randrange(1, 20))) + data,
    "truncated": lambda _, data: data[: len(data) // 2],
}
_UNENDED = frozenset({"silent", "truncated"})


def spoils(fault: Fault) -> bool:
    """Return True if `fault` changes answers or their time."""
    return fault.kind in _SPOILERS


def spoiled(faults: Iterable[Ongoing], noise: random.Random, data: bytes, *, end: bool) -> tuple[bytes, bool, float]:
    """Return (a part of) an answer after `faults`, all of which spoil answers, its end, and its delay, s."""
    late_s, whole = 0.0, end
    for each in faults:
        if each.fault.kind == "late":
            late_s += each.fault.delay_s
        data, end = _SPOILERS[each.fault.kind](noise, data), end and each.fault.kind not in _UNENDED
        if whole and each.left is not None:
            each.left -= 1
    return data, end, late_s
