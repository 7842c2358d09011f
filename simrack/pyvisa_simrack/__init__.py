"""Front door of the desk: `pyvisa.ResourceManager("@simrack")` finds this package by its name.

`"@simrack"` is the desk with a wire, `"rc_filter.py@simrack"` with the circuit of that file; it runs in real time,
`"?speed=max@simrack"` in simulated time.
"""

from importlib import import_module
from pathlib import Path

from simrack.clock import ScaledClock, VirtualClock
from simrack.wires.visa_backend import SimVisaLibrary
from simrack.wires.visa_session import SimulatedInstruments

__all__ = ["WRAPPER_CLASS"]


class SimrackLibrary(SimVisaLibrary):
    """The library object of a desk."""


WRAPPER_CLASS = SimrackLibrary


def _resolve(path: str) -> SimulatedInstruments:
    """Build a desk with the circuit of the file `path`; imported only when asked for."""
    desk = import_module("simrack.desk")
    file, _, speed = path.partition("?speed=")
    try:
        circuit = desk.circuit_in(Path(file)) if file else None
        built = desk.Desk.build(VirtualClock() if speed == "max" else ScaledClock(float(speed or 1.0)), circuit)
    except ValueError as error:  # PyVISA's word for a library that is not there is OSError
        raise OSError(str(error)) from error
    return SimulatedInstruments(built.by_resource(), built.world.clock)


SimrackLibrary.install_resolver(_resolve)
