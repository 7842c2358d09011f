"""Settings of the virtual Coriolis calibration."""

from collections.abc import Iterator
from typing import Annotated, ClassVar

from vcfbench.instructions.schedule import KvcBy, SweepSettings
from vcfbench.instructions.v_vc import has_v_vc_meter
from vcfbench.procedures.null_comparison.plan import invalid_guess, invalid_match, invalid_match_rates
from vcfbench.station.bounds import Rate, ranged, said, several
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.settings import Match


class VirtualCoriolisSettings(SweepSettings, frozen=True, kw_only=True):
    """Settings of the virtual Coriolis calibration, in addition to those of all procedures."""

    match: Annotated[
        Match,
        said("step 2 compares outputs less their own zeros, or as they are (the paper)", option=True),
    ] = Match.ZERO
    match_rate_deg_s: Annotated[Rate, said("rate at which K_Vc is found")] = 10.0
    match_iterations: Annotated[int, ranged(2, 100, "most settings of V_Vc that step 2 may take")] = 4
    match_windows: Annotated[int, ranged(1, 1000, "windows of each mean that determines K_Vc")] = 4
    k_vc_by: Annotated[
        KvcBy, said("K_Vc by one match, half the difference at both signs, or a curve", option="--kvc")
    ] = KvcBy.ONE_POINT
    match_rates_deg_s: Annotated[
        tuple[Rate, ...], several(3, 100, "rates at which a curve is matched, each with both signs")
    ] = (10.0, 20.0, 50.0, 100.0, 200.0)

    table_step: ClassVar[int] = 3

    @property
    def as_in_the_paper(self) -> bool:
        """True if rates are visited, and K_Vc is found, as the paper does it."""
        return super().as_in_the_paper and self.k_vc_by is KvcBy.ONE_POINT

    @property
    def magnitudes_deg_s(self) -> tuple[float, ...]:
        """The rates at which V_Vc is matched, without sign, rising."""
        rates = self.match_rates_deg_s if self.k_vc_by is KvcBy.CURVE else (self.match_rate_deg_s,)
        return tuple(sorted({abs(rate) for rate in rates}))

    @property
    def unforeseen(self) -> dict[str, str]:
        if self.k_vc_by is not KvcBy.CURVE or has_v_vc_meter(self):
            return {}
        why = "it goes with how near to a match the generator's levels come where its ranges end"
        return dict.fromkeys(("virtual.scale_factor", "scale_factor_error_percent"), why)

    @property
    def null_cycles(self) -> int:
        """Number of null comparisons: each has two windows of a level."""
        return max(1, self.match_windows // 2)

    @property
    def fastest_deg_s(self) -> float:
        return max(super().fastest_deg_s, *self.magnitudes_deg_s)

    def contradictions(self) -> Iterator[InvalidValue]:
        yield from super().contradictions()
        largest = max(map(abs, self.rates_deg_s))
        yield from invalid_match(self, "match_rate_deg_s", self.match_rate_deg_s)
        yield from invalid_guess(self, abs(self.match_rate_deg_s), largest, self.k_vc_guess_deg_s_per_v)
        if self.k_vc_by is not KvcBy.ONE_POINT and self.match is Match.ABSOLUTE:
            yield InvalidValue("match", f"zero, by which {self.k_vc_by.value} compares", "absolute")
        if self.k_vc_by is KvcBy.CURVE:
            yield from invalid_match_rates(self, self.match_rates_deg_s, 3)
            if self.magnitudes_deg_s[-1] < largest:
                expected = f"at least one of {largest:g} deg/s or more: a curve holds only within its rates"
                yield InvalidValue("match_rates_deg_s", expected, list(self.match_rates_deg_s))
