"""Settings of the calibration of K_Vc."""

from collections.abc import Iterator
from typing import Annotated, Self

from msgspec import Meta, structs, to_builtins

from vcfbench.procedures.health.plan import AC_WANTED, HEALTH
from vcfbench.procedures.shared.known.v_vc import KnownVvcSettings
from vcfbench.procedures.shared.null_comparison.plan import invalid_match_rates
from vcfbench.station.bounds import Rate, ranged, said, several
from vcfbench.station.invalid_value import InvalidValue


class KVcSettings(KnownVvcSettings, frozen=True, kw_only=True):
    """Settings of the calibration of K_Vc, beside those of all procedures."""

    match_rates_deg_s: Annotated[
        tuple[Rate, ...], several(3, 100, "rates at which V_Vc is matched, each with both signs")
    ] = (10.0, 20.0, 50.0, 100.0, 200.0)
    match_iterations: Annotated[int, ranged(2, 100, "most settings of V_Vc that a search takes")] = 5
    curve_order: Annotated[int, ranged(3, 7, "order of the curve")] = 3
    validity_days: Annotated[float, Meta(gt=0.0, le=36_500.0, description="of the certificate, days")] = 365.0
    wanted_u95_ppm: Annotated[
        float, Meta(gt=0.0, le=1e6, description="U95 of K_Vc at which the device should come back to a table, ppm")
    ] = 500.0
    health: Annotated[bool, said(HEALTH, option=True)] = True
    ac_volts: Annotated[bool, said(AC_WANTED)] = False
    axis_tilt_deg: Annotated[float, ranged(0.0, 90.0, "of the table's axis, limit")] = 0.5

    def recalled(self) -> Self:
        """Return these settings with the device's characteristics, as earlier procedures found them."""
        settings = super().recalled()
        seen = None if self.dut is None else self.store.characteristics(self.dut)
        plain = {} if seen is None else to_builtins(seen)
        return structs.replace(settings, station=structs.replace(settings.station, characteristics=plain))

    @property
    def fastest_deg_s(self) -> float:
        return max(map(abs, self.match_rates_deg_s))

    @property
    def magnitudes_deg_s(self) -> tuple[float, ...]:
        """The rates without sign, each once, rising: the search goes on from the result at the rate before."""
        return tuple(sorted({abs(rate) for rate in self.match_rates_deg_s}))

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        yield from invalid_match_rates(self, self.match_rates_deg_s, self.curve_order)
        largest_v = self.fastest_deg_s / max(abs(self.k_vc_guess_deg_s_per_v), 1e-9)
        yield from self.beyond_range(largest_v, self.fastest_deg_s)
