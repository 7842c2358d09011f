"""K_Vc as a curve: the V_Vc that gives the same output as the table, at rates of both signs; a device's certificate.

At each rate the output is chopped, 0, +, -, -, + and 0, first on the table with the generator off, then at rest with
V_Vc on: what drifts linearly cancels in each block, what is added to the output (bias, the Earth's rate along the axis,
the modulator's leakage) in the difference from the block's own zeros. Both differences are equal but for a rest of a
thousandth, so the multimeter's errors cancel too: it only compares. Rates of both signs keep the modulator's even order
out of K_Vc (one point at +10 deg/s: +0.094 %), and several rates its odd order (the paper's one point: +2 % at 200).
V_Vc is measured; the paper takes the generator's setting, which is good to 2 % and 4 mV.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Annotated

from msgspec import Meta

from vcfbench.analysis.chopped import CHOPPED
from vcfbench.bench.bounds import LEAST_V_VC_V, Rate
from vcfbench.bench.misfit import Misfit
from vcfbench.bench.settings import rate_words
from vcfbench.errors import MeasurementError
from vcfbench.interfaces import ReadsVoltage
from vcfbench.procedures.agreement import MATCH_DRIFT, require_agreement, require_expected_k_vc
from vcfbench.procedures.catalogue import BUILT_IN
from vcfbench.procedures.k_vc_results import DRIVEN, SEARCH, TABLE, block, certificate, k_vc_report, k_vc_results
from vcfbench.procedures.known_v_vc import KnownVvcSettings, measured_levels, ready_meters, take_level
from vcfbench.procedures.procedure import PAPER_NEEDS, PAPER_USES, Procedure
from vcfbench.procedures.routines import go_to_rate, powered, set_v_vc, take, v_vc_on
from vcfbench.procedures.steps import DisableVvc, Note, Outcome, Plan, Settle

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

    from vcfbench.analysis.chopped import Block
    from vcfbench.procedures.step import Routine
    from vcfbench.record.schema import Point

__all__ = ["K_VC", "KVcSettings", "k_vc"]

_CLOSE = 1e-3
"""What the search may leave of the output's span; the rest is interpolated, with a slope good to some parts in 1000."""
_USABLE = 0.1
"""What is left in a block beyond that is no null: more than the ends of two ranges of a generator are apart."""


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

    def contradictions(self) -> Iterator[Misfit]:
        """Yield what the ranges cannot say; every rate must have a V_Vc within the limits."""
        yield from super().contradictions()
        limits, guess, magnitudes = self.station.limits, abs(self.k_vc_guess_deg_s_per_v), self.magnitudes_deg_s
        if 2 * len(magnitudes) < self.curve_order + 2:
            expected = f"at least {self.curve_order // 2 + 1} different rates for a curve of order {self.curve_order}"
            yield Misfit("match_rates_deg_s", expected, list(self.match_rates_deg_s))
        most_deg_s = math.inf if limits.max_rate_deg_s is None else limits.max_rate_deg_s
        for index, rate_deg_s in enumerate(self.match_rates_deg_s):
            if not self.rate_tolerance_deg_s < abs(rate_deg_s) <= most_deg_s:
                at_rest = f"above {self.rate_tolerance_deg_s:g} deg/s (rate_tolerance_deg_s): less is at rest"
                yield Misfit(f"match_rates_deg_s[{index}]", f"{rate_words(most_deg_s)}, and {at_rest}", rate_deg_s)
        largest, least = magnitudes[-1], magnitudes[0]
        if limits.max_v_vc_v is not None and guess * limits.max_v_vc_v < largest:
            expected = f"at least {largest / limits.max_v_vc_v:g}, so that {largest:g} deg/s needs at most "
            yield Misfit(
                "k_vc_guess_deg_s_per_v", f"{expected}{limits.max_v_vc_v:g} V of V_Vc (limits.max_v_vc_v)", guess
            )
        if guess * LEAST_V_VC_V > least:
            needs = f"{least:g} deg/s needs at least {LEAST_V_VC_V:g} V, which a generator can set"
            yield Misfit("k_vc_guess_deg_s_per_v", f"at most {least / LEAST_V_VC_V:g}, so that {needs}", guess)


def k_vc(settings: KVcSettings) -> Plan:
    """Find the V_Vc of each rate by a null comparison with the table."""
    return (yield from powered(settings, _matched(settings)))


def _matched(settings: KVcSettings) -> Routine[Outcome]:
    yield from ready_meters(settings)
    yield Settle(settings.settle_s, "gyro settles, table at rest")
    levels_v: dict[float, float] = {}
    for cycle in range(settings.cycles):
        per_deg_s = 1.0 / settings.k_vc_guess_deg_s_per_v, 1.0 / settings.k_vc_guess_deg_s_per_v
        for rate_deg_s in settings.magnitudes_deg_s:
            yield Note(f"Cycle {cycle + 1}, {rate_deg_s:g} deg/s: on the table, generator off")
            table = yield from _table_block(settings, rate_deg_s)
            yield Note(f"Cycle {cycle + 1}, {rate_deg_s:g} deg/s: table at rest, V_Vc on")
            yield from v_vc_on()
            yield Settle(settings.settle_s, "gyro settles after the generator came on")
            if cycle == 0:
                found = yield from _search(settings, rate_deg_s, table, per_deg_s)
                levels_v[rate_deg_s], levels_v[-rate_deg_s] = found
                per_deg_s = found[0] / rate_deg_s, -found[1] / rate_deg_s
            yield from _driven_block(settings, rate_deg_s, levels_v, table)
            yield DisableVvc()
            yield Settle(settings.settle_s, "gyro settles after the generator went off")
    if settings.v_vc_role == "multimeter":
        yield Note("V_Vc by the one multimeter, at every level that was used")
        yield from v_vc_on()
        yield from measured_levels(settings, (0.0, *levels_v.values()))
    return Outcome(f"V_Vc matched at {2 * len(settings.magnitudes_deg_s)} rates, {settings.cycles} times")


def _table_block(settings: KVcSettings, rate_deg_s: float) -> Routine[Block]:
    """Take a chopped block on the table."""
    points: list[Point] = []
    previous_deg_s = 0.0
    for sign in CHOPPED:
        now_deg_s = sign * rate_deg_s
        if now_deg_s != previous_deg_s:
            yield from go_to_rate(settings, now_deg_s, previous_deg_s=previous_deg_s)
        points.append((yield from take(settings, TABLE, rate_deg_s=now_deg_s, v_vc_v=0.0, table_deg_s=now_deg_s)))
        previous_deg_s = now_deg_s
        _require_same(points, settings)
    return block(points)


def _driven_block(
    settings: KVcSettings, rate_deg_s: float, levels_v: Mapping[float, float], table: Block
) -> Routine[None]:
    """Take a chopped block at rest with V_Vc on; what it gives must be what the table gave."""
    points: list[Point] = []
    previous_v = 0.0
    for sign in CHOPPED:
        level_v = levels_v[sign * rate_deg_s] if sign else 0.0
        if level_v != previous_v:
            level_v = yield from set_v_vc(settings, level_v)
        points.append((yield from _take(settings, DRIVEN, sign * rate_deg_s, level_v)))
        previous_v = level_v
        _require_same(points, settings)
    yield from set_v_vc(settings, 0.0)
    _require_null(block(points).differences_v, table.differences_v, rate_deg_s)


def _require_same(points: list[Point], settings: KVcSettings) -> None:
    if len(points) > 1:
        require_agreement(points, settings, MATCH_DRIFT)


def _require_null(driven_v: tuple[float, float], table_v: tuple[float, float], rate_deg_s: float) -> None:
    for virtual, real, sign in zip(driven_v, table_v, (1.0, -1.0), strict=True):
        if not abs(virtual - real) <= _USABLE * abs(real):
            raise MeasurementError(
                f"at {sign * rate_deg_s:+g} deg/s the table moves the output by {real:+.6g} V, V_Vc by {virtual:+.6g}",
                instrument="multimeter",
                step=str(DRIVEN),
                hint="check the V_Vc lead and k_vc_guess_deg_s_per_v; the two must come within 10 %",
            )


def _take(settings: KVcSettings, step: int, rate_deg_s: float, v_vc_v: float) -> Routine[Point]:
    return (yield from take_level(settings, step, rate_deg_s=rate_deg_s, v_vc_v=v_vc_v, table_deg_s=0.0))


def _search(
    settings: KVcSettings, rate_deg_s: float, table: Block, per_deg_s: tuple[float, float]
) -> Routine[tuple[float, float]]:
    """Return the settings of V_Vc that give what the table gave, one for each sign, nearest of those that were tried.

    Each try goes along the chord through zero, which is within some per cent of the tangent, so two or three are
    enough. Not so where a generator changes its range: levels between the ends of two ranges cannot be set.
    """
    wanted = table.differences_v
    levels = (per_deg_s[0] * rate_deg_s, -per_deg_s[1] * rate_deg_s)
    nearest = [(math.inf, level_v) for level_v in levels]
    for attempt in range(settings.match_iterations):
        zero = yield from _take(settings, SEARCH, 0.0, 0.0)
        seen = []
        for sign, level_v in zip((1.0, -1.0), levels, strict=True):
            set_v = yield from set_v_vc(settings, level_v)
            point = yield from _take(settings, SEARCH, sign * rate_deg_s, set_v)
            seen.append((set_v, point.output_v - zero.output_v))
        yield from set_v_vc(settings, 0.0)
        away = [abs(got - want) for (_, got), want in zip(seen, wanted, strict=True)]
        nearest = [min(had, (off, now[0])) for had, off, now in zip(nearest, away, seen, strict=True)]
        noise_v = 3.0 * math.sqrt(2.0) * zero.std_v / math.sqrt(zero.n)
        close = all(off <= max(noise_v, _CLOSE * abs(want)) for off, want in zip(away, wanted, strict=True))
        if attempt > 0 and close:
            break
        levels = (_chord(*seen[0], wanted[0]), _chord(*seen[1], wanted[1]))
    plus_v, minus_v = (level_v for _, level_v in nearest)
    require_expected_k_vc(2.0 * rate_deg_s / (plus_v - minus_v), settings.k_vc_guess_deg_s_per_v, settings.expected)
    return plus_v, minus_v


def _chord(set_v: float, got_v: float, wanted_v: float) -> float:
    """Return the V_Vc for `wanted_v` on the line through zero and what `set_v` gave.

    Raises:
        MeasurementError: the output does not answer to V_Vc.
    """
    if not abs(got_v) > 0.1 * abs(wanted_v):
        raise MeasurementError(
            f"the output does not answer to V_Vc: {got_v:+.4g} V for {set_v:.6g} V, the table gives {wanted_v:+.4g} V",
            instrument="rate_source",
            step=str(SEARCH),
            hint="check the V_Vc lead, the generator's output, and k_vc_guess_deg_s_per_v",
        )
    return set_v * wanted_v / got_v


K_VC = Procedure(
    name="kvc",
    title=BUILT_IN["kvc"][1],
    settings=KVcSettings,
    plan=k_vc,
    results=k_vc_results,
    report=k_vc_report,
    entry=certificate,
    needs=PAPER_NEEDS,
    uses={**PAPER_USES, "v_vc_meter": ReadsVoltage},
)
"""The calibration of K_Vc."""
