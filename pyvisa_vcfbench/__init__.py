"""Front door of the simulated instruments: `pyvisa.ResourceManager("@vcfbench")` finds this package by its name.

`"@vcfbench"` is the embedded paper bench, `"bench.toml@vcfbench"` the simulated bench of that file;
`"?speed=max@vcfbench"` has simulated time.
"""

from importlib import import_module

from simrack.wires.visa_backend import SimVisaLibrary
from simrack.wires.visa_session import SimulatedInstruments

__all__ = ["WRAPPER_CLASS"]


class VcfbenchLibrary(SimVisaLibrary):
    """The library object of a simulated bench of vcfbench."""

    maker = "vcfbench"


WRAPPER_CLASS = VcfbenchLibrary


def _resolve(path: str) -> SimulatedInstruments:
    """Build the simulated bench of the bench file `path`, the embedded one for ""; imported only when asked for."""
    instruments, clock = import_module("vcfbench.bench.visa_resolver").resolve(path)
    return SimulatedInstruments(instruments, clock)


VcfbenchLibrary.install_resolver(_resolve)
