"""Output of a warm gyroscope as a closed form of its parameters: the results of a calibration without errors.

Drive at the temperature after the warm-up and on the rails, demodulated modes, feed-through, modulator and output
amplifier, after docs/theory.md. The simulation itself does not use it: it propagates the modes in time.
"""

import cmath
import math
from collections.abc import Callable
from typing import NamedTuple

from vcfbench.sim.gyro.design import earth_rate_deg_s, g_rate_deg_s
from vcfbench.sim.parameters import BenchParameters


def warm_output(
    bench: BenchParameters, generator_ohm: float = 50.0, rails_v: tuple[float, float] | None = None
) -> Callable[[float, float | None], float]:
    """Return the output of the warm gyroscope, V, by rate (deg/s) and V_Vc (V); None with the generator off.

    The rate is that about its own axis, of which a table askew to it gives less.
    V_Vc is the level of the open generator behind `generator_ohm`; 0 ohm means the level at the input.
    `rails_v` are the rails at the PCB, positive and negative; None means the nominal ones.
    """
    thermal, virtual, stage = bench.thermal, bench.virtual_path, bench.output_stage
    positive_v, negative_v = rails_v or (bench.supply.nominal_v, -bench.supply.nominal_v)
    low_v, high_v = min(negative_v + stage.headroom_v, 0.0), max(positive_v - stage.headroom_v, 0.0)
    rise_k = thermal.ambient_c + thermal.self_heating_k - thermal.reference_c
    seen = _demodulated(bench, min(positive_v, -negative_v))
    steady_deg_s = earth_rate_deg_s(bench) + thermal.bias_coefficient_deg_s_k * rise_k + g_rate_deg_s(bench)

    def output(rate_deg_s: float, v_vc_v: float | None) -> float:
        modulated = 0.0
        if v_vc_v is not None:
            node = v_vc_v * virtual.pull_down_ohm / (virtual.pull_down_ohm + generator_ohm)
            modulated = (
                virtual.offset_v + node + virtual.second_order_per_v * node**2 + virtual.third_order_per_v2 * node**3
            )
        acting_v = seen.per_deg_s * (rate_deg_s + steady_deg_s) + seen.per_v * modulated
        past_v = max(abs(acting_v) - abs(seen.per_deg_s) * bench.sense_path.dead_band_deg_s, 0.0)
        u = stage.gain * (math.copysign(past_v, acting_v) + seen.at_rest_v)
        y = sum(order * u**k for k, order in enumerate(stage.orders))
        return min(max(y, low_v), high_v)

    return output


class _Demodulated(NamedTuple):
    """Output of the demodulator, V: per deg/s, per volt at the modulator, of quadrature and carrier at rest."""

    per_deg_s: float
    per_v: float
    at_rest_v: float


def _demodulated(bench: BenchParameters, weaker_rail_v: float) -> _Demodulated:
    """Return it at the temperature of the modes, which they take in steps of `refresh_k`."""
    path, virtual, thermal = bench.sense_path, bench.virtual_path, bench.thermal
    warm_c = thermal.ambient_c + thermal.self_heating_k
    rise_k = math.floor(warm_c / thermal.refresh_k + 0.5) * thermal.refresh_k - thermal.reference_c
    reference_rad_s = 2 * math.pi * bench.drive_mode.frequency_hz
    drive = reference_rad_s * (1 + bench.drive_mode.frequency_coefficient_per_k * rise_k)
    # The amplitude that the AGC holds: the set one on these rails, limited by the largest force
    loop, mode = bench.drive_loop, bench.drive_mode
    wanted = loop.amplitude_m * (1 + loop.amplitude_supply_coefficient_per_v * (weaker_rail_v - bench.supply.nominal_v))
    quality = mode.quality * (1 + mode.quality_coefficient_per_k * rise_k)
    amplitude_m = min(wanted, loop.force_limit_n_per_v * weaker_rail_v * quality / (mode.mass_kg * drive**2))
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
    return _Demodulated((demodulator * per_rate).real, (demodulator * per_volt).real, (demodulator * at_rest).real)
