"""The lab's own procedure: the zero-rate output with the table at rest, and how far two table rates agree with it.

It takes an open bench and knows nothing of simulation. Errors of the bench are not caught: the bench makes itself safe.
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import fmean
from typing import TYPE_CHECKING

from vcfbench.clock import sleep

if TYPE_CHECKING:
    from vcfbench.bench.bench import Bench

SETTLE_S = 2.0
READINGS = 5


@dataclass(frozen=True)
class ZeroRate:
    """Output at rest (V), and scale factor from the two rates (V/(deg/s))."""

    bias_v: float
    scale_factor_v_per_deg_s: float


def zero_rate(bench: Bench, rate_deg_s: float = 50.0) -> ZeroRate:
    """Switch the gyroscope on, read its output at rest and at plus and minus `rate_deg_s`."""
    _switch_on(bench)
    outputs_v = {rate: _output_v(bench, rate) for rate in (0.0, rate_deg_s, -rate_deg_s)}
    bench.rate_table.set_rate(0.0, bench.description.procedure.acceleration_deg_s2)
    slope = (outputs_v[rate_deg_s] - outputs_v[-rate_deg_s]) / (2.0 * rate_deg_s)
    return ZeroRate(outputs_v[0.0], slope)


def _switch_on(bench: Bench) -> None:
    settings, rails = bench.description.procedure, bench.description.wiring.rails
    bench.power.configure_output(rails.positive, settings.positive_rail_v, settings.rail_current_limit_a)
    bench.power.configure_output(rails.negative, settings.negative_rail_v, settings.rail_current_limit_a)
    bench.power.enable_outputs()
    bench.multimeter.configure_dc_voltage(settings.meter_range_v, settings.nplc)
    sleep(bench.clock, settings.drive.start_up_s)
    bench.rate_table.enable()


def _output_v(bench: Bench, rate_deg_s: float) -> float:
    bench.rate_table.set_rate(rate_deg_s, bench.description.procedure.acceleration_deg_s2)
    while not bench.rate_table.at_rate():
        sleep(bench.clock, 0.1)
    sleep(bench.clock, SETTLE_S)
    return fmean(bench.multimeter.read_voltage_v() for _ in range(READINGS))
