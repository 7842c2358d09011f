"""How the settings of the DSO7104B have the inputs sampled: screen, channels, memory, sample rate, pace."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from simrack.instruments.dso7104b.acquisition import Pace
from simrack.instruments.dso7104b.inputs import ChannelView, Screen
from simrack.instruments.dso7104b.settings import CHANNELS

if TYPE_CHECKING:
    from collections.abc import Mapping

    from simrack.instruments.dso7104b.kinds import ScopeKind


def main_window(state: Mapping[str, Any]) -> Screen:
    """Return the main window."""
    span, position = state["TIM:RANG"], state["TIM:POS"]
    share = {"LEFT": 0.1, "CENT": 0.5, "RIGH": 0.9}[state["TIM:REF"]]
    return Screen(position - share * span, span)


def channel_view(state: Mapping[str, Any], channel: int, node: str | None, limit_hz: float) -> ChannelView:
    """Return how `channel` sees its node, None where it hangs free; `limit_hz` is that of the bandwidth limit."""

    def of(key: str) -> Any:
        return state[f"CHAN{channel}:{key}"]

    return ChannelView(
        node,
        of("RANG"),
        of("OFFS"),
        of("PROB"),
        of("INV"),
        ac=of("COUP") == "AC",
        skew_s=of("SKEW"),
        limit_hz=limit_hz if of("BWL") else math.inf,
    )


def pace_of(state: Mapping[str, Any], last_trigger_s: float) -> Pace:
    """Return how acquisitions follow each other, the last trigger having been at `last_trigger_s` of bench time."""
    segmented = state["ACQ:MODE"] == "SEGM"
    return Pace(
        auto=state["TRIG:SWE"] == "AUTO",
        repeats=state["ACQ:COUN"] if state["ACQ:TYPE"] == "AVER" and not segmented else 1,
        segments=state["SEGM:COUN"] if segmented else 0,
        holdoff_s=state["TRIG:HOLD"],
        not_before_s=last_trigger_s + state["TRIG:HOLD"],
        smooth=state["ACQ:TYPE"] == "HRES",
    )


def memory_points(state: Mapping[str, Any], kind: ScopeKind) -> int:
    """Return the points in memory; with both channels of a pair (1, 2 and 3, 4) there are fewer.

    Segments share it.
    """
    half = _both_of_a_pair(state)
    most, rate = kind.memory[half], kind.rate_hz[half]
    if state["ACQ:MODE"] == "SEGM":
        most //= state["SEGM:COUN"]
    return int(max(100, min(most, state["TIM:RANG"] * rate)))


def sample_rate_hz(state: Mapping[str, Any], kind: ScopeKind) -> float:
    """Return the sample rate: what fills the memory, but no more than the converters give."""
    return min(memory_points(state, kind) / float(state["TIM:RANG"]), kind.rate_hz[_both_of_a_pair(state)])


def _both_of_a_pair(state: Mapping[str, Any]) -> bool:
    shown = {channel for channel in CHANNELS if state[f"CHAN{channel}:DISP"]}
    return {1, 2} <= shown or {3, 4} <= shown
