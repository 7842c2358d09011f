"""The simulated instruments by the name on the box: class, wires, terminals, and the list of their manual."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import MappingProxyType
from typing import Any, Final, Literal

from msgspec import Struct, field

Kind = Literal["supply", "generator", "multimeter", "oscilloscope", "chamber", "rate table", "own", "box", "adapter"]

_SERIAL = ("TCP", "serial line")
_LXI = ("TCP", "VXI-11", "HiSLIP")
_OLDER_LXI = ("TCP", "VXI-11")


class SimulatedModel(Struct, frozen=True):
    """A model.

    Args:
        name: what is on the box; of a rate table its language.
        kind: what it is.
        twin: its class, or what makes it, below `simrack`.
        wires: what it is served on in addition to PyVISA in its own process, TCP as labs have it on converters.
        index: file in `simrack/manuals` with the headers of its manual or, where that was not at hand, of drivers and
            notes, as its first line says; and how many drivers use one. Empty of what has no list.
        text: the module whose docstring says from which sources it is written, and what is unverified; `instrument`
            beside its class without it.
        own: what else its class is made with.
    """

    name: str
    kind: Kind
    twin: str
    wires: tuple[str, ...]
    index: str = ""
    text: str = ""
    own: Mapping[str, float] = field(default_factory=dict)

    def load(self) -> Any:
        """Return its class."""
        module, _, name = self.twin.partition(":")
        found = getattr(import_module(f"simrack.{module}"), name)
        return found.of_model(self.name, **self.own) if hasattr(found, "of_model") else found

    @property
    def outputs(self) -> tuple[str, ...]:
        """Its terminals that feed nodes."""
        two = "sine_hz" in self.own and int(self.name[4]) % 2 == 0
        count = {"supply": 3, "generator": 2 if two else 1}.get(self.kind, 0)
        return tuple(f"output_{number}" for number in range(1, count + 1))

    @property
    def inputs(self) -> tuple[str, ...]:
        """Its terminals that look at nodes."""
        if self.kind == "oscilloscope":
            return ("channel_1", "channel_2", "channel_3", "channel_4")
        return ("input",) if self.kind == "multimeter" else ()

    def description(self) -> str:
        """Return the module's notes on sources and on missing functions."""
        return import_module(f"simrack.{self.text or self.twin.partition(':')[0] + '.instrument'}").__doc__ or ""


def _table(name: str, module: str, twin: str) -> SimulatedModel:
    module = f"rate_tables.{module}"
    return SimulatedModel(name, "rate table", f"{module}:{twin}", _SERIAL, text=module)


_33220A, _TRUEFORM, _ATS545 = (f"instruments.{each}" for each in ("agilent33220a", "trueform:TrueformTwin", "ats545"))
_TRUEVOLT, _KEITHLEY = "instruments.truevolt:TruevoltTwin", "instruments.keithley"
_DSO, _X_SERIES = "instruments.dso7104b:Dso7104BTwin", "instruments.infiniivision:InfiniiVisionXTwin"
_TRUEFORMS_HZ = {
    **dict.fromkeys(("33509B", "33510B", "33511B", "33512B"), 20e6),
    **dict.fromkeys(("33521B", "33522B"), 30e6),
    **dict.fromkeys(("33611A", "33612A"), 80e6),
    **dict.fromkeys(("33621A", "33622A"), 120e6),
}
_ALL = (
    SimulatedModel("E3631A", "supply", "instruments.e3631a:E3631ATwin", _SERIAL, "E3631A.txt"),
    SimulatedModel("E36312A", "supply", "instruments.e36312a:E36312ATwin", _LXI, "E36312A.txt"),
    SimulatedModel("33220A", "generator", f"{_33220A}:Agilent33220ATwin", _OLDER_LXI, "33220A.txt"),
    *(
        SimulatedModel(name, "generator", _TRUEFORM, _LXI, "Trueform.txt", own={"sine_hz": sine_hz})
        for name, sine_hz in _TRUEFORMS_HZ.items()
    ),
    SimulatedModel("34401A", "multimeter", "instruments.hp34401a:Hp34401ATwin", _SERIAL, "34401A.txt"),
    *(SimulatedModel(name, "multimeter", _TRUEVOLT, _LXI, "Truevolt.txt") for name in ("34461A", "34465A")),
    SimulatedModel("2000", "multimeter", f"{_KEITHLEY}:Keithley2000Twin", _SERIAL, "2000.txt", f"{_KEITHLEY}.k2000"),
    SimulatedModel(
        *("DMM6500", "multimeter", f"{_KEITHLEY}:KeithleyDMM6500Twin"),
        *(_OLDER_LXI, "DMM6500.txt", f"{_KEITHLEY}.dmm6500"),
    ),
    SimulatedModel("DSO7104B", "oscilloscope", _DSO, _OLDER_LXI, "7000B.txt"),
    *(
        SimulatedModel(name, "oscilloscope", _X_SERIES, _OLDER_LXI, "InfiniiVisionX.txt")
        for name in ("DSOX3024A", "MSOX3104T", "DSOX4104A")
    ),
    SimulatedModel("ATS-545", "chamber", f"{_ATS545}:TemptronicATS545Twin", _SERIAL, text=_ATS545),
    _table("ACL", "acl.instrument", "AclTable"),
    _table("Zaber", "zaber", "ZaberTable"),
    _table("ATL", "atl", "AtlTable"),
    _table("ESP", "esp", "EspTable"),
    _table("DD16", "dd16", "Dd16Table"),
    _table("MN-AS", "mn_as", "MnAsTable"),
    _table("RUYA", "ruya", "RuyaTable"),
    _table("AAAA", "aaaa", "AaaaTable"),
)
RACK: Final[Mapping[str, SimulatedModel]] = {model.name: model for model in _ALL}
"""All that `simrack serve` knows by name."""
MODELS: Final[Mapping[str, SimulatedModel]] = {name: model for name, model in RACK.items() if model.index}
"""Those of which a list of headers is at hand."""


def model_named(name: str, own: Mapping[str, SimulatedModel] = MappingProxyType({})) -> SimulatedModel:
    """Return a built-in or a custom model, by its name in any case.

    Raises:
        ValueError: there is none.
    """
    known = {**RACK, **own}
    found = next((model for each, model in known.items() if each.upper() == name.upper()), None)
    if found is None:
        raise ValueError(f"unknown model {name!r}; expected one of {', '.join(known)}")
    return found
