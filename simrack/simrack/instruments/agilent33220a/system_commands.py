"""DISPlay, SYSTem and STATus."""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.instruments.agilent33220a.declarations import nr3
from simrack.scpi import (
    Boolean,
    Choice,
    Command,
    Integer,
    Limits,
    ScpiError,
    Text,
    attribute,
    boolean,
    condition,
    enable,
    event,
    next_error,
    quoted,
    signed_integer,
)

if TYPE_CHECKING:
    from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A as _Model


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
    attribute("DISPlay", Boolean(), "panel.display", boolean),
    attribute("DISPlay:TEXT", Text(limit=40), "panel.text", quoted),
    Command("DISPlay:TEXT:CLEar", do=lambda model: setattr(model.panel, "text", "")),
    Command("SYSTem:BEEPer[:IMMediate]", do=lambda _: None),
    Command("SYSTem:ERRor:NEXT", query=next_error),  # of SCPI 1999.0, which it claims; unverified
    attribute("SYSTem:BEEPer:STATe", Boolean(), "panel.beep", boolean),
    attribute("SYSTem:KLOCk[:STATe]", Boolean(), "panel.lock", boolean),
    attribute("SYSTem:KLOCk:EXCLude", Choice(("NONE", "LOCal")), "panel.exclude", str),
    Command("SYSTem:VERSion", query=lambda _: "1999.0"),
    attribute("SYSTem:COMMunicate:RLSTate", Choice(("LOCal", "REMote", "RWLock")), "panel.remote"),
    attribute("SYSTem:COMMunicate:GPIB:ADDRess", Integer(limits=Limits(0, 30)), "panel.gpib", signed_integer),
    attribute("SYSTem:COMMunicate:LAN:DHCP[:STATe]", Boolean(), "panel.dhcp", boolean),
    attribute("SYSTem:COMMunicate:LAN:IPADdress", Text(limit=15), "panel.address", quoted),
    attribute("SYSTem:COMMunicate:LAN:SMASk", Text(limit=15), "panel.mask", quoted),
    attribute("SYSTem:COMMunicate:LAN:GATEway", Text(limit=15), "panel.gateway", quoted),
    attribute("SYSTem:COMMunicate:LAN:HOSTname", Text(limit=15), "panel.host", quoted),
    Command("SYSTem:COMMunicate:LAN:MAC", query=lambda _: '"0030D3002041"'),
    condition("STATus:QUEStionable:CONDition", lambda model: model.questionable),
    event("STATus:QUEStionable[:EVENt]", lambda model: model.questionable),
    enable("STATus:QUEStionable:ENABle", "questionable"),
    Command("STATus:PRESet", do=_preset_status),
)
