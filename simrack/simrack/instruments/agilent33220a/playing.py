"""Played signal of a function generator: an offset, and one waveform by a phase that goes on in its own way.

`at` gives the volts of any instant. `piece` gives what a curved input makes of them below `HIGHEST_HZ`, by means over
stretches of the phase, so that neither a fast carrier nor its edges are sampled:

- a level or straight line up to the next corner, where corners are seldom,
- the lines of its spectrum, while the frequency stays,
- else 1/64 s as a sum of cosines, from means over `BINS` equal parts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from simrack.components import Component
from simrack.instruments.agilent33220a.envelopes import Envelope, WidthSwing
from simrack.instruments.agilent33220a.phases import Phase, Steady, SteadyRun
from simrack.instruments.agilent33220a.waveforms import FAST_HZ, POWERS, Cycle, Values
from simrack.sources import HIGHEST_HZ, Bend, Piece

if TYPE_CHECKING:
    from numpy.typing import NDArray

PIECE_S = 1 / 64
BINS = 4096
_SELDOM_HZ, _OFTEN_HZ = 64.0, 512.0
"""Corners that come less often than the first are taken one by one; up to the second where there are too many lines."""
_LINES_HZ = 16.0
"""From where on a waveform's lines are few enough."""
_MOST_LINES, _HIGHEST_LINE_HZ = 1000, 64e3
"""Lines cost little, and what is missing of the sum where it begins is felt as a kick: it is a hundredth then."""
_SHORTEST_S = 1e-9
_TICKED = 1e-3
"""A tick that is less than this part of one away has been."""
_BENDS = 16
_FORGOTTEN = 1e-13


class Playing(Struct, frozen=True):
    """offset_v + peak_v envelope(t) waveform(phase(t)); a negative peak is an inverted waveform.

    With a `clock_hz` the volts change at its ticks alone: of more points than ticks some are skipped. Means know
    nothing of it, which are off by what half a tick makes.
    """

    offset_v: float
    peak_v: float
    waveform: Cycle
    phase: Phase
    envelope: Envelope | None = None
    width: WidthSwing | None = None
    source_ohm: float = 50.0
    clock_hz: float = 0.0

    def at(self, times_s: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the open-circuit volts at bench times."""
        if self.clock_hz:
            times_s = np.floor(times_s * self.clock_hz + _TICKED) / self.clock_hz
        duty = None if self.width is None else self.width.values(times_s)
        volts = self.peak_v * self.waveform.values(_fraction(self.phase.at(times_s)), duty)
        if self.envelope is not None:
            volts *= self.envelope.values(times_s)
        return np.asarray(volts + self.offset_v)

    def piece(self, start_s: float, bend: Bend) -> Piece:
        """Return the signal after the input's non-linearity, from `start_s`."""
        if self.envelope is None and self.width is None:
            if self.phase.slowest_hz > FAST_HZ:
                return Piece(start_s, math.inf, self._cycle_mean(bend))
            run = self.phase.run(start_s)
            if run is not None and run.until_s - start_s > 1 / _SELDOM_HZ and (piece := self._run(start_s, run, bend)):
                return piece
        stop = start_s + PIECE_S
        edges = np.linspace(start_s, stop, BINS + 1)
        return Piece(start_s, stop, *cosines(self._bin_means(edges, bend), PIECE_S))

    def divided(self, share: float) -> Playing:
        """Return the signal behind a load."""
        offset_v, peak_v = self.offset_v * share, self.peak_v * share
        return replace(self, offset_v=offset_v, peak_v=peak_v, source_ohm=self.source_ohm * share)

    def at_frequency(self, hertz: float) -> Playing:
        """Return the signal as it would be with nothing but one frequency."""
        return replace(self, phase=Steady(hertz), envelope=None, width=None)

    def components(self) -> tuple[Component]:
        """Return that it is one."""
        from simrack.instruments.agilent33220a.banded import Banded  # noqa: PLC0415  (only where it is looked at so)

        return (Banded(self),)

    # --- while the frequency stays ------------------------------------------------------------------------------

    def _run(self, start_s: float, run: SteadyRun, bend: Bend) -> Piece | None:
        if run.hz == 0.0:
            return Piece(start_s, run.until_s, float(bent(self.at(np.array([start_s])), bend)[0]))
        if run.hz >= FAST_HZ:
            return Piece(start_s, run.until_s, self._cycle_mean(bend))
        corners = self.waveform.corners
        often_hz = math.inf if corners is None else len(corners) * run.hz
        if (run.hz >= _LINES_HZ and often_hz > _SELDOM_HZ) or corners is None:
            # Lines of its spectrum
            edges = np.arange(BINS + 1) / BINS
            means = [np.diff(self.waveform.integral(power, edges)) * BINS for power in POWERS]
            made = self._mixed(means, bend, 1.0)
            order = np.arange(1, min(int(_HIGHEST_LINE_HZ / run.hz), _MOST_LINES) + 1)
            spectrum = 2 * np.fft.rfft(made)[order] / BINS / np.sinc(order / BINS)
            spectrum *= np.exp(2j * math.pi * order * (run.cycles % 1.0 - 0.5 / BINS))
            least = _FORGOTTEN * max(float(np.abs(made).max()), 1e-300)
            terms = [
                (complex(a), 2j * math.pi * run.hz * float(n))
                for a, n in zip(spectrum, order, strict=True)
                if abs(a) > least
            ]
            return Piece(start_s, run.until_s, float(made.mean()), 0.0, tuple(terms))
        return self._straight(start_s, run, corners, bend) if often_hz < _OFTEN_HZ else None

    def _straight(self, start_s: float, run: SteadyRun, corners: tuple[float, ...], bend: Bend) -> Piece:
        """Return the piece up to the next corner: a chord, and the input's bend of it as sines."""
        place = run.cycles % 1.0
        soon = run.hz * _SHORTEST_S
        far = next((each for each in (*corners, 1.0 + corners[0]) if each > place + soon), 2.0)
        stop = max(min(start_s + (far - place) / run.hz, run.until_s), start_s + _SHORTEST_S)
        lasts = stop - start_s
        inner = self.waveform.values(_fraction(place + np.array([0.25, 0.75]) * lasts * run.hz))
        first, rise = 1.5 * inner[0] - 0.5 * inner[1], 2 * (inner[1] - inner[0])
        parts = np.arange(4 * _BENDS + 1) / (4 * _BENDS)
        made = bent(self.offset_v + self.peak_v * (first + rise * parts), bend)
        chord = float(made[-1] - made[0])
        return Piece(start_s, stop, float(made[0]), chord / lasts, _sines(made - made[0] - chord * parts, lasts))

    # --- means ---------------------------------------------------------------------------------------------------

    def _cycle_mean(self, bend: Bend) -> float:
        one = np.ones(1)
        return float(self._mixed([self.waveform.integral(power, one) for power in POWERS], bend, 1.0)[0])

    def _mixed(self, means: list[Values], bend: Bend, envelope: float | Values) -> Values:
        """Return the mean of the bent volts from the means of the waveform's powers."""
        d, a = self.offset_v, self.peak_v * envelope
        s1, s2, s3 = means
        square = d * d + 2 * d * a * s1 + a * a * s2
        cube = d**3 + 3 * d * d * a * s1 + 3 * d * a * a * s2 + a**3 * s3
        return np.asarray(bend[0] + bend[1] * (d + a * s1) + bend[2] * square + bend[3] * cube)

    def _bin_means(self, edges_s: Values, bend: Bend) -> Values:
        """Return the mean of the bent volts between each two of `edges_s`, intervals split at breaks of the phase."""
        breaks = self.phase.breaks(float(edges_s[0]), float(edges_s[-1]))
        if not len(breaks):
            return self._part_means(edges_s, bend)
        parts = np.union1d(edges_s, breaks)
        areas = self._part_means(parts, bend) * np.diff(parts)
        return np.asarray(np.add.reduceat(areas, np.searchsorted(parts, edges_s[:-1])) / np.diff(edges_s))

    def _part_means(self, edges_s: Values, bend: Bend) -> Values:
        envelope = 1.0 if self.envelope is None else self.envelope.means(edges_s)
        return self._mixed(self.power_means(edges_s), bend, envelope)

    def power_means(self, edges_s: Values, powers: Sequence[int] = POWERS, fast_hz: float = FAST_HZ) -> list[Values]:
        """Return the means of the waveform's powers between each two of the edges; above `fast_hz` those of a cycle."""
        cycles = self.phase.at(edges_s)
        duty = None if self.width is None else self.width.values((edges_s[1:] + edges_s[:-1]) / 2)
        steps = np.diff(cycles)
        if bool(np.all(np.abs(steps) > fast_hz * np.diff(edges_s))):
            one = np.ones_like(steps)
            return [self.waveform.integral(power, one, duty) for power in powers]
        whole = np.floor(cycles)
        places, passed = cycles - whole, np.diff(whole)
        moves = np.abs(steps) > 1e-9
        still = self.waveform.values(_fraction(cycles[:-1] + steps / 2), duty)
        means = []
        for power in powers:
            one = self.waveform.integral(power, np.ones(1), None if duty is None else duty[:1])
            full = one if duty is None else self.waveform.integral(power, np.ones_like(steps), duty)
            grown = self.waveform.integral(power, places[1:], duty) - self.waveform.integral(power, places[:-1], duty)
            means.append(np.where(moves, (grown + full * passed) / np.where(moves, steps, 1.0), still**power))
        return means


def bent(volts: Values, bend: Bend) -> Values:
    """Return volts after the non-linearity of an input."""
    return np.asarray(bend[0] + volts * (bend[1] + volts * (bend[2] + volts * bend[3])))


def cosines(means: Values, lasts_s: float) -> tuple[float, float, tuple[tuple[complex, complex], ...]]:
    """Return constant, slope and terms up to `HIGHEST_HZ` of a signal with these means of equal parts of `lasts_s`."""
    count = len(means)
    order = np.arange(1, int(2 * lasts_s * HIGHEST_HZ) + 1)
    spectrum = np.fft.rfft(np.concatenate((means, means[::-1])))
    sizes = (spectrum[order] * np.exp(-0.5j * math.pi * order / count)).real / count / np.sinc(order / (2 * count))
    speeds = 1j * math.pi / lasts_s * order
    return float(means.mean()), 0.0, tuple(zip(sizes.astype(complex).tolist(), speeds.tolist(), strict=True))


def _sines(values: Values, lasts_s: float) -> tuple[tuple[complex, complex], ...]:
    """Return the sine terms of values at even times, 0 at both ends."""
    if float(np.abs(values).max()) == 0.0:
        return ()
    order = np.arange(1, _BENDS + 1)
    spectrum = np.fft.rfft(np.concatenate((values[:-1], -values[:0:-1])))[order]
    sizes = 1j * spectrum.imag / (len(values) - 1)  # sin x = Re(-j e^{jx})
    return tuple(zip(sizes.tolist(), (1j * math.pi / lasts_s * order).tolist(), strict=True))


def _fraction(cycles: Values) -> Values:
    return np.asarray(cycles - np.floor(cycles))
