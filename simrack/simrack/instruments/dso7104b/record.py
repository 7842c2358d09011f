"""Record of an oscilloscope: samples of a stretch of time with its errors, in any number of points."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator

import numpy as np
from msgspec import Struct
from numpy.typing import NDArray

from simrack.components import ended
from simrack.dense import Coarse
from simrack.instruments.dso7104b.inputs import ChannelView, Screen, Signals

_BLOCK_POINTS, _INTERPOLATED_POINTS = 1 << 14, 1 << 16
"""Samples worked out in one go: each by itself, and most of them from their neighbours."""
_DENSE_POINTS = 1024
_LEAST_SAVING, _MOST_SAVING = 4, 4096
_SAMPLE_RATE_HZ = 4e9
_MOST_AVERAGED = 256
"""Samples behind a point of high resolution, where nothing tells how fast the signal is."""
_AVERAGED_AT_ONCE = 1 << 16
_SCREEN_TELLS, _FINER = 2.6, 4.0
"""Times of the finest time: up to where the screen's points tell a signal, and of what else it is looked at."""
_UNKNOWN_POINTS = 1 << 17
"""Points that measurements are taken of, where nothing tells how fast the signal is."""
_MEASURED_MOST = 1 << 20
_PEAK_SAMPLES = 8
"""Samples behind each point of a peak detection at least, and at most altogether."""
_PEAK_MOST = 1 << 22


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
        """Return an oscilloscope without errors."""
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
    """A channel's samples in volts after the converter, and True if any was beyond it."""

    volts: NDArray[np.float64]
    clipped: bool
    step_v: float


class AcquiredRecord(Struct, frozen=True):
    """Treatment of the samples by an acquisition.

    Args:
        number: of the record.
        kind: NORM, AVER, HRES or PEAK.
        bits: of the converter with what averaging gains; 0 for as many as the waveform format carries.
        averages: acquisitions in one.
        rate_hz: samples a second.
    """

    number: int
    kind: str
    bits: int
    averages: int
    rate_hz: float


class Record:
    """Record of an acquisition, which can be looked at with any number of points."""

    def __init__(
        self, signals: Signals, trigger_s: float, screen: Screen, errors: ScopeErrors, kept: AcquiredRecord
    ) -> None:
        self._signals = signals
        self._capture = signals.capture
        self.trigger_s = trigger_s
        self.screen = screen
        self.views = signals.views
        self._errors = errors
        self.kept = kept
        self.number = kept.number

    def digitised(self, channel: int, points: int) -> Digitised:
        """Return `points` samples of `channel` over the screen."""
        return ended(self.digitising(channel, points))

    def digitising(self, channel: int, points: int, *, extremes: bool = False) -> Generator[None, None, Digitised]:
        """Return, after slices of work, so many samples of `channel` over the screen, or extremes by peak detection."""
        yield from self._signals.preparing(channel)
        blocks = []
        for block in (self.peak_blocks if extremes else self.blocks)(channel, points):
            blocks.append(block)
            yield
        volts, view = np.concatenate(blocks), self.views[channel]
        yield
        # codes 2...254 of 256 are data: 1 and 255 say that the sample is beyond the converter
        unit = view.range_v / 256
        low, high = view.offset_v - 126 * unit, view.offset_v + 126 * unit
        clipped = bool((volts < low - unit / 2).any() or (volts > high + unit / 2).any())
        return Digitised(volts, clipped, self._step_v(view))

    def _at_once(self, channel: int, points: int) -> int:
        """Return the number of samples, of so many over the screen, in one slice."""
        node, step_s = self.views[channel].node, self.screen.range_s / points
        fine = node is not None and self._capture.finest_s(node) < _LEAST_SAVING * step_s
        return self._signals.at_once(channel, step_s, _BLOCK_POINTS if fine else _INTERPOLATED_POINTS)

    def blocks(self, channel: int, points: int, block_points: int = 0) -> Iterator[NDArray[np.float64]]:
        """Yield the samples in blocks: eight million at once would take hundreds of megabytes."""
        view, step, noise = self.views[channel], self._step_v(self.views[channel]), self._noise(channel, points)
        share = self._averaged(channel, points) if self.kept.kind == "HRES" else 1
        block_points = block_points or max(1, self._at_once(channel, points * share) // share)
        for start in range(0, points, block_points):
            count = min(block_points, points - start)
            volts = self._analogue(channel, points, start, count, share)
            if self._errors.noise_div:
                volts += self._noise_v(view, points) * noise(start, count)
            yield _stepped(volts, step, view.offset_v) if step else volts

    def peak_blocks(self, channel: int, points: int) -> Iterator[NDArray[np.float64]]:
        """Yield alternately the smallest and the largest of the samples behind each pair of points (peak detect)."""
        samples = 2 * self._peak_samples(channel, points)
        pairs = max(1, self._at_once(channel, points * samples // 2) // samples)
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

    def _averaged(self, channel: int, points: int) -> int:
        """Return how many samples high resolution averages for a point: of all there are so many as it takes."""
        node = self.views[channel].node
        step_s = self.screen.range_s / points
        finest = math.inf if node is None else self._capture.finest_s(node)
        enough = math.ceil(0.5 * step_s / finest) if finest else _MOST_AVERAGED
        return max(1, min(enough, int(step_s * self.kept.rate_hz), _AVERAGED_AT_ONCE))

    def measured_points(self, channel: int, few: int) -> int:
        """Return of how many points measurements are taken: of the screen's, or of the memory's where those miss it.

        That is where a sine would have less than 48 points in a period; of the memory then as many as tell the signal.
        """
        node = self.views[channel].node
        finest = math.inf if node is None else self._capture.finest_s(node)
        if self.kept.kind in {"AVER", "HRES", "PEAK"} or self.screen.range_s <= _SCREEN_TELLS * finest * few:
            return few
        enough = math.ceil(_FINER * self.screen.range_s / finest) if finest else _UNKNOWN_POINTS
        return int(max(few, min(enough, _MEASURED_MOST, self.screen.range_s * self.kept.rate_hz)))

    def _step_v(self, view: ChannelView) -> float:
        return view.range_v / 2**self.kept.bits if self.kept.bits else 0.0

    def _analogue(self, channel: int, points: int, start: int, count: int, share: int = 1) -> NDArray[np.float64]:
        """Return the converter's input at `count` of `points` sample times, from the `start`-th on.

        With a `share` each is the mean of so many samples about its time.
        """
        if share > 1:
            dense = self._dense(channel, points * share, start * share, count * share, (share - 1) / 2.0)
            return np.asarray(dense.reshape(-1, share).mean(axis=1))
        return self._dense(channel, points, start, count)

    def _dense(self, channel: int, points: int, start: int, count: int, early: float = 0.0) -> NDArray[np.float64]:
        gain = 1.0 + self._errors.gain_error[channel - 1]
        offset_v = self._errors.offset_error_div[channel - 1] * self.views[channel].range_v / 8.0
        coarse = self._coarse(channel, points, start, count, early)
        if coarse is None:
            times = self.screen.times_s(points, start, count) - early * (self.screen.range_s / points)
            return self._signals.volts(channel, self._real_s(channel, times)) * gain + offset_v
        few = self._signals.volts(channel, coarse.times_s())
        return coarse.interpolated(few * gain + offset_v)

    def _coarse(self, channel: int, points: int, start: int, count: int, early: float) -> Coarse | None:
        """Return the times from which a block is interpolated, None where it must be looked at point by point."""
        node = self.views[channel].node
        if count < _DENSE_POINTS or node is None:
            return None
        step = self.screen.range_s / points / (1.0 + self._errors.time_base_error)
        first = self._real_s(channel, self.screen.times_s(points, start, 1))[0] - early * step
        share = int(min(self._capture.finest_s(node) / step, _MOST_SAVING))
        # the cubics of both ends reach beyond them: what jumps there would show here
        reach = 2 * share * step
        if share < _LEAST_SAVING or not self._capture.whole(first - reach, first + count * step + reach):
            return None
        return Coarse(float(first), step, count, share)

    def _real_s(self, channel: int, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        # a fast clock samples early: what it calls t is really t / (1 + error)
        return self.trigger_s + times_s / (1.0 + self._errors.time_base_error) - self._errors.skew_s[channel - 1]

    def _noise(self, channel: int, points: int) -> Callable[[int, int], NDArray[np.float64]]:
        """Return a function for the noise of points from one on: a draw each, or draws of real samples joined."""
        draws = np.random.default_rng((self.number, channel, self._errors.noise_seed))
        samples = self.screen.range_s * _SAMPLE_RATE_HZ
        if samples >= points:
            return lambda _, count: draws.standard_normal(count)
        sampled = draws.standard_normal(math.ceil(samples) + 1)
        return lambda start, count: np.interp(
            np.arange(start, start + count) * (samples / points), np.arange(len(sampled)), sampled
        )

    def _noise_v(self, view: ChannelView, points: int) -> float:
        averages = self.kept.averages
        if self.kept.kind == "HRES":
            averages = max(1, int(self.screen.range_s * self.kept.rate_hz / points))
        return self._errors.noise_div * view.range_v / 8.0 / math.sqrt(averages)


def _stepped(volts: NDArray[np.float64], step_v: float, offset_v: float) -> NDArray[np.float64]:
    """Return volts in the steps of the converter."""
    volts -= offset_v
    volts /= step_v
    np.round(volts, out=volts)
    volts *= step_v
    volts += offset_v
    return volts
