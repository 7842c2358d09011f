"""The tables that a calibration ends with, as plain text."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Mapping, Sequence

    from vcfbench.procedures.acceptance import Acceptance
    from vcfbench.record.schema import Point

__all__ = ["columns", "summary", "verdicts"]


def columns(head: Sequence[str], rows: Iterable[Sequence[str]], align: Callable[[str, int], str] = str.rjust) -> str:
    """Return columns under their heads, a rule between; numbers to the right, `align` texts with ``str.ljust``."""
    table = [tuple(head), *(tuple(row) for row in rows)]
    widths = [max(len(row[i]) for row in table) for i in range(len(head))]
    lines = ["   ".join(map(align, row, widths)).rstrip() for row in table]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:]])


def summary(procedure: str, points: Sequence[Point], results: Mapping[str, Any]) -> str:
    """Return table, fits and comparison of a complete run; of any other only the points that were kept."""
    if not results:
        return _plain_points(points)
    if procedure == "virtual-coriolis":
        return "\n\n".join([_table_1(points), _virtual_coriolis(results)])
    if procedure == "turntable":
        return "\n\n".join([_one_column(points), _fit("turntable", results)])
    return "\n\n".join([_plain_points(points), _plain_results(results)])


def _plain_results(results: Mapping[str, Any], prefix: str = "") -> str:
    """Return the results of a procedure of one's own, a line each under their names."""
    lines = (
        _plain_results(value, f"{prefix}{name}.") if isinstance(value, dict) else f"{prefix}{name} = {value}"
        for name, value in results.items()
    )
    return "\n".join(lines)


def _plain_points(points: Sequence[Point]) -> str:
    head = ("step", "rate / (deg/s)", "V_Vc / V", "output / V", "s / V", "n")
    rows = (
        (str(p.step), f"{p.rate_deg_s:.6g}", f"{p.v_vc_v:.6g}", f"{p.output_v:.5f}", f"{p.std_v:.1e}", str(p.n))
        for p in points
    )
    return columns(head, rows)


def _one_column(points: Sequence[Point]) -> str:
    rows = ((f"{p.rate_deg_s:g}", f"{p.output_v:.5f}", f"{p.std_v:.1e}") for p in points)
    return columns(("Omega_z / (deg/s)", "output / V", "s / V"), rows)


def _table_1(points: Sequence[Point]) -> str:
    """Lay out steps 3 and 4 like the paper's Table 1, with the V_Vc that stood for each rate."""
    table = [point for point in points if point.step == 3]
    virtual = [point for point in points if point.step == 4]
    rows = (
        (f"{left.rate_deg_s:g}", f"{left.output_v:.5f}", f"{right.output_v:.5f}", f"{right.v_vc_v:.5f}")
        for left, right in zip(table, virtual, strict=True)
    )
    return columns(("Omega_z / (deg/s)", "turntable / V", "virtual Coriolis / V", "V_Vc / V"), rows)


def _virtual_coriolis(results: Mapping[str, Any]) -> str:
    k_vc, comparison = results["k_vc"], results["comparison"]
    rounded = comparison["scale_factor_error_percent_rounded"]
    as_printed = "" if rounded is None else f", {rounded:.3f} % from slopes rounded as the paper prints them"
    k_vc_line = (
        f"K_Vc = {k_vc['value']:.6g} (deg/s)/V, u {k_vc['u']:.2g}; "
        f"V_Vc at {results['match_rate_deg_s']:g} deg/s {results['v_vc10_v']:.6g} V (match: {results['match']})"
    )
    u_line = (
        f"  u from noise and resolution {results['scale_factor_error_u_percent']:.2g} %, "
        f"from scatter about the lines {results['scale_factor_error_fit_u_percent']:.2g} %"
    )
    error_line = f"scale factor error {results['scale_factor_error_percent']:.4f} %{as_printed}"
    fits = (_fit("turntable", results["turntable"]), _fit("virtual Coriolis", results["virtual"]))
    return "\n".join([k_vc_line, *fits, error_line, u_line])


def _fit(name: str, column: Mapping[str, Any]) -> str:
    scale_factor, bias, ppm = column["scale_factor"], column["bias"], column["nonlinearity_ppm"]
    return "\n".join(
        [
            f"{name}: V = {scale_factor['value']:+.8f} Omega_z {bias['value']:+.6f}",
            (
                f"  scale factor {1e3 * scale_factor['value']:.5f} mV/(deg/s), u {1e3 * scale_factor['u']:.1g}; "
                f"bias {1e3 * bias['value']:.3f} mV, u {1e3 * bias['u']:.1g}"
            ),
            (
                f"  non-linearity {_ppm(ppm['max_span'])} ppm of the span (max_span), "
                f"{_ppm(ppm['max_span_rounded'])} the paper's way (max_span_rounded), "
                f"{_ppm(ppm['max_fs'])} of full scale (max_fs)"
            ),
        ]
    )


def _ppm(value: float | None) -> str:
    return "-" if value is None else f"{value:.1f}"


def verdicts(acceptance: Acceptance) -> str:
    """Return PASS or FAIL, and below it every limit with its value."""
    rows = (
        (limit.key, _figure(limit.value), f"{limit.low:g}", f"{limit.high:g}", limit.word.upper())
        for limit in acceptance.limits
    )
    table = columns(("limit", "value", "low", "high", "verdict"), rows)
    return f"{'PASS' if acceptance.passed else 'FAIL'}\n{table}"


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.6g}"
