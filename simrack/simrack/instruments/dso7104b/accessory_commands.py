"""The external trigger input, calibration and files of the DSO7104B: settings and replies.

Words and learn strings are those of the siblings' guides (5000 and 6000 series, from memory; the 2000 X and 3000 X
guides for :EXTernal?), none was verified on a 7000B. There is no USB stick: commands
that need one say so with an error. The user calibration changes nothing.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.instruments.dso7104b.declarations import (
    nothing,
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
    attribute,
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
    own = model.state.external
    limit = boolean(own.bandwidth_limit)
    return f":EXT:BWL {limit};RANG {_short(own.range_v)};UNIT {own.unit};PROB {own.probe:+.3E}"


def _short(value: float) -> str:
    """Return a number with as few digits as it has: `+8E+00`."""
    mantissa, exponent = f"{value:+.5E}".split("E")
    return f"{mantissa.rstrip('0').rstrip('.')}E{exponent}"


_EXTERNAL = (
    Command("EXTernal", query=_external_learned),
    attribute("EXTernal:BWLimit", Boolean(), "state.external.bandwidth_limit", boolean),
    attribute("EXTernal:RANGe", Number(unit="V", limits=Limits(1.0, 8000.0)), "state.external.range_v", "nr3"),
    attribute("EXTernal:PROBe", Number(limits=Limits(0.1, 1000.0)), "state.external.probe", "nr3"),
    Command("EXTernal:PROBe:ID", query=lambda _: "NONE"),
    attribute("EXTernal:PROBe:STYPe", Choice(("DIFFerential", "SINGle")), "state.external.probe_type"),
    attribute("EXTernal:UNITs", Choice(("VOLT", "AMPere")), "state.external.unit"),
    Command("EXTernal:IMPedance", query=lambda _: "ONEM"),
    Command("EXTernal:PROTection", query=lambda _: "NORM"),
)

# --- user calibration


_CALIBRATION = (
    Command("CALibrate:DATE", query=lambda _: _CALIBRATED["DATE"], reply=comma_list(signed_integer)),
    Command("CALibrate:TIME", query=lambda _: _CALIBRATED["TIME"], reply=comma_list(signed_integer)),
    attribute("CALibrate:LABel", Text(limit=32), "calibration_label", quoted),
    Command("CALibrate:STARt", do=nothing),
    Command("CALibrate:STATus", query=lambda _: '+0,"Calibrated"'),
    Command("CALibrate:SWITch", query=lambda _: "UNPR"),
    Command("CALibrate:TEMPerature", query=lambda model: model.nr3(0.0)),
)
"""A calibration takes nothing off the errors of the specimen."""

# --- files


def _saving_learned(model: SimulatedDso7104B) -> str:
    state = model.state
    return f':SAVE:FIL "{state.save.name}";PWD "{state.save.folder}"'


def _recalling_learned(model: SimulatedDso7104B) -> str:
    return f':REC:FIL "{model.state.recall.name}";PWD "{model.state.recall.folder}"'


_PATH, _NAME = Text(limit=254), Text(limit=254, required=False)

_FILES = (
    Command("SAVE", query=_saving_learned),
    attribute("SAVE:FILename", _PATH, "state.save.name", quoted),
    attribute("SAVE:PWD", _PATH, "state.save.folder", quoted),
    attribute("SAVE:IMAGe:AREA", Choice(("GRATicule", "SCReen")), "state.save.image_area"),
    attribute("SAVE:IMAGe:FACTors", Boolean(), "state.save.image_factors", boolean),
    attribute(
        "SAVE:IMAGe:FORMat", Choice(("TIFF", "BMP", "BMP24bit", "BMP8bit", "PNG", "NONE")), "state.save.image_format"
    ),
    attribute("SAVE:IMAGe:INKSaver", Boolean(), "state.save.image_ink_saver", boolean),
    attribute("SAVE:IMAGe:PALette", Choice(("COLor", "GRAYscale", "MONochrome")), "state.save.image_palette"),
    attribute(
        "SAVE:WAVeform:FORMat", Choice(("ALB", "ASCiixy", "CSV", "BINary", "NONE")), "state.save.waveform_format"
    ),
    attribute(
        "SAVE:WAVeform:LENGth", Integer(limits=Limits(100, 8_000_000)), "state.save.waveform_points", signed_integer
    ),
    Command("SAVE:IMAGe[:STARt]", (_NAME,), do=_no_medium),
    Command("SAVE:SETup[:STARt]", (_NAME,), do=_no_medium),
    Command("SAVE:WAVeform[:STARt]", (_NAME,), do=_no_medium),
    Command("RECall", query=_recalling_learned),
    attribute("RECall:FILename", _PATH, "state.recall.name", quoted),
    attribute("RECall:PWD", _PATH, "state.recall.folder", quoted),
    Command("RECall:IMAGe[:STARt]", (_NAME,), do=_no_medium),
    Command("RECall:SETup[:STARt]", (_NAME,), do=_no_medium),
)
"""Setups are kept by *SAV and :SYSTem:SETup?; of files there are only the names."""

ACCESSORY_COMMANDS = (*_EXTERNAL, *_CALIBRATION, *_FILES)
"""Commands of :EXTernal, :CALibrate, :SAVE and :RECall."""
