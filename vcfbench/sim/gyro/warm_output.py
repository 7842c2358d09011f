"""The output of a warm gyroscope as a closed form of its parameters: what a calibration without errors would find.

Demodulated modes at the temperature after the warm-up, modulator and output amplifier, after docs/theory.md. The
simulation itself does not use it: it propagates the modes in time.
"""

from __future__ import annotations

import cmath
import math
from typing import TYPE_CHECKING

from vcfbench.sim.gyro.design import earth_rate_deg_s

if TYPE_CHECKING:
    from collections.abc import Callable

    from vcfbench.sim.parameters import BenchParameters

__all__ = ["warm_output"]


def warm_output(bench: BenchParameters, generator_ohm: float = 50.0) -> Callable[[float, float | None], float]:
    """Return the output of the warm gyroscope, V, by rate (deg/s) and V_Vc (V); None with the generator off.

    The rate is that about its own axis, of which a table askew to it gives less.
    V_Vc is the level of the open generator behind `generator_ohm`; 0 ohm means the level at the input.
    """
    thermal, virtual, stage = bench.thermal, bench.virtual_path, bench.output_stage
    rise = thermal.ambient_c + thermal.self_heating_k - thermal.reference_c
    seen = _demodulated(bench, rise)
    steady_deg_s = earth_rate_deg_s(bench) + thermal.bias_coefficient_deg_s_k * rise

    def output(rate_deg_s: float, v_vc_v: float | None) -> float:
        modulated = 0.0
        if v_vc_v is not None:
            node = v_vc_v * virtual.pull_down_ohm / (virtual.pull_down_ohm + generator_ohm)
            modulated = (
                virtual.offset_v + node + virtual.second_order_per_v * node**2 + virtual.third_order_per_v2 * node**3
            )
        u = stage.gain * (seen[0] * (rate_deg_s + steady_deg_s) + seen[1] * modulated + seen[2])
        return stage.offset_v + u + stage.second_order_per_v * u**2 + stage.third_order_per_v2 * u**3

    return output


def _demodulated(bench: BenchParameters, rise_k: float) -> tuple[float, float, float]:
    """Return what comes out of the demodulator per deg/s, per volt at the modulator, and from quadrature, V."""
    path, virtual = bench.sense_path, bench.virtual_path
    drive = 2 * math.pi * bench.drive_mode.frequency_hz * (1 + bench.drive_mode.frequency_coefficient_per_k * rise_k)
    velocity = bench.drive_loop.amplitude_m * drive
    chain = path.preamplifier_gain * path.amplifier_gain * path.multiplier_per_v * path.reference_amplitude_v / 2
    per_rate = per_volt = shifted = 0j
    for mode in (bench.sense_in_phase, bench.sense_anti_phase):
        own = 2 * math.pi * mode.frequency_hz * (1 + mode.frequency_coefficient_per_k * rise_k)
        quality = mode.quality * (1 + mode.quality_coefficient_per_k * rise_k)
        answer = chain * mode.pick_off_v_per_m / complex(own**2 - drive**2, own * drive / quality)
        left, right = mode.left_participation, mode.right_participation
        combs = left * virtual.left_comb_n_per_v2 + right * virtual.right_comb_n_per_v2
        force = combs * path.reference_amplitude_v / virtual.mass_kg
        per_rate += answer * (left + right) * 2j * velocity * math.pi / 180
        per_volt += answer * -1j * cmath.exp(1j * virtual.carrier_phase_rad) * force
        shifted += answer * 2 * velocity * mode.quadrature_rad_s
    demodulator = 1j * cmath.exp(-1j * path.demodulator_phase_rad)
    return (demodulator * per_rate).real, (demodulator * per_volt).real, (demodulator * shifted).real
