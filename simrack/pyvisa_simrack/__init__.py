"""Front door of a rack: `pyvisa.ResourceManager("@simrack")` finds this package by its name.

`"@simrack"` is the desk with a wire, `"rc_filter.py@simrack"` with the circuit of that file, `"bench.toml@simrack"` all
of a bench file; behind a question mark
stand the speed, real time unless it is said, and models: `"?speed=max&models=34461A,33522B@simrack"`.
"""

from importlib import import_module

from simrack.clock import ScaledClock, VirtualClock
from simrack.wires.visa_backend import SimVisaLibrary
from simrack.wires.visa_session import SimulatedInstruments

__all__ = ["WRAPPER_CLASS"]


class SimrackLibrary(SimVisaLibrary):
    """The library object of a desk."""


WRAPPER_CLASS = SimrackLibrary


def _resolve(path: str) -> SimulatedInstruments:
    """Build a rack with the circuit of the file `path`; imported only when asked for."""
    rack = import_module("simrack.rack")
    file, _, query = path.partition("?")
    try:
        speed, models = _said(query)
        plan = import_module("simrack.bench_file").planned([word for word in (file, *models) if word])
        built = rack.Rack.build(VirtualClock() if speed == "max" else ScaledClock(float(speed)), plan)
    except ValueError as error:  # PyVISA's word for a library that is not there is OSError
        raise OSError(str(error)) from error
    return SimulatedInstruments(built.by_resource(), built.world.clock)


def _said(query: str) -> tuple[str, list[str]]:
    """Return speed and models of what stands behind the question mark."""
    said = dict(part.partition("=")[::2] for part in query.split("&") if part)
    if unknown := set(said) - {"speed", "models"}:
        raise ValueError(f"expected speed and models behind the question mark, got {min(unknown)!r}")
    return said.get("speed", "1"), said.get("models", "").split(",")


SimrackLibrary.install_resolver(_resolve)
