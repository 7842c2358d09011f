"""Expected statement of a run: its U95 by the budget itself, of points that the dry run predicts with noise.

A gyroscope on paper answers the steps of the dry run once more, and scatters as the real one should. What the steps
would put into the journal goes through the results of the procedure, as what a bench gave does. So nothing of any
budget stands here.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from random import Random
from statistics import fmean
from typing import Any, Final

import numpy as np
from msgspec import Struct, field, structs, to_builtins
from numpy.typing import NDArray

from vcfbench.archive.output_unit import in_output_unit
from vcfbench.errors import BenchError
from vcfbench.instructions.procedure import AnyProcedure
from vcfbench.procedures.catalogue import PROCEDURES
from vcfbench.records.schema import Point
from vcfbench.records.stated import InParts, values_of
from vcfbench.station.description import Simulation
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import ProcedureSettings
from vcfbench.steps import ConfigureMeter, ModulatedRecord, Window
from vcfbench.steps.measured import Foreseen
from vcfbench.steps.step import Reading, Step
from vcfbench.steps.tally import Tally

PAPER_WALK_DEG_SQRT_H: Final = 0.21  # Angle random walk of the paper's gyroscope: assumed where the noise is not told
_PAPER_BIAS_V: Final = -0.042
"""Output at rest of the paper's gyroscope: of a bias as a rate, the scale factor's uncertainty counts with it."""
_LARGEST: Final = 3
_PAPER_OUTPUT: Final = (8.5e-6, -2.64e-8)
"""Second and third order of the paper's output over the first, by the rate in deg/s."""
_PAPER_MODULATOR: Final = (0.013, 0.0145)  # The same of V_Vc in volts
_PAPER_NONLINEARITY_PPM: Final = 825.0
_DIGITS = 1e-9  # Relative uncertainty below which only rounding remains


class ExpectedValue(Struct, frozen=True):
    """A result and its expected U95, with its largest causes and the u of each.

    It will be incomplete without what is `missing`.
    """

    name: str
    unit: str
    u95: float
    causes: tuple[tuple[str, float], ...]
    missing: tuple[str, ...] = ()


class Expectation(Struct, frozen=True):
    """Expected statement of a run; `noise` names the assumed noise, `why_none` the reason for having no values.

    `unknown` names the results whose U95 goes with what the run finds, each with why.
    """

    values: tuple[ExpectedValue, ...]
    noise: str
    why_none: str | None = None
    unknown: tuple[tuple[str, str], ...] = ()


_TAUS_S: Final = tuple(10.0 ** (0.25 * n) for n in range(2, 20))
_SPLIT_HZ = 24.8
_WIDTH = 3489.0 / (2.0 * 1224.0 * _SPLIT_HZ)
"""Half width of the paper's sense resonance (drive over 2 Q) over its distance from the drive, which is above: noise
near the resonance is seen larger."""
_FILTER_HZ = 100.0


class _Scattering(LinearGyro, kw_only=True):
    """A gyroscope on paper with white noise, seen through its sense mode, and 1/f noise.

    `white_v_sqrt_s` is the random walk of the integrated output. The 1/f noise is a sum of first-order processes, four
    a decade of time constants, the same over a second.
    """

    rng: Random
    white_v_sqrt_s: float
    flicker_v: float
    integration_s: float
    begun_s: float = 0.0
    drawn_s: float = -math.inf
    slow_v: list[float] = field(default_factory=lambda: [0.0] * len(_TAUS_S))
    bends: float = 1.0
    scatter_v: dict[float, float] = field(default_factory=dict)

    def output_v(self, table_deg_s: float) -> float:
        """Return the output of a gyroscope that bends as the paper's does, V."""
        v_vc_v = self.v_vc_v if self.v_vc_on else 0.0
        rate_deg_s = table_deg_s + self.k_vc * _bent(v_vc_v, _PAPER_MODULATOR, self.bends)
        return self.bias_v + self.scale_factor * _bent(rate_deg_s, _PAPER_OUTPUT, self.bends)

    def noise_v(self, after_s: float) -> float:
        """Return noise of one reading that begins so long after the step does, V."""
        return self.of_a_reading_v() * self.rng.gauss() + self._flicker_at(self.begun_s + after_s)

    def record_noise_v(self, count: int, interval_s: float, aperture_s: float) -> Sequence[float]:
        """Return noise of readings taken by the meter itself, with the spectrum that the sense mode gives it."""
        each = max(1, round(interval_s / aperture_s))
        drawn = np.array([self.rng.gauss() for _ in range(each * count)])
        white = drawn * self.white_v_sqrt_s / math.sqrt(interval_s / each)
        spectrum = np.fft.rfft(white) * np.sqrt(_mode(np.fft.rfftfreq(white.size, interval_s / each)))
        seen = np.fft.irfft(spectrum, white.size)[::each]
        noise_v: list[float] = (seen + self._flicker_at(self.begun_s)).tolist()
        return noise_v

    def of_a_reading_v(self) -> float:
        """Return the standard deviation of one reading, by the spectrum of its averaging."""
        if self.integration_s not in self.scatter_v:
            f = np.linspace(0.0, 8.0 * _SPLIT_HZ, 8000)
            seen = _mode(f) * np.sinc(f * self.integration_s) ** 2
            self.scatter_v[self.integration_s] = math.sqrt(2.0 * float(seen.sum() - 0.5 * seen[0]) * float(f[1]))
        return self.white_v_sqrt_s * self.scatter_v[self.integration_s]

    def _flicker_at(self, t_s: float) -> float:
        if self.flicker_v and t_s >= self.drawn_s + 1.0:
            size_v = self.flicker_v * math.sqrt(math.log(10.0) / 4.0 / (2.0 * math.pi))
            kept = [math.exp((self.drawn_s - t_s) / tau_s) for tau_s in _TAUS_S]
            drawn = [size_v * math.sqrt(1.0 - each**2) * self.rng.gauss() for each in kept]
            self.slow_v = [each * slow + new for each, slow, new in zip(kept, self.slow_v, drawn, strict=True)]
            self.drawn_s = t_s
        return math.fsum(self.slow_v)


def _bent(size: float, orders: tuple[float, float], share: float) -> float:
    return size * (1.0 + share * size * (orders[0] + orders[1] * size))


def _mode(f_hz: NDArray[Any]) -> NDArray[np.float64]:
    """Return the noise at `f_hz` over that at rest, as powers: both side bands of the mode add, the filter follows."""
    ratio = f_hz / _SPLIT_HZ
    sides = [1.0 / ((1.0 + sign * ratio) ** 2 + _WIDTH**2) for sign in (-1.0, 1.0)]
    return np.asarray(0.5 * (sides[0] + sides[1]) * (1.0 + _WIDTH**2) / (1.0 + (f_hz / _FILTER_HZ) ** 8))


def expectation(
    procedure: AnyProcedure, settings: ProcedureSettings, simulation: Simulation | None, steps: Iterable[Step]
) -> Expectation:
    """Return the expected statement of a run of `steps` of `procedure`, without opening the bench.

    The noise is what the bench file tells: of a simulated gyroscope its own, which may have none at all.
    """
    walk, words = _noise(settings, simulation)
    try:
        values, unknown = _stated(procedure, settings, walk, steps)
    except BenchError as error:
        return Expectation((), words, error.what)
    except Exception as error:  # noqa: BLE001  # what predicted points come to is anybody's arithmetic
        return Expectation((), words, f"{type(error).__name__}: {error}")
    return Expectation(values, words, None if values or unknown else "its results state no U95", unknown)


def _gyro(settings: ProcedureSettings, walk_deg_sqrt_h: float | None) -> _Scattering:
    base, expected = settings.expected_gyro(), settings.expected
    flicker_deg_h = settings.station.sources.bias_instability_deg_h
    perfect = walk_deg_sqrt_h == 0.0
    per_deg_s, largest_ppm = abs(base.scale_factor), 0.0 if perfect else expected.nonlinearity_ppm
    gyro = _Scattering(
        k_vc=base.k_vc,
        scale_factor=base.scale_factor,
        bias_v=_PAPER_BIAS_V / 0.0125 * per_deg_s if expected.bias_v is None and not perfect else base.bias_v,
        rng=Random(5),  # noqa: S311  # the same plan is told the same, by a draw near the middle of what draws give
        white_v_sqrt_s=(_DIGITS * PAPER_WALK_DEG_SQRT_H if perfect else walk_deg_sqrt_h or PAPER_WALK_DEG_SQRT_H)
        / 60.0
        * per_deg_s,
        flicker_v=(flicker_deg_h or 0.0) / 3600.0 * per_deg_s,
        integration_s=settings.aperture_s,
        bends=1.0 if largest_ppm is None else min(1.0, largest_ppm / _PAPER_NONLINEARITY_PPM),
    )
    if expected.reading_noise_v is not None and not perfect:
        gyro.white_v_sqrt_s *= fmean(expected.reading_noise_v) / gyro.of_a_reading_v()
    return gyro


def _noise(settings: ProcedureSettings, simulation: Simulation | None) -> tuple[float | None, str]:
    """Return the angle random walk of a simulated gyroscope that is perfect but for it, and words for all noise.

    It is 0 of one without any noise, and None of all others.
    """
    known, window, walk = settings.station.sources, settings.expected.reading_noise_v, None
    by = f"{PAPER_WALK_DEG_SQRT_H:g} deg/sqrt(h), the paper's (assumed: no expected.reading_noise_v)"
    quiet = window is None and known.bias_instability_deg_h == 0.0
    if quiet and simulation is not None and simulation.parameters == "ideal":
        walk = 60.0 * float(simulation.override.get("noise", {}).get("angle_random_walk_deg_sqrt_s", 0.0))
        by = f"{walk:g} deg/sqrt(h) ([simulation])"
    if walk == 0.0:
        return walk, "a perfect gyroscope, without noise (uncertainty.bias_instability_deg_h = 0)"
    white = (
        f"white noise of {by}"
        if window is None
        else f"readings that scatter by {0.5 * (window[0] + window[1]):.2g} V (expected.reading_noise_v)"
    )
    flicker = known.bias_instability_deg_h
    return walk, f"{white}, flicker of {flicker or 0.0:g} deg/h ({known.bias_instability_from})"


def _stated(
    procedure: AnyProcedure, settings: ProcedureSettings, walk_deg_sqrt_h: float | None, steps: Iterable[Step]
) -> tuple[tuple[ExpectedValue, ...], tuple[tuple[str, str], ...]]:
    """Return the results with their U95, and the names of those with one that nobody can expect, with the reason."""
    lines, points, gyro = [], [], _gyro(settings, walk_deg_sqrt_h)
    for line, point in _lines(steps, gyro, settings.station.mains_hz):
        lines.append(line)
        points += [] if point is None else [point]
    foreseen = Foreseen(points, lambda: lines, white_v_sqrt_s=gyro.white_v_sqrt_s)
    results = in_output_unit(procedure.results(settings, foreseen), settings.station.output_unit)
    of_parts = results.parts if isinstance(results, InParts) else ()
    parts = [(f"{each.name}.", PROCEDURES[each.name], each.results) for each in of_parts]
    values, unknown = [], []
    for before, of, found in parts or [("", procedure, results)]:
        unforeseen = {**of.unforeseen, **settings.unforeseen}
        unknown += [(before + name, why) for name, why in unforeseen.items()]
        for name, value in values_of(found).items():
            u95, causes = value.u95, sorted(((each.source, abs(each.u)) for each in value.parts), key=lambda c: -c[1])
            known = unforeseen.keys().isdisjoint({name, name.rpartition(".")[2]})
            if u95 and u95 > _DIGITS * abs(value.value or 0.0) and known:
                largest = tuple(causes[:_LARGEST])
                values.append(ExpectedValue(before + name, value.unit, u95, largest, tuple(value.missing)))
    return tuple(values), tuple(unknown)


def _lines(steps: Iterable[Step], gyro: _Scattering, mains_hz: float) -> Iterator[tuple[dict[str, Any], Point | None]]:
    """Yield the journal's content for each step, and its point."""
    t_s = 0.0
    for number, step in enumerate(steps, 1):
        if isinstance(step, ConfigureMeter):
            gyro.integration_s = step.nplc / mains_hz
        gyro.begun_s = t_s
        result = step.predict(gyro)
        if isinstance(result, ModulatedRecord):
            result = structs.replace(result, output_t_s=t_s, v_vc_t_s=t_s)
        if isinstance(result, Window) and not result.readings:
            long: Any = step  # its readings are in the journal alone, its point has their mean and scatter
            at = [place * long.interval_s for place in range(long.samples)]
            readings = [Reading(t_s + each, result.point.output_v + gyro.noise_v(each)) for each in at]
            tally = Tally()
            tally.add([each.voltage_v for each in readings])
            mean = structs.replace(result.point, output_v=tally.mean_v, std_v=tally.std_v)
            result = structs.replace(result, point=mean)
            yield {"type": "readings", "n": number, "readings": to_builtins(readings)}, None
        kinds = {"step_kind": type(step).__name__, "result_kind": type(result).__name__}
        found, point = result.as_json(), result.recorded_point
        for reading in found.get("readings", ()):  # of a prediction they begin with their step
            reading["t_s"] += t_s
        line = {"type": "step", "n": number, **kinds, "t_s": t_s, "step": to_builtins(step), "result": found}
        t_s += step.duration_s
        yield {**line, **({} if point is None else {"point": point.as_json()}), "end_s": t_s}, point
