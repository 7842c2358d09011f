"""Where a certificate's K_Vc is known, by temperature."""

from __future__ import annotations

import pytest

from vcfbench.devices.k_vc_change import require_characterised
from vcfbench.errors import ConfigError
from vcfbench.records.device_values import Characteristics, Measured

AT_20 = Characteristics(temperature_c=Measured(value=20.0, u=0.1))
AS_FAR = Characteristics(temperature_c=Measured(value=20.0, u=0.1), least_temperature_c=-10.0, most_temperature_c=60.0)


@pytest.mark.parametrize(("seen", "low_c", "high_c"), [(AT_20, 0.0, 40.0), (AS_FAR, -10.0, 60.0)])
def test_k_vc_is_known_within_its_temperatures_alone(seen: Characteristics, low_c: float, high_c: float) -> None:
    for now_c in (low_c, 20.0, high_c, None):
        require_characterised(seen, now_c)
    for now_c in (low_c - 0.1, high_c + 0.1):
        with pytest.raises(ConfigError, match=f"K_Vc is known from {low_c:g} to {high_c:g} degC"):
            require_characterised(seen, now_c)
