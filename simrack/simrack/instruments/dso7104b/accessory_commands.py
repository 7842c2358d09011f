"""Cursors, the external trigger input, calibration, files and mask test of the DSO7104B: settings and what they answer.

Words and learn strings are those of the siblings' guides (5000 and 6000 series, from memory; the 2000 X and 3000 X
guides for :EXTernal?), none was verified on a 7000B. Nothing is measured by cursors or masks, there is no USB stick,
and the user calibration changes nothing: what would need one of them says so with an error.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.instruments.dso7104b.declarations import (
    OPTIONAL_SOURCE,
    SECONDS,
    SOURCE,
    VOLTS,
    SourceParameter,
    nothing,
    number,
    setting,
)
from simrack.scpi import (
    Boolean,
    Choice,
    Command,
    Integer,
    Limits,
    Number,
    ScpiError,
    Text,
    boolean,
    comma_list,
    quoted,
    signed_integer,
)

if TYPE_CHECKING:
    from simrack.instruments.dso7104b.instrument import SimulatedDso7104B

_CALIBRATED = {"DATE": (1, 1, 2026), "TIME": (12, 0, 0)}
"""When the user calibration was last done: day, month, year; hours, minutes, seconds."""


def _no_medium(_: SimulatedDso7104B, *arguments: object) -> None:
    """Nothing is plugged in that files could be on."""
    del arguments
    raise ScpiError(-252)


# --- cursors


def _marked(pattern: str, key: str, parameter: Number) -> Command:
    """Declare a cursor's place; setting one by hand turns manual cursors on (5000 series guide)."""

    def write(model: SimulatedDso7104B, place: float) -> None:
        model.state["MARK:MODE"] = "MAN"
        model.state[key] = place

    return Command(
        pattern, (parameter,), do=write, query=lambda model: model.nr3(model.state[key]), query_parameters=()
    )


def _distance(pattern: str, first: str, second: str) -> Command:
    return Command(pattern, query=lambda model: model.nr3(model.state[second] - model.state[first]))


def _set_marker_mode(model: SimulatedDso7104B, mode: str) -> None:
    """Turn cursors on; where none has a source yet they are the measurements'."""
    model.state["MARK:MODE"] = mode
    if mode != "OFF" and model.state["MARK:X1Y1"] == "NONE":
        model.state["MARK:X1Y1"] = model.state["MARK:X2Y2"] = model.state["MEAS:SOUR"][0]


def _markers_learned(model: SimulatedDso7104B) -> str:
    state = model.state
    return f":MARK:X1Y1 {state['MARK:X1Y1']};X2Y2 {state['MARK:X2Y2']};MODE {state['MARK:MODE']}"


_MARKERS = (
    Command("MARKer", query=_markers_learned),
    Command(
        "MARKer:MODE",
        (Choice(("OFF", "MEASurement", "MANual")),),
        do=_set_marker_mode,
        query=lambda model: model.state["MARK:MODE"],
    ),
    setting("MARKer:X1Y1source", "MARK:X1Y1", SourceParameter(words=("CHANnel<1-4>", "FUNCtion", "MATH", "NONE"))),
    setting("MARKer:X2Y2source", "MARK:X2Y2", SourceParameter(words=("CHANnel<1-4>", "FUNCtion", "MATH", "NONE"))),
    _marked("MARKer:X1Position", "MARK:X1", SECONDS),
    _marked("MARKer:X2Position", "MARK:X2", SECONDS),
    _marked("MARKer:Y1Position", "MARK:Y1", VOLTS),
    _marked("MARKer:Y2Position", "MARK:Y2", VOLTS),
    _distance("MARKer:XDELta", "MARK:X1", "MARK:X2"),
    _distance("MARKer:YDELta", "MARK:Y1", "MARK:Y2"),
)

# --- the input EXTernal


def _external_learned(model: SimulatedDso7104B) -> str:
    state = model.state
    return (
        f":EXT:BWL {boolean(state['EXT:BWL'])};RANG {_short(state['EXT:RANG'])};UNIT {state['EXT:UNIT']};"
        f"PROB {state['EXT:PROB']:+.3E}"
    )


def _short(value: float) -> str:
    """Return a number with as few digits as it has: `+8E+00`."""
    mantissa, exponent = f"{value:+.5E}".split("E")
    return f"{mantissa.rstrip('0').rstrip('.')}E{exponent}"


_EXTERNAL = (
    Command("EXTernal", query=_external_learned),
    setting("EXTernal:BWLimit", "EXT:BWL", Boolean(), boolean),
    number("EXTernal:RANGe", "EXT:RANG", Number(unit="V", limits=Limits(1.0, 8000.0))),
    number("EXTernal:PROBe", "EXT:PROB", Number(limits=Limits(0.1, 1000.0))),
    Command("EXTernal:PROBe:ID", query=lambda _: "NONE"),
    setting("EXTernal:PROBe:STYPe", "EXT:STYP", Choice(("DIFFerential", "SINGle"))),
    setting("EXTernal:UNITs", "EXT:UNIT", Choice(("VOLT", "AMPere"))),
    Command("EXTernal:IMPedance", query=lambda _: "ONEM"),
    Command("EXTernal:PROTection", query=lambda _: "NORM"),
)

# --- user calibration


def _set_label(model: SimulatedDso7104B, label: str) -> None:
    model.calibration_label = label


_CALIBRATION = (
    Command("CALibrate:DATE", query=lambda _: _CALIBRATED["DATE"], reply=comma_list(signed_integer)),
    Command("CALibrate:TIME", query=lambda _: _CALIBRATED["TIME"], reply=comma_list(signed_integer)),
    Command(
        "CALibrate:LABel",
        (Text(limit=32),),
        do=_set_label,
        query=lambda model: model.calibration_label,
        query_parameters=(),
        reply=quoted,
    ),
    Command("CALibrate:STARt", do=nothing),
    Command("CALibrate:STATus", query=lambda _: '+0,"Calibrated"'),
    Command("CALibrate:SWITch", query=lambda _: "UNPR"),
    Command("CALibrate:TEMPerature", query=lambda model: model.nr3(0.0)),
)
"""A calibration takes nothing off the errors of the specimen."""

# --- files


def _saving_learned(model: SimulatedDso7104B) -> str:
    state = model.state
    return f':SAVE:FIL "{state["SAVE:FIL"]}";PWD "{state["SAVE:PWD"]}"'


def _recalling_learned(model: SimulatedDso7104B) -> str:
    return f':REC:FIL "{model.state["REC:FIL"]}";PWD "{model.state["REC:PWD"]}"'


_PATH, _NAME = Text(limit=254), Text(limit=254, required=False)

_FILES = (
    Command("SAVE", query=_saving_learned),
    setting("SAVE:FILename", "SAVE:FIL", _PATH, quoted),
    setting("SAVE:PWD", "SAVE:PWD", _PATH, quoted),
    setting("SAVE:IMAGe:AREA", "SAVE:IMAG:AREA", Choice(("GRATicule", "SCReen"))),
    setting("SAVE:IMAGe:FACTors", "SAVE:IMAG:FACT", Boolean(), boolean),
    setting("SAVE:IMAGe:FORMat", "SAVE:IMAG:FORM", Choice(("TIFF", "BMP", "BMP24bit", "BMP8bit", "PNG", "NONE"))),
    setting("SAVE:IMAGe:INKSaver", "SAVE:IMAG:INKS", Boolean(), boolean),
    setting("SAVE:IMAGe:PALette", "SAVE:IMAG:PAL", Choice(("COLor", "GRAYscale", "MONochrome"))),
    setting("SAVE:WAVeform:FORMat", "SAVE:WAV:FORM", Choice(("ALB", "ASCiixy", "CSV", "BINary", "NONE"))),
    setting("SAVE:WAVeform:LENGth", "SAVE:WAV:LENG", Integer(limits=Limits(100, 8_000_000)), signed_integer),
    Command("SAVE:IMAGe[:STARt]", (_NAME,), do=_no_medium),
    Command("SAVE:SETup[:STARt]", (_NAME,), do=_no_medium),
    Command("SAVE:WAVeform[:STARt]", (_NAME,), do=_no_medium),
    Command("SAVE:MASK[:STARt]", (_NAME,), do=_no_medium),
    Command("RECall", query=_recalling_learned),
    setting("RECall:FILename", "REC:FIL", _PATH, quoted),
    setting("RECall:PWD", "REC:PWD", _PATH, quoted),
    Command("RECall:IMAGe[:STARt]", (_NAME,), do=_no_medium),
    Command("RECall:SETup[:STARt]", (_NAME,), do=_no_medium),
    Command("RECall:MASK[:STARt]", (_NAME,), do=_no_medium),
)
"""Setups are kept by *SAV and :SYSTem:SETup?; of files there are only the names."""

# --- mask test

_DELTA = Number()

_MASKS = (
    setting("MTESt:ENABle", "MTES:ENAB", Boolean(), boolean),
    setting("MTESt:LOCK", "MTES:LOCK", Boolean(), boolean),
    setting("MTESt:SOURce", "MTES:SOUR", SOURCE),
    setting("MTESt:AMASk:SOURce", "MTES:AMAS:SOUR", SOURCE),
    setting("MTESt:AMASk:UNITs", "MTES:AMAS:UNIT", Choice(("CURRent", "DIVisions"))),
    number("MTESt:AMASk:XDELta", "MTES:AMAS:XDEL", _DELTA),
    number("MTESt:AMASk:YDELta", "MTES:AMAS:YDEL", _DELTA),
    Command("MTESt:AMASk:CREate", do=nothing),
    Command("MTESt:DELete", do=nothing),
    Command("MTESt:COUNt:RESet", do=nothing),
    Command("MTESt:COUNt:TIME", query=lambda model: model.nr3(0.0)),
    Command("MTESt:COUNt:WAVeforms", query=lambda _: 0, reply=signed_integer),
    Command("MTESt:COUNt:FWAVeforms", query=lambda *_: 0, query_parameters=(OPTIONAL_SOURCE,), reply=signed_integer),
    setting("MTESt:RMODe", "MTES:RMOD", Choice(("FORever", "TIME", "SIGMa", "WAVeforms"))),
    number("MTESt:RMODe:SIGMa", "MTES:RMOD:SIGM", Number(limits=Limits(0.1, 9.3))),
    number("MTESt:RMODe:TIME", "MTES:RMOD:TIME", Number(unit="S", limits=Limits(1.0, 1e6))),
    setting("MTESt:RMODe:WAVeforms", "MTES:RMOD:WAV", Integer(limits=Limits(1, 1_000_000_000)), signed_integer),
    setting("MTESt:RMODe:FACTion:STOP", "MTES:RMOD:STOP", Boolean(), boolean),
    setting("MTESt:SCALe:BIND", "MTES:SCAL:BIND", Boolean(), boolean),
    number("MTESt:SCALe:X1", "MTES:SCAL:X1", SECONDS),
    number("MTESt:SCALe:XDELta", "MTES:SCAL:XDEL", SECONDS),
    number("MTESt:SCALe:Y1", "MTES:SCAL:Y1", VOLTS),
    number("MTESt:SCALe:Y2", "MTES:SCAL:Y2", VOLTS),
    Command("MTESt:TITLe", query=lambda _: "", reply=quoted),
)
"""No waveform is ever compared with a mask: none has been tested, none has failed."""

ACCESSORY_COMMANDS = (*_MARKERS, *_EXTERNAL, *_CALIBRATION, *_FILES, *_MASKS)
"""What is said to :MARKer, :EXTernal, :CALibrate, :SAVE, :RECall and :MTESt."""
