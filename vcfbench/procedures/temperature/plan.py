"""Scale factor, bias and drive frequency against temperature, up and down again.

At each temperature: the chamber (or a person, where it has no interface) goes there, the gyroscope soaks until its
output stands still, then the output is chopped 0, +, -, -, +, 0 by V_Vc or by the table, and the drive frequency is
measured where there is an oscilloscope. In the end the air is off, or the person is asked to bring the room back.
"""

import math
from collections.abc import Sequence
from itertools import pairwise
from statistics import fmean

from msgspec.structs import replace

from vcfbench import steps
from vcfbench.belief.agreement import require_steady_slope
from vcfbench.belief.chopped_level import chopped, table_due_deg_s, to_level
from vcfbench.belief.jumps import watched
from vcfbench.errors import MeasurementError
from vcfbench.instructions import routines
from vcfbench.instructions.kept import Keeps
from vcfbench.instructions.procedure import Procedure, Watched, roles
from vcfbench.instructions.scale_factor import ScaleFactorBy
from vcfbench.procedures.bandwidth import sweep
from vcfbench.procedures.temperature import results
from vcfbench.procedures.temperature.settings import STEADY_MEANS, TemperatureSettings
from vcfbench.records.device_values import Characteristics, Measured
from vcfbench.records.schema import Point
from vcfbench.steps.step import Routine, answer
from vcfbench.uncertainty.measurand import as_kept
from vcfbench.uncertainty.oscilloscope import capture_drive

_SIGMAS = 3.0


def _looked_at(settings: TemperatureSettings, work: steps.Plan) -> steps.Plan:
    yield from routines.look_at_drive(settings)
    if not settings.split:
        yield steps.NotChecked("the mode split", "not measured here; --set split=true does, at each temperature")
    yield from work


def _air_off(settings: TemperatureSettings, work: steps.Plan) -> steps.Plan:
    """Do `work`; whatever happens, the air is off afterwards, or a person is asked to bring the room back."""
    if settings.chamber is None:
        yield from work
        yield steps.set_air_by_hand(settings.room_c, settings.chamber_takes_s)
        return
    try:
        yield from work
    finally:
        yield steps.StopFlow()


@routines.framed(routines.energised, _looked_at, routines.held_at_rest, _air_off)
def plan(settings: TemperatureSettings) -> steps.Plan:
    """Go to each temperature, soak, measure."""
    previous_c = settings.room_c
    by_table, samples = settings.by is ScaleFactorBy.TABLE, round(settings.soak_window_s / settings.sample_interval_s)
    level = (settings.level_deg_s, 0.0) if by_table else (0.0, settings.level_v)
    common = {**routines.window_of(settings), "samples": max(4, samples)}
    window = steps.Acquire(2, *level, table_due_deg_s(settings, 1.0), **common)
    block: list[Point] = []
    for temperature_c, direction in zip(settings.temperatures_c, directions(settings.temperatures_c), strict=True):
        yield results.AtTemperature(temperature_c, direction)
        if settings.chamber is None:
            yield steps.set_air_by_hand(temperature_c, settings.chamber_takes_s)
        else:
            yield steps.SetTemperature(temperature_c, settings.ramp_k_min, settings.window_k, 0.0)
            way_k = max(0.0, abs(temperature_c - previous_c) - settings.window_k)
            yield from _reached(settings, temperature_c, way_k / settings.ramp_k_min * 60.0)
        # Wait, then take means at the level until three in a row move no more
        yield steps.Settle(settings.soak_s, "gyroscope takes the temperature")
        yield from to_level(settings, 1.0)
        points: list[Point] = []
        while not stands_still(points[-STEADY_MEANS:], settings):
            if settings.soak_s + (len(points) + 1) * window.physical_s > settings.longest_soak_s:
                raise MeasurementError(
                    f"the output has not come to rest after {settings.longest_soak_s:g} s at the temperature",
                    instrument="multimeter",
                    hint="raise longest_soak_s or steady_ppm_min for a device that warms up slowly",
                )
            points.append(answer((yield window), steps.Window).point)
        yield from to_level(settings, 0.0, previous=1.0)
        yield from _reached(settings, temperature_c)
        block = yield from watched(settings, chopped(settings, settings.cycles, block))
        for soaked in points:  # the level of the block, as it was before it
            at_level = replace(soaked, step=block[0].step, rate_deg_s=settings.level_deg_s)
            require_steady_slope([block[0], at_level], block[1:3])
        if settings.station.oscilloscope is not None:
            yield from capture_drive(settings)
        if settings.split:
            yield from sweep(settings.sweep)
            yield steps.DisableVvc()
            yield steps.ConfigureGenerator(0.0)
            yield steps.ConfigureMeter(float(settings.meter_range_v), float(settings.nplc))
        previous_c = temperature_c


def directions(temperatures_c: Sequence[float]) -> list[str]:
    """Return for each temperature whether it was come to going ``up`` or ``down``; the first as the second goes on."""
    found: list[str] = []
    for before, here in pairwise(temperatures_c):
        found.append("up" if here > before else "down" if here < before else found[-1] if found else "up")
    return [found[0], *found]


def _reached(settings: TemperatureSettings, temperature_c: float, ramp_s: float = 0.0) -> Routine[None]:
    """See that the air is there, and read it."""
    if settings.chamber is not None:
        deadline_s = 2.0 * ramp_s + settings.chamber_takes_s
        answer((yield steps.AwaitTemperature(temperature_c, ramp_s, 0.0, deadline_s)), steps.TemperatureReading)


def stands_still(points: Sequence[Point], settings: TemperatureSettings) -> bool:
    """Return True if the output at the level moved by less than `steady_ppm_min` from the first to the last mean.

    The level itself is about the output; what the noise of the readings alone would move it by is let through.
    """
    if len(points) < STEADY_MEANS:
        return False
    level_v = abs(settings.level_deg_s * settings.expected_gyro().scale_factor)
    minutes = (len(points) - 1) * settings.soak_window_s / 60.0
    noise_v = _SIGMAS * math.sqrt(2.0 * fmean(point.std_v**2 / point.n for point in points))
    return abs(points[-1].output_v - points[0].output_v) <= settings.steady_ppm_min * 1e-6 * level_v * minutes + noise_v


def temperature_characteristics(settings: TemperatureSettings, found: results.TemperatureResult) -> Characteristics:
    """Return the characteristics that K_Vc depends on; that of K_Vc itself takes a run by the table and one by V_Vc."""
    by_table, seen_c = settings.by is ScaleFactorBy.TABLE, [each.temperature_c for each in found.points]
    frequency = found.frequency
    return Characteristics(
        temperature_c=None if frequency is None else Measured(value=found.reference_c, u=settings.u_temperature_k),
        drive_hz=None if frequency is None else as_kept(frequency),
        drive_ppm_k=None if found.frequency_tc is None else as_kept(found.frequency_tc),
        split_size_hz=None if found.split is None else as_kept(found.split),
        split_hz_k=None if found.split_tc is None else as_kept(found.split_tc),
        table_slope_ppm_k=as_kept(found.scale_factor_tc) if by_table else None,
        v_vc_slope_ppm_k=None if by_table else as_kept(found.scale_factor_tc),
        least_temperature_c=None if frequency is None else min(seen_c),
        most_temperature_c=None if frequency is None else max(seen_c),
    )


TEMPERATURE = Procedure(
    name="temperature",
    method=(
        "At each temperature of a cycle, up and down again, the gyroscope is left to settle; then scale factor, bias "
        "and drive frequency are measured. Polynomials through the results give the temperature coefficients, the two "
        "directions the hysteresis."
    ),
    settings=TemperatureSettings,
    watched=Watched(frozenset({1}), results.AtTemperature),
    plan=plan,
    results=results.temperature_results,
    report=results.temperature_report,
    unforeseen={
        "bias": "it goes with the temperature coefficient that is found",
        **dict.fromkeys(
            ("frequency", "frequency_tc", "frequency_hysteresis"),
            "it goes with the temperature coefficient and the scatter of the oscilloscope's records",
        ),
    },
    entry=Keeps("temperature", temperature_characteristics),
    needs=roles("multimeter"),
    either=roles("rate_source", "rate_table"),
    streams=True,
    several=True,
    uses=roles("power", "oscilloscope", "chamber"),
)
