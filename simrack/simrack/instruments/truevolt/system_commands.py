"""Display, beeper, identity and status of the Truevolt series (guide p. 269)."""

from __future__ import annotations

from simrack import scpi
from simrack.instruments.truevolt.instrument import SimulatedTruevolt
from simrack.instruments.truevolt.kinds import MeterKind

_SELF_TEST_S = 2.0
"""*TST? (unverified)."""
_WHOLE_TEST_S = 10.0
"""TEST:ALL? (unverified)."""
_STATES = scpi.Integer(limits=scpi.Limits(0, 4))
_TEXT_LIMIT = 40
"""Characters on the display (users' drivers)."""


def preset_status(meter: SimulatedTruevolt) -> None:
    """STATus:PRESet: no event is summed up."""
    for register in meter.engine.status.summaries.values():
        register.enable = 0


def _identities(kind: MeterKind) -> tuple[str, ...]:
    """Return the words of SYSTem:IDENtify (p. 270)."""
    older = ("HP34401A", "AT34461A") if kind.model == "34461A" else ("HP34401A", "AT34410A", "AT34411A")
    return ("DEFault", *older)


def _clock(word: str, shown: str) -> scpi.Command:
    """Declare a part of the clock, which stands still: three numbers (form: help page of SYSTem, users' drivers)."""

    def write(meter: SimulatedTruevolt, *numbers: float) -> None:
        meter.engine.remembered[word,] = ",".join(f"{each:g}" for each in numbers)

    numbers = (scpi.Number(),) * 3
    return scpi.Command(
        f"SYSTem:{word}", numbers, do=write, query=lambda m: m.engine.remembered.get((word,), shown), reads=True
    )


def _up_time(meter: SimulatedTruevolt) -> str:
    """Return days, hours, minutes, seconds (users' drivers)."""
    minutes, seconds = divmod(int(meter.clock.now()), 60)
    return ",".join(scpi.signed_integer(each) for each in (minutes // 1440, minutes // 60 % 24, minutes % 60, seconds))


def _lan() -> tuple[scpi.Command, ...]:
    """Return the settings of its network port, which change nothing here; their defaults are unverified."""
    lan, addresses = "SYSTem:COMMunicate:LAN:", ("IPADdress", "SMASk", "GATeway", "DNS<1-2>", "WINS<1-2>")
    return (
        scpi.remembered(f"{lan}DHCP", scpi.Boolean(), default=True, reply=scpi.boolean),
        scpi.remembered(f"{lan}HOSTname", scpi.Text(limit=15), "K-34461A-00001", scpi.quoted),
        *(scpi.remembered(f"{lan}{each}", scpi.Text(limit=15), "0.0.0.0", scpi.quoted) for each in addresses),  # noqa: S104  (what a box says that has none)
        scpi.Command(f"{lan}DOMain", query=lambda _: "", reply=scpi.quoted, reads=True),
        scpi.Command(f"{lan}MAC", query=lambda _: "0030D3000001", reply=scpi.quoted, reads=True),
        scpi.Command(f"{lan}CONTrol", query=lambda _: 0, reply=scpi.signed_integer, reads=True),
        scpi.Command(f"{lan}UPDate", do=lambda _: None),
    )


def commands(kind: MeterKind) -> tuple[scpi.Command, ...]:
    """Return the system commands of a model."""
    return (
        scpi.attribute("DISPlay[:STATe]", scpi.Boolean(), "display_on", scpi.boolean),
        scpi.attribute(
            "DISPlay:TEXT[:DATA]", scpi.Text(), "display_text", scpi.quoted, convert=lambda text: text[:_TEXT_LIMIT]
        ),
        scpi.Command("DISPlay:TEXT:CLEar", do=lambda meter: setattr(meter, "display_text", "")),
        scpi.Command("ROUTe:TERMinals", query=lambda meter: "REAR" if meter.rear else "FRON", reads=True),
        scpi.Command("SYSTem:BEEPer[:IMMediate]", do=lambda _: None),
        scpi.attribute("SYSTem:BEEPer:STATe", scpi.Boolean(), "beeper", scpi.boolean),
        scpi.attribute("SYSTem:IDENtify", scpi.Choice(_identities(kind)), "identifies_as"),
        _clock("DATE", "2026,1,1"),
        _clock("TIME", "12,0,0.000"),
        scpi.Command("SYSTem:UPTime", query=_up_time, reads=True),
        scpi.Command("SYSTem:TEMPerature", query=lambda _meter: 30.0, reply=scpi.real(8), reads=True),
        scpi.remembered("SYSTem:LABel", scpi.Text(limit=_TEXT_LIMIT), "", scpi.quoted),
        scpi.remembered("SYSTem:CLICk:STATe", scpi.Boolean(), default=True, reply=scpi.boolean),
        scpi.Command("SYSTem:LFRequency", query=lambda meter: f"{meter.line_hz:+d}", reads=True),
        scpi.Command("SYSTem:LICense:CATalog", query=lambda _meter: '""', reads=True),
        scpi.Command("SYSTem:LOCal", do=lambda _: None),
        scpi.Command("SYSTem:PRESet", do=scpi.reset),
        scpi.Command("SYSTem:VERSion", query=lambda _meter: "1994.0", reads=True),
        scpi.Command("*SAV", (_STATES,), do=lambda meter, place: meter.save(place)),
        scpi.Command("*RCL", (_STATES,), do=lambda meter, place: meter.recall(place)),
        scpi.Command("*OPT", query=lambda _meter: "0,0,0", reads=True),
        scpi.Command("*TST", query=lambda meter: meter.forget() or "+0", query_takes_s=_SELF_TEST_S),
        scpi.Command("TEST:ALL", query=lambda meter: meter.forget() or "+0", query_takes_s=_WHOLE_TEST_S),
        *_lan(),
        *scpi.status_commands("OPERation", "operation"),
        *scpi.status_commands("QUEStionable", "questionable"),
        scpi.remembered("FORMat:BORDer", scpi.Choice(("NORMal", "SWAPped")), "NORM"),
        scpi.Command("SYSTem:ERRor:NEXT", query=scpi.next_error),
        # of CALibration the queries: it stays secured; values of a unit that was calibrated once
        scpi.Command("CALibration:COUNt", query=lambda _meter: 1, reply=scpi.signed_integer, reads=True),
        scpi.Command("CALibration:SECure:STATe", query=lambda _meter: True, reply=scpi.boolean, reads=True),
        scpi.Command("CALibration:STRing", query=lambda _meter: "", reply=scpi.quoted, reads=True),
        scpi.remembered("OUTPut:TRIGger:SLOPe", scpi.Choice(("POSitive", "NEGative")), "NEG"),
        scpi.Command("STATus:PRESet", do=preset_status),
    )
