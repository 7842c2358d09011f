"""Whether V_Vc brings non-linear errors of its own: rate and V_Vc at carrier level, over one range.

In print (Sensors 2022, 22, 6577): virtual Coriolis "introduces additional vibration, coupled to the sensitive end,
which results in additional nonlinear errors". Asked here is whether the way that the force takes makes such errors:
generator, modulator and output stage are straight lines, the modes and the demodulator those of the embedded
gyroscope, with unequal combs, phases that are off, quadrature and feed-through. The whole equation is
integrated cycle by cycle (tests/sim/gyro/carrier.py), no envelope, no closed form.

    python experiments/added_vibration.py
"""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from msgspec.structs import replace

from tests.sim.gyro.carrier import CarrierModel
from vcfbench.sim.gyro.design import paper_bench

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from vcfbench.sim.parameters import BenchParameters

    Floats = NDArray[np.float64]

CYCLES = 14_000
"""Four seconds: what is left of a transient is below 1e-15."""
LEVELS = np.linspace(-200.0, 200.0, 17)
"""Rates, deg/s, and by K_Vc the levels of V_Vc."""
K_VC = 150.0


class Row(NamedTuple):
    """What the filtered signal is over one range: volts over its span, ppm, of the line's largest residual and orders.

    `second` and `third` are the orders of a cubic at full scale; `harmonic` is the largest line of V_s at two to five
    times the carrier at full scale over that at the carrier, all of them by a Fourier sum over one cycle.
    """

    nonlinearity_ppm: float
    second_ppm: float
    third_ppm: float
    harmonic_ppm: float


def gyroscope(second_order_per_v: float = 0.0, third_order_per_v2: float = 0.0) -> BenchParameters:
    """Return the embedded gyroscope, feed-through added, its modulator as told, V_Vc of 1 V at 150 deg/s."""
    bench = paper_bench()
    through = replace(bench.sense_path, carrier_feedthrough=1e-5, v_vc_feedthrough=1e-3)
    bent = {"second_order_per_v": second_order_per_v, "third_order_per_v2": third_order_per_v2}
    return replace(bench, sense_path=through, virtual_path=replace(bench.virtual_path, **bent))


def swept(bench: BenchParameters, by_v_vc: float, beside_deg_s: float = 0.0) -> Row:
    """Return what levels of one kind come to: `by_v_vc` 1 is V_Vc, 0 the rate; the other stands at `beside_deg_s`."""
    model, path = CarrierModel(bench), bench.virtual_path
    means, harmonics = [], []
    for level in LEVELS:
        rate = (1.0 - by_v_vc) * level + by_v_vc * beside_deg_s
        v = (by_v_vc * level + (1.0 - by_v_vc) * beside_deg_s) / K_VC
        bent = path.offset_v + v + path.second_order_per_v * v**2 + path.third_order_per_v2 * v**3
        state = model.run(model.at_rest(), CYCLES, rate_rad_s=math.radians(rate), virtual_v=bent).state
        cycle = model.run(state, 1, rate_rad_s=math.radians(rate), virtual_v=bent)
        means.append(float(np.mean(cycle.filtered)))
        lines = np.abs(np.fft.rfft(cycle.sense))
        harmonics.append(float(lines[2:6].max() / lines[1]))
    x, y = LEVELS / LEVELS.max(), np.array(means)
    line = np.polynomial.polynomial.polyfit(x, y, 1)
    cubic = np.polynomial.polynomial.polyfit(x, y, 3)
    span = 2.0 * abs(line[1])
    residual = float(np.abs(y - np.polynomial.polynomial.polyval(x, line)).max())
    return Row(*(1e6 * each for each in (residual / span, cubic[2] / cubic[1], cubic[3] / cubic[1], max(harmonics))))


def main() -> int:
    ideal, shipped = gyroscope(), gyroscope(13e-3, 14.5e-3)
    rows = {
        "rate, V_Vc at 0": swept(ideal, 0.0),
        "V_Vc, rate at 0": swept(ideal, 1.0),
        "rate, V_Vc for 100 deg/s beside it": swept(ideal, 0.0, 100.0),
        "V_Vc, a rate of 100 deg/s beside it": swept(ideal, 1.0, 100.0),
        "V_Vc, modulator as shipped": swept(shipped, 1.0),
    }
    head = "over +-200 deg/s, ppm of span or full scale"
    print(f"{head:44} {'line':>10} {'second':>10} {'third':>10} {'harmonic':>10}")
    for name, row in rows.items():
        print(f"{name:44} " + " ".join(f"{each:10.2g}" for each in row))
    return 0


if __name__ == "__main__":
    sys.exit(main())
