"""Trigger commands of the DSO7104B; the trigger that their settings mean makes :mod:`.trigger_settings`.

Widths of pulses are those of the 7000B user's guide (p. 129), the range of levels that of the 3000T guide. That a level
belongs to its channel in every mode is unverified.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.instruments.dso7104b.declarations import CHANNEL, clipped, number, setting
from simrack.scpi import (
    Boolean,
    Choice,
    Command,
    Integer,
    Limits,
    Number,
    boolean,
    comma_list,
    signed_integer,
)

if TYPE_CHECKING:
    from simrack.instruments.dso7104b.instrument import SimulatedDso7104B

_EXTERNAL_REACH_V = 8.0


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


_SOURCE = Choice(("CHANnel<1-4>", "EXTernal", "LINE"))
_PULSE_TIME = Number(unit="S", limits=Limits(2e-9, 10.0))


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
    setting("TRIGger:MODE", "TRIG:MODE", Choice(("EDGE", "GLITch", "TV"))),
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
