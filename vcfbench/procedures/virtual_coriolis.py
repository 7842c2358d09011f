"""The virtual Coriolis calibration: the paper's four steps (section 4.2) in the order in which they can be done.

The paper prints its fourth step before its third; the turntable sweep comes first here, so that everything that needs
the table moving is behind when the V_Vc sweep starts. While the table turns the generator's output is off and the PCB
holds the V_Vc node at 0 V; while V_Vc acts the table is held at rest under servo.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from vcfbench.errors import MeasurementError
from vcfbench.procedures.matching import Matching
from vcfbench.procedures.phrases import Phrase, go_to_rate, powered, ramp_to, set_v_vc, take, v_vc_on
from vcfbench.procedures.steps import DisableVvc, Note, Outcome, Plan, Settle, SetVvc
from vcfbench.procedures.turntable import table_sweep

if TYPE_CHECKING:
    from vcfbench.procedures.settings import CalibrationSettings
    from vcfbench.record.schema import Point

__all__ = ["virtual_coriolis"]


def virtual_coriolis(settings: CalibrationSettings) -> Plan:
    """Calibrate on the rate table and by the virtual Coriolis force, and compare."""
    return (yield from powered(settings, _four_steps(settings)))


def _four_steps(settings: CalibrationSettings) -> Phrase[Outcome]:
    yield Note(f"Step 1: the table turns at {settings.match_rate_deg_s:g} deg/s, generator off")
    points = yield from _table_reference(settings)
    yield Note("Step 2: table at rest, generator on; V_Vc is adjusted until the output equals that of step 1")
    matching = yield from _match(settings, points)
    yield Note("Step 3: the table turns at each rate, generator off")
    yield DisableVvc()
    yield from table_sweep(settings, 3)
    yield Note(f"Step 4: table at rest, V_Vc stands for each rate, K_Vc = {matching.k_vc:.6g} (deg/s)/V")
    yield from _virtual_sweep(settings, matching.k_vc)
    return Outcome(f"four-step calibration at {len(settings.rates_deg_s)} rates")


def _table_reference(settings: CalibrationSettings) -> Phrase[list[Point]]:
    """Step 1: the zero output and the output at the matching rate."""
    rate_deg_s = settings.match_rate_deg_s
    yield Settle(settings.settle_s, "gyro settles, table at rest")
    zero = yield from _take_repeatedly(settings, 1, rate_deg_s=0.0, v_vc_v=0.0)
    yield from go_to_rate(settings, rate_deg_s, previous_deg_s=0.0)
    turning = yield from _take_repeatedly(settings, 1, rate_deg_s=rate_deg_s, v_vc_v=0.0)
    yield from ramp_to(settings, 0.0, previous_deg_s=rate_deg_s)
    return [*zero, *turning]


def _match(settings: CalibrationSettings, points: list[Point]) -> Phrase[Matching]:
    """Step 2: the zero output with the generator on, then V_Vc by linear prediction until the outputs are equal."""
    yield from v_vc_on()
    yield Settle(settings.settle_s, "gyro settles after the generator came on")
    points += yield from _take_repeatedly(settings, 2, rate_deg_s=0.0, v_vc_v=0.0)
    v_vc_v = settings.match_rate_deg_s / settings.k_vc_guess
    for number in range(settings.match_iterations):
        v_vc_v = yield from set_v_vc(settings, v_vc_v)
        points.append((yield from take(settings, 2, rate_deg_s=0.0, v_vc_v=v_vc_v, table_deg_s=0.0)))
        matching = Matching.of(points, settings.match, settings.match_rate_deg_s)
        if number > 0 and matching.equal():  # one lucky guess proves nothing
            break
        v_vc_v = matching.v_vc_equal_v
    if not matching.usable():
        raise _no_match(matching, settings)
    points += yield from _take_repeatedly(settings, 2, rate_deg_s=0.0, v_vc_v=points[-1].v_vc_v, taken=1)
    return Matching.of(points, settings.match, settings.match_rate_deg_s)


def _no_match(matching: Matching, settings: CalibrationSettings) -> MeasurementError:
    return MeasurementError(
        f"the output does not come to that of step 1: {matching.residual_v:+.4g} V left after "
        f"{settings.match_iterations} settings of V_Vc, the best {matching.best.v_vc_v:.6g} V",
        instrument="multimeter",
        step="2",
        hint="check the V_Vc lead and k_vc_guess_deg_s_per_v of the bench file",
    )


def _take_repeatedly(
    settings: CalibrationSettings, step: int, *, rate_deg_s: float, v_vc_v: float, taken: int = 0
) -> Phrase[list[Point]]:
    """Take the windows of steps 1 and 2 one after the other, less those `taken` already.

    K_Vc hangs on four means 125 mV apart, where a window of ten readings each would leave 0.06 % of noise; the
    sweeps, over 5 V, need no more than one.
    """
    points = []
    for _ in range(settings.match_windows - taken):
        point = yield from take(settings, step, rate_deg_s=rate_deg_s, v_vc_v=v_vc_v, table_deg_s=rate_deg_s)
        points.append(point)
    return points


def _virtual_sweep(settings: CalibrationSettings, k_vc: float) -> Phrase[None]:
    """Step 4: each rate as V_Vc = rate / K_Vc; the point stands for K_Vc times the V_Vc that was read back."""
    yield from v_vc_on()
    for rate_deg_s in settings.rates_deg_s:
        v_vc_v = yield from set_v_vc(settings, rate_deg_s / k_vc)
        yield from take(settings, 4, rate_deg_s=k_vc * v_vc_v, v_vc_v=v_vc_v, table_deg_s=0.0)
    yield SetVvc(0.0)
