"""Report of the procedure `phase`."""

from __future__ import annotations

from vcfbench.procedures.phase.results import CaptureSense, Phases, sense_phasor
from vcfbench.procedures.phase.settings import PhaseSettings
from vcfbench.procedures.shared.measurand import QUANTITY_COLUMNS, Measurand, quantity_row
from vcfbench.reports.document import Axis, Figure, Report, Series, Table, Text
from vcfbench.steps import SineRecords
from vcfbench.steps.measured import Measured

NOT_HELD = (
    "The uncertainties hold the scatter of the records and, against the drive signal, the skew of the oscilloscope's "
    "channels. They do not hold: probes and the resistance of the nodes, the non-linearity of the converter, the "
    "phase of the drive's own pick-off, the curvature of the filter's lag, a change of temperature. Not seen: signs, "
    "since combs, pick-offs and output stage may have either (angles are known apart from half turns); the force "
    "itself, which is no node: a delay between carrier and force is in the virtual phase, together with what unequal "
    "combs do; and the in-phase and the anti-phase mode apart."
)


def phase_report(_settings: PhaseSettings, measured: Measured, found: Phases) -> Report:
    """Report the phases, their effect on K_Vc, and the omissions of the uncertainties."""
    against_drive = {
        "carrier": found.carrier_deg,
        "sense signal of a positive rate (Coriolis)": found.coriolis_deg,
        "sense signal of a positive V_Vc (virtual)": found.virtual_deg,
        "demodulator's reference, apart from half a turn": found.demodulator_deg,
    }
    errors = {
        "carrier from the drive's velocity": found.carrier_from_velocity_deg,
        "Coriolis from the drive's velocity": found.coriolis_from_velocity_deg,
        "virtual from Coriolis": found.virtual_from_coriolis_deg,
        "demodulator from Coriolis": found.demodulator_from_coriolis_deg,
        "error of K_Vc by equal outputs": found.k_vc_error_ppm,
        "delay of the filter": found.filter_delay_ms,
    }
    met = "met" if found.target_met else "NOT met"
    drive = f"drive {found.drive_hz:.3f} Hz; {found.records} records"
    target = f"U95 of {found.target_deg:g} deg for every phase: {met}"
    by_carrier = f"{found.k_vc_ppm_per_carrier_deg:+.0f} ppm a degree of the carrier"
    by_demodulator = f"{found.k_vc_ppm_per_demodulator_deg:+.1f} ppm a degree of the demodulator"
    error = found.k_vc_error_ppm
    wrong = (
        f"{abs(error.value):.0f} ppm too {'small' if error.value < 0.0 else 'large'}, U95 {error.expanded_u:.2g} ppm"
    )
    sensitivities = {
        "k_vc_ppm_carrier_deg": found.k_vc_ppm_per_carrier_deg,
        "k_vc_ppm_demodulator_deg": found.k_vc_ppm_per_demodulator_deg,
        "scale_factor_ppm_demodulator_deg": found.scale_factor_ppm_per_demodulator_deg,
        "bias_deg_s_demodulator_deg": found.bias_deg_s_per_demodulator_deg,
    }
    known = ", ".join(f"{key} = {value:.4g}" for key, value in sensitivities.items())
    said = (
        f"{drive}; {target}\nK_Vc by equal outputs: {wrong}; it changes by {by_carrier}, {by_demodulator}\n"
        f"for [uncertainty] of the bench file: {known}\n{NOT_HELD}"
    )
    return Report(
        [
            _table("phases against the drive signal", against_drive),
            _table("what they come to, apart from half turns", errors),
            Text(said),
            *_figures(measured),
        ]
    )


def _figures(measured: Measured) -> list[Figure]:
    """Draw the sense signal of each record as a phasor: the way from minus to plus has the phase of the force."""
    seen: dict[str, list[complex]] = {"rate +": [], "rate -": [], "V_Vc +": [], "V_Vc -": []}
    for step, found in measured.found(SineRecords):
        if isinstance(step, CaptureSense) and (step.rate_deg_s or step.v_vc_v):
            what, level = ("rate", step.rate_deg_s) if step.rate_deg_s else ("V_Vc", step.v_vc_v)
            seen[f"{what} {'+' if level > 0.0 else '-'}"] += [1e3 * sense_phasor(each) for each in found.records]
    series = [Series(name, [p.real for p in found], [p.imag for p in found]) for name, found in seen.items() if found]
    axes = Axis("in phase with the drive signal", "mV"), Axis("a quarter turn ahead", "mV")
    words = "A point a record; the way from minus to plus has the phase of the force."
    return [Figure("Sense signal against the drive signal", *axes, series, words)] if series else []


def _table(title: str, quantities: dict[str, Measurand]) -> Table:
    return Table(QUANTITY_COLUMNS, [quantity_row(*each) for each in quantities.items()], title)
