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
late            answers come `delay_s` later
garbled         one byte of each answer is noise
garbage         a burst of noise comes before each answer
truncated       the second half of each answer is missing
disconnect      the connection is cut once
unreachable     the connection is cut, and there is no new one
half_open       the connection is dead and nobody says so: nothing is taken, nothing comes; a new one works
power_cycle     the mains fail: the connection is cut, and the instrument comes back (after `duration_s`) as switched on
error           `number` is in the error queue
identity        the answer to ``*IDN?`` is `identity`: somebody has exchanged the instrument
overload        the multimeter's input is beyond every range
offset          the multimeter reads `offset` too much (in the unit of the reading), and `drift_s` more every second
current_limit   a short circuit (`load_ohm`) across the rails: the supply goes to its current limit
interlock       the rate table's master interlock opens: the servo drops
door            its door switch opens
emergency_stop  its emergency stop is pressed
drive_fault     its power amplifier fails
jam             something holds its axis: a servo trips on following error, a stepping motor stalls
==============  ====================================================================================================

:class:`FaultyDevice` stands around a `Device`, so that transports, drivers and procedures see what they would see of a
real fault. From `power_cycle` on they are faults of the bench, not of a wire, and act on the instrument itself.
"""

from __future__ import annotations

import random
from collections import deque
from threading import Lock
from typing import TYPE_CHECKING, Any, Literal, get_args

import msgspec
from msgspec import Struct

from simrack.scpi import INFINITY, ScpiError, ScpiTwin

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping

    from simrack.clock import Clock
    from simrack.device import Device

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
]

_WHOLE = 1 << 25
_POWER_ON = 128
_MOST = 1e9
"""Of times and offsets: thirty years, or more volts than there are; beyond, sums of floats lose what is asked for."""
_AT_ONCE = frozenset({"disconnect", "error"})
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
        if self.count is not None and not (self.kind in _SPOILERS and self.count > 0):
            raise ValueError("a count is of answers, above 0, of a fault that spoils them")
        if not self.load_ohm > 0:
            raise ValueError(f"a load has more than 0 ohm, not {self.load_ohm}")
        for name in ("at_s", "duration_s", "delay_s", "number", "offset", "drift_s"):
            value = getattr(self, name)
            if value is not None and not abs(value) <= _MOST:
                raise ValueError(f"{name} is at most {_MOST:g} either sign, not {value:g}")
        if self.at_s < 0 or self.delay_s < 0 or (self.duration_s is not None and self.duration_s <= 0):
            raise ValueError("a fault begins at 0 s or later, and lasts")

    def describe(self) -> str:
        """Return in words the fault, its beginning and how long it lasts."""
        own = {name: getattr(self, name) for name in self.__struct_fields__ if name in _OF_KIND.get(self.kind, ())}
        what = "".join(f", {name} {value}" for name, value in own.items())
        if self.kind in _AT_ONCE:
            return f"{self.instrument}: {self.kind}{what}, once at {self.at_s:g} s of bench time"
        until = "until it is cleared" if self.duration_s is None else f"for {self.duration_s:g} s"
        answers = "" if self.count is None else f", or {self.count} answers"
        return f"{self.instrument}: {self.kind}{what}, from {self.at_s:g} s of bench time {until}{answers}"


class FaultScript(Struct, frozen=True):
    """Faults and their times; `seed` is that of the noise."""

    faults: tuple[Fault, ...]
    seed: int = 0


def script_of(table: Mapping[str, Any]) -> FaultScript:
    """Return the script that a table ``seed = 3``, ``[[fault]]`` describes; ValueError says which entry is none."""
    seed, entries = table.get("seed", 0), table.get("fault", [])
    if set(table) - {"seed", "fault"} or type(seed) is not int or not isinstance(entries, list):
        raise ValueError("expected seed and [[fault]] and nothing else")
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
    """Return the fault of which somebody gave the fields by name; raises ValueError if one is missing or wrong."""
    if unknown := set(values) - set(Fault.__struct_fields__):
        raise ValueError(f"a fault has no {min(unknown)!r}")
    if values.get("kind") not in get_args(Kind):
        raise ValueError(f"a fault is one of {', '.join(get_args(Kind))}, not {values.get('kind')!r}")
    try:
        with _ONE_AT_A_TIME:
            return msgspec.convert(dict(values), Fault)  # noqa: TID251  (one thread at a time here, too)
    except msgspec.ValidationError as error:
        raise ValueError(" ".join(str(error).replace("`", "").split())) from None


# --- faults of the bench: each begins at once and returns what ends it ---------------------------------------------


def _overdrive(device: Any, _fault: Fault) -> Callable[[], None]:
    inputs = device.inputs
    device.inputs = _Overdriven(inputs)
    return lambda: setattr(device, "inputs", inputs)


class _Overdriven:
    """The input stage of a multimeter whose input is beyond every range."""

    def __init__(self, inputs: Any) -> None:
        self._inputs = inputs

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inputs, name)

    def autorange(self, function: Any, _range: float) -> float:
        return float(function.ranges[-1])

    def begin(self, *arguments: Any, **settings: Any) -> Any:
        reading = self._inputs.begin(*arguments, **settings)
        return type(reading)(reading.end_s, lambda: INFINITY)


def _shift(device: Any, fault: Fault) -> Callable[[], None]:
    inputs, clock = device.inputs, device.engine.clock
    begun_s = clock.now()
    device.inputs = _Shifted(inputs, lambda: fault.offset + fault.drift_s * (clock.now() - begun_s))
    return lambda: setattr(device, "inputs", inputs)


class _Shifted:
    """The input stage of a multimeter that reads too much."""

    def __init__(self, inputs: Any, offset: Callable[[], float]) -> None:
        self._inputs = inputs
        self._offset = offset

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inputs, name)

    def begin(self, *arguments: Any, **settings: Any) -> Any:
        return self._shifted(self._inputs.begin(*arguments, **settings))

    def _shifted(self, reading: Any) -> Any:
        def value() -> Any:
            read = reading.value()
            if isinstance(read, type(reading)):  # it needs a further one
                return self._shifted(read)
            return read if abs(read) >= INFINITY else read + self._offset()

        return type(reading)(reading.end_s, value)


def _exchange(device: Any, fault: Fault) -> Callable[[], None]:
    device.identity = lambda: fault.identity
    return lambda: delattr(device, "identity")


def _restart(device: Any, _fault: Fault) -> Callable[[], None]:
    """Switch off and on: settings of *RST, queues empty, masks cleared unless *PSC 0 keeps them, PON set."""
    engine = device.engine
    engine.clear()
    device.reset()
    engine.clear_status()
    engine.status.esr = _POWER_ON
    if engine.clears_masks_at_power_on:
        engine.status.ese = engine.status.sre = 0
    if hasattr(device, "local"):
        device.local = True
    return lambda: None


def _short(device: Any, fault: Fault) -> Callable[[], None]:
    worlds = {name: output._world for name, output in device.outputs.items()}  # noqa: SLF001  # the leads end there

    def connect(lead: Callable[[Any], Any]) -> None:
        for name, output in device.outputs.items():
            output._world = lead(worlds[name])  # noqa: SLF001  # as above
        device.regulate()

    connect(lambda world: _Shorted(world, fault.load_ohm))
    return lambda: connect(lambda world: world)


class _Shorted:
    """The World at the end of a supply's leads when something lies across them."""

    def __init__(self, world: Any, load_ohm: float) -> None:
        self._world = world
        self._load_ohm = load_ohm

    def __getattr__(self, name: str) -> Any:
        return getattr(self._world, name)

    def rail_current_a(self, rail: str, voltage_v: float) -> float:
        return float(self._world.rail_current_a(rail, voltage_v)) + abs(voltage_v) / self._load_ohm


def _open_interlock(device: Any, fault: Fault) -> Callable[[], None]:
    device.set_interlock(fault.kind, faulty=True)
    return lambda: device.set_interlock(fault.kind, faulty=False)


def _hold(device: Any, _fault: Fault) -> Callable[[], None]:
    device.jam(held=True)
    return lambda: device.jam(held=False)


_ON_THE_BENCH: dict[str, tuple[str, Callable[[Any, Fault], Callable[[], None]]]] = {
    # kind: what an instrument must have to suffer it, and how it begins
    "power_cycle": ("reset", _restart),
    "identity": ("identity", _exchange),
    "overload": ("inputs", _overdrive),
    "offset": ("inputs", _shift),
    "current_limit": ("outputs", _short),
    **dict.fromkeys(("interlock", "door", "emergency_stop", "drive_fault"), ("set_interlock", _open_interlock)),
    "jam": ("jam", _hold),
}


def require_possible(device: Any, fault: Fault) -> None:
    """Raise ValueError if `device`, the instrument of `fault`, cannot suffer it."""
    needed = _ON_THE_BENCH.get(fault.kind, ("write",))[0]
    if not hasattr(device, needed) or (fault.kind == "error" and not isinstance(device, ScpiTwin)):
        raise ValueError(f"{fault.instrument} knows no {fault.kind!r}")


def begin_on_bench(device: Any, fault: Fault) -> Callable[[], None]:
    """Let a fault of the bench begin at `device`; return its end. Faults of a wire change nothing there."""
    begin = _ON_THE_BENCH.get(fault.kind)
    return (lambda: None) if begin is None else begin[1](device, fault)


class Ongoing(Struct, eq=False):
    """A fault under way: its end, when that is, and how many more answers it spoils (None: all)."""

    fault: Fault
    undo: Callable[[], None]
    ends_s: float | None
    left: int | None

    @property
    def over(self) -> bool:
        """Whether it has spoiled as many answers as it was to."""
        return self.left == 0


# --- faults of a wire ------------------------------------------------------------------------------------------------


class FaultyDevice:
    """A device, and its faults.

    Args:
        device: what it stands around.
        clock: bench time.
        noise: where noise comes from.
    """

    def __init__(self, device: Device, clock: Clock, noise: random.Random) -> None:
        self.device = device
        self._clock = clock
        self._noise = noise
        self._planned: list[Fault] = []
        self._active: list[Ongoing] = []
        self._underway: deque[tuple[float, bytes, bool]] = deque()
        self._cut = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self.device, name)

    def add(self, fault: Fault) -> None:
        """Let `fault` happen at its time, now if that has passed.

        Raises:
            ValueError: the instrument cannot suffer it.
        """
        require_possible(self.device, fault)
        self._planned.append(fault)
        self._planned.sort(key=lambda each: each.at_s)
        self._advance()

    def clear_faults(self) -> None:
        """End the faults under way and forget the planned ones."""
        self._planned.clear()
        while self._active:
            self._active.pop().undo()
        self._cut = False

    # --- what transports call -------------------------------------------------------------------------------------

    def write(self, data: bytes, *, end: bool = False) -> None:
        """Take bytes from the controller; ConnectionResetError when the link is lost."""
        self._require_link()
        if not self._dead:
            self.device.write(data, end=end)

    def read(self, limit: int) -> tuple[bytes, bool]:
        """Return the bytes that have arrived; ConnectionResetError when the link is lost."""
        self._advance()
        if not (self._active or self._underway or self._cut):
            return self.device.read(limit)
        self._require_link()
        if self._dead:
            return b"", False
        if not self._underway:
            return self.device.read(limit) if not self._spoiling() else (b"", False)
        arrives_s, data, end = self._underway[0]
        if arrives_s > self._clock.now():
            return b"", False
        part, rest = data[:limit], data[limit:]
        if rest:
            self._underway[0] = (arrives_s, rest, end)
        else:
            self._underway.popleft()
        return part, end and not rest

    def wake_at(self) -> float | None:
        """Do everything due; return when something next happens by itself."""
        if not (self._planned or self._active or self._underway):  # as nearly always
            return self.device.wake_at()
        self._advance()
        own = self.device.wake_at()
        if not (self._active or self._underway):
            planned = [each.at_s for each in self._planned[:1]]
            return min([*planned, own] if own is not None else planned, default=None)
        if own is not None and own <= self._clock.now() and self._dead:  # what it says there nobody hears
            own = None
        coming = [
            own,
            *(each.ends_s for each in self._active),
            *(each.at_s for each in self._planned[:1]),
        ]
        coming += [arrives_s for arrives_s, _, _ in self._underway]
        return min((instant for instant in coming if instant is not None), default=None)

    def clear(self) -> None:
        """Device clear."""
        self._require_link()
        self._underway.clear()
        self.device.clear()

    def status_byte(self) -> int:
        """Serial poll."""
        self._require_link()
        return self.device.status_byte()

    def trigger(self) -> None:
        """Group execute trigger."""
        self._require_link()
        self.device.trigger()

    # --- faults ---------------------------------------------------------------------------------------------------

    def _advance(self) -> None:
        """Begin and end faults that are due, and spoil the answers of the device.

        What it says while earlier words are under way comes after them, whether or not the fault is over.
        """
        if not (self._planned or self._active or self._underway):
            return
        now = self._clock.now()
        if not (self._active or self._underway) and self._planned[0].at_s > now:
            return
        while self._planned and self._planned[0].at_s <= now:
            self._begin(self._planned.pop(0))
        self._end([each for each in self._active if each.ends_s is not None and each.ends_s <= now])
        if self._underway or self._spoiling():
            self._spoil_what_is_said()

    def _begin(self, fault: Fault) -> None:
        if fault.kind == "error":
            self.device.engine.report(ScpiError(fault.number))  # type: ignore[attr-defined]  # add() has seen to it
        if fault.kind in CUTTING:
            self._underway.clear()
            self.device.clear()
            self._cut = fault.kind != "unreachable"
        if fault.kind in _AT_ONCE:
            return
        undo = begin_on_bench(self.device, fault)
        if fault.kind == "power_cycle" and fault.duration_s is None:
            return
        ends_s = None if fault.duration_s is None else max(fault.at_s, self._clock.now()) + fault.duration_s
        self._active.append(Ongoing(fault, undo, ends_s, fault.count))

    def _end(self, over: Iterable[Ongoing]) -> None:
        for each in over:
            self._active.remove(each)
            each.undo()

    @property
    def _dead(self) -> bool:
        return any(each.fault.kind == "half_open" for each in self._active)

    def _require_link(self) -> None:
        self._advance()
        if self._cut or any(each.fault.kind in UNREACHABLE for each in self._active):
            self._cut = False
            raise ConnectionResetError("the link to the instrument is lost")

    def _spoiling(self) -> list[Ongoing]:
        return [each for each in self._active if spoils(each.fault)]

    def _spoil_what_is_said(self) -> None:
        data, end = self.device.read(_WHOLE)
        if not data:
            return
        arrives_s = max([self._clock.now(), *(each[0] for each in self._underway)])
        spoiling = self._spoiling()
        data, end, late_s = spoiled(spoiling, self._noise, data, end=end)
        self._end([each for each in spoiling if each.over])
        arrives_s += late_s
        if data:
            self._underway.append((arrives_s, data, end))


def _lose(_noise: random.Random, _data: bytes, _end: bool) -> tuple[bytes, bool]:  # noqa: FBT001  # as an answer is
    return b"", False


def _leave(_noise: random.Random, data: bytes, end: bool) -> tuple[bytes, bool]:  # noqa: FBT001
    return data, end


def _garble(noise: random.Random, data: bytes, end: bool) -> tuple[bytes, bool]:  # noqa: FBT001
    """Spoil one byte, not the terminator if there is another; the byte in its place is never text."""
    place = noise.randrange(max(1, len(data) - 2))
    return data[:place] + bytes([noise.randrange(0x80, 0x100)]) + data[place + 1 :], end


def _add_garbage(noise: random.Random, data: bytes, end: bool) -> tuple[bytes, bool]:  # noqa: FBT001
    return bytes(noise.randrange(0x80, 0x100) for _ in range(noise.randrange(1, 20))) + data, end


def _cut_short(_noise: random.Random, data: bytes, _end: bool) -> tuple[bytes, bool]:  # noqa: FBT001
    return data[: len(data) // 2], False


_SPOILERS: dict[str, Callable[[random.Random, bytes, bool], tuple[bytes, bool]]] = {
    "silent": _lose,
    "late": _leave,
    "garbled": _garble,
    "garbage": _add_garbage,
    "truncated": _cut_short,
}


def spoils(fault: Fault) -> bool:
    """Tell whether `fault` changes answers or their time."""
    return fault.kind in _SPOILERS


def spoiled(faults: Iterable[Ongoing], noise: random.Random, data: bytes, *, end: bool) -> tuple[bytes, bool, float]:
    """Return (a part of) an answer after `faults`, all of which spoil answers, its end, and how late that is, s."""
    late_s, whole = 0.0, end
    for each in faults:
        if each.fault.kind == "late":
            late_s += each.fault.delay_s
        data, end = _SPOILERS[each.fault.kind](noise, data, end)
        if whole and each.left is not None:
            each.left -= 1
    return data, end, late_s


class FaultInjector:
    """The instruments of a bench, and their faults; `devices` stand in for those that it was made of."""

    def __init__(self, devices: Mapping[str, Device], clock: Clock, seed: int = 0) -> None:
        self._clock = clock
        self.devices = {
            role: FaultyDevice(device, clock, random.Random(f"{seed}/{role}"))  # noqa: S311  # noise, not secrets
            for role, device in devices.items()
        }

    def add(self, *faults: Fault) -> None:
        """Let `faults` happen at their times.

        Raises:
            ValueError: the bench has no such instrument, or the instrument cannot suffer that.
        """
        for fault in faults:
            self._device(fault.instrument).add(fault)

    def play(self, script: FaultScript) -> None:
        """Let everything in `script` happen, its noise from its seed; errors as of :meth:`add`."""
        for role, device in self.devices.items():
            device._noise.seed(f"{script.seed}/{role}")  # noqa: SLF001  # its own
        self.add(*script.faults)

    def clear(self, roles: Iterable[str] | None = None) -> None:
        """End the faults of `roles`, or of all, and forget those that are planned."""
        for role in self.devices if roles is None else roles:
            self._device(role).clear_faults()

    def _device(self, role: str) -> FaultyDevice:
        try:
            return self.devices[role]
        except KeyError:
            raise ValueError(f"the bench has no {role!r}, only {', '.join(self.devices)}") from None
