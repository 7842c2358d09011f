"""K_Vc as a curve: the V_Vc that gives the same output as the table, at rates of both signs; a device's certificate.

At each rate the output is chopped, 0, +, -, -, + and 0, first on the table with the generator off, then at rest with
V_Vc on: what drifts linearly cancels in each block, what is added to the output (bias, the Earth's rate along the axis,
the modulator's leakage) in the difference from the block's own zeros. Both differences are equal but for a rest of a
thousandth, so the multimeter's errors cancel too: it only compares. Rates of both signs keep the modulator's even order
out of K_Vc (one point at +10 deg/s: +0.094 %), and several rates its odd order (the paper's one point: +2 % at 200).
V_Vc is measured; the paper takes the generator's setting, which is good to 2 % and 4 mV.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Annotated

from msgspec import Meta

from vcfbench.bench.bounds import Rate  # noqa: TC001 - msgspec reads it
from vcfbench.interfaces import ReadsVoltage
from vcfbench.plans.steps import Note, Outcome, Plan, Settle
from vcfbench.procedures.catalogue import BUILT_IN
from vcfbench.procedures.known.v_vc import KnownVvcSettings, measured_levels, ready_meters, take_level
from vcfbench.procedures.kvc.results import DRIVEN, SEARCH, TABLE, certificate, k_vc_report, k_vc_results
from vcfbench.procedures.null_comparison.plan import NullTerms, invalid_match_rates, nulled
from vcfbench.procedures.procedure import PAPER_NEEDS, PAPER_USES, Procedure
from vcfbench.procedures.routines import powered, v_vc_on

if TYPE_CHECKING:
    from collections.abc import Iterator

    from vcfbench.bench.invalid_value import InvalidValue
    from vcfbench.plans.step import Routine

__all__ = ["K_VC", "KVcSettings", "k_vc"]


class KVcSettings(KnownVvcSettings, frozen=True, kw_only=True):
    """What the calibration of K_Vc is told beside what all procedures are."""

    match_rates_deg_s: Annotated[
        tuple[Rate, ...],
        Meta(min_length=3, max_length=100, description="rates at which V_Vc is matched, each with both signs"),
    ] = (10.0, 20.0, 50.0, 100.0, 200.0)
    match_iterations: Annotated[int, Meta(ge=2, le=100, description="most settings of V_Vc that a search takes")] = 5
    curve_order: Annotated[int, Meta(ge=3, le=7, description="order of the curve")] = 3
    table_accuracy_ppm: Annotated[
        float, Meta(ge=0.0, le=1e5, description="of the table's mean rate, limits, ppm of it")
    ] = 10.0
    validity_days: Annotated[float, Meta(gt=0.0, le=36_500.0, description="of the certificate, days")] = 365.0
    axis_tilt_deg: Annotated[float, Meta(ge=0.0, le=90.0, description="of the table's axis, limit")] = 0.5

    @property
    def fastest_deg_s(self) -> float:
        """The fastest that the table is asked to turn, deg/s, either way."""
        return max(map(abs, self.match_rates_deg_s))

    @property
    def magnitudes_deg_s(self) -> tuple[float, ...]:
        """The rates without sign, each once, rising: the search goes on from what the rate before found."""
        return tuple(sorted({abs(rate) for rate in self.match_rates_deg_s}))

    def contradictions(self) -> Iterator[InvalidValue]:
        """Yield what the ranges cannot say; every rate must have a V_Vc within the limits."""
        yield from super().contradictions()
        yield from invalid_match_rates(self, self.match_rates_deg_s, self.curve_order)
        largest_v = self.fastest_deg_s / max(abs(self.k_vc_guess_deg_s_per_v), 1e-9)
        yield from self.beyond_range(largest_v, self.fastest_deg_s)


def k_vc(settings: KVcSettings) -> Plan:
    """Find the V_Vc of each rate by a null comparison with the table."""
    return (yield from powered(settings, _matched(settings)))


def _matched(settings: KVcSettings) -> Routine[Outcome]:
    yield from ready_meters(settings)
    yield Settle(settings.settle_s, "gyro settles, table at rest")
    found = yield from nulled(
        settings,
        NullTerms(
            magnitudes_deg_s=settings.magnitudes_deg_s,
            cycles=settings.cycles,
            iterations=settings.match_iterations,
            take=partial(take_level, settings, table_deg_s=0.0),
            table=TABLE,
            search=SEARCH,
            driven=DRIVEN,
        ),
    )
    if settings.v_vc_role == "multimeter":
        yield Note("V_Vc by the one multimeter, at every level that was used")
        yield from v_vc_on()
        yield from measured_levels(settings, (0.0, *found.levels_v.values()))
    return Outcome(f"V_Vc matched at {2 * len(settings.magnitudes_deg_s)} rates, {settings.cycles} times")


K_VC = Procedure(
    name="kvc",
    title=BUILT_IN["kvc"][1],
    method=(
        "The table turns the gyroscope at rates of both signs; at each, V_Vc is adjusted with the table at rest until "
        "the output, less its zero, is the same (a null comparison), and V_Vc is measured. Rate over V_Vc, as a curve "
        "with its uncertainty, is the certificate of the device."
    ),
    settings=KVcSettings,
    plan=k_vc,
    results=k_vc_results,
    report=k_vc_report,
    entry=certificate,
    needs=PAPER_NEEDS,
    uses={**PAPER_USES, "v_vc_meter": ReadsVoltage},
)
"""The calibration of K_Vc."""
