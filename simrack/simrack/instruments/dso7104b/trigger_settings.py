"""The trigger that the settings of the DSO7104B mean, mode by mode; :mod:`.trigger_commands` has their sources."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING, Any

from simrack.instruments.dso7104b.conditions import (
    Burst,
    Condition,
    Duration,
    EdgeCondition,
    NeverMet,
    Pattern,
    PulseCondition,
    SequenceCondition,
    SequenceStage,
    Video,
)
from simrack.instruments.dso7104b.inputs import EXTERNAL, LINE
from simrack.instruments.dso7104b.trigger import Comparator, SyncTips, Trigger

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

_LINE_S = {"NTSC": 63.556e-6, "PALM": 63.556e-6, "PAL": 64e-6, "SEC": 64e-6, "GEN": 64e-6}
_UNPLUGGED_V = 1e-9
_HALF_DIVISION = 0.5


def trigger_of(state: Mapping[str, Any]) -> Trigger:
    """Return the trigger that the settings mean."""
    make = _MODES.get(state["TRIG:MODE"])
    return Trigger({}, NeverMet) if make is None else make(state)


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


def _wanted(value: int, mask: int) -> dict[int, bool]:
    """Return what bits 0 to 3 say of channels 1 to 4, and bit 4 of EXTernal."""
    return {bit + 1: bool(value >> bit & 1) for bit in range(5) if mask >> bit & 1}


def _source_of(channel: int) -> str:
    return "EXT" if channel == EXTERNAL else f"CHAN{channel}"


def _comparators(state: Mapping[str, Any], channels: set[int]) -> dict[int, Comparator]:
    return {channel: comparator_of(state, _source_of(channel)) for channel in sorted(channels)}


def _pattern(state: Mapping[str, Any]) -> Trigger:
    value, mask, source, slope = state["PATT"]
    edge = None if source == "NONE" else (_input(source), slope == "POS")
    wanted = _wanted(value, mask)
    channels = set(wanted) | ({edge[0]} if edge else set())
    return Trigger(_comparators(state, channels), partial(Pattern, wanted, edge))


def _duration(state: Mapping[str, Any]) -> Trigger:
    wanted = _wanted(*state["DUR:PATT"])
    longest, shortest = state["DUR:RANG"]
    make: Callable[[], Condition] = {
        "GRE": partial(Duration, wanted, state["DUR:GRE"], math.inf),
        "LESS": partial(Duration, wanted, 0.0, state["DUR:LESS"]),
        "INR": partial(Duration, wanted, shortest, longest),
        "OUTR": partial(Duration, wanted, shortest, longest, outside=True),
        "TIM": partial(Duration, wanted, state["DUR:GRE"], math.inf, timeout=True),
    }[state["DUR:QUAL"]]
    return Trigger(_comparators(state, set(wanted)), make)


def _burst(state: Mapping[str, Any]) -> Trigger:
    channel, rising = _input(state["TRIG:SOUR"]), state["EBUR:SLOP"] == "POS"
    make = partial(Burst, channel, rising=rising, count=state["EBUR:COUN"], idle_s=state["EBUR:IDLE"])
    return Trigger({channel: comparator_of(state, state["TRIG:SOUR"])}, make)


def _television(state: Mapping[str, Any]) -> Trigger:
    """Return the trigger on any line or any field; of a certain line or field it never knows."""
    mode, source = state["TV:MODE"], state["TV:SOUR"]
    if mode not in {"ALIN", "AFI", "VERT"}:
        return Trigger({}, NeverMet)
    channel, negative = _input(source), state["TV:POL"] == "NEG"
    make = partial(Video, channel, negative=negative, line_s=_LINE_S[state["TV:STAN"]], field=mode != "ALIN")
    swing_v = _HALF_DIVISION * state[f"{source}:RANG"] / 8.0
    return Trigger({channel: comparator_of(state, source)}, make, SyncTips(negative, swing_v))


def _stage(state: Mapping[str, Any], words: tuple[str, ...]) -> SequenceStage | None:
    """Return the stage that words like `PATT1,AND,EDGE1` or `EDGE2,COUN` mean; None for NONE and TIMer."""
    pattern = next((_wanted(*state[f"SEQ:{word}"]) for word in words if word.startswith("PATT")), None)
    edge = next((state[f"SEQ:{word}"] for word in words if word.startswith("EDGE")), None)
    if pattern is None and edge is None:
        return None
    return SequenceStage(pattern, "EXIT" not in words, None if edge is None else (_input(edge[0]), edge[1] == "POS"))


def _sequence(state: Mapping[str, Any]) -> Trigger:
    find, trigger, reset = (_stage(state, state[key]) for key in ("SEQ:FIND", "SEQ:TRIG", "SEQ:RES"))
    if find is None or trigger is None:
        return Trigger({}, NeverMet)
    make = partial(
        SequenceCondition,
        find,
        trigger,
        reset,
        count=state["SEQ:COUN"] if "COUN" in state["SEQ:TRIG"] else 1,
        counts_anew="NREF" not in state["SEQ:TRIG"],
        timer_s=state["SEQ:TIM"] if state["SEQ:RES"] == ("TIM",) else math.inf,
    )
    stages = [each for each in (find, trigger, reset) if each is not None]
    channels = {channel for each in stages for channel in each.pattern or {}}
    channels |= {each.edge[0] for each in stages if each.edge is not None}
    return Trigger(_comparators(state, channels), make)


_MODES: dict[str, Callable[[Mapping[str, Any]], Trigger]] = {
    "EDGE": _edge,
    "GLIT": _pulse,
    "PATT": _pattern,
    "DUR": _duration,
    "EBUR": _burst,
    "SEQ": _sequence,
    "TV": _television,
}
"""The other modes wait for frames of a serial bus, which nothing on this bench sends."""
