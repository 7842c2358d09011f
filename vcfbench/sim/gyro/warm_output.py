"""Output of a warm gyroscope as a closed form of its parameters: the results of a calibration without errors.

Drive at the temperature after the warm-up and on the rails, demodulated modes, feed-through, modulator and output
amplifier, after docs/theory.md. The simulation itself does not use it: it propagates the modes in time.
"""

import math
from collections.abc import Callable

from vcfbench.sim.gyro.design import Demodulated, demodulated, earth_rate_deg_s, g_rate_deg_s
from vcfbench.sim.parameters import BenchParameters


def warm_output(
    bench: BenchParameters, generator_ohm: float = 50.0, rails_v: tuple[float, float] | None = None
) -> Callable[[float, float | None], float]:
    """Return the output of the warm gyroscope, V, by rate (deg/s) and V_Vc (V); None with the generator off.

    The rate is that about its own axis, of which a table askew to it gives less.
    V_Vc is the level of the open generator behind `generator_ohm`; 0 ohm means the level at the input.
    `rails_v` are the PCB's supply, positive and negative; None means the nominal ones.
    """
    thermal, virtual, stage = bench.thermal, bench.virtual_path, bench.output_stage
    positive_v, negative_v = rails_v or (bench.supply.nominal_v, -bench.supply.nominal_v)
    if bench.supply.single:
        negative_v = -positive_v
    low_v, high_v = min(negative_v + stage.headroom_v, 0.0), max(positive_v - stage.headroom_v, 0.0)
    low_v = stage.headroom_v if bench.supply.single else low_v
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


def _demodulated(bench: BenchParameters, weaker_rail_v: float) -> Demodulated:
    """Return it at the temperature of the modes, which they take in steps of `refresh_k`."""
    loop, mode, thermal = bench.drive_loop, bench.drive_mode, bench.thermal
    warm_c = thermal.ambient_c + thermal.self_heating_k
    rise_k = math.floor(warm_c / thermal.refresh_k + 0.5) * thermal.refresh_k - thermal.reference_c
    drive = 2 * math.pi * mode.frequency_hz * (1 + mode.frequency_coefficient_per_k * rise_k)
    # The amplitude that the AGC holds: the set one on these rails, limited by the largest force
    wanted = loop.amplitude_m * (1 + loop.amplitude_supply_coefficient_per_v * (weaker_rail_v - bench.supply.nominal_v))
    quality = mode.quality * (1 + mode.quality_coefficient_per_k * rise_k)
    amplitude_m = min(wanted, loop.force_limit_n_per_v * weaker_rail_v * quality / (mode.mass_kg * drive**2))
    return demodulated(bench, rise_k, amplitude_m)
