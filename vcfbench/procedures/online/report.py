"""Report of a calibration by a modulation: scale factor of every window and of the run, its budget, figures."""

from vcfbench.procedures.online.results import OnlineResult, WindowFactor
from vcfbench.procedures.online.settings import OnlineSettings
from vcfbench.procedures.shared.known.certificate import drift_parts, lists_of_omissions
from vcfbench.procedures.shared.known.v_vc import known_words
from vcfbench.procedures.shared.measurand import budget_table, made_of, said_of
from vcfbench.reports.document import Axis, Column, Figure, Report, Series, Table, Text
from vcfbench.steps.measured import Measured


def online_report(settings: OnlineSettings, _measured: Measured, results: OnlineResult) -> Report:
    """Report scale factor, disturbance, the windows, and their Allan deviation."""
    disturbance = results.disturbance
    scatter = f"chi-square {results.chi_square:.1f} for {results.dof} degrees of freedom"
    sine = f"virtual rate {results.virtual_rate_deg_s:.4g} deg/s, V_Vc {results.v_vc_amplitude_v:.6g} V"
    less = f"disturbed by less than {results.disturbed_by_less_than_deg_s:.2g} deg/s (95 %)"
    noise = f"{results.noise_at_rest_deg_s:.2g} deg/s at rest, {results.noise_modulated_deg_s:.2g} modulated"
    curvature = f"{results.compression_ppm:+.0f} ppm of curvature, {results.response_ppm:+.0f} ppm of response"
    words = [
        said_of("scale factor, small signals", results.scale_factor),
        f"{len(results.windows)} windows scatter with {scatter}; {sine}",
        f"true rate under modulation less at rest: {disturbance.value:+.2g} deg/s, u {disturbance.u:.1g}: {less}",
        f"  u is made of {made_of(disturbance, '.1g')} deg/s",
        f"noise of a reading: {noise}; {100.0 * results.lost_share:.2g} % of the time is lost between bursts",
        f"taken out: {results.rectified_deg_s:+.3g} deg/s rectified, {curvature}",
        f"K_Vc from {results.k_vc_from}; V_Vc is known by the {results.v_vc_by}",
        *results.since,
        *known_words(settings),
    ]
    columns = (
        *(Column("t", "s", ".1f"), Column("scale factor", "V/(deg/s)", ".8f")),
        *(Column("u of its readings", "ppm", ".1f"), Column("u", "ppm", ".1f")),
    )
    rows = [
        (each.t_s, each.scale_factor_v_per_deg_s, _ppm(each.u_readings, each), _ppm(each.u, each))
        for each in results.windows
    ]
    parts = [
        Text("\n".join(words)),
        Table(columns, rows, "scale factor, window after window"),
        budget_table("the scale factor", results.scale_factor),
        *([] if results.drift is None else drift_parts(results.drift)),
        *_figures(results),
        *lists_of_omissions(results.holds_not, results.unseen),
    ]
    return Report(parts)


def _ppm(u: float, window: WindowFactor) -> float:
    return 1e6 * u / abs(window.scale_factor_v_per_deg_s)


def _figures(results: OnlineResult) -> list[Figure]:
    mean = results.scale_factor.value
    times = [each.t_s for each in results.windows]
    ppm = [1e6 * (each.scale_factor_v_per_deg_s / mean - 1.0) for each in results.windows]
    factors = Series("window", times, ppm, [_ppm(each.u_readings, each) for each in results.windows])
    rate = Series("burst", results.rate_t_s, results.rate_change_deg_s)
    figures = [
        Figure("Scale factor over time", Axis("time", "s"), Axis("scale factor less its mean", "ppm"), [factors]),
        Figure("True rate, modulation taken out", Axis("time", "s"), Axis("rate less that at rest", "deg/s"), [rate]),
    ]
    rows = [each for each in results.allan if each.deviation_ppm > 0.0]
    if rows:
        tau = [each.tau_s for each in rows]
        low, high = [each.low_ppm for each in rows], [each.high_ppm for each in rows]
        curve = Series("windows", tau, [each.deviation_ppm for each in rows], low=low, high=high)
        noise = Series("noise of the readings alone", tau, [each.noise_ppm for each in rows], kind="line")
        axes = Axis("averaging time", "s", "log"), Axis("Allan deviation", "ppm", "log")
        words = "The band holds the true value with 95 %."
        figures.append(Figure("Allan deviation of the scale factor", *axes, [curve, noise], words))
    return figures
