"""The trigger that the settings of the DSO7104B mean, mode by mode; :mod:`.trigger_commands` has their sources."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

from simrack.instruments.dso7104b.conditions import EdgeCondition, NeverMet, PulseCondition, Video
from simrack.instruments.dso7104b.inputs import EXTERNAL, LINE
from simrack.instruments.dso7104b.trigger import Comparator, SyncTips, Trigger

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_LINE_S = {"NTSC": 63.556e-6, "PALM": 63.556e-6, "PAL": 64e-6, "SEC": 64e-6, "GEN": 64e-6}
_UNPLUGGED_V = 1e-9
_HALF_DIVISION = 0.5


def trigger_of(state: Mapping[str, Any]) -> Trigger:
    """Return the trigger that the settings mean."""
    return _MODES[state["TRIG:MODE"]](state)


def _input(source: str) -> int:
    named = {"EXT": EXTERNAL, "LINE": LINE}
    return named[source] if source in named else int(source[4:])


def comparator_of(state: Mapping[str, Any], source: str, side: float = 0.0) -> Comparator:
    """Return a comparator at the source's level; noise reject gives it a division of hysteresis."""
    band_v = state[f"{source}:RANG"] / 8.0 if state["TRIG:NREJ"] and source.startswith("CHAN") else 0.0
    level_v = 0.0 if source == "LINE" else state[f"LEV:{source}"]
    if source == "EXT":
        level_v += _UNPLUGGED_V  # what is at 0 V is not above a level of 0 V
    return Comparator.at(level_v, band_v, side, reject="HF" if state["TRIG:HFR"] else "")


def _coupled(state: Mapping[str, Any], comparator: Comparator) -> Comparator:
    """Return a comparator behind the coupling that the edge trigger has."""
    coupling = state["TRIG:COUP"]
    reject = "LF" if coupling == "LFR" else comparator.filter
    return Comparator(comparator.level_v, comparator.low_v, comparator.high_v, coupling == "AC", reject)


def _edge(state: Mapping[str, Any]) -> Trigger:
    source, slope = state["TRIG:SOUR"], state["TRIG:SLOP"]
    side = {"POS": 1.0, "NEG": -1.0}.get(slope, 0.0)
    channel = _input(source)
    make = partial(EdgeCondition, channel, rising=slope != "NEG", falling=slope != "POS")
    return Trigger({channel: _coupled(state, comparator_of(state, source, side))}, make)


def _pulse(state: Mapping[str, Any]) -> Trigger:
    source, positive = state["GLIT:SOUR"], state["GLIT:POL"] == "POS"
    less, greater = state["GLIT:RANG"]
    least, most = {
        "LESS": (0.0, state["GLIT:LESS"]),
        "GRE": (state["GLIT:GRE"], math.inf),
        "RANG": (greater, less),
    }[state["GLIT:QUAL"]]
    channel = _input(source)
    make = partial(PulseCondition, channel, positive=positive, least_s=least, most_s=most)
    return Trigger({channel: comparator_of(state, source)}, make)


def _television(state: Mapping[str, Any]) -> Trigger:
    """Return the trigger on any line or any field; of a certain line or field it never knows."""
    mode, source = state["TV:MODE"], state["TV:SOUR"]
    if mode not in {"ALIN", "AFI", "VERT"}:
        return Trigger({}, NeverMet)
    channel, negative = _input(source), state["TV:POL"] == "NEG"
    make = partial(Video, channel, negative=negative, line_s=_LINE_S[state["TV:STAN"]], field=mode != "ALIN")
    swing_v = _HALF_DIVISION * state[f"{source}:RANG"] / 8.0
    return Trigger({channel: comparator_of(state, source)}, make, SyncTips(negative, swing_v))


_MODES: dict[str, Callable[[Mapping[str, Any]], Trigger]] = {
    "EDGE": _edge,
    "GLIT": _pulse,
    "TV": _television,
}
