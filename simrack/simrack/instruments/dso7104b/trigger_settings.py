"""The trigger that the settings of the DSO7104B mean, mode by mode; :mod:`.trigger_commands` has their sources."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from simrack.instruments.dso7104b.conditions import EdgeCondition, NeverMet, PulseCondition, Video
from simrack.instruments.dso7104b.inputs import EXTERNAL, LINE
from simrack.instruments.dso7104b.settings import ScopeSettings
from simrack.instruments.dso7104b.trigger import Comparator, SyncTips, Trigger

_LINE_S = {"NTSC": 63.556e-6, "PALM": 63.556e-6, "PAL": 64e-6, "SEC": 64e-6, "GEN": 64e-6}
_UNPLUGGED_V = 1e-9
_HALF_DIVISION = 0.5


def trigger_of(state: ScopeSettings) -> Trigger:
    """Return the trigger that the settings mean."""
    return _MODES[state.trigger.mode](state)


def _input(source: str) -> int:
    named = {"EXT": EXTERNAL, "LINE": LINE}
    return named[source] if source in named else int(source[4:])


def comparator_of(state: ScopeSettings, source: str, side: float = 0.0) -> Comparator:
    """Return a comparator at the source's level; noise reject gives it a division of hysteresis."""
    band_v = state.channel_of(source).range_v / 8.0 if state.trigger.reject_noise and source.startswith("CHAN") else 0.0
    level_v = 0.0 if source == "LINE" else state.levels_v[source]
    if source == "EXT":
        level_v += _UNPLUGGED_V  # what is at 0 V is not above a level of 0 V
    return Comparator.at(level_v, band_v, side, reject="HF" if state.trigger.reject_hf else "")


def _edge(state: ScopeSettings) -> Trigger:
    source, slope = state.trigger.source, state.trigger.slope
    side = {"POS": 1.0, "NEG": -1.0}.get(slope, 0.0)
    channel = _input(source)
    make = partial(EdgeCondition, channel, rising=slope != "NEG", falling=slope != "POS")
    # A comparator behind the coupling that the edge trigger has
    comparator = comparator_of(state, source, side)
    coupling = state.trigger.coupling
    reject = "LF" if coupling == "LFR" else comparator.filter
    return Trigger(
        {channel: Comparator(comparator.level_v, comparator.low_v, comparator.high_v, coupling == "AC", reject)}, make
    )


def _pulse(state: ScopeSettings) -> Trigger:
    source, positive = state.pulse.source, state.pulse.polarity == "POS"
    less, greater = state.pulse.range_s
    least, most = {
        "LESS": (0.0, state.pulse.less_s),
        "GRE": (state.pulse.greater_s, math.inf),
        "RANG": (greater, less),
    }[state.pulse.qualifier]
    channel = _input(source)
    make = partial(PulseCondition, channel, positive=positive, least_s=least, most_s=most)
    return Trigger({channel: comparator_of(state, source)}, make)


def _television(state: ScopeSettings) -> Trigger:
    """Return the trigger on any line or any field; of a certain line or field it never knows."""
    mode, source = state.television.mode, state.television.source
    if mode not in {"ALIN", "AFI", "VERT"}:
        return Trigger({}, NeverMet)
    channel, negative = _input(source), state.television.polarity == "NEG"
    make = partial(Video, channel, negative=negative, line_s=_LINE_S[state.television.standard], field=mode != "ALIN")
    swing_v = _HALF_DIVISION * state.channel_of(source).range_v / 8.0
    return Trigger({channel: comparator_of(state, source)}, make, SyncTips(negative, swing_v))


_MODES: dict[str, Callable[[ScopeSettings], Trigger]] = {"EDGE": _edge, "GLIT": _pulse, "TV": _television}
