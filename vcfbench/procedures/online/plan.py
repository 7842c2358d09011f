"""Calibration while the gyroscope measures: a small sine on V_Vc, and its lock-in in the output.

The sine stands for a rate that is known by the device's K_Vc; what the output makes of it is the scale factor, window
after window. The true rate is the output with the sine taken out, and is compared with the output at rest of V_Vc
before and after. Neither a table nor an oscilloscope is needed; where there is a table it may turn meanwhile.
"""

from typing import Literal

from vcfbench import steps
from vcfbench.instructions import routines
from vcfbench.instructions.procedure import Procedure, roles
from vcfbench.instructions.v_vc import ready_v_vc_meter
from vcfbench.interfaces import FunctionGenerator, SamplesVoltage
from vcfbench.procedures.online.results import online_report, online_results
from vcfbench.procedures.online.settings import OnlineSettings


def _metered(settings: OnlineSettings, work: steps.Plan) -> steps.Plan:
    seen = yield from routines.look_at_drive(settings)
    yield from ready_v_vc_meter(settings, settings.v_vc_range_v)
    yield from work
    yield from routines.look_again(settings, seen)


@routines.framed(routines.energised, _metered, routines.held_at_rest)
def online(settings: OnlineSettings) -> steps.Plan:
    """Calibrate while the gyroscope measures: V_Vc at rest, the modulation, V_Vc at rest again."""
    table_deg_s = None if settings.station.limits.max_rate_deg_s is None else settings.rate_deg_s
    if table_deg_s:  # the table turns all the while
        yield from routines.go_to_rate(settings, table_deg_s, previous_deg_s=0.0)
    of: Literal["both", "output"] = "both" if settings.v_vc_role == "v_vc_meter" else "output"
    still, moving = (_sample(settings, peak_v, of, table_deg_s) for peak_v in (0.0, settings.amplitude_v))
    yield steps.Note("V_Vc at rest: what the true rate reads without modulation")
    yield from routines.v_vc_on(settings.settle_s)
    yield still
    yield from routines.check_rails(settings)  # no reading knows that they fell
    yield steps.Note(f"The modulation, {settings.bursts} times {settings.burst_readings * settings.aperture_s:g} s")
    yield steps.SetSine(settings.modulation_hz, settings.amplitude_v)
    yield steps.Settle(settings.settle_s, "gyro settles after the sine came on")
    for _ in range(settings.bursts):
        yield moving
        yield from routines.check_rails(settings)
    yield steps.Note("V_Vc at rest again")
    yield steps.ConfigureGenerator(0.0)
    yield steps.Settle(settings.settle_s, "gyro settles after the sine went off")
    yield still
    yield from routines.check_rails(settings)
    if settings.v_vc_role == "multimeter":
        # Have V_Vc measured by the one meter, whose leads a person moves there and back: at rest and the sine
        yield steps.Note("V_Vc by the one multimeter")
        yield steps.move_leads("multimeter", "v_vc")
        yield _sample(settings, 0.0, "v_vc", None)
        yield steps.SetSine(settings.modulation_hz, settings.amplitude_v)
        yield steps.Settle(settings.settle_s, "the generator settles")
        yield _sample(settings, settings.amplitude_v, "v_vc", None)
        yield steps.move_leads("multimeter", "output")


def _sample(
    settings: OnlineSettings, amplitude_v: float, of: Literal["both", "output", "v_vc"], table_deg_s: float | None
) -> steps.SampleModulated:
    sampled = settings.modulation_hz, amplitude_v, settings.burst_readings, settings.aperture_s
    return steps.SampleModulated(*sampled, of, table_deg_s, settings.rate_tolerance_deg_s)


ONLINE = Procedure(
    name="online",
    method=(
        "While the gyroscope measures a true rate, a sine on V_Vc adds a known virtual one. Its lock-in in the output "
        "gives the scale factor window by window; the output with the sine taken out is the true rate."
    ),
    settings=OnlineSettings,
    plan=online,
    results=online_results,
    report=online_report,
    unforeseen={"disturbance": "it is the scatter of a few records"},
    needs=roles(rate_source=FunctionGenerator, multimeter=SamplesVoltage),
    uses={**roles("power", "oscilloscope", v_vc_meter=SamplesVoltage), **roles("rate_table")},
)
