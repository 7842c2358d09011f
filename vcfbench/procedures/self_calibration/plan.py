"""Recalibration without a table: scale factor, bias and non-linearity of a gyroscope from V_Vc alone, by its K_Vc.

What a rate table once told of the device, the curve of K_Vc with its covariance, turns V_Vc into rates. The output is
chopped at each level, 0, +, -, -, + and 0, the bias taken with the generator off. Neither table nor oscilloscope is
needed: supply, generator, a multimeter, and where there is one a second on V_Vc.
"""

from vcfbench.analysis.chopped import CHOPPED
from vcfbench.belief.jumps import watched
from vcfbench.devices.device import level_for
from vcfbench.instructions.procedure import Procedure, Watched, roles
from vcfbench.instructions.routines import drive_seen, energised, framed, set_v_vc, take, v_vc_on
from vcfbench.instructions.v_vc import measured_levels, ready_v_vc_meter, take_driven
from vcfbench.procedures.health.plan import examined
from vcfbench.procedures.self_calibration import results
from vcfbench.procedures.self_calibration.results import SelfCalibrationSettings
from vcfbench.steps import DisableVvc, Note, Plan, Settle
from vcfbench.steps.step import Routine


@framed(energised, drive_seen, watched)
def self_calibration(settings: SelfCalibrationSettings) -> Plan:
    """Calibrate by V_Vc alone."""
    yield from ready_v_vc_meter(settings, settings.v_vc_range_v)
    curve, levels_v = settings.known.k_vc, {0.0: 0.0}
    for rate_deg_s in settings.magnitudes_deg_s:
        levels_v |= {signed: level_for(curve, signed, settings.rates_key) for signed in (rate_deg_s, -rate_deg_s)}
    for cycle in range(settings.cycles):
        for rate_deg_s in settings.magnitudes_deg_s:
            yield Note(f"Cycle {cycle + 1}, {rate_deg_s:g} deg/s: generator off, then V_Vc")
            yield from _at_rest(settings)
            yield from v_vc_on(settings.settle_s)
            previous_v = 0.0
            for signed in (sign * rate_deg_s for sign in CHOPPED):
                level_v = levels_v[signed]
                if level_v != previous_v:  # from then on the level is that which was read back
                    levels_v[signed] = level_v = yield from set_v_vc(settings, level_v)
                yield from take_driven(settings, results.DRIVEN, rate_deg_s=signed, v_vc_v=level_v, table_deg_s=None)
                previous_v = level_v
            yield DisableVvc()
    yield from _at_rest(settings)
    known = settings.known
    asked = {"looked_for": settings.health, "exchange": settings.exchange}
    yield from examined(settings, known.characteristics, **asked, source=known.source)
    yield from measured_levels(settings, levels_v.values())


def _at_rest(settings: SelfCalibrationSettings) -> Routine[None]:
    yield Settle(settings.settle_s, "gyro settles, generator off")
    yield from take(settings, results.AT_REST, rate_deg_s=0.0, v_vc_v=0.0)


SELF_CALIBRATION = Procedure(
    name="self-calibration",
    method=(
        "Without a rate table: V_Vc is set to levels that stand, by the certificate of the device, for known rates, "
        "and the output is read at each, and with the generator off, which is the bias. The slope at rate 0 of a cubic "
        "through the outputs is the scale factor of small signals, a least-squares line gives that of all levels and "
        "the non-linearity. The scale factor is compared with the device's certificate and last entry."
    ),
    settings=SelfCalibrationSettings,
    watched=Watched(),
    plan=self_calibration,
    results=results.self_calibration_results,
    report=results.self_calibration_report,
    entry=results.entry_of,
    needs=roles("rate_source", "multimeter"),
    uses=roles("power", "oscilloscope", "v_vc_meter"),
)
