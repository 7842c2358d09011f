"""The supply of the gyroscope: currents from the first instant, steady currents, effect of its rails on the output.

Three parts: power-on with the currents of all rails and the output read as fast as supply and meter go; the steady
currents when it is warm; and each rail moved up and down within the limits of the bench, chopped 0, +, -, -, +, 0
against drift, with bias and scale factor taken each time (by V_Vc of both signs, or by the table).
"""

from functools import partial
from typing import Any

from msgspec import Struct, structs

from vcfbench import steps
from vcfbench.analysis.chopped import CHOPPED
from vcfbench.belief.chopped_level import at_signs, to_level
from vcfbench.belief.jumps import watched
from vcfbench.clock import sleep
from vcfbench.instructions import routines
from vcfbench.instructions.kept import Keeps
from vcfbench.instructions.procedure import Procedure, Watched, roles
from vcfbench.instructions.scale_factor import ScaleFactorBy
from vcfbench.procedures.power import results
from vcfbench.procedures.power.results import PowerResult, PowerSettings, RailDraw, RailsDrawn, RailsLogged
from vcfbench.records.device_values import Characteristics
from vcfbench.station.linear_gyro import LinearGyro
from vcfbench.steps.step import Context, Effect, Reading, Routine, Step, does
from vcfbench.uncertainty.measurand import as_kept

_QUICK_NPLC = 1.0
_ROUND_S = 0.05
"""The least time from one round of readings to the next; most supplies need more for their currents."""


class _Logged:
    """Steps after which currents and output are read as fast as they come, for `seconds`."""

    __slots__ = ()
    rails: tuple[steps.ConfigureRail, ...]
    seconds: float

    def describe(self) -> str:
        done: str = super().describe()  # type: ignore[misc]
        return f"{done}; currents and output as fast as they come for {self.seconds:g} s"

    @property
    def physical_s(self) -> float:
        return self.seconds

    def perform(self, context: Context) -> Any:
        clock, power, meter = context.bench.clock, context.bench.power, context.bench.multimeter
        drawn, outputs, begun_s = [], [], clock.now()
        super().perform(context)  # type: ignore[misc]
        while (round_s := clock.now()) < begun_s + self.seconds:
            for rail in self.rails:
                current_a = power.measure_current_a(rail.output)  # its time is that of the answer
                drawn.append(RailDraw(clock.now(), rail.output, None, current_a))
                outputs.append(Reading(clock.now(), context.believable(meter.read_voltage_v)))
            sleep(clock, max(0.0, round_s + _ROUND_S - clock.now()))
        return RailsLogged(begun_s, tuple(drawn), tuple(outputs))

    def predict(self, gyro: LinearGyro) -> Any:
        times = [number * _ROUND_S for number in range(max(8, int(self.seconds / _ROUND_S)))]
        drawn = tuple(RailDraw(t_s, rail.output, None, 0.0) for t_s in times for rail in self.rails)
        return RailsLogged(0.0, drawn, tuple(Reading(t_s, gyro.output_v(0.0)) for t_s in times))


class SuppliedAndLogged(_Logged, steps.EnableSupply, frozen=True):
    """Switch the supply on; from then on currents and output are read as fast as they come, for `seconds`."""

    rails: tuple[steps.ConfigureRail, ...]
    seconds: float


class RailOnAndLog(_Logged, steps.ConfigureRail, frozen=True):
    """Set a rail to its level while the outputs are on, and log as :class:`SuppliedAndLogged` does."""

    rails: tuple[steps.ConfigureRail, ...]
    seconds: float


@does(Effect.MEASURES, "rails")
class MeasureRails(Step, Struct, frozen=True):
    """Read voltage and current of each rail `samples` times, every `interval_s`."""

    rails: tuple[steps.ConfigureRail, ...]
    samples: int
    interval_s: float

    def describe(self) -> str:
        return f"voltage and current of each rail, {self.samples} times, every {self.interval_s:g} s"

    @property
    def physical_s(self) -> float:
        return self.samples * self.interval_s

    def perform(self, context: Context) -> RailsDrawn:
        clock, power = context.bench.clock, context.bench.power
        drawn = []
        for _ in range(self.samples):
            begun_s = clock.now()
            for rail in self.rails:
                voltage_v, current_a = power.measure_voltage_v(rail.output), power.measure_current_a(rail.output)
                drawn.append(RailDraw(clock.now(), rail.output, voltage_v, current_a))
            sleep(clock, max(0.0, begun_s + self.interval_s - clock.now()))
        return RailsDrawn(tuple(drawn))

    def predict(self, gyro: LinearGyro) -> RailsDrawn:
        drawn = [RailDraw(0.0, rail.output, rail.voltage_v, 0.0) for _ in range(self.samples) for rail in self.rails]
        return RailsDrawn(tuple(drawn))


@routines.framed(routines.off_afterwards, routines.held_at_rest)
def plan(settings: PowerSettings) -> steps.Plan:
    """Log power-on, read the steady currents, and move the rails."""
    yield steps.ConfigureMeter(float(settings.meter_range_v), _QUICK_NPLC)
    yield from routines.source_off(settings)
    rails = routines.rails_of(settings)
    for number, order in enumerate(settings.orders):
        if number:
            yield steps.DisableSupply()
            yield steps.Settle(settings.off_s, "rails and drive come to rest")
        words = "the rail" if len(rails) == 1 else "both rails together"
        yield steps.Note(f"Power-on: {words if order == 'together' else f'{order} rail first'}")
        second = [rail for rail in rails if order not in {"together", rail.rail}]
        for rail in rails:  # that which comes second is at 0 V first
            yield structs.replace(rail, voltage_v=0.0) if rail in second else rail
        yield SuppliedAndLogged(rails, settings.order_delay_s if second else settings.log_s)
        for rail in second:
            yield RailOnAndLog(rail.rail, rail.output, rail.voltage_v, rail.current_limit_a, rails, settings.log_s)
    yield from routines.under_power(settings, settings.start_up_s, "warm-up", partial(routines.look_early, held=True))
    seen = yield from routines.look_at_drive(settings)
    yield steps.ConfigureMeter(float(settings.meter_range_v), float(settings.nplc))
    yield steps.Note("Steady currents")
    yield MeasureRails(rails, settings.samples, settings.sample_interval_s)
    yield from watched(settings, _moved(settings))
    yield from routines.require_answer(settings)
    yield from routines.look_again(settings, seen)


def _moved(settings: PowerSettings) -> Routine[None]:
    """Take the output at rest and at the rate of both signs, on rails moved either way; the rails as they were then."""
    for which in settings.varied:
        for cycle in range(settings.cycles):
            yield steps.Note(f"Rails moved: {which}, {settings.rail_step_v:g} V either way, cycle {cycle + 1}")
            for sign in CHOPPED:
                moved = settings.moved(which, sign * settings.rail_step_v)
                yield from _set_rails(moved)
                yield from at_signs(moved, (0.0, 1.0, -1.0))
                yield from to_level(moved, 0.0, previous=-1.0)
    yield from _set_rails(settings)


def _set_rails(settings: PowerSettings) -> Routine[None]:
    for rail in routines.rails_of(settings):  # noqa: UP028  # a tuple cannot be sent results
        yield rail
    yield steps.Settle(settings.settle_s, "gyro settles after the step of the rails")


def power_characteristics(settings: PowerSettings, found: PowerResult) -> Characteristics | None:
    """Return the effect of both rails on the slope; their effect on K_Vc takes a run by the table and one by V_Vc."""
    for effect in found.effects:
        if effect.rails == "both" or settings.station.rails.single:
            slope = as_kept(effect.scale_factor)
            if settings.by is ScaleFactorBy.TABLE:
                return Characteristics(table_slope_ppm_v=slope)
            return Characteristics(v_vc_slope_ppm_v=slope)
    return None


POWER = Procedure(
    name="power",
    method=(
        "Currents of both rails are logged from power-on, in the orders in which rails can come on, with the output "
        "beside them; then each rail is stepped about its level, and what the output does gives the rejection of the "
        "supply."
    ),
    settings=PowerSettings,
    watched=Watched(frozenset({1})),
    plan=plan,
    results=results.power_results,
    report=results.power_report,
    entry=Keeps("power", power_characteristics),
    needs=roles("power", "multimeter"),
    either=roles("rate_source", "rate_table"),
    uses=roles("oscilloscope"),
)
