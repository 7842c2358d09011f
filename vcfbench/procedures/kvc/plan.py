"""K_Vc as a curve: the V_Vc that gives the same output as the table, at rates of both signs; a device's certificate.

At each rate the output is chopped, 0, +, -, -, + and 0, first on the table with the generator off, then at rest with
V_Vc on: what drifts linearly cancels in each block, what is added to the output (bias, the Earth's rate along the axis,
the modulator's leakage) in the difference from the block's own zeros. Both differences are equal but for a rest of a
thousandth, so the multimeter's errors cancel too: it only compares. Rates of both signs keep the modulator's even order
out of K_Vc (one point at +10 deg/s: +0.094 %), and several rates its odd order (the paper's one point: +2 % at 200).
V_Vc is measured; the paper takes the generator's setting, which is good to 2 % and 4 mV.
"""

from functools import partial

from vcfbench.interfaces import ReadsVoltage
from vcfbench.procedures.catalogue import BUILT_IN
from vcfbench.procedures.health.by_meter import compared_amplitudes
from vcfbench.procedures.health.plan import examined
from vcfbench.procedures.kvc.results import DRIVEN, SEARCH, TABLE, certificate, k_vc_report, k_vc_results
from vcfbench.procedures.kvc.settings import KVcSettings
from vcfbench.procedures.procedure import PAPER_NEEDS, PAPER_USES, Procedure
from vcfbench.procedures.shared.known.v_vc import measured_levels, ready_meters, take_level
from vcfbench.procedures.shared.null_comparison.plan import NullTerms, nulled
from vcfbench.procedures.shared.routines import framed, powered
from vcfbench.procedures.shared.steady.watched import watched
from vcfbench.steps import Outcome, Plan, Settle


@framed(powered, watched)
def k_vc(settings: KVcSettings) -> Plan:
    """Find the V_Vc of each rate by a null comparison with the table."""
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
    yield from examined(settings, None, looked_for=settings.health)
    if settings.ac_volts:
        yield from compared_amplitudes(settings)
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
