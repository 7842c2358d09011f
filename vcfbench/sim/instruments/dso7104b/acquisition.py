"""How an oscilloscope gets a record out of the World: arm, look for the trigger, sample, digitise."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Protocol

import numpy as np
from msgspec import Struct

from vcfbench.sim.gyro.dense import Coarse
from vcfbench.sim.instruments.dso7104b.inputs import Signals, seen
from vcfbench.sim.instruments.dso7104b.trigger import TriggerSearch

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from numpy.typing import NDArray

    from vcfbench.sim.instruments.dso7104b.inputs import Capture, ChannelView, Recording, ScopeWorld, Screen
    from vcfbench.sim.instruments.dso7104b.trigger import Trigger

__all__ = ["Acquisition", "Digitised", "Found", "Pace", "Record", "ScopeErrors", "acquisition"]

AUTO_TRIGGER_S = 0.02
"""How long AUTO waits for a trigger; the guide says that AUTO suits signals above 50 Hz (unverified)."""
_SEARCH_S = 1e-3
_LONGEST_SEARCH_S = 0.05
_BIAS_POINTS = 4000
_BLOCK_POINTS = 1 << 16
_DENSE_POINTS = 1024
_LEAST_SAVING, _MOST_SAVING = 4, 4096
_SAMPLE_RATE_HZ = 4e9
_PEAK_SAMPLES = 8
"""Samples behind each point of a peak detection at least, and at most altogether."""
_PEAK_MOST = 1 << 22
_REARM_S = 10e-6
"""From the end of a segment until the next can begin to fill (unverified)."""
_STARTED_ANEW_S = 2.0
"""Of a longer silence only the last part is searched: at two microseconds a point this takes a tenth of a second."""
_REMEMBERED_S = 11.0
"""The longest duration that a trigger measures, and a little more."""


class ScopeErrors(Struct, frozen=True):
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
    exponent_digits: int = 3
    """Digits of the exponent in replies: three on the 6000 series (same code base), two on later ones."""
    noise_seed: int = 0
    """Which noise it is: two specimens never have the same."""

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

        vertical = four(0.02), four(0.1)
        skew_s, time_base_error = four(1e-10), float(rng.uniform(-25e-6, 25e-6))
        return cls(*vertical, skew_s, time_base_error, 0.02, 8, noise_seed=int(rng.integers(1 << 31)))


class Digitised(Struct, frozen=True):
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
        self.trigger_s = trigger_s
        self.screen = screen
        self.views = views
        self._errors = errors
        self.number = number
        self._bits = bits
        self.averages = averages

    def digitised(self, channel: int, points: int) -> Digitised:
        """Return `points` samples of `channel` over the screen."""
        return self._judged(channel, np.concatenate(list(self.blocks(channel, points))))

    def extremes(self, channel: int, points: int) -> Digitised:
        """Return the same by peak detection."""
        return self._judged(channel, np.concatenate(list(self.peak_blocks(channel, points))))

    def _judged(self, channel: int, volts: NDArray[np.float64]) -> Digitised:
        view = self.views[channel]
        # codes 2...254 of 256 are data: 1 and 255 say that the sample is beyond the converter
        unit = view.range_v / 256
        low, high = view.offset_v - 126 * unit, view.offset_v + 126 * unit
        clipped = bool((volts < low - unit / 2).any() or (volts > high + unit / 2).any())
        return Digitised(volts, clipped, self._step_v(view))

    def blocks(self, channel: int, points: int, block_points: int = _BLOCK_POINTS) -> Iterator[NDArray[np.float64]]:
        """Yield the samples in blocks: eight million at once would take hundreds of megabytes."""
        view = self.views[channel]
        bias_v, step = self._bias_v(channel), self._step_v(view)
        noise = self._noise(channel, points)
        for start in range(0, points, block_points):
            count = min(block_points, points - start)
            volts = self._analogue(channel, points, start, count)
            volts -= bias_v
            if self._errors.noise_div:
                volts += self._noise_v(view) * noise(start, count)
            yield _stepped(volts, step, view.offset_v) if step else volts

    def peak_blocks(self, channel: int, points: int) -> Iterator[NDArray[np.float64]]:
        """Yield alternately the smallest and the largest of the samples behind each pair of points (peak detect)."""
        samples = 2 * self._peak_samples(channel, points)
        pairs = max(1, _BLOCK_POINTS * _PEAK_SAMPLES // samples)
        for volts in self.blocks(channel, points * samples // 2, pairs * samples):
            rows = volts.reshape(-1, samples)
            yield np.stack((rows.min(axis=1), rows.max(axis=1)), axis=1).reshape(-1)

    def _peak_samples(self, channel: int, points: int) -> int:
        """Return how many samples are looked at behind a point: so many that nothing of the node slips through."""
        node = self.views[channel].node
        finest = math.inf if node is None else self._capture.finest_s(node)
        most = max(_PEAK_SAMPLES, _PEAK_MOST // points)
        if not finest:
            return most
        return min(most, max(_PEAK_SAMPLES, math.ceil(2.0 * self.screen.range_s / points / finest)))

    def _step_v(self, view: ChannelView) -> float:
        return view.range_v / 2**self._bits if self._bits else 0.0

    def _bias_v(self, channel: int) -> float:
        """Return what AC coupling takes off: its 3.5 Hz corner, as seen on one screen."""
        if not self.views[channel].ac:
            return 0.0
        gain = 1.0 + self._errors.gain_error[channel - 1]
        return gain * float(self._shown(channel, self.screen.times_s(_BIAS_POINTS)).mean())

    def _analogue(self, channel: int, points: int, start: int, count: int) -> NDArray[np.float64]:
        """Return what the converter sees at `count` of `points` sample times, from the `start`-th on."""
        gain = 1.0 + self._errors.gain_error[channel - 1]
        offset_v = self._errors.offset_error_div[channel - 1] * self.views[channel].range_v / 8.0
        coarse = self._coarse(channel, points, start, count)
        if coarse is None:
            return self._shown(channel, self.screen.times_s(points, start, count)) * gain + offset_v
        few = seen(self._capture, self.views[channel], coarse.times_s())
        return coarse.interpolated(few * gain + offset_v)

    def _coarse(self, channel: int, points: int, start: int, count: int) -> Coarse | None:
        """Return the times from which a block is interpolated, None where it must be looked at point by point."""
        node = self.views[channel].node
        if count < _DENSE_POINTS or node is None:
            return None
        first = self._real_s(channel, self.screen.times_s(points, start, 1))[0]
        step = self.screen.range_s / points / (1.0 + self._errors.time_base_error)
        share = int(min(self._capture.finest_s(node) / step, _MOST_SAVING))
        # the cubics of both ends reach beyond them: what jumps there would show here
        reach = 2 * share * step
        if share < _LEAST_SAVING or not self._capture.whole(first - reach, first + count * step + reach):
            return None
        return Coarse(float(first), step, count, share)

    def _shown(self, channel: int, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        return seen(self._capture, self.views[channel], self._real_s(channel, times_s))

    def _real_s(self, channel: int, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        # a fast clock samples early: what it calls t is really t / (1 + error)
        return self.trigger_s + times_s / (1.0 + self._errors.time_base_error) - self._errors.skew_s[channel - 1]

    def _noise(self, channel: int, points: int) -> Callable[[int, int], NDArray[np.float64]]:
        """Return what gives the noise of points from one on: a draw each, or what joins the draws of real samples."""
        draws = np.random.default_rng((self.number, channel, self._errors.noise_seed))
        samples = self.screen.range_s * _SAMPLE_RATE_HZ
        if samples >= points:
            return lambda _, count: draws.standard_normal(count)
        sampled = draws.standard_normal(math.ceil(samples) + 1)
        return lambda start, count: np.interp(
            np.arange(start, start + count) * (samples / points), np.arange(len(sampled)), sampled
        )

    def _noise_v(self, view: ChannelView) -> float:
        return self._errors.noise_div * view.range_v / 8.0 / math.sqrt(self.averages)


def _stepped(volts: NDArray[np.float64], step_v: float, offset_v: float) -> NDArray[np.float64]:
    """Return volts in the steps of the converter."""
    volts -= offset_v
    volts /= step_v
    np.round(volts, out=volts)
    volts *= step_v
    volts += offset_v
    return volts


class Pace(Struct, frozen=True):
    """How acquisitions follow each other.

    Args:
        auto: trigger by itself where nothing does for a while.
        repeats: acquisitions of an average.
        segments: acquisitions of a segmented one, each a record of its own.
        holdoff_s: time from one trigger to the next at least.
        not_before_s: bench time before which no trigger counts, from the holdoff of the one before.
    """

    auto: bool
    repeats: int = 1
    segments: int = 0
    holdoff_s: float = 0.0
    not_before_s: float = -math.inf


class Found(Struct, frozen=True):
    """What was captured, and when the triggers were."""

    capture: Capture
    triggers_s: tuple[float, ...]


class Acquisition(Protocol):
    """One armed acquisition: call :meth:`step` at :attr:`due_s` until it gives what it found."""

    screen: Screen
    views: Mapping[int, ChannelView]
    due_s: float

    def step(self) -> Found | None:
        """Return capture and triggers once there is a complete record, else None (and a later `due_s`)."""
        ...

    def force(self) -> None:
        """Trigger whatever the signal does."""
        ...

    def close(self) -> None:
        """Give up."""
        ...


def acquisition(
    world: ScopeWorld, screen: Screen, views: Mapping[int, ChannelView], trigger: Trigger, pace: Pace
) -> Acquisition:
    """Arm: from AUTO sweep one record is wanted soon, otherwise nothing may be missed however long it takes."""
    kind = _Swept if pace.auto and not pace.segments else _Patient
    return kind(world, screen, views, trigger, pace)


class _Armed:
    """What both ways have in common."""

    def __init__(
        self, world: ScopeWorld, screen: Screen, views: Mapping[int, ChannelView], trigger: Trigger, pace: Pace
    ) -> None:
        self._world = world
        self.screen = screen
        self.views = views
        self._pace = pace
        self._search = TriggerSearch(trigger)
        self._forced = False
        # a little more than the screen, for skew and time base error
        self._before_s = max(0.0, -screen.left_s) * 1.001 + 1e-8
        self._after_s = max(0.0, screen.right_s) * 1.001 + 1e-8
        self._search_s = max(_SEARCH_S, screen.range_s)
        self._armed_s = world.clock.now()
        self.due_s = 0.0

    def force(self) -> None:
        """Trigger whatever the signal does."""
        self._forced = True

    def close(self) -> None:
        """Give up."""

    def _crossing(self, capture: Capture, start_s: float, stop_s: float) -> float | None:
        return self._search.find(Signals(capture, self.views), max(start_s, self._pace.not_before_s), stop_s)

    def _repeats_s(self) -> float:
        """Return the time of the further acquisitions of an average, which see the same steady signal."""
        return (self._pace.repeats - 1) * max(self._before_s + self._after_s, self._pace.holdoff_s)


class _Swept(_Armed):
    """AUTO sweep: capture after capture until there is a trigger or it is given up to wait."""

    def __init__(
        self, world: ScopeWorld, screen: Screen, views: Mapping[int, ChannelView], trigger: Trigger, pace: Pace
    ) -> None:
        super().__init__(world, screen, views, trigger, pace)
        self._found: Found | None = None
        self._arm()

    def _arm(self) -> None:
        self._start_s = self._world.clock.now()
        self.due_s = self._start_s + self._before_s + self._search_s + self._after_s
        self._capture = self._world.capture(self._start_s, self.due_s)

    def step(self) -> Found | None:
        """Return what was found once there is a complete record, else None (and a later `due_s`)."""
        if self._world.clock.now() < self.due_s:
            return None
        if self._found is None:
            self._found = self._look()
            if self._found is None:
                self._search_longer()
                self._arm()
                return None
            if self._pace.repeats > 1:
                self.due_s += self._repeats_s()
                return None
        return self._found

    def _search_longer(self) -> None:
        """Look for the trigger in a longer stretch, but not past the patience of AUTO."""
        longest = self._armed_s + AUTO_TRIGGER_S - self._world.clock.now()
        self._search_s = max(self._search_s, min(2.0 * self._search_s, longest))

    def _look(self) -> Found | None:
        opening = self._start_s + self._before_s
        crossing = self._crossing(self._capture, opening, opening + self._search_s)
        if crossing is not None:
            return Found(self._capture, (crossing,))
        waited = self._world.clock.now() - self._armed_s
        if self._forced or waited >= AUTO_TRIGGER_S:
            return Found(self._capture, (opening,))
        return None


class _Patient(_Armed):
    """NORMal sweep and segmented memory: everything is recorded from arming on, so that nothing is missed."""

    def __init__(
        self, world: ScopeWorld, screen: Screen, views: Mapping[int, ChannelView], trigger: Trigger, pace: Pace
    ) -> None:
        super().__init__(world, screen, views, trigger, pace)
        self._recording: Recording = world.record()
        self._triggers_s: list[float] = []
        self._from_s = self._armed_s + self._before_s
        self._waiting_since_s = self._from_s
        self._complete = False
        self.due_s = self._from_s + self._search_s + self._after_s

    def close(self) -> None:
        """Give up, or be done: nothing more is recorded."""
        self._recording.close()

    def step(self) -> Found | None:
        """Return what was found once there is a complete record, else None (and a later `due_s`)."""
        if self._world.clock.now() < self.due_s:
            return None
        if not self._complete:
            self._go_on()
            if not self._complete:
                return None
            self.close()
            if self._pace.repeats > 1 and not self._pace.segments:
                self.due_s += self._repeats_s()
                return None
        return Found(self._recording, tuple(self._triggers_s))

    def _go_on(self) -> None:
        """Take every trigger whose record is over; come back for the next."""
        now = self._world.clock.now()
        while not self._complete:
            trigger_s = self._next(now - self._after_s)
            if trigger_s is None:
                break
            self._take(trigger_s)
        if not self._complete:
            if not self._triggers_s:
                self._recording.forget(self._from_s - self._before_s - _REMEMBERED_S)
            self._search_s = min(2.0 * self._search_s, max(self._search_s, _LONGEST_SEARCH_S))
            self.due_s = max(now, self._from_s + self._after_s) + self._search_s

    def _take(self, trigger_s: float) -> None:
        self._triggers_s.append(trigger_s)
        self._complete = len(self._triggers_s) >= max(1, self._pace.segments)
        refilled_s = trigger_s + self._after_s + _REARM_S + self._before_s
        self._from_s = self._waiting_since_s = max(refilled_s, trigger_s + self._pace.holdoff_s)
        self._search_s = max(_SEARCH_S, self.screen.range_s)

    def _next(self, horizon_s: float) -> float | None:
        """Return the next trigger up to the horizon, real, forced or automatic."""
        if horizon_s - self._from_s > _STARTED_ANEW_S:
            self._from_s = horizon_s - _STARTED_ANEW_S
        crossing = self._crossing(self._recording, self._from_s, horizon_s)
        by_itself = self._waiting_since_s + AUTO_TRIGGER_S if self._pace.auto else math.inf
        if crossing is not None:
            return min(crossing, by_itself)
        if self._forced and horizon_s >= self._from_s:
            return horizon_s
        self._from_s = max(self._from_s, horizon_s)
        return by_itself if by_itself <= horizon_s else None
