"""What the 34401A's input stage makes of a node: aperture, autozero, ranges, noise, and its published errors."""

from __future__ import annotations

import math
import random
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from vcfbench.sim.instruments.dmm_functions import RESOLUTIONS, Function
from vcfbench.sim.instruments.dmm_math import OVERLOAD

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np

    from vcfbench.sim.world import World

__all__ = ["Inputs", "MeterErrors", "Reading"]

_FAST_APERTURE_S = {0.02: 400e-6, 0.2: 3e-3}
"""Integration below one cycle does not depend on the line (p. 217)."""
_OVERHEAD_S = {0.02: 0.6e-3, 0.2: 0.33e-3}
"""What the published reading rates leave beside integration and delay (p. 217; inferred)."""
_AC_WINDOW_S = 0.1
_SAMPLE_RATE_HZ = 50e3
"""Rate at which ac volts and frequency look at the node: enough for the carriers of the PCB."""
_LEAST_AC_V = 0.01
"""Below 10 % of the lowest range a counter sees no signal and reads 0 (p. 61)."""


@dataclass(frozen=True, slots=True)
class MeterErrors:
    """Imperfections of a specimen on the dc voltage function; each can be set by itself."""

    gain_error: float = 0.0
    """Relative error of the reading, V/V (p. 216: 1 year 0.0035 % on the 10 V range)."""
    offset_v: float = 0.0
    """Offset on the 10 V range, V; on the others in proportion (p. 216: 0.0005 % of range)."""
    unzeroed_offset_v: float = 0.0
    """Further offset while autozero is off, V (p. 216: 0.0002 % of range + 5 uV)."""
    noise: float = 0.0
    """White noise, rms, as a multiple of the resolution that goes with the integration time."""
    input_ohm: float = math.inf
    """Input resistance: 10 Mohm +-1 %, above 10 Gohm on the lower ranges with automatic impedance (p. 53)."""
    quantised: bool = False
    """Whether readings come in steps of a tenth of the resolution (unverified; the format has more digits)."""
    noise_seed: int = 0
    """Seed of the noise."""

    @classmethod
    def none(cls) -> MeterErrors:
        """Return an ideal specimen."""
        return cls()

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> MeterErrors:
        """Return a specimen drawn from the 1-year accuracy of the 10 V range as four standard deviations (p. 227)."""
        return cls(
            gain_error=float(rng.normal(0.0, 35e-6 / 4)),
            offset_v=float(rng.normal(0.0, 50e-6 / 4)),
            unzeroed_offset_v=float(rng.normal(0.0, 25e-6 / 4)),
            noise=0.3,
            input_ohm=float(10e6 * (1 + rng.uniform(-0.01, 0.01))),
            quantised=True,
            noise_seed=int(rng.integers(1 << 31)),
        )


@dataclass(frozen=True, slots=True)
class Reading:
    """A reading under way: `value()` may be asked for from `end_s` on."""

    end_s: float
    value: Callable[[], float]


class _Scale(NamedTuple):
    """A range, how far beyond it readings go, and the resolution."""

    range: float
    over_range: float
    resolution_v: float


class Inputs:
    """The input terminals on a node.

    Args:
        world: the World the node is in.
        node: the node between the HI and LO terminals; the ratio's sense terminals are open.
        errors: imperfections of the specimen.
        mains_hz: line frequency.
        source_ohm: resistance of the node.
    """

    def __init__(self, world: World, node: str, errors: MeterErrors, mains_hz: float, source_ohm: float) -> None:
        self._world = world
        self._node = node
        self._errors = errors
        self._mains_hz = mains_hz
        self._source_ohm = source_ohm
        self._noise = random.Random(errors.noise_seed)  # noqa: S311  (noise, not secrets)

    def aperture_s(self, nplc: float) -> float:
        """Return the integration time of `nplc` power line cycles."""
        return _FAST_APERTURE_S.get(nplc, nplc / self._mains_hz)

    def autorange(self, function: Function, range_: float) -> float:
        """Return the range for the signal now: up above 120 %, down below 10 % of the present one (p. 53)."""
        level = self._level(function)
        ranges = function.ranges
        if level > range_ * function.over_range_of(range_):
            held = [candidate for candidate in ranges if level <= candidate * function.over_range_of(candidate)]
            return held[0] if held else ranges[-1]
        if level < 0.1 * range_:
            return next(candidate for candidate in ranges if level <= candidate)
        return range_

    def _level(self, function: Function) -> float:
        if function.unit == "OHM":
            return math.inf
        if function.unit == "A":
            return 0.0
        return abs(self._world.value_v(self._node))

    def begin(
        self,
        function: Function,
        start_s: float,
        *,
        range_: float,
        nplc: float,
        aperture_s: float,
        autozero: bool,
        high_impedance: bool,
    ) -> Reading:
        """Start a reading whose aperture opens at `start_s`."""
        if function.gated:
            return self._gate(function, start_s, aperture_s)
        if not function.integrating and function.ranges:
            return self._rms(function, start_s, range_)
        aperture = self.aperture_s(nplc)
        end = start_s + aperture * (2 if autozero else 1) + _OVERHEAD_S.get(nplc, 0.0)
        if function.name == "VOLT":
            loading = self.loading(range_, high_impedance=high_impedance)
            window = self._world.window(self._node, start_s, start_s + aperture)
            scale = _Scale(range_, function.over_range_of(range_), RESOLUTIONS[nplc] * range_)
            return Reading(end, lambda: self._as_read(window.mean_v() * loading, scale, autozero=autozero))
        nothing = 0.0 if function.unit == "A" else OVERLOAD
        return Reading(end, lambda: nothing)

    def loading(self, range_: float, *, high_impedance: bool) -> float:
        """Return what the input resistance leaves of the node's open voltage (p. 53)."""
        if math.isinf(self._errors.input_ohm) or (high_impedance and range_ <= 10.0):
            return 1.0
        return self._errors.input_ohm / (self._errors.input_ohm + self._source_ohm)

    def _as_read(self, true_v: float, scale: _Scale, *, autozero: bool) -> float:
        if abs(true_v) > scale.range * scale.over_range:
            return math.copysign(OVERLOAD, true_v)
        errors = self._errors
        reading = true_v * (1.0 + errors.gain_error) + errors.offset_v * scale.range / 10.0
        if not autozero:
            reading += errors.unzeroed_offset_v
        if errors.noise:
            reading += self._noise.gauss(0.0, errors.noise * scale.resolution_v)
        if errors.quantised:
            step = scale.resolution_v / 10.0
            reading = round(reading / step) * step
        return reading

    def _samples(self, start_s: float, stop_s: float) -> Callable[[], tuple[np.ndarray, np.ndarray]]:
        capture = self._world.capture(start_s, stop_s)

        def samples() -> tuple[np.ndarray, np.ndarray]:
            import numpy as np  # noqa: PLC0415  (only ac functions need arrays)

            times = np.linspace(start_s, stop_s, int((stop_s - start_s) * _SAMPLE_RATE_HZ) + 1)
            return times, capture.samples(self._node, times)

        return samples

    def _rms(self, function: Function, start_s: float, range_: float) -> Reading:
        stop = start_s + _AC_WINDOW_S
        if function.unit == "A":
            return Reading(stop, lambda: 0.0)
        samples = self._samples(start_s, stop)

        def value() -> float:
            _, volts = samples()
            rms = float(volts.std())
            return OVERLOAD if rms > range_ * function.over_range_of(range_) else rms

        return Reading(stop, value)

    def _gate(self, function: Function, start_s: float, aperture_s: float) -> Reading:
        samples = self._samples(start_s, start_s + aperture_s)

        def value() -> float:
            frequency = _frequency_hz(*samples())
            if function.name == "FREQ" or frequency == 0.0:
                return frequency
            return 1.0 / frequency

        return Reading(start_s + aperture_s, value)


def _frequency_hz(times_s: np.ndarray, volts: np.ndarray) -> float:
    """Return the frequency by counting rising crossings of the mean, 0 without a signal."""
    import numpy as np  # noqa: PLC0415  (only the counter needs arrays)

    centred = volts - volts.mean()
    if float(centred.std()) < _LEAST_AC_V:
        return 0.0
    before = np.flatnonzero((centred[:-1] < 0.0) & (centred[1:] >= 0.0))
    if len(before) < 2:
        return 0.0
    low, high = centred[before], centred[before + 1]
    crossings = times_s[before] - low / (high - low) * (times_s[1] - times_s[0])
    return float((len(crossings) - 1) / (crossings[-1] - crossings[0]))
