"""The external trigger input, calibration and files of the DSO7104B: settings and replies.

Words and learn strings are those of the siblings' guides (5000 and 6000 series, from memory; the 2000 X and 3000 X
guides for :EXTernal?), none was verified on a 7000B. There is no USB stick: commands
that need one say so with an error. The user calibration changes nothing.
"""

from __future__ import annotations

from typing import Any

from simrack import scpi
from simrack.instruments.dso7104b.declarations import learned, nothing
from simrack.instruments.dso7104b.instrument import SimulatedDso7104B
from simrack.scpi.lexer import Token, TokenKind

ROWS = scpi.Rows()

_CALIBRATED = {"DATE": (1, 1, 2026), "TIME": (12, 0, 0)}
"""When the user calibration was last done: day, month, year; hours, minutes, seconds."""


def _no_medium(_: SimulatedDso7104B, *arguments: object) -> None:
    """Nothing is plugged in that files could be on."""
    del arguments
    raise scpi.ScpiError(-252)


# --- the input EXTernal


@ROWS.query("EXTernal", reads=True)
def _external_learned(model: SimulatedDso7104B) -> str:
    own = model.state.external
    limit = scpi.boolean(own.bandwidth_limit)
    return f":EXT:BWL {limit};RANG {_short(own.range_v)};UNIT {own.unit};PROB {own.probe:+.3E}"


def _short(value: float) -> str:
    """Return a number with as few digits as it has: `+8E+00`."""
    mantissa, exponent = f"{value:+.5E}".split("E")
    return f"{mantissa.rstrip('0').rstrip('.')}E{exponent}"


_EXTERNAL = (
    scpi.attribute("EXTernal:BWLimit", scpi.Boolean(), "state.external.bandwidth_limit", scpi.boolean),
    scpi.attribute(
        "EXTernal:RANGe", scpi.Number(unit="V", limits=scpi.Limits(1.0, 8000.0)), "state.external.range_v", "nr3"
    ),
    scpi.attribute("EXTernal:PROBe", scpi.Number(limits=scpi.Limits(0.1, 1000.0)), "state.external.probe", "nr3"),
    scpi.Command("EXTernal:PROBe:ID", query=lambda _: "NONE", reads=True),
    scpi.attribute("EXTernal:PROBe:STYPe", scpi.Choice(("DIFFerential", "SINGle")), "state.external.probe_type"),
    scpi.attribute("EXTernal:UNITs", scpi.Choice(("VOLT", "AMPere")), "state.external.unit"),
    scpi.Command("EXTernal:IMPedance", query=lambda _: "ONEM", reads=True),
    scpi.Command("EXTernal:PROTection", query=lambda _: "NORM", reads=True),
)

# --- user calibration

_CALIBRATION = (
    scpi.Command(
        "CALibrate:DATE", query=lambda _: _CALIBRATED["DATE"], reply=scpi.comma_list(scpi.signed_integer), reads=True
    ),
    scpi.Command(
        "CALibrate:TIME", query=lambda _: _CALIBRATED["TIME"], reply=scpi.comma_list(scpi.signed_integer), reads=True
    ),
    scpi.attribute("CALibrate:LABel", scpi.Text(limit=32), "calibration_label", scpi.quoted),
    scpi.Command("CALibrate:STARt", do=nothing),
    scpi.Command("CALibrate:STATus", query=lambda _: '+0,"Calibrated"', reads=True),
    scpi.Command("CALibrate:SWITch", query=lambda _: "UNPR", reads=True),
    scpi.Command("CALibrate:TEMPerature", query=lambda model: model.nr3(0.0), reads=True),
)
"""A calibration takes nothing off the errors of the specimen."""

# --- files

_IMAGES = scpi.Choice(("TIFF", "BMP", "BMP24bit", "BMP8bit", "PNG", "NONE"))
_TRACES = scpi.Choice(("ALB", "ASCiixy", "CSV", "BINary", "NONE"))
_POINTS = scpi.Integer(limits=scpi.Limits(100, 8_000_000))
_PATH, _NAME = scpi.Text(limit=254), scpi.Text(limit=254, required=False)


class _PlaceOrName(scpi.Integer, frozen=True, kw_only=True):
    """A place of *SAV, or the name of a file (guides of the 2000 X and 3000 X; unverified on a 7000B)."""

    def parse(self, token: Token) -> Any:
        """Return the number of a place, or the characters of a name."""
        return _NAME.parse(token) if token.kind is TokenKind.STRING else super().parse(token)

    def settle(self, parsed: Any, model: Any) -> Any:
        """Return an int for a place, a str for a name."""
        return parsed if isinstance(parsed, str) else super().settle(parsed, model)


_PLACE_OR_NAME = _PlaceOrName(limits=scpi.Limits(0, 9), required=False)


def _save_setup(model: SimulatedDso7104B, place: int | str | None) -> None:
    if not isinstance(place, int):
        _no_medium(model)
    else:
        model.save(place)


def _recall_setup(model: SimulatedDso7104B, place: int | str | None) -> None:
    if not isinstance(place, int):
        _no_medium(model)
    else:
        model.recall(place)


_FILES = (
    learned("SAVE", ':SAVE:FIL "{0.save.name}";PWD "{0.save.folder}"'),
    learned("RECall", ':REC:FIL "{0.recall.name}";PWD "{0.recall.folder}"'),
    *(
        scpi.attribute(*row)
        for row in (
            ("SAVE:FILename", _PATH, "state.save.name", scpi.quoted),
            ("SAVE:PWD", _PATH, "state.save.folder", scpi.quoted),
            ("SAVE:IMAGe:AREA", scpi.Choice(("GRATicule", "SCReen")), "state.save.image_area"),
            ("SAVE:IMAGe:FACTors", scpi.Boolean(), "state.save.image_factors", scpi.boolean),
            ("SAVE:IMAGe:FORMat", _IMAGES, "state.save.image_format"),
            ("SAVE:IMAGe:INKSaver", scpi.Boolean(), "state.save.image_ink_saver", scpi.boolean),
            ("SAVE:IMAGe:PALette", scpi.Choice(("COLor", "GRAYscale", "MONochrome")), "state.save.image_palette"),
            ("SAVE:WAVeform:FORMat", _TRACES, "state.save.waveform_format"),
            ("SAVE:WAVeform:LENGth", _POINTS, "state.save.waveform_points", scpi.signed_integer),
            ("RECall:FILename", _PATH, "state.recall.name", scpi.quoted),
            ("RECall:PWD", _PATH, "state.recall.folder", scpi.quoted),
        )
    ),
    *(
        scpi.Command(f"{each}[:STARt]", (_NAME,), do=_no_medium)
        for each in ("SAVE:IMAGe", "SAVE:WAVeform", "RECall:IMAGe")
    ),
    scpi.Command("SAVE:SETup[:STARt]", (_PLACE_OR_NAME,), do=_save_setup),
    scpi.Command("RECall:SETup[:STARt]", (_PLACE_OR_NAME,), do=_recall_setup),
)
"""Setups are kept in places, as by *SAV, and by :SYSTem:SETup?; of files there are only the names."""

ACCESSORY_COMMANDS = (*ROWS, *_EXTERNAL, *_CALIBRATION, *_FILES)
"""Commands of :EXTernal, :CALibrate, :SAVE and :RECall."""
