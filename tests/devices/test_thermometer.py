"""The drive's frequency as a thermometer: only where it changes with temperature."""

from __future__ import annotations

import pytest

from vcfbench.devices.k_vc_change import ASSUMED_DRIVE_PPM_K
from vcfbench.devices.thermometer import rise_by_drive, thermometer
from vcfbench.records.device_values import Measured


@pytest.mark.parametrize(("ppm_k", "u"), [(1.8e-11, 2.7e-12), (-0.3, 0.01), (0.0, 0.0), (4.0, 1.5), (-20.0, 9.0)])
def test_drive_that_hardly_changes_is_no_thermometer(ppm_k: float, u: float) -> None:
    assert thermometer(Measured(value=ppm_k, u=u)) is None


def test_a_drive_without_own_coefficient_has_its_class() -> None:
    assert thermometer(None) is ASSUMED_DRIVE_PPM_K
    own = Measured(value=25.0, u=0.5)
    assert thermometer(own) is own


@pytest.mark.parametrize("ppm_k", [-30.0, 20.0])
def test_rise_and_u_are_those_of_the_quotient(ppm_k: float) -> None:
    """Of 5 K: 1 ppm of either frequency, and 2 % of the coefficient."""
    after_hz = 12000.0 * (1.0 + 5e-6 * ppm_k)
    rise_k, u_k = rise_by_drive((12000.0, 0.012), (after_hz, 0.012), Measured(value=ppm_k, u=0.02 * abs(ppm_k)))
    assert rise_k == pytest.approx(5.0)
    assert u_k == pytest.approx((2.0 / ppm_k**2 + 0.1**2) ** 0.5)
