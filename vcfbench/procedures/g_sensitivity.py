"""Bias against acceleration: an operator turns the case, so that each of its axes points up and down.

IEEE 1431 (12.11) has gravity as the acceleration. The positions are taken there and back, so that a drift in line with
time falls out. The Earth's rate comes with them: whole along a vertical input axis, where the latitude tells it, and
none along a level one that points east, as far as it does.
"""

import math
from collections.abc import Iterator, Sequence
from statistics import fmean
from typing import Annotated, Literal

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from vcfbench import steps
from vcfbench.analysis.arrays import Floats
from vcfbench.belief.jumps import watched
from vcfbench.errors import ConfigError
from vcfbench.instructions import routines
from vcfbench.instructions.procedure import Procedure, Watched, roles
from vcfbench.instructions.scale_factor import AtRestSettings, rates_by, scale_factor_used
from vcfbench.instructions.schedule import EARTH_DEG_S
from vcfbench.instructions.v_vc import meter_error
from vcfbench.records.schema import Point
from vcfbench.reports.document import Axis, Figure, Report, Series, Table, Text, heads
from vcfbench.station.bounds import ranged, said, several
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.steps.measured import Measured
from vcfbench.uncertainty.measurand import measurand, quantity_table, titled
from vcfbench.uncertainty.window_sum import noise_v, windows_without_times
from vcfbench.values.sources import METER_GAIN
from vcfbench.values.value import Measurand, UncertaintyPart, Value

STANDARD_GRAVITY_M_S2 = 9.80665
"""One g (3rd CGPM, 1901)."""
_ANYWHERE_M_S2 = 0.027
"""Gravity at sea level is within so much of it: 9.780 at the equator, 9.832 at the poles (WGS 84)."""
_ALTITUDE_M_S2 = 0.0062
"""A station is as high as 2000 m: 3.086e-6 m/s^2 less for each metre (free air)."""
Axes = Literal["x", "y", "z"]


class GSensitivitySettings(AtRestSettings, frozen=True, kw_only=True):
    """Settings of the bias against acceleration, in addition to those of all procedures."""

    warm_up_s: Annotated[float, ranged(0.0, 86_400.0, "wait after power-on")] = 1800.0
    axes: Annotated[tuple[Axes, ...], several(1, 3, "axes of the case that are turned up and down")] = ("x", "y", "z")
    input_axis: Annotated[Axes, said("axis of the case about which the gyroscope senses")] = "z"
    cycles: Annotated[int, ranged(1, 100, "cycles through the positions, there and back")] = 2
    turn_s: Annotated[float, ranged(1.0, 3600.0, "time that turning the case takes, for the estimate")] = 60.0
    samples: Annotated[int, ranged(2, 1000, "readings per mean", option=True)] = 60
    tilt_deg: Annotated[float, ranged(0.0, 45.0, "largest angle of an axis from the vertical")] = 1.0
    heading_deg: Annotated[float, ranged(0.0, 90.0, "largest angle of a level input axis from east")] = 5.0

    @property
    def early_look(self) -> tuple[str, ...]:
        return super().early_look[1:]  # It may lie anywhere

    @property
    def positions(self) -> tuple[str, ...]:
        """The axes that point up in turn, there and back."""
        there = [sign + axis for axis in dict.fromkeys(self.axes) for sign in "+-"]
        return (*there, *reversed(there))

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        yield from windows_without_times(self)


class GSensitivityResult(Struct, frozen=True):
    """Result of the bias against acceleration."""

    per_g: dict[str, Measurand]
    """Sensitivity by axis of the case."""
    per_m_s2: dict[str, Measurand]
    """The same in SI units."""
    biases_deg_s: dict[str, float]
    """Output by the axis that points up, as a rate, the Earth's rate taken off."""
    gravity_m_s2: float
    gravity_from: str
    scale_factor_v_per_deg_s: float
    scale_factor_from: str

    def stated(self) -> Iterator[Value]:
        """Yield its values."""
        yield from (titled(f"bias by acceleration along {axis}", each) for axis, each in self.per_g.items())


@routines.framed(routines.energised, routines.drive_seen, watched)
def g_sensitivity(settings: GSensitivitySettings) -> steps.Plan:
    """Ask for the case to be turned, and take a window in each position; leave it upright."""
    previous, upright = "", f"+{settings.input_axis}"
    for _ in range(settings.cycles):
        for number, up in enumerate(settings.positions):
            if up != previous:
                yield _turned(settings, up)
                yield steps.Settle(settings.settle_s, "gyro settles after it was turned")
            yield from routines.take(settings, number, rate_deg_s=0.0, v_vc_v=0.0)
            previous = up
    yield from routines.require_answer(settings, turns=False)
    if previous != upright:
        yield _turned(settings, upright)


def _turned(settings: GSensitivitySettings, up: str) -> steps.AskOperator:
    """Return the step that has the case turned."""
    level = up[1] != settings.input_axis
    east = f", and its input axis +{settings.input_axis} east" if level else ""
    words = f"turn the gyroscope so that its {up} axis points up{east}, and take the hands off"
    return steps.AskOperator(words, settings.turn_s, (("up_axis", up),))


def results(settings: GSensitivitySettings, measured: Measured) -> GSensitivityResult:
    """Return the sensitivity along each axis."""
    scale, where = scale_factor_used(settings), settings.station.latitude_deg
    windows = [each for step, each in measured.found(steps.Window) if isinstance(step, steps.Acquire)]
    ups = settings.positions * settings.cycles
    if len(windows) != len(ups):
        raise ConfigError(f"expected {len(ups)} windows, got {len(windows)}")
    vertical = 0.0 if where is None else EARTH_DEG_S * math.sin(math.radians(where))
    earth = {sign + settings.input_axis: float(f"{sign}1") * vertical for sign in "+-"}
    found = [each.mean_v / scale.value - earth.get(up, 0.0) for up, each in zip(ups, windows, strict=True)]
    biases = {up: fmean(b for at, b in zip(ups, found, strict=True) if at == up) for up in sorted(set(ups))}
    gravity_m_s2, u_gravity, gravity_from = gravity(where)
    g = gravity_m_s2 / STANDARD_GRAVITY_M_S2
    per_g = {axis: (biases["+" + axis] - biases["-" + axis]) / (2.0 * g) for axis in dict.fromkeys(settings.axes)}
    in_g, in_si = dict[str, Measurand](), dict[str, Measurand]()
    for axis, value in per_g.items():
        weights = np.array([(up == "+" + axis) - float(up == "-" + axis) for up in ups])
        across = math.hypot(*(other for name, other in per_g.items() if name != axis))
        shortened = (1.0 - math.cos(math.radians(settings.tilt_deg))) / math.sqrt(3.0)
        parts = [
            *_over_time(settings, windows, weights / (2.0 * g * (weights > 0.0).sum()), scale.value),
            UncertaintyPart("gravity", value * u_gravity / gravity_m_s2),
            UncertaintyPart("tilt, of gravity along the other axes", across * _of_two(settings.tilt_deg)),
            UncertaintyPart("tilt, of gravity along the axis", value * shortened),
            *(replace(part, u=part.u / g) for part in _earth(settings, axis)),
            UncertaintyPart(METER_GAIN, value * meter_error(settings, "multimeter").u_gain),
            UncertaintyPart("scale factor", value * (scale.u or 0.0) / scale.value),
        ]
        lacks = {
            "scale factor": scale.u is None,
            "warm-up": settings.station.sources.warm_up_k is None,
            "other axes": len(per_g) < 3,
        }
        missing = [name for name, lacking in lacks.items() if lacking]
        in_g[axis], in_si[axis] = (
            measurand(value / per, f"(deg/s)/{unit}", [replace(part, u=part.u / per) for part in parts], missing)
            for unit, per in (("g", 1.0), ("(m/s^2)", STANDARD_GRAVITY_M_S2))
        )
    return GSensitivityResult(in_g, in_si, biases, gravity_m_s2, gravity_from, scale.value, scale.source)


def gravity(latitude_deg: float | None) -> tuple[float, float, str]:
    """Return gravity at sea level, m/s^2 (Somigliana, WGS 84), its u with the altitude unknown, and its source."""
    altitude = _ALTITUDE_M_S2 / math.sqrt(3.0)
    if latitude_deg is None:
        return (
            STANDARD_GRAVITY_M_S2,
            math.hypot(_ANYWHERE_M_S2 / math.sqrt(3.0), altitude),
            "standard, no latitude known",
        )
    squared = math.sin(math.radians(latitude_deg)) ** 2
    at_sea = 9.7803253359 * (1.0 + 0.00193185265241 * squared) / math.sqrt(1.0 - 0.00669437999014 * squared)
    return at_sea, altitude, f"of {latitude_deg:g} deg of latitude, at sea level"


def _of_two(limit_deg: float) -> float:
    """Return the u of half the difference of two positions whose sines of an angle are within a limit, each its own."""
    return math.sin(math.radians(limit_deg)) / math.sqrt(6.0)


def _earth(settings: GSensitivitySettings, axis: str) -> Iterator[UncertaintyPart]:
    """Yield the uncertainty of the Earth's rate, deg/s, in half the difference of an axis up and down."""
    latitude = settings.station.latitude_deg
    north, vertical = EARTH_DEG_S, EARTH_DEG_S
    if latitude is not None:
        north, vertical = (abs(EARTH_DEG_S * f(math.radians(latitude))) for f in (math.cos, math.sin))
    if axis == settings.input_axis:
        yield UncertaintyPart("the Earth's rate to the north, by tilt", north * _of_two(settings.tilt_deg))
        if latitude is None:
            yield UncertaintyPart("the Earth's vertical rate, no latitude known", vertical / math.sqrt(3.0))
    else:
        yield UncertaintyPart("the Earth's rate to the north, by heading", north * _of_two(settings.heading_deg))
        yield UncertaintyPart("the Earth's vertical rate, by tilt", vertical * _of_two(settings.tilt_deg))


def _over_time(
    settings: GSensitivitySettings, windows: Sequence[steps.Window], weights: Floats, scale: float
) -> Iterator[UncertaintyPart]:
    """Yield the effects of readings, flicker and the end of the warm-up on a sum of windows by `weights`, as a rate."""
    of_each = {place: float(weight) for place, weight in enumerate(weights) if weight}
    for part in noise_v(settings, windows, of_each, [each.point for each in windows]):
        yield replace(part, u=part.u / abs(scale))
    known, begins_s = settings.station.sources, np.array([float(each.readings[0].t_s) for each in windows])
    left = np.exp(-(settings.start_up_s + begins_s - begins_s[0]) / known.warm_up_time_s)
    warm_up_deg_s = (known.warm_up_k or 0.0) * (known.bias_deg_h_k or 0.0) / 3600.0
    yield UncertaintyPart("warm-up", warm_up_deg_s * float(weights @ left) / math.sqrt(3.0))


def report(settings: GSensitivitySettings, _points: Sequence[Point], found: GSensitivityResult) -> Report:
    """Report the sensitivity along each axis, and the bias in each position."""
    rows = {f"along {axis}": each for axis, each in found.per_g.items()}
    rows |= {f"along {axis}, SI": each for axis, each in found.per_m_s2.items()}
    columns = heads("<axis that points up | bias [deg/s]:.5f")
    words = (
        f"g is {STANDARD_GRAVITY_M_S2} m/s^2; gravity {found.gravity_m_s2:.4f} m/s^2, {found.gravity_from}; "
        f"{rates_by(found.scale_factor_v_per_deg_s, found.scale_factor_from)}. The Earth's rate along a vertical "
        f"input axis ({settings.input_axis}) is subtracted if the latitude is known. Not detected: an effect of g^2, "
        "and a drift that is not linear in time."
    )
    numbers = list(range(1, len(found.biases_deg_s) + 1))
    series = Series("bias", numbers, list(found.biases_deg_s.values()))
    names = ", ".join(f"{n} {name}" for n, name in zip(numbers, found.biases_deg_s, strict=True))
    return Report(
        [
            quantity_table(rows),
            Table(columns, list(found.biases_deg_s.items()), "Bias by position"),
            Text(words),
            Figure("Bias by position", Axis(f"position: {names}"), Axis("bias", "deg/s"), [series]),
        ]
    )


G_SENSITIVITY = Procedure(
    name="g-sensitivity",
    method=(
        "An operator turns the case so that each axis points up and down in turn, there and back; half the difference "
        "of the outputs at rest, as a rate and less the Earth's, over gravity is the sensitivity along the axis."
    ),
    settings=GSensitivitySettings,
    watched=Watched(),
    plan=g_sensitivity,
    results=results,
    report=report,
    needs=roles("multimeter"),
    uses=roles("power", "oscilloscope", "rate_source"),
)
