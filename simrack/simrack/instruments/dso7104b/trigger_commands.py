"""Trigger commands of the DSO7104B; the trigger that their settings mean makes :mod:`.trigger_settings`.

Formats and limits of pattern and duration are those of the 5000 and 6000 series programmer's guides, widths of pulses
those of the 7000B user's guide (p. 129), the range of levels that of the 3000T guide. Unverified: that a level belongs
to its channel in every mode, EBURst's source and limits, the words of SEQuence, what serial modes without their option
answer.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from simrack.instruments.dso7104b.declarations import CHANNEL, clipped, number, setting
from simrack.scpi import (
    Boolean,
    Choice,
    Command,
    Integer,
    Limits,
    Number,
    Parameter,
    ScpiError,
    boolean,
    comma_list,
    signed_integer,
)
from simrack.scpi.lexer import Token, TokenKind

if TYPE_CHECKING:
    from collections.abc import Callable

    from simrack.instruments.dso7104b.instrument import SimulatedDso7104B

_OPTIONS = ("FLEXray", "I2S", "M1553", "UART")
"""Serial modes that come with options; the others are standard (data sheet, from memory)."""
_SERIAL = ("CAN", "IIC", "LIN", "SPI", "USB")
_EXTERNAL_REACH_V = 8.0


class _Bits(Parameter, frozen=True):
    """An integer, or one as a string: "0x1F"."""

    def parse(self, token: Token) -> int:
        """Return the integer; -224 for a string that is none."""
        if token.kind is TokenKind.NUMBER:
            return round(token.number)
        if token.kind is not TokenKind.STRING:
            raise self.refuse_kind(token)
        try:
            return int(token.text, 16)
        except ValueError:
            raise ScpiError(-224) from None


def _set_mode(model: SimulatedDso7104B, mode: str) -> None:
    """Choose the mode; those of options that are not installed are refused (number unverified)."""
    if mode in {Choice((option,)).mnemonics[0].short for option in _OPTIONS}:
        raise ScpiError(-241)
    model.state["TRIG:MODE"] = mode


def _reach(model: SimulatedDso7104B, source: str) -> tuple[float, float]:
    """Return the lowest and the highest level: 0.75 of full scale about the centre of the screen."""
    if not source.startswith("CHAN"):
        return -_EXTERNAL_REACH_V, _EXTERNAL_REACH_V
    centre, reach = model.state[f"{source}:OFFS"], 0.75 * model.state[f"{source}:RANG"]
    return centre - reach, centre + reach


def _level(pattern: str, source_key: str) -> Command:
    """Declare the level of a mode's source, or of the one that is named."""

    def write(model: SimulatedDso7104B, volts: float, source: str | None) -> None:
        named = source or model.state[source_key]
        model.state[f"LEV:{named}"] = clipped(model, volts, *_reach(model, named))

    return Command(
        pattern,
        (Number(unit="V"), Choice(("CHANnel<1-4>", "EXTernal"), required=False)),
        do=write,
        query=lambda model, source: model.nr3(model.state[f"LEV:{source or model.state[source_key]}"]),
        query_parameters=(Choice(("CHANnel<1-4>", "EXTernal"), required=False),),
    )


def _set_reject(model: SimulatedDso7104B, word: str) -> None:
    """Turn one filter on and the other off; LF is the coupling of that name."""
    model.state["TRIG:HFR"] = word == "HF"
    if word == "LF":
        model.state["TRIG:COUP"] = "LFR"
    elif model.state["TRIG:COUP"] == "LFR":
        model.state["TRIG:COUP"] = "DC"


def _reject(model: SimulatedDso7104B) -> str:
    if model.state["TRIG:COUP"] == "LFR":
        return "LF"
    return "HF" if model.state["TRIG:HFR"] else "OFF"


def _set_pattern(model: SimulatedDso7104B, value: int, mask: int, source: str | None, slope: str | None) -> None:
    """Take value and mask, with or without source and slope of an edge: both or none."""
    if (source is None) != (slope is None):
        raise ScpiError(-109)
    model.state["PATT"] = (value, mask, source or "NONE", slope or "POS")


def _pattern_reply(model: SimulatedDso7104B) -> str:
    value, mask, source, slope = model.state["PATT"]
    return f"{signed_integer(value)},{signed_integer(mask)},{source},{slope}"


def _times(pattern: str, key: str, less: Limits, greater: Limits) -> Command:
    """Declare a range of times; the larger one is the upper limit, whatever the order."""
    limits = Number(unit="S", limits=Limits(greater.minimum, less.maximum))

    def write(model: SimulatedDso7104B, one: float, other: float) -> None:
        upper = clipped(model, max(one, other), less.minimum, less.maximum)
        model.state[key] = (upper, clipped(model, min(one, other), greater.minimum, greater.maximum))

    return Command(
        pattern,
        (limits, limits),
        do=write,
        query=lambda model: comma_list(model.nr3)(model.state[key]),
        query_parameters=(),
    )


def _stage_setting(pattern: str, key: str, allowed: set[str]) -> Command:
    """Declare a stage; the words that it may be made of are a few combinations (6000 series guide, from memory)."""

    def write(model: SimulatedDso7104B, *words: str) -> None:
        if ",".join(words) not in allowed:
            raise ScpiError(-224)
        model.state[key] = words

    return Command(pattern, (_STAGE_WORD,), do=write, query=lambda model: ",".join(model.state[key]), repeat=True)


def _set_pair(prefix: str) -> Callable[..., None]:
    def write(model: SimulatedDso7104B, index: int, one: Any, other: Any) -> None:
        model.state[f"{prefix}{index}"] = (one, other)

    return write


def _patterns(index: int) -> set[str]:
    return {f"PATT{index},ENT", f"PATT{index},EXIT", f"EDGE{index}", f"PATT{index},AND,EDGE{index}"}


_STAGE_WORD = Choice(("PATTern<1-2>", "EDGE<1-2>", "ENTered", "EXITed", "AND", "COUNt", "NREFind", "NONE", "TIMer"))
_SOURCE = Choice(("CHANnel<1-4>", "EXTernal", "LINE"))
_PULSE_TIME = Number(unit="S", limits=Limits(2e-9, 10.0))
_GREATER = Limits(10e-9, 10.0)
_LESS = Limits(15e-9, 10.0)


def _learned(model: SimulatedDso7104B) -> str:
    """Return what all modes have in common, and the edge (siblings' guides; of other modes nothing is known)."""
    state = model.state
    general = (
        f":TRIG:MODE {state['TRIG:MODE']};SWE {state['TRIG:SWE']};NREJ {boolean(state['TRIG:NREJ'])};"
        f"HFR {boolean(state['TRIG:HFR'])};HOLD {state['TRIG:HOLD'] * 1e9:+.13f}E-09"
    )
    if state["TRIG:MODE"] != "EDGE":
        return general
    source = state["TRIG:SOUR"]
    return (
        f"{general};:TRIG:EDGE:SOUR {source};LEV {state[f'LEV:{source}']:+.5E};SLOP {state['TRIG:SLOP']};"
        f"REJ {_reject(model)};COUP {state['TRIG:COUP']}"
    )


TRIGGER_COMMANDS = (
    Command("TRIGger", query=_learned),
    Command(
        "TRIGger:MODE",
        (Choice((*("EDGE", "GLITch", "PATTern", "TV", "DURation", "EBURst", "SEQuence"), *_SERIAL, *_OPTIONS)),),
        do=_set_mode,
        query=lambda model: model.state["TRIG:MODE"],
    ),
    setting("TRIGger:SWEep", "TRIG:SWE", Choice(("AUTO", "NORMal"))),
    setting("TRIGger[:EDGE]:SOURce", "TRIG:SOUR", _SOURCE),
    _level("TRIGger[:EDGE]:LEVel", "TRIG:SOUR"),
    setting("TRIGger[:EDGE]:SLOPe", "TRIG:SLOP", Choice(("POSitive", "NEGative", "EITHer", "ALTernate"))),
    setting("TRIGger[:EDGE]:COUPling", "TRIG:COUP", Choice(("AC", "DC", "LFReject"))),
    Command("TRIGger[:EDGE]:REJect", (Choice(("OFF", "LF", "HF")),), do=_set_reject, query=_reject),
    setting("TRIGger:HFReject", "TRIG:HFR", Boolean(), boolean),
    setting("TRIGger:NREJect", "TRIG:NREJ", Boolean(), boolean),
    number("TRIGger:HOLDoff", "TRIG:HOLD", Number(unit="S", limits=Limits(60e-9, 10.0))),
    Command("TRIGger:FORCe", do=lambda model: model.force(), urgent=True),
    setting("TRIGger:GLITch:SOURce", "GLIT:SOUR", _SOURCE),
    _level("TRIGger:GLITch:LEVel", "GLIT:SOUR"),
    setting("TRIGger:GLITch:QUALifier", "GLIT:QUAL", Choice(("GREaterthan", "LESSthan", "RANGe"))),
    setting("TRIGger:GLITch:POLarity", "GLIT:POL", Choice(("POSitive", "NEGative"))),
    number("TRIGger:GLITch:LESSthan", "GLIT:LESS", _PULSE_TIME),
    number("TRIGger:GLITch:GREaterthan", "GLIT:GRE", _PULSE_TIME),
    _times("TRIGger:GLITch:RANGe", "GLIT:RANG", Limits(15e-9, 10.0), Limits(10e-9, 9.99)),
    Command(
        "TRIGger:PATTern",
        (
            _Bits(),
            _Bits(),
            Choice(("CHANnel<1-4>", "EXTernal", "NONE"), required=False),
            Choice(("POSitive", "NEGative"), required=False),
        ),
        do=_set_pattern,
        query=_pattern_reply,
        query_parameters=(),
    ),
    Command(
        "TRIGger:DURation:PATTern",
        (_Bits(), _Bits()),
        do=lambda model, value, mask: model.state.update({"DUR:PATT": (value, mask)}),
        query=lambda model: model.state["DUR:PATT"],
        query_parameters=(),
        reply=comma_list(signed_integer),
    ),
    setting(
        "TRIGger:DURation:QUALifier",
        "DUR:QUAL",
        Choice(("GREaterthan", "LESSthan", "INRange", "OUTRange", "TIMeout")),
    ),
    number("TRIGger:DURation:GREaterthan", "DUR:GRE", Number(unit="S", limits=_GREATER)),
    number("TRIGger:DURation:LESSthan", "DUR:LESS", Number(unit="S", limits=_LESS)),
    _times("TRIGger:DURation:RANGe", "DUR:RANG", _LESS, Limits(10e-9, 9.99)),
    setting("TRIGger:EBURst:COUNt", "EBUR:COUN", Integer(limits=Limits(1, 65535)), signed_integer),
    number("TRIGger:EBURst:IDLE", "EBUR:IDLE", Number(unit="S", limits=_GREATER)),
    setting("TRIGger:EBURst:SLOPe", "EBUR:SLOP", Choice(("POSitive", "NEGative"))),
    setting("TRIGger:SEQuence:COUNt", "SEQ:COUN", Integer(limits=Limits(1, 10000)), signed_integer),
    Command(
        "TRIGger:SEQuence:EDGE<1-2>",
        (Choice(("CHANnel<1-4>", "EXTernal")), Choice(("POSitive", "NEGative"))),
        do=_set_pair("SEQ:EDGE"),
        query=lambda model, index: ",".join(model.state[f"SEQ:EDGE{index}"]),
    ),
    Command(
        "TRIGger:SEQuence:PATTern<1-2>",
        (_Bits(), _Bits()),
        do=_set_pair("SEQ:PATT"),
        query=lambda model, index: model.state[f"SEQ:PATT{index}"],
        query_parameters=(),
        reply=comma_list(signed_integer),
    ),
    _stage_setting("TRIGger:SEQuence:FIND", "SEQ:FIND", _patterns(1)),
    _stage_setting("TRIGger:SEQuence:TRIGger", "SEQ:TRIG", {*_patterns(2), "EDGE2,COUN", "EDGE2,COUN,NREF"}),
    _stage_setting("TRIGger:SEQuence:RESet", "SEQ:RES", {"NONE", "TIM", *_patterns(1), *_patterns(2)}),
    number("TRIGger:SEQuence:TIMer", "SEQ:TIM", Number(unit="S", limits=_GREATER)),
    setting("TRIGger:TV:SOURce", "TV:SOUR", CHANNEL),
    setting(
        "TRIGger:TV:MODE",
        "TV:MODE",
        Choice(("FIEld<1-2>", "AFIelds", "ALINes", "LINE", "VERTical", "LFIeld<1-2>", "LALTernate", "LVERtical")),
    ),
    setting("TRIGger:TV:STANdard", "TV:STAN", Choice(("GENeric", "NTSC", "PALM", "PAL", "SECam"))),
    setting("TRIGger:TV:POLarity", "TV:POL", Choice(("POSitive", "NEGative"))),
    setting("TRIGger:TV:LINE", "TV:LINE", Integer(limits=Limits(1, 1125)), signed_integer),
)
"""What is said to :TRIGger."""
