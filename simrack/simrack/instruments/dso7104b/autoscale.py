"""Settings by :AUToscale: channels with a signal on the screen, three periods of the first of them."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from simrack.instruments.dso7104b.filters import UNKNOWN_AT_ONCE
from simrack.instruments.dso7104b.inputs import ChannelCapture, finest_so_far_s
from simrack.instruments.dso7104b.measurements import MeasuredTrace, Thresholds
from simrack.instruments.dso7104b.settings import CHANNELS, ScopeSettings

LOOK_S = 0.1
"""How long it looks at the inputs (unverified)."""
_POINTS = 20_000
_LEAST_V = 0.01


def fitting(state: ScopeSettings, nodes: Mapping[int, str], capture: ChannelCapture, start_s: float) -> Iterator[None]:
    """Set channels and time base up, in slices of work, for the signals captured from `start_s` on."""
    times = start_s + np.linspace(0.0, LOOK_S, _POINTS)
    frequencies = []
    for channel in CHANNELS:
        node = nodes.get(channel)
        volts = np.zeros(len(times)) if node is None else (yield from _looking(capture, node, times))
        frequencies += _fit_channel(state, channel, times, volts)
        yield
    if frequencies:
        state.timebase.range_s = 10.0 * _nice(3.0 / frequencies[0] / 10.0)
        state.timebase.position_s = 0.0


def _looking(
    capture: ChannelCapture, node: str, times: NDArray[np.float64]
) -> Generator[None, None, NDArray[np.float64]]:
    at_once, parts = len(times) if finest_so_far_s(capture, node) else UNKNOWN_AT_ONCE, list[NDArray[np.float64]]()
    for first in range(0, len(times), at_once):
        parts.append(np.asarray(capture.samples(node, times[first : first + at_once])))
        yield
    return np.concatenate(parts)


def _fit_channel(
    state: ScopeSettings, channel: int, times: NDArray[np.float64], volts: NDArray[np.float64]
) -> list[float]:
    """Show a channel that has a signal above 10 mVpp; return its frequency, if any."""
    swing = float(np.ptp(volts)) * state.channel[channel].probe
    state.channel[channel].shown = swing > _LEAST_V
    if swing <= _LEAST_V:
        return []
    state.channel[channel].range_v = 8.0 * _nice(swing / 5.0)
    state.channel[channel].offset_v = float(volts.max() + volts.min()) / 2.0 * state.channel[channel].probe
    trace = MeasuredTrace(times, volts, clipped=False, thresholds=Thresholds())
    counted = trace.mean_frequency()
    return [] if counted is None else [counted]


def _nice(value: float) -> float:
    """Return the next 1-2-5 value at or above `value`."""
    decade = 10.0 ** math.floor(math.log10(value))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= value * (1 - 1e-9))
