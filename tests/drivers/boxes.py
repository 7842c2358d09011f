"""Every driver on the simulated instrument of its model, each on a World of its own."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from msgspec import Struct
from simrack.attendance import AttendedClock
from simrack.instruments.ats545 import AirStreamErrors, TemptronicATS545Twin
from simrack.wires.visa_backend import SimVisaLibrary

from tests.conformance import walk
from vcfbench.clock import VirtualClock
from vcfbench.drivers.registry import open_instrument
from vcfbench.sim.gyro.design import ideal_bench
from vcfbench.sim.world import World

if TYPE_CHECKING:
    from collections.abc import Iterator

    from simrack.device import Device

MODELS = {
    "33220A": "agilent33220a",
    "33622A": "keysight33622a",
    "E3631A": "e3631a",
    "E36312A": "e36312a",
    "34401A": "hp34401a",
    "34461A": "keysight34461a",
    "34465A": "keysight34465a",
    "2000": "keithley2000",
    "DMM6500": "dmm6500",
    "DSO7104B": "dso7104b",
    "DSOX3024A": "dsox3024a",
    "ATS-545": "",
}
"""Models by the name on the box, and what walks through their manuals call them."""

METERS = ("34401A", "34461A", "34465A", "2000", "DMM6500")


class Box(Struct, frozen=True):
    """A simulated instrument, and the clock that it and its driver live by."""

    model: str
    device: Device
    clock: AttendedClock

    def say(self, *messages: str) -> None:
        """Do at its front panel what these messages do; it is left without errors and in step."""
        for message in messages:
            self.device.write(message.encode("ascii") + b"\n", end=True)
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
    if MODELS[model]:
        bench = walk.bench(MODELS[model])
        return Box(model, bench.device, bench.clock)
    clock = AttendedClock(VirtualClock())
    device = TemptronicATS545Twin(World(clock, ideal_bench(), 0), errors=AirStreamErrors.none())
    clock.attend(device)
    return Box(model, device, clock)
