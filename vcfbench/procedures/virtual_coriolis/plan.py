"""The virtual Coriolis calibration: the paper's four steps (section 4.2) in the order in which they can be done.

The paper prints its fourth step before its third; the turntable sweep comes first here, so that everything that needs
the table moving is behind when the V_Vc sweep starts. While the table turns the generator's output is off and the PCB
holds the V_Vc node at 0 V; while V_Vc acts the table is held at rest under servo.
"""

from collections.abc import Iterator
from functools import partial
from itertools import groupby

from vcfbench.belief import agreement
from vcfbench.belief.jumps import watched
from vcfbench.errors import MeasurementError
from vcfbench.instructions import routines
from vcfbench.instructions.procedure import Procedure, Watched, roles
from vcfbench.instructions.schedule import SEARCH, ZERO_DRIVEN, KvcBy
from vcfbench.instructions.v_vc import generator_sheet, has_v_vc_meter, ready_v_vc_meter, take_driven
from vcfbench.procedures.null_comparison.plan import nulled
from vcfbench.procedures.turntable import table_sweep
from vcfbench.procedures.virtual_coriolis import results
from vcfbench.procedures.virtual_coriolis.matching import Matching
from vcfbench.procedures.virtual_coriolis.null_matching import DRIVEN, TABLE, NullMatching, null_matching
from vcfbench.procedures.virtual_coriolis.settings import VirtualCoriolisSettings
from vcfbench.records.schema import Point
from vcfbench.station.settings import V_VC_RANGE_V
from vcfbench.steps import DisableVvc, Note, Plan, Settle
from vcfbench.steps.step import Routine


@routines.framed(routines.powered, watched)
def virtual_coriolis(settings: VirtualCoriolisSettings) -> Plan:
    """Calibrate on the rate table and by the virtual Coriolis force, and compare."""
    yield from ready_v_vc_meter(settings, V_VC_RANGE_V)
    rates: Matching | NullMatching
    if settings.k_vc_by is KvcBy.ONE_POINT:
        yield Note(f"Step 1: the table turns at {settings.match_rate_deg_s:g} deg/s, generator off")
        yield Settle(settings.settle_s, "gyro settles, table at rest")
        # The zero output and the output at the matching rate, in turn
        rates_deg_s = [settings.match_rate_deg_s if turning else 0.0 for turning in _in_turn(settings.match_windows)]
        look = partial(agreement.require_expected_column, expected=settings.expected)
        points = yield from routines.at_rates(settings, 1, rates_deg_s, look)
        yield from routines.ramp_to(settings, 0.0, previous_deg_s=rates_deg_s[-1])
        yield Note("Step 2: table at rest, generator on; V_Vc is adjusted until the output equals that of step 1")
        driven, rates = yield from _match(settings, points)
    else:
        yield Note("Steps 1 and 2: at each rate of both signs V_Vc is matched to the output on the table")
        yield Settle(settings.settle_s, "gyro settles, table at rest")
        often, steps = (settings.null_cycles, settings.match_iterations), (TABLE, SEARCH, DRIVEN)
        points, driven, _ = yield from nulled(settings, settings.magnitudes_deg_s, *often, steps)
        agreement.require_expected_column(points, settings.expected)
        rates = null_matching(settings, [*points, *driven])
        agreement.require_expected_k_vc(rates.k_vc, settings.k_vc_guess_deg_s_per_v, settings.expected)
    yield Note("Step 3: the table turns at each rate, generator off")
    yield DisableVvc()
    yield from table_sweep(settings, 3, points)
    yield Note(f"Step 4: table at rest, V_Vc stands for each rate, K_Vc = {rates.k_vc:.6g} (deg/s)/V")
    yield from _virtual_sweep(settings, rates, driven)


def _match(settings: VirtualCoriolisSettings, table: list[Point]) -> Routine[tuple[list[Point], Matching]]:
    """Step 2: the zero output with the generator on, then V_Vc by linear prediction until the outputs are equal.

    Returns the points with the generator on, the zero first, then that of the V_Vc that was found, and K_Vc.
    """
    yield from routines.v_vc_on(settings.settle_s)
    points = [(yield from take_driven(settings, 2, rate_deg_s=0.0, v_vc_v=0.0))]
    agreement.require_same_zero(table[0], points[0], table[1])
    v_vc_v = settings.match_rate_deg_s / settings.k_vc_guess_deg_s_per_v
    for number in range(settings.match_iterations):
        v_vc_v = yield from routines.set_v_vc(settings, v_vc_v)
        if number > 1 and v_vc_v in {point.v_vc_v for point in points}:  # between the ends of two ranges: nothing new
            break
        points.append((yield from take_driven(settings, 2, rate_deg_s=0.0, v_vc_v=v_vc_v)))
        matching = Matching.of([*table, *points], settings.match, settings.match_rate_deg_s)
        if number > 0 and matching.equal():  # one lucky guess proves nothing
            break
        v_vc_v = matching.next_v
    if not matching.usable():
        raise MeasurementError(
            f"the output of step 2 does not reach the output of step 1: {matching.residual_v:+.4g} V left after "
            f"{settings.match_iterations} settings of V_Vc, the best {matching.best.v_vc_v:.6g} V",
            instrument="multimeter",
            step="2",
            hint="the levels needed lie between two ranges of the generator: choose another match_rate_deg_s"
            if matching.is_between()
            else "check the V_Vc lead and k_vc_guess_deg_s_per_v of the bench file",
        )
    agreement.require_expected_k_vc(matching.k_vc, settings.k_vc_guess_deg_s_per_v, settings.expected)
    # The rest of the windows at 0 V and at the V_Vc that was found, in turn: one of each was taken on the way here
    equal_v = previous_v = matching.best.v_vc_v
    for pushed in _in_turn(settings.match_windows - 1):
        v_vc_v = equal_v if pushed else 0.0
        if v_vc_v != previous_v:
            yield from routines.set_v_vc(settings, v_vc_v)
        points.append((yield from take_driven(settings, 2, rate_deg_s=0.0, v_vc_v=v_vc_v)))
        previous_v = v_vc_v
    matching = Matching.of([*table, *points], settings.match, settings.match_rate_deg_s)
    agreement.require_expected_k_vc(matching.k_vc, settings.k_vc_guess_deg_s_per_v, settings.expected)
    return points, matching


def _in_turn(windows: int) -> Iterator[bool]:
    """Yield `windows` zeros and as many levels as zero, level, level, zero, ...: linear drift cancels, flicker nearly.

    K_Vc hangs on four means 125 mV apart, where one window of ten readings each would leave 0.06 % of noise and a
    wandering zero half as much again; the sweeps, over 5 V, need no more than one window a level.
    """
    for number in range(windows):
        second = number % 2 == 0
        yield from (not second, second)


def _virtual_sweep(
    settings: VirtualCoriolisSettings, rates: Matching | NullMatching, driven: list[Point]
) -> Routine[None]:
    """Step 4: each rate as V_Vc = rate / K_Vc; the point stands for the rate of the V_Vc that was read back.

    Before and after it the zero is taken. The slope must agree with that of step 2, `driven`.
    """
    points: list[Point] = []
    zeros: list[Point] = []
    reference = (driven[0], next(point for point in reversed(driven) if point.v_vc_v != driven[0].v_vc_v))
    limit_v = None if has_v_vc_meter(settings) else generator_sheet(settings).limit_v
    yield from routines.v_vc_on(settings.settle_s)
    if settings.visits_deg_s[0]:
        yield from routines.take_reference(settings, 4)
    for visit in settings.visits_deg_s:
        v_vc_v = yield from routines.set_v_vc(settings, 0.0 if visit is None else rates.level_for(visit))
        own, number = (points, 4) if visit is not None else (zeros, ZERO_DRIVEN)
        rate_deg_s = rates.rate_of(v_vc_v)
        own.append((yield from take_driven(settings, number, rate_deg_s=rate_deg_s, v_vc_v=v_vc_v)))
        agreement.require_steady_slope(points[-2:], reference, limit_v)
    agreement.require_steady_slope(points, reference, limit_v)
    # Take the outermost levels again that were visited in one stretch alone, and the zero where no reference began.
    # At the ends one stretch that is off looks like the modulator's next orders, or like another range of the
    # generator
    levels_v = [point.v_vc_v for point in points]
    stretches = [level_v for level_v, _ in groupby(levels_v)]
    ends_v = dict.fromkeys((max(levels_v), min(levels_v)))
    again = [level_v for level_v in ends_v if stretches.count(level_v) == 1]
    if settings.visits_deg_s[-1] and levels_v[0] not in again:
        again.append(0.0)
    for level_v in again:
        set_v = yield from routines.set_v_vc(settings, level_v)
        yield from routines.take_reference(settings, 4, set_v)


VIRTUAL_CORIOLIS = Procedure(
    name="virtual-coriolis",
    method=(
        "Step 1: the output is read at rest and at the match rate on the rate table. Step 2: the table at rest, V_Vc "
        "is adjusted until the output changes by as much; rate over V_Vc is K_Vc. Step 3: the turntable calibration. "
        "Step 4: the same rates again by V_Vc = rate / K_Vc, the table at rest. Each output is the mean of repeated "
        "readings. Least-squares lines through both columns give scale factors and biases; their comparison tells how "
        "well the virtual rate stands for a real one. Uncertainties are combined after the GUM (JCGM 100)."
    ),
    settings=VirtualCoriolisSettings,
    watched=Watched(),
    plan=virtual_coriolis,
    results=results.virtual_coriolis_results,
    report=results.virtual_coriolis_report,
    uses=roles("power", "oscilloscope", "v_vc_meter"),
)
