"""The simulated instruments by the name on the box: class, wires, terminals, and what is known of their manual."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any, Final, Literal

from msgspec import Struct, field

Kind = Literal["supply", "generator", "multimeter", "oscilloscope", "chamber", "rate table", "own"]

_SERIAL = ("TCP", "serial line")
_LXI = ("TCP", "VXI-11", "HiSLIP")
_OLDER_LXI = ("TCP", "VXI-11")


class SimulatedModel(Struct, frozen=True):
    """A model.

    Args:
        name: what is on the box; of a rate table its language.
        kind: what it is.
        twin: its class, or what makes it, below `simrack`.
        text: the module whose docstring says from which sources it is written, and what is unverified, below `simrack`.
        wires: what it is served on beside PyVISA in one's own process, TCP as labs have it on converters.
        index: file in `simrack/manuals` with the headers of its manual or, where that was not at hand, of drivers and
            notes, as its first line says; and how many drivers use one. Empty of what has no list.
        own: what else its class is made with.
        terminals: its outputs or inputs.
    """

    name: str
    kind: Kind
    twin: str
    text: str
    wires: tuple[str, ...]
    index: str = ""
    own: Mapping[str, float] = field(default_factory=dict)
    terminals: tuple[str, ...] = ()

    def load(self) -> Any:
        """Return its class."""
        module, _, name = self.twin.partition(":")
        found = getattr(import_module(f"simrack.{module}"), name)
        return found.of_model(self.name, **self.own) if hasattr(found, "of_model") else found

    @property
    def feeds(self) -> tuple[str, ...]:
        """Its terminals that are outputs."""
        return self.terminals if self.kind in {"supply", "generator"} else ()

    def description(self) -> str:
        """Return what its module says of sources and of what is not simulated."""
        return import_module(f"simrack.{self.text}").__doc__ or ""


def _supply(name: str, module: str, wires: tuple[str, ...]) -> SimulatedModel:
    twin, text = f"instruments.{module}:{name}Twin", f"instruments.{module}.instrument"
    outputs = ("output_1", "output_2", "output_3")
    return SimulatedModel(name, "supply", twin, text, wires, f"{name}.txt", terminals=outputs)


def _trueform(name: str, sine_hz: float) -> SimulatedModel:
    twin, text = "instruments.trueform:TrueformTwin", "instruments.trueform.instrument"
    outputs = ("output_1",) if int(name[4]) % 2 else ("output_1", "output_2")
    return SimulatedModel(name, "generator", twin, text, _LXI, "Trueform.txt", {"sine_hz": sine_hz}, outputs)


def _meter(name: str, twin: str, text: str, wires: tuple[str, ...], index: str) -> SimulatedModel:
    below = "instruments."
    return SimulatedModel(name, "multimeter", below + twin, below + text, wires, index, terminals=("input",))


def _oscilloscope(name: str, twin: str, index: str) -> SimulatedModel:
    twin, text = f"instruments.{twin}", f"instruments.{twin.partition(':')[0]}.instrument"
    channels = tuple(f"channel_{number}" for number in range(1, 5))
    return SimulatedModel(name, "oscilloscope", twin, text, _OLDER_LXI, index, terminals=channels)


def _table(name: str, module: str, twin: str) -> SimulatedModel:
    text = "rate_tables.acl.instrument" if module == "acl" else f"rate_tables.{module}"
    return SimulatedModel(name, "rate table", f"rate_tables.{module}:{twin}", text, _SERIAL)


_GENERATORS_HZ = {
    **dict.fromkeys(("33509B", "33510B", "33511B", "33512B"), 20e6),
    **dict.fromkeys(("33521B", "33522B"), 30e6),
    **dict.fromkeys(("33611A", "33612A"), 80e6),
    **dict.fromkeys(("33621A", "33622A"), 120e6),
}
_33220A = "instruments.agilent33220a"
_X_SERIES = "infiniivision:InfiniiVisionXTwin"

MODELS: Final[Mapping[str, SimulatedModel]] = {
    model.name: model
    for model in (
        _supply("E3631A", "e3631a", _SERIAL),
        _supply("E36312A", "e36312a", _LXI),
        SimulatedModel(
            *("33220A", "generator", f"{_33220A}:Agilent33220ATwin", f"{_33220A}.instrument", _OLDER_LXI, "33220A.txt"),
            terminals=("output_1",),
        ),
        *(_trueform(name, sine_hz) for name, sine_hz in _GENERATORS_HZ.items()),
        _meter("34401A", "hp34401a:Hp34401ATwin", "hp34401a.instrument", _SERIAL, "34401A.txt"),
        *(
            _meter(name, "truevolt:TruevoltTwin", "truevolt.instrument", _LXI, "Truevolt.txt")
            for name in ("34461A", "34465A")
        ),
        _meter("2000", "keithley:Keithley2000Twin", "keithley.k2000", _SERIAL, "2000.txt"),
        _meter("DMM6500", "keithley:KeithleyDMM6500Twin", "keithley.dmm6500", _OLDER_LXI, "DMM6500.txt"),
        _oscilloscope("DSO7104B", "dso7104b:Dso7104BTwin", "7000B.txt"),
        *(_oscilloscope(name, _X_SERIES, "InfiniiVisionX.txt") for name in ("DSOX3024A", "MSOX3104T", "DSOX4104A")),
    )
}
"""Those of which a list of headers is at hand."""
RACK: Final[Mapping[str, SimulatedModel]] = {
    **MODELS,
    **{
        model.name: model
        for model in (
            SimulatedModel(
                "ATS-545", "chamber", "instruments.ats545:TemptronicATS545Twin", "instruments.ats545", _SERIAL
            ),
            _table("ACL", "acl", "AclTable"),
            _table("Zaber", "zaber", "ZaberTable"),
            _table("ATL", "atl", "AtlTable"),
            _table("ESP", "esp", "EspTable"),
            _table("DD16", "dd16", "Dd16Table"),
            _table("MN-AS", "mn_as", "MnAsTable"),
            _table("RUYA", "ruya", "RuyaTable"),
            _table("AAAA", "aaaa", "AaaaTable"),
        )
    },
}
"""All that `simrack serve` knows by name."""


def model_named(name: str, own: Mapping[str, SimulatedModel] = MappingProxyType({})) -> SimulatedModel:
    """Return a model of the rack or of somebody's own, whatever case its name is written in.

    Raises:
        ValueError: there is none.
    """
    known = {**RACK, **own}
    found = next((model for each, model in known.items() if each.upper() == name.upper()), None)
    if found is None:
        raise ValueError(f"there is no model {name!r}, only {', '.join(known)}")
    return found
