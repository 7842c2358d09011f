"""Faults of the bench, not of a wire: each begins at once at an instrument and returns a function that ends it."""

from __future__ import annotations

from collections.abc import Callable, Generator
from functools import partial
from typing import Any

from msgspec import Struct
from msgspec.structs import replace

from simrack.clock import Clock
from simrack.faults import Fault
from simrack.scpi import INFINITY, ScpiTwin

_POWER_ON = 128


def _replaced(device: Any, part: str, stand_in: Any) -> Callable[[], None]:
    """Put something in the place of a part of an instrument; return a function that puts it back."""
    kept = getattr(device, part)
    setattr(device, part, stand_in)
    return lambda: setattr(device, part, kept)


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


class _Shifted:
    """The input stage of a multimeter that reads too much."""

    def __init__(self, inputs: Any, clock: Clock, fault: Fault) -> None:
        self._inputs = inputs
        begun_s = clock.now()
        self._offset: Callable[[], float] = lambda: fault.offset + fault.drift_s * (clock.now() - begun_s)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._inputs, name)

    def begin(self, *arguments: Any, **settings: Any) -> Any:
        return self._shifted(self._inputs.begin(*arguments, **settings))

    def _shifted(self, reading: Any) -> Any:
        def shifted(read: Any) -> Any:
            if isinstance(read, Struct):  # it needs a further reading
                return self._shifted(read)
            return read if abs(read) >= INFINITY else read + self._offset()

        def labour() -> Generator[None, None, Any]:
            outcome = yield from reading.labour()
            return shifted(outcome)

        sliced = None if reading.labour is None else labour
        return replace(reading, value=lambda: shifted(reading.value()), labour=sliced)


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


def _switched(switch: Callable[..., None], name: str) -> Callable[[], None]:
    switch(**{name: True})
    return lambda: switch(**{name: False})


_ON_THE_BENCH: dict[str, tuple[str, Callable[[Any, Fault], Callable[[], None]]]] = {
    # kind: what an instrument must have to suffer it, and how it begins
    "power_cycle": ("reset", _restart),
    "identity": ("identity", lambda device, fault: _replaced(device, "identity", lambda: fault.identity)),
    "overload": ("inputs", lambda device, _: _replaced(device, "inputs", _Overdriven(device.inputs))),
    "offset": (
        "inputs",
        lambda device, fault: _replaced(device, "inputs", _Shifted(device.inputs, device.engine.clock, fault)),
    ),
    "current_limit": ("outputs", _short),
    **dict.fromkeys(
        ("interlock", "door", "emergency_stop", "drive_fault"),
        ("set_interlock", lambda device, fault: _switched(partial(device.set_interlock, fault.kind), "faulty")),
    ),
    **dict.fromkeys(
        ("readback_zero", "readback_stuck", "readback_half", "readback_behind"),
        ("misread", lambda device, fault: device.misread(fault.kind.removeprefix("readback_"))),
    ),
    "jam": ("jam", lambda device, _: _switched(device.jam, "held")),
}


def require_possible(device: Any, fault: Fault) -> None:
    """Raise ValueError if `device`, the instrument of `fault`, cannot suffer it."""
    needed = _ON_THE_BENCH.get(fault.kind, ("write",))[0]
    if not hasattr(device, needed) or (fault.kind == "error" and not isinstance(device, ScpiTwin)):
        raise ValueError(f"{fault.instrument} does not have the fault {fault.kind!r}")


def begin_on_bench(device: Any, fault: Fault) -> Callable[[], None]:
    """Begin a fault of the bench at `device`; return its end. Faults of a wire change nothing there."""
    begin = _ON_THE_BENCH.get(fault.kind)
    return (lambda: None) if begin is None else begin[1](device, fault)
