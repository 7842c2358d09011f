"""V_Vc that gives the same output as the table, at rates of both signs: null comparisons, chopped against drift.

At each rate the output is chopped, 0, +, -, -, + and 0, first on the table with the generator off, then at rest with
V_Vc on: what drifts linearly cancels in each block, what is added to the output in the difference from the block's own
zeros.
"""

import math
from collections.abc import Iterator, Mapping, Sequence

from vcfbench.analysis.chopped import CHOPPED, Block
from vcfbench.belief.agreement import require_expected_k_vc, require_expected_slope
from vcfbench.errors import MeasurementError
from vcfbench.instructions.routines import at_rates, set_v_vc, v_vc_on
from vcfbench.instructions.v_vc import take_driven
from vcfbench.records.schema import Point, pooled_std_v
from vcfbench.station.bounds import LEAST_V_VC_V
from vcfbench.station.invalid_value import InvalidValue
from vcfbench.station.settings import ProcedureSettings, rate_words
from vcfbench.steps import DisableVvc, Note, Settle
from vcfbench.steps.step import Routine

_CLOSE = 1e-3
"""Largest residual of the search, relative to the output's span; it is interpolated, with a slope good to 1e-3."""
_USABLE = 0.1
"""Largest residual of a usable null."""
_BETWEEN_RANGES = 0.4
"""What the search may have left besides, where it came to either side: a small level may lie between the ends of two
ranges of a generator, whose offsets make it a large share. The curve through all levels tells what is left."""

_NOISES = 9.0
"""Standard deviations of a mean that a null may be off besides: V_Vc was chosen by noisy means, which are compared."""


def nulled(
    settings: ProcedureSettings,
    magnitudes_deg_s: Sequence[float],
    cycles: int,
    iterations: int,
    steps: tuple[int, int, int],
) -> Routine[tuple[list[Point], list[Point], Mapping[float, float]]]:
    """Match V_Vc at each rate of both signs; return the points of all blocks, table and driven, and V_Vc by rate.

    `steps` are the numbers that points carry: the table's blocks, the search for V_Vc, of so many `iterations` at most,
    the blocks of V_Vc. Rates rise: a search goes on from the result at the rate before.
    """
    of_table, of_search, of_driven = steps
    table: list[Point] = []
    driven: list[Point] = []
    levels_v: dict[float, float] = {}
    usable: dict[float, tuple[float, float]] = {}
    for cycle in range(cycles):
        per_deg_s = 1.0 / settings.k_vc_guess_deg_s_per_v, 1.0 / settings.k_vc_guess_deg_s_per_v
        for rate_deg_s in magnitudes_deg_s:
            yield Note(f"Cycle {cycle + 1}, {rate_deg_s:g} deg/s: on the table, generator off")
            table += yield from at_rates(settings, of_table, [sign * rate_deg_s for sign in CHOPPED])
            real = block(table[-len(CHOPPED) :])
            yield Note(f"Cycle {cycle + 1}, {rate_deg_s:g} deg/s: table at rest, V_Vc on")
            yield from v_vc_on(settings.settle_s)
            if cycle == 0:
                found, usable[rate_deg_s] = yield from _search(
                    settings, rate_deg_s, real, per_deg_s, (of_search, iterations)
                )
                levels_v[rate_deg_s], levels_v[-rate_deg_s] = found
                per_deg_s = found[0] / rate_deg_s, -found[1] / rate_deg_s
            previous_v = 0.0
            for sign in CHOPPED:
                level_v = levels_v[sign * rate_deg_s] if sign else 0.0
                if level_v != previous_v:
                    previous_v = yield from set_v_vc(settings, level_v)
                taken = take_driven(settings, of_driven, rate_deg_s=sign * rate_deg_s, v_vc_v=previous_v)
                driven.append((yield from taken))
            yield from set_v_vc(settings, 0.0)
            virtual = block(driven[-len(CHOPPED) :])
            both = (*table[-len(CHOPPED) :], *driven[-len(CHOPPED) :])
            noise_v = _NOISES * pooled_std_v(both) / math.sqrt(min(each.n for each in both))
            differences = zip(virtual.differences_v, real.differences_v, usable[rate_deg_s], (1.0, -1.0), strict=True)
            for got_v, want_v, within_v, way in differences:
                if not abs(got_v - want_v) <= within_v + noise_v:
                    raise MeasurementError(
                        f"at {way * rate_deg_s:+g} deg/s the table moves the output by {want_v:+.6g} V, V_Vc by "
                        f"{got_v:+.6g}",
                        instrument="multimeter",
                        step=str(of_driven),
                        hint="check the V_Vc lead and k_vc_guess_deg_s_per_v; the two must come within "
                        f"{within_v + noise_v:.2g} V",
                    )
            yield DisableVvc()
            yield Settle(settings.settle_s, "gyro settles after the generator went off")
    return table, driven, levels_v


def block(points: Sequence[Point]) -> Block:
    """Return the mean outputs of six windows."""
    return Block(tuple(point.output_v for point in points))


def invalid_match_rates(
    settings: ProcedureSettings, rates_deg_s: Sequence[float], order: int
) -> Iterator[InvalidValue]:
    """Yield the faults of rates at which V_Vc is matched for a curve of `order`, the key `match_rates_deg_s`."""
    magnitudes = sorted({abs(rate) for rate in rates_deg_s})
    if 2 * len(magnitudes) < order + 2:
        expected = f"at least {(order + 3) // 2} different magnitudes for a curve of order {order}, -20 and 20 are one"
        yield InvalidValue("match_rates_deg_s", expected, list(rates_deg_s))
    for index, rate_deg_s in enumerate(rates_deg_s):
        yield from invalid_match(settings, f"match_rates_deg_s[{index}]", rate_deg_s)
    yield from invalid_guess(settings, magnitudes[0], magnitudes[-1], abs(settings.k_vc_guess_deg_s_per_v))


def invalid_match(settings: ProcedureSettings, key: str, rate_deg_s: float) -> Iterator[InvalidValue]:
    """Yield the fault of a rate at which V_Vc is matched, if it has one: beyond the table's, or nearly rest."""
    limit_deg_s = settings.station.limits.max_rate_deg_s
    most_deg_s = math.inf if limit_deg_s is None else limit_deg_s
    if not settings.rate_tolerance_deg_s < abs(rate_deg_s) <= most_deg_s:
        at_rest = f"above {settings.rate_tolerance_deg_s:g} deg/s (rate_tolerance_deg_s): less is at rest"
        yield InvalidValue(key, f"{rate_words(most_deg_s)}, and {at_rest}", rate_deg_s)


def invalid_guess(settings: ProcedureSettings, least: float, largest: float, guess: float) -> Iterator[InvalidValue]:
    """Yield the faults of a guess of K_Vc: V_Vc of the largest rate is beyond the limit, of the least too small."""
    key, limit_v = "k_vc_guess_deg_s_per_v", settings.station.limits.max_v_vc_v
    if limit_v is not None and abs(guess) * limit_v < largest:
        expected = f"at least {largest / limit_v:g}, so that {largest:g} deg/s needs at most {limit_v:g} V of V_Vc"
        yield InvalidValue(key, f"{expected} (limits.max_v_vc_v)", guess)
    if abs(guess) * LEAST_V_VC_V > least:
        needs = f"{least:g} deg/s needs at least {LEAST_V_VC_V:g} V, which a generator can set"
        yield InvalidValue(key, f"at most {least / LEAST_V_VC_V:g}, so that {needs}", guess)


def _search(
    settings: ProcedureSettings,
    rate_deg_s: float,
    table: Block,
    per_deg_s: tuple[float, float],
    terms: tuple[int, int],
) -> Routine[tuple[tuple[float, float], tuple[float, float]]]:
    """Return the settings of V_Vc for the outputs on the table, one for each sign, and which residual is usable, V.

    The settings are the nearest of those that were tried. Each try goes along the chord through zero, which is within
    some per cent of the tangent, so two or three are enough. Not so where a generator changes its range: levels between
    the ends of two ranges cannot be set.
    """
    wanted, (step, iterations) = table.differences_v, terms
    levels = (per_deg_s[0] * rate_deg_s, -per_deg_s[1] * rate_deg_s)
    nearest = [(math.inf, level_v) for level_v in levels]
    beyond: tuple[set[bool], set[bool]] = set(), set()
    for attempt in range(iterations):
        zero = yield from take_driven(settings, step, rate_deg_s=0.0, v_vc_v=0.0)
        seen = []
        for sign, level_v in zip((1.0, -1.0), levels, strict=True):
            set_v = yield from set_v_vc(settings, level_v)
            point = yield from take_driven(settings, step, rate_deg_s=sign * rate_deg_s, v_vc_v=set_v)
            seen.append((set_v, point.output_v - zero.output_v))
        yield from set_v_vc(settings, 0.0)
        away = [abs(got - want) for (_, got), want in zip(seen, wanted, strict=True)]
        for sides, (_, got), want in zip(beyond, seen, wanted, strict=True):
            sides.add(abs(got) > abs(want))
        nearest = [min(had, (off, now[0])) for had, off, now in zip(nearest, away, seen, strict=True)]
        noise_v = 3.0 * math.sqrt(2.0) * zero.std_v / math.sqrt(zero.n)
        close = all(off <= max(noise_v, _CLOSE * abs(want)) for off, want in zip(away, wanted, strict=True))
        if attempt > 0 and close:
            break
        levels = _chord(*seen[0], wanted[0], step), _chord(*seen[1], wanted[1], step)
    (left_plus_v, plus_v), (left_minus_v, minus_v) = nearest
    require_expected_slope((wanted[0] - wanted[1]) / (2.0 * rate_deg_s), settings.expected, step)
    require_expected_k_vc(2.0 * rate_deg_s / (plus_v - minus_v), settings.k_vc_guess_deg_s_per_v, settings.expected)
    usable = [
        _USABLE * abs(want) + (min(left_v, _BETWEEN_RANGES * abs(want)) if len(sides) > 1 else 0.0)
        for left_v, want, sides in zip((left_plus_v, left_minus_v), wanted, beyond, strict=True)
    ]
    return (plus_v, minus_v), (usable[0], usable[1])


def _chord(set_v: float, got_v: float, wanted_v: float, step: int) -> float:
    """Return the V_Vc for `wanted_v` on the line through zero and the output at `set_v`."""
    if not abs(got_v) > 0.1 * abs(wanted_v):
        raise MeasurementError(
            f"the output does not respond to V_Vc: {got_v:+.4g} V for {set_v:.6g} V, the table gives {wanted_v:+.4g} V",
            instrument="rate_source",
            step=str(step),
            hint="check the V_Vc lead, the generator's output, and k_vc_guess_deg_s_per_v",
        )
    return set_v * wanted_v / got_v
