"""DISPlay, SYSTem and STATus."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from simrack.instruments.agilent33220a.declarations import nr3
from simrack.scpi import (
    Boolean,
    Choice,
    Command,
    Integer,
    Limits,
    Parameter,
    ScpiError,
    Text,
    boolean,
    condition,
    enable,
    event,
    next_error,
    quoted,
    signed_integer,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A as _Model


def _panel(pattern: str, key: str, parameter: Parameter, reply: Callable[[Any], str]) -> Command:
    def write(model: _Model, value: Any) -> None:
        model.panel[key] = value

    return Command(pattern, (parameter,), do=write, query=lambda model: model.panel[key], reply=reply)


def _preset_status(model: _Model) -> None:
    model.questionable.enable = 0


def _calibrate(model: _Model) -> int:
    """CALibration?: secured, it fails (error and answer unverified)."""
    model.engine.report(ScpiError(702, "Calibration error; calibration memory is secured"))
    return 1


COMMANDS = (
    # of CALibration the queries: this one stays secured, and has no adjustments
    Command("CALibration[:ALL]", query=_calibrate, reply=signed_integer),
    Command("CALibration:COUNt", query=lambda _: 1, reply=signed_integer),
    Command("CALibration:SECure:STATe", query=lambda _: True, reply=boolean),
    Command("CALibration:STRing", query=lambda _: "", reply=quoted),
    Command("CALibration:VALue", query=lambda _: 0.0, reply=nr3),
    _panel("DISPlay", "display", Boolean(), boolean),
    _panel("DISPlay:TEXT", "text", Text(limit=40), quoted),
    Command("DISPlay:TEXT:CLEar", do=lambda model: model.panel.update(text="")),
    Command("SYSTem:BEEPer[:IMMediate]", do=lambda _: None),
    Command("SYSTem:ERRor:NEXT", query=next_error),  # of SCPI 1999.0, which it claims; unverified
    _panel("SYSTem:BEEPer:STATe", "beep", Boolean(), boolean),
    _panel("SYSTem:KLOCk[:STATe]", "lock", Boolean(), boolean),
    _panel("SYSTem:KLOCk:EXCLude", "exclude", Choice(("NONE", "LOCal")), str),
    Command("SYSTem:VERSion", query=lambda _: "1999.0"),
    Command(
        "SYSTem:COMMunicate:RLSTate",
        (Choice(("LOCal", "REMote", "RWLock")),),
        do=lambda model, state: setattr(model, "remote", state),
        query=lambda model: model.remote,
    ),
    _panel("SYSTem:COMMunicate:GPIB:ADDRess", "gpib", Integer(limits=Limits(0, 30)), signed_integer),
    _panel("SYSTem:COMMunicate:LAN:DHCP[:STATe]", "dhcp", Boolean(), boolean),
    _panel("SYSTem:COMMunicate:LAN:IPADdress", "address", Text(limit=15), quoted),
    _panel("SYSTem:COMMunicate:LAN:SMASk", "mask", Text(limit=15), quoted),
    _panel("SYSTem:COMMunicate:LAN:GATEway", "gateway", Text(limit=15), quoted),
    _panel("SYSTem:COMMunicate:LAN:HOSTname", "host", Text(limit=15), quoted),
    Command("SYSTem:COMMunicate:LAN:MAC", query=lambda _: '"0030D3002041"'),
    condition("STATus:QUEStionable:CONDition", lambda model: model.questionable),
    event("STATus:QUEStionable[:EVENt]", lambda model: model.questionable),
    enable("STATus:QUEStionable:ENABle", lambda model: model.questionable),
    Command("STATus:PRESet", do=_preset_status),
)
