"""Common results of the columns of table and virtual Coriolis force: noise, line, accepted values."""

import math
from collections.abc import Sequence
from types import MappingProxyType
from typing import TypeGuard

from msgspec.structs import replace

from vcfbench.analysis.column import CalibrationColumn, Quantity
from vcfbench.analysis.scale_factor import ScaleFactorResult, characterise
from vcfbench.procedures.shared.budget.statement import Statement
from vcfbench.procedures.shared.sweep.schedule import SweepSettings
from vcfbench.records.schema import Point, pooled_std_v
from vcfbench.station.settings import ProcedureSettings


def acceptance_values(column: CalibrationColumn) -> dict[str, float | None]:
    """Return the values of a column that ``[acceptance]`` limits, by its keys."""
    scale_factor, bias_v = column.scale_factor.value, column.bias.value
    return {
        "scale_factor_v_per_deg_s": scale_factor,
        "bias_v": bias_v,
        "bias_deg_s": bias_v / scale_factor if scale_factor else None,
        "nonlinearity_ppm": column.nonlinearity_ppm.max_span,
    }


_STATED = MappingProxyType(
    {
        "scale_factor": "scale_factor_v_per_deg_s",
        "bias": "bias_v",
        "bias_deg_s": "bias_deg_s",
        "k_vc": "k_vc_deg_s_per_v",
        "scale_factor_error_percent": "scale_factor_error_percent",
    }
)
"""The keys of ``[acceptance]`` by the names of stated values, those of the table's column without its name."""


def acceptance_u95(statement: Statement | None) -> dict[str, float]:
    """Return the expanded uncertainties of the values that ``[acceptance]`` limits, by its keys."""
    stated = () if statement is None else statement.values
    named = {each.name.removeprefix("turntable."): each.u95 for each in stated}
    return {_STATED[name]: u95 for name, u95 in named.items() if name in _STATED}


def with_statement(column: CalibrationColumn, statement: Statement | None, before: str = "") -> CalibrationColumn:
    """Return a column with the combined uncertainties that are stated of it under names that begin with `before`."""
    return replace(
        column,
        scale_factor=combined(column.scale_factor, statement, f"{before}scale_factor"),
        bias=combined(column.bias, statement, f"{before}bias"),
    )


def combined(of_fit: Quantity, statement: Statement | None, name: str) -> Quantity:
    """Return a value with the combined uncertainty that is stated of it, if any is."""
    if statement is None:
        return replace(of_fit, complete=False, missing=("combined uncertainty",))
    stated = statement.value(name)
    return replace(of_fit, u=stated.u, complete=stated.complete, missing=stated.missing)


def is_swept(settings: ProcedureSettings) -> TypeGuard[SweepSettings]:
    """Tell whether the rates are visited otherwise than the paper does."""
    return isinstance(settings, SweepSettings) and not settings.as_in_the_paper


def u_output_v(points: Sequence[Point], meter_resolution_v: float) -> float:
    """Return the standard uncertainty of one window's mean, V: pooled type A, the meter's resolution as type B.

    The resolution is rectangular, a/sqrt(12), and taken to be common to the readings of a window: without enough noise
    to dither it, averaging does not make it smaller. The meter's gain and the table's rate are common to all points and
    belong to a budget.
    """
    type_a_v = noise_std_v(points) / math.sqrt(min(point.n for point in points))
    return math.hypot(type_a_v, u_resolution_v(meter_resolution_v))


def noise_std_v(points: Sequence[Point]) -> float:
    """Return the standard deviation of one reading, V, that the means of windows scatter by.

    Where windows were taken again it is their scatter, since that holds the flicker that readings within a window do
    not see; it is never less than the readings' own.
    """
    return max(pooled_std_v(points), repeat_std_v(points) * math.sqrt(min(point.n for point in points)))


def repeat_std_v(points: Sequence[Point]) -> float:
    """Return the standard deviation of the means of windows taken again at the same setting, V; 0 without any."""
    groups: dict[tuple[int, float, float], list[float]] = {}
    for point in points:
        groups.setdefault((point.step, point.rate_deg_s, point.v_vc_v), []).append(point.output_v)
    degrees = sum(len(group) - 1 for group in groups.values())
    if not degrees:
        return 0.0
    centres = {key: math.fsum(group) / len(group) for key, group in groups.items()}
    squares = math.fsum((output_v - centres[key]) ** 2 for key, group in groups.items() for output_v in group)
    return math.sqrt(squares / degrees)


def u_resolution_v(meter_resolution_v: float) -> float:
    """Return the standard uncertainty of a reading by the meter's resolution, V, rectangular."""
    return meter_resolution_v / math.sqrt(12.0)


def fitted_column(points: Sequence[Point], u_v: float | Sequence[float]) -> ScaleFactorResult:
    """Return the line through the outputs of a column, with its residuals."""
    return characterise([point.rate_deg_s for point in points], [point.output_v for point in points], u_v)
