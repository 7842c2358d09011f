"""Trigger commands of the DSO7104B; the trigger that their settings mean makes :mod:`.trigger_settings`.

Widths of pulses are those of the 7000B user's guide (p. 129), the range of levels that of the 3000T guide. That a level
belongs to its channel in every mode is unverified.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from simrack.instruments.dso7104b.declarations import CHANNEL, clipped
from simrack.scpi import (
    Boolean,
    Choice,
    Command,
    Integer,
    Limits,
    Number,
    Rows,
    attribute,
    boolean,
    comma_list,
    signed_integer,
)

if TYPE_CHECKING:
    from simrack.instruments.dso7104b.instrument import SimulatedDso7104B

ROWS = Rows()
"""Rows that stand on their handlers."""

_EXTERNAL_REACH_V = 8.0


def _reach(model: SimulatedDso7104B, source: str) -> tuple[float, float]:
    """Return the lowest and the highest level: 0.75 of full scale about the centre of the screen."""
    if not source.startswith("CHAN"):
        return -_EXTERNAL_REACH_V, _EXTERNAL_REACH_V
    centre, reach = model.state.channel_of(source).offset_v, 0.75 * model.state.channel_of(source).range_v
    return centre - reach, centre + reach


def _level(pattern: str, mode: str) -> Command:
    """Declare the level of a mode's source, or of the one that is named."""

    def write(model: SimulatedDso7104B, volts: float, source: str | None) -> None:
        named = source or getattr(model.state, mode).source
        model.state.levels_v[named] = clipped(model, volts, *_reach(model, named))

    return Command(
        pattern,
        (Number(unit="V"), Choice(("CHANnel<1-4>", "EXTernal"), required=False)),
        do=write,
        query=lambda model, source: model.nr3(model.state.levels_v[source or getattr(model.state, mode).source]),
        query_parameters=(Choice(("CHANnel<1-4>", "EXTernal"), required=False),),
    )


def _reject(model: SimulatedDso7104B) -> str:
    if model.state.trigger.coupling == "LFR":
        return "LF"
    return "HF" if model.state.trigger.reject_hf else "OFF"


def _set_pulse_range(model: SimulatedDso7104B, one: float, other: float) -> None:
    """Take a range of times; the larger one is the upper limit, whatever the order."""
    upper = clipped(model, max(one, other), 15e-9, 10.0)
    model.state.pulse.range_s = (upper, clipped(model, min(one, other), 10e-9, 9.99))


_SOURCE = Choice(("CHANnel<1-4>", "EXTernal", "LINE"))
_PULSE_TIME = Number(unit="S", limits=Limits(2e-9, 10.0))


@ROWS.query("TRIGger")
def _learned(model: SimulatedDso7104B) -> str:
    """Return the settings common to all modes, and the edge (siblings' guides; of other modes nothing is known)."""
    state = model.state
    general = (
        f":TRIG:MODE {state.trigger.mode};SWE {state.trigger.sweep};NREJ {boolean(state.trigger.reject_noise)};"
        f"HFR {boolean(state.trigger.reject_hf)};HOLD {state.trigger.holdoff_s * 1e9:+.13f}E-09"
    )
    if state.trigger.mode != "EDGE":
        return general
    source = state.trigger.source
    return (
        f"{general};:TRIG:EDGE:SOUR {source};LEV {state.levels_v[source]:+.5E};SLOP {state.trigger.slope};"
        f"REJ {_reject(model)};COUP {state.trigger.coupling}"
    )


@ROWS.do("TRIGger[:EDGE]:REJect", (Choice(("OFF", "LF", "HF")),), query=_reject)
def _set_reject(model: SimulatedDso7104B, word: str) -> None:
    """Turn one filter on and the other off; LF is the coupling of that name."""
    model.state.trigger.reject_hf = word == "HF"
    if word == "LF":
        model.state.trigger.coupling = "LFR"
    elif model.state.trigger.coupling == "LFR":
        model.state.trigger.coupling = "DC"


TRIGGER_COMMANDS = (
    *ROWS,
    attribute("TRIGger:MODE", Choice(("EDGE", "GLITch", "TV")), "state.trigger.mode"),
    attribute("TRIGger:SWEep", Choice(("AUTO", "NORMal")), "state.trigger.sweep"),
    attribute("TRIGger[:EDGE]:SOURce", _SOURCE, "state.trigger.source"),
    _level("TRIGger[:EDGE]:LEVel", "trigger"),
    attribute("TRIGger[:EDGE]:SLOPe", Choice(("POSitive", "NEGative", "EITHer", "ALTernate")), "state.trigger.slope"),
    attribute("TRIGger[:EDGE]:COUPling", Choice(("AC", "DC", "LFReject")), "state.trigger.coupling"),
    attribute("TRIGger:HFReject", Boolean(), "state.trigger.reject_hf", boolean),
    attribute("TRIGger:NREJect", Boolean(), "state.trigger.reject_noise", boolean),
    attribute("TRIGger:HOLDoff", Number(unit="S", limits=Limits(60e-9, 10.0)), "state.trigger.holdoff_s", "nr3"),
    Command("TRIGger:FORCe", do=lambda model: model.force(), urgent=True),
    attribute("TRIGger:GLITch:SOURce", _SOURCE, "state.pulse.source"),
    _level("TRIGger:GLITch:LEVel", "pulse"),
    attribute("TRIGger:GLITch:QUALifier", Choice(("GREaterthan", "LESSthan", "RANGe")), "state.pulse.qualifier"),
    attribute("TRIGger:GLITch:POLarity", Choice(("POSitive", "NEGative")), "state.pulse.polarity"),
    attribute("TRIGger:GLITch:LESSthan", _PULSE_TIME, "state.pulse.less_s", "nr3"),
    attribute("TRIGger:GLITch:GREaterthan", _PULSE_TIME, "state.pulse.greater_s", "nr3"),
    Command(
        "TRIGger:GLITch:RANGe",
        (Number(unit="S", limits=Limits(10e-9, 10.0)),) * 2,
        do=_set_pulse_range,
        query=lambda model: comma_list(model.nr3)(model.state.pulse.range_s),
    ),
    attribute("TRIGger:TV:SOURce", CHANNEL, "state.television.source"),
    attribute(
        "TRIGger:TV:MODE",
        Choice(("FIEld<1-2>", "AFIelds", "ALINes", "LINE", "VERTical", "LFIeld<1-2>", "LALTernate", "LVERtical")),
        "state.television.mode",
    ),
    attribute("TRIGger:TV:STANdard", Choice(("GENeric", "NTSC", "PALM", "PAL", "SECam")), "state.television.standard"),
    attribute("TRIGger:TV:POLarity", Choice(("POSitive", "NEGative")), "state.television.polarity"),
    attribute("TRIGger:TV:LINE", Integer(limits=Limits(1, 1125)), "state.television.line", signed_integer),
)
"""What is said to :TRIGger."""
