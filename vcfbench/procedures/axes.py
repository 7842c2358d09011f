"""Sensitivity to rates about the three axes of the case: an operator mounts each of them along the table's in turn.

The three slopes are the components of one vector: its length is the scale factor, its direction the input axis. Of
several devices, or the three axes of one, each has its own; together they are the cross-axis matrix.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from typing import Annotated, ClassVar

import numpy as np
from msgspec import Struct

from vcfbench import steps
from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.input_axis import angle_of, direction, tilts
from vcfbench.belief.agreement import require_expected_slope
from vcfbench.belief.jumps import watched
from vcfbench.errors import ConfigError
from vcfbench.instructions import routines
from vcfbench.instructions.procedure import Procedure, Watched, roles
from vcfbench.records.schema import Point
from vcfbench.reports.document import Part, Report, Table, Text, heads
from vcfbench.station.bounds import Rates, ranged, said
from vcfbench.station.settings import DeviceSettings
from vcfbench.steps.measured import Measured
from vcfbench.uncertainty.measurand import finite, measurand, titled, value_table
from vcfbench.uncertainty.windows import WindowNoise, line_weights
from vcfbench.values.sources import METER_GAIN, TABLE_RATE
from vcfbench.values.value import Measurand, UncertaintyPart, Value

_CASE = ("x", "y", "z")
_MOUNTING = "mounting"
_UNSEEN = (
    "Not detected: bending by the mounting, and the non-linearity of an axis. All angles are about the axes of the "
    "case as it was mounted."
)


class AxesSettings(DeviceSettings, frozen=True, kw_only=True):
    """Settings of the sensitivities about three axes, in addition to those of all procedures."""

    rates_deg_s: Annotated[Rates, said("rates of the table in each mounting", option="--rates")] = (50.0, 0.0, -50.0)
    mount_s: Annotated[float, ranged(1.0, 3600.0, "time that a mounting takes, for the estimate")] = 120.0
    mounting_deg: Annotated[
        float, ranged(0.0, 10.0, "largest angle between an axis of the case and the table's axis, in two directions")
    ] = 0.5

    smooth: ClassVar[bool] = False  # about an axis across the input axis there is no answer that could be asked for


class AxesResult(Struct, frozen=True, kw_only=True):
    """Sensitivities about three axes: the scale factor is their length, the input axis their direction.

    >>> found = vcfbench.run("axes", settings={"samples": 5}).results
    >>> f"{found.scale_factor.value:.4f}", sorted(found.towards)
    ('-0.0125', ['x', 'y'])
    """

    sensitivity: tuple[float, float, float]
    """Slope of the output by the rate about x, y and z, V/(deg/s)."""
    u_sensitivity: tuple[float, float, float]
    """Their standard uncertainties by the readings alone."""
    scale_factor: Measurand
    towards: dict[str, Measurand]
    """Angle of the input axis towards each axis across it, mrad."""
    outputs_v: dict[str, float]
    """Output at rest in each mounting, by the axis that points up: the bias, with the Earth's rate and gravity."""
    mounting_deg: float

    def stated(self) -> Iterator[Value]:
        """Yield its values."""
        yield self.scale_factor.called("scale_factor", "scale_factor")
        yield from (titled(f"input axis towards {axis}", each) for axis, each in self.towards.items())


@routines.framed(routines.energised, routines.drive_seen)
def plan(settings: AxesSettings) -> steps.Plan:
    """Ask for each axis of the case to be mounted along the table's, and visit the rates."""
    for number, axis in enumerate(_CASE, 1):
        words = f"mount the gyroscope with its +{axis} axis up, along the table's, and take the hands off"
        yield steps.AskOperator(words, settings.mount_s, (("up_axis", f"+{axis}"),))
        yield steps.Settle(settings.settle_s, "gyro settles after it was mounted")
        sweep = routines.at_rates(settings, number, [*settings.rates_deg_s, 0.0])
        yield from routines.under_servo(settings, watched(settings, sweep))


def results(settings: AxesSettings, measured: Measured) -> AxesResult:
    """Return the sensitivities, the scale factor and the direction of the input axis."""
    points = tuple(measured)
    step = np.array([point.step for point in points])
    rate, output = (np.array([getattr(point, name) for point in points]) for name in ("rate_deg_s", "output_v"))
    weights = np.zeros((3, len(points)))
    for number in range(3):
        own = step == number + 1
        if own.sum() < 3:
            raise ConfigError(f"expected three windows and more about each axis, got {own.sum()} about {_CASE[number]}")
        weights[number, own] = line_weights(rate[own])[0]
    slopes = weights @ output
    size, axis, _ = direction(slopes, np.zeros((3, 3)))
    require_expected_slope(size, settings.expected, len(_CASE))
    noise = WindowNoise.of(settings, points, size)
    limit = math.radians(settings.mounting_deg)
    across = np.maximum(size**2 - slopes**2, 0.0)  # of which a mounting that is askew lets some into an axis
    digit = settings.meter_resolution_v**2 / 12.0
    by_source: dict[str, tuple[Floats, float]] = {
        "readings": (noise.by_readings(weights), noise.dof),
        "flicker": (noise.by_flicker(weights, [False] * 3), noise.flicker_dof),
        "last digit": (digit * weights @ weights.T, math.inf),
        _MOUNTING: (np.diag(across * limit**2 / 3.0), math.inf),
        f"{_MOUNTING}, axis under test": (np.diag((slopes * (1.0 - math.cos(limit))) ** 2 / 3.0), math.inf),
    }
    known = settings.station.sources
    sigmas = known.meter_sigmas or math.sqrt(3.0)
    scale = [*_parts(by_source, axis), UncertaintyPart(METER_GAIN, abs(size) * (known.meter_gain or 0.0) / sigmas)]
    scale.append(UncertaintyPart(TABLE_RATE, abs(size) * (known.table_rate or 0.0) / math.sqrt(3.0)))
    missing = ["table rate"] if known.table_rate is None else []
    towards = {
        _CASE[other]: measurand(1e3 * angle, "mrad", list(_parts(by_source, 1e3 * by / size)))
        for other, angle, by in tilts(axis)
    }
    own = sum((by_source[name][0] for name in ("readings", "flicker", "last digit")), np.zeros((3, 3)))
    u = np.sqrt(np.diag(own))
    return AxesResult(
        sensitivity=(float(slopes[0]), float(slopes[1]), float(slopes[2])),
        u_sensitivity=(float(u[0]), float(u[1]), float(u[2])),
        scale_factor=measurand(size, "V/(deg/s)", scale, missing, "scale_factor"),
        towards=towards,
        outputs_v={name: float(output[(step == n) & (rate == 0.0)].mean()) for n, name in enumerate(_CASE, 1)},
        mounting_deg=settings.mounting_deg,
    )


def _parts(by_source: Mapping[str, tuple[Floats, float]], by: Floats) -> Iterator[UncertaintyPart]:
    """Yield the contributions to a value that changes `by` so much with each sensitivity."""
    for source, (covariance, dof) in by_source.items():
        u = math.sqrt(max(float(by @ covariance @ by), 0.0))
        yield UncertaintyPart(source, u, finite(dof), rectangular=source == _MOUNTING)


def report(_settings: object, _points: Sequence[Point], found: AxesResult) -> Report:
    """Report the sensitivities and the direction of the input axis."""
    rows = [(axis, slope, found.outputs_v[axis]) for axis, slope in zip(_CASE, found.sensitivity, strict=True)]
    columns = heads("<axis of the rate | slope [V/(deg/s)]:.7g | output at rest [V]:.6g")
    return Report(
        [
            value_table(found.stated()),
            Table(columns, rows, "axis of the case along the table's"),
            Text(_UNSEEN),
        ]
    )


def matrix(found: Mapping[str, AxesResult], unit: str = "V/(deg/s)") -> list[Part]:
    """Return the cross-axis matrix of several outputs by name, and the angles of their input axes.

    A mounting is the same for all of them: an axis that is askew by an angle turns two input axes alike.
    """
    rows = [(name, *each.sensitivity) for name, each in found.items()]
    parts: list[Part] = [
        Table(heads(f"<device | x [{unit}]:.6g | y:.6g | z:.6g"), rows, "Output for the rate about each axis")
    ]
    values = [between_axes(*pair) for pair in combinations(found.items(), 2)]
    return [*parts, value_table(values, "Angles of the input axes")] if values else parts


def between_axes(first: tuple[str, AxesResult], second: tuple[str, AxesResult]) -> Value:
    """Return by name the angle of two input axes, mrad, from the nearest of 0, 90 and 180 degrees."""
    (one, a), (two, b) = first, second
    limit = math.radians(max(a.mounting_deg, b.mounting_deg)) / math.sqrt(3.0)
    (size_a, axis_a, _), (size_b, axis_b, _) = (direction(np.array(each.sensitivity), np.eye(3)) for each in (a, b))
    u_a, u_b = np.array(a.u_sensitivity) / size_a, np.array(b.u_sensitivity) / size_b
    angle = angle_of(axis_a, axis_b, np.diag(u_a**2 + u_b**2))
    readings = math.hypot(*(angle.by_one * u_a), *(angle.by_two * u_b))
    mounted = [angle.by_one[j] * axis_a[k] + angle.by_two[j] * axis_b[k] for j in range(3) for k in range(3) if j != k]
    parts = [
        UncertaintyPart("readings", 1e3 * readings),
        UncertaintyPart(_MOUNTING, 1e3 * limit * math.hypot(*mounted)),
    ]
    found = titled(f"{two} to {one}, {angle.words}", measurand(1e3 * angle.rad, "mrad", parts))
    return found if angle.below is None else found.bound("below", 1e3 * angle.below)


AXES = Procedure(
    name="axes",
    method=(
        "An operator mounts the gyroscope on the rate table with each axis of its case along the table's in turn. The "
        "slope of the output by the table's rate is the sensitivity about that axis; the length of the three is the "
        "scale factor, their direction the input axis."
    ),
    settings=AxesSettings,
    watched=Watched(anew=steps.AskOperator),
    plan=plan,
    results=results,
    report=report,
    needs=roles("multimeter", "rate_table"),
    uses=roles("power", "oscilloscope", "rate_source"),
    streams=True,
    several=True,
)
