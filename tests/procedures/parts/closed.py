"""Closed forms of the parts that no change of an instrument makes: the scatter of records, the last digit."""

from __future__ import annotations

import cmath
import math
from itertools import pairwise
from statistics import fmean, stdev, variance
from typing import TYPE_CHECKING, Any

import numpy as np

from vcfbench.procedures.phase import Rotations
from vcfbench.procedures.power.results import RailsLogged
from vcfbench.procedures.resonance import DriveDecay, SenseDecay
from vcfbench.steps import SineRecords
from vcfbench.uncertainty.oscilloscope import CaptureSense

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from tests.procedures.parts.held import Run


def _of_mean(values: Sequence[float]) -> float:
    return stdev(values) / math.sqrt(len(values))


def scatter_of_decays(run: Run) -> dict[str, float]:
    """Return u of the mean of what the ring-downs found, one by one."""
    sense = [found for _, found in run.measured.found(SenseDecay)]
    drive = [found for _, found in run.measured.found(DriveDecay)]
    lists = {
        "drive_hz": [each.drive_hz for each in sense],
        "sense_hz": [each.modes[0].frequency_hz for each in sense],
        "split_ring_down_hz": [each.drive_hz - each.modes[0].frequency_hz for each in sense],
        "sense_q_ring_down": [each.modes[0].q for each in sense],
        "in_phase_hz": [each.modes[1].frequency_hz for each in sense],
        "in_phase_q": [each.modes[1].q for each in sense],
        "drive_ring_down_hz": [each.frequency_hz for each in drive],
        "drive_q": [each.q for each in drive],
    }
    return {name: (_of_quality if "_q" in name else _of_mean)(values) for name, values in lists.items()}


def _of_quality(values: Sequence[float]) -> float:
    """Return u of a quality factor, to the second order of the scatter, by which noise that rings moves it."""
    share = stdev(values) / fmean(values)
    return fmean(values) * math.hypot(share / math.sqrt(len(values)), share**2)


def scatter_of_phases(run: Run) -> dict[str, float]:
    """Return u of the phases by the scatter of their records: across the way that a force of either sign makes."""
    states = [(step, found) for step, found in run.measured.found(SineRecords) if isinstance(step, CaptureSense)]
    records = [each for _, found in states for each in found.records]

    def across(level: Callable[[CaptureSense], float]) -> float:
        ways = [
            [
                cmath.rect(each.amplitudes_v[2], math.radians(each.phases_deg[2]))
                for step, found in states
                for each in found.records
                if level(step) * sign > 0.0
            ]
            for sign in (1.0, -1.0)
        ]
        moved = sum(ways[0]) / len(ways[0]) - sum(ways[1]) / len(ways[1])
        u_v = math.hypot(*(math.sqrt(variance([(each / moved).imag for each in way]) / len(way)) for way in ways))
        return math.degrees(u_v)

    # The reference by a line through the phases of both sines against their difference of frequency: its slope is the
    # filter's delay
    aimed_hz = run.settings.difference_hz  # a sine that the time bases moved away is taken again
    turned = [each for _, found in run.measured.found(Rotations) for each in found.records]
    turned = [each for each in turned if abs(abs(each.difference_hz) - aimed_hz) <= 1e-3 * aimed_hz]
    hz = np.array([each.difference_hz for each in turned])
    beside = np.array([each.reference_deg for each in turned])
    beside = (
        np.array([math.remainder(each - beside[0], 360.0) for each in beside]) if np.ptp(beside) > 180.0 else beside
    )
    design = np.column_stack([np.ones(hz.size), hz])
    _, (squares,), *_ = np.linalg.lstsq(design, beside, rcond=None)
    u_phase, u_slope = np.sqrt(squares / (hz.size - 2) * np.diag(np.linalg.inv(design.T @ design)))
    return {
        "carrier_deg": _of_mean([math.remainder(each.phases_deg[1], 360.0) for each in records]),
        "coriolis_deg": across(lambda step: step.rate_deg_s),
        "virtual_deg": across(lambda step: step.v_vc_v),
        "demodulator_deg": float(u_phase),
        "filter_delay_ms": float(1e3 * u_slope / 360.0),
    }


def u_of_phase(name: str) -> Callable[[Run], dict[str, float]]:
    """Return what gives u of one phase to every value."""
    return lambda run: dict.fromkeys(run.values, scatter_of_phases(run)[f"{name}_deg"])


def of_cosines(moved: str) -> Callable[[Run], dict[str, float]]:
    """Return what gives u of the error of K_Vc, ppm, by one phase: the ratio of the cosines of two angles."""

    def u(run: Run) -> dict[str, float]:
        def ppm(by_deg: float) -> float:
            at = {name: run.values[f"{name}_deg"].value for name in ("coriolis", "virtual", "demodulator")}
            at[moved] += by_deg
            seen, by_rate = (math.cos(math.radians(at[name] - at["demodulator"])) for name in ("virtual", "coriolis"))
            return 1e6 * seen / by_rate

        return {"k_vc_error_ppm": abs(ppm(0.01) - ppm(-0.01)) / 0.02 * scatter_of_phases(run)[f"{moved}_deg"]}

    return u


def between_readings(run: Run) -> dict[str, float]:
    """Return the time between the two readings of the output between which it became valid."""
    (log,) = [found for _, found in run.measured.found(RailsLogged)]
    times_s = [0.0, *(each.t_s - log.t_s for each in log.outputs)]
    middle_s = run.values["power_on[0].valid_output"].value
    widths: list[Any] = [b - a for a, b in pairwise(times_s) if a <= middle_s <= b]
    return {"power_on[0].valid_output": widths[0]}


def ranges_ohm(_run: Run) -> dict[str, float]:
    """Return the range of each line's resistance: rails, V_Vc input, output."""
    return {f"lines[{line}].resistance": each for line, each in enumerate((1e4, 1e4, 1e7, 1e3))}


def over_static(of: Callable[[Run], dict[str, float]]) -> Callable[[Run], dict[str, float]]:
    """Return what gives u of the static response by `of`, and of all that is over it in proportion."""

    def every(run: Run) -> dict[str, float]:
        static = run.values["static_v_per_v"]
        share = of(run)["static_v_per_v"] / abs(static.value)
        return {name: share * abs(each.value) for name, each in run.values.items()}

    return every


def across(run: Run) -> dict[str, float]:
    """Return of each axis what the others are sensitive to, together."""
    sizes = {name: each.value for name, each in run.values.items()}
    return {
        name: math.hypot(*(each for other, each in sizes.items() if other != name and other[:-1] == name[:-1]))
        for name in sizes
    }


def in_proportion(run: Run) -> dict[str, float]:
    """Return the size of every value: what a relative error does to it."""
    return {name: abs(each.value) for name, each in run.values.items()}


def alike(run: Run) -> dict[str, float]:
    """Return 1 for every value: what an error in its own unit does to it."""
    return dict.fromkeys(run.values, 1.0)


def over_k_vc(run: Run) -> dict[str, float]:
    """Return by how much a unit of the K_Vc that was told moves what is in proportion to it, or to one over it."""
    told = run.settings.k_vc
    return {name: abs(each.value / float(told)) for name, each in run.values.items()}


def over_scale_factor(run: Run) -> dict[str, float]:
    """Return by how much a unit of the scale factor that was told moves what is divided by it."""
    return {name: abs(each.value / run.settings.scale_factor_v_per_deg_s) for name, each in run.values.items()}


def by_scale_factor(of: Callable[[Run], dict[str, float]]) -> Callable[[Run], dict[str, float]]:
    """Return what gives u of a bias as a rate by that of the run's scale factor, which `of` gives."""

    def every(run: Run) -> dict[str, float]:
        scale_factor = run.values["scale_factor"].value
        share = of(run)["scale_factor"] / abs(scale_factor)
        return {name: share * abs(each.value) for name, each in run.values.items()}

    return every


def of_curvature(run: Run) -> dict[str, float]:
    """Return by how much a kelvin moves slope and curvature of the scale factor's parabola, both over its value."""
    slope, curvature = (run.values[name].value for name in ("scale_factor_tc", "scale_factor_tc2"))
    return {
        "scale_factor_tc": abs(2.0 * curvature - 1e-6 * slope**2),
        "scale_factor_tc2": 1e-6 * abs(curvature * slope),
    }


def of_drive(run: Run) -> dict[str, float]:
    """Return u of quality factors by that of the drive's frequency: time base, scatter and digits of the records."""
    records = [found for _, found in run.measured.found(SineRecords) if len(found.channels) == 1][-1].records
    found_hz = [each.frequency_hz for each in records]
    digits = max(0.0, fmean(each.u_frequency_hz**2 for each in records) - 2.0 * variance(found_hz))
    u_hz = math.sqrt((25e-6 * fmean(found_hz)) ** 2 / 3.0 + variance(found_hz) / len(found_hz) + digits)
    return {name: abs(each.value) * u_hz / fmean(found_hz) for name, each in run.values.items() if "q" in name}


def over_gravity(run: Run) -> dict[str, float]:
    """Return what a deg/s of half the difference of two positions makes, per g or m/s^2, at 37.9 deg of latitude."""
    return {name: (9.80665 if name.startswith("per_g") else 1.0) / 9.800 for name in run.values}


def volts_over_gravity(run: Run) -> dict[str, float]:
    """Return the same of a volt."""
    told = abs(run.settings.scale_factor_v_per_deg_s)
    return {name: each / told for name, each in over_gravity(run).items()}
