"""Phases: carrier, Coriolis, virtual Coriolis and demodulator against the drive, and their effect on K_Vc.

Drive, carrier and sense signal are sines of one frequency on the oscilloscope, fitted as IEEE 1057 has it. What a rate
or V_Vc does to the sense signal is the difference of its phasors at both signs: quadrature and feed-through, which are
there all the time, drop out. The demodulator's reference is no node of the bench; it is found by a V_Vc of twice the
drive frequency and a little: :mod:`vcfbench.analysis.rotating`.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable, Sequence
from statistics import fmean, stdev, variance

from msgspec import Struct

from vcfbench.analysis.rotating import Rotation, reference_phase
from vcfbench.errors import MeasurementError
from vcfbench.procedures.phase.settings import PhaseSettings
from vcfbench.procedures.shared.measurand import Measurand, UncertaintyPart, measurand
from vcfbench.steps import CaptureSines, RotationRecord, Rotations, SineRecord, SineRecords
from vcfbench.steps.measured import Measured
from vcfbench.steps.step import LOOK_AT_SIGNALS

_LARGEST_SCATTER_DEG = 5.0
"""Largest scatter of the demodulator's phase between records: mere noise scatters by 52 deg, a gyroscope by 0.01."""
_SKEW_S = 1e-10
"""DSO7104B: delay of a channel, either way (unverified), rectangular."""


class CaptureSense(CaptureSines, frozen=True):
    """Sines of drive, carrier and sense signal while the table has a rate (deg/s) and V_Vc a level (V)."""

    rate_deg_s: float = 0.0
    v_vc_v: float = 0.0


class Phases(Struct, frozen=True):
    """Phases against the drive signal, deg, of one frequency all; and their effect on K_Vc.

    `coriolis_deg` and `virtual_deg` are those of the sense signal that a positive rate and a positive V_Vc make.
    Of `demodulator_deg` half turns are not seen. The `..._from_...` are folded into -90 to 90: `velocity` leads the
    drive signal by a quarter turn. `k_vc_error_ppm` is by how much K_Vc, found by equal outputs, is larger than the
    quotient of both forces' sense signals. `k_vc_ppm_per_carrier_deg` and `k_vc_ppm_per_demodulator_deg` say by how
    much it changes with a degree of either; `scale_factor_ppm_per_demodulator_deg` and
    `bias_deg_s_per_demodulator_deg` by how much scale factor and bias do: the latter is what quadrature and
    feed-through let in. `filter_delay_ms` is that of the filter behind the demodulator.
    """

    carrier_deg: Measurand
    coriolis_deg: Measurand
    virtual_deg: Measurand
    demodulator_deg: Measurand
    carrier_from_velocity_deg: Measurand
    coriolis_from_velocity_deg: Measurand
    virtual_from_coriolis_deg: Measurand
    demodulator_from_coriolis_deg: Measurand
    k_vc_error_ppm: Measurand
    k_vc_ppm_per_carrier_deg: float
    k_vc_ppm_per_demodulator_deg: float
    scale_factor_ppm_per_demodulator_deg: float
    bias_deg_s_per_demodulator_deg: float
    filter_delay_ms: Measurand
    drive_hz: float
    records: int
    target_deg: float
    target_met: bool


class _Angle(Struct, frozen=True):
    """A phase against the drive signal, deg, with the uncertainty that its records leave."""

    deg: float
    u_deg: float
    dof: float

    def part(self, source: str, weight: float = 1.0) -> UncertaintyPart:
        """Return it as a part of an uncertainty, `weight` that of a degree."""
        return UncertaintyPart(source, abs(weight) * self.u_deg, self.dof)


def phases_of(
    settings: PhaseSettings, states: Sequence[tuple[CaptureSense, SineRecords]], turned: Sequence[RotationRecord]
) -> Phases:
    """Return the phases from records of the sense signal at both signs of rate and V_Vc, and of both sines.

    Raises:
        MeasurementError: a rate or V_Vc does not move the sense signal, or the output does not follow that.
    """
    records = [each for _, found in states for each in found.records]
    carrier = _mean_angle([each.phases_deg[1] for each in records])
    coriolis = _response(states, lambda step: step.rate_deg_s, f"a rate of {settings.rate_deg_s:g} deg/s")
    virtual = _response(states, lambda step: step.v_vc_v, f"V_Vc of {settings.v_vc_v:g} V")
    reference = reference_phase(
        [Rotation(r.drive_hz, r.difference_hz, r.reference_deg, r.turning_v, r.output_v) for r in turned]
    )
    if reference.scatter_deg > _LARGEST_SCATTER_DEG:
        raise MeasurementError(
            "the output does not answer to the sense signal: the demodulator's phase scatters by "
            f"{reference.scatter_deg:.0f} deg from record to record, as that of mere noise does",
            instrument="oscilloscope",
            hint=LOOK_AT_SIGNALS,
        )
    demodulator = _Angle(reference.phase_deg, reference.u_phase_deg, reference.dof)
    phases = carrier, coriolis, virtual, demodulator
    drive_hz = fmean(each.frequency_hz for each in records)
    skew = UncertaintyPart("skew of two channels", math.sqrt(2.0 / 3.0) * 360.0 * drive_hz * _SKEW_S)
    against_drive = [measurand(each.deg, "deg", [each.part("records"), skew]) for each in phases]
    error, by_carrier, by_demodulator = _of_k_vc(coriolis, virtual, demodulator)
    return Phases(
        carrier_deg=against_drive[0],
        coriolis_deg=against_drive[1],
        virtual_deg=against_drive[2],
        demodulator_deg=against_drive[3],
        carrier_from_velocity_deg=measurand(_folded(carrier.deg - 90.0), "deg", [carrier.part("carrier"), skew]),
        coriolis_from_velocity_deg=measurand(_folded(coriolis.deg - 90.0), "deg", [coriolis.part("Coriolis"), skew]),
        virtual_from_coriolis_deg=measurand(
            _folded(virtual.deg - coriolis.deg), "deg", [virtual.part("virtual"), coriolis.part("Coriolis")]
        ),
        demodulator_from_coriolis_deg=measurand(
            _folded(demodulator.deg - coriolis.deg), "deg", [demodulator.part("demodulator"), coriolis.part("Coriolis")]
        ),
        k_vc_error_ppm=error,
        k_vc_ppm_per_carrier_deg=by_carrier,
        k_vc_ppm_per_demodulator_deg=by_demodulator,
        scale_factor_ppm_per_demodulator_deg=1e6 * math.radians(math.tan(math.radians(coriolis.deg - demodulator.deg))),
        bias_deg_s_per_demodulator_deg=_bias_per_deg(settings, states, demodulator.deg),
        filter_delay_ms=measurand(
            1e3 * reference.delay_s, "ms", [UncertaintyPart("records", 1e3 * reference.u_delay_s, reference.dof)]
        ),
        drive_hz=drive_hz,
        records=len(records) + len(turned),
        target_deg=settings.target_deg,
        target_met=all(each.expanded_u <= settings.target_deg for each in against_drive),
    )


def _bias_per_deg(
    settings: PhaseSettings, states: Sequence[tuple[CaptureSense, SineRecords]], demodulator_deg: float
) -> float:
    """Return by how much the bias changes with a degree of the demodulator's phase, deg/s.

    What is there at rest is the mean of both signs of a rate; the demodulator lets in what is a quarter turn from it.
    """
    plus, minus = (
        [sense_phasor(each) for step, found in states if sign * step.rate_deg_s > 0.0 for each in found.records]
        for sign in (1.0, -1.0)
    )
    first, second = sum(plus) / len(plus), sum(minus) / len(minus)
    seen = cmath.rect(1.0, -math.radians(demodulator_deg))
    per_deg_s = ((first - second) / (2.0 * settings.rate_deg_s) * seen).real
    return math.radians(((first + second) / 2.0 * seen).imag / per_deg_s)


def _of_k_vc(coriolis: _Angle, virtual: _Angle, demodulator: _Angle) -> tuple[Measurand, float, float]:
    """Return the effect of the phases on K_Vc, ppm, and ppm a degree of carrier and demodulator.

    The demodulator sees both sense signals with the cosine of their angle to its reference.
    """
    seen, by_rate = (math.radians(_folded(each.deg - demodulator.deg)) for each in (virtual, coriolis))
    ratio = math.cos(seen) / math.cos(by_rate)
    ppm_a_degree = 1e6 * ratio * math.radians(1.0)
    by_virtual, by_coriolis = -ppm_a_degree * math.tan(seen), ppm_a_degree * math.tan(by_rate)
    by_demodulator = -by_virtual - by_coriolis
    parts = [
        virtual.part("virtual", by_virtual),
        coriolis.part("Coriolis", by_coriolis),
        demodulator.part("demodulator", by_demodulator),
    ]
    return measurand(1e6 * (ratio - 1.0), "ppm", parts), by_virtual, by_demodulator


def _folded(angle_deg: float) -> float:
    """Return an angle apart from half turns, -90 to 90 deg."""
    return math.remainder(angle_deg, 180.0)


def _mean_angle(angles_deg: Sequence[float]) -> _Angle:
    """Return the mean of angles that lie close together, also across 180 deg."""
    first = angles_deg[0]
    beside = [math.remainder(each - first, 360.0) for each in angles_deg]
    u_deg = stdev(beside) / math.sqrt(len(beside))
    return _Angle(math.remainder(first + fmean(beside), 360.0), u_deg, len(beside) - 1)


def _response(
    states: Sequence[tuple[CaptureSense, SineRecords]], level: Callable[[CaptureSense], float], what: str
) -> _Angle:
    """Return the phase of the difference of the sense signal's phasors between the two signs of a level."""
    plus, minus = (
        [sense_phasor(each) for step, found in states if sign * level(step) > 0.0 for each in found.records]
        for sign in (1.0, -1.0)
    )
    moved = sum(plus) / len(plus) - sum(minus) / len(minus)
    if abs(moved) < 1e-3 * max(map(abs, plus)):
        raise MeasurementError(f"{what} of either sign does not move the sense signal", instrument="oscilloscope")
    along = moved / abs(moved)
    variances = [variance((each / along).imag for each in state) / len(state) for state in (plus, minus)]
    dof = len(plus) + len(minus) - 2
    return _Angle(math.degrees(cmath.phase(moved)), math.degrees(math.sqrt(sum(variances)) / abs(moved)), dof)


def sense_phasor(record: SineRecord) -> complex:
    """Return the sense signal against the drive signal, V."""
    return cmath.rect(record.amplitudes_v[2], math.radians(record.phases_deg[2]))


def phase_results(settings: PhaseSettings, measured: Measured) -> Phases:
    """Return the phases from all that was captured."""
    states = [(step, found) for step, found in measured.found(SineRecords) if isinstance(step, CaptureSense)]
    turned = [each for _, found in measured.found(Rotations) for each in found.records]
    return phases_of(settings, states, turned)
