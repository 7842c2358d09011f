"""Trigger commands of the DSO7104B; the trigger that their settings mean makes :mod:`.trigger_settings`.

Widths of pulses are those of the 7000B user's guide (p. 129), the range of levels that of the 3000T guide. That a level
belongs to its channel in every mode is unverified.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from simrack import scpi
from simrack.instruments.dso7104b.declarations import CHANNEL, clipped
from simrack.instruments.dso7104b.instrument import SimulatedDso7104B

ROWS = scpi.Rows()

_EXTERNAL_REACH_V = 8.0


def _reach(model: SimulatedDso7104B, source: str) -> tuple[float, float]:
    """Return the lowest and the highest level: 0.75 of full scale about the centre of the screen."""
    if not source.startswith("CHAN"):
        return -_EXTERNAL_REACH_V, _EXTERNAL_REACH_V
    centre, reach = model.state.channel_of(source).offset_v, 0.75 * model.state.channel_of(source).range_v
    return centre - reach, centre + reach


def _level(pattern: str, mode: str) -> scpi.Command:
    """Declare the level of a mode's source, or of the one that is named."""

    def write(model: SimulatedDso7104B, volts: float, source: str | None) -> None:
        named = source or getattr(model.state, mode).source
        model.state.levels_v[named] = clipped(model, volts, *_reach(model, named))

    return scpi.Command(
        pattern,
        (scpi.Number(unit="V"), scpi.Choice(("CHANnel<1-4>", "EXTernal"), required=False)),
        do=write,
        query=lambda model, source: model.nr3(model.state.levels_v[source or getattr(model.state, mode).source]),
        query_parameters=(scpi.Choice(("CHANnel<1-4>", "EXTernal"), required=False),),
        reads=True,
    )


def _reject(model: SimulatedDso7104B) -> str:
    if model.state.trigger.coupling == "LFR":
        return "LF"
    return "HF" if model.state.trigger.reject_hf else "OFF"


def _set_pulse_range(model: SimulatedDso7104B, one: float, other: float) -> None:
    """Take a range of times; the larger one is the upper limit, whatever the order."""
    upper = clipped(model, max(one, other), 15e-9, 10.0)
    model.state.pulse.range_s = (upper, clipped(model, min(one, other), 10e-9, 9.99))


_SOURCE = scpi.Choice(("CHANnel<1-4>", "EXTernal", "LINE"))
_PULSE_TIME = scpi.Number(unit="S", limits=scpi.Limits(2e-9, 10.0))


@ROWS.query("TRIGger", reads=True)
def _learned(model: SimulatedDso7104B) -> str:
    """Return the settings common to all modes, and the edge (siblings' guides; of other modes nothing is known)."""
    state = model.state
    general = (
        f":TRIG:MODE {state.trigger.mode};SWE {state.trigger.sweep};NREJ {scpi.boolean(state.trigger.reject_noise)};"
        f"HFR {scpi.boolean(state.trigger.reject_hf)};HOLD {state.trigger.holdoff_s * 1e9:+.13f}E-09"
    )
    if state.trigger.mode != "EDGE":
        return general
    source = state.trigger.source
    return (
        f"{general};:TRIG:EDGE:SOUR {source};LEV {state.levels_v[source]:+.5E};SLOP {state.trigger.slope};"
        f"REJ {_reject(model)};COUP {state.trigger.coupling}"
    )


@ROWS.do("TRIGger[:EDGE]:REJect", (scpi.Choice(("OFF", "LF", "HF")),), query=_reject, reads=True)
def _set_reject(model: SimulatedDso7104B, word: str) -> None:
    """Turn one filter on and the other off; LF is the coupling of that name."""
    model.state.trigger.reject_hf = word == "HF"
    if word == "LF":
        model.state.trigger.coupling = "LFR"
    elif model.state.trigger.coupling == "LFR":
        model.state.trigger.coupling = "DC"


_FIELDS = scpi.Choice(("FIEld<1-2>", "AFIelds", "ALINes", "LINE", "VERTical", "LFIeld<1-2>", "LALTernate", "LVERtical"))


def _setting(
    header: str, parameter: scpi.Parameter, path: str, reply: Callable[[Any], str] | str = str
) -> scpi.Command:
    return scpi.attribute(f"TRIGger{header}", parameter, f"state.{path}", reply)


TRIGGER_COMMANDS = (
    *ROWS,
    _setting(":MODE", scpi.Choice(("EDGE", "GLITch", "TV")), "trigger.mode"),
    _setting(":SWEep", scpi.Choice(("AUTO", "NORMal")), "trigger.sweep"),
    _setting("[:EDGE]:SOURce", _SOURCE, "trigger.source"),
    _level("TRIGger[:EDGE]:LEVel", "trigger"),
    _setting("[:EDGE]:SLOPe", scpi.Choice(("POSitive", "NEGative", "EITHer", "ALTernate")), "trigger.slope"),
    _setting("[:EDGE]:COUPling", scpi.Choice(("AC", "DC", "LFReject")), "trigger.coupling"),
    _setting(":HFReject", scpi.Boolean(), "trigger.reject_hf", scpi.boolean),
    _setting(":NREJect", scpi.Boolean(), "trigger.reject_noise", scpi.boolean),
    _setting(":HOLDoff", scpi.Number(unit="S", limits=scpi.Limits(60e-9, 10.0)), "trigger.holdoff_s", "nr3"),
    scpi.Command("TRIGger:FORCe", do=lambda model: model.force(), urgent=True),
    _setting(":GLITch:SOURce", _SOURCE, "pulse.source"),
    _level("TRIGger:GLITch:LEVel", "pulse"),
    _setting(":GLITch:QUALifier", scpi.Choice(("GREaterthan", "LESSthan", "RANGe")), "pulse.qualifier"),
    _setting(":GLITch:POLarity", scpi.Choice(("POSitive", "NEGative")), "pulse.polarity"),
    _setting(":GLITch:LESSthan", _PULSE_TIME, "pulse.less_s", "nr3"),
    _setting(":GLITch:GREaterthan", _PULSE_TIME, "pulse.greater_s", "nr3"),
    scpi.Command(
        "TRIGger:GLITch:RANGe",
        (scpi.Number(unit="S", limits=scpi.Limits(10e-9, 10.0)),) * 2,
        do=_set_pulse_range,
        query=lambda model: scpi.comma_list(model.nr3)(model.state.pulse.range_s),
        reads=True,
    ),
    _setting(":TV:SOURce", CHANNEL, "television.source"),
    _setting(":TV:MODE", _FIELDS, "television.mode"),
    _setting(":TV:STANdard", scpi.Choice(("GENeric", "NTSC", "PALM", "PAL", "SECam")), "television.standard"),
    _setting(":TV:POLarity", scpi.Choice(("POSitive", "NEGative")), "television.polarity"),
    _setting(":TV:LINE", scpi.Integer(limits=scpi.Limits(1, 1125)), "television.line", scpi.signed_integer),
)
"""What is said to :TRIGger."""
