"""The external trigger input, calibration and files of the DSO7104B: settings and replies.

Words and learn strings are those of the siblings' guides (5000 and 6000 series, from memory; the 2000 X and 3000 X
guides for :EXTernal?), none was verified on a 7000B. There is no USB stick: commands
that need one say so with an error. The user calibration changes nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.instruments.dso7104b.declarations import (
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
    Command("RECall", query=_recalling_learned),
    setting("RECall:FILename", "REC:FIL", _PATH, quoted),
    setting("RECall:PWD", "REC:PWD", _PATH, quoted),
    Command("RECall:IMAGe[:STARt]", (_NAME,), do=_no_medium),
    Command("RECall:SETup[:STARt]", (_NAME,), do=_no_medium),
)
"""Setups are kept by *SAV and :SYSTem:SETup?; of files there are only the names."""

ACCESSORY_COMMANDS = (*_EXTERNAL, *_CALIBRATION, *_FILES)
"""Commands of :EXTernal, :CALibrate, :SAVE and :RECall."""
