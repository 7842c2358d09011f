"""Every driver on the simulated instrument of its model, each on a World of its own."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from msgspec import Struct
from simrack.attendance import AttendedClock
from simrack.sources import Drive
from simrack.wires.visa_backend import SimVisaLibrary

from vcfbench.clock import VirtualClock
from vcfbench.drivers.registry import open_instrument
from vcfbench.models import find_model, twin_of
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from collections.abc import Iterator

    from simrack.device import Device

METERS = ("34401A", "34461A", "34465A", "2000", "DMM6500")
INPUT_V = 2.72
"""Volts at the meters."""
SINE = Drive(0.5, 2.0, 1000.0)
"""The signal on the channels of the oscilloscopes."""
GENERATORS, SUPPLIES, SCOPES = ("33220A", "33522B"), ("E3631A", "E36312A"), ("DSO7104B", "DSOX3024A")
_WIRED: dict[str, dict[str, Any]] = {
    **{meter: {"node": "rail_positive"} for meter in METERS},
    **{generator: {"node": "v_vc"} for generator in GENERATORS},
    **{scope: {"channels": dict.fromkeys((1, 2, 3, 4), "v_vc")} for scope in SCOPES},
    **{supply: {"rails": {"P25V": "positive", "N25V": "negative"}} for supply in SUPPLIES},
}


class Box(Struct, frozen=True):
    """A simulated instrument, and the World and clock that it and its driver live by."""

    model: str
    device: Device
    world: World
    clock: AttendedClock

    def say(self, *messages: str) -> None:
        """Do at its front panel what these messages do; it is left without errors and in step."""
        for message in messages:
            self.device.write(message.encode("ascii") + b"\n", end=True)
            while (at_s := self.device.wake_at()) is not None and at_s < self.clock.now() + 5.0:
                self.clock.sleep_until(at_s)
        self.device.clear()
        self.device.write(b"*CLS\n", end=True)

    @contextmanager
    def driven(self, **settings: Any) -> Iterator[Any]:
        """Open its driver."""
        resource = "GPIB0::5::INSTR"
        SimVisaLibrary.register("box", {resource: self.device}, self.clock)
        try:
            driver = open_instrument(
                "box", self.model, resource, library="box@vcfbench", clock=self.clock, settings=settings
            )
            try:
                yield driver
            finally:
                driver.close()
        finally:
            SimVisaLibrary.unregister("box")


def box(model: str) -> Box:
    """Switch an ideal instrument on."""
    clock = AttendedClock(VirtualClock())
    world = World(clock, ideal_bench(), 0)
    row: Any = find_model(model)
    twin: Any = twin_of(row)
    device = twin(world, errors=twin.errors_class.none(), **_WIRED.get(model, {}))
    if model in METERS:
        world.set_rail("positive", INPUT_V)
    if model in SCOPES:
        world.drive("v_vc", SINE)
    clock.attend(device)
    return Box(model, device, world, clock)
