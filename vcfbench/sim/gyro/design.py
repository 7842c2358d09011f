"""Choice of the shipped parameter sets: round physical values, and gains that follow from targets.

The structure's frequencies, quality factors and noise are the paper's. Everything else is chosen; gains that must
meet a figure are computed here from that figure by the closed form of the steady state, so no magic constant is left
unexplained.
"""

import cmath
import math
from typing import NamedTuple

from msgspec import Struct
from msgspec.structs import replace

from vcfbench.sim.parameters import BenchParameters, SenseMode, Site

EARTH_RATE_DEG_S = 15.041067 / 3600.0


class Targets(Struct, frozen=True):
    """Targets of the computed gains: y = c0 + c1 r + c2 r^2 + c3 r^3, r the table rate in deg/s, V_Vc switch open."""

    bias_v: float
    scale_factor_v_s_deg: float
    second_order: float
    third_order: float
    virtual_scale_deg_s_v: float
    switch_on_shift_v: float


IDEAL_TARGETS = Targets(0.0, -12.542052e-3, 0.0, 0.0, 150.0, 0.0)
# Wang et al. Table 1, turntable column: c2 and c3 are those of a cubic fitted to it. Over the paper's 17 rates they add
# mean(r^2) c2 = 6238.8 c2 to the intercept and sum(r^4)/sum(r^2) c3 = 32178 c3 to the slope of the least-squares line.
PAPER_TARGETS = Targets(
    bias_v=-42.041176e-3 + 1.06e-7 * 6238.8,
    scale_factor_v_s_deg=-12.542052e-3 - 3.3e-10 * 32178.0,
    second_order=-1.06e-7,
    third_order=3.3e-10,
    virtual_scale_deg_s_v=150.0,
    switch_on_shift_v=51.7e-3,
)


class Demodulated(NamedTuple):
    """Steady output of the demodulator, V: per deg/s, per volt at the modulator, of quadrature and carrier at rest."""

    per_deg_s: float
    per_v: float
    at_rest_v: float


def demodulated(bench: BenchParameters, rise_k: float, amplitude_m: float) -> Demodulated:
    """Return it so much above the reference temperature, by the amplitude of the drive."""
    path, virtual = bench.sense_path, bench.virtual_path
    reference_rad_s = 2 * math.pi * bench.drive_mode.frequency_hz
    drive = reference_rad_s * (1 + bench.drive_mode.frequency_coefficient_per_k * rise_k)
    v_dac = path.reference_amplitude_v * amplitude_m / bench.drive_loop.amplitude_m
    demodulator = 0.5j * path.multiplier_per_v * v_dac * cmath.exp(-1j * path.demodulator_phase_rad)
    carrier = -1j * cmath.exp(1j * virtual.carrier_phase_rad)
    per_rate = shifted = 0j
    per_volt = carrier * path.v_vc_feedthrough * v_dac / path.reference_amplitude_v
    for sense in (bench.sense_in_phase, bench.sense_anti_phase):
        own = 2 * math.pi * sense.frequency_hz * (1 + sense.frequency_coefficient_per_k * rise_k)
        quality = sense.quality * (1 + sense.quality_coefficient_per_k * rise_k)
        picked = path.preamplifier_gain * path.amplifier_gain * sense.pick_off_v_per_m
        answer = picked / complex(own**2 - drive**2, own * drive / quality)
        left, right = sense.left_participation, sense.right_participation
        combs = left * virtual.left_comb_n_per_v2 + right * virtual.right_comb_n_per_v2
        per_rate += answer * (left + right) * 2j * amplitude_m * drive * math.pi / 180
        per_volt += answer * carrier * combs * v_dac / virtual.mass_kg
        shifted += answer * 2 * amplitude_m * reference_rad_s * sense.quadrature_rad_s  # a stiffness: drive or no drive
    at_rest = shifted + carrier * path.carrier_feedthrough * v_dac
    return Demodulated((demodulator * per_rate).real, (demodulator * per_volt).real, (demodulator * at_rest).real)


def seen_share(bench: BenchParameters) -> float:
    """Return the share of a rate about the vertical, the table's axis, that the gyroscope's axis sees."""
    along = sum(each * up for each, up in zip(bench.site.input_axis, bench.site.up, strict=True))
    return math.cos(math.radians(bench.table.misalignment_deg)) * along


def earth_rate_deg_s(bench: BenchParameters) -> float:
    """Return the Earth's rate that the gyroscope sees of the vertical, the table's axis, deg/s."""
    return EARTH_RATE_DEG_S * math.sin(math.radians(bench.site.latitude_deg)) * seen_share(bench)


def g_rate_deg_s(bench: BenchParameters) -> float:
    """Return the bias by gravity, deg/s, that of the latitude at sea level (GRS 1967, rounded)."""
    squared = math.sin(math.radians(bench.site.latitude_deg)) ** 2
    gravity = 9.780318 * (1.0 + 0.0053024 * squared - 0.0000235 * squared * (1.0 - squared)) / 9.80665
    parts = zip(bench.sense_path.g_sensitivity_deg_s_g, bench.site.up, strict=True)
    return gravity * sum(per_g * up for per_g, up in parts)


def design(bench: BenchParameters, targets: Targets) -> BenchParameters:
    """Return `bench` with output gain, offset and curvature, K_FBY and modulator offset that meet `targets`.

    The output is y = offset + u + a2 u^2 + a3 u^3 with u = u0 + g r, where u0 comes from quadrature and Earth rate.
    """
    per_rate, per_volt, quadrature = demodulated(bench, 0.0, bench.drive_loop.amplitude_m)
    earth = earth_rate_deg_s(bench)
    gain, second, third = targets.scale_factor_v_s_deg / per_rate, 0.0, 0.0
    for _ in range(20):  # the curvature shifts the slope at u0 a little: converges at once
        slope = gain * per_rate
        start = gain * (quadrature + per_rate * earth)
        third = targets.third_order / slope**3
        second = targets.second_order / slope**2 - 3 * third * start
        gain = targets.scale_factor_v_s_deg / (per_rate * (1 + 2 * second * start + 3 * third * start**2))
    start = gain * (quadrature + per_rate * earth)
    offset = targets.bias_v - (start + second * start**2 + third * start**3)
    combs = targets.virtual_scale_deg_s_v * per_rate / per_volt
    virtual = replace(
        bench.virtual_path,
        left_comb_n_per_v2=bench.virtual_path.left_comb_n_per_v2 * combs,
        right_comb_n_per_v2=bench.virtual_path.right_comb_n_per_v2 * combs,
        offset_v=targets.switch_on_shift_v / (targets.scale_factor_v_s_deg * targets.virtual_scale_deg_s_v),
    )
    output = replace(
        bench.output_stage, gain=gain, offset_v=offset, second_order_per_v=second, third_order_per_v2=third
    )
    return replace(bench, virtual_path=virtual, output_stage=output)


PERFECT = BenchParameters(
    sense_in_phase=SenseMode(frequency_hz=3342.0, left_participation=0.8, right_participation=0.2),
    sense_anti_phase=SenseMode(frequency_hz=3464.1, left_participation=0.5, right_participation=0.5),
)
"""The perfect bench before its gains are computed; round numbers are chosen, the others are the paper's."""


def ideal_bench() -> BenchParameters:
    """Return the shipped set `ideal`: every imperfection off, noise too."""
    return design(PERFECT, IDEAL_TARGETS)


def imperfect() -> BenchParameters:
    """Return the specimen of the set `paper` before its gains are computed; every imperfection here was chosen."""
    return replace(
        PERFECT,
        drive_mode=replace(PERFECT.drive_mode, frequency_coefficient_per_k=-30e-6, quality_coefficient_per_k=-2e-3),
        sense_in_phase=replace(
            PERFECT.sense_in_phase,
            quadrature_rad_s=math.radians(5.0),
            frequency_coefficient_per_k=-31e-6,
            quality_coefficient_per_k=-2e-3,
        ),
        sense_anti_phase=replace(
            PERFECT.sense_anti_phase,
            quadrature_rad_s=math.radians(20.0),
            frequency_coefficient_per_k=-31e-6,
            quality_coefficient_per_k=-2e-3,
        ),
        drive_loop=replace(PERFECT.drive_loop, amplitude_supply_coefficient_per_v=200e-6),
        supply=replace(PERFECT.supply, ripple_feedthrough=1e-3),
        sense_path=replace(PERFECT.sense_path, demodulator_phase_rad=math.pi - math.radians(0.5)),
        virtual_path=replace(
            PERFECT.virtual_path,
            carrier_phase_rad=math.pi + math.radians(0.3),
            left_comb_n_per_v2=1.01e-8,
            right_comb_n_per_v2=0.99e-8,
            second_order_per_v=13e-3,
            third_order_per_v2=14.5e-3,
        ),
        noise=replace(
            PERFECT.noise, angle_random_walk_deg_sqrt_s=0.21 / 60, bias_instability_deg_s=3.7 / 0.6642824702679 / 3600
        ),
        thermal=replace(PERFECT.thermal, self_heating_k=0.3, bias_coefficient_deg_s_k=30.0 / 3600),
        table=replace(
            PERFECT.table,
            rate_error=5e-6,
            ripple_arcsec=(5.0, 0.5),
            ripple_harmonic=(1, 8),
            ripple_phase_rad=(0.4, 1.1),
            flutter_per_sqrt_hz=5e-6,
        ),
        site=Site(latitude_deg=37.9),
        pick_up=replace(PERFECT.pick_up, meter_leads_v=1e-3, v_vc_lead_v=20e-6),
    )


def paper_bench() -> BenchParameters:
    """Return the shipped set `paper`, a realistic specimen.

    Its imperfections were chosen so that the calibration of Wang et al. (2018) comes out: the turntable column's K and
    bias, 51.7 mV when the switch closes at 0 V.
    """
    return design(imperfect(), PAPER_TARGETS)
