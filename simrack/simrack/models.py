"""The simulated instruments that speak SCPI by the name on the box: class, wires, and what is known of their manual."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any, Final

from msgspec import Struct, field

_BENCH = ("TCP", "serial line")
_LXI = ("TCP", "VXI-11", "HiSLIP")
_OLDER_LXI = ("TCP", "VXI-11")


class SimulatedModel(Struct, frozen=True):
    """A model.

    Args:
        name: what is on the box.
        twin: its class, or what makes it, below `simrack.instruments`.
        text: the module whose docstring says from which sources it is written, and what is unverified.
        wires: what it is served on beside PyVISA in one's own process, TCP as labs have it on converters.
        own: what else its class is made with.
        index: file in `simrack/manuals` with the headers of its manual or, where that was not at hand, of drivers and
            notes, as its first line says; and how many drivers use one.
    """

    name: str
    twin: str
    text: str
    wires: tuple[str, ...]
    index: str
    own: Mapping[str, float] = field(default_factory=dict)

    def load(self) -> Any:
        """Return its class."""
        module, _, name = self.twin.partition(":")
        found = getattr(import_module(f"simrack.instruments.{module}"), name)
        return found.of_model(self.name, **self.own) if hasattr(found, "of_model") else found

    def description(self) -> str:
        """Return what its module says of sources and of what is not simulated."""
        return import_module(f"simrack.instruments.{self.text}").__doc__ or ""


MODELS: Final[Mapping[str, SimulatedModel]] = {
    model.name: model
    for model in (
        SimulatedModel("E3631A", "e3631a:E3631ATwin", "e3631a.instrument", _BENCH, "E3631A.txt"),
        SimulatedModel("E36312A", "e36312a:E36312ATwin", "e36312a.instrument", _LXI, "E36312A.txt"),
        SimulatedModel(
            "33220A", "agilent33220a:Agilent33220ATwin", "agilent33220a.instrument", _OLDER_LXI, "33220A.txt"
        ),
        *(
            SimulatedModel(
                name, "trueform:TrueformTwin", "trueform.instrument", _LXI, "Trueform.txt", own={"sine_hz": sine_hz}
            )
            for sine_hz, names in (
                *((20e6, ("33509B", "33510B", "33511B", "33512B")), (30e6, ("33521B", "33522B"))),
                *((80e6, ("33611A", "33612A")), (120e6, ("33621A", "33622A"))),
            )
            for name in names
        ),
        SimulatedModel("34401A", "hp34401a:Hp34401ATwin", "hp34401a.instrument", _BENCH, "34401A.txt"),
        *(
            SimulatedModel(name, "truevolt:TruevoltTwin", "truevolt.instrument", _LXI, "Truevolt.txt")
            for name in ("34461A", "34465A")
        ),
        SimulatedModel("2000", "keithley:Keithley2000Twin", "keithley.k2000", _BENCH, "2000.txt"),
        SimulatedModel("DMM6500", "keithley:KeithleyDMM6500Twin", "keithley.dmm6500", _OLDER_LXI, "DMM6500.txt"),
        SimulatedModel("DSO7104B", "dso7104b:Dso7104BTwin", "dso7104b.instrument", _OLDER_LXI, "7000B.txt"),
        *(
            SimulatedModel(
                name, "infiniivision:InfiniiVisionXTwin", "infiniivision.instrument", _OLDER_LXI, "InfiniiVisionX.txt"
            )
            for name in ("DSOX3024A", "MSOX3104T", "DSOX4104A")
        ),
    )
}
