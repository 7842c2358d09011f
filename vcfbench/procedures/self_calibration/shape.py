"""Change of the modulator's shape since the certificate, and its present curve.

Without a table the output's curve and the modulator's cannot be told apart by the data alone: both bend the output
against V_Vc. On the table the output's was measured, and it is the smaller by far. So it is taken to be what it was,
within `OUTPUT_LIMIT` of itself, and what has changed of the whole is the modulator's.
"""

import math

import numpy as np

from vcfbench.analysis.arrays import Floats
from vcfbench.analysis.chopped import polynomial_through_zero
from vcfbench.records.device_values import Characteristics

OUTPUT_CURVE = "the output's curve since the certificate"
OUTPUT_LIMIT = 0.03
"""Possible relative change of the output's curve since the table: rectangular, this program's own, no source's. It
bends by its volts, whose gain `experiments/ageing.py` ages by as much; it puts 20 ppm into the line."""
_ROUNDS = 12
_SETTLED = 1e-9


def output_orders(then: Characteristics | None) -> Floats | None:
    """Return second and third order of the output against the rate, as the table had them; None where unknown."""
    if then is None or then.output_second_per_deg_s is None or then.output_third_per_deg_s2 is None:
        return None
    return np.array([then.output_second_per_deg_s.value, then.output_third_per_deg_s2.value])


def orders_of(coefficients: Floats, v_vc_v: Floats, output_v: Floats, covariance_v2: Floats) -> tuple[Floats, Floats]:
    """Return second and third order of the output at rate 0, over its slope there, and their covariance.

    `v_vc_v` begins with that of the zero, which is taken off the outputs of the others.
    """
    rates = np.polynomial.polynomial.polyval(v_vc_v, coefficients)
    found, covariance, _ = polynomial_through_zero(rates[1:] - rates[0], output_v, covariance_v2, 3)
    first, second, third = found
    at = -rates[0]
    slope = first + 2.0 * second * at + 3.0 * third * at**2
    by = np.array([[0.0, 1.0 / slope, 3.0 * at / slope], [0.0, 0.0, 1.0 / slope]])
    return np.array([(second + 3.0 * third * at) / slope, third / slope]), by @ covariance @ by.T


def bent(coefficients: Floats, v_vc_v: Floats, output_v: Floats, covariance_v2: Floats, output: Floats) -> Floats:
    """Return the curve of K_Vc whose second and third order agree with the curve of `output`.

    By Newton's method from `coefficients`: an order of the curve changes that of the output by so much over its slope.
    """
    curve = coefficients.copy()
    for _ in range(_ROUNDS):
        orders, _ = orders_of(curve, v_vc_v, output_v, covariance_v2)
        # y = S (r + g2 r^2 + ...), r = k1 V + k2 V^2 + ...: too large a g2 is too small a k2, by k1^2 of it
        step = (orders - output) * np.array([curve[1] ** 2, curve[1] ** 3])
        curve[2:4] += step
        if (np.abs(step) <= _SETTLED * np.abs(curve[1])).all():
            break
    return curve


def has_changed(orders: Floats, covariance: Floats, output: Floats, then: Characteristics) -> bool:
    """Return True if the output's curve is another than it was: by chi-square with two degrees, one in a thousand.

    Of the modulator's orders then the certificate's curve has the uncertainty that counts.
    """
    known = then.output_second_per_deg_s, then.output_third_per_deg_s2
    variances = [0.0 if each is None else each.u**2 for each in known]
    left = orders - output
    return float(left @ np.linalg.solve(covariance + np.diag(variances), left)) > -2.0 * math.log(1e-3)
