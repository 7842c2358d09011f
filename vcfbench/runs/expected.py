"""What a run is expected to state: its U95 by the budget itself, of points that the dry run predicts with noise.

The plan is walked with a gyroscope on paper that scatters as the real one should. What its steps would put into the
journal goes through the results of the procedure, as what a bench gave does. So nothing of any budget stands here.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from msgspec import Struct, field, structs, to_builtins

from vcfbench.bench.linear_gyro import LinearGyro
from vcfbench.errors import BenchError, PlanError
from vcfbench.plans.step import Reading, abandon
from vcfbench.plans.steps import ConfigureMeter, ModulatedRecord, Window

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from numpy.random import Generator
    from numpy.typing import NDArray

    from vcfbench.bench.settings import ProcedureSettings
    from vcfbench.plans.step import Plan, Step, StepResult
    from vcfbench.procedures.procedure import AnyProcedure
    from vcfbench.record.schema import Point

PAPER_WALK_DEG_SQRT_H: Final = 0.21
"""Angle random walk of the paper's gyroscope: what is assumed where nobody tells the noise."""
_PAPER_BIAS_V: Final = -0.042
"""Output at rest of the paper's gyroscope: of a bias as a rate, the scale factor's uncertainty counts with it."""
_LARGEST: Final = 3
_OF_A_CURVE: Final = frozenset({"nonlinearity"})
"""Results whose uncertainty goes with their size; a gyroscope on paper is a straight line."""
_OF_WHAT_TEMPERATURE_DOES: Final = {"temperature": frozenset({"bias", "frequency", "frequency_tc"})}
"""By procedure, results whose uncertainty goes with what the run is to find of the device."""


class ExpectedValue(Struct, frozen=True):
    """A result and its U95 before the run, with its largest causes and the u of each, as far as results tell them."""

    name: str
    unit: str
    u95: float
    causes: tuple[tuple[str, float], ...]


class Expectation(Struct, frozen=True):
    """What a run is expected to state; `noise` says what noise was put in, `why_none` why there is nothing."""

    values: tuple[ExpectedValue, ...]
    noise: str
    why_none: str | None = None


_TAUS_S: NDArray[np.float64] = 10.0 ** np.arange(0.5, 5.0, 0.25)
_SPLIT_HZ = 24.8
_WIDTH = 0.1
"""Of the paper's sense mode against its drive, and of its resonance: noise near it is seen larger."""


class _Scattering(LinearGyro, kw_only=True):
    """A gyroscope on paper with white noise, seen through its sense mode, and 1/f noise.

    `white_v_sqrt_s` is the random walk of the integrated output. The 1/f noise is a sum of first-order processes, four
    a decade of time constants, the same over a second.
    """

    rng: Generator
    white_v_sqrt_s: float
    reading_v: float | None
    flicker_v: float
    integration_s: float
    begun_s: float = 0.0
    drawn_s: float = -math.inf
    slow_v: NDArray[np.float64] = field(default_factory=lambda: np.zeros(_TAUS_S.size))
    scatter_v: dict[float, float] = field(default_factory=dict)

    def noise_v(self, after_s: float) -> float:
        """Return noise of one reading that begins so long after the step does, V."""
        if self.integration_s not in self.scatter_v:
            stated_v = self.reading_v
            self.scatter_v[self.integration_s] = self._scatter_v(self.integration_s) if stated_v is None else stated_v
        return self.scatter_v[self.integration_s] * self.rng.standard_normal() + self._flicker_at(
            self.begun_s + after_s
        )

    def record_noise_v(self, count: int, interval_s: float, aperture_s: float) -> Sequence[float]:
        """Return noise of readings taken by the meter itself, with the spectrum that the sense mode gives it."""
        each = max(1, round(interval_s / aperture_s))
        white = self.rng.standard_normal(each * count) * self.white_v_sqrt_s / math.sqrt(interval_s / each)
        spectrum = np.fft.rfft(white) * np.sqrt(_mode(np.fft.rfftfreq(white.size, interval_s / each)))
        seen = np.fft.irfft(spectrum, white.size)[::each]
        noise_v: list[float] = (seen + self._flicker_at(self.begun_s)).tolist()
        return noise_v

    def _scatter_v(self, integration_s: float) -> float:
        """Return the standard deviation of one reading, by the spectrum of what it averages."""
        f = np.linspace(0.0, 40.0 * _SPLIT_HZ, 40_000)
        seen = _mode(f) * np.sinc(f * integration_s) ** 2
        return self.white_v_sqrt_s * math.sqrt(2.0 * float(seen.sum() - 0.5 * seen[0]) * float(f[1]))

    def _flicker_at(self, t_s: float) -> float:
        if self.flicker_v and t_s >= self.drawn_s + 1.0:
            size_v = self.flicker_v * math.sqrt(math.log(10.0) / 4.0 / (2.0 * math.pi))
            kept = np.exp(-(t_s - self.drawn_s) / _TAUS_S)
            drawn = size_v * np.sqrt(1.0 - kept**2) * self.rng.standard_normal(_TAUS_S.size)
            self.slow_v, self.drawn_s = kept * self.slow_v + drawn, t_s
        return float(self.slow_v.sum())


def _mode(f_hz: NDArray[Any]) -> NDArray[np.float64]:
    """Return the response of the mode to a rate at `f_hz`, squared, over that at rest."""
    ratio = f_hz / _SPLIT_HZ
    return np.asarray(1.0 / ((1.0 - ratio**2) ** 2 + (_WIDTH * ratio) ** 2))


def expectation(procedure: AnyProcedure, settings: ProcedureSettings, plan: Plan) -> Expectation:
    """Return what a run of `plan`, which `procedure` makes of `settings`, is expected to state; nothing is opened."""
    words = _noise_words(settings)
    try:
        values = tuple(_stated(procedure, settings, plan))
    except BenchError as error:
        return Expectation((), words, error.what)
    except Exception as error:  # noqa: BLE001  # what predicted points come to is anybody's arithmetic
        return Expectation((), words, f"{type(error).__name__}: {error}")
    return Expectation(values, words, None if values else "its results state no U95")


def _gyro(settings: ProcedureSettings) -> _Scattering:
    base, window = settings.expected_gyro(), settings.expected.reading_noise_v
    per_deg_s = abs(base.scale_factor)
    return _Scattering(
        k_vc=base.k_vc,
        scale_factor=base.scale_factor,
        bias_v=_PAPER_BIAS_V if settings.expected.bias_v is None else base.bias_v,
        rng=np.random.default_rng(4),  # the same plan is told the same, by a draw near the middle of what draws give
        white_v_sqrt_s=PAPER_WALK_DEG_SQRT_H / 60.0 * per_deg_s,
        reading_v=None if window is None else 0.5 * (window[0] + window[1]),
        flicker_v=(settings.station.sources.bias_instability_deg_h or 0.0) / 3600.0 * per_deg_s,
        integration_s=float(settings.nplc) / settings.station.mains_hz,
    )


def _noise_words(settings: ProcedureSettings) -> str:
    known = settings.station.sources
    window = settings.expected.reading_noise_v
    white = (
        f"white noise of {PAPER_WALK_DEG_SQRT_H:g} deg/sqrt(h), the paper's (assumed: no expected.reading_noise_v)"
        if window is None
        else f"readings that scatter by {0.5 * (window[0] + window[1]):.2g} V (expected.reading_noise_v)"
    )
    flicker = known.bias_instability_deg_h
    return f"{white}, flicker of {flicker or 0.0:g} deg/h ({known.bias_instability_from})"


def _stated(procedure: AnyProcedure, settings: ProcedureSettings, plan: Plan) -> Iterator[ExpectedValue]:
    from vcfbench.plans.measured import Foreseen  # noqa: PLC0415
    from vcfbench.runs.quantities import named_values  # noqa: PLC0415

    lines, points = [], []
    beside = getattr(settings, "health", False)  # what is looked at so only tells whether K_Vc is still what it was
    for line, point in _lines(plan, _gyro(settings), settings.station.mains_hz, beside=beside):
        lines.append(line)
        points += [] if point is None else [point]
    results = procedure.results(settings, Foreseen(points, lambda: lines))
    left_out = _OF_WHAT_TEMPERATURE_DOES.get(procedure.name, frozenset()) | _OF_A_CURVE
    for name, value in named_values(results).items():
        u95 = value.stated_u95
        if u95 and name.rpartition(".")[2] not in left_out:
            yield ExpectedValue(name, value.unit, u95, value.causes[:_LARGEST])


def _lines(
    plan: Plan, gyro: _Scattering, mains_hz: float, *, beside: bool
) -> Iterator[tuple[dict[str, Any], Point | None]]:
    """Yield what the journal would hold of each step, and its point.

    Raises:
        PlanError: a step finds what nobody can predict, and the results do not need it only `beside` the rest.
    """
    t_s, number = 0.0, 0
    try:
        step = next(plan)
        while True:
            number += 1
            if isinstance(step, ConfigureMeter):
                gyro.integration_s = step.nplc / mains_hz
            gyro.begun_s = t_s
            result = step.predict(gyro)
            if result.unpredicted and not beside:
                raise PlanError(f"{step.describe()}: {result.unpredicted}")
            if isinstance(result, ModulatedRecord):
                result = structs.replace(result, output_t_s=t_s, v_vc_t_s=t_s)
            if isinstance(result, Window) and not result.readings:
                chunk, result = _long_window(step, result, gyro, t_s)
                yield {"type": "readings", "n": number, "readings": chunk}, None
            line = _line(number, step, result, t_s)
            t_s += step.duration_s
            yield {**line, "end_s": t_s}, result.recorded_point
            step = plan.send(result)
    except StopIteration:
        return
    finally:
        abandon(plan)


def _long_window(step: Any, result: Window, gyro: _Scattering, t_s: float) -> tuple[list[Any], Window]:
    """Return the readings of a window that are in the journal alone, and the window with what they come to."""
    from vcfbench.plans.tally import Tally  # noqa: PLC0415

    at = [number * step.interval_s for number in range(step.samples)]
    readings = [Reading(t_s + each, result.point.output_v + gyro.noise_v(each)) for each in at]
    tally = Tally()
    tally.add([each.voltage_v for each in readings])
    point = structs.replace(result.point, output_v=tally.mean_v, std_v=tally.std_v)
    return to_builtins(readings), structs.replace(result, point=point)


def _line(number: int, step: Step, result: StepResult, t_s: float) -> dict[str, Any]:
    kinds = {"step_kind": type(step).__name__, "result_kind": type(result).__name__}
    found = result.as_json()
    for reading in found.get("readings", ()):  # of a prediction they begin with their step
        reading["t_s"] += t_s
    line = {"type": "step", "n": number, **kinds, "t_s": t_s, "step": to_builtins(step), "result": found}
    point = result.recorded_point
    return line if point is None else {**line, "point": point.as_json()}
