"""DISPlay, SYSTem and STATus."""

from __future__ import annotations

from simrack import scpi
from simrack.instruments.agilent33220a.declarations import nr3
from simrack.instruments.agilent33220a.instrument import SimulatedAgilent33220A as _Model

_SECURED = "Calibration error; calibration memory is secured"

ROWS = scpi.Rows()


@ROWS.do("STATus:PRESet")
def _preset_status(model: _Model) -> None:
    model.questionable.enable = 0


@ROWS.query("CALibration[:ALL]", reply=scpi.signed_integer)
def _calibrate(model: _Model) -> int:
    """CALibration?: secured, it fails (error and answer unverified)."""
    model.engine.report(scpi.ScpiError(702, _SECURED))
    return 1


@ROWS.do(
    "CALibration:SECure:STATe",
    (scpi.Boolean(), scpi.Word()),
    query=lambda model: model.panel.secured,
    reply=scpi.boolean,
    reads=True,
)
def _secure(model: _Model, state: object, code: str) -> None:
    if code != model.panel.code:
        raise scpi.ScpiError(703, "Calibration error; secure code provided was invalid")
    model.panel.secured = bool(state)


@ROWS.attribute("CALibration:STRing", scpi.Text(limit=40), "panel.calibration", scpi.quoted)
def _set_calibration_text(model: _Model, text: str) -> None:
    _require_unsecured(model)
    model.panel.calibration = text


@ROWS.do("CALibration:SECure:CODE", (scpi.Word(),))
def _set_code(model: _Model, code: str) -> None:
    _require_unsecured(model)
    model.panel.code = code


def _require_unsecured(model: _Model) -> None:
    if model.panel.secured:
        raise scpi.ScpiError(702, _SECURED)


COMMANDS = (
    *ROWS,
    # it has no adjustments
    scpi.Command("CALibration:COUNt", query=lambda _: 1, reply=scpi.signed_integer, reads=True),
    scpi.Command("CALibration:VALue", query=lambda _: 0.0, reply=nr3, reads=True),
    scpi.attribute("DISPlay", scpi.Boolean(), "panel.display", scpi.boolean),
    scpi.attribute("DISPlay:TEXT", scpi.Text(limit=40), "panel.text", scpi.quoted),
    scpi.Command("DISPlay:TEXT:CLEar", do=lambda model: setattr(model.panel, "text", "")),
    scpi.Command("SYSTem:BEEPer[:IMMediate]", do=lambda _: None),
    scpi.Command("SYSTem:ERRor:NEXT", query=scpi.next_error),  # of SCPI 1999.0, which it claims; unverified
    scpi.attribute("SYSTem:BEEPer:STATe", scpi.Boolean(), "panel.beep", scpi.boolean),
    scpi.attribute("SYSTem:KLOCk[:STATe]", scpi.Boolean(), "panel.lock", scpi.boolean),
    scpi.attribute("SYSTem:KLOCk:EXCLude", scpi.Choice(("NONE", "LOCal")), "panel.exclude", str),
    scpi.Command("SYSTem:VERSion", query=lambda _: "1999.0", reads=True),
    scpi.attribute("SYSTem:COMMunicate:RLSTate", scpi.Choice(("LOCal", "REMote", "RWLock")), "panel.remote"),
    *(
        scpi.Command(f"SYSTem:{word}", do=lambda model, short=word[:3]: setattr(model.panel, "remote", short.upper()))
        for word in ("LOCal", "REMote", "RWLock")
    ),
    scpi.attribute(
        "SYSTem:COMMunicate:GPIB:ADDRess", scpi.Integer(limits=scpi.Limits(0, 30)), "panel.gpib", scpi.signed_integer
    ),
    scpi.attribute("SYSTem:COMMunicate:LAN:DHCP[:STATe]", scpi.Boolean(), "panel.dhcp", scpi.boolean),
    scpi.attribute("SYSTem:COMMunicate:LAN:IPADdress", scpi.Text(limit=15), "panel.address", scpi.quoted),
    scpi.attribute("SYSTem:COMMunicate:LAN:SMASk", scpi.Text(limit=15), "panel.mask", scpi.quoted),
    scpi.attribute("SYSTem:COMMunicate:LAN:GATEway", scpi.Text(limit=15), "panel.gateway", scpi.quoted),
    scpi.attribute("SYSTem:COMMunicate:LAN:HOSTname", scpi.Text(limit=15), "panel.host", scpi.quoted),
    scpi.Command("SYSTem:COMMunicate:LAN:MAC", query=lambda _: '"0030D3002041"', reads=True),
    scpi.condition("STATus:QUEStionable:CONDition", lambda model: model.questionable),
    scpi.event("STATus:QUEStionable[:EVENt]", lambda model: model.questionable),
    scpi.enable("STATus:QUEStionable:ENABle", "questionable"),
)
