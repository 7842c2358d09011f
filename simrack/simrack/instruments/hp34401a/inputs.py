"""Input stage of the 34401A: a reading of any function, with the specimen's errors."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Generator, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from msgspec import Struct
from msgspec.structs import replace

from simrack.components import ended
from simrack.instruments.hp34401a import counter, ohms
from simrack.instruments.hp34401a.ac import SETTLING_S, AcResponse, Detected, crest_limit, detecting
from simrack.instruments.hp34401a.calculation import OVERLOAD
from simrack.instruments.hp34401a.corrections import Corrections
from simrack.instruments.hp34401a.current import open_ac_input_a, open_dc_input_a
from simrack.instruments.hp34401a.functions import APERTURES_S, Function
from simrack.instruments.hp34401a.imperfections import MeterErrors
from simrack.instruments.hp34401a.setup import Setup
from simrack.specifications import HP_34401A, VoltmeterSpecification
from simrack.trace import History, Piece

__all__ = ["FAST_APERTURES_S", "Inputs", "MeasuringConditions", "MeterErrors", "MeterReading"]

FAST_APERTURES_S = MappingProxyType({0.02: 400e-6, 0.2: 3e-3})
"""Integration below one cycle does not depend on the line (p. 217)."""
_OVERHEAD_S = {0.02: 0.6e-3, 0.2: 0.33e-3}
"""What the published reading rates leave beside integration and delay (p. 217; inferred)."""
_USUAL_RANGE_V, _YEAR_DAYS = 10.0, 365.0
_UNZEROED, _UNZEROED_V = 2e-6, 5e-6
"""Published error while autozero is off (p. 216)."""
_LOOKED_AT_V = 1.0
"""On ranges up to this the peaks of a direct voltage are looked at: no source of the bench overloads the others so."""
_PEAK_LOOKS = 1 << 12
_SAMPLE_STEP = 4e-4
"""Resolution of a sample as a part of its range: ten steps of a converter of 16 bits (a DMM6500's, unverified)."""
_SAMPLES_AT_ONCE = 1 << 12
"""Samples of a slice."""
_AC_READING_S = 0.02
"""50 readings a second with the settling delays defeated (p. 219)."""
_RANGING_S = 0.02
"""How long an ac signal is looked at to find its range (unverified; p. 219 gives a limit for the whole)."""
_CREST_FACTOR = 5.0
"""Peaks beyond this times the range overload the ac amplifier (p. 218: crest factor 5:1 at full scale)."""
_LEAST_AC_V = 0.01
"""Below 10 % of the lowest range a counter sees no signal and reads 0 (p. 61)."""
_LEAST_PART = 0.01
"""So it does below this part of a fixed range (unverified)."""
_AC_DIGIT = 1e-6
"""Resolution of the ac functions as a part of the range: always 6.5 digits (p. 57)."""
_AC_LIMIT_LOWEST, _AC_LIMIT = 4e-4, 3e-4
"""Published error of range of ac voltage, on the lowest range and above (p. 218)."""


class MeterReading(Struct, frozen=True):
    """A reading under way: `value()` may be asked for from `end_s` on, and may be a further reading that it needs.

    What takes this computer long has `labour` too, which returns the same at its end.
    """

    end_s: float
    value: Callable[[], float | MeterReading]
    labour: Callable[[], Generator[None, None, float | MeterReading]] | None = None

    @classmethod
    def in_slices(cls, end_s: float, labour: Callable[[], Generator[None, None, float | MeterReading]]) -> MeterReading:
        """Return a reading that is worked out slice by slice."""
        return cls(end_s, lambda: ended(labour()), labour)


class MeasuringConditions(Struct, frozen=True):
    """Conditions of a reading in addition to function and setup.

    Args:
        autozero: whether a zero is taken with each reading.
        high_impedance: whether the lower direct-voltage ranges have more than 10 Gohm.
        filter_hz: the ac filter.
        delay_s: from trigger, or a change of range, to the measurement.
    """

    autozero: bool = True
    high_impedance: bool = False
    filter_hz: float = 20.0
    delay_s: float = 0.0


class _Scale(Struct, frozen=True):
    """A range, its over-range, the resolution, and the noise that a short integration adds, rms."""

    range: float
    over_range: float
    resolution: float
    added_noise: float = 0.0


class _Share(NamedTuple):
    """The errors of a range as multiples of those of the 10 V range, by their published limits."""

    reading: float
    offset: float
    unzeroed: float


_USUAL = _Share(1.0, 1.0, 1.0)


def _shares(sheet: VoltmeterSpecification) -> dict[float, _Share]:
    """Return the errors of the ranges that a data sheet knows."""
    usual = sheet.accuracy_of(_USUAL_RANGE_V, _YEAR_DAYS)
    limits = {range_v: sheet.accuracy_of(range_v, _YEAR_DAYS) for range_v in sheet.accuracy}
    return {
        range_v: _Share(
            limit.reading / usual.reading,
            limit.range * range_v / (usual.range * _USUAL_RANGE_V),
            (_UNZEROED * range_v + _UNZEROED_V) / (_UNZEROED * _USUAL_RANGE_V + _UNZEROED_V),
        )
        for range_v, limit in limits.items()
    }


class Inputs:
    """The input terminals on a node.

    Args:
        world: the World the node is in, or leads to it.
        node: the node between the HI and LO terminals.
        errors: imperfections of the specimen.
        mains_hz: line frequency.
        sense: the node between the sense terminals, None while they are open.
        fast_apertures_s: integration times that do not depend on the line, by power line cycles.
        sheet: what is published of its direct voltages.
    """

    def __init__(
        self,
        world: Any,
        node: str,
        errors: MeterErrors,
        *,
        mains_hz: float,
        sense: str | None,
        fast_apertures_s: Mapping[float, float] = FAST_APERTURES_S,
        sheet: VoltmeterSpecification = HP_34401A,
    ) -> None:
        self._world = world
        self._node = node
        self._sense = sense
        self._errors = errors
        self._mains_hz = mains_hz
        self._fast_apertures_s = fast_apertures_s
        self._sheet = sheet
        self._shares = _shares(sheet)
        self._noise = random.Random(errors.noise_seed)  # noqa: S311  (noise, not secrets)
        self._history: History | None = None
        self.corrections = Corrections()
        """What calibrations have changed."""

    def aperture_s(self, nplc: float) -> float:
        """Return the integration time of `nplc` power line cycles."""
        return self._fast_apertures_s.get(nplc, nplc / self._mains_hz)

    def route(self, function: Function) -> None:
        """Switch the input to a function: the ac path sees the signal from now on, and has to settle."""
        if self._history is not None:
            self._history.end()
        wanted = function.alternating and function.unit != "A"
        self._history = self._world.trace(max(SETTLING_S.values()) + 1.0) if wanted else None

    # --- beginning a reading ------------------------------------------------------------------------------

    def begin(self, function: Function, start_s: float, setup: Setup, conditions: MeasuringConditions) -> MeterReading:
        """Start a reading on a trigger at `start_s`; alternating ones find their range, which they leave in `setup`."""
        if function.unit == "A":
            return self._current(function, start_s, setup, conditions)
        if function.alternating:
            if not setup.auto:
                return self._ac(function, start_s + conditions.delay_s, setup, conditions)
            ranged = function.voltage_ranged

            def look() -> Generator[None, None, MeterReading]:
                level = yield from self._detected(start_s, start_s + _RANGING_S, conditions.filter_hz)
                better = _fitting(ranged, setup.range, level.rms_v, level.peak_v)
                begun = start_s + _RANGING_S + (function.autorange_s if better != setup.range else 0.0)
                setup.range = better
                return self._ac(function, begun + conditions.delay_s, setup, conditions)

            return MeterReading.in_slices(start_s + _RANGING_S, look)
        return self._integrated(function, start_s + conditions.delay_s, setup, conditions)

    def autorange(self, function: Function, range_: float) -> float:
        """Return the range for the signal now: up above 120 %, down below 10 % of the present one (p. 53)."""
        if function.unit == "OHM":
            # Range of ohms; the test current goes with the range, so each range is tried
            if self._sense_open(function):
                return function.ranges[-1]
            node_v, source_ohm = self._world.value_v(self._node), self._world.source_ohm(self._node)
            levels = {each: abs(ohms.resistance_ohm(node_v, source_ohm, each)) for each in function.ranges}
            if 0.1 * range_ <= levels[range_] <= range_ * function.over_range_of(range_):
                return range_
            fits = (each for each, level in levels.items() if level <= each * function.over_range_of(each))
            return next(fits, function.ranges[-1])
        if function.unit == "A":
            return _fitting(function, range_, 0.0)
        return _fitting(function, range_, abs(self._world.value_v(self._node)))

    def frequency_hz(self) -> float:
        """Return the frequency of the ac path's signal in the last second, 0 without a signal."""
        now, response = self._world.clock.now(), self._response(20.0)
        counting = counter.counting(self._pieces(), (now - 1.0, now), now, response, _LEAST_AC_V)
        return ended(counting).frequency_hz

    # --- direct voltage, ohms -----------------------------------------------------------------------------

    def _integrated(
        self, function: Function, start_s: float, setup: Setup, conditions: MeasuringConditions
    ) -> MeterReading:
        aperture = self.aperture_s(setup.nplc)
        autozero = conditions.autozero or function.name in ("FRES", "VOLT:RAT")
        end = start_s + aperture * (2 if autozero else 1) + _OVERHEAD_S.get(setup.nplc, 0.0)
        window = self._world.window(self._node, start_s, start_s + aperture)
        scale = self._scale(function, setup.range, setup.nplc)
        if function.name == "VOLT":
            loading = self.loading(setup.range, high_impedance=conditions.high_impedance)
            peak = self._peak(start_s, start_s + aperture) if setup.range <= _LOOKED_AT_V else None

            def volts() -> float | MeterReading:
                seen_v = window.mean_v() * loading
                most_v = seen_v if peak is None else max(seen_v, peak() * loading, key=abs)
                again = self._integrated_again(function, setup, conditions, most_v)
                return again or self._as_read(seen_v, scale, most_v, autozero=autozero)

            return MeterReading(end, volts)
        if function.name == "VOLT:RAT":
            return self._ratio(function, window.mean_v, scale, start_s, setup.nplc)
        return MeterReading(end, lambda: self._resistive(function, window.mean_v(), scale))

    def digitised(
        self,
        function: Function,
        times: tuple[float, float, range],
        range_: float,
        keep: Callable[[list[tuple[float, float]]], None],
        *,
        high_impedance: bool,
    ) -> MeterReading:
        """Start samples amid intervals: `times` are start, interval, and which `keep` gets, but for the last."""
        start_s, interval_s, wanted = times
        stop_s = start_s + wanted.stop * interval_s
        looked_at, loading = self._world.capture(start_s, stop_s), self.loading(range_, high_impedance=high_impedance)
        scale = _Scale(range_, function.over_range_of(range_), _SAMPLE_STEP * range_)
        open_a = open_dc_input_a(self._errors.current, range_) if function.unit == "A" else 0.0

        def labour() -> Generator[None, None, float]:
            import numpy as np  # noqa: PLC0415  (only where samples are taken)

            taken: list[tuple[float, float]] = []
            for first in range(wanted.start, wanted.stop, _SAMPLES_AT_ONCE):
                keep(taken)
                at_s = start_s + (np.arange(first, min(first + _SAMPLES_AT_ONCE, wanted.stop)) + 0.5) * interval_s
                if function.unit == "A":
                    shown = [self._shown(open_a, scale.resolution) for _ in at_s]
                else:
                    true = (looked_at.samples(self._node, at_s) * loading).tolist()
                    shown = [self._as_read(each, scale, each, autozero=False) for each in true]
                taken = list(zip(shown, at_s.tolist(), strict=True))
                yield
            keep(taken[:-1])
            return taken[-1][0]

        return MeterReading.in_slices(stop_s, labour)

    def _scale(self, function: Function, range_: float, nplc: float) -> _Scale:
        fraction, added = function.fraction_of(nplc), 0.0
        if self._errors.short_noise and function.unit == "V":
            added = self._errors.short_noise * self._sheet.added_noise_v(range_, nplc)
        return _Scale(range_, function.over_range_of(range_), fraction * range_, added)

    def _peak(self, start_s: float, stop_s: float) -> Callable[[], float]:
        """Look at the terminals between two times, and return a function that finds the voltage farthest from 0.

        Of a node of the PCB itself that is not said, 0: its noise would have to be drawn for it, reading by reading.
        """
        import numpy as np  # noqa: PLC0415  (only where a range can be overloaded by peaks)

        looked_at = self._world.capture(max(start_s, self._world.clock.now()), stop_s)

        def farthest_v() -> float:
            if not looked_at.fed(self._node):
                return 0.0
            times = start_s + (np.arange(_PEAK_LOOKS) + 0.5) * ((stop_s - start_s) / _PEAK_LOOKS)
            volts = looked_at.samples(self._node, times)
            return float(volts[np.abs(volts).argmax()])

        return farthest_v

    def _integrated_again(
        self, function: Function, setup: Setup, conditions: MeasuringConditions, seen_v: float
    ) -> MeterReading | None:
        """Autorange that meets an overload, because the voltage has changed meanwhile, takes a higher range."""
        if not setup.auto or (higher := _fitting(function, setup.range, abs(seen_v))) <= setup.range:
            return None
        setup.range = higher
        begun = self._world.clock.now() + function.autorange_s
        return self._integrated(function, begun + conditions.delay_s, setup, conditions)

    def loading(self, range_: float, *, high_impedance: bool) -> float:
        """Return the part of the node's open voltage that the input resistance leaves (p. 53)."""
        if math.isinf(self._errors.input_ohm) or (high_impedance and range_ <= 10.0):
            return 1.0
        source_ohm = self._world.source_ohm(self._node)  # nothing is there, whatever loads it, where a lead hangs free
        return 1.0 if math.isinf(source_ohm) else self._errors.input_ohm / (self._errors.input_ohm + source_ohm)

    def _as_read(self, true_v: float, scale: _Scale, most_v: float, *, autozero: bool) -> float:
        """Return a reading of a mean, an overload by the volts farthest from 0."""
        if abs(most_v) > scale.range * scale.over_range:
            return math.copysign(OVERLOAD, most_v)
        errors, share = self._errors, self._shares.get(scale.range, _USUAL)
        reading = true_v * (1.0 + errors.gain_error * share.reading) + errors.offset_v * share.offset
        if not autozero:
            reading += errors.unzeroed_offset_v * share.unzeroed
        return self._shown(self.corrections.apply("VOLT", scale.range, reading), scale.resolution, scale.added_noise)

    def _shown(self, reading: float, resolution: float, added_noise: float = 0.0) -> float:
        """Return a reading with the converter's noise, in its steps."""
        if self._errors.noise:
            noise = self._errors.noise * resolution
            reading += self._noise.gauss(0.0, math.hypot(noise, added_noise) if added_noise else noise)
        if self._errors.quantised:
            step = resolution / 10.0
            reading = round(reading / step) * step
        return reading

    def _ratio(
        self, function: Function, signal_v: Callable[[], float], scale: _Scale, start_s: float, nplc: float
    ) -> MeterReading:
        """Both inputs are read one after the other, each with its zero; the reference up to 12 V (p. 52, 217)."""
        aperture = self.aperture_s(nplc)
        middle, end = start_s + 2 * aperture, start_s + 4 * aperture + _OVERHEAD_S.get(nplc, 0.0)
        if self._sense is None:
            return MeterReading(end, lambda: OVERLOAD)
        reference = self._world.window(self._sense, middle, middle + aperture)

        def value() -> float:
            of_sense = self._scale(function, 10.0, nplc)
            below_v, above_v = reference.mean_v(), signal_v()
            below = self._as_read(below_v, of_sense, below_v, autozero=True)
            above = self._as_read(above_v, scale, above_v, autozero=True)
            overloaded = OVERLOAD in (abs(below), abs(above)) or below == 0.0
            return OVERLOAD if overloaded else above / below

        return MeterReading(end, value)

    def _sense_open(self, function: Function) -> bool:
        return function.unit in {"C", "F"} or (function.name == "FRES" and self._sense is None)

    def _resistive(self, function: Function, node_v: float, scale: _Scale) -> float:
        source_ohm = self._world.source_ohm(self._node)
        if function.name == "DIOD":
            by_1_ma = OVERLOAD if math.isinf(source_ohm) else node_v + ohms.TEST_CURRENT_A[1e3] * source_ohm
            return self._diode(by_1_ma, scale)
        if self._sense_open(function):
            return OVERLOAD
        leads = 0.0 if function.name == "FRES" else self._errors.ohms.lead_ohm
        true_ohm = ohms.resistance_ohm(node_v, source_ohm + leads, scale.range)
        if abs(true_ohm) > scale.range * scale.over_range:
            return math.copysign(OVERLOAD, true_ohm)
        errors, limits = self._errors.ohms, ohms.limits(scale.range)
        reading = true_ohm * (1.0 + errors.reading_share * limits.reading)
        reading += errors.range_share * limits.range * scale.range
        name = "RES" if function.name == "CONT" else function.name
        return self._shown(self.corrections.apply(name, scale.range, reading), scale.resolution)

    def _diode(self, true_v: float, scale: _Scale) -> float:
        if abs(true_v) > scale.range * scale.over_range:
            return math.copysign(OVERLOAD, true_v)
        errors = self._errors.ohms
        reading = true_v * (1.0 + 1e-4 * errors.reading_share) + 2e-4 * errors.range_share * scale.range  # p. 216
        return self._shown(reading, scale.resolution)

    # --- current ------------------------------------------------------------------------------------------

    def _current(
        self, function: Function, start_s: float, setup: Setup, conditions: MeasuringConditions
    ) -> MeterReading:
        start_s += conditions.delay_s
        range_, errors = setup.range, self._errors.current
        if function.alternating:
            own = self.corrections.apply(function.name, range_, open_ac_input_a(errors, range_))
            return MeterReading(start_s + _AC_READING_S, lambda: self._shown(own, _AC_DIGIT * range_))
        own = self.corrections.apply(function.name, range_, open_dc_input_a(errors, range_))
        aperture = self.aperture_s(setup.nplc) * (2 if conditions.autozero else 1)
        end = start_s + aperture + _OVERHEAD_S.get(setup.nplc, 0.0)
        return MeterReading(end, lambda: self._shown(own, function.fraction_of(setup.nplc) * range_))

    # --- alternating voltage, frequency, period -----------------------------------------------------------

    def _ac(self, function: Function, start_s: float, setup: Setup, conditions: MeasuringConditions) -> MeterReading:
        if function.gated:
            return self._gate(function, start_s, setup, conditions)
        stop = start_s + _AC_READING_S

        def value() -> Generator[None, None, float | MeterReading]:
            seen = yield from self._detected(stop - SETTLING_S[conditions.filter_hz], stop, conditions.filter_hz)
            return self._again(function, setup, conditions, seen) or self._rms(function, setup.range, seen)

        return MeterReading.in_slices(stop, value)

    def _again(
        self, function: Function, setup: Setup, conditions: MeasuringConditions, seen: Detected
    ) -> MeterReading | None:
        """Autorange that looked too briefly at a slow signal finds out in the end, and takes another range."""
        ranged = function.voltage_ranged
        if not setup.auto or not _overloads(ranged, setup.range, seen) or setup.range == ranged.ranges[-1]:
            return None
        setup.range = ranged.ranges[ranged.ranges.index(setup.range) + 1]
        begun = self._world.clock.now() + function.autorange_s
        return self._ac(function, begun + conditions.delay_s, setup, conditions)

    def _rms(self, function: Function, range_: float, seen: Detected) -> float:
        if _overloads(function, range_, seen):
            return OVERLOAD
        errors = self._errors.ac
        crest = crest_limit(seen.peak_v / seen.rms_v) if seen.rms_v else 0.0
        part = _AC_LIMIT_LOWEST if range_ == function.ranges[0] else _AC_LIMIT
        relative = errors.range_gain_error[function.ranges.index(range_)] + errors.crest_share * crest
        reading = seen.rms_v * (1.0 + relative) + errors.range_share * part * range_
        reading = self.corrections.apply(function.name, range_, reading)
        if errors.noise:
            reading += self._noise.gauss(0.0, errors.noise * range_)
        if self._errors.quantised:
            step = _AC_DIGIT * range_
            reading = round(reading / step) * step
        return max(reading, 0.0)

    def _gate(self, function: Function, start_s: float, setup: Setup, conditions: MeasuringConditions) -> MeterReading:
        gate, ranged = setup.aperture_s, function.voltage_ranged
        stop = start_s + gate

        def value(known: float) -> Generator[None, None, float | MeterReading]:
            seen = yield from self._detected(start_s, stop, conditions.filter_hz)
            yield
            if _overloads(ranged, setup.range, seen):
                return self._again(function, setup, conditions, seen) or OVERLOAD
            least = max(_LEAST_AC_V, _LEAST_PART * setup.range)
            response = self._response(conditions.filter_hz)
            counted = yield from counter.counting(self._pieces(), (start_s, stop), known, response, least)
            begun = math.isfinite(counted.closes_s)
            longest = counter.LONGEST_WAIT_S + (stop if begun else start_s)
            if counted.closes_s <= known or known >= longest:
                return self._counted(function, counted.frequency_hz, gate)
            later = min(counted.closes_s, longest)
            return MeterReading.in_slices(later, lambda: value(later))

        end = stop + counter.OVERHEAD_S
        return MeterReading.in_slices(end, lambda: value(end))

    def _counted(self, function: Function, frequency_hz: float, gate_s: float) -> float:
        if frequency_hz == 0.0:
            return 0.0
        errors = self._errors.counter
        low = min(3.0 / frequency_hz, 1.0) ** 2
        error = errors.timebase_error + errors.low_frequency_error * low
        if errors.noise:
            error += self._noise.gauss(0.0, errors.noise * APERTURES_S[gate_s])
        reading = self.corrections.apply("FREQ", 0.0, frequency_hz * (1.0 + error))
        return reading if function.name == "FREQ" else 1.0 / reading

    def _pieces(self) -> list[Piece]:
        return [] if self._history is None else self._history.pieces(self._node)

    def _detected(self, start_s: float, stop_s: float, filter_hz: float) -> Generator[None, None, Detected]:
        return detecting(self._pieces(), start_s, stop_s, self._response(filter_hz))

    def _response(self, filter_hz: float) -> AcResponse:
        source_ohm = 0.0 if math.isinf(self._errors.input_ohm) else self._world.source_ohm(self._node)
        source_ohm = 0.0 if math.isinf(source_ohm) else source_ohm  # nothing is there, whatever loads it
        errors = self._errors.ac
        flatness = self.corrections.flatness
        errors = replace(errors, flatness_error=errors.flatness_error + flatness) if flatness else errors
        return AcResponse(filter_hz, errors, source_ohm)


def _overloads(function: Function, range_: float, seen: Detected) -> bool:
    return seen.rms_v > range_ * function.over_range_of(range_) or seen.peak_v > _CREST_FACTOR * range_


def _fitting(function: Function, range_: float, level: float, peak: float = 0.0) -> float:
    """Return the range for a level: up above 120 %, down below 10 % of the present one (p. 53)."""

    def holds(candidate: float) -> bool:
        return level <= candidate * function.over_range_of(candidate) and peak <= _CREST_FACTOR * candidate

    if not holds(range_):
        return next((candidate for candidate in function.ranges if holds(candidate)), function.ranges[-1])
    if level < 0.1 * range_:
        return next(each for each in function.ranges if level <= each and peak <= _CREST_FACTOR * each)
    return range_
