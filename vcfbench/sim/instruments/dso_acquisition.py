"""How an oscilloscope gets a record out of the World: arm, look for the trigger, sample, digitise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from numpy.typing import NDArray

    from vcfbench.clock import Clock

__all__ = ["Acquisition", "ChannelView", "Digitised", "EdgeTrigger", "Record", "ScopeErrors", "ScopeWorld", "Screen"]

AUTO_TRIGGER_S = 0.02
"""How long AUTO waits for a trigger; the guide says that AUTO suits signals above 50 Hz (unverified)."""
_SEARCH_S = 1e-3
_LONGEST_SEARCH_S = 0.05
_SEARCH_POINTS = 4000
_REFINE_POINTS = 33
_REFINE_ROUNDS = 3
_BLOCK_POINTS = 1 << 16


class Capture(Protocol):
    """A stretch of time of the World."""

    def samples(self, node: str, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the node's volts at absolute times."""
        ...


class ScopeWorld(Protocol):
    """What the oscilloscope needs of the World."""

    @property
    def clock(self) -> Clock:
        """Bench time."""
        ...

    def capture(self, start_s: float, stop_s: float) -> Capture:
        """Register a stretch of time."""
        ...


@dataclass(frozen=True, slots=True)
class ScopeErrors:
    """Imperfections of one specimen; each is off at zero."""

    gain_error: tuple[float, float, float, float]
    """Relative error of the vertical gain of each channel (data sheet, unverified: 2 % of full scale)."""
    offset_error_div: tuple[float, float, float, float]
    """Vertical offset of each channel, divisions (data sheet, unverified: 0.1 div and 2 mV)."""
    skew_s: tuple[float, float, float, float]
    """Delay of each channel, s (below 100 ps)."""
    time_base_error: float
    """Relative error of the time base: 15 ppm and 2 ppm a year (7000 Series service guide p. 45)."""
    noise_div: float
    """White noise of a sample, divisions rms (unverified)."""
    converter_bits: int
    """Bits over the full range: 8; 0 for as many as the waveform format carries."""

    @classmethod
    def none(cls) -> ScopeErrors:
        """Return an oscilloscope that shows what is."""
        zero = (0.0, 0.0, 0.0, 0.0)
        return cls(zero, zero, zero, 0.0, 0.0, 0)

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> ScopeErrors:
        """Return a specimen drawn uniformly within the data sheet, five years old."""

        def four(reach: float) -> tuple[float, float, float, float]:
            first, second, third, fourth = (float(each) for each in rng.uniform(-reach, reach, 4))
            return first, second, third, fourth

        return cls(four(0.02), four(0.1), four(1e-10), float(rng.uniform(-25e-6, 25e-6)), 0.02, 8)


@dataclass(frozen=True, slots=True)
class Screen:
    """The time window that is shown: from `left_s` for `range_s`, trigger at 0."""

    left_s: float
    range_s: float

    @property
    def right_s(self) -> float:
        """The end of the window, s."""
        return self.left_s + self.range_s

    def times_s(self, points: int, start: int = 0, count: int | None = None) -> NDArray[np.float64]:
        """Return the sample times of `points` from the left edge, or `count` of them from the `start`-th on."""
        stop = points if count is None else start + count
        return self.left_s + np.arange(start, stop, dtype=np.float64) * (self.range_s / points)


@dataclass(frozen=True, slots=True)
class ChannelView:
    """How a channel looks at its node."""

    node: str | None
    """Node of the PCB; None for an open input."""
    range_v: float
    """Full screen, displayed volts."""
    offset_v: float
    """Displayed volts at the centre of the screen."""
    probe: float
    """Displayed over real volts."""
    inverted: bool
    ac: bool


@dataclass(frozen=True, slots=True)
class EdgeTrigger:
    """The edge that starts a record; `channel` None never comes (EXT with nothing connected).

    With `width_s` (least, most) the edge must end a pulse that lasted so long: a glitch trigger.
    """

    channel: int | None
    level_v: float
    rising: bool
    falling: bool
    ac: bool
    width_s: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class Digitised:
    """A channel's samples in volts after the converter, and whether any was beyond it."""

    volts: NDArray[np.float64]
    clipped: bool
    step_v: float


class Record:
    """What an acquisition kept: it can be looked at with any number of points."""

    def __init__(
        self,
        capture: Capture,
        trigger_s: float,
        screen: Screen,
        views: Mapping[int, ChannelView],
        errors: ScopeErrors,
        *,
        number: int,
        bits: int,
        averages: int,
    ) -> None:
        self._capture = capture
        self._trigger_s = trigger_s
        self.screen = screen
        self.views = views
        self._errors = errors
        self._number = number
        self._bits = bits
        self.averages = averages

    def digitised(self, channel: int, points: int) -> Digitised:
        """Return `points` samples of `channel` over the screen."""
        view = self.views[channel]
        volts = np.concatenate(list(self.blocks(channel, points)))
        step = self._step_v(view)
        # codes 2...254 of 256 are data: 1 and 255 say that the sample is beyond the converter
        unit = view.range_v / 256
        low, high = view.offset_v - 126 * unit, view.offset_v + 126 * unit
        clipped = bool((volts < low - unit / 2).any() or (volts > high + unit / 2).any())
        return Digitised(volts, clipped, step)

    def blocks(self, channel: int, points: int) -> Iterator[NDArray[np.float64]]:
        """Yield the same samples in blocks: eight million at once would take hundreds of megabytes."""
        view = self.views[channel]
        bias_v, step = self._bias_v(channel), self._step_v(view)
        noise = np.random.default_rng((self._number, channel))
        for start in range(0, points, _BLOCK_POINTS):
            count = min(_BLOCK_POINTS, points - start)
            volts = self._analogue(channel, self.screen.times_s(points, start, count)) - bias_v
            if self._errors.noise_div:
                volts += self._noise_v(view) * noise.standard_normal(count)
            if step:
                volts = np.round((volts - view.offset_v) / step) * step + view.offset_v
            yield volts

    def _step_v(self, view: ChannelView) -> float:
        return view.range_v / 2**self._bits if self._bits else 0.0

    def _bias_v(self, channel: int) -> float:
        """Return what AC coupling takes off: its 3.5 Hz corner, as seen on one screen."""
        if not self.views[channel].ac:
            return 0.0
        gain = 1.0 + self._errors.gain_error[channel - 1]
        return gain * float(self._shown(channel, self.screen.times_s(_SEARCH_POINTS)).mean())

    def extremes(self, channel: int, points: int) -> Digitised:
        """Return alternately smallest and largest of the samples behind each pair of points (peak detect)."""
        fine = self.digitised(channel, points * 8)
        pairs = fine.volts.reshape(-1, 16)
        volts = np.stack((pairs.min(axis=1), pairs.max(axis=1)), axis=1).reshape(-1)[:points]
        return Digitised(volts, fine.clipped, fine.step_v)

    def _analogue(self, channel: int, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        gain = 1.0 + self._errors.gain_error[channel - 1]
        offset_v = self._errors.offset_error_div[channel - 1] * self.views[channel].range_v / 8.0
        return self._shown(channel, times_s) * gain + offset_v

    def _shown(self, channel: int, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        # a fast clock samples early: what it calls t is really t / (1 + error)
        real_s = self._trigger_s + times_s / (1.0 + self._errors.time_base_error) - self._errors.skew_s[channel - 1]
        return seen(self._capture, self.views[channel], real_s)

    def _noise_v(self, view: ChannelView) -> float:
        return self._errors.noise_div * view.range_v / 8.0 / math.sqrt(self.averages)


def seen(capture: Capture, view: ChannelView, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return displayed volts at absolute times, before AC coupling and the channel's own errors."""
    if view.node is None:
        return np.zeros(len(times_s))
    volts = np.asarray(capture.samples(view.node, times_s), dtype=np.float64)
    return volts * (-view.probe if view.inverted else view.probe)


class Acquisition:
    """One armed acquisition: call :meth:`step` at :attr:`due_s` until it gives a trigger time."""

    def __init__(
        self,
        world: ScopeWorld,
        screen: Screen,
        views: Mapping[int, ChannelView],
        trigger: EdgeTrigger,
        *,
        auto: bool,
        repeats: int,
    ) -> None:
        self._world = world
        self.screen = screen
        self.views = views
        self._trigger = trigger
        self._auto = auto
        self._forced = False
        self._repeats = repeats
        # a little more than the screen, for skew and time base error
        self._before_s = max(0.0, -screen.left_s) * 1.001 + 1e-8
        self._after_s = max(0.0, screen.right_s) * 1.001 + 1e-8
        self._search_s = max(_SEARCH_S, screen.range_s)
        self._armed_s = world.clock.now()
        self._found: tuple[Capture, float] | None = None
        self.due_s = 0.0
        self._arm()

    def _arm(self) -> None:
        self._start_s = self._world.clock.now()
        self.due_s = self._start_s + self._before_s + self._search_s + self._after_s
        self._capture = self._world.capture(self._start_s, self.due_s)

    def force(self) -> None:
        """Trigger whatever the signal does."""
        self._forced = True

    def step(self) -> tuple[Capture, float] | None:
        """Return capture and trigger time once there is a complete record, else None (and a later `due_s`)."""
        if self._world.clock.now() < self.due_s:
            return None
        if self._found is None:
            self._found = self._look()
            if self._found is None:
                self._search_longer()
                self._arm()
                return None
            if self._repeats > 1:
                # the further acquisitions of an average take their time, but see the same steady signal
                self.due_s += (self._repeats - 1) * (self._before_s + self._after_s)
                return None
        return self._found

    def _search_longer(self) -> None:
        """Look for the trigger in longer and longer stretches, but not past the patience of AUTO."""
        longest = _LONGEST_SEARCH_S
        if self._auto:
            longest = self._armed_s + AUTO_TRIGGER_S - self._world.clock.now()
        self._search_s = max(self._search_s, min(2.0 * self._search_s, longest))

    def _look(self) -> tuple[Capture, float] | None:
        opening = self._start_s + self._before_s
        crossing = self._crossing(opening, opening + self._search_s)
        if crossing is not None:
            return self._capture, crossing
        waited = self._world.clock.now() - self._armed_s
        if self._forced or (self._auto and waited >= AUTO_TRIGGER_S):
            return self._capture, opening
        return None

    def _crossing(self, start_s: float, stop_s: float) -> float | None:
        view = None if self._trigger.channel is None else self.views.get(self._trigger.channel)
        if view is None or view.node is None:
            return None
        bracket: tuple[float, float] | None = (start_s, stop_s)
        points, bias = _SEARCH_POINTS, 0.0
        for round_number in range(_REFINE_ROUNDS):
            assert bracket is not None  # noqa: S101  (for the type checker)
            times = np.linspace(*bracket, points)
            volts = seen(self._capture, view, times)
            if self._trigger.ac and round_number == 0:
                bias = float(volts.mean())
            bracket = self._first(times, volts - bias)
            if bracket is None:
                return None
            points = _REFINE_POINTS
        assert bracket is not None  # noqa: S101  (for the type checker)
        return _interpolated(self._capture, view, bracket, self._trigger.level_v + bias)

    def _first_pulse(
        self, times: NDArray[np.float64], volts: NDArray[np.float64], width_s: tuple[float, float]
    ) -> tuple[float, float] | None:
        """Return the bracket of the edge that ends the first pulse of a wanted width."""
        heights = volts - self._trigger.level_v
        places, instants = _crossings(times, heights)
        ends = places[1:][
            ((heights[places[1:]] >= 0) == self._trigger.falling)
            & (np.diff(instants) >= width_s[0])
            & (np.diff(instants) <= width_s[1])
        ]
        return (float(times[ends[0]]), float(times[ends[0] + 1])) if len(ends) else None

    def _first(self, times: NDArray[np.float64], volts: NDArray[np.float64]) -> tuple[float, float] | None:
        if self._trigger.width_s is not None and len(times) == _SEARCH_POINTS:
            return self._first_pulse(times, volts, self._trigger.width_s)
        above = volts >= self._trigger.level_v
        wanted = np.zeros(len(times) - 1, dtype=bool)
        if self._trigger.rising:
            wanted |= ~above[:-1] & above[1:]
        if self._trigger.falling:
            wanted |= above[:-1] & ~above[1:]
        places = np.flatnonzero(wanted)
        return (float(times[places[0]]), float(times[places[0] + 1])) if len(places) else None


def _crossings(
    times: NDArray[np.float64], heights: NDArray[np.float64]
) -> tuple[NDArray[np.intp], NDArray[np.float64]]:
    """Return where the sign of `heights` changes, by index and by time."""
    places = np.flatnonzero((heights[:-1] >= 0) != (heights[1:] >= 0))
    before, after = heights[places], heights[places + 1]
    return places, times[places] + before / (before - after) * (times[1] - times[0])


def _interpolated(capture: Capture, view: ChannelView, bracket: tuple[float, float], level_v: float) -> float:
    before, after = (float(each) for each in seen(capture, view, np.array(bracket)))
    part = (level_v - before) / (after - before) if after != before else 0.0
    return bracket[0] + part * (bracket[1] - bracket[0])
