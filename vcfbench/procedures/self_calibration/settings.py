"""Settings of a self-calibration."""

from collections.abc import Iterator
from typing import Annotated

from vcfbench.procedures.health.plan import AC_WANTED, HEALTH
from vcfbench.procedures.shared.known.device import KnownDeviceSettings
from vcfbench.station.bounds import Rate, said, several
from vcfbench.station.invalid_value import InvalidValue


class SelfCalibrationSettings(KnownDeviceSettings, frozen=True, kw_only=True):
    """Settings of a self-calibration, beside those of all procedures."""

    virtual_rates_deg_s: Annotated[tuple[Rate, ...], several(2, 100, "rates that V_Vc stands for, with both signs")] = (
        *(10.0, 20.0, 50.0, 100.0, 200.0),
    )
    health: Annotated[bool, said(HEALTH, option=True)] = True
    ac_volts: Annotated[bool, said(f"{AC_WANTED}, if the certificate has them so and its oscilloscope is not here")] = (
        True
    )

    @property
    def magnitudes_deg_s(self) -> tuple[float, ...]:
        """The rates without sign, each once, rising."""
        return tuple(sorted({abs(rate) for rate in self.virtual_rates_deg_s}))

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        if self.magnitudes_deg_s[0] == 0.0 or len(self.magnitudes_deg_s) < 2:
            expected = "at least two rates of different size, none of them 0"
            yield InvalidValue("virtual_rates_deg_s", expected, list(self.virtual_rates_deg_s))
