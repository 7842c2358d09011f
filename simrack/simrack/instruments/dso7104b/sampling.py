"""Sampling of the inputs by the settings of the DSO7104B: screen, channels, memory, sample rate, pace."""

from __future__ import annotations

import math

from simrack.instruments.dso7104b.acquisition import Pace
from simrack.instruments.dso7104b.inputs import ChannelView, Screen
from simrack.instruments.dso7104b.kinds import ScopeKind
from simrack.instruments.dso7104b.settings import CHANNELS, ScopeSettings


def main_window(state: ScopeSettings) -> Screen:
    """Return the main window."""
    span, position = state.timebase.range_s, state.timebase.position_s
    share = {"LEFT": 0.1, "CENT": 0.5, "RIGH": 0.9}[state.timebase.reference]
    return Screen(position - share * span, span)


def channel_view(state: ScopeSettings, channel: int, node: str | None, limit_hz: float) -> ChannelView:
    """Return the node as `channel` sees it, with its bandwidth limit `limit_hz`; None for a free channel."""
    own = state.channel[channel]
    return ChannelView(
        node,
        own.range_v,
        own.offset_v,
        own.probe,
        own.inverted,
        ac=own.coupling == "AC",
        skew_s=own.skew_s,
        limit_hz=limit_hz if own.bandwidth_limit else math.inf,
    )


def pace_of(state: ScopeSettings, last_trigger_s: float) -> Pace:
    """Return how acquisitions follow each other, the last trigger having been at `last_trigger_s` of bench time."""
    segmented = state.acquire.mode == "SEGM"
    return Pace(
        auto=state.trigger.sweep == "AUTO",
        repeats=state.acquire.count if state.acquire.type == "AVER" and not segmented else 1,
        segments=state.acquire.segments if segmented else 0,
        holdoff_s=state.trigger.holdoff_s,
        not_before_s=last_trigger_s + state.trigger.holdoff_s,
        smooth=state.acquire.type == "HRES",
    )


def memory_points(state: ScopeSettings, kind: ScopeKind) -> int:
    """Return the points in memory; with both channels of a pair (1, 2 and 3, 4) there are fewer.

    Segments share it.
    """
    half = _both_of_a_pair(state)
    most, rate = kind.memory[half], kind.rate_hz[half]
    if state.acquire.mode == "SEGM":
        most //= state.acquire.segments
    return int(max(100, min(most, state.timebase.range_s * rate)))


def sample_rate_hz(state: ScopeSettings, kind: ScopeKind) -> float:
    """Return the sample rate: the memory's over the screen, but no more than the converters give."""
    return min(memory_points(state, kind) / float(state.timebase.range_s), kind.rate_hz[_both_of_a_pair(state)])


def _both_of_a_pair(state: ScopeSettings) -> bool:
    shown = {channel for channel in CHANNELS if state.channel[channel].shown}
    return {1, 2} <= shown or {3, 4} <= shown
