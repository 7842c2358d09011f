"""Faults of the bench, not of a wire: each begins at once at an instrument and returns what ends it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from simrack.scpi import INFINITY, ScpiTwin

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.faults import Fault

_POWER_ON = 128


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
