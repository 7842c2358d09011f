"""Warm-up: the output at rest from power-on until it is steady, and the exponential that it follows.

First the output is read quickly while the drive loop starts (turn-on), then in means of a minute. The run ends when
three of them in a row agree and their slope is below the bias instability a minute (after IEEE 952, 6.6), not before
`shortest_s`, since the end of an exponential is not seen in its middle; or at `longest_s`, and then says so.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, ClassVar, Self

from msgspec import Meta, Struct
from msgspec.structs import replace

from vcfbench import steps
from vcfbench.clock import sleep
from vcfbench.interfaces import MeasuresWaveforms, PowersRails, ReadsVoltage, Rotates, SetsVoltage
from vcfbench.procedures.catalogue import BUILT_IN
from vcfbench.procedures.procedure import Procedure
from vcfbench.procedures.shared import routines
from vcfbench.procedures.shared.known.scale_factor import AtRestSettings, read_scale_factor, scale_factor_used
from vcfbench.procedures.warmup.results import WarmupResult, is_steady, warmup_report, warmup_results
from vcfbench.records.schema import Point
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.station.settings import Sources
from vcfbench.steps.measured import Foreseen, Measured
from vcfbench.steps.step import Context, Reading, Routine, Step, StepResult, answer

_QUICK_NPLC = 1.0
_QUICK_INTERVAL_S = 0.1
"""While the drive loop starts: ten readings a second of one power-line cycle."""


class WarmupSettings(AtRestSettings, frozen=True, kw_only=True):
    """Settings of the warm-up, beside those of all procedures."""

    shortest_s: Annotated[
        float, Meta(ge=180.0, le=86_400.0, description="from power-on, before it may be called steady")
    ] = 1800.0
    longest_s: Annotated[float, Meta(ge=180.0, le=86_400.0, description="and at most, steady or not")] = 3600.0
    window_s: Annotated[float, Meta(ge=10.0, le=600.0, description="length of the means that must agree")] = 60.0
    bias_instability_deg_h: Annotated[
        float, Meta(ge=1e-3, le=1e6, description="B of this gyroscope, of its zero record: what steady means")
    ] = 5.6
    turn_on_tolerance_deg_s: Annotated[
        float, Meta(ge=1e-3, le=1e3, description="the output is on when it stays so close to what it comes to")
    ] = 1.0

    @property
    def readings_a_window(self) -> int:
        """Number of readings of one mean."""
        return max(4, round(self.window_s / self.sample_interval_s))

    @property
    def warm_again_s(self) -> float:
        """Waiting time as a part of a run: the shortest."""
        return self.shortest_s

    def contradictions(self) -> Iterator[InvalidValue]:
        """Yield the contradictions beyond the ranges."""
        yield from super().contradictions()
        if self.longest_s < self.shortest_s:
            yield InvalidValue("longest_s", f"at least shortest_s, {self.shortest_s:g} s", self.longest_s)
        if self.shortest_s < 3.0 * self.window_s:
            yield InvalidValue("shortest_s", f"at least three windows of {self.window_s:g} s", self.shortest_s)


class SwitchedOn(StepResult, Struct, frozen=True):
    """The bench time at which the supply was told to switch on, s, and the output from then on."""

    t_s: float
    log: tuple[Reading, ...]

    def corrected(self, step: Step, known: Sources) -> Self:
        """Return the log with the correction of the multimeter's certificate to the output."""
        del step
        return replace(self, log=tuple(each.corrected(known) for each in self.log))

    def describe(self) -> str:
        """Say how long it was followed."""
        return f"{len(self.log)} readings from power-on"


class SwitchOnAndLog(steps.EnableSupply, frozen=True):
    """Switch the supply on and read the output from the first instant, one reading every `interval_s`."""

    subject: ClassVar[str] = "supply outputs"

    seconds: float
    interval_s: float

    def describe(self) -> str:
        """Describe the action."""
        return f"supply outputs on; the output every {self.interval_s:g} s for {self.seconds:g} s"

    @property
    def physical_s(self) -> float:
        """The log, s."""
        return self.seconds

    def perform(self, context: Context) -> Any:
        """Switch on, and read until the time is over; a meter that is slower gives fewer readings."""
        clock, meter = context.bench.clock, context.bench.multimeter
        begun_s = clock.now()
        context.bench.power.enable_outputs()
        log = []
        while (now_s := clock.now()) < begun_s + self.seconds:
            log.append(Reading(now_s, context.believable(meter.read_voltage_v)))
            sleep(clock, max(0.0, now_s + self.interval_s - clock.now()))
        return SwitchedOn(begun_s, tuple(log))

    def predict(self, gyro: LinearGyro) -> Any:
        """Predict an output that is there at once."""
        count = max(1, int(self.seconds / self.interval_s))
        return SwitchedOn(0.0, tuple(Reading(n * self.interval_s, gyro.output_v(0.0)) for n in range(count)))


def warmup(settings: WarmupSettings) -> steps.Plan:
    """Follow the output from power-on: V_Vc off, the table (where there is one) held still under servo."""
    yield from read_scale_factor(settings)
    return (yield from routines.off_afterwards(settings, routines.held_at_rest(settings, _from_power_on(settings))))


def _from_power_on(settings: WarmupSettings) -> Routine[steps.Outcome]:
    yield steps.Note("Power-on")
    yield steps.ConfigureMeter(float(settings.meter_range_v), _QUICK_NPLC)
    yield from routines.source_off(settings)
    rails = routines.rails_of(settings)
    for rail in rails:  # noqa: UP028  # a tuple cannot be sent results
        yield rail
    yield SwitchOnAndLog(settings.drive.start_up_s, _QUICK_INTERVAL_S)
    yield steps.CheckRails(rails, settings.rail_tolerance_v)
    yield steps.ConfigureMeter(float(settings.meter_range_v), float(settings.nplc))
    yield from routines.look_at_drive(settings)
    yield steps.Note(f"The output at rest, {settings.shortest_s:g} to {settings.longest_s:g} s")
    outcome = yield from _until_steady(settings)
    yield from routines.require_answer(settings)
    return outcome


def _until_steady(settings: WarmupSettings) -> Routine[steps.Outcome]:
    """Take means until they are steady or the time is over."""
    window = steps.Acquire(
        step=1,
        rate_deg_s=0.0,
        v_vc_v=0.0,
        table_deg_s=None if settings.station.limits.max_rate_deg_s is None else 0.0,
        tolerance_deg_s=settings.rate_tolerance_deg_s,
        rails=routines.rails_of(settings),
        rail_tolerance_v=settings.rail_tolerance_v,
        samples=settings.readings_a_window,
        interval_s=settings.sample_interval_s,
        resolution_v=settings.meter_resolution_v,
        noise_v=settings.expected.reading_noise_v,
    )
    points: list[Point] = []
    while True:
        points.append(answer((yield window), steps.Window).point)
        elapsed_s = settings.drive.start_up_s + len(points) * window.physical_s
        steady = is_steady(points[-3:], window.physical_s, _instability_v(settings))
        routines.require_alive(settings, points[-1])
        if elapsed_s >= settings.shortest_s and steady:
            return steps.Outcome(f"steady after {len(points)} means")
        if elapsed_s + window.physical_s > settings.longest_s:
            return steps.Outcome(f"not seen to be steady in {len(points)} means")


def _instability_v(settings: WarmupSettings) -> float:
    """Return B in volts; of the scale factor its size alone counts, and roughly: a record's is not read for it."""
    scale_factor = settings.scale_factor_v_per_deg_s or settings.expected_gyro().scale_factor
    return abs(scale_factor) * _instability_deg_h(settings) / 3600.0


def _instability_deg_h(settings: WarmupSettings) -> float:
    """Return B, deg/h: that of the settings, or of the bench file, where that is larger and not assumed."""
    known = settings.station.sources
    stated = None if "bias_instability_deg_h" in known.assumed else known.bias_instability_deg_h
    return max(settings.bias_instability_deg_h, stated or 0.0)


def _results(settings: WarmupSettings, measured: Measured) -> WarmupResult:
    ((_, switched),) = measured.found(SwitchedOn)
    scale = scale_factor_used(settings, measured)
    log = [(each.t_s - switched.t_s, each.voltage_v / scale.value) for each in switched.log]
    windows = [(each.t_s - switched.t_s, each.voltage_v / scale.value) for each in measured.readings.windows]
    length_s = settings.readings_a_window * settings.sample_interval_s
    return warmup_results(
        log,
        windows,
        interval_s=settings.sample_interval_s,
        scale=scale,
        settings=settings,
        tolerance_deg_s=settings.turn_on_tolerance_deg_s,
        instability_deg_s=_instability_deg_h(settings) / 3600.0,
        steady=is_steady(measured[-3:], length_s, _instability_v(settings)),
        resolution_deg_s=settings.meter_resolution_v / abs(scale.value),
        creeps=not isinstance(measured, Foreseen),
    )


WARMUP = Procedure(
    name="warmup",
    title=BUILT_IN["warmup"][1],
    method=(
        "From power-on the output is recorded at rest until three means in a row agree. Turn-on is when the output "
        "first stays within its tolerance; an exponential fitted to the readings gives amplitude, time constant and "
        "warm-up time."
    ),
    settings=WarmupSettings,
    plan=warmup,
    results=_results,
    report=warmup_report,
    unforeseen=dict.fromkeys(("amplitude", "time_constant", "warm_up"), "it goes with how the output warms up"),
    in_one_piece="a warm-up begins with power-on; after a break the gyroscope is warm, or cold again",
    needs={"power": PowersRails, "multimeter": ReadsVoltage},
    uses={"oscilloscope": MeasuresWaveforms, "rate_source": SetsVoltage, "rate_table": Rotates},
)
"""The warm-up."""
