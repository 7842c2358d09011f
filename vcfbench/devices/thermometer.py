"""The drive's frequency as a thermometer: its coefficient, and rises of temperature by it."""

import math
from typing import TypeAlias

from vcfbench.devices.k_vc_change import ASSUMED_DRIVE_PPM_K
from vcfbench.records.device_values import Measured

Frequency: TypeAlias = tuple[float, float]
"""A frequency and its standard uncertainty, Hz."""

_LEAST_PPM_K = 1.0
"""With less, ageing and the time base of an oscilloscope (14 ppm) are more than a room's temperatures (ours)."""
_SIGMAS = 3.0


def thermometer(known: Measured | None) -> Measured | None:
    """Return the coefficient by which a drive shows its temperature, ppm/K; None where it hardly changes with it.

    Without one of the device's own it is the assumed one of its class.
    """
    per_k = known or ASSUMED_DRIVE_PPM_K
    return per_k if abs(per_k.value) > max(_LEAST_PPM_K, _SIGMAS * per_k.u) else None


def rise_by_drive(before: Frequency, after: Frequency, per_k: Measured) -> tuple[float, float]:
    """Return how much warmer a device has become, K, by the frequencies of its drive, and its standard uncertainty."""
    (before_hz, u_before_hz), (after_hz, u_after_hz) = before, after
    rise_k = 1e6 * (after_hz / before_hz - 1.0) / per_k.value
    u_ppm = 1e6 * math.hypot(u_before_hz, u_after_hz) / before_hz
    return rise_k, math.hypot(u_ppm, rise_k * per_k.u) / abs(per_k.value)
